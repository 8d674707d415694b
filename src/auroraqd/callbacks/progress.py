"""Progress of a run: a bar on a terminal, a line now and then elsewhere."""

import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

if TYPE_CHECKING:
    from auroraqd.aurora import Aurora
    from auroraqd.descriptors.training import Progress as Training

_REDRAW = 0.1  # s
_LOG = 10.0  # s


class RunProgress:
    """A context whose object is called after each generation, and whose `training` while a descriptor is trained.

    Args:
        console: where to show it.
        generations: generations at the end of the run; None where it is not known.
        evaluations, generation: done before.
    """

    def __init__(self, console: Console, generations: int | None, evaluations: int = 0, generation: int = 0):
        self._console = console
        self._generations = generations
        self._evaluations = evaluations
        self._bar: Progress | None = None
        self._gap = _REDRAW if console.is_terminal else _LOG
        self._next = 0.0
        self._generation = generation

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
        self._since = time.monotonic()
        self._next = self._since + (0 if self._bar else self._gap)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, aurora: "Aurora") -> None:
        """Show the state of a run, if it is time to, or if the run is at its end."""
        self._generation = aurora.generation
        now = time.monotonic()
        if now < self._next and aurora.generation != self._generations:
            return
        speed = (aurora.evaluations - self._evaluations) / max(now - self._since, 1e-9)
        self._next, self._since, self._evaluations = now + self._gap, now, aurora.evaluations
        record = aurora.history.last
        assert record is not None  # a generation has just been recorded
        l = "" if record.l != record.l else f", l {record.l:.3g}"
        state = f"{record.size:,} stored{l}, {record.new + record.replaced:,} added, {speed:,.0f}/s"
        self._show(state)

    def training(self, progress: "Training") -> None:
        """Show the state of a training, if it is time to."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + self._gap
            self._show(f"training {progress.repeat}/{progress.repeats}, error {progress.error:.4f}")

    def _show(self, state: str) -> None:
        if self._bar is not None:
            self._bar.update(self._task, completed=self._generation, state=state)
        else:
            of = "" if self._generations is None else f"/{self._generations}"
            self._console.print(f"generation {self._generation}{of}  {state}", highlight=False, soft_wrap=True)


@contextmanager
def shown(aurora: "Aurora", generations: int | None) -> Iterator[RunProgress]:
    """Progress of a run on standard error, and of the trainings in it.

    Args:
        aurora: the run.
        generations: at its end; None where it is not known.
    """
    progress = RunProgress(Console(stderr=True), generations, aurora.evaluations, aurora.generation)
    with progress, training_told(aurora.descriptor.transformer, progress):
        yield progress


def training_told(transformer: Any, progress: RunProgress) -> AbstractContextManager[Any]:
    """Tell the progress of the training of an `AutoEncoder`; nothing of others, for which JAX need not be imported."""
    module = sys.modules.get("auroraqd.descriptors.autoencoder")
    if module is None or not isinstance(transformer, module.AutoEncoder):
        return nullcontext()
    return module.listening(progress.training)
