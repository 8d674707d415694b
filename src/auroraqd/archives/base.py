"""Archives: where a Quality-Diversity algorithm keeps what it found.

An archive (container) decides which individuals are different or good enough to stay. `Archive` is what every archive
promises, and what one of your own derives from.

Fitness is maximised. Columns share their rows: row i of `genotype`, `fitness`, ... is one individual.
"""

from __future__ import annotations

import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import mapping, numbers, numeric, shown, whole, whole_numbers
from auroraqd._compiled import compiled
from auroraqd._files import room_in
from auroraqd._interrupts import uninterrupted
from auroraqd._notebooks import card, facts_of
from auroraqd.archives.population import Population, Room, Rows
from auroraqd.individuals import KNOWN, Columns, Individuals, check_dimensions, check_like, measured, stored
from auroraqd.observations import finite_rows

REJECTED, NEW, REPLACED, INVALID = 0, 1, 2, -1
"""The status of an individual after `Archive.add`."""

_OPTIONAL = [name for name, kind in KNOWN.items() if not kind.always]
_MOST_ID = 2**62
_STORED_CREDIT, _UNSTORED_CREDIT = 1.0, -0.5  # curiosity score [Cully & Demiris, IEEE TEVC 2018]
_NONE = np.empty(0, np.int64)


class Placement(NamedTuple):
    """What an archive decides about n individuals, one after the other or all at once.

    Attributes:
        status: (n,) int8: REJECTED, NEW or REPLACED.
        row: (n,) int64: the row an individual is stored in, -1 where it is rejected. New ones take the next free rows, in
            order, the first of all row 0. One that replaces another takes its row, which may be that of an individual of the
            same batch; the last to take a row is who is there.
        evicted: (m,) int64: rows, counted after all that, whose individuals go. The rest close up, in order.
    """

    status: np.ndarray
    row: np.ndarray
    evicted: np.ndarray = _NONE


class Info(NamedTuple):
    """What became of n individuals.

    Attributes:
        status: (n,) int8: 0 rejected, 1 new, 2 replaced another, -1 invalid.
        row: (n,) int64: where each is stored now, -1 where it is not.
        removed: (m,) int64: ids of those that are no longer stored, others of the same batch among them.
        gain: (n,) float64: how much fitter each is than the one whose place it took; NaN where it took nobody's.
    """

    status: np.ndarray
    row: np.ndarray
    removed: np.ndarray
    gain: np.ndarray

    @classmethod
    def none(cls, n: int) -> Info:
        """Of n individuals that are all invalid."""
        return cls(np.full(n, INVALID, np.int8), np.full(n, -1), _NONE, np.full(n, np.nan))

    def among(self, which: np.ndarray) -> Info:
        """Of n individuals of which these are the ones where (n,) bool is true, and the others invalid."""
        found = Info(np.empty(len(which), np.int8), np.empty(len(which), np.int64), self.removed, np.empty(len(which)))
        _spread(which, self.status, self.row, self.gain, found.status, found.row, found.gain)
        return found

    def only(self, which: np.ndarray) -> Info:
        """Of some of these individuals, where (n,) bool is true."""
        return Info(self.status[which], self.row[which], self.removed, self.gain[which])


