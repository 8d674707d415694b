"""The repertoire: what the user takes away from a run."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import in_short, numbers, whole
from auroraqd.descriptor import Descriptor
from auroraqd.scaling import Scaling
from auroraqd.tasks import Evaluation, Genes, evaluated
from auroraqd.tasks.noise import other_seeds

if TYPE_CHECKING:
    import pandas

REQUIRED = ("genotype", "fitness", "observation", "descriptor", "curiosity", "id")
OPTIONAL = ("ground_truth", "reconstruction_error")


class Reached(NamedTuple):
    """The skills whose outcome is closest to a desired one, the closest first.

    Attributes:
        rows: (k,) of the repertoire.
        distance: (k,) to the desired outcome: in descriptor space, or, where it is only partly specified, the root mean square
            over the entries given, each channel scaled to [-1, 1] by its range in the repertoire.
        genotype: (k, n_genes), what to do.
        observation: (k, ...), what it led to when it was found.
        reconstruction: (k, ...), what the learned descriptor expects there; None if it cannot reconstruct.
    """

    rows: np.ndarray
    distance: np.ndarray
    genotype: np.ndarray
    observation: np.ndarray
    reconstruction: np.ndarray | None

    def __repr__(self) -> str:
        return in_short(self)


class Again(NamedTuple):
    """Skills that were evaluated again.

    Attributes:
        fitness: (n, times).
        observation: (n, times, ...).
        error: (n, times), root mean square difference to the stored observation, in its units; NaN where it is invalid.
        ground_truth: (n, times, ...), or None.
    """

    fitness: np.ndarray
    observation: np.ndarray
    error: np.ndarray
    ground_truth: np.ndarray | None

    def __repr__(self) -> str:
        return in_short(self)


class Repertoire:
    """A collection of behaviours: the columns of the archive it comes from, an individual a row, read-only.

    Args:
        columns: at least `genotype`, `fitness`, `observation`, `descriptor`, `curiosity` and `id`, of equal length.
        descriptor: gives the descriptor they were found with; called when it is first needed.
    """

    def __init__(self, columns: Mapping[str, np.ndarray], descriptor: Callable[[], Descriptor]):
        missing = [name for name in REQUIRED if name not in columns]
        if missing:
            raise ValueError(f"a repertoire must have the columns {', '.join(REQUIRED)}; there is no {', '.join(missing)}")
        if len({len(column) for column in columns.values()}) > 1:
            raise ValueError(f"the columns of a repertoire must be of one length, got {[len(c) for c in columns.values()]}")
        for name, ndim in (("genotype", 2), ("fitness", 1), ("descriptor", 2), ("curiosity", 1), ("id", 1)):
            if columns[name].ndim != ndim:
                raise ValueError(f"{name} must have {ndim} axes, got shape {columns[name].shape}")
        self._columns = dict(columns)
        for column in self._columns.values():
            column.flags.writeable = False
        self._load_descriptor = descriptor
        self._descriptor: Descriptor | None = None

    def __len__(self) -> int:
        return len(self._columns["id"])

    def __repr__(self) -> str:
        return f"Repertoire of {len(self)} individuals, descriptors of {self.descriptor.shape[1]} dimensions"

    @property
    def genotype(self) -> np.ndarray:
        """(n, n_genes) float64."""
        return self._columns["genotype"]

    @property
    def fitness(self) -> np.ndarray:
        """(n,) float64."""
        return self._columns["fitness"]

    @property
    def observation(self) -> np.ndarray:
        """(n, ...), in the shape and dtype of the task."""
        return self._columns["observation"]

    @property
    def descriptor(self) -> np.ndarray:
        """(n, d) float64."""
        return self._columns["descriptor"]

    @property
    def ground_truth(self) -> np.ndarray | None:
        """(n, ...), or None."""
        return self._columns.get("ground_truth")

    @property
    def reconstruction_error(self) -> np.ndarray | None:
        """(n,) float64, or None."""
        return self._columns.get("reconstruction_error")

    @property
    def curiosity(self) -> np.ndarray:
        """(n,) float64."""
        return self._columns["curiosity"]

    @property
    def id(self) -> np.ndarray:
        """(n,) int64."""
        return self._columns["id"]

    def describe(self, observation: ArrayLike) -> np.ndarray:
        """Descriptors of other observations, (n, ...) to (n, d), by the learned descriptor of the repertoire.

        Raises:
            RuntimeError: the descriptor is not learned.
            ValueError: wrong shape; or the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        return self._loaded().describe_observation(observation)

    def reconstruct(self, descriptor: ArrayLike) -> np.ndarray:
        """Observations, (n, ...) in the units of the task, that the learned descriptor expects at descriptors, (n, d).

        Raises:
            RuntimeError: the descriptor is not learned, or has no `inverse_transform`.
            ValueError: wrong shape; or the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        places, d = numbers("descriptor", descriptor), self.descriptor.shape[1]
        if len(self) and (places.ndim != 2 or places.shape[1] != d):
            raise ValueError(f"descriptor must have shape (n, {d}), as those of the repertoire, got {places.shape}")
        return self._loaded().reconstruct(places)

    def reach(self, observation: ArrayLike, k: int = 1) -> Reached:
        """The k skills whose outcome is closest to a desired one.

        Through the learned descriptor; where the descriptor is not learned, or the outcome is only partly specified, on the
        entries of the observation that are given.

        Args:
            observation: (...), in the shape and units of the task; NaN for what does not matter.
            k: how many.

        Raises:
            ValueError: wrong shape, an infinity, nothing but NaN, or k larger than the repertoire, which must not be empty; or
                the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        self._check_any("reach")
        whole("k", k, most=len(self))
        wanted, shape = numbers("observation", observation), self.observation.shape[1:]
        if wanted.shape != shape:
            raise ValueError(f"observation must have shape {shape}, as those of the repertoire, got {wanted.shape}")
        given = ~np.isnan(wanted)
        if np.isinf(wanted).any() or not given.any():
            raise ValueError("observation must have finite entries, or NaN for what does not matter, but not NaN alone")
        descriptor = self._loaded()
        if given.all() and descriptor.learned:
            distance = np.linalg.norm(self.descriptor - descriptor.describe_observation(wanted[None])[0], axis=1)
        else:
            half = Scaling.of(self.observation).scaler(wanted.size).half[given.ravel()]
            difference = (self.observation.reshape(len(self), -1)[:, given.ravel()] - wanted[given]) / half
            distance = np.sqrt(np.mean(difference**2, axis=1))
        rows = np.argsort(distance, kind="stable")[:k]
        expected = descriptor.reconstruct(self.descriptor[rows]) if descriptor.decode is not None else None
        return Reached(rows, distance[rows], self.genotype[rows], self.observation[rows], expected)

    def sample(self, n: int) -> np.ndarray:
        """Rows of n skills spread over descriptor space, always the same; fewer, if the rest are copies. See `diverse`."""
        return diverse(self.descriptor, whole("n", n))

    def evaluate(self, task: Callable[..., Any], rows: ArrayLike | None = None, times: int = 1, *, seed: int = 0) -> Again:
        """Run skills again, to see how repeatable they are, or what another robot makes of them.

        Args:
            task: see `auroraqd.tasks`; its observations must have the shape of those stored.
            rows: (n,) of the repertoire, all of it by default.
            times: how often.
            seed: of a task whose outcome depends on chance: each evaluation gets one of its own from it, none of a run's.

        Returns:
            fitness, observation, error to the stored observation, and ground truth, of each skill each time: see `Again`.

        Raises:
            IndexError, ValueError: there are no such rows, or an argument is out of range.
            TaskError: the task raised, or returned something else than promised.
            TypeError: the task cannot be called.
        """
        if isinstance(task, type) or not callable(task):
            raise TypeError(f"task must be callable, an instance and not a class, got {task!r}")
        self._check_any("evaluate")
        chosen = np.arange(len(self)) if rows is None else self._rows(rows)
        genotype, stored = self.genotype[chosen], self.observation[chosen]
        seeds = other_seeds(whole("seed", seed, least=0), whole("times", times) * len(chosen)).reshape(times, len(chosen))
        found = []
        for theirs in seeds:  # copies, for the task may change what it is given, and use again what it returns
            evaluation = evaluated(task, genotype.copy(), theirs.copy(), "with skills of the repertoire")
            found.append(Evaluation(*(None if column is None else np.array(column) for column in evaluation)))
        for evaluation in found:
            if evaluation.observation.shape != stored.shape:
                raise ValueError(f"observation must have shape {stored.shape}, as stored, got {evaluation.observation.shape}")
        fitness = np.stack([evaluation.fitness for evaluation in found], axis=1)
        observation = np.stack([evaluation.observation for evaluation in found], axis=1)
        difference = (observation.astype(np.float64) - stored[:, None]).reshape(*fitness.shape, -1)
        error = np.sqrt(np.mean(np.where(np.isfinite(difference), difference, np.nan) ** 2, axis=2))
        truths = [evaluation.ground_truth for evaluation in found if evaluation.ground_truth is not None]
        return Again(fitness, observation, error, np.stack(truths, axis=1) if truths else None)

    def to_pandas(self, genes: Genes | None = None, observation: bool = True) -> pandas.DataFrame:
        """A table, a skill a row, which pandas writes to CSV, Parquet and others. Needs pandas, the extra `tables`.

        Args:
            genes: their names are columns then, in their units, instead of genotype_0, ... in [0, 1].
            observation: whether its entries are columns too: observation_0_1, ...

        Raises:
            TypeError: genes are something else.
            ValueError: pandas is not installed, or genes are of another number, or called like another column.
        """
        if genes is not None and not isinstance(genes, Genes):
            raise TypeError(f"genes must be auroraqd.tasks.Genes, or None, got {genes!r}")
        try:
            import pandas
        except ImportError:
            raise ValueError('pandas is not installed: pip install "auroraqd[tables]"') from None
        others: dict[str, np.ndarray] = {}
        for name, rows in self._columns.items():
            if (name == "observation" and not observation) or (name == "genotype" and genes is not None):
                continue
            if rows.ndim == 1:
                others[name] = rows
            else:
                for index in np.ndindex(*rows.shape[1:]):
                    others["_".join(map(str, (name, *index)))] = rows[(slice(None), *index)]
        twice = [] if genes is None else [name for name in genes.names if name in others]
        if twice:
            raise ValueError(f"genes must not be called like other columns of the table: {', '.join(twice)}")
        # Of a run that has stored nothing, it is not known how many genes there are.
        genotype = self.genotype if genes is None or len(self) else np.empty((0, len(genes)))
        named = {} if genes is None else dict(zip(genes.names, genes.scale(genotype).T, strict=True))
        return pandas.DataFrame({**named, **others})

    def _check_any(self, purpose: str) -> None:
        if len(self) == 0:
            raise ValueError(f"the repertoire is empty, nothing was stored in its run: there is no skill to {purpose}")

    def _rows(self, rows: ArrayLike) -> np.ndarray:
        """Rows that there are, (n,), of which there must be one."""
        try:
            chosen = np.atleast_1d(np.asarray(rows))
        except ValueError:
            chosen = np.empty((0, 0))
        if chosen.ndim != 1 or chosen.size == 0 or chosen.dtype.kind not in "iu":
            raise ValueError(f"rows must be whole numbers of shape (n,), at least one, got {reprlib.repr(rows)}")
        wrong = chosen[(chosen < -len(self)) | (chosen >= len(self))]
        if len(wrong):
            raise IndexError(f"rows must be of the repertoire, 0 to {len(self) - 1}, got {wrong[0]}")
        return chosen

    def _loaded(self) -> Descriptor:
        if self._descriptor is None:
            self._descriptor = self._load_descriptor()
        return self._descriptor


def diverse(descriptor: np.ndarray, n: int) -> np.ndarray:
    """Rows of n descriptors that are far from each other; of fewer, if the rest are copies.

    The first is the one farthest from the mean, the next always the one farthest from all before.

    Args:
        descriptor: (m, d).
        n: how many.
    """
    if len(descriptor) == 0:
        return np.empty(0, np.int64)
    # By a power of two, which changes no digit, so that squares do not overflow.
    descriptor = descriptor * 0.5 ** max(int(np.frexp(np.abs(descriptor).max(initial=0))[1]) - 300, 0)
    chosen: list[int] = []
    distance = _squared(descriptor, descriptor.mean(axis=0))
    while len(chosen) < min(n, len(descriptor)) and not (chosen and distance.max() == 0):
        row = int(distance.argmax())
        from_it = _squared(descriptor, descriptor[row])
        distance = np.minimum(distance, from_it) if chosen else from_it
        chosen.append(row)
    return np.array(chosen, np.int64)


def _squared(places: np.ndarray, place: np.ndarray) -> np.ndarray:
    return ((places - place) ** 2).sum(axis=1)
