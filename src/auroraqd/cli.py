"""The command line. Heavy imports are inside the commands: `auroraqd --help` must answer at once."""

import copy
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from auroraqd import __version__

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from auroraqd.aurora import Aurora
    from auroraqd.experiments import Settings
    from auroraqd.experiments.replication import Job
    from auroraqd.experiments.variants import Experiment

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
JobsOption = Annotated[
    int | None, typer.Option(help="Processes that evaluate; the result is the same. [default: none but this]")
]
CheckpointOption = Annotated[float, typer.Option(min=0, help="Seconds between two checkpoints, at least.")]
SchedulerOption = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, like tcp://node1:8786, whose workers evaluate.")
]
FiguresOption = Annotated[bool, typer.Option(help="Draw the figures at the end.")]


@app.command()
def run(
    task: Annotated[
        str,
        typer.Argument(
            help="What the robot does: ballistic, air-hockey or air-hockey:restitution_threshold=1; or mymodule:my_task."
        ),
    ],
    descriptor: Annotated[
        str,
        typer.Option(
            help="How behaviours differ: pca or autoencoder (learned), hand-coded, genotype, or observation (all of it). "
            "Options like autoencoder:isometry=0 or autoencoder:hidden=64x32 are the parameters of AutoEncoder."
        ),
    ] = "pca",
    pretrained: Annotated[
        bool, typer.Option("--pretrained", help="Fit the descriptor once, on the prior data set of the task.")
    ] = False,
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
            help="How offspring are made: polynomial (rate, eta, at_least_one), gaussian (sigma, rate) or iso-line (iso_sigma, "
            "line_sigma), with options like polynomial:rate=0.1,eta=10."
        ),
    ] = "polynomial",
    resolution: Annotated[
        str, typer.Option(help="How l follows the descriptors: vat, vat:cells=47124 or fixed:l=0.05.")
    ] = "vat",
    schedule: Annotated[
        str, typer.Option(help="When the descriptor is refitted: doubling:first=50, every:generations=100 or never.")
    ] = "doubling",
    archive: Annotated[
        str,
        typer.Option(
            help="Where behaviours are kept: unstructured; grid (cells and bounds low, high of each dimension); cvt (cells, "
            "samples, steps, low, high); or cvt-prior; with options like grid:cells=30,low=0."
        ),
    ] = "unstructured",
    k: Annotated[int, typer.Option(help="Neighbours that make up the novelty.")] = 15,
    epsilon: Annotated[float, typer.Option(help="Tolerance of the addition rule.")] = 0.1,
    competition: Annotated[str, typer.Option(help="Who stays of two alike: dominance or elitist.")] = "dominance",
    capacity: Annotated[int | None, typer.Option(help="Most individuals to store. [default: no limit]")] = None,
    l: Annotated[float, typer.Option("--l", help="Distance threshold until the resolution sets it.")] = 0.0,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    checkpoint_every: CheckpointOption = 10.0,
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
        pretrained=pretrained,
        generations=generations,
        batch_size=batch_size,
        seed=seed,
        selection=s.strategy("selection", selection),
        variation=s.strategy("variation", variation),
        resolution=s.strategy("resolution", resolution),
        schedule=s.strategy("schedule", schedule),
        archive=s.strategy("archive", archive),
        l=l,
        k=k,
        epsilon=epsilon,
        competition=competition,
        capacity=capacity,
    )
    out = out or Path("runs") / f"{settings.task_kind}-{settings.descriptor_kind}-{seed}"
    _run(settings, out, overwrite, figures, checkpoint_every, _factory(jobs, scheduler))


@app.command()
def repeat(
    folder: Annotated[Path, typer.Argument(help="Run folder whose settings to use.")],
    out: Annotated[Path, typer.Option(help="Run folder to create.")],
    overwrite: OverwriteOption = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    checkpoint_every: CheckpointOption = 10.0,
    figures: FiguresOption = True,
) -> None:
    """Run again with the settings of a run folder, from the start."""
    settings = _settings_in(folder)
    _run(settings, out, overwrite, figures, checkpoint_every, _factory(jobs, scheduler))


