"""Individuals on their way into the archive: asked for, evaluated, not yet added."""

from typing import Any, NamedTuple

import numpy as np


class Pending(NamedTuple):
    """A batch that was asked for and not told."""

    genotype: np.ndarray  # (n, n_genes)
    parent_id: np.ndarray  # (n,) int64, -1 for those without a parent
    parent_row: np.ndarray  # (n,) int64, where the parents were when they were selected
    rearranged: int  # the archive's count at that time
    since: float


class Batch(NamedTuple):
    """Individuals that have been evaluated and not yet added."""

    genotype: np.ndarray
    parent_id: np.ndarray
    parent_row: np.ndarray
    born: np.ndarray  # (n,) int64, the number of the evaluation; -1 where it is not known
    fitness: np.ndarray
    observation: np.ndarray
    ground_truth: np.ndarray | None

    @property
    def sources(self) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """What a descriptor may read."""
        return self.genotype, self.observation, self.ground_truth

    def only(self, rows: np.ndarray) -> "Batch":
        """These rows, (n,) bool."""
        if rows.all():
            return self
        columns: Any = (None if column is None else column[rows] for column in self)
        return Batch(*columns)

    def copied(self) -> "Batch":
        """The same in memory of its own: a task may use its arrays again."""
        columns: Any = (None if column is None else column.copy() for column in self)
        return Batch(*columns)

    def joined(self, other: "Batch") -> "Batch":
        """These and the others."""
        pairs: Any = zip(self, other, strict=True)
        columns: Any = (None if one is None else np.concatenate([one, two]) for one, two in pairs)
        return Batch(*columns)