class Archive(Individuals, ABC):
    """What every archive promises: columns, `add`, `redescribe` and `credit`.

    Columns are read-only views of the individuals stored now, an individual a row; take a copy to keep one. An id is never
    given twice.

    An archive of your own derives from this class, calls `super().__init__()`, and provides `place`, which decides. What it
    remembers beside the columns it derives from them in `reindex`. Its `settings` and `constants` are the arguments that make
    it again, for run folders. `own` names columns of its own with their dtypes, one number each: they are 0 for newcomers, go
    where their individuals go, are saved, and are written through `writable`. `auroraqd.testing.check_archive` looks at all
    that.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> from auroraqd.archives import NEW, Placement
        >>> class Everything(auroraqd.Archive):
        ...     def place(self, batch):
        ...         return Placement(np.full(batch.rows, NEW, np.int8), len(self) + np.arange(batch.rows))
        >>> aurora = auroraqd.Aurora(2, "genotype", archive=Everything(), seed=0)
        >>> aurora = aurora.run(auroraqd.tasks.Ballistic(), generations=2)
        >>> len(aurora.archive) + aurora.history.last.invalid
        400
    """

    own: ClassVar[Mapping[str, type]] = {}

    def __init__(self) -> None:
        self._room: Room = np.empty
        self._population = Population()
        self._next_id = 0
        self._where = Rows()
        self._lock = threading.RLock()  # kernels run without the interpreter's

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._lock = threading.RLock()

    def keep_observations(self, folder: str | os.PathLike) -> None:
        """Have the observations in files of a folder, instead of memory. They have no names, and go with this archive.

        It is for those that are too many for memory, on a disk that is fast. They are read as they are from memory.

        Raises:
            OSError: there cannot be such files, or the disk has not the room; nothing has changed.
            TypeError, ValueError: the folder is no path.
        """
        room = room_in(folder)
        with self._lock, uninterrupted():
            self._population.move(room)
            self._room = room

    @abstractmethod
    def place(self, batch: Columns) -> Placement:
        """Decide about individuals, in order, as if each met an archive that holds the ones before it; or all at once.

        The columns of the archive are those before; `len(archive)` is 0 when all are added again.

        Args:
            batch: n individuals, n >= 1, with the columns of the archive. Fitness, observation and descriptor are finite.
        """

    def reindex(self) -> None:
        """Derive what is kept beside the columns from these, which have changed, or are gone, without `place`."""

    @property
    def settings(self) -> dict[str, Any]:
        """The arguments that make an empty one, as JSON values."""
        return {}

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """Arguments that are arrays, by name."""
        return {}

    @classmethod
    def made(cls, settings: Mapping[str, Any], constants: Mapping[str, np.ndarray]) -> Archive:
        """An empty archive of these `settings` and `constants`."""
        return cls(**settings, **constants)

    @property
    def full(self) -> bool:
        """Whether there is no room: an individual is stored only in the place of another, if at all."""
        return False

    def __len__(self) -> int:
        return len(self._population)

    def _repr_html_(self) -> str:
        return card(type(self).__name__, facts_of(self), "individuals", self)

    @property
    def columns(self) -> Columns:
        """All columns, as views; none while nothing is stored."""
        return self._population.columns

    def _found(self, name: str) -> np.ndarray | None:
        return self._population[name] if name in self._population else None

    def writable(self, name: str) -> np.ndarray:
        """(n,): one of its `own` columns, to be changed in place. Invalid after the next addition."""
        if name not in self.own:
            raise ValueError(
                f"name must be one of the archive's own columns, {', '.join(self.own) or 'of which there is none'}"
            )
        return self._population.raw(name)[: len(self)]

    @property
    def state(self) -> dict[str, Any]:
        """What changes beside the columns, as JSON values."""
        return {"next_id": self._next_id}

    def restore(self, columns: Mapping[str, np.ndarray], state: Mapping[str, Any]) -> None:
        """Become the archive, of the same parameters, that had these columns and this `state`.

        Args:
            columns: by name, all of those that the archive had; those that an earlier version did not keep are filled in.
            state: likewise.

        Raises:
            ValueError: no archive can have had them; this one is unchanged.
        """
        next_id = whole("next_id", mapping("state", state).get("next_id"), least=0, most=_MOST_ID)
        held = stored(columns)
        ids, where = held["id"], Rows()
        if held.rows and not (ids.min() >= 0 and ids.max() < next_id):
            raise ValueError(f"id must be from 0 to below next_id, {next_id}, got {ids.min()} to {ids.max()}")
        if held.rows and not self._apart(held["descriptor"]):
            raise ValueError("descriptor must be such that individuals can be stored beside each other, and some cannot")
        try:
            where.reserve(int(ids.max(initial=-1)) + 1)
            where.set(ids, np.arange(held.rows))
        except (MemoryError, ValueError, OverflowError):
            raise ValueError(f"id must be small enough to keep account of, got {ids.max()}") from None
        held = held | {name: np.zeros(held.rows, kind) for name, kind in self.own.items() if name not in held}
        with self._lock, uninterrupted():
            self._next_id, self._where = next_id, where
            self._population = Population(held if held.rows else Columns({}), self._room)
            self._population.reserve(held.rows)
            self._population.write(np.arange(held.rows), held if held.rows else Columns({}), held.rows)
            self.reindex()

    def _apart(self, descriptor: np.ndarray) -> bool:
        """Whether individuals with these descriptors, (n, d) finite, n >= 1, can be stored beside each other."""
        return True

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
            observation: (n, ...), numbers; or a mapping of names to several such arrays.
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
        batch = measured(
            {
                "genotype": genotype,
                "fitness": fitness,
                "observation": observation,
                "descriptor": descriptor,
                "ground_truth": ground_truth,
                "reconstruction_error": reconstruction_error,
                "born": born,
                "parent": parent,
            }
        )
        valid = finite_rows(batch["fitness"]) & finite_rows(batch["observation"])
        return self.insert(batch, valid).status

    def insert(self, batch: Columns, valid: np.ndarray | bool) -> Info:
        """As `add`, of arrays that have been looked at; `valid`, (n,) bool, or all: fitness and observation are finite."""
        with self._lock, uninterrupted():
            self._check(batch)
            return self._insert(batch, valid & finite_rows(batch["descriptor"]))

    def _insert(self, batch: Columns, valid: np.ndarray) -> Info:
        sound = np.count_nonzero(valid)
        if sound == 0:
            return Info.none(batch.rows)
        return self._insert_valid(batch) if sound == batch.rows else self._insert_valid(batch.chosen(valid)).among(valid)

    def _insert_valid(self, batch: Columns) -> Info:
        size, n = len(self), batch.rows
        zeros = {"curiosity": np.zeros(n), **{name: np.zeros(n, kind) for name, kind in self.own.items()}}
        batch = batch | {**zeros, "id": np.arange(self._next_id, self._next_id + n)}  # there may be fewer in the end
        if size == 0:
            self._population = Population(batch, self._room)
            self.reindex()
        status, row, evicted = self._decide(batch)
        status, row = np.asarray(status, np.int8), np.array(row, np.int64)
        try:
            self._population.reserve(size + int(np.count_nonzero(status == NEW)))
            self._where.reserve(self._next_id + n)
        except BaseException:  # there is no memory, or the disk is full
            self.reindex()
            raise
        # From here on each has its place, and nothing may fail.
        ids, stored = self._population.raw("id"), self._population.raw("fitness")
        fitness, gain = np.ascontiguousarray(batch["fitness"]), np.full(n, np.nan)
        # Which writes id and fitness; the rest follows.
        size, self._next_id, staying, removed = _settled(
            row, fitness, size, self._next_id, ids, stored, self._where.places, gain
        )
        self._population.write(row[staying], batch.chosen(staying), size, but=("id", "fitness"))
        info = Info(status, row, removed, gain)
        return info if len(evicted) == 0 else self._evicted(info, evicted)

    def _evicted(self, info: Info, evicted: np.ndarray) -> Info:
        """Let the individuals in these rows go, and the rest close up."""
        gone = np.zeros(len(self), bool)
        gone[evicted] = True
        removed = self._population["id"][gone]
        place = np.where(gone, -1, np.cumsum(~gone) - 1)
        self._population.gather(np.flatnonzero(~gone))
        self._where.set(removed, -1)
        self._where.set(self.id, np.arange(len(self)))
        row = np.where(info.row < 0, -1, place[info.row])
        self.reindex()
        return info._replace(row=row, removed=np.concatenate([info.removed, removed]))

    def _decide(self, batch: Columns) -> Placement:
        """What `place` decides, which must make sense. If not, or if it raises, the archive is as before."""
        try:
            found = self.place(batch)
            if isinstance(found, tuple) and len(found) in (2, 3):
                found = Placement(*found)
                problem = _problem(found, batch.rows, len(self))
            else:
                problem = f"must return a Placement, of status and row and perhaps evicted, got {shown(found)}"
        except BaseException:
            self.reindex()
            raise
        if problem is not None:
            self.reindex()
            raise ValueError(f"{type(self).__name__}.place {problem}")
        return found

    def _check(self, batch: Columns) -> None:
        """Raise ValueError unless these columns can be added."""
        if batch.rows:
            check_dimensions(batch["descriptor"])
        if len(self) == 0:
            return
        for name in _OPTIONAL:
            if (name in batch) != (name in self._population):
                wanted = "be given, as for" if name in self._population else "not be given, as it was not for"
                raise ValueError(f"{name} must {wanted} the individuals added before")
        for name, rows in batch.items():
            known = self._population.raw(name)
            if rows.dtype != known.dtype or rows.shape[1:] != known.shape[1:]:
                check_like(name, rows, known)

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
        if size:
            check_dimensions(new["descriptor"])
        with self._lock, uninterrupted():
            return self._add_again(Columns(new), whole("least", least, least=0))

    def rebuild(self) -> int:
        """Add all again, oldest first, by the rule as it is now. Returns how many stay."""
        return self.redescribe(self.descriptor.copy(), reconstruction_error=self.reconstruction_error)

    def _add_again(self, new: Columns, least: int) -> int:
        """Add all, oldest first, with new descriptors, unless fewer than `least` would stay; returns how many."""
        if len(self) == 0:
            return 0
        held = self._population
        order = np.argsort(self.id)
        batch = (held.columns.without("reconstruction_error") | new).chosen(order)
        self._population = Population()
        source, evicted, taken = _NONE, _NONE, False
        try:
            self.reindex()
            _, row, evicted = self._decide(batch)
            kept = row >= 0
            source = np.empty(int(row.max(initial=-1)) + 1, np.int64)
            source[row[kept]] = order[kept]  # the last to be stored in a row is who is there
            source = np.delete(source, evicted)
            taken = len(source) >= least
        finally:
            self._population = held
            if not taken:
                self.reindex()
        if taken:
            self._rearrange(source, new.take(source))
            if len(evicted):
                self.reindex()
        return len(source)

    def _rearrange(self, source: np.ndarray, new: Columns) -> None:
        """Keep the rows `source`, in this order, with new columns instead of those they had."""
        self._where.set(self.id, -1)
        self._population.renew(source)
        self._population.drop("reconstruction_error")
        for name, rows in new.items():
            self._population.set(name, rows)
        self._where.set(self.id, np.arange(len(self)))

    def rows_of(self, ids: ArrayLike) -> np.ndarray:
        """The rows of individuals, (n,) int64; -1 for an id that is not stored.

        Raises:
            ValueError: the ids are no whole numbers.
        """
        return self._where.of(whole_numbers("ids", ids))

    def credit(self, parent_ids: ArrayLike, status: ArrayLike) -> None:
        """Update curiosity: a parent gains 1 for each child that was stored and loses 0.5 for each that was not.

        Args:
            parent_ids: (n,) ids; those no longer stored (replaced meanwhile), and -1, are passed over.
            status: (n,) what `add` returned for the children.

        Raises:
            ValueError: ids are no whole numbers, status is none, or they are not of one shape (n,).
        """
        ids, status = whole_numbers("parent_ids", parent_ids), numeric("status", status)
        if ids.shape != status.shape or ids.ndim != 1:
            raise ValueError(f"parent_ids and status must have one shape (n,), got {ids.shape} and {status.shape}")
        if not ((status >= INVALID) & (status <= REPLACED)).all():
            raise ValueError(f"status must be what add returned, from {INVALID} to {REPLACED}, got {shown(status)}")
        self.credited(np.ascontiguousarray(ids), np.ascontiguousarray(status, np.int8))

    def credited(self, parent_ids: np.ndarray, status: np.ndarray) -> None:
        """As `credit`, of contiguous arrays, (n,) int64 and int8, that are what they must be."""
        if len(self) == 0:
            return
        with self._lock, uninterrupted():
            _credit(self._population.raw("curiosity"), self._where.places, parent_ids, status)