@app.command()
def resume(
    folder: Annotated[Path, typer.Argument(help="Run folder to go on with.")],
    generations: Annotated[
        int | None, typer.Option("--generations", "-n", help="In all, to go on further. [default: those of the run]")
    ] = None,
    any_environment: Annotated[
        bool, typer.Option("--any-environment", help="Go on with other versions or on another machine: no longer bit for bit.")
    ] = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    checkpoint_every: CheckpointOption = 10.0,
    figures: FiguresOption = True,
) -> None:
    """Go on with a run that was interrupted or killed, from its last checkpoint, as if it had never ended.

    A run that has ended goes on further with --generations. Example: auroraqd resume runs/first --generations 10000
    """
    from auroraqd import storage

    settings = _settings_in(folder)
    if generations is not None:
        settings = replace(settings, generations=generations)
    with console.status("loading") if console.is_terminal else nullcontext(), _warnings_said():
        if any((folder / name).is_file() for name in (storage.REPERTOIRE, storage.PREVIOUS)):
            task, aurora = settings.build_task(), storage.resume(folder, any_environment=any_environment)
        else:  # it ended before its first checkpoint
            task, aurora = settings.build()
    given = {name: getattr(settings, name) for name in ("seed", "batch_size", "selection", "variation", "schedule")}
    differ = [
        f"{name} {value} and not {getattr(aurora, name)}" for name, value in given.items() if value != getattr(aurora, name)
    ]
    if differ:
        raise UserError(f"{folder}/config.json has been changed, {', '.join(differ)}: the run cannot go on with it")
    if aurora.generation >= settings.generations:
        raise UserError(
            f"{folder} is at its end, generation {aurora.generation} of {settings.generations}: "
            "--generations with a larger number goes on"
        )
    _grow(task, aurora, settings, folder, figures, checkpoint_every, _factory(jobs, scheduler))


@app.command()
def show(
    folder: Annotated[Path, typer.Argument(help="Run folder.")],
    figures: FiguresOption = True,
) -> None:
    """Print what a run found, and draw its figures again."""
    _report(folder, figures)


@app.command()
def animate(
    folder: Annotated[Path, typer.Argument(help="Run folder.")],
    skill: Annotated[int | None, typer.Option(help="Row of the repertoire. [default: twelve diverse ones]")] = None,
    out: Annotated[
        Path | None, typer.Option(help="A .gif or an .mp4 to write. [default: FOLDER/figures/skill-SKILL.gif]")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file given by --out if it exists.")] = False,
) -> None:
    """Show a skill as an animation: the way of the puck or projectile, and the arm that moves it.

    The rows of diverse skills are in FOLDER/figures/skills.png. Example: auroraqd animate runs/first --skill 17
    """
    from auroraqd import storage

    if out is not None and out.exists() and not overwrite:
        raise UserError(f"{out} exists: choose another file with --out, or replace it with --overwrite")
    repertoire, config = storage.load(folder), storage.load_config(folder)
    from auroraqd.report.scenes import scene_of
    from auroraqd.report.skills import animate

    scene = scene_of(config, repertoire)
    rows = repertoire.sample(12) if skill is None else [skill]
    path = out or folder / storage.FIGURES / ("skills.gif" if skill is None else f"skill-{skill}.gif")
    with console.status("drawing") if console.is_terminal else nullcontext() as status:

        def drawn(done: int, frames: int) -> None:
            if status is not None:
                status.update(f"drawing, frame {done} of {frames}")

        animate(repertoire, scene, rows, path, drawn)
    console.print(str(path), highlight=False, soft_wrap=True)


@app.command()
def reproduce(
    task: Annotated[str, typer.Argument(help="Whose experiment: ballistic or air-hockey.")],
    replications: Annotated[int, typer.Option(help="Runs of each variant.")] = 20,
    generations: Annotated[int, typer.Option(help="Generations of 200 evaluations a run.")] = 5000,
    variants: Annotated[
        str,
        typer.Option(
            help="Which, separated by commas: hand-coded, pca-incremental, ae-incremental, cvt, ae-isometric; of ballistic "
            "also genotype, pca-pretrained, ae-pretrained, cvt-prior, ae-pretrained-split."
        ),
    ] = "all",
    jobs: Annotated[int | None, typer.Option(help="Runs at once. [default: one a core]")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler, whose workers do the runs; --out must be where they all see it."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Where the results are, and more are added. [default: runs/reproduce-TASK]")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="2 replications of 60 generations, auto-encoders and CVT made small: a minute.")
    ] = False,
) -> None:
    """Repeat an experiment of the paper: all variants, many times, with statistics and figures.

    Runs that are done are skipped, so it can be interrupted and called again. Example: auroraqd reproduce ballistic --quick
    """
    from auroraqd.experiments.variants import EXPERIMENTS

    if task not in EXPERIMENTS:
        raise UserError(f"task must be one of {', '.join(EXPERIMENTS)}, got {task!r}")
    experiment = EXPERIMENTS[task].quickened() if quick else EXPERIMENTS[task]
    known = experiment.variants
    names = list(known) if variants == "all" else [name.strip() for name in variants.split(",")]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise UserError(f"variants of {task} must be of {', '.join(known)}, got {', '.join(unknown)}")
    if quick:
        replications, generations = min(replications, 2), min(generations, 60)
        console.print(
            f"quick: {replications} replications of {generations} generations; no conclusions can be drawn", highlight=False
        )
    for name, value in (("replications", replications), ("generations", generations), ("jobs", jobs)):
        if value is not None and value < 1:
            raise UserError(f"{name} must be 1 or more, got {value}")
    _reproduce(
        experiment,
        [name for name in known if name in names],
        replications,
        generations,
        jobs,
        scheduler,
        out or Path("runs") / f"reproduce-{task}{'-quick' * quick}",
    )


