"""Progress of a run: a bar on a terminal, a line now and then elsewhere. Both are callbacks for `Aurora.run`."""

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from auroraqd.aurora import Aurora

_REDRAW = 0.1  # s
_LOG = 10.0  # s


class RunProgress:
    """A context whose object is called after each generation.

    Args:
        console: where to show it.
        generations: generations at the end of the run.
    """

    def __init__(self, console: Console, generations: int):
        self._console = console
        self._generations = generations
        self._bar: Progress | None = None
        self._gap = _REDRAW if console.is_terminal else _LOG
        self._next = 0.0

    def __enter__(self) -> "RunProgress":
        if self._console.is_terminal:
            self._bar = bar = Progress(  # fits into 80 columns
                MofNCompleteColumn(table_column=Column(no_wrap=True)),
                BarColumn(bar_width=8),
                TextColumn("{task.fields[state]}", table_column=Column(no_wrap=True)),
                TimeRemainingColumn(compact=True, table_column=Column(no_wrap=True)),
                TextColumn("left"),
                console=self._console,
            )
            bar.start()
            self._task = bar.add_task("", total=self._generations, state="")
        self._since, self._evaluations = time.monotonic(), 0
        self._next = self._since + (0 if self._bar else self._gap)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, aurora: Aurora) -> None:
        """Show the state of a run, if it is time to, or if the run is at its end."""
        now = time.monotonic()
        if now < self._next and aurora.generation < self._generations:
            return
        speed = (aurora.evaluations - self._evaluations) / max(now - self._since, 1e-9)
        self._next, self._since, self._evaluations = now + self._gap, now, aurora.evaluations
        record = aurora.history.last
        assert record is not None  # a generation has just been recorded
        state = f"{record.size:,} stored, l {record.l:.3g}, {record.new + record.replaced:,} added, {speed:,.0f}/s"
        if self._bar is not None:
            self._bar.update(self._task, completed=aurora.generation, state=state)
        else:
            self._console.print(f"generation {aurora.generation}/{self._generations}  {state}", highlight=False, soft_wrap=True)
