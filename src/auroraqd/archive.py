"""Archives: where a Quality-Diversity algorithm keeps what it found.

An archive (container) decides which individuals are different or good enough to stay. `Archive` is what every archive
promises; `UnstructuredArchive` is the container of Novelty Search with Local Competition that the AURORA paper uses.

Fitness is maximised. Columns share their rows: row i of `genotype`, `fitness`, ... is one individual.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from auroraqd import _neighbours
from auroraqd._checks import (
    finite_rows,
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
from auroraqd._compiled import compiled
from auroraqd._interrupts import uninterrupted
from auroraqd.population import ORIGIN, Population

REJECTED, NEW, REPLACED, INVALID = 0, 1, 2, -1
"""The status of an individual after `Archive.add`."""

_NO_DIMENSIONS = "descriptor must have a dimension at least, got none"
_COLUMNS: dict[str, tuple[int | None, type | None]] = {  # axes and dtype; None: any
    "genotype": (2, np.float64),
    "fitness": (1, np.float64),
    "observation": (None, None),
    "descriptor": (2, np.float64),
    "curiosity": (1, np.float64),
    "id": (1, np.int64),
    "ground_truth": (None, None),
    "reconstruction_error": (1, np.float64),
    "born": (1, np.int64),
    "parent": (1, np.int64),
}
_OPTIONAL = ("ground_truth", "reconstruction_error", "born", "parent")
_MOST_ID = 2**62
_MOST_ROWS = int(np.iinfo(np.int32).max)
_STORED_CREDIT, _UNSTORED_CREDIT = 1.0, -0.5  # curiosity score [Cully & Demiris, IEEE TEVC 2018]


class Archive(ABC):
    """What every archive promises: columns, `add`, `redescribe` and `credit`.

    Columns are read-only views of the individuals stored now, an individual a row; take a copy to keep one:
    `genotype` (n, n_genes), `fitness` (n,), `observation` (n, ...), `descriptor` (n, d), `ground_truth` (n, ...) or None,
    `reconstruction_error` (n,) or None, `curiosity` (n,), `id` (n,) int64, `born` (n,) int64, `parent` (n,) int64. An id is
    never given twice.

    A new kind of archive provides five things, and calls `super().__init__()`: `_place`, which decides; `_clear`, which
    forgets; `_remember`, which finds its way into individuals that are there; and the properties `full` and `settings`.
    `_place` sees individuals in the order of their rows: the first that it calls new is in row 0 of an empty archive.
    """

    def __init__(self) -> None:
        self._population = Population()
        self._next_id = 0
        self._rearranged = 0
        self._lock = threading.RLock()  # kernels run without the interpreter's

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._lock = threading.RLock()

    @abstractmethod
    def _place(self, descriptor: np.ndarray, fitness: np.ndarray, status: np.ndarray) -> np.ndarray:
        """Decide on individuals one at a time, in order, and remember those that are stored.

        Args:
            descriptor: (n, d) float64, finite where `status` is not INVALID.
            fitness: (n,) float64, likewise.
            status: (n,) int8, to be set to REJECTED, NEW or REPLACED, except where it is INVALID.

        Returns:
            (n,) int64: the row an individual is stored in, -1 when it is not. A new one takes the next free row.
        """

    @abstractmethod
    def _clear(self) -> None:
        """Forget all individuals."""

    @abstractmethod
    def _remember(self) -> None:
        """Derive what is kept beside the columns from these, in an archive that knows none of its individuals yet."""

    def __len__(self) -> int:
        return len(self._population)

    @property
    @abstractmethod
    def full(self) -> bool:
        """Whether there is no room: an individual is stored only in the place of another, if at all."""

    @property
    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """The parameters, as JSON values."""

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """Parameters that are arrays, by name."""
        return {}

    @property
    def state(self) -> dict[str, Any]:
        """What changes beside the columns, as JSON values."""
        return {"next_id": self._next_id, "rearranged": self._rearranged}

    def restore(self, columns: Mapping[str, np.ndarray], state: Mapping[str, Any]) -> None:
        """Become the archive, of the same parameters, that had these columns and this `state`.

        Args:
            columns: by name, all of those that the archive had; `born` and `parent`, which an earlier version did not keep,
                are -1 if they are missing.
            state: likewise.

        Raises:
            ValueError: no archive can have had them; this one is unchanged.
        """
        mapping("columns", columns)
        state = mapping("state", state)
        next_id, rearranged = (whole(name, state.get(name), least=0, most=_MOST_ID) for name in ("next_id", "rearranged"))
        check_columns(columns)
        ids = columns["id"]
        if len(ids) and not (ids.min() >= 0 and ids.max() < next_id):
            raise ValueError(f"id must be from 0 to below next_id, {next_id}, got {ids.min()} to {ids.max()}")
        if len(ids) and not self._apart(columns["descriptor"]):
            raise ValueError("descriptor must be such that individuals can be stored beside each other, and some cannot")
        with self._lock, uninterrupted():
            self._next_id, self._rearranged = next_id, rearranged
            self._population = Population()
            self._clear()
            size = len(columns["id"])
            columns = {**{name: np.full(size, -1) for name in ORIGIN}, **columns}
            if size:
                self._population.define(columns)
                self._population.reserve(size)
                self._population.write(np.arange(size), columns)
                self._population.resize(size)
                self._remember()

    def _apart(self, descriptor: np.ndarray) -> bool:
        """Whether individuals with these descriptors, (n, d) finite, n >= 1, can be stored beside each other."""
        return True

    def _whole_column(self, name: str) -> np.ndarray:
        return self._population[name] if name in self._population else np.empty(0, np.int64)

    def _column(self, name: str, row_shape: tuple[int, ...] = ()) -> np.ndarray:
        return self._population[name] if name in self._population else np.empty((0, *row_shape))

    def _optional_column(self, name: str) -> np.ndarray | None:
        return self._population[name] if name in self._population else None

    @property
    def genotype(self) -> np.ndarray:
        """(n, n_genes) float64: controller parameters."""
        return self._column("genotype", (0,))

    @property
    def fitness(self) -> np.ndarray:
        """(n,) float64: quality, larger is better."""
        return self._column("fitness")

    @property
    def observation(self) -> np.ndarray:
        """(n, ...), in the shape and dtype of the task: sensory data."""
        return self._column("observation", (0,))

    @property
    def descriptor(self) -> np.ndarray:
        """(n, d) float64: behavioural descriptor."""
        return self._column("descriptor", (0,))

    @property
    def ground_truth(self) -> np.ndarray | None:
        """(n, ...): what the task knows about the behaviour, or None when it does not tell."""
        return self._optional_column("ground_truth")

    @property
    def reconstruction_error(self) -> np.ndarray | None:
        """(n,) float64: root mean square error of the observation reconstructed from its descriptor, or None."""
        return self._optional_column("reconstruction_error")

    @property
    def curiosity(self) -> np.ndarray:
        """(n,) float64: how often offspring was stored (+1) or not (-0.5)."""
        return self._column("curiosity")

    @property
    def id(self) -> np.ndarray:
        """(n,) int64: unique, given in the order of storing; rows are not sorted by it, for some replace others."""
        return self._whole_column("id")

    @property
    def born(self) -> np.ndarray:
        """(n,) int64: the number of its evaluation in its run, the first is 0; -1 where it is not known."""
        return self._whole_column("born")

    @property
    def parent(self) -> np.ndarray:
        """(n,) int64: the id of its parent, which may have been replaced; -1 for none, or where it is not known."""
        return self._whole_column("parent")

    def add(
        self,
        genotype: ArrayLike,
        fitness: ArrayLike,
        observation: ArrayLike,
        descriptor: ArrayLike,
        *,
        ground_truth: ArrayLike | None = None,
        reconstruction_error: ArrayLike | None = None,
        born: ArrayLike | None = None,
        parent: ArrayLike | None = None,
    ) -> np.ndarray:
        """Add individuals one at a time, in order, each to an archive that holds the ones before it.

        Args:
            genotype: (n, n_genes), finite.
            fitness: (n,).
            observation: (n, ...), numbers.
            descriptor: (n, d).
            ground_truth: (n, ...), if known. Given either always or never.
            reconstruction_error: (n,), if known. Given either always or never.
            born: (n,) whole numbers, of their evaluations, if known; otherwise it is -1.
            parent: (n,) ids of their parents, -1 for none; likewise.

        Returns:
            (n,) int8, the status of each: 0 rejected, 1 new, 2 replaced another, -1 invalid (a NaN or an infinity in
            fitness, observation or descriptor).

        Raises:
            ValueError: an argument has the wrong shape or dtype; the archive is unchanged.
        """
        batch = {
            "genotype": numbers("genotype", genotype, axes=2),
            "fitness": numbers("fitness", fitness, axes=1),
            "observation": numeric("observation", observation, rows=True),
            "descriptor": numbers("descriptor", descriptor, axes=2),
        }
        if ground_truth is not None:
            batch["ground_truth"] = numeric("ground_truth", ground_truth, rows=True)
        if reconstruction_error is not None:
            batch["reconstruction_error"] = numbers("reconstruction_error", reconstruction_error, axes=1)
        batch["born"] = _origin("born", born, len(batch["genotype"]))
        batch["parent"] = _origin("parent", parent, len(batch["genotype"]))
        del genotype, fitness, observation, descriptor, ground_truth, reconstruction_error, born, parent
        with self._lock, uninterrupted():
            self._check(batch)
            return self._add(batch)

    def _add(self, batch: dict[str, np.ndarray]) -> np.ndarray:
        valid = finite_rows(batch["fitness"]) & finite_rows(batch["observation"]) & finite_rows(batch["descriptor"])
        status = np.full(len(valid), REJECTED, np.int8)
        status[~valid] = INVALID
        if len(valid) == 0:
            return status
        if len(self) == 0:
            self._clear()
            self._population.define({**batch, "curiosity": np.empty(0), "id": np.empty(0, np.int64)})
        target = self._place(batch["descriptor"], batch["fitness"], status)
        stored = np.flatnonzero(target >= 0)
        target = target[stored]
        batch = {name: rows.take(stored, axis=0) for name, rows in batch.items()}
        batch["curiosity"] = np.zeros(len(stored))
        batch["id"] = np.arange(self._next_id, self._next_id + len(stored))
        self._next_id += len(stored)
        size = len(self) + int(np.count_nonzero(status == NEW))
        self._population.reserve(size)
        self._population.write(target, batch)
        self._population.resize(size)
        return status

    def _check(self, batch: dict[str, np.ndarray]) -> None:
        """Raise ValueError unless these columns can be added."""
        n = len(batch["genotype"])
        for name, rows in batch.items():
            if len(rows) != n:
                raise ValueError(f"{name} must have {n} rows, as genotype has, got shape {rows.shape}")
        if not np.isfinite(batch["genotype"]).all():
            raise ValueError("genotype must be finite, got a NaN or an infinity")
        if n and batch["descriptor"].shape[1] == 0:
            raise ValueError(_NO_DIMENSIONS)
        if len(self) == 0:
            return
        for name in ("ground_truth", "reconstruction_error"):
            if (name in batch) != (name in self._population):
                wanted = "be given, as for" if name in self._population else "not be given, as it was not for"
                raise ValueError(f"{name} must {wanted} the individuals added before")
        for name, rows in batch.items():
            check_like(name, rows, self._population.raw(name))

    def redescribe(self, descriptor: ArrayLike, *, reconstruction_error: ArrayLike | None = None, least: int = 0) -> int:
        """Give every individual a new descriptor and add all again, oldest first (paper, Sec. "AURORA").

        Individuals that have become alike compete, so the archive may shrink. Ids and curiosity stay.

        Args:
            descriptor: (n, any d), one for each row.
            reconstruction_error: (n,), likewise. None: the column is dropped.
            least: if fewer than these would stay, the archive is unchanged.

        Returns:
            How many stay, or would.

        Raises:
            ValueError: wrong shape, or a NaN or infinity; the archive is unchanged.
        """
        size = len(self)
        new = {"descriptor": numbers("descriptor", descriptor, axes=2, finite=True)}
        if reconstruction_error is not None:
            new["reconstruction_error"] = numbers("reconstruction_error", reconstruction_error, axes=1)
        for name, rows in new.items():
            if len(rows) != size:
                raise ValueError(f"{name} must have {size} rows, one for each individual stored, got shape {rows.shape}")
        if size and new["descriptor"].shape[1] == 0:
            raise ValueError(_NO_DIMENSIONS)
        with self._lock, uninterrupted():
            return self._add_again(new, whole("least", least, least=0))

    def _add_again(self, new: dict[str, np.ndarray], least: int) -> int:
        """Add all, oldest first, with new descriptors, unless fewer than `least` would stay; returns how many."""
        size = len(self)
        if size == 0:
            self._clear()
            self._rearranged += 1
            return 0
        order = np.argsort(self.id)
        status = np.full(size, REJECTED, np.int8)
        self._clear()
        try:
            target = self._place(new["descriptor"][order], self.fitness[order], status)
        except BaseException:
            self._remember_again()
            raise
        staying = int(np.count_nonzero(status == NEW))
        if staying < least:
            self._remember_again()
            return staying
        self._rearranged += 1
        kept = target >= 0
        source = np.empty(staying, np.int64)
        source[target[kept]] = order[kept]  # the last to be stored in a row is who is there
        new = {name: rows[source] for name, rows in new.items()}  # before the rest moves: these may be views of it
        self._population.gather(source)
        self._population.drop("reconstruction_error")
        for name, rows in new.items():
            self._population.set(name, rows)
        return staying

    def _remember_again(self) -> None:
        """Find the way back into individuals that are there, after an attempt to add them again."""
        self._clear()
        self._remember()

    @property
    def rearranged(self) -> int:
        """How often all have been added again: rows found before the last time are out of date."""
        return self._rearranged

    def rows_of(self, ids: ArrayLike) -> np.ndarray:
        """The rows of individuals, (n,) int64; -1 for an id that is not stored.

        Raises:
            ValueError: the ids are no whole numbers.
        """
        order = np.argsort(self.id)
        ids = whole_numbers("ids", ids)
        rows = np.full(ids.shape, -1)
        if len(order):
            found = order[np.minimum(np.searchsorted(self.id, ids, sorter=order), len(order) - 1)]
            rows = np.where(self.id[found] == ids, found, rows)
        return rows

    def credit(self, parent_ids: ArrayLike, status: ArrayLike, *, rows: ArrayLike | None = None) -> None:
        """Update curiosity: a parent gains 1 for each child that was stored and loses 0.5 for each that was not.

        Args:
            parent_ids: (n,) ids; those no longer stored (replaced meanwhile), and -1, are passed over.
            status: (n,) what `add` returned for the children.
            rows: (n,) where the parents were before `add`, if known: saves the search for them.

        Raises:
            ValueError: ids or rows are no whole numbers, status is none, or they are not of one shape (n,).
        """
        ids, status = whole_numbers("parent_ids", parent_ids), numeric("status", status)
        if ids.shape != status.shape or ids.ndim != 1:
            raise ValueError(f"parent_ids and status must have one shape (n,), got {ids.shape} and {status.shape}")
        if not ((status >= INVALID) & (status <= REPLACED)).all():
            raise ValueError(f"status must be what add returned, from {INVALID} to {REPLACED}, got {shown(status)}")
        rows = None if rows is None else whole_numbers("rows", rows)
        if rows is not None and rows.shape != ids.shape:
            raise ValueError(f"rows must have shape {ids.shape}, as parent_ids, got {rows.shape}")
        if len(self) == 0:
            return
        with self._lock, uninterrupted():
            rows = self.rows_of(ids) if rows is None else rows
            curiosity, stored_ids = (self._population.raw(name)[: len(self)] for name in ("curiosity", "id"))
            rows, ids = np.ascontiguousarray(rows, np.int64), np.ascontiguousarray(ids)
            _credit(curiosity, stored_ids, rows, ids, np.ascontiguousarray(status, np.int8))


@compiled(nogil=True)
def _credit(curiosity, stored_ids, rows, ids, status):
    """Add what each child earns, (m,) ids and status, to the curiosity of its parent if that is still in its row."""
    for i in range(rows.shape[0]):
        row = rows[i]
        if 0 <= row < curiosity.shape[0] and stored_ids[row] == ids[i]:
            curiosity[row] += _STORED_CREDIT if status[i] > REJECTED else _UNSTORED_CREDIT


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
        self._clear()

    def __getstate__(self) -> dict[str, Any]:
        derived = ("_tree", "_stored", "_scratch")  # arrays of which some share memory, which a copy would undo
        return {name: value for name, value in super().__getstate__().items() if name not in derived}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._scratch = _neighbours.scratch(self._k)
        self._clear()
        if len(self):
            self._remember()

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
        """Distance threshold. Setting it on a filled archive adds all again, oldest first."""
        return self._l

    @l.setter
    def l(self, value: float) -> None:
        self.redescribe(self.descriptor.copy(), reconstruction_error=self.reconstruction_error, l=number("l", value))

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
        """(n,) float64: mean distance of each individual to its k nearest, itself left out."""
        if len(self) == 0:
            return np.empty(0)
        return _neighbours.novelties(self._tree, self.descriptor, self.k)

    def _clear(self) -> None:
        self._tree: _neighbours.Tree | None = None
        self._stored: _neighbours.Stored | None = None
        self._placed = 0

    def _remember(self) -> None:
        self._tree, self._stored = _neighbours.indexed(self.descriptor, self.fitness)
        self._placed = len(self)

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

    def _place(self, descriptor: np.ndarray, fitness: np.ndarray, status: np.ndarray) -> np.ndarray:
        n, d = descriptor.shape
        tree, stored = self._tree, self._stored
        if tree is None or stored is None:
            tree, stored = _neighbours.empty(d), _neighbours.room(d, n)
        elif len(stored.fitness) < self._placed + n:
            stored = _neighbours.more_room(stored, self._placed, n)
        batch = _neighbours.Batch(
            np.ascontiguousarray(descriptor), np.ascontiguousarray(fitness), status, np.empty(n, np.int64)
        )
        capacity = _MOST_ROWS if self._capacity is None else self._capacity
        rule = _neighbours.Rule(self._l, self._k, self._epsilon, self._competition == "elitist", capacity)
        self._tree, self._placed = _neighbours.add(tree, batch, stored, self._placed, rule, self._scratch)
        self._stored = stored
        return batch.target


def check_columns(columns: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError unless these can be the columns of an archive, by name."""
    missing = [name for name in _COLUMNS if name not in columns and name not in _OPTIONAL]
    if missing:
        raise ValueError(f"the columns of an archive must have {', '.join(missing)}")
    n = len(columns["genotype"]) if np.ndim(columns["genotype"]) else 0
    for name, column in columns.items():
        axes, dtype = _COLUMNS.get(name, (None, None))
        instance(name, column, np.ndarray, "an array")
        if column.dtype.kind not in "biuf" or column.dtype.itemsize > 8 or dtype not in (None, column.dtype):
            raise ValueError(f"{name} must be {'numbers' if dtype is None else np.dtype(dtype)}, got {column.dtype}")
        if column.ndim == 0 or axes not in (None, column.ndim) or len(column) != n:
            wanted = "rows" if axes is None else f"{axes} axes"
            raise ValueError(f"{name} must have {wanted}, {n} as genotype has, got shape {column.shape}")
        if name not in _OPTIONAL and not finite_rows(column).all():
            raise ValueError(f"{name} must be finite, got a NaN or an infinity")
    if n and columns["descriptor"].shape[1] == 0:
        raise ValueError(_NO_DIMENSIONS)
    if len(np.unique(columns["id"])) < n:
        raise ValueError("id must differ between individuals, and some are the same")


def check_like(name: str, rows: np.ndarray, known: np.ndarray) -> None:
    """Raise ValueError unless rows fit into a column that is there, in shape and without loss in dtype."""
    if rows.shape[1:] != known.shape[1:]:
        raise ValueError(f"{name} must have shape {rows_of(known.shape[1:])}, as before, got {rows.shape}")
    if rows.dtype != known.dtype and not np.can_cast(rows.dtype, known.dtype, "safe"):
        raise ValueError(f"{name} must have dtype {known.dtype}, as before, got {rows.dtype}")


def _origin(name: str, values: ArrayLike | None, n: int) -> np.ndarray:
    """Whole numbers that say where n individuals come from, (n,); -1 if they are not given."""
    if values is None:
        return np.full(n, -1)
    return whole_numbers(name, values, axes=1)
