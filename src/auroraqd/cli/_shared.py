"""What the commands share: where they print, how they fail, options that mean the same everywhere."""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

if TYPE_CHECKING:
    from auroraqd.callbacks.loggers import Logger
    from auroraqd.evaluate import Spread

# What is printed holds paths and messages of others: nothing in it is markup.
console = Console(soft_wrap=False, markup=False, emoji=False)
errors = Console(stderr=True, soft_wrap=True, markup=False, emoji=False)

OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace the run folder if it exists.")]
JobsOption = Annotated[
    int | None, typer.Option(help="Processes that evaluate; the result is the same. [default: none but this]")
]
ObservationsOption = Annotated[
    Path | None,
    typer.Option(help="Folder, on a fast disk, for what was observed, where that is too much for memory. [default: in memory]"),
]
TimeoutOption = Annotated[
    float | None, typer.Option(help="Seconds that an individual may take, with --jobs or --scheduler. [default: no limit]")
]
CheckpointOption = Annotated[float, typer.Option(min=0, help="Seconds between two checkpoints, at least.")]
SchedulerOption = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, like tcp://node1:8786, whose workers evaluate.")
]
LogOption = Annotated[
    list[str] | None,
    typer.Option(
        "--log",
        help="Log each generation: csv:PATH, tensorboard:FOLDER, wandb:project=NAME or mlflow:experiment=NAME. Several times "
        "for several.",
    ),
]
SnapshotsOption = Annotated[
    bool, typer.Option(help="Keep small snapshots at updates of the descriptor, which `auroraqd explore` shows over time.")
]
FiguresOption = Annotated[bool, typer.Option(help="Draw the figures at the end.")]


_LOGS = {
    "csv": ("path",),
    "tensorboard": ("folder",),
    "wandb": ("project", "mode", "name", "group", "entity", "id", "dir"),
    "mlflow": ("experiment", "tracking_uri", "run_id"),
}


class UserError(Exception):
    """A mistake of the user's, or trouble with their files: shown as one sentence."""


def busy(text: str, *, log: bool = False) -> AbstractContextManager[Any]:
    """Say what takes long, on a terminal; elsewhere in a line, if it is worth one in a log."""
    if console.is_terminal:
        return console.status(text)
    if log:
        console.print(text, highlight=False, soft_wrap=True)
    return nullcontext()


@contextmanager
def warnings_said() -> Iterator[None]:
    """Warnings as a sentence, and not with the line of code that gave them."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for warning in caught:
        errors.print(f"Warning: {warning.message}", markup=False, highlight=False)


def loggers(texts: Sequence[str] | None) -> "list[Logger]":
    """The loggers that the options ask for."""
    return [_logger(text) for text in texts or ()]


def _logger(text: str) -> "Logger":
    from auroraqd.callbacks import loggers

    kinds = {
        "csv": loggers.CSV,
        "tensorboard": loggers.TensorBoard,
        "wandb": loggers.WeightsAndBiases,
        "mlflow": loggers.MLflow,
    }
    name, _, rest = text.partition(":")
    if name not in kinds:
        raise UserError(f"--log must be one of {', '.join(kinds)}, got {text!r}")
    first, *others = _LOGS[name]
    if not others:  # a path may have any letter in it
        options = {first: rest} if rest else {}
    else:
        pairs = [option.partition("=") for option in rest.split(",") if option]
        options = {key: value for key, _, value in pairs}
    unknown = [option for option in options if option not in _LOGS[name]]
    if unknown:
        raise UserError(f"--log {name} has no option {unknown[0]!r}; its options are: {', '.join(_LOGS[name])}")
    if first not in options and name != "mlflow":
        raise UserError(f"--log {name} needs a {first}: write {name}:{first + '=NAME' if others else first.upper()}")
    try:
        return kinds[name](**options)
    except (ModuleNotFoundError, ValueError) as error:
        raise UserError(f"--log {name}: {error}") from None


def spreading(jobs: int | None, scheduler: str | None, timeout: float | None) -> "Callable[[Any], Spread] | None":
    """What makes a task one of the workers that the options ask for; None: no other process."""
    if jobs is None and scheduler is None:
        if timeout is not None:
            raise UserError("--timeout needs workers, which can be ended: give --jobs or --scheduler too")
        return None
    from auroraqd import evaluate

    if jobs is not None and scheduler is not None:
        raise UserError("give --jobs or --scheduler, not both")
    if jobs is not None and jobs < 1:
        raise UserError(f"jobs must be 1 or more, got {jobs}")
    if timeout is not None and not 0 < timeout < math.inf:
        raise UserError(f"timeout must be more than 0 seconds, got {timeout:g}")
    executor = evaluate.processes(jobs) if scheduler is None else evaluate.dask(scheduler)
    return partial(evaluate.over, executor, timeout=timeout)
