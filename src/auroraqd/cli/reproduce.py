"""`auroraqd reproduce`: to repeat an experiment of the paper."""

import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from auroraqd.cli._config import ConfigOption
from auroraqd.cli._names import completed
from auroraqd.cli._shared import UserError, busy, console, errors
from auroraqd.cli.growing import compile_kernels

if TYPE_CHECKING:
    from auroraqd.experiments import Settings
    from auroraqd.experiments.replication import Job
    from auroraqd.experiments.variants import Experiment


def reproduce(
    task: Annotated[str, typer.Argument(autocompletion=completed("task"), help="Whose experiment: ballistic or air-hockey.")],
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
    config: ConfigOption = None,
) -> None:
    """Repeat an experiment of the paper: all variants, many times, with statistics and figures.

    Runs that are done are skipped, so it can be interrupted and called again.

    Example: auroraqd reproduce ballistic --quick
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
    names: Sequence[str],
    replications: int,
    generations: int,
    workers: int | None,
    scheduler: str | None,
    out: Path,
) -> None:
    from auroraqd._files import folder_at
    from auroraqd._workers import cores
    from auroraqd.evaluate import dask
    from auroraqd.experiments.ledger import Ledger
    from auroraqd.experiments.progress import ExperimentProgress
    from auroraqd.experiments.runner import execute, plan

    cluster: Any = None if scheduler is None else dask(scheduler)()
    ledger = Ledger(out if cluster is None else out.resolve())
    jobs, settings = plan(ledger, experiment, names, replications, experiment.base(generations))
    folder_at(out)
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
    with busy("preparing: kernels, centroids", log=True):
        for name in needed:
            if isinstance(settings[name].archive, CVT):
                settings[name].build()
        compile_kernels(next(iter(settings.values())))
