"""`auroraqd run`, `repeat` and `resume`: to discover a repertoire."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from auroraqd.cli._config import ConfigOption, SaveConfigOption, write_config
from auroraqd.cli._names import completed
from auroraqd.cli._shared import (
    CheckpointOption,
    FiguresOption,
    JobsOption,
    LogOption,
    ObservationsOption,
    OverwriteOption,
    SchedulerOption,
    SnapshotsOption,
    TimeoutOption,
    UserError,
    busy,
    loggers,
    spreading,
    warnings_said,
)
from auroraqd.cli.growing import Plan, grow

if TYPE_CHECKING:
    from auroraqd.aurora import Aurora
    from auroraqd.evaluate import Spread
    from auroraqd.experiments import Settings


OutOption = Annotated[Path | None, typer.Option(help="Run folder to create. [default: runs/TASK-DESCRIPTOR-SEED]")]


def run(
    context: typer.Context,
    task: Annotated[
        str,
        typer.Argument(
            autocompletion=completed("task"),
            help="What the robot does: ballistic, air-hockey or air-hockey:restitution_threshold=1, air-hockey-camera, maze, "
            "hexapod or hexapod:damage=leg-limp, octopus-arm; or mymodule:my_task.",
        ),
    ],
    descriptor: Annotated[
        str,
        typer.Option(
            autocompletion=completed("descriptor"),
            help="How behaviours differ: pca or autoencoder (learned), hand-coded, genotype, or observation (all of it). "
            "Options like autoencoder:isometry=0 or autoencoder:hidden=64x32 are the parameters of AutoEncoder.",
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
    emitter: Annotated[
        str,
        typer.Option(
            autocompletion=completed("emitter"),
            help="What makes genotypes: genetic (selection, then variation); goals (random, sigma, first); novelty-search or "
            "nslc (population, k); taxons (population, k, elite, first); ribs:cma (sigma, batch_size, ranker, es), "
            "ribs:iso-line (sigma, line_sigma, batch_size) or ribs:gaussian (sigma, batch_size), which need pyribs; with "
            "options like goals:random=0.2.",
        ),
    ] = "genetic",
    selection: Annotated[
        str,
        typer.Option(
            autocompletion=completed("selection"),
            help="How parents are chosen: curiosity, uniform, novelty, surprise (reconstruction error), or mixed (novelty or "
            "surprise, by a coin for each batch).",
        ),
    ] = "curiosity",
    variation: Annotated[
        str,
        typer.Option(
            autocompletion=completed("variation"),
            help="How offspring are made: polynomial (rate, eta, at_least_one), gaussian (sigma, rate) or iso-line (iso_sigma, "
            "line_sigma), with options like polynomial:eta=10.",
        ),
    ] = "polynomial",
    resolution: Annotated[
        str,
        typer.Option(
            autocompletion=completed("resolution"),
            help="How l follows the descriptors: vat:cells=47124 (cells that they span), size:individuals=10000 (about how "
            "many to store), csc:target=10000 (likewise, corrected in each generation), fixed:l=0.05; auto: vat in one and two "
            "dimensions, size in more.",
        ),
    ] = "auto",
    schedule: Annotated[
        str,
        typer.Option(
            autocompletion=completed("schedule"),
            help="When the descriptor is refitted: doubling:first=50, widening:first=20, every:generations=100 or never.",
        ),
    ] = "doubling",
    archive: Annotated[
        str,
        typer.Option(
            autocompletion=completed("archive"),
            help="Where behaviours are kept: unstructured; dominated (capacity, k); grid (cells and bounds low, high of each "
            "dimension); cvt (cells, samples, steps, low, high); or cvt-prior; with options like grid:cells=30,low=0.",
        ),
    ] = "unstructured",
    k: Annotated[int, typer.Option(help="Neighbours that make up the novelty.")] = 15,
    epsilon: Annotated[float, typer.Option(help="Tolerance of the addition rule.")] = 0.1,
    competition: Annotated[
        str,
        typer.Option(autocompletion=completed("competition"), help="Who stays of two alike: dominance or elitist."),
    ] = "dominance",
    capacity: Annotated[int | None, typer.Option(help="Most individuals to store. [default: no limit]")] = None,
    l: Annotated[float, typer.Option("--l", help="Distance threshold until the resolution sets it.")] = 0.0,
    survival: Annotated[
        float, typer.Option(help="Least share of the stored that an update of the descriptor must leave, or it is refused.")
    ] = 0.25,
    robust: Annotated[
        bool, typer.Option(help="Set observations far outside all others aside when the descriptor is fitted.")
    ] = True,
    asynchronous: Annotated[
        bool,
        typer.Option("--asynchronous", help="Workers that are free get new work at once, and wait for nobody: with --jobs."),
    ] = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    timeout: TimeoutOption = None,
    observations: ObservationsOption = None,
    checkpoint_every: CheckpointOption = 10.0,
    log: LogOption = None,
    snapshots: SnapshotsOption = True,
    figures: FiguresOption = True,
    config: ConfigOption = None,
    save_config: SaveConfigOption = None,
) -> None:
    """Discover a repertoire of behaviours and keep it in a run folder.

    Example: auroraqd run ballistic -n 500 --out runs/first
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
        emitter=s.strategy("emitter", emitter),
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
        survival=survival,
        robust=robust,
        asynchronous=asynchronous,
    )
    out = out or Path("runs") / f"{settings.task_kind}-{settings.descriptor_kind}-{seed}"
    _run(
        settings,
        out,
        overwrite,
        figures,
        checkpoint_every,
        spreading(jobs, scheduler, timeout),
        _onlookers(log, snapshots, out),
        observations=observations,
        prepared=partial(write_config, context, save_config),
    )


