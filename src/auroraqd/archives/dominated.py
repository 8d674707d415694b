"""The archive of dominated novelty search: a number of individuals, each far from those that are fitter."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import whole
from auroraqd.archives._ranked import disturb, mean_distance, nearest
from auroraqd.archives.base import NEW, REJECTED, Archive, Placement
from auroraqd.individuals import Columns

_MOST_ROWS = int(np.iinfo(np.int32).max)


class _Measured(NamedTuple):
    """Scores of n individuals that stay the same until another comes or goes near them.

    Attributes:
        descriptor, fitness: (n, d) and (n,), of whom.
        score: (n,) float64.
        reach: (n,), squared distance to the k-th of the neighbours it is made of; infinite where there are fewer, -1 where the
            score is out of date.
    """

    descriptor: np.ndarray
    fitness: np.ndarray
    score: np.ndarray
    reach: np.ndarray


class DominatedArchive(Archive):
    """Dominated novelty search: of all that were found, those stay that are far from whoever is as good or better.

    A batch is added at once. The score of an individual is the mean distance to the k nearest of those, stored or of the
    batch, that are at least as fit, itself excepted; over as many as there are, and infinite for the fittest, which has none.
    The `capacity` highest scores stay; of equal ones the older, and within a batch the earlier row. There are no cells, no
    distance threshold and no bounds, so descriptors may be of any scale, and change it.

    R. Bahlous-Boldi, M. Faldor, L. Grillotti, H. Janmohamed, L. Coiffard, L. Spector, A. Cully, Dominated Novelty Search:
    Rethinking Local Competition in Quality-Diversity, GECCO 2025.

    Args:
        capacity: individuals to store.
        k: neighbours that make up the score.

    Raises:
        ValueError: one is no whole number, or below 1.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> archive = auroraqd.DominatedArchive(capacity=2, k=1)
        >>> descriptor = np.array([[0.0], [0.1], [1.0]])
        >>> archive.add(np.zeros((3, 1)), np.array([1.0, 0.0, 0.0]), descriptor, descriptor)
        array([1, 0, 1], dtype=int8)
    """

    def __init__(self, capacity: int = 1000, k: int = 3) -> None:
        super().__init__()
        self._capacity = whole("capacity", capacity, most=_MOST_ROWS)
        self._k = whole("k", k, most=10**6)
        self._measured: _Measured | None = None  # always what measuring again would give, so it need not be saved

    def __repr__(self) -> str:
        return f"DominatedArchive(capacity={self.capacity}, k={self.k}): {len(self)} individuals"

    @property
    def capacity(self) -> int:
        """The most individuals to store."""
        return self._capacity

    @property
    def k(self) -> int:
        """Neighbours that make up the score."""
        return self._k

    @property
    def settings(self) -> dict[str, Any]:
        """The parameters, as JSON values."""
        return {"capacity": self.capacity, "k": self.k}

    def score(self) -> np.ndarray:
        """(n,) float64: of each individual, as it is now."""
        squared, rows = nearest(self.descriptor, self.fitness, np.arange(len(self)), self.k)
        return mean_distance(squared, rows)

    def place(self, batch: Columns) -> Placement:
        """As `Archive.place`, by the rule above."""
        size, n = len(self), batch.rows
        if size + n <= self.capacity:
            return Placement(np.full(n, NEW, np.int8), np.arange(size, size + n))
        known = self._with(np.array(batch["descriptor"], order="C"), np.array(batch["fitness"]))
        stale = np.flatnonzero(known.reach < 0)
        squared, rows = nearest(known.descriptor, known.fitness, stale, self.k)
        known.score[stale], known.reach[stale] = mean_distance(squared, rows), squared[:, -1]
        stays = np.zeros(size + n, bool)
        stays[np.lexsort((np.concatenate([self.id, batch["id"]]), -known.score))[: self.capacity]] = True
        self._measured = _without(known, stays)
        new = stays[size:]
        row = np.where(new, size + np.cumsum(new) - 1, -1)
        return Placement(np.where(new, NEW, REJECTED).astype(np.int8), row, np.flatnonzero(~stays[:size]))

    def _with(self, descriptor: np.ndarray, fitness: np.ndarray) -> _Measured:
        """What is known of the scores of those stored, as these come, and of theirs."""
        size, known = len(self), self._measured
        if size == 0:
            return _unmeasured(descriptor, fitness)
        if known is None or not (
            np.array_equal(known.descriptor, self.descriptor) and np.array_equal(known.fitness, self.fitness)
        ):
            known = _unmeasured(self.descriptor, self.fitness)
        disturb(known.descriptor, known.fitness, known.reach, descriptor, fitness)
        coming = _unmeasured(descriptor, fitness)
        return _Measured(*(np.concatenate(both) for both in zip(known, coming, strict=True)))


def _unmeasured(descriptor: np.ndarray, fitness: np.ndarray) -> _Measured:
    return _Measured(descriptor, fitness, np.zeros(len(fitness)), np.full(len(fitness), -1.0))


def _without(known: _Measured, stays: np.ndarray) -> _Measured:
    """Those that stay, (n,) bool, as the others go."""
    kept, gone = (_Measured(*(column[which] for column in known)) for which in (stays, ~stays))
    disturb(kept.descriptor, kept.fitness, kept.reach, gone.descriptor, gone.fitness)
    return kept