@compiled(nogil=True)
def _credit(curiosity, places, ids, status):
    """Add what each child earns, (m,) status, to the curiosity of its parent, (m,) ids, if that has a place; see `Rows`."""
    for i in range(ids.shape[0]):
        if 0 <= ids[i] < places.shape[0] and places[ids[i]] > 0:
            curiosity[places[ids[i]] - 1] += _STORED_CREDIT if status[i] > REJECTED else _UNSTORED_CREDIT


@compiled(nogil=True)
def _spread(which, some_status, some_row, some_gain, status, row, gain):
    """Fill the last three, of n individuals, from those of some, where (n,) bool is true; the others are invalid."""
    taken = 0
    for i in range(which.shape[0]):
        if which[i]:
            status[i], row[i], gain[i] = some_status[taken], some_row[taken], some_gain[taken]
            taken += 1
        else:
            status[i], row[i], gain[i] = INVALID, -1, np.nan


@compiled(nogil=True)
def _settled(row, fitness, size, next_id, ids, stored_fitness, places, gain):
    """Give those that are stored ids, and their places, one after the other.

    Args:
        row: (n,) int64, the place of each, -1 for none; set to -1 where another of them takes it later.
        fitness: (n,), of each.
        size: individuals stored before.
        next_id: the first of theirs.
        ids, stored_fitness: (most,) int64 and float64, by row; set.
        places: (most,) int32, by id, see `Rows`; set.
        gain: (n,), see `Info`; set where a place is taken.

    Returns:
        Individuals stored after; the next id; who of them stays, (m,) int64; and the ids of those that went, (r,) int64.
    """
    stored, removed = np.empty(row.shape[0], np.int64), np.empty(row.shape[0], np.int64)
    first, gone = next_id, 0
    for i in range(row.shape[0]):
        place = row[i]
        if place < 0:
            continue
        if place < size:
            before = ids[place]
            places[before] = 0
            gain[i] = fitness[i] - stored_fitness[place]
            removed[gone] = before
            gone += 1
            if first <= before < next_id:  # of the same batch
                row[stored[before - first]] = -1
        else:
            size += 1
        ids[place], stored_fitness[place], places[next_id] = next_id, fitness[i], place + 1
        stored[next_id - first] = i
        next_id += 1
    staying = 0
    for i in stored[: next_id - first]:
        if row[i] >= 0:
            stored[staying] = i
            staying += 1
    return size, next_id, stored[:staying], removed[:gone]