def repeat(
    folder: Annotated[Path, typer.Argument(help="Run folder whose settings to use.")],
    out: Annotated[Path, typer.Option(help="Run folder to create.")],
    overwrite: OverwriteOption = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    timeout: TimeoutOption = None,
    checkpoint_every: CheckpointOption = 10.0,
    log: LogOption = None,
    snapshots: SnapshotsOption = True,
    figures: FiguresOption = True,
) -> None:
    """Run again with the settings of a run folder, from the start; individuals that came one by one, in the same order."""
    from auroraqd.runs.folders import load_events

    settings = _settings_in(folder)
    events = load_events(folder) if settings.asynchronous else None
    spread_over = spreading(jobs, scheduler, timeout)
    _run(settings, out, overwrite, figures, checkpoint_every, spread_over, _onlookers(log, snapshots, out), events=events)


def resume(
    folder: Annotated[Path, typer.Argument(help="Run folder to go on with.")],
    generations: Annotated[
        int | None, typer.Option("--generations", "-n", help="In all, to go on further. [default: those of the run]")
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(help="As of `auroraqd run`, for a run that was saved from Python. [default: the one it was saved with]"),
    ] = None,
    trusted: Annotated[
        list[str] | None,
        typer.Option(
            help="Full name of a type, beyond scikit-learn's, that may be created to load the run: mymodule.MyEncoder. Several "
            "times for several."
        ),
    ] = None,
    any_environment: Annotated[
        bool, typer.Option("--any-environment", help="Go on with other versions or on another machine: no longer bit for bit.")
    ] = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    timeout: TimeoutOption = None,
    observations: ObservationsOption = None,
    checkpoint_every: CheckpointOption = 10.0,
    log: LogOption = None,
    snapshots: SnapshotsOption = True,
    figures: FiguresOption = True,
) -> None:
    """Go on with a run that was interrupted or killed, from its last checkpoint, as if it had never ended.

    A run that has ended goes on further with --generations.

    Example: auroraqd resume runs/first --generations 10000
    """
    from auroraqd.experiments.settings import is_of_settings
    from auroraqd.runs import folders

    logs, spread_over = _onlookers(log, snapshots, folder), spreading(jobs, scheduler, timeout)
    if not is_of_settings(config := folders.load_config(folder)):  # it was saved from Python
        loaded = partial(
            folders.resume, folder, trusted=trusted or (), any_environment=any_environment, observations=observations
        )
        found, aurora, plan = _saved_from_python(folder, config, generations, task, loaded)
        return grow(found, aurora, plan, folder, figures, checkpoint_every, spread_over, logs)
    if task is not None or trusted:
        raise UserError(f"--task and --trusted are for runs that were saved from Python, and {folder} says what it needs")
    settings = _settings_in(folder)
    if generations is not None:
        settings = replace(settings, generations=generations)
    with busy("loading"), warnings_said():
        if any((folder / name).is_file() for name in (folders.REPERTOIRE, folders.PREVIOUS)):
            found = settings.build_task()
            aurora = folders.resume(folder, any_environment=any_environment, observations=observations)
            aurora.run(found, generations=0)  # says so if the code of the task has changed
        else:  # it ended before its first checkpoint
            found, aurora = settings.build(observations)
    differ = _differences(settings, aurora) + (folders.changed(folder, settings.as_json()) if aurora.generation else [])
    differ = list({text.split()[0]: text for text in reversed(differ)}.values())
    if differ:
        raise UserError(f"{folder}/config.json has been changed, {', '.join(differ)}: the run cannot go on with it")
    _check_goes_on(settings.task, found, aurora, folder, settings.generations)
    grow(found, aurora, Plan.of(settings), folder, figures, checkpoint_every, spread_over, logs)


