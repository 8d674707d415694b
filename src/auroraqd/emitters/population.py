"""Evolution of a population beside the archive: novelty search, with local competition, and TAXONS.

The population is what parents are taken from; it may hold individuals that the archive has not stored. Novelty is measured
among both, each individual counting once: individuals are known by the numbers of their evaluations, `born`.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auroraqd._checks import function, in_words, whole
from auroraqd.archives._ranked import mean_distance, nearest
from auroraqd.archives.base import INVALID, Archive, Info
from auroraqd.emitters.selection import surprise
from auroraqd.emitters.variation import Gaussian, Polynomial
from auroraqd.individuals import Columns
from auroraqd.observations import finite_rows

_KEPT = ("genotype", "fitness", "observation", "ground_truth", "descriptor", "reconstruction_error", "born", "id")


@dataclass
class _Bred:
    """What emitters with a population share.

    `_best_first` puts individuals in order; the population is kept in it.
    """

    population: int = 100
    k: int = 15
    variation: Callable[[np.ndarray, np.random.Generator], np.ndarray] = field(default_factory=Polynomial)

    __repr__ = in_words

    def __post_init__(self) -> None:
        whole("population", self.population)
        whole("k", self.k)
        function("variation", self.variation)
        if getattr(self.variation, "n_parents", 1) != 1:
            raise ValueError(f"variation must be of one parent, got {self.variation!r}")
        self._members = Columns({})

    @property
    def members(self) -> Columns:
        """The population, best first; no rows before the first individuals were asked for."""
        return self._members

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See `auroraqd.emitters`. The first population is the best that the archive holds."""
        if self._members.rows == 0:
            self._members = self._chosen(archive.columns.only(*_KEPT), archive).copied()
        rows = self._parents(n, rng)
        children = np.clip(self.variation(self._members["genotype"][rows], rng), 0, 1)
        return children, self._members["id"][rows]

    def tell(self, archive: Archive, batch: Columns, info: Info) -> None:
        """See `auroraqd.emitters`: parents and children are put in order, and the best are the next population."""
        self._members = self._chosen(_joined(self._members, _newcomers(archive, batch, info)), archive)

    def updated(self, archive: Archive, describe: Callable[[Columns], Columns]) -> None:
        """See `auroraqd.emitters`. Whom the new descriptor cannot describe is no longer a member."""
        if self._members.rows:
            members = describe(self._members.without("descriptor", "reconstruction_error"))
            self._members = members.take(finite_rows(members["descriptor"]))

    def state(self) -> dict[str, Any]:
        """The population."""
        return dict(self._members)

    def restore(self, state: Mapping[str, Any]) -> None:
        """Become what had this `state`."""
        self._members = Columns({name: value for name, value in state.items() if isinstance(value, np.ndarray)})

    def _parents(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """(n,) rows of the population, by tournaments of two: they are in order, so the lower wins."""
        return rng.integers(self._members.rows, size=(n, 2)).min(axis=1)

    def _chosen(self, individuals: Columns, archive: Archive) -> Columns:
        """The best, best first."""
        if individuals.rows == 0:
            return individuals
        return individuals.take(self._best_first(individuals, archive)[: self.population])

    def _best_first(self, individuals: Columns, archive: Archive) -> np.ndarray:
        raise NotImplementedError


@dataclass(repr=False)
class NoveltySearch(_Bred):
    """Novelty search: the most novel of parents and children are the next population.

    J. Lehman, K. O. Stanley, Abandoning Objectives: Evolution Through the Search for Novelty Alone, Evolutionary Computation
    19(2), 2011.

    Args:
        population: individuals in it.
        k: neighbours that make up the novelty.
        variation: `vary(parents, rng)` to children, of one parent; see `auroraqd.emitters.variation`.

    Raises:
        TypeError, ValueError: one is of the wrong kind or out of range.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> emitter = auroraqd.emitters.NoveltySearch(population=50)
        >>> auroraqd.Aurora(2, "hand-coded", emitter=emitter, seed=0).run(task, generations=3).generation
        3
    """

    def _best_first(self, individuals: Columns, archive: Archive) -> np.ndarray:
        novelty, _ = _novelty(individuals, archive, self.k)
        return np.argsort(-novelty, kind="stable")


@dataclass(repr=False)
class NSLC(_Bred):
    """Novelty search with local competition: NSGA-II on novelty, and on how many of the k nearest are less fit.

    J. Lehman, K. O. Stanley, Evolving a Diversity of Virtual Creatures Through Novelty Search and Local Competition, GECCO
    2011. Individuals in one front are told apart by crowding, as in NSGA-II (Deb et al., IEEE TEVC 2002).

    Args:
        population, k, variation: see `NoveltySearch`.

    Raises:
        TypeError, ValueError: one is of the wrong kind or out of range.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> emitter = auroraqd.emitters.NSLC(population=50)
        >>> auroraqd.Aurora(2, "hand-coded", emitter=emitter, seed=0).run(task, generations=3).generation
        3
    """

    def _best_first(self, individuals: Columns, archive: Archive) -> np.ndarray:
        novelty, outdone = _novelty(individuals, archive, self.k)
        return in_order(np.stack([novelty, outdone], axis=1))


@dataclass(repr=False)
class TAXONS(_Bred):
    """TAXONS: evolution towards novelty in a learned space, or towards what it cannot reconstruct, by one coin a batch.

    Every member has offspring in turn, which are the next population, the least of them replaced by copies of the best. In the
    first batches novelty alone decides, for the descriptor has learned little.

    G. Paolo, A. Laflaquiere, A. Coninx, S. Doncieux, Unsupervised Learning and Exploration of Reachable Outcome Space, ICRA
    2020.

    Args:
        population, k, variation: see `NoveltySearch`.
        elite: the best, whose copies replace as many of the least.
        first: batches in which novelty decides.

    Raises:
        TypeError, ValueError: one is of the wrong kind or out of range.

    Examples:
        >>> import auroraqd
        >>> from sklearn.decomposition import PCA
        >>> task = auroraqd.tasks.Ballistic()
        >>> emitter = auroraqd.emitters.TAXONS(population=50, elite=5)
        >>> auroraqd.Aurora(2, PCA(2), emitter=emitter, schedule=auroraqd.Every(30), seed=0).run(task, generations=3).generation
        3
    """

    variation: Callable[[np.ndarray, np.random.Generator], np.ndarray] = field(
        default_factory=lambda: Gaussian(sigma=0.05, rate=0.2)
    )
    elite: int = 5
    first: int = 30

    def __post_init__(self) -> None:
        super().__post_init__()
        whole("first", self.first, least=0)
        whole("elite", self.elite, least=0)
        if 2 * self.elite > self.population:
            raise ValueError(f"population must be at least twice elite, which is {self.elite}, got {self.population}")
        self._batches = 0
        self._by_surprise = False

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See `auroraqd.emitters`.

        Raises:
            ValueError: there are no reconstruction errors.
        """
        surprise(archive, "TAXONS")
        self._by_surprise = bool(rng.random() < 0.5) and self._batches >= self.first
        return super().ask(archive, n, rng)

    def tell(self, archive: Archive, batch: Columns, info: Info) -> None:
        """See `auroraqd.emitters`: the children, and where there are too few the best of their parents, are the next."""
        self._batches += 1
        everyone = _joined(self._chosen(_newcomers(archive, batch, info), archive), self._members)
        rows = np.arange(min(self.population, everyone.rows))
        copies = min(self.elite, len(rows) // 2)
        rows[len(rows) - copies :] = rows[:copies]
        self._members = everyone.take(rows)

    def state(self) -> dict[str, Any]:
        """The population, and how far it is."""
        return {**super().state(), "batches": self._batches, "by_surprise": self._by_surprise}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Become what had this `state`."""
        super().restore(state)
        self._batches, self._by_surprise = whole("batches", state["batches"], least=0), bool(state["by_surprise"])

    def _parents(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return np.arange(n) % self._members.rows

    def _best_first(self, individuals: Columns, archive: Archive) -> np.ndarray:
        value = individuals["reconstruction_error"] if self._by_surprise else _novelty(individuals, archive, self.k)[0]
        return np.argsort(-np.nan_to_num(value, nan=-1.0), kind="stable")


def _newcomers(archive: Archive, batch: Columns, info: Info) -> Columns:
    """Those of a batch that are valid, with their ids; -1 of those that are not stored."""
    ids = np.where(info.row >= 0, archive.id[info.row], -1) if len(archive) else np.full(batch.rows, -1)
    valid = (info.status != INVALID) & finite_rows(batch["descriptor"])
    return (batch | {"id": ids}).only(*_KEPT).take(valid)


def _joined(first: Columns, second: Columns) -> Columns:
    """Both, the first first. Of none there are no columns."""
    return first.joined(second) if first.rows and second.rows else first if first.rows else second


def _novelty(individuals: Columns, archive: Archive, k: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,) mean distances of individuals to the k nearest among them and the archive; and how many of these are less fit."""
    born = individuals["born"]
    beside = ~np.isin(archive.born, born[born >= 0])
    points = np.concatenate([individuals["descriptor"], archive.descriptor[beside]])
    fitness = np.concatenate([individuals["fitness"], archive.fitness[beside]])
    squared, rows = nearest(points, np.zeros(len(points)), np.arange(individuals.rows), k)
    novelty = mean_distance(squared, rows) if len(points) > 1 else np.zeros(individuals.rows)
    outdone = (rows >= 0) & (fitness[rows] < individuals["fitness"][:, None])
    return novelty, outdone.sum(axis=1)


def in_order(objectives: np.ndarray) -> np.ndarray:
    """(n,) rows by the order of NSGA-II: by front, then those in emptier regions of it, then the lower row.

    Args:
        objectives: (n, 2), larger is better.
    """
    front = fronts(objectives)
    apart = np.empty(len(front))
    for number in range(front.max(initial=-1) + 1):
        members = front == number
        apart[members] = crowding(objectives[members])
    return np.lexsort((-apart, front))


def fronts(objectives: np.ndarray) -> np.ndarray:
    """(n,) the front of each: 0 where no other is better in one objective and as good in the other, 1 where only those are, ...

    Points come in falling order of both objectives, so that one is beaten by a front exactly if the highest second objective
    there is as high. That falls from front to front.

    Args:
        objectives: (n, 2), larger is better.
    """
    points, which = np.unique(objectives, axis=0, return_inverse=True)
    number, lowest = np.empty(len(points), np.int64), []  # lowest: of minus the second objective, by front
    for i in range(len(points) - 1, -1, -1):
        value = -float(points[i, 1])
        number[i] = bisect_right(lowest, value)
        lowest[number[i] : number[i] + 1] = [value]
    return number[which.reshape(-1)]


def crowding(objectives: np.ndarray) -> np.ndarray:
    """(n,) how far the neighbours of each are apart, as shares of the ranges, (n, 2); infinite at the ends."""
    apart = np.zeros(len(objectives))
    for values in objectives.T:
        order = np.argsort(values, kind="stable")
        ranked, span = values[order], np.ptp(values)
        gap = np.full(len(values), np.inf)
        gap[1:-1] = (ranked[2:] - ranked[:-2]) / span if span else 0.0
        apart[order] += gap
    return apart
