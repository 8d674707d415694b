"""How a run went: one record a generation."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from auroraqd._checks import one_of
from auroraqd._notebooks import card, figure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Record(NamedTuple):
    """The state after a generation. Counts are totals since the start.

    Attributes:
        generation: generations done.
        evaluations: individuals evaluated.
        size: individuals stored.
        l: distance threshold; NaN for an archive that has none.
        rejected, new, replaced, invalid: individuals that were given this status.
        mean_fitness, max_fitness: of the stored; NaN while there are none.
        rmse: mean over the stored of the root mean square error of their reconstruction, on the [-1, 1] scale; NaN when the
            descriptor cannot reconstruct.
        refused: updates of the descriptor that failed or were refused; see `auroraqd.control.update`.
        rmse_new: as `rmse`, of the individuals of this generation, by a descriptor that was not fitted on them: how well it
            generalises. NaN where there are none, and in the generation of the first fit.
        seconds: time from each `ask` to the end of its `tell`.
    """

    generation: int
    evaluations: int
    size: int
    l: float
    rejected: int
    new: int
    replaced: int
    invalid: int
    mean_fitness: float
    max_fitness: float
    rmse: float
    refused: int = 0
    rmse_new: float = np.nan
    seconds: float = np.nan


class History:
    """Records of a run. Long runs are thinned: with `limit` records, every second one goes, and from then on every second
    generation is recorded, and so on, so that a run of weeks needs no more memory than one of minutes. The last record is
    always kept.
    """

    def __init__(self, limit: int = 20_000):
        self._limit = limit
        self._gap = 1
        self._records: list[Record] = []
        self._last: Record | None = None

    @classmethod
    def restored(cls, records: Sequence[Record], gap: int) -> "History":
        """The history that had these `records`, and this `gap`."""
        history = cls()
        history._gap = gap
        history._records = [record for record in records if record.generation % gap == 0]
        history._last = records[-1] if records else None
        return history

    @property
    def gap(self) -> int:
        """Generations between two records that are kept."""
        return self._gap

    def append(self, record: Record) -> None:
        """Add the record of the next generation."""
        self._last = record
        if record.generation % self._gap == 0:
            self._records.append(record)
        if len(self._records) >= self._limit:
            self._gap *= 2
            self._records = [kept for kept in self._records if kept.generation % self._gap == 0]

    @property
    def last(self) -> Record | None:
        """The latest record, None before the first generation."""
        return self._last

    @property
    def records(self) -> list[Record]:
        """All records kept, in order."""
        if self._last is None or (self._records and self._records[-1] is self._last):
            return list(self._records)
        return [*self._records, self._last]

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        return f"History of {len(self)} records, the last: {self._last}"

    def _repr_html_(self) -> str:
        last = self.last
        known = {} if last is None else {name: value for name, value in last._asdict().items() if value == value}
        facts = {
            name.replace("_", " "): f"{value:,}" if isinstance(value, int) else f"{value:.4g}" for name, value in known.items()
        }
        return card(f"History of {len(self):,} records, the last:", facts, "history", self)

    def plot(self) -> "Figure":
        """Size, l and reconstruction error over generations: a figure of Matplotlib, which notebooks show."""
        return figure_of("history_figure", self.records)

    def column(self, name: str) -> np.ndarray:
        """One field of all records, (records,).

        Raises:
            ValueError: there is no such field.
        """
        one_of("name", name, Record._fields)
        return np.array([getattr(record, name) for record in self.records])
