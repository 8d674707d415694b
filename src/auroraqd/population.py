"""The columns of stored individuals.

A population is a set of arrays with one row an individual: contiguous, grown by doubling, without sentinels (a row exists
or it does not). Columns take their shape and dtype from the first individuals, so images stay uint8.
"""

from collections.abc import Mapping

import numpy as np

REQUIRED = ("genotype", "fitness", "observation", "descriptor", "curiosity", "id")
"""Columns that all individuals have."""

ORIGIN = ("born", "parent")
"""Columns that individuals have had since version 0.3, -1 where it is not known."""

COLUMNS = (*REQUIRED, "ground_truth", "reconstruction_error", *ORIGIN)
"""All columns."""


class Population:
    """Rows 0 to `len(population)` of named columns.

    Columns are read as attributes-by-name (`population["fitness"]`): read-only views of the rows in use.
    """

    def __init__(self):
        self._columns: dict[str, np.ndarray] = {}
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> np.ndarray:
        view = self._columns[name][: self._size]
        view.flags.writeable = False
        return view

    def define(self, columns: Mapping[str, np.ndarray]) -> None:
        """Create columns with the row shapes and dtypes of these arrays."""
        self._columns = {name: np.empty((0, *rows.shape[1:]), rows.dtype) for name, rows in columns.items()}

    def raw(self, name: str) -> np.ndarray:
        """The whole array of a column, unused rows included, for kernels that write. Invalid after `reserve`."""
        return self._columns[name]

    def reserve(self, rows: int) -> None:
        """Make room for this many rows in all."""
        for name, column in self._columns.items():
            if rows > len(column):
                grown = np.empty((max(rows, 2 * len(column), 16), *column.shape[1:]), column.dtype)
                grown[: self._size] = column[: self._size]
                self._columns[name] = grown

    def resize(self, size: int) -> None:
        """Declare how many rows are in use; there must be room."""
        self._size = size

    def write(self, target: np.ndarray, rows: Mapping[str, np.ndarray]) -> None:
        """Write rows at these places. Of several rows for one place, the last stays."""
        for name, values in rows.items():
            self._columns[name][target] = values

    def gather(self, source: np.ndarray) -> None:
        """Keep the rows `source`, (n,), in this order."""
        for column in self._columns.values():
            column[: len(source)] = column[source]
        self._size = len(source)

    def set(self, name: str, rows: np.ndarray) -> None:
        """Replace a column, or create one, by an array of `len(population)` rows."""
        self._columns[name] = rows

    def drop(self, name: str) -> None:
        """Remove a column if it is there."""
        self._columns.pop(name, None)
