"""The repertoire: what the user takes away from a run."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import (
    MOST_SEED,
    flag,
    function,
    in_short,
    instance,
    mapping,
    number,
    numbers,
    numeric,
    one_of,
    rows_of,
    shown,
    whole,
    whole_numbers,
)
from auroraqd._files import as_path
from auroraqd._notebooks import card, facts_of, figure_of
from auroraqd.deployment import arrays_of, written
from auroraqd.descriptors.descriptor import Descriptor, Transformer
from auroraqd.descriptors.scaling import Scaling, far_outside
from auroraqd.history import History
from auroraqd.individuals import KNOWN, Columns, Individuals, stored
from auroraqd.observations import by_stream, check_same_streams, features_of, has_streams, observations, streams_of
from auroraqd.provenance import genes_in, task_named
from auroraqd.refinement import Ruler, Search, Skills
from auroraqd.tasks import Evaluation, Genes, evaluated
from auroraqd.tasks.noise import other_seeds, seeds_at

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


_MOST_TIMES = 10**6  # that a skill is evaluated again
_MOST_TRIALS = 10**4  # for a goal
_LOOKED_AT = 1000  # skills, to know how many dimensions observations have
_OUTCOMES = "ground_truth", "observation", "descriptor"


class Reached(NamedTuple):
    """The skills whose outcome is closest to a desired one, the closest first.

    Attributes:
        rows: (k,) of the repertoire.
        distance: (k,) to the desired outcome: the root mean square over the entries given, each channel (last axis) scaled to
            [-1, 1] by its range in the repertoire, of which observations far outside all others are left out. Streams that are
            given count alike.
        genotype: (k, n_genes), what to do.
        observation: (k, ...), what it led to when it was found; of streams (k,), each by its name.
        reconstruction: likewise, what the learned descriptor expects there; None if it cannot reconstruct.
    """

    rows: np.ndarray
    distance: np.ndarray
    genotype: np.ndarray
    observation: np.ndarray
    reconstruction: np.ndarray | None

    def __repr__(self) -> str:
        return in_short(self)


class Refined(NamedTuple):
    """Genotypes that come closer to goals than any skill.

    Attributes:
        genotype: (n, n_genes), the best that was found for each goal; where no trial was better, that of the nearest skill.
        outcome: (n, ...) float64, what it led to.
        error: (n,), from there to the goal: see `Reached.distance`, which is of observations; of others it is likewise.
        before: (n,), that of the nearest skill, as it is stored.
        rows: (n,), the nearest skill.
        trials: (n,), how many there were.
    """

    genotype: np.ndarray
    outcome: np.ndarray
    error: np.ndarray
    before: np.ndarray
    rows: np.ndarray
    trials: np.ndarray

    def __repr__(self) -> str:
        return in_short(self)


class Again(NamedTuple):
    """Skills that were evaluated again.

    Attributes:
        fitness: (n, times).
        observation: (n, times, ...).
        error: (n, times), root mean square difference to the stored observation, in its units; of streams, in which each counts
            alike, on the scale of `Reached.distance`. NaN where it is invalid.
        ground_truth: (n, times, ...), or None.
    """

    fitness: np.ndarray
    observation: np.ndarray
    error: np.ndarray
    ground_truth: np.ndarray | None

    def __repr__(self) -> str:
        return in_short(self)


class Origin(Protocol):
    """The run that a repertoire comes from. Asked when it is first needed."""

    def descriptor(self) -> Descriptor:
        """The one that the individuals were found with."""
        ...

    def transformer(self) -> Transformer | None:
        """What the descriptor learned; None where it is read off."""
        ...

    def seed(self) -> int:
        """Of the run."""
        ...

    def config(self) -> dict[str, Any]:
        """The settings of the run."""
        ...

    def history(self) -> History:
        """Of the run."""
        ...


class Repertoire(Individuals):
    """A collection of behaviours: the columns of the archive it comes from, an individual a row, read-only.

    Args:
        columns: at least `genotype`, `fitness`, `observation`, `descriptor`, `curiosity` and `id`, of equal length. `born` and
            `parent` are -1, not known, where they are missing.
        origin: the run they come from.

    Examples:
        >>> import auroraqd
        >>> from sklearn.decomposition import PCA
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0).run(task, generations=10)
        >>> repertoire = auroraqd.load(auroraqd.save(aurora, "runs/repertoire"))
        >>> wanted = repertoire.observation[7]
        >>> repertoire.reach(wanted, k=1).rows
        array([7])
        >>> repertoire.sample(5).shape  # rows that are spread over descriptor space
        (5,)
    """

    def __init__(self, columns: Mapping[str, np.ndarray], origin: Origin):
        columns = {
            name: (observations if name == "observation" else partial(numeric, rows=True))(f"columns[{name!r}]", column)
            for name, column in mapping("columns", columns).items()
        }
        self._origin = origin
        self._take(dict(stored(columns)))

    def _take(self, columns: dict[str, np.ndarray]) -> None:
        for column in columns.values():
            column.flags.writeable = False
        self._columns = Columns(columns)

    @property
    def columns(self) -> Columns:
        """All columns."""
        return self._columns

    def __getstate__(self) -> dict[str, Any]:
        return {"columns": dict(self._columns), "origin": self._origin}  # what was derived from them is derived again

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._origin = state["origin"]
        self._take(state["columns"])  # copies of arrays can be written to

    def __repr__(self) -> str:
        return f"Repertoire of {len(self)} individuals, descriptors of {self.descriptor.shape[1]} dimensions"

    def _repr_html_(self) -> str:
        return card("Repertoire", {**self._run(), **facts_of(self)}, "individuals", self)

    @property
    def folder(self) -> Path | None:
        """The run folder that it comes from; None where it comes from none."""
        return getattr(self._origin, "folder", None)

    def _run(self) -> dict[str, Any]:
        """What its run was, if it is known."""
        try:
            config = self.config
        except (OSError, ValueError, AttributeError):  # an origin of somebody's own
            return {}
        return {"task": task_named(config), "described by": config.get("descriptor"), "seed": config.get("seed")}

    def plot(self) -> Figure:
        """Skills in descriptor space and ground truth, and what was observed: a figure of Matplotlib, which notebooks show.

        Raises:
            ValueError: the repertoire is empty.
        """
        self._check_any("draw")
        return figure_of("repertoire_figure", self)

    @cached_property
    def config(self) -> dict[str, Any]:
        """The settings of the run and where it comes from: `config.json` of its folder, read when it is first asked for.

        Raises:
            FileNotFoundError: it is no longer there.
            ValueError: it is damaged.
        """
        return self._origin.config()

    @cached_property
    def history(self) -> History:
        """How the run went: `history.csv` of its folder, read when it is first asked for.

        Raises:
            FileNotFoundError: it is no longer there.
            ValueError: it is damaged.
        """
        return self._origin.history()

    def describe(self, observation: ArrayLike) -> np.ndarray:
        """Descriptors of other observations, (n, ...) to (n, d), by the learned descriptor of the repertoire.

        Raises:
            RuntimeError: the descriptor is not learned.
            ValueError: wrong shape; or the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        return self._descriptor.describe_observation(observation)

    def reconstruct(self, descriptor: ArrayLike) -> np.ndarray:
        """Observations, (n, ...) in the units of the task, that the learned descriptor expects at descriptors, (n, d).

        Raises:
            RuntimeError: the descriptor is not learned, or has no `inverse_transform`.
            ValueError: wrong shape; or the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        places, d = numbers("descriptor", descriptor), self.descriptor.shape[1]
        if len(self) and (places.ndim != 2 or places.shape[1] != d):
            raise ValueError(f"descriptor must have shape (n, {d}), as those of the repertoire, got {places.shape}")
        return self._descriptor.reconstruct(places)

    def reach(self, observation: ArrayLike | Mapping[str, ArrayLike], k: int = 1) -> Reached:
        """The k skills whose outcome is closest to a desired one.

        Closest by the observation, all of it or the entries that are given; see `Reached.distance`. Two outcomes may have one
        descriptor, which therefore does not decide.

        Args:
            observation: (...), in the shape and units of the task; NaN for what does not matter. Of streams, those that matter,
                by their names.
            k: how many.

        An outcome in ground truth is one for `refine`, or for the repertoire of `auroraqd.deploy`.

        Raises:
            ValueError: wrong shape, an infinity, nothing but NaN, or k larger than the repertoire, which must not be empty; or
                the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        self._check_any("reach")
        whole("k", k, most=len(self))
        try:
            goal = self._goals("observation", "observation", observation)[0]
        except ValueError as error:
            hint = ". It may be a ground truth: refine comes close to those" if self._may_be_truth(observation) else ""
            raise ValueError(f"{error}{hint}") from None
        distance = np.linalg.norm(self._rulers["observation"].apart(self.observation, goal), axis=1)
        rows = np.argsort(distance, kind="stable")[:k]
        descriptor = self._descriptor
        expected = descriptor.reconstruct(self.descriptor[rows]) if descriptor.decode is not None else None
        return Reached(rows, distance[rows], self.genotype[rows], self.observation[rows], expected)

    def refine(
        self,
        task: Callable[..., Any],
        goals: ArrayLike | Mapping[str, ArrayLike],
        by: Literal["ground_truth", "observation", "descriptor"] = "ground_truth",
        trials: int = 10,
        *,
        k: int = 5,
        enough: float = 0.0,
        seed: int = 0,
    ) -> Refined:
        """Come closer to goals than the nearest skills do, by a few trials for each.

        From the k nearest skills, genotypes by linear models of what genes do to the outcome, of skills nearby and of the
        trials before: see `auroraqd.refinement`. The goals do not learn from each other. Everything is deterministic, but for
        the task.

        Args:
            task: see `auroraqd.tasks`; it is called once for each trial, with a genotype for each goal.
            goals: (n, ...), outcomes in the shape and units of those stored; NaN for what does not matter. Of streams, those
                that matter, by their names.
            by: the column in which they are outcomes.
            trials: for each goal, at most.
            k: skills to start from, at most.
            enough: an error that is small enough: then there are no more trials for the goal.
            seed: of a task whose outcome depends on chance, see `evaluate`.

        Returns:
            genotype and outcome, the error now and before, and how many trials it took: see `Refined`. Where outcomes depend on
            chance, the best of several is also the luckiest: `evaluate` others to know.

        Raises:
            RuntimeError: the descriptor is not known.
            TaskError: the task raised, or returned something else than promised.
            TypeError: the task cannot be called.
            ValueError: an argument has the wrong shape or is out of range; there is no ground truth, or no skill.

        Examples:
            >>> import auroraqd
            >>> from sklearn.decomposition import PCA
            >>> task = auroraqd.tasks.Ballistic()
            >>> aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0).run(task, generations=10)
            >>> repertoire = auroraqd.load(auroraqd.save(aurora, "runs/refined"))
            >>> refined = repertoire.refine(task, [[-0.5, -0.3]], trials=5)
            >>> bool(refined.error[0] < refined.before[0] / 100)
            True
        """
        function("task", task)
        self._check_any("refine")
        column = self._led_to(one_of("by", by, _OUTCOMES))
        wanted = self._goals("goals", by, goals, axes=1)
        starts = min(whole("k", k), len(self))
        number("enough", enough)
        skills = Skills(self.genotype, column, self.observation, self._rulers[by], self._rulers["observation"])
        rng = np.random.default_rng(0)
        searches = [Search(skills, goal, starts, rng) for goal in wanted]
        rows, before = np.array([search.row for search in searches]), np.array([search.error for search in searches])
        genotype, outcome = self.genotype[rows], by_stream(_floats, column[rows])
        done = np.zeros(len(wanted), np.int64)
        most = whole("trials", trials, most=_MOST_TRIALS)
        seeds = other_seeds(whole("seed", seed, least=0, most=MOST_SEED), most * len(wanted)).reshape(most, len(wanted))
        for theirs in seeds:
            going = np.flatnonzero([search.error > enough for search in searches])
            if len(going) == 0:
                break
            asked = np.array([searches[row].ask() for row in going])
            found = self._tried(task, asked, theirs[going], by)
            for index, row in enumerate(going):
                if searches[row].tell(asked[index], found[index : index + 1]):
                    genotype[row], outcome[row] = asked[index], found[index]
            done[going] += 1
        return Refined(genotype, outcome, np.array([search.error for search in searches]), before, rows, done)

    def _tried(self, task: Callable[..., Any], genotypes: np.ndarray, seeds: np.ndarray, by: str) -> np.ndarray:
        """The outcomes, float64, of genotypes that nobody knows yet, (k, n_genes), in a column, (k, ...)."""
        evaluation = evaluated(task, genotypes.copy(), seeds, "with genotypes that are refined")
        observed = self._as_stored(evaluation.observation)
        if by == "descriptor":
            names = {"genotype": genotypes, "observation": observed, "ground_truth": evaluation.ground_truth}
            columns = Columns({name: rows for name, rows in names.items() if rows is not None})
            valid, descriptor = self._descriptor.readable(columns), np.full((len(genotypes), self.descriptor.shape[1]), np.nan)
            if valid.any():
                descriptor[valid] = self._descriptor.describe(columns.chosen(np.flatnonzero(valid)))[0]
            return descriptor
        found = observed if by == "observation" else evaluation.ground_truth
        if found is None:
            raise ValueError("by must be observation or descriptor, for the task does not return ground truth")
        if found.shape[1:] != self._led_to(by).shape[1:]:
            raise ValueError(f"{by} must have shape {rows_of(self._led_to(by).shape[1:])}, as stored, got {found.shape}")
        return by_stream(_floats, found)

    def _as_stored(self, observation: np.ndarray) -> np.ndarray:
        """Observations of a task, (n, ...), if they have the shape of those stored."""
        check_same_streams("observation", observation, self.observation)
        shape = self.observation.shape[1:]
        if observation.shape[1:] != shape:
            raise ValueError(f"observation must have shape {rows_of(shape)}, as stored, got {observation.shape}")
        return observation

    def _led_to(self, name: str) -> np.ndarray:
        """One in which outcomes are."""
        if name not in self._columns:
            raise ValueError("by must be observation or descriptor, for no ground truth is stored")
        return self._columns[name]

    @cached_property
    def _rulers(self) -> Mapping[str, Ruler]:
        """What outcomes are measured with, in each column that has some."""
        return {name: Ruler.of(self._columns[name]) for name in _OUTCOMES if name in self._columns}

    def _goals(self, called: str, by: str, goals: Any, axes: int = 0) -> np.ndarray:
        """What is wanted of each entry of a column, (n, features): NaN where nothing is.

        Args:
            called: the argument, for messages.
            by: the column.
            goals: what came.
            axes: 1: there are several; 0: there is one.
        """
        column = self._led_to(by)
        streams, whole = streams_of(column), not has_streams(column)
        wanted = {called: goals} if whole else goals
        names = {called: column} if whole else streams
        if not isinstance(wanted, Mapping) or not wanted or set(wanted) - set(names):
            given = ", ".join(map(str, goals)) or "none" if isinstance(goals, Mapping) else shown(goals)
            raise ValueError(f"{called} must be a mapping of some of {', '.join(streams)} to arrays, got {given}")
        parts: dict[str, np.ndarray] = {}
        for name, values in wanted.items():
            full = name if whole else f"{called} {name}"
            array, shape = numbers(full, values), names[name].shape[1:]
            if array.ndim < axes or array.shape[axes:] != shape or (axes and len(array) == 0):
                of_all = rows_of(shape) if axes else shape
                raise ValueError(f"{full} must have shape {of_all}, as those of the repertoire, got {array.shape}")
            if np.isinf(array).any():
                raise ValueError(f"{full} must have finite entries, or NaN for what does not matter")
            parts[name] = array.reshape(len(array) if axes else 1, -1)
        lengths = {len(part) for part in parts.values()}
        if len(lengths) > 1:
            raise ValueError(f"{called} must have as many rows in each stream, got {' and '.join(map(str, sorted(lengths)))}")
        missing = {name: np.full((max(lengths), features_of(stream)), np.nan) for name, stream in names.items()}
        found = np.concatenate(list((missing | parts).values()), axis=1)
        if np.isnan(found).all(axis=1).any():
            raise ValueError(f"{called} must have finite entries, or NaN for what does not matter, but not NaN alone")
        return found

    def _may_be_truth(self, values: Any) -> bool:
        """Whether what is no observation has the shape of one ground truth."""
        try:
            return self.ground_truth is not None and np.shape(values) == self.ground_truth.shape[1:]
        except ValueError:  # rows of several lengths
            return False

    def explained(self) -> np.ndarray:
        """Which share of the variance of what was observed the first principal components hold: how large a descriptor may be.

        Each channel counts by its range, streams alike. Of more than a thousand skills, some are looked at, evenly spread.

        Returns:
            (k,) the share of the first, of the first two, and so on; the last is 1.

        Raises:
            ValueError: the repertoire is empty.

        Examples:
            >>> import auroraqd
            >>> aurora = auroraqd.Aurora(2, "genotype", seed=0).run(auroraqd.tasks.Ballistic(), generations=2)
            >>> auroraqd.load(auroraqd.save(aurora, "runs/explained")).explained()[:3].round(2)
            array([0.53, 0.95, 0.98])
        """
        self._check_any("look at")
        some = self.observation[:: -(-len(self) // _LOOKED_AT)]
        rows = Ruler.of(some).apart(some, np.zeros(features_of(some)))
        rows -= rows.mean(axis=0)
        products = rows @ rows.T if len(rows) < rows.shape[1] else rows.T @ rows
        variance = np.clip(np.linalg.eigvalsh(products)[::-1], 0, None)
        total = variance.sum()
        return np.cumsum(variance) / total if total > 0 else np.ones(len(variance))

    def sample(self, n: int) -> np.ndarray:
        """Rows of n skills spread over descriptor space, always the same; fewer, if the rest are copies. See `diverse`."""
        return diverse(self.descriptor, whole("n", n))

    def outlying(self) -> np.ndarray:
        """Rows of skills whose observations lie far outside all others, (m,); see `auroraqd.descriptors.scaling.far_outside`.

        They are set aside when the descriptor is fitted: a simulation may have blown up.
        """
        return np.flatnonzero(far_outside(self.observation))

    def evaluate(
        self,
        task: Callable[..., Any],
        rows: ArrayLike | None = None,
        times: int = 1,
        *,
        seed: int = 0,
        seeds: Literal["new", "found"] = "new",
    ) -> Again:
        """Run skills again, to see how repeatable they are, or what another robot makes of them.

        Args:
            task: see `auroraqd.tasks`; its observations must have the shape of those stored.
            rows: (n,) of the repertoire, all of it by default.
            times: how often.
            seed: of a task whose outcome depends on chance: each evaluation gets one of its own from it, none of a run's.
            seeds: "found": each skill gets the seed instead that it was found with, each time the same.

        Returns:
            fitness, observation, error to the stored observation, and ground truth, of each skill each time: see `Again`.

        Raises:
            IndexError, ValueError: there are no such rows, an argument is out of range, or it is not known with which seed a
                skill was found.
            TaskError: the task raised, or returned something else than promised.
            TypeError: the task cannot be called.
        """
        function("task", task)
        one_of("seeds", seeds, ("new", "found"))
        self._check_any("evaluate")
        chosen = np.arange(len(self)) if rows is None else self._rows(rows)
        genotype, stored = self.genotype[chosen], self.observation[chosen]
        found = []
        again = self._seeds(
            seeds, whole("seed", seed, least=0, most=MOST_SEED), whole("times", times, most=_MOST_TIMES), chosen
        )
        for theirs in again:  # copies, for the task may change what it is given, and use again what it returns
            evaluation = evaluated(task, genotype.copy(), theirs.copy(), "with skills of the repertoire")
            found.append(Evaluation(*(None if column is None else np.array(column) for column in evaluation)))
        for evaluation in found:
            self._as_stored(evaluation.observation)
        fitness = np.stack([evaluation.fitness for evaluation in found], axis=1)
        observation = np.stack([evaluation.observation for evaluation in found], axis=1)
        error = self._difference(observation, stored)
        truths = [evaluation.ground_truth for evaluation in found if evaluation.ground_truth is not None]
        return Again(fitness, observation, error, np.stack(truths, axis=1) if truths else None)

    def _difference(self, again: np.ndarray, stored: np.ndarray) -> np.ndarray:
        """(n, times): see `Again.error`."""
        usual, squares = None, []
        for name, stream in streams_of(stored).items():
            of_all = streams_of(again)[name] if has_streams(again) else again
            difference = (of_all.astype(np.float64) - stream[:, None]).reshape(*again.shape[:2], -1)
            if has_streams(stored):
                usual = ~far_outside(self.observation) if usual is None else usual
                difference /= Scaling.of(self.observation[name][usual]).scaler(difference.shape[2]).half
            squares.append(np.mean(np.where(np.isfinite(difference), difference, np.nan) ** 2, axis=2))
        return np.sqrt(np.mean(squares, axis=0))

    def _seeds(self, which: str, seed: int, times: int, rows: np.ndarray) -> np.ndarray:
        """Seeds to evaluate rows with, (times, n) uint64."""
        if which == "new":
            return other_seeds(seed, times * len(rows)).reshape(times, len(rows))
        unknown = np.count_nonzero(self.born[rows] < 0)
        if unknown:
            raise ValueError(
                f"seeds must be 'new' for {unknown} of these {len(rows)} skills: which evaluation found them is not known, for "
                "an earlier version did not keep it (their born is -1)"
            )
        return np.tile(seeds_at(self._origin.seed(), self.born[rows]), (times, 1))

    def deploy(self, folder: str | os.PathLike, rows: ArrayLike | None = None, *, overwrite: bool = False) -> Path:
        """Write a folder for a robot whose computer has NumPy and nothing else; see `auroraqd.deployment`.

        `skills.npz` has the columns, with names, bounds and units of the genes if the run knows them. `skills.py` reads it:
        `reach(goal)` there is that of here, and `describe(observation)` too, where the descriptor is one matrix, PCA for
        instance. A README says how to use them.

        Args:
            folder: to create.
            rows: (n,) of the repertoire, all of it by default.
            overwrite: whether it may be there: then files of these names are replaced.

        Returns:
            The folder.

        Raises:
            FileExistsError: it is there.
            IndexError, ValueError: there are no such rows, or no skills.
            OSError: it cannot be written.

        Examples:
            >>> import auroraqd
            >>> from sklearn.decomposition import PCA
            >>> task = auroraqd.tasks.Ballistic()
            >>> aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0).run(task, generations=2)
            >>> repertoire = auroraqd.load(auroraqd.save(aurora, "runs/deployed"))
            >>> sorted(path.name for path in repertoire.deploy("robot").iterdir())
            ['README.md', 'skills.npz', 'skills.py']
        """
        path, overwrite = as_path("folder", folder), flag("overwrite", overwrite)
        self._check_any("deploy")
        chosen = np.arange(len(self)) if rows is None else self._rows(rows) % len(self)
        try:
            affine = self._descriptor.affine
        except (ValueError, AttributeError):  # of a type that is not trusted: auroraqd's and PCA are
            affine = None
        run = self._run()
        origin = f", on {run['task']}, seed {run['seed']}" if run.get("task") else ""
        written(path, arrays_of(self._columns, chosen, self._rulers, self._genes(), affine), origin, overwrite)
        return path

    def to_pandas(self, genes: Genes | None = None, observation: bool = True) -> pandas.DataFrame:
        """A table, a skill a row, which pandas writes to CSV, Parquet and others. Needs pandas, the extra `tables`.

        Args:
            genes: their names are columns then, in their units, instead of genotype_0, ... in [0, 1]. By default those of the
                task of the run, if it has an attribute `genes`.
            observation: whether its entries are columns too: observation_0_1, ...

        Raises:
            TypeError: genes are something else.
            ValueError: pandas is not installed, or genes are of another number, or called like another column.
        """
        instance("genes", genes, Genes | None, "auroraqd.tasks.Genes, or None")
        flag("observation", observation)
        try:
            import pandas
        except ImportError:
            raise ValueError('pandas is not installed: pip install "auroraqd[tables]"') from None
        genes = self._genes() if genes is None else genes
        others: dict[str, np.ndarray] = {}
        for name, rows in self._columns.items():
            if (name == "observation" and not observation) or (name == "genotype" and genes is not None):
                continue
            for stream, entries in streams_of(rows).items():
                called = (name, stream) if has_streams(rows) else (name,)
                for index in np.ndindex(*entries.shape[1:]):
                    others["_".join(map(str, (*called, *index)))] = entries[(slice(None), *index)]
        twice = [] if genes is None else [name for name in genes.names if name in others]
        if twice:
            raise ValueError(f"genes must not be called like other columns of the table: {', '.join(twice)}")
        # Of a run that has stored nothing, it is not known how many genes there are.
        genotype = self.genotype if genes is None or len(self) else np.empty((0, len(genes)))
        named = {} if genes is None else dict(zip(genes.names, genes.scale(genotype).T, strict=True))
        return pandas.DataFrame({**named, **others})

    def _genes(self) -> Genes | None:
        """Those of the task, if its run folder is there and they are of use."""
        try:
            genes = genes_in(self.config)
        except (OSError, ValueError, AttributeError):  # an origin of somebody's own
            return None
        return None if genes is None or len(genes) != self.genotype.shape[1] or set(genes.names) & set(KNOWN) else genes

    def _check_any(self, purpose: str) -> None:
        if len(self) == 0:
            raise ValueError(f"the repertoire is empty, nothing was stored in its run: there is no skill to {purpose}")

    def _rows(self, rows: ArrayLike) -> np.ndarray:
        """Rows that there are, (n,), of which there must be one."""
        chosen = np.atleast_1d(whole_numbers("rows", rows, some=True))
        if chosen.ndim != 1:
            raise ValueError(f"rows must have shape (n,), got {chosen.shape}")
        wrong = chosen[(chosen < -len(self)) | (chosen >= len(self))]
        if len(wrong):
            raise IndexError(f"rows must be of the repertoire, 0 to {len(self) - 1}, got {wrong[0]}")
        return chosen

    @cached_property
    def _descriptor(self) -> Descriptor:
        return self._origin.descriptor()


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


def _floats(rows: np.ndarray) -> np.ndarray:
    return rows.astype(np.float64)


def _squared(places: np.ndarray, place: np.ndarray) -> np.ndarray:
    return ((places - place) ** 2).sum(axis=1)
