"""Archives of cells: MAP-Elites.

The space of descriptors is cut into cells, and a cell keeps the fittest individual that fell into it [1]. `GridArchive` cuts
a box into equal parts; `auroraqd.archives.cvt.CVTArchive` has cells of any shape in any number of dimensions.

[1] J.-B. Mouret, J. Clune, Illuminating search spaces by mapping elites, arXiv:1504.04909, 2015.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import numbers, shown, wholes
from auroraqd.archives.base import NEW, REPLACED, Archive, Placement
from auroraqd.individuals import Columns


class CellArchive(Archive):
    """An archive with one place a cell: a newcomer takes an empty one, or replaces who is there if it is strictly fitter.

    A new kind provides `_cells`, `n_cells` and `n_dimensions`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._row_of: dict[int, int] = {}  # cell to row: memory for the filled ones only
        self._elite: list[float] = []  # fitness, a row an individual

    @abstractmethod
    def _cells(self, descriptor: np.ndarray) -> np.ndarray:
        """The cell of each descriptor, (n, d) finite float64 to (n,) int64."""

    @property
    @abstractmethod
    def n_cells(self) -> int:
        """Cells there are."""

    @property
    @abstractmethod
    def n_dimensions(self) -> int:
        """Dimensions of the descriptors."""

    @property
    def cell(self) -> np.ndarray:
        """(n,) int64: the cell of each individual."""
        cells = np.empty(len(self), np.int64)
        cells[list(self._row_of.values())] = list(self._row_of)
        return cells

    def cell_of(self, descriptor: ArrayLike) -> np.ndarray:
        """The cells that descriptors fall into, (n, d) to (n,) int64.

        Raises:
            ValueError: wrong shape, or a NaN or an infinity.
        """
        values = numbers("descriptor", descriptor, f" of shape (n, {self.n_dimensions})", axes=2, finite=True)
        self._check_descriptor(values)
        return self._cells(values)

    def _check_descriptor(self, descriptor: np.ndarray) -> None:
        if descriptor.shape[1] != self.n_dimensions:
            raise ValueError(
                f"descriptor must have {self.n_dimensions} dimensions, as the cells have, got {descriptor.shape[1]}"
            )

    def _apart(self, descriptor: np.ndarray) -> bool:
        self._check_descriptor(descriptor)
        return len(np.unique(self._cells(descriptor))) == len(descriptor)

    def _check(self, batch: Columns) -> None:
        super()._check(batch)
        self._check_descriptor(batch["descriptor"])

    def _add_again(self, new: Columns, least: int) -> int:
        self._check_descriptor(new["descriptor"])
        return super()._add_again(new, least)

    def reindex(self) -> None:
        """As `Archive.reindex`."""
        cells = self._cells(self.descriptor).tolist() if len(self) else []
        self._row_of = {cell: row for row, cell in enumerate(cells)}
        self._elite = self.fitness.tolist()

    def place(self, batch: Columns) -> Placement:
        """As `Archive.place`, by the rule above."""
        status, rows = np.zeros(batch.rows, np.int8), np.full(batch.rows, -1)
        cells = self._cells(batch["descriptor"]).tolist()
        for i, (cell, fitness) in enumerate(zip(cells, batch["fitness"].tolist(), strict=True)):
            row = self._row_of.setdefault(cell, len(self._elite))
            if row == len(self._elite):
                self._elite.append(fitness)
                status[i], rows[i] = NEW, row
            elif fitness > self._elite[row]:
                self._elite[row] = fitness
                status[i], rows[i] = REPLACED, row
        return Placement(status, rows)


class GridArchive(CellArchive):
    """MAP-Elites on a grid: a box cut into equal cells.

    Descriptors outside the box belong to the nearest cell at its border.

    Args:
        cells: how many along each dimension, for instance (30, 30).
        low, high: the corners of the box, numbers or one a dimension. Learned descriptors have no bounds known beforehand: an
            `UnstructuredArchive` needs none.

    Raises:
        ValueError: not a box, or no cells.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> archive = auroraqd.GridArchive((2, 2), low=0, high=1)
        >>> descriptor = np.array([[0.1, 0.1], [0.2, 0.2], [0.9, 0.9]])
        >>> archive.add(np.zeros((3, 1)), np.array([0.0, 1.0, 0.0]), descriptor, descriptor)
        array([1, 2, 1], dtype=int8)
        >>> archive.cell
        array([0, 3])
    """

    def __init__(self, cells: Sequence[int], *, low: ArrayLike = -1.0, high: ArrayLike = 1.0) -> None:
        super().__init__()
        # A place in the box is a float.
        self._shape = wholes("cells", cells, "numbers of cells, one for each dimension", most=2**53)
        if not self._shape:
            raise ValueError(f"cells must be numbers of cells, one for each dimension, got {shown(cells)}")
        if self.n_cells > np.iinfo(np.int64).max:
            raise ValueError(f"cells must make fewer than 2^63 in all, got {shown(cells)}")
        try:
            self._low, self._high = (
                np.array(np.broadcast_to(numbers(name, v), len(self._shape))) for name, v in (("low", low), ("high", high))
            )
        except ValueError:
            wanted = f"numbers, or {len(self._shape)} each"
            raise ValueError(f"low and high must be {wanted}, got {shown(low)} and {shown(high)}") from None
        with np.errstate(over="ignore", invalid="ignore"):
            width = self._high - self._low
        if not (np.isfinite(width).all() and (self._low < self._high).all()):
            raise ValueError(f"low must be below high, both finite, got {shown(low)} and {shown(high)}")

    def __repr__(self) -> str:
        box = f"low={self._low.tolist()}, high={self._high.tolist()}"
        return f"GridArchive({self._shape}, {box}): {len(self)} individuals"

    @property
    def settings(self) -> dict[str, Any]:
        """The parameters, as JSON values."""
        return {"cells": list(self._shape), "low": self._low.tolist(), "high": self._high.tolist()}

    @property
    def n_cells(self) -> int:
        """Cells of the grid."""
        product = 1
        for number in self._shape:
            product *= number
        return product

    @property
    def n_dimensions(self) -> int:
        """Dimensions of the grid."""
        return len(self._shape)

    def _cells(self, descriptor: np.ndarray) -> np.ndarray:
        inside = np.clip(descriptor, self._low, self._high)
        share = (inside - self._low) / (self._high - self._low)
        place = np.minimum((share * self._shape).astype(np.int64), np.array(self._shape) - 1)
        strides = np.cumprod([1, *self._shape[:0:-1]], dtype=np.int64)[::-1]
        return place @ strides
