"""The columns of an archive in memory: contiguous, grown by doubling, without sentinels (a row exists or it does not).

Columns take their shape and dtype from the first individuals, so images stay uint8. The observations may be in a file.
"""

from collections.abc import Callable, Collection

import numpy as np

from auroraqd.individuals import Columns

Room = Callable[[tuple[int, ...], np.dtype], np.ndarray]
"""Makes an array of a shape and a dtype, whatever is in it."""


class Population:
    """Rows 0 to `len(population)` of named columns.

    Columns are read by name (`population["fitness"]`): read-only views of the rows in use.

    Args:
        like: the columns it is to have, of any rows.
        room: for the observations.
    """

    def __init__(self, like: Columns = Columns({}), room: Room = np.empty):
        self._columns = {name: np.empty((0, *rows.shape[1:]), rows.dtype) for name, rows in like.items()}
        self._room = room
        self._size = 0

    def _new(self, name: str, rows: int) -> np.ndarray:
        """An array for a column, for this many rows."""
        column = self._columns[name]
        return (self._room if name == "observation" else np.empty)((rows, *column.shape[1:]), column.dtype)

    def move(self, room: Room) -> None:
        """Have the observations elsewhere. Columns are as they were."""
        if "observation" in self._columns:
            column = self._columns["observation"]
            moved = room(column.shape, column.dtype)
            moved[: self._size] = column[: self._size]
            self._columns["observation"] = moved
        self._room = room

    def __len__(self) -> int:
        return self._size

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> np.ndarray:
        view = self._columns[name][: self._size]
        view.flags.writeable = False
        return view

    @property
    def columns(self) -> Columns:
        """All of them, as views."""
        return Columns({name: self[name] for name in self._columns})

    def raw(self, name: str) -> np.ndarray:
        """The whole array of a column, unused rows included, for kernels that write. Invalid after `write`."""
        return self._columns[name]

    def write(self, target: np.ndarray, rows: Columns, size: int, *, but: Collection[str] = ()) -> None:
        """Write rows at these places, for which there is room, and have `size` in all. Columns in `but` have been written."""
        for name, column in self._columns.items():
            if name not in but:
                column[target] = rows[name]
        self._size = size

    def reserve(self, rows: int) -> None:
        """Make room for this many rows in all."""
        for name, column in self._columns.items():
            if rows > len(column):
                grown = self._new(name, max(rows, 2 * len(column), 16))
                grown[: self._size] = column[: self._size]
                self._columns[name] = grown

    def gather(self, source: np.ndarray) -> None:
        """Keep the rows `source`, (n,), in this order."""
        for column in self._columns.values():
            column[: len(source)] = column[source]
        self._size = len(source)

    def renew(self, source: np.ndarray) -> None:
        """As `gather`, into new arrays with as much room: who holds views of those before sees what there was."""
        for name, column in self._columns.items():
            renewed = self._new(name, len(column))
            np.take(column, source, axis=0, out=renewed[: len(source)], mode="clip")  # "raise" would copy once more
            self._columns[name] = renewed
        self._size = len(source)

    def set(self, name: str, rows: np.ndarray) -> None:
        """Replace a column, or create one, by an array of `len(population)` rows."""
        self._columns[name] = rows

    def drop(self, name: str) -> None:
        """Remove a column if it is there."""
        self._columns.pop(name, None)


class Rows:
    """Where individuals are: ids, which are dense, to rows."""

    def __init__(self) -> None:
        self._row = np.zeros(0, np.int32)  # and one more, so that 0 is nowhere: memory that nobody writes to costs nothing

    @property
    def places(self) -> np.ndarray:
        """By id: the row and one more, 0 for nowhere."""
        return self._row

    def reserve(self, most: int) -> None:
        """Make room for ids below this number."""
        if most > len(self._row):
            grown = np.zeros(max(most, 2 * len(self._row)), np.int32)
            grown[: len(self._row)] = self._row
            self._row = grown

    def set(self, ids: np.ndarray, rows: np.ndarray | int) -> None:
        """These individuals, (n,), for which there is room, are in these rows; or nowhere, for -1."""
        self._row[ids] = rows + 1

    def of(self, ids: np.ndarray) -> np.ndarray:
        """The rows of individuals, (n,) int64; -1 of those that are nowhere."""
        known = (ids >= 0) & (ids < len(self._row))
        if known.all():
            return self._row[ids] - np.int64(1)
        rows = np.full(ids.shape, -1)
        rows[known] = self._row[ids[known]] - np.int64(1)
        return rows
