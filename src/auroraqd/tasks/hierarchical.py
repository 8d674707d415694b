"""Hierarchies: what a robot does is a sequence of skills that it has, and not of motor commands.

A gene vector names places in the descriptor space of a repertoire, one for each step. At each place the nearest skill is
executed, and the next one begins where it ended. What is found by such a task is a repertoire too, of which the next layer can
be made, after A. Cully, Y. Demiris, Hierarchical Behavioral Repertoires with Unsupervised Descriptors, GECCO 2018.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from scipy.spatial import KDTree

from auroraqd._checks import check_genotypes, function, numbers, one_of, seeds_for, shown, whole
from auroraqd.observations import has_streams, streams_of
from auroraqd.tasks import Evaluation, as_evaluation, name_of

_MOST_STEPS = 10**6
_SPACES = "descriptor", "ground_truth"


class Hierarchical:
    """A task whose genes name skills of a repertoire, which are executed one after the other.

    Called with genotypes, (n, n_genes), it returns an `Evaluation`:

    - fitness (n,): the sum over the steps;
    - observation (n, steps, ...): of each step, of streams likewise;
    - ground_truth (n, ...): of the last step, or None.

    Args:
        skills: a repertoire, or an archive: `genotype`, (m, genes), and the column in which places are.
        task: executes skills. Another `Hierarchical`, whose skills they are; a `Hexapod`; or a function `task(genotypes,
            state)` that returns an evaluation, as any task does, and the state in which it leaves n robots. It is called with
            state None where they begin, and else with what it returned before. If it has an attribute `seeded` that is true,
            it is called as `task(genotypes, state, seeds)`. A task with a method `carried` does so by that.
        steps: how many skills follow each other.
        by: the column in which genes name places: "descriptor" or "ground_truth". Genes from 0 to 1 go from the lowest to the
            highest place there, in each dimension.

    Attributes:
        n_genes: steps times the dimensions of a place.
        layers: run folders that the skills come from, those of all layers below too, the nearest first.

    Raises:
        TypeError: the task cannot be called.
        ValueError: there are no skills, or they have other genes than the task takes, or an argument is out of range.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> def move(genotypes, state):  # a step of up to 1 m in a plane
        ...     here = (0 if state is None else state) + 2 * genotypes - 1
        ...     return here, here
        >>> aurora = auroraqd.Aurora(2, "observation", seed=0)
        >>> _ = aurora.run(lambda genotypes: move(genotypes, None)[0], generations=2)
        >>> walk = auroraqd.tasks.Hierarchical(aurora.archive, move, steps=3)
        >>> walk.n_genes
        6
        >>> walk(np.ones((1, 6))).observation.shape
        (1, 3, 2)
    """

    def __init__(
        self, skills: Any, task: Callable[..., Any], steps: int, by: Literal["descriptor", "ground_truth"] = "descriptor"
    ):
        self.task = function("task", task)
        self.steps, self.by = whole("steps", steps, most=_MOST_STEPS), one_of("by", by, _SPACES)
        genotype, places = getattr(skills, "genotype", None), getattr(skills, by, None)
        if genotype is None or places is None:
            raise ValueError(f"skills must be a repertoire or an archive with genotypes and {by}, got {shown(skills)}")
        if len(genotype) == 0:
            raise ValueError("skills must be one at least, and the repertoire is empty")
        takes = getattr(task, "n_genes", genotype.shape[1])
        if takes != genotype.shape[1]:
            raise ValueError(f"skills must have {takes} genes, as the task that executes them takes, got {genotype.shape[1]}")
        self._genotype, self._places = np.array(genotype), numbers("places", places).reshape(len(genotype), -1).copy()
        self._nearest = KDTree(self._places)
        self.n_genes = self.steps * self._places.shape[1]
        self.seeded = bool(getattr(task, "seeded", False))
        folder = getattr(skills, "folder", None)
        self.layers: list[str] = [] if folder is None else [os.fspath(folder)]
        self.layers += getattr(task, "layers", [])

    def __repr__(self) -> str:
        content = hashlib.blake2b(self._genotype.tobytes() + self._places.tobytes(), digest_size=4).hexdigest()
        task = repr(self.task) if isinstance(self.task, Hierarchical) else name_of(self.task)
        return f"Hierarchical({len(self._genotype)} skills {content}, {task}, steps={self.steps}, by={self.by!r})"

    def rows(self, genotypes: np.ndarray) -> np.ndarray:
        """Which skills genotypes, (n, n_genes) in [0, 1], execute: rows of the repertoire, (n, steps).

        Raises:
            ValueError: genotypes have the wrong shape, or leave [0, 1].
        """
        genotypes = numbers("genotypes", genotypes, " of shape (n, n_genes)", axes=2, some=True)
        check_genotypes("there must be", genotypes, (len(genotypes), self.n_genes))
        low, high = self._places.min(axis=0), self._places.max(axis=0)
        places = low + genotypes.reshape(len(genotypes), self.steps, -1) * (high - low)
        return np.asarray(self._nearest.query(places)[1])

    def __call__(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> Evaluation:
        """See the class; with seeds, (n,), if it is seeded."""
        return self.carried(genotypes, None, seeds)[0]

    def carried(self, genotypes: np.ndarray, state: Any, seeds: np.ndarray | None = None) -> tuple[Evaluation, Any]:
        """From the state in which others left the robots, None where they begin: what they do, and the state they are in then.

        Raises:
            ValueError: the genotypes are none, or the task returned something else than promised.
        """
        rows = self.rows(genotypes)
        execute = getattr(self.task, "carried", self.task)
        done = []
        for step in range(self.steps):
            skills = self._genotype[rows[:, step]]
            given = (skills, state, self._seeds(seeds, step, len(rows))) if self.seeded else (skills, state)
            result = execute(*given)
            if not isinstance(result, tuple) or len(result) != 2:
                came = f"a tuple of {len(result)}" if isinstance(result, tuple) else type(result).__name__
                raise ValueError(f"the task of a Hierarchical must return a pair, (evaluation, state), got {came}")
            evaluation, state = result
            try:
                evaluation = as_evaluation(evaluation, len(rows))
            except ValueError as error:
                of = "of the pair (evaluation, state) that the task of a Hierarchical must return, the first"
                raise ValueError(f"{of}: {error}") from None
            done.append(Evaluation(*(None if column is None else column.copy() for column in evaluation)))
        fitness = np.sum([evaluation.fitness for evaluation in done], axis=0)
        return Evaluation(fitness, _stacked([e.observation for e in done]), done[-1].ground_truth), state

    def _seeds(self, seeds: Any, step: int, n: int) -> np.ndarray:
        """Those of a step, (n,) uint64."""
        if seeds is None:
            raise ValueError("seeds must be given, (n,) whole numbers, for the task is seeded")
        return np.array(
            [np.random.PCG64(int(seed)).advance(step).random_raw() for seed in seeds_for("seeds", seeds, n)], np.uint64
        )


def _stacked(observations: list[np.ndarray]) -> Any:
    """Observations of all steps, (n, ...) each, as (n, steps, ...)."""
    if not has_streams(observations[0]):
        return np.stack(observations, axis=1)
    return {name: np.stack([each[name] for each in observations], axis=1) for name in streams_of(observations[0])}
