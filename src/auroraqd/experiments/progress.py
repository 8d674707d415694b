"""Progress of an experiment: bars on a terminal, a line now and then elsewhere."""

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from auroraqd.experiments.duration import TimeLeft, spoken
from auroraqd.experiments.replication import Job, Result
from auroraqd.experiments.runner import Status

_LOG = 10.0  # s


class ExperimentProgress:
    """A context that shows how an experiment goes: a `auroraqd.experiments.runner.Listener`.

    Args:
        console: where to show it.
        runs: how many there are to do.
        left: how long they take.
    """

    def __init__(self, console: Console, runs: int, left: TimeLeft):
        self._console = console
        self._runs = runs
        self._left = left
        self._experiment = ""
        self._finished = 0
        self._failed: list[str] = []
        self._tasks: dict[tuple[str, int], TaskID] = {}
        self._next = 0.0
        self._latest: dict[tuple[str, int], Status] = {}

    @property
    def failed(self) -> list[str]:
        """The runs that were given up, and why."""
        return list(self._failed)

    def __enter__(self) -> "ExperimentProgress":
        self._bar = Progress(
            TextColumn("{task.description}", table_column=Column(no_wrap=True)),
            MofNCompleteColumn(table_column=Column(no_wrap=True)),
            BarColumn(bar_width=12),
            TextColumn("{task.fields[state]}", table_column=Column(no_wrap=True)),
            TimeElapsedColumn(),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._all = self._bar.add_task("runs", total=self._runs, state="")
        self._bar.start()
        self._next = time.monotonic() + _LOG
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def begin(self, experiment: str) -> None:
        """What is told from now on is about this experiment."""
        self._experiment = experiment

    def progress(self, status: Status) -> None:
        """A run has come this far."""
        run = status.variant, status.replication
        self._left.progress(self._experiment, status)
        self._bar.update(self._all, state=self._time_left())
        self._latest[run] = status
        if run not in self._tasks:
            name = f"{status.variant} {status.replication}"
            self._tasks[run] = self._bar.add_task(name, total=status.generations, state="")
        self._bar.update(self._tasks[run], completed=status.generation, state=_state(status))
        if not self._console.is_terminal and time.monotonic() >= self._next:
            self._next = time.monotonic() + _LOG
            self._line(f"{self._finished}/{self._runs} runs{', ' * bool(self._time_left())}{self._time_left()}")
            for latest in list(self._latest.values()):
                where = f"generation {latest.generation}/{latest.generations}"
                self._line(f"{latest.variant} {latest.replication}: {where}, {_state(latest)}")

    def finished(self, result: Result) -> None:
        """A run is done."""
        self._finished += 1
        self._left.finished(self._experiment, result)
        self._remove(result.variant, result.replication)
        rmse = "" if result.rmse != result.rmse else f", RMSE {result.rmse:.4f}"
        measures = "".join(f", {name} {value:.4g}" for name, value in list(result.measures.items())[:1])
        self._line(
            f"{self._finished}/{self._runs} {result.variant} {result.replication}: {result.size:,} stored"
            f"{measures}{rmse}, {result.seconds:.0f} s"
        )

    def failed_run(self, job: Job, reason: str) -> None:
        """A run is given up."""
        self._left.without(self._experiment, job.variant, job.replication)
        self._remove(job.variant, job.replication)
        self._failed.append(f"{job.variant} {job.replication}: {reason}")
        self._line(f"given up: {self._failed[-1]}")

    def _remove(self, variant: str, replication: int) -> None:
        self._latest.pop((variant, replication), None)
        task = self._tasks.pop((variant, replication), None)
        if task is not None:
            self._bar.remove_task(task)
        self._bar.update(self._all, completed=self._finished, state=self._time_left())

    def _time_left(self) -> str:
        seconds = self._left.seconds()
        return "" if seconds is None else f"{spoken(seconds)} left"

    def _line(self, text: str) -> None:
        self._bar.console.print(text, highlight=False, soft_wrap=True)


def _state(status: Status) -> str:
    return f"{status.size:,} stored{', ' * bool(status.training)}{status.training}"