def _reproduce(
    experiment: "Experiment",
    names: "Sequence[str]",
    replications: int,
    generations: int,
    workers: int | None,
    scheduler: str | None,
    out: Path,
) -> None:
    from auroraqd._workers import cores
    from auroraqd.evaluate import dask
    from auroraqd.experiments.ledger import Ledger
    from auroraqd.experiments.runner import execute, plan
    from auroraqd.progress import ExperimentProgress

    cluster: Any = None if scheduler is None else dask(scheduler)()
    ledger = Ledger(out if cluster is None else out.resolve())
    jobs, settings = plan(ledger, experiment, names, replications, experiment.base(generations))
    out.mkdir(parents=True, exist_ok=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console.print(f"{len(jobs)} runs to do, {len(ledger.results)} done before; results in {out}", highlight=False)
    failed: list[str] = []
    if jobs:
        _prepare(settings, jobs)
        try:
            with ExperimentProgress(console, len(jobs)) as progress:
                execute(jobs, settings, ledger, workers or (cluster.workers if cluster else len(cores())), progress, cluster)
                failed = progress.failed
        except KeyboardInterrupt:
            if cluster:
                cluster.kill()
            errors.print(
                f"Interrupted; {len(ledger.results)} runs are done and in {out}: the same command goes on", highlight=False
            )
            raise typer.Exit(130) from None
    if not ledger.results:
        raise UserError(f"no run was completed: {'; '.join(failed)}")
    from rich.markdown import Markdown

    from auroraqd.report import write_report

    files = write_report(ledger, experiment)
    table = (out / "summary.md").read_text()
    console.print(Markdown(table) if console.is_terminal else table, highlight=False, soft_wrap=not console.is_terminal)
    for path in files:
        console.print(str(path), highlight=False, soft_wrap=True)
    if failed:
        raise UserError(f"{len(failed)} runs were given up, the same command tries them again: {'; '.join(failed)}")


def _prepare(settings: "Mapping[str, Settings]", jobs: "Sequence[Job]") -> None:
    """What is the same for all runs, once: centroids are found and kept on disk, kernels compiled."""
    from auroraqd.experiments.settings import CVT

    needed = {job.variant for job in jobs}
    with console.status("preparing: kernels, centroids") if console.is_terminal else nullcontext():
        for name in needed:
            if isinstance(settings[name].archive, CVT):
                settings[name].build()
        _compile(next(iter(settings.values())))


def _settings_in(folder: Path) -> "Settings":
    """The settings of a run folder that `auroraqd run` made."""
    from auroraqd.experiments import Settings
    from auroraqd.storage import load_config

    config = load_config(folder)
    if "task" not in config:
        raise UserError(f"{folder} was saved from Python: only what `auroraqd run` made can be run from here")
    try:
        return Settings.from_json(config)
    except (ValueError, TypeError) as error:
        raise UserError(f"{folder}/config.json cannot be run again: {error}") from None


@contextmanager
def _warnings_said() -> "Iterator[None]":
    """Warnings as a sentence, and not with the line of code that gave them."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for warning in caught:
        errors.print(f"Warning: {warning.message}", markup=False, highlight=False)


def _factory(jobs: int | None, scheduler: str | None) -> "Callable[[], Executor] | None":
    """Of the executor that the options ask for; None: no other process."""
    if jobs is None and scheduler is None:
        return None
    from auroraqd import evaluate

    if jobs is not None and scheduler is not None:
        raise UserError("give --jobs or --scheduler, not both")
    if jobs is not None and jobs < 1:
        raise UserError(f"jobs must be 1 or more, got {jobs}")
    return evaluate.processes(jobs) if scheduler is None else evaluate.dask(scheduler)


def _run(
    settings: "Settings",
    out: Path,
    overwrite: bool,
    figures: bool,
    every: float = 10.0,
    factory: "Callable[[], Executor] | None" = None,
) -> None:
    _check_free(out, overwrite)
    with console.status("preparing") if console.is_terminal else nullcontext():
        task, aurora = settings.build()
    _grow(task, aurora, settings, out, figures, every, factory, overwrite=overwrite)


def _grow(
    task: Any,
    aurora: "Aurora",
    settings: "Settings",
    out: Path,
    figures: bool,
    every: float,
    factory: "Callable[[], Executor] | None",
    *,
    overwrite: bool = False,
) -> None:
    """Run until the generations of the settings are done, with checkpoints; whatever ends it, show what was found."""
    from auroraqd.autoencoder import listening
    from auroraqd.checkpoints import LOCK, Checkpoints
    from auroraqd.evaluate import over
    from auroraqd.progress import RunProgress

    failure: BaseException | None = None
    console.print(f"[bold]{settings.task}[/], descriptor [bold]{settings.descriptor}[/], seed {settings.seed}", highlight=False)
    for polite_end in {signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}:  # of a cluster, of a closed terminal
        signal.signal(polite_end, signal.default_int_handler)
    checkpoints = Checkpoints(
        aurora,
        out,
        every=every,
        config=settings.as_json(),
        overwrite=overwrite,
        report=lambda text: errors.print(text, markup=False, highlight=False),
    )
    with checkpoints:
        try:
            with console.status("compiling, which takes some 10 s the first time") if console.is_terminal else nullcontext():
                _compile(settings)
            with RunProgress(console, settings.generations, aurora.evaluations) as progress, listening(progress.training):

                def after_each(aurora: "Aurora") -> None:
                    progress(aurora)
                    checkpoints()

                with nullcontext(task) if factory is None else over(factory, task) as spread:
                    aurora.run(spread, generations=settings.generations - aurora.generation, callback=after_each)
        except (KeyboardInterrupt, Exception) as error:  # whatever it is, what was found is saved and shown first
            failure = error
    if checkpoints.saved:
        _report(out, figures)
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
    from auroraqd.descriptor import DescriptorError
    from auroraqd.tasks import TaskError

    if isinstance(failure, KeyboardInterrupt):
        errors.print(f"Interrupted after {aurora.generation} generations; {kept}", highlight=False)
        raise typer.Exit(130)
    if isinstance(failure, MemoryError):
        raise UserError(f"there is not enough memory: {failure}; {kept}")
    if isinstance(failure, TaskError | DescriptorError | ValueError | OSError):
        raise UserError(f"{failure}; {kept}")
    errors.print(kept, highlight=False)
    raise failure


def _compile(settings: "Settings") -> None:
    """Run a few generations elsewhere, so that the time of compilation is not taken for the time of the run."""
    from auroraqd.experiments.settings import PCA, TASKS, Unstructured

    # A task of the user's own may take long, and do things: it is not called for this.
    task = settings.task if settings.task_kind in TASKS else "ballistic"
    kernels = replace(
        settings, task=task, descriptor=PCA, components=1, pretrained=False, archive=Unstructured(), capacity=None
    )
    task, aurora = replace(kernels, batch_size=max(settings.batch_size, 20)).build()
    aurora.run(task, generations=3)
    copy.deepcopy(aurora.archive)  # builds its index anew, as long runs do now and then


def _check_free(out: Path, overwrite: bool) -> None:
    """Make sure that nothing will be overwritten that should not be, before any work is done."""
    from auroraqd.storage import CONFIG

    if out.exists() and not out.is_dir():
        raise UserError(f"{out} exists and is no folder: choose another with --out")
    if out.is_dir() and any(not path.name.startswith(".") for path in out.iterdir()):
        if not (out / CONFIG).is_file():
            raise UserError(f"{out} is not empty and no run folder: choose another with --out")
        if not overwrite:
            raise UserError(
                f"{out} holds a run already: choose another folder with --out, go on with it by `auroraqd resume {out}`, or "
                "replace it with --overwrite"
            )


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
    for name, value in [*_what_ran(storage.load_config(folder)), *_results(repertoire, records[-1] if records else None)]:
        table.add_row(name, value)
    for index, path in enumerate(files):
        table.add_row("" if index else "files", str(path))
    console.print(table, highlight=False)


def _what_ran(config: "Mapping[str, Any]") -> list[tuple[str, str]]:
    archive = config.get("archive")
    kind = archive.get("type") if isinstance(archive, dict) else None
    words = [config.get("task"), config.get("descriptor"), kind, f"seed {config.get('seed')}"]
    return [("run", ", ".join(str(word) for word in words if word is not None))]


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