def _saved_from_python(
    folder: Path,
    config: dict[str, Any],
    generations: int | None,
    task: str | None,
    loaded: "Callable[[], Aurora]",
) -> "tuple[Any, Aurora, Plan]":
    """Task, run, and what else there is to know of a run that `auroraqd.save` or `Checkpoints` left, and a call loads."""
    from auroraqd.experiments import Settings
    from auroraqd.experiments.settings import task_of
    from auroraqd.runs import folders

    named = task or task_of(config)
    if named is None:
        raise UserError(
            f"{folder} was saved from Python, and its task cannot be imported from anywhere: say where it is, "
            "--task mymodule:my_task, or go on with it from Python, by auroraqd.resume"
        )
    with busy("loading"), warnings_said():
        aurora = loaded()
        try:
            found = Settings(task=named).build_task(aurora.n_genes)
        except ValueError as error:
            hint = "" if task else f". Say where the task of {folder} is: --task mymodule:my_task"
            raise UserError(f"{error}{hint}") from None
        if task is None and not _is_made_alike(found, named, config):
            raise UserError(
                f"the task of {folder} was made of {named} with arguments that are not known: make it in a module, and say "
                "where it is, --task mymodule:my_task"
            )
        aurora.run(found, generations=0)  # says so if the code of the task has changed
    if generations is None:
        raise UserError(
            f"{folder} was saved from Python at generation {aurora.generation}, and does not say how many there are to be: "
            "give --generations, all in all"
        )
    _check_goes_on(named, found, aurora, folder, generations)
    kept = folders.given(aurora, config)
    descriptor, in_parts = f"{config.get('descriptor', aurora.descriptor)}", len(aurora.events) > 0
    return found, aurora, Plan(named, descriptor, generations, in_parts, kept, settings=None)


def _is_made_alike(task: Any, named: str, config: dict[str, Any]) -> bool:
    """Whether a task that was made of a class without arguments is as the one that a run folder describes."""
    from inspect import signature

    from auroraqd.provenance import task_in

    kind = type(task)
    if named != f"{kind.__module__}:{kind.__qualname__}" or not signature(kind).parameters:
        return True
    return (task_in(config) or {}).get("repr") == repr(task)


def _check_goes_on(name: str, task: Any, aurora: "Aurora", folder: Path, generations: int) -> None:
    """Make sure that a run can go on with a task, and has not come to its end."""
    if getattr(task, "n_genes", aurora.n_genes) != aurora.n_genes:
        raise UserError(f"task {name} has {task.n_genes} genes now, and the run in {folder} has {aurora.n_genes}")
    if aurora.generation >= generations:
        raise UserError(
            f"{folder} is at its end, at generation {aurora.generation} with {generations} asked for: "
            "--generations with a larger number goes on"
        )


def _onlookers(log: list[str] | None, snapshots: bool, folder: Path) -> list[Any]:
    """The callbacks that the options ask for."""
    from auroraqd.runs.snapshots import Snapshots

    return [*loggers(log), *([Snapshots(folder)] if snapshots else [])]


def _differences(settings: "Settings", aurora: "Aurora") -> list[str]:
    """What differs between settings and a run, in words, as far as the run itself says."""
    names = ["seed", "batch_size", "schedule", *(["selection", "variation"] if settings.genetic else [])]
    given = {name: getattr(settings, name) for name in names}
    return [
        f"{name} {value} and not {getattr(aurora, name)}" for name, value in given.items() if value != getattr(aurora, name)
    ]


def _settings_in(folder: Path) -> "Settings":
    """The settings of a run folder that `auroraqd run` made."""
    from auroraqd.experiments import Settings
    from auroraqd.experiments.settings import is_of_settings
    from auroraqd.runs.folders import load_config

    config = load_config(folder)
    if not is_of_settings(config):
        raise UserError(
            f"{folder}/config.json cannot be run again: it has not the settings of `auroraqd run`, so it was saved from "
            "Python, or has been changed"
        )
    try:
        return Settings.from_json(config)
    except (ValueError, TypeError) as error:
        raise UserError(f"{folder}/config.json cannot be run again: {error}") from None


def _run(
    settings: "Settings",
    out: Path,
    overwrite: bool,
    figures: bool,
    every: float = 10.0,
    spread_over: "Callable[[Any], Spread] | None" = None,
    logs: Sequence[Any] = (),
    *,
    events: Any = None,
    observations: Path | None = None,
    prepared: Callable[[], None] = lambda: None,
) -> None:
    """Build a run and let it grow; `prepared` is called in between."""
    from auroraqd.provenance import described
    from auroraqd.runs.folders import check_no_layer

    _check_free(out, overwrite)
    with busy("preparing"):
        task, aurora = settings.build(observations)
        check_no_layer(described(task), out)
    prepared()
    grow(task, aurora, Plan.of(settings), out, figures, every, spread_over, logs, overwrite=overwrite, events=events)


def _check_free(out: Path, overwrite: bool) -> None:
    """Make sure that nothing will be overwritten that should not be, before any work is done."""
    from auroraqd.runs.folders import CONFIG

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
