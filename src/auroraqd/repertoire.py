"""The repertoire: what the user takes away from a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
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
    numbers,
    numeric,
    one_of,
    shown,
    whole,
    whole_numbers,
)
from auroraqd._notebooks import card, facts_of, figure_of
from auroraqd.descriptors.descriptor import Descriptor, Transformer
from auroraqd.descriptors.scaling import Scaling, far_outside
from auroraqd.history import History
from auroraqd.individuals import KNOWN, Columns, Individuals, stored
from auroraqd.observations import check_same_streams, has_streams, observations, streams_of
from auroraqd.provenance import genes_in, task_named
from auroraqd.tasks import Evaluation, Genes, evaluated
from auroraqd.tasks.noise import other_seeds, seeds_at

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


_MOST_TIMES = 10**6  # that a skill is evaluated again


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
            name: (observations if name == "observation" else partial(numeric, rows=True))(f"column {name}", column)
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

        Raises:
            ValueError: wrong shape, an infinity, nothing but NaN, or k larger than the repertoire, which must not be empty; or
                the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        self._check_any("reach")
        whole("k", k, most=len(self))
        usual = ~far_outside(self.observation)
        squares = []
        for name, wanted in self._outcome(observation).items():
            stream, given = streams_of(self.observation)[name], ~np.isnan(wanted)
            half = Scaling.of(stream[usual]).scaler(wanted.size).half[given.ravel()]
            difference = (stream.reshape(len(self), -1)[:, given.ravel()] - wanted[given]) / half
            squares.append(np.mean(difference**2, axis=1))
        distance = np.sqrt(np.mean(squares, axis=0))
        rows = np.argsort(distance, kind="stable")[:k]
        descriptor = self._descriptor
        expected = descriptor.reconstruct(self.descriptor[rows]) if descriptor.decode is not None else None
        return Reached(rows, distance[rows], self.genotype[rows], self.observation[rows], expected)

    def _outcome(self, observation: Any) -> dict[str, np.ndarray]:
        """What is wanted of each stream, or of the observation if it is one array, (...), if anything of it is."""
        streams, whole = streams_of(self.observation), not has_streams(self.observation)
        wanted = {"observation": observation} if whole else observation
        if not isinstance(wanted, Mapping) or not wanted or set(wanted) - set(streams):
            raise ValueError(
                f"observation must be a mapping of some of {', '.join(streams)} to arrays, got {shown(observation)}"
            )
        found = {}
        for name, values in wanted.items():
            called = name if whole else f"observation {name}"
            array, shape = numbers(called, values), streams[name].shape[1:]
            if array.shape != shape:
                raise ValueError(f"{called} must have shape {shape}, as those of the repertoire, got {array.shape}")
            if np.isinf(array).any():
                raise ValueError(f"{called} must have finite entries, or NaN for what does not matter")
            if not np.isnan(array).all():
                found[name] = array
        if not found:
            raise ValueError("observation must have finite entries, or NaN for what does not matter, but not NaN alone")
        return found

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
            check_same_streams("observation", evaluation.observation, stored)
            if evaluation.observation.shape != stored.shape:
                raise ValueError(f"observation must have shape {stored.shape}, as stored, got {evaluation.observation.shape}")
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
        except (OSError, ValueError):
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


def _squared(places: np.ndarray, place: np.ndarray) -> np.ndarray:
    return ((places - place) ** 2).sum(axis=1)
