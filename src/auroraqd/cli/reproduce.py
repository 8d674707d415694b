"""`auroraqd reproduce`: to repeat an experiment of the paper, or all of it."""

import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from auroraqd.cli._config import ConfigOption
from auroraqd.cli._names import completed
from auroraqd.cli._shared import UserError, busy, console, errors
from auroraqd.cli.growing import compile_kernels

if TYPE_CHECKING:
    from auroraqd.experiments import Settings
    from auroraqd.experiments.ledger import Ledger
    from auroraqd.experiments.replication import Job
    from auroraqd.experiments.variants import Experiment

PAPER = "paper"  # all experiments, and a report


def reproduce(
    task: Annotated[
        str,
        typer.Argument(
            autocompletion=completed("experiment"),
            help="Which experiment: ballistic or air-hockey, of the paper; follow-up, of Grillotti and Cully (2022); paper: "
            "all three, and a report.",
        ),
    ],
    replications: Annotated[
        int | None, typer.Option(help="Runs of each variant. [default: as published: 20, and 10 of the follow-up]")
    ] = None,
    generations: Annotated[
        int | None, typer.Option(help="Generations a run. [default: as published: 5,000 of 200, and 1,000 of 128]")
    ] = None,
    variants: Annotated[
        str,
        typer.Option(
            help="Which, separated by commas: hand-coded, pca-incremental, ae-incremental, cvt, ae-isometric; of ballistic "
            "also genotype, pca-pretrained, ae-pretrained, cvt-prior, ae-pretrained-split. Of the follow-up: hand-coded, "
            "random, csc-uniform, csc-novelty, csc-surprise, csc-mixed, csc-curiosity, csc-uniform-2, vat-uniform, "
            "vat-uniform-2, fixed-uniform, taxons, novelty-search."
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
        bool,
        typer.Option(
            "--quick", help="2 replications of 60 generations unless said, auto-encoders and CVT made small: a minute."
        ),
    ] = False,
    config: ConfigOption = None,
) -> None:
    """Repeat an experiment of the paper: all variants, many times, with statistics and figures.

    Interrupt it and call it again: runs that are done are skipped, and those under way go on. "paper" repeats
    both, and what its follow-up did on air hockey, and writes a report with each claim beside what came out.

    Example: auroraqd reproduce ballistic --quick
    """
    from auroraqd.experiments.catalogue import EXPERIMENTS

    if task != PAPER and task not in EXPERIMENTS:
        raise UserError(f"task must be one of {', '.join(EXPERIMENTS)}, {PAPER}, got {task!r}")
    experiments = [e.quickened() if quick else e for name, e in EXPERIMENTS.items() if task in (PAPER, name)]
    known = list(dict.fromkeys(name for experiment in experiments for name in experiment.variants))
    names = known if variants == "all" else [name.strip() for name in variants.split(",") if name.strip()]
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise UserError(f"variants of {task} must be of {', '.join(known)}, got {', '.join(unknown) or 'none'}")
    for name, value in (("replications", replications), ("generations", generations), ("jobs", jobs)):
        if value is not None and value < 1:
            raise UserError(f"{name} must be 1 or more, got {value}")
    if quick:
        replications, generations = replications or 2, generations or 60
        console.print(
            f"quick: {replications} replications of {generations} generations; no conclusions can be drawn", highlight=False
        )
    out = out or Path("runs") / f"reproduce-{task}{'-quick' * quick}"
    wanted = {out / e.name if task == PAPER else out: (e, [name for name in e.variants if name in names]) for e in experiments}
    _reproduce(wanted, replications, generations, jobs, scheduler)
    if task == PAPER:
        _report_on_paper(out)


class _Part(NamedTuple):
    """What there is to do of an experiment."""

    experiment: "Experiment"
    ledger: "Ledger"
    jobs: "list[Job]"
    settings: "dict[str, Settings]"


def _reproduce(
    wanted: "Mapping[Path, tuple[Experiment, Sequence[str]]]",
    replications: int | None,
    generations: int | None,
    workers: int | None,
    scheduler: str | None,
) -> None:
    """Do what is missing of each experiment in its folder, and write the reports."""
    from auroraqd._files import folder_at
    from auroraqd._workers import cores
    from auroraqd.evaluate import dask
    from auroraqd.experiments.ledger import Ledger
    from auroraqd.experiments.runner import plan
    from auroraqd.runs.folders import CONFIG

    for folder in wanted:
        if (folder / CONFIG).exists():
            raise UserError(f"{folder} holds a run: choose another folder for the results of an experiment")
    cluster: Any = None if scheduler is None else dask(scheduler)()
    parts = []
    for folder, (experiment, names) in wanted.items():
        ledger = Ledger(folder if cluster is None else folder.resolve())
        runs = replications or experiment.replications
        parts.append(_Part(experiment, ledger, *plan(ledger, experiment, names, runs, experiment.base(generations))))
    for folder, part in zip(wanted, parts, strict=True):
        folder_at(folder)
        done = len(part.ledger.results)
        console.print(f"{len(part.jobs)} runs to do, {done} done before; results in {folder}", highlight=False)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    failed: list[str] = []
    if any(part.jobs for part in parts):
        try:
            failed = _execute(parts, workers or (cluster.workers if cluster else len(cores())), cluster)
        except KeyboardInterrupt:
            if cluster:
                cluster.kill()
            done, where = sum(len(part.ledger.results) for part in parts), " and ".join(map(str, wanted))
            errors.print(f"Interrupted; {done} runs are done and in {where}: the same command goes on", highlight=False)
            raise typer.Exit(130) from None
    if not any(part.ledger.results for part in parts):
        raise UserError(f"no run was completed: {'; '.join(failed)}")
    for folder, part in zip(wanted, parts, strict=True):
        if part.ledger.results:
            _report(part, folder)
    if failed:
        raise UserError(f"{len(failed)} runs were given up, the same command tries them again: {'; '.join(failed)}")


def _execute(parts: "Sequence[_Part]", workers: int, cluster: Any) -> list[str]:
    """Do the runs of one experiment after the other; returns those that were given up."""
    from auroraqd.experiments.duration import TimeLeft
    from auroraqd.experiments.progress import ExperimentProgress
    from auroraqd.experiments.runner import execute

    jobs = [job for part in parts for job in part.jobs]
    _prepare(parts)
    left = TimeLeft(jobs, workers, [(part.experiment.name, part.ledger.results) for part in parts])
    with ExperimentProgress(console, len(jobs), left) as progress:
        for part in parts:
            if part.jobs:
                progress.begin(part.experiment.name)
                execute(part.jobs, part.settings, part.ledger, workers, progress, cluster)
        return progress.failed


def _report(part: "_Part", folder: Path) -> None:
    from rich.markdown import Markdown

    from auroraqd.report import write_report

    files = write_report(part.ledger, part.experiment)
    table = (folder / "summary.md").read_text()
    console.print(Markdown(table) if console.is_terminal else table, highlight=False, soft_wrap=not console.is_terminal)
    _print_paths(files)


def _report_on_paper(out: Path) -> None:
    """The claims, judged by all results in the folder."""
    from auroraqd.experiments.catalogue import EXPERIMENTS
    from auroraqd.experiments.ledger import Ledger
    from auroraqd.report import write_paper

    ledgers = {name: Ledger(out / name) for name in EXPERIMENTS}
    files = write_paper({name: ledger for name, ledger in ledgers.items() if ledger.results}, out)
    console.print(next(line for line in files[0].read_text().splitlines() if line.startswith("Of ")), highlight=False)
    _print_paths(files)


def _print_paths(files: Sequence[Path]) -> None:
    for path in files:
        console.print(str(path), highlight=False, soft_wrap=True)


def _prepare(parts: "Sequence[_Part]") -> None:
    """What is the same for all runs, once: centroids are found and kept on disk, kernels compiled."""
    from auroraqd.experiments.settings import CVT

    with busy("preparing: kernels, centroids", log=True):
        for part in parts:
            for name in {job.variant for job in part.jobs}:
                if isinstance(part.settings[name].archive, CVT):
                    part.settings[name].build()
            if part.jobs:
                compile_kernels(next(iter(part.settings.values())))
