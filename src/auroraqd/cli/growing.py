"""A run of a command: generations with checkpoints, progress and callbacks, and what is said when it ends."""

import copy
import os
import signal
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer
from rich.text import Text

from auroraqd.cli._shared import UserError, busy, console, errors
from auroraqd.cli.show import report

if TYPE_CHECKING:
    from auroraqd.aurora import Aurora
    from auroraqd.evaluate import Spread
    from auroraqd.experiments import Settings


class Plan(NamedTuple):
    """What a command needs to know of a run that the run itself does not say."""

    task: str
    descriptor: str
    generations: int
    asynchronous: bool
    config: dict[str, Any] | None
    settings: "Settings | None"  # whose kernels are compiled first; None: as they are needed

    @classmethod
    def of(cls, settings: "Settings") -> "Plan":
        """That of a run by settings."""
        s = settings
        return cls(s.task, s.descriptor, s.generations, s.asynchronous, s.as_json(), s)


def grow(
    task: Any,
    aurora: "Aurora",
    plan: Plan,
    out: Path,
    figures: bool,
    every: float,
    spread_over: "Callable[[Any], Spread] | None",
    logs: Sequence[Any] = (),
    *,
    overwrite: bool = False,
    events: Any = None,
) -> None:
    """Run until the generations that are planned are done, with checkpoints; whatever ends it, show what was found.

    With the `events` of another run, do them again.
    """
    from auroraqd import asynchronous
    from auroraqd._compiled import compiling
    from auroraqd.callbacks.progress import RunProgress, training_told
    from auroraqd.runs.checkpoints import LOCK, Checkpoints
    from auroraqd.runs.snapshots import remove_snapshots

    if plan.asynchronous and spread_over is None and events is None:
        raise UserError("an asynchronous run needs workers: give --jobs or --scheduler too")
    failure: BaseException | None = None
    here = Path.cwd()
    bold = (plan.task, "bold"), (plan.descriptor, "bold")
    console.print(Text.assemble(bold[0], ", descriptor ", bold[1], f", seed {aurora.seed}"))
    for polite_end in {signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}:  # of a cluster, of a closed terminal
        signal.signal(polite_end, signal.default_int_handler)
    checkpoints = Checkpoints(
        aurora,
        out,
        every=every,
        config=plan.config,
        overwrite=overwrite,
        report=lambda text: errors.print(text, highlight=False),
    )
    with checkpoints:
        if overwrite:
            remove_snapshots(out)  # of the run that was there
        try:
            slow = "compiling kernels, which takes some 10 s the first time"
            with ExitStack() as said, compiling(lambda: said.enter_context(busy(slow, log=True))):
                if plan.settings is not None:
                    compile_kernels(plan.settings)
            progress = RunProgress(console, plan.generations, aurora.evaluations, aurora.generation)
            workers = nullcontext(task) if spread_over is None else spread_over(task)
            with progress, training_told(aurora.descriptor.transformer, progress), workers as spread:
                callbacks = (progress, checkpoints, *logs)
                if events is not None:
                    asynchronous.replay(aurora, spread, events, callbacks)
                else:
                    until, in_parts = plan.generations, plan.asynchronous
                    aurora.run(spread, until_generation=until, callback=callbacks, asynchronous=in_parts)
        except (KeyboardInterrupt, Exception) as error:  # whatever it is, what was found is saved and shown first
            failure = error
    os.chdir(here)  # a task may have changed it
    if checkpoints.saved:
        report(out, figures)
        kept = f"what was found is in {out}"
    else:
        kept = "nothing had been found yet"
        with suppress(OSError):  # a folder that holds anything else stays
            (out / LOCK).unlink()
            out.rmdir()
    if failure is not None:
        _end(failure, aurora, kept)


def _end(failure: BaseException, aurora: "Aurora", kept: str) -> None:
    """Say why a run has ended, and end the command."""
    from auroraqd.descriptors.descriptor import DescriptorError
    from auroraqd.emitters import EmitterError
    from auroraqd.tasks import TaskError

    if isinstance(failure, KeyboardInterrupt):
        errors.print(f"Interrupted after {aurora.generation} generations; {kept}", highlight=False)
        raise typer.Exit(130)
    if isinstance(failure, MemoryError):
        raise UserError(f"there is not enough memory: {failure}; {kept}")
    if isinstance(failure, TaskError | DescriptorError | EmitterError | ValueError | OSError):
        raise UserError(f"{failure}; {kept}")
    errors.print(kept, highlight=False)
    raise failure


def compile_kernels(settings: "Settings") -> None:
    """Run a few generations elsewhere, so that the time of compilation is not taken for the time of the run."""
    from auroraqd.experiments.settings import AUTOENCODER, GENOTYPE, PCA, TASKS, Dominated, Unstructured

    # A task of the user's own may take long, and do things: it is not called for this.
    task = settings.task if settings.task_kind in TASKS else "ballistic"
    learned = settings.descriptor_kind in (PCA, AUTOENCODER)
    descriptor = PCA if learned else GENOTYPE  # scikit-learn takes a second to import
    archive = Dominated(20) if isinstance(settings.archive, Dominated) else Unstructured()
    kernels = replace(
        settings, task=task, descriptor=descriptor, components=1, pretrained=False, archive=archive, capacity=None
    )
    task, aurora = replace(kernels, batch_size=max(settings.batch_size, 20)).build()
    aurora.run(task, generations=3)
    copy.deepcopy(aurora.archive)  # builds its index anew, as long runs do now and then
