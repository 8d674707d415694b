"""The command line. Heavy imports are inside the commands: `auroraqd --help` must answer at once."""

import copy
import signal
import sys
import time
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from auroraqd import __version__

if TYPE_CHECKING:
    from auroraqd.aurora import Aurora
    from auroraqd.experiments import Settings

_SAVE_EVERY = 60.0  # s

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Let a robot find out by itself what it can do: Quality-Diversity with learned behavioural descriptors (AURORA).",
)
console = Console(soft_wrap=False)
errors = Console(stderr=True, soft_wrap=True)


class UserError(Exception):
    """A mistake of the user's, or trouble with their files: shown as one sentence."""


def _show_version(wanted: bool) -> None:
    if wanted:
        console.print(f"auroraqd {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


OutOption = Annotated[Path | None, typer.Option(help="Run folder to create. [default: runs/TASK-DESCRIPTOR-SEED]")]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace the run folder if it exists.")]
FiguresOption = Annotated[bool, typer.Option(help="Draw the figures at the end.")]


@app.command()
def run(
    task: Annotated[str, typer.Argument(help="What the robot does: ballistic.")],
    descriptor: Annotated[str, typer.Option(help="How behaviours differ: pca (learned), hand-coded or genotype.")] = "pca",
    components: Annotated[int, typer.Option(help="Dimensions of a learned descriptor.")] = 2,
    generations: Annotated[int, typer.Option("--generations", "-n", help="Batches to evaluate.")] = 5000,
    batch_size: Annotated[int, typer.Option(help="Evaluations a generation.")] = 200,
    seed: Annotated[int, typer.Option(help="The same seed gives the same run.")] = 0,
    out: OutOption = None,
    overwrite: OverwriteOption = False,
    selection: Annotated[str, typer.Option(help="How parents are chosen: curiosity or uniform.")] = "curiosity",
    variation: Annotated[
        str,
        typer.Option(
            help="How offspring are made: polynomial:rate=0.1,eta=10,at_least_one=true, gaussian:sigma=0.05,rate=1 or "
            "iso-line:iso_sigma=0.01,line_sigma=0.2; options may be left out."
        ),
    ] = "polynomial",
    resolution: Annotated[
        str, typer.Option(help="How l follows the descriptors: vat, vat:cells=47124 or fixed:l=0.05.")
    ] = "vat",
    schedule: Annotated[
        str, typer.Option(help="When the descriptor is refitted: doubling:first=50, every:generations=100 or never.")
    ] = "doubling",
    k: Annotated[int, typer.Option(help="Neighbours that make up the novelty.")] = 15,
    epsilon: Annotated[float, typer.Option(help="Tolerance of the addition rule.")] = 0.1,
    competition: Annotated[str, typer.Option(help="Who stays of two alike: dominance or elitist.")] = "dominance",
    capacity: Annotated[int | None, typer.Option(help="Most individuals to store. [default: no limit]")] = None,
    l: Annotated[float, typer.Option("--l", help="Distance threshold until the resolution sets it.")] = 0.0,
    figures: FiguresOption = True,
) -> None:
    """Discover a repertoire of behaviours and keep it in a run folder.

    Example: auroraqd run ballistic --descriptor pca --generations 5000 --seed 0 --out runs/first
    """
    from auroraqd.experiments import settings as s

    settings = s.Settings(
        task=task,
        descriptor=descriptor,
        components=components,
        generations=generations,
        batch_size=batch_size,
        seed=seed,
        selection=s.strategy("selection", selection),
        variation=s.strategy("variation", variation),
        resolution=s.strategy("resolution", resolution),
        schedule=s.strategy("schedule", schedule),
        l=l,
        k=k,
        epsilon=epsilon,
        competition=competition,
        capacity=capacity,
    )
    _run(settings, out or Path("runs") / f"{task}-{descriptor}-{seed}", overwrite, figures)


@app.command()
def repeat(
    folder: Annotated[Path, typer.Argument(help="Run folder whose settings to use.")],
    out: Annotated[Path, typer.Option(help="Run folder to create.")],
    overwrite: OverwriteOption = False,
    figures: FiguresOption = True,
) -> None:
    """Run again with the settings of a run folder, from the start."""
    from auroraqd.experiments import Settings
    from auroraqd.storage import load_config

    config = load_config(folder)
    if "task" not in config:
        raise UserError(f"{folder} was saved from Python: only what `auroraqd run` made can be run again")
    try:
        settings = Settings.from_json(config)
        settings.build()
    except (ValueError, TypeError) as error:
        raise UserError(f"{folder}/config.json cannot be run again: {error}") from None
    _run(settings, out, overwrite, figures)


@app.command()
def show(
    folder: Annotated[Path, typer.Argument(help="Run folder.")],
    figures: FiguresOption = True,
) -> None:
    """Print what a run found, and draw its figures again."""
    _report(folder, figures)


def _run(settings: "Settings", out: Path, overwrite: bool, figures: bool) -> None:
    _check_free(out, overwrite)
    task, aurora = settings.build()
    out.mkdir(parents=True, exist_ok=True)
    from auroraqd._interrupts import uninterrupted
    from auroraqd.descriptor import DescriptorError
    from auroraqd.progress import RunProgress
    from auroraqd.storage import save
    from auroraqd.tasks import TaskError

    failure: BaseException | None = None
    console.print(f"[bold]{settings.task}[/], descriptor [bold]{settings.descriptor}[/], seed {settings.seed}", highlight=False)
    for polite_end in {signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}:  # of a cluster, of a closed terminal
        signal.signal(polite_end, signal.default_int_handler)
    try:
        with console.status("compiling, which takes some 10 s the first time") if console.is_terminal else nullcontext():
            _compile(settings)
        with RunProgress(console, settings.generations) as progress:
            saving = _Saving(out, settings.as_json())

            def after_each(aurora: "Aurora") -> None:
                progress(aurora)
                saving(aurora)

            aurora.run(task, generations=settings.generations, callback=after_each)
    except (KeyboardInterrupt, TaskError, DescriptorError) as error:
        failure = error
    kept = "nothing had been found yet"
    if len(aurora.archive) or failure is None:
        with uninterrupted():  # an impatient second Ctrl-C
            save(aurora, out, config=settings.as_json())
        _report(out, figures)
        kept = f"what was found is in {out}"
    else:
        with suppress(OSError):  # a folder that holds an earlier run stays
            out.rmdir()
    if isinstance(failure, KeyboardInterrupt):
        errors.print(f"Interrupted after {aurora.generation} generations; {kept}", highlight=False)
        raise typer.Exit(130)
    if failure is not None:
        raise UserError(f"{failure}; {kept}")


class _Saving:
    """A callback that saves a run every minute, so that not even a dead machine costs more than that.

    A disk that is full for a while does not end the run: it is said, and tried again a minute later.
    """

    def __init__(self, out: Path, config: dict[str, Any]):
        self._out, self._config = out, config
        self._next = time.monotonic() + _SAVE_EVERY

    def __call__(self, aurora: "Aurora") -> None:
        if time.monotonic() >= self._next and len(aurora.archive):
            from auroraqd.storage import save

            try:
                save(aurora, self._out, config=self._config)
            except OSError as error:
                errors.print(f"not saved at generation {aurora.generation}: {error}", highlight=False)
            self._next = time.monotonic() + _SAVE_EVERY


def _compile(settings: "Settings") -> None:
    """Run a few generations elsewhere, so that the time of compilation is not taken for the time of the run."""
    task, aurora = replace(settings, batch_size=max(settings.batch_size, 20), capacity=None).build()
    aurora.run(task, generations=3)
    copy.deepcopy(aurora.archive)  # builds its index anew, as long runs do now and then


def _check_free(out: Path, overwrite: bool) -> None:
    """Make sure that nothing will be overwritten that should not be, before any work is done."""
    from auroraqd.storage import CONFIG

    if out.exists() and not out.is_dir():
        raise UserError(f"{out} exists and is no folder: choose another with --out")
    if out.is_dir() and any(out.iterdir()):
        if not (out / CONFIG).is_file():
            raise UserError(f"{out} is not empty and no run folder: choose another with --out")
        if not overwrite:
            raise UserError(f"{out} holds a run already: choose another folder with --out, or replace it with --overwrite")


def _report(folder: Path, figures: bool) -> None:
    from auroraqd import storage

    repertoire, records = storage.load(folder), storage.load_history(folder)
    files = [folder / name for name in (storage.CONFIG, storage.HISTORY, storage.REPERTOIRE)]
    if figures:
        from auroraqd.report import write_figures

        files += write_figures(folder)
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in _results(repertoire, records[-1] if records else None):
        table.add_row(name, value)
    for index, path in enumerate(files):
        table.add_row("" if index else "files", str(path))
    console.print(table, highlight=False)


def _results(repertoire: Any, last: Any) -> list[tuple[str, str]]:
    shapes = f"genotype {repertoire.genotype.shape[1:]}, observation {repertoire.observation.shape[1:]}"
    rows = [("repertoire", f"{len(repertoire):,} individuals: {shapes}, descriptor {repertoire.descriptor.shape[1:]}")]
    if last is None:
        return rows
    counts = ", ".join(f"{getattr(last, name):,} {name}" for name in ("new", "replaced", "rejected", "invalid"))
    rows += [("evaluations", f"{last.evaluations:,} in {last.generation:,} generations: {counts}")]
    rows += [("l", f"{last.l:.6g}")] if last.l == last.l else []
    rows += [("RMSE", f"{last.rmse:.4f} (reconstruction, observations scaled to [-1, 1])")] if last.rmse == last.rmse else []
    if last.max_fitness > last.mean_fitness:
        rows += [("fitness", f"mean {last.mean_fitness:.6g}, highest {last.max_fitness:.6g}")]
    return [*rows, ("time", f"{last.seconds:.1f} s, {1e6 * last.seconds / max(last.evaluations, 1):.2f} us an evaluation")]


def main() -> None:
    """The `auroraqd` command."""
    try:
        app(standalone_mode=True)
    except (UserError, ValueError, OSError) as error:
        _fail(str(error))
    except MemoryError as error:
        _fail(f"there is not enough memory: {error}")


def _fail(message: str) -> None:
    errors.print("[bold red]Error:[/] ", end="")
    errors.print(message, markup=False, highlight=False)
    sys.exit(1)


if __name__ == "__main__":
    main()
