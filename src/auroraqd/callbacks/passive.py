"""A grid beside a run, which says how much of a space was seen, whatever the archive of the run keeps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import number
from auroraqd.archives.base import Info
from auroraqd.archives.grid import GridArchive
from auroraqd.individuals import Columns
from auroraqd.metrics import grid_of
from auroraqd.observations import finite_rows

_OF = ("ground_truth", "descriptor")


class Score(NamedTuple):
    """How much of a grid was filled by the end of a generation.

    Attributes:
        generation, evaluations: of the run.
        coverage: the share of the cells that are filled.
        qd_score: the fitness of the fittest in each, summed.
    """

    generation: int
    evaluations: int
    coverage: float
    qd_score: float


class PassiveGrid:
    """A callback that keeps, in each cell of a grid, the fittest of all individuals evaluated while it looks on, stored or not.

    It takes no part in the run. So runs whose archives or descriptors differ are compared in one space.

    Args:
        bins: cells in each dimension, a number or one each.
        low, high: the corners of the box, numbers or one each. What is outside counts to the nearest cell at the border.
        of: what is in the grid, "ground_truth" or "descriptor". A learned descriptor changes its meaning with each update.
        offset: subtracted from each fitness in the QD-score: the least there can be.

    Attributes:
        archive: the grid, a `GridArchive`; None before the first individuals.
        scores: a `Score` for each generation.

    Raises:
        ValueError: an argument is out of range; in a run, the task gives no ground truth, or there is no such grid.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> grid = auroraqd.callbacks.PassiveGrid(30)
        >>> aurora = auroraqd.Aurora(2, "genotype", seed=0).run(task, generations=3, callback=grid)
        >>> len(grid.scores), 0 < grid.scores[-1].coverage < 1
        (3, True)
    """

    def __init__(
        self,
        bins: int | Sequence[int],
        low: ArrayLike = -1.0,
        high: ArrayLike = 1.0,
        *,
        of: str = "ground_truth",
        offset: float = 0.0,
    ) -> None:
        if of not in _OF:
            raise ValueError(f"of must be one of {', '.join(_OF)}, got {of!r}")
        grid_of(bins, low, high, max(np.size(bins), np.size(low), np.size(high)))  # so that what is wrong is said now
        self._of, self._box = of, (bins, low, high)
        self._offset = number("offset", offset, least=-np.inf, wanted="subtracted from each fitness")
        self.archive: GridArchive | None = None
        self.scores: list[Score] = []

    def told(self, aurora: Any, batch: Columns, info: Info) -> None:
        """Individuals were evaluated: those that are valid are put into the grid."""
        if self._of not in batch:
            raise ValueError("a PassiveGrid of ground_truth reads the ground truth, but the task gives none: of='descriptor'")
        points = np.asarray(batch[self._of], np.float64).reshape(batch.rows, -1)
        valid = finite_rows(batch["fitness"]) & finite_rows(points)
        if not valid.any():
            return
        if self.archive is None:
            self.archive = grid_of(*self._box, points.shape[1])
        seen = batch.only("genotype", "fitness", "observation", "born", "parent") | {"descriptor": points}
        self.archive.insert(seen.take(valid), finite_rows(batch["observation"])[valid])

    def generation(self, aurora: Any) -> None:
        """A generation is done: score it."""
        self.scores.append(Score(aurora.generation, aurora.evaluations, self.coverage, self.qd_score))

    @property
    def coverage(self) -> float:
        """The share of the cells that are filled."""
        return 0.0 if self.archive is None else len(self.archive) / self.archive.n_cells

    @property
    def qd_score(self) -> float:
        """The fitness of the fittest in each cell, less the offset, summed."""
        return 0.0 if self.archive is None else float(np.sum(self.archive.fitness - self._offset))
