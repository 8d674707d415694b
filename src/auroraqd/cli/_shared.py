"""What the commands share: where they print, how they fail, options that mean the same everywhere."""

import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

if TYPE_CHECKING:
    from auroraqd.evaluate import Spread

# What is printed holds paths and messages of others: nothing in it is markup.
console = Console(soft_wrap=False, markup=False, emoji=False)
errors = Console(stderr=True, soft_wrap=True, markup=False, emoji=False)

OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace the run folder if it exists.")]
JobsOption = Annotated[
    int | None, typer.Option(help="Processes that evaluate; the result is the same. [default: none but this]")
]
TimeoutOption = Annotated[
    float | None, typer.Option(help="Seconds that an individual may take, with --jobs or --scheduler. [default: no limit]")
]
CheckpointOption = Annotated[float, typer.Option(min=0, help="Seconds between two checkpoints, at least.")]
SchedulerOption = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, like tcp://node1:8786, whose workers evaluate.")
]
FiguresOption = Annotated[bool, typer.Option(help="Draw the figures at the end.")]


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
