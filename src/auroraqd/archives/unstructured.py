"""The archive of the paper: the container of Novelty Search with Local Competition, without cells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import mapping, number, one_of, whole
from auroraqd._interrupts import uninterrupted
from auroraqd.archives import _neighbours
from auroraqd.archives._ranked import disturb
from auroraqd.archives.base import Archive, Placement
from auroraqd.individuals import Columns

_MOST_ROWS = int(np.iinfo(np.int32).max)
_WORTH = 0.5  # share of novelties out of date beyond which none is kept: nobody has asked for them lately


class _Novelty(NamedTuple):
    """Of each individual.

    Attributes:
        value: (n,) float64.
        reach: (n,), squared distance within which another that comes or goes changes it; -1 where it is not known.
    """

    value: np.ndarray
    reach: np.ndarray


class UnstructuredArchive(Archive):
    """An archive without cells: an individual is new when its descriptor is farther than l from all others.

    The rule, for one individual at a time, with d1 and d2 the distances to its nearest and second nearest [1]:

    - d1 > l, or nothing stored: it is added;
    - d2 < (1 - epsilon) l: it is rejected, for it would crowd a second neighbour;
    - otherwise it competes with the nearest for its place.

    So at fixed l no two stored are closer than (1 - epsilon) l. Novelty is the mean distance to the k nearest, the nearest
    itself left out for both. `competition` is "dominance", the exclusive epsilon-dominance on (fitness, novelty) of [1], which
    the AURORA paper uses; or "elitist", where the fitter stays and novelty decides between equals.

    [1] A. Cully, Y. Demiris, Quality and Diversity Optimization: A Unifying Modular Framework, IEEE TEVC 2018.

    Args:
        l: distance threshold, in units of the descriptor. 0 keeps every descriptor that differs, by 1e-154 at least: squares of
            less vanish. `Aurora` sets it.
        k: neighbours that make up the novelty.
        epsilon: tolerance of the rule, from 0 to below 1.
        competition: "dominance" or "elitist".
        capacity: the most individuals to store; beyond it new ones are rejected, and replacement goes on. None: no limit.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> archive = auroraqd.UnstructuredArchive(l=0.1, k=3)
        >>> descriptor = np.array([[0.0, 0.0], [0.5, 0.0], [0.52, 0.0], [0.5, 0.0]])
        >>> archive.add(np.zeros((4, 1)), np.array([0.0, 0.0, 1.0, 0.0]), descriptor, descriptor)
        array([1, 1, 2, 0], dtype=int8)
        >>> archive.descriptor  # the third took the place of the second: alike, and fitter
        array([[0.  , 0.  ],
               [0.52, 0.  ]])
    """

    def __init__(
        self,
        *,
        l: float = 0.0,
        k: int = 15,
        epsilon: float = 0.1,
        competition: Literal["dominance", "elitist"] = "dominance",
        capacity: int | None = None,
    ) -> None:
        super().__init__()
        self._k = whole("k", k, most=10**6)
        self._epsilon = number("epsilon", epsilon, most=np.nextafter(1, 0), wanted="0 or more and below 1")
        self._competition = one_of("competition", competition, ("dominance", "elitist"))
        self._capacity = None if capacity is None else whole("capacity", capacity, most=_MOST_ROWS)
        self._l = number("l", l)
        self._scratch = _neighbours.scratch(self._k)
        self.reindex()

    def __getstate__(self) -> dict[str, Any]:
        derived = ("_tree", "_stored", "_scratch", "_novel")  # arrays of which some share memory, which a copy would undo
        return {name: value for name, value in super().__getstate__().items() if name not in derived}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._scratch = _neighbours.scratch(self._k)
        self.reindex()

    def __repr__(self) -> str:
        return (
            f"UnstructuredArchive(l={self.l:.6g}, k={self.k}, epsilon={self.epsilon}, competition={self.competition!r}, "
            f"capacity={self.capacity}): {len(self)} individuals"
        )

    @property
    def k(self) -> int:
        """Neighbours that make up the novelty."""
        return self._k

    @property
    def epsilon(self) -> float:
        """Tolerance of the addition rule."""
        return self._epsilon

    @property
    def competition(self) -> str:
        """Who stays of two alike: "dominance" or "elitist"."""
        return self._competition

    @property
    def capacity(self) -> int | None:
        """The most individuals to store, or None."""
        return self._capacity

    @property
    def settings(self) -> dict[str, Any]:
        """The parameters, as JSON values; l, which changes, is in the history."""
        return {name: getattr(self, name) for name in ("k", "epsilon", "competition", "capacity")}

    @property
    def full(self) -> bool:
        """Whether the capacity is reached: new ones are rejected, replacement goes on."""
        return self._capacity is not None and len(self) >= self._capacity

    @property
    def l(self) -> float:
        """Distance threshold. Setting it adds all again, oldest first; `adjust` does not."""
        return self._l

    @l.setter
    def l(self, value: float) -> None:
        self.redescribe(self.descriptor.copy(), reconstruction_error=self.reconstruction_error, l=number("l", value))

    def adjust(self, l: float) -> None:
        """Set the distance threshold for those to come. What is stored stays, at any distance."""
        self._l = number("l", l)

    def redescribe(
        self,
        descriptor: ArrayLike,
        *,
        reconstruction_error: ArrayLike | None = None,
        least: int = 0,
        l: float | None = None,
    ) -> int:
        """As `Archive.redescribe`, with a new l if one is given."""
        with self._lock, uninterrupted():
            previous = self._l
            self._l = previous if l is None else number("l", l)
            taken = False
            try:
                staying = super().redescribe(descriptor, reconstruction_error=reconstruction_error, least=least)
                taken = staying >= least
            finally:
                if not taken:
                    self._l = previous
            return staying

    def novelty(self) -> np.ndarray:
        """(n,) float64: mean distance of each individual to its k nearest, itself left out.

        Once it was asked for, it is measured again only where another has come or gone among the nearest.
        """
        if len(self) == 0:
            return np.empty(0)
        with self._lock:
            known = self._novel
            if known is None:
                known = _Novelty(np.empty(len(self)), np.full(len(self), -1.0))
            stale = np.flatnonzero(known.reach < 0)
            known.value[stale], reach = _neighbours.novelties(self._tree, self.descriptor, self.k, stale)
            known.reach[stale] = reach * reach * (1 + 1e-12) + 1e-300  # whatever the rounding
            self._novel = known
            return known.value.copy()

    def reindex(self) -> None:
        """As `Archive.reindex`."""
        self._novel: _Novelty | None = None
        self._tree: _neighbours.Tree | None = None
        self._stored: _neighbours.Stored | None = None
        self._indexed = len(self)
        if len(self):
            self._tree, self._stored = _neighbours.indexed(self.descriptor, self.fitness)

    @property
    def state(self) -> dict[str, Any]:
        """What changes beside the columns, as JSON values."""
        return {**super().state, "l": self._l}

    def restore(self, columns: Mapping[str, np.ndarray], state: Mapping[str, Any]) -> None:
        """As `Archive.restore`."""
        with self._lock, uninterrupted():
            l = number("l", mapping("state", state).get("l"))
            super().restore(columns, state)
            self._l = l

    def _apart(self, descriptor: np.ndarray) -> bool:
        whole_rows = np.dtype((np.void, descriptor.itemsize * descriptor.shape[1]))
        rows = np.ascontiguousarray(descriptor + 0.0).view(whole_rows)  # of the two zeros, one
        return len(np.unique(rows)) == len(rows)

    def place(self, batch: Columns) -> Placement:
        """As `Archive.place`, by the rule above."""
        descriptor, fitness = (np.ascontiguousarray(batch[name]) for name in ("descriptor", "fitness"))
        n, d = descriptor.shape
        tree, stored = self._tree, self._stored
        if tree is None or stored is None:
            tree, stored = _neighbours.empty(d), _neighbours.room(d, n)
        elif len(stored.fitness) < self._indexed + n:
            stored = _neighbours.more_room(stored, self._indexed, n)
        decided = Placement(np.zeros(n, np.int8), np.empty(n, np.int64))
        coming = _neighbours.Batch(descriptor, fitness, decided.status, decided.row)
        capacity = _MOST_ROWS if self._capacity is None else self._capacity
        rule = _neighbours.Rule(self._l, self._k, self._epsilon, self._competition == "elitist", capacity)
        self._tree, self._indexed = _neighbours.add(tree, coming, stored, self._indexed, rule, self._scratch)
        self._stored = stored
        if self._novel is not None:
            self._novel = self._still(self._novel, np.unique(decided.row[decided.row >= 0]), stored.descriptor)
        return decided

    def _still(self, known: _Novelty, changed: np.ndarray, descriptor: np.ndarray) -> _Novelty | None:
        """What is known of novelties when these rows, ascending, have changed; None where that is not worth keeping."""
        before = self.descriptor[changed[changed < len(self)]]
        value, reach = np.empty(self._indexed), np.full(self._indexed, -1.0)
        value[: len(self)], reach[: len(self)] = known
        reach[changed] = -1.0
        moved = np.concatenate([before, descriptor[changed]])
        disturb(descriptor[: self._indexed], np.zeros(self._indexed), reach, moved, np.zeros(len(moved)))
        return _Novelty(value, reach) if np.count_nonzero(reach < 0) < _WORTH * self._indexed else None