@compiled(nogil=True)
def _sound(status, row, size):
    """Whether rows, (n,) int64, are those of new, replaced and rejected individuals, in order; (n,) int8 status."""
    for i in range(status.shape[0]):
        if status[i] == NEW:
            if row[i] != size:
                return False
            size += 1
        elif status[i] == REPLACED:
            if not 0 <= row[i] < size:
                return False
        elif status[i] != REJECTED or row[i] != -1:
            return False
    return True


def _as_ours(column: Any, dtype: type, n: int) -> bool:
    return type(column) is np.ndarray and column.dtype == dtype and column.shape == (n,)


def _problem(placement: Placement, n: int, size: int) -> str | None:
    """What is wrong with what was decided about n individuals for an archive of this size, in words."""
    status, row, evicted = placement
    if len(evicted) == 0 and _as_ours(status, np.int8, n) and _as_ours(row, np.int64, n) and _sound(status, row, size):
        return None
    for name, column in (("status", status), ("row", row)):
        if not isinstance(column, np.ndarray) or column.shape != (n,) or column.dtype.kind not in "iu":
            return f"must return {name} as whole numbers of shape ({n},), got {shown(column)}"
    if not ((status >= REJECTED) & (status <= REPLACED)).all():
        return f"must return a status of {REJECTED}, {NEW} or {REPLACED} for each, got {shown(np.unique(status))}"
    new = status == NEW
    free = size + np.cumsum(new)  # the next row, after each
    if not (row[new] == free[new] - 1).all():
        return f"must give new individuals the next free rows, {size} and following, in order, got {shown(row[new])}"
    if not ((row == -1) == (status == REJECTED)).all() or (row < -1).any() or (row >= free).any():
        return f"must give those that replace others a row that there is, and those rejected -1, got {shown(row[~new])}"
    if len(evicted) and (
        evicted.dtype.kind not in "iu"
        or evicted.min() < 0
        or evicted.max() >= free[-1]
        or len(np.unique(evicted)) < len(evicted)
    ):
        return f"must evict rows that there are, {free[-1]} in all, each once, got {shown(evicted)}"
    return None
