"""`auroraqd show`, `explore` and `animate`: to look at what was found."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from auroraqd.cli._shared import FiguresOption, UserError, busy, console, warnings_said


def show(
    folder: Annotated[Path, typer.Argument(help="Run folder.")],
    figures: FiguresOption = True,
) -> None:
    """Print what a run found, and draw its figures again."""
    report(folder, figures)


def animate(
    folder: Annotated[Path, typer.Argument(help="Run folder.")],
    skill: Annotated[int | None, typer.Option(help="Row of the repertoire. [default: twelve diverse ones]")] = None,
    out: Annotated[
        Path | None, typer.Option(help="A .gif or an .mp4 to write. [default: FOLDER/figures/skill-SKILL.gif]")
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(help="mymodule:my_task, a Gym, of a run that was saved from Python. [default: that of the run]"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file given by --out if it exists.")] = False,
) -> None:
    """Show a skill as an animation: the robot, if MuJoCo draws it; or the way of the puck or projectile, and the arm.

    The rows of diverse skills are in FOLDER/figures/skills.png.

    Example: auroraqd animate runs/first --skill 17
    """
    import numpy as np

    from auroraqd.runs import folders
    from auroraqd.tasks.noise import other_seeds

    if out is not None and out.exists() and not overwrite:
        raise UserError(f"{out} exists: choose another file with --out, or replace it with --overwrite")
    repertoire, config = folders.load(folder), folders.load_config(folder)
    from auroraqd.report import film
    from auroraqd.report.scenes import scene_of
    from auroraqd.report.skills import animate, check_rows

    rows = repertoire.sample(12) if skill is None else np.array([skill])
    check_rows(repertoire, rows)
    robot = _robot(config, task)
    if robot is not None and robot.n_genes != repertoire.genotype.shape[1]:
        raise UserError(
            f"task {task} has {robot.n_genes} genes, and the skills in {folder} have {repertoire.genotype.shape[1]}"
        )
    path = out or folder / folders.FIGURES / ("skills.gif" if skill is None else f"skill-{skill}.gif")
    with busy("drawing") as status:

        def drawn(done: int, frames: int) -> None:
            if status is not None:
                status.update(f"drawing, frame {done} of {frames}")

        if robot is None:
            animate(repertoire, scene_of(config, repertoire), rows, path, drawn)
        else:
            seeds = other_seeds(0, len(rows)) if robot.seeded else None
            film(robot, repertoire.genotype[rows], path, seeds, [f"skill {row}" for row in rows], drawn)
    console.print(str(path), highlight=False, soft_wrap=True)


def explore(
    folders: Annotated[list[Path], typer.Argument(help="Run folder; several are compared in their ground truth.")],
    out: Annotated[Path, typer.Option(help="The .html file to write.")] = Path("skills.html"),
    most: Annotated[int, typer.Option(help="Skills in the page; of more, as many are drawn at random.")] = 20_000,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a page to explore skills in a browser: one file, which needs no network and no server.

    Example: auroraqd explore runs/first --out skills.html
    """
    if out.exists() and not overwrite:
        raise UserError(f"{out} exists: choose another file with --out, or replace it with --overwrite")
    with busy("loading"):
        from auroraqd.report import explore

        with warnings_said():
            explore(folders, out, most=most)
    console.print(f"{out}, {out.stat().st_size / 1e6:.1f} MB: open it in a browser", highlight=False, soft_wrap=True)


def _robot(config: Mapping[str, Any], named: str | None) -> Any:
    """The task that is named, or else that of the run, if it is a robot that MuJoCo draws; or None."""
    from auroraqd.experiments import Settings
    from auroraqd.experiments.settings import task_of
    from auroraqd.tasks import Gym

    try:
        task = Settings(task=named or task_of(config) or "ballistic").build_task()
    except ValueError:
        if named is not None:
            raise
        return None  # its module is not here: its trajectories can be drawn
    if isinstance(task, Gym) and task.model is not None:
        return task
    if named is not None:
        raise UserError(f"task {named} is no robot that MuJoCo draws, a Gym of one of its environments")
    return None


def report(folder: Path, figures: bool) -> None:
    """Print what a run found, and where its files are."""
    from auroraqd.runs import folders

    repertoire, records = folders.load(folder), folders.load_history(folder)
    files = [folder / name for name in (folders.CONFIG, folders.HISTORY, folders.REPERTOIRE)]
    trouble = None
    if figures:
        from auroraqd.report import write_figures

        try:
            with warnings_said():
                files += write_figures(folder)
        except OSError as error:  # what was found is shown all the same
            trouble = error
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in [*_what_ran(folders.load_config(folder)), *_networks(repertoire), *_results(repertoire, records)]:
        table.add_row(name, value)
    for index, path in enumerate(files):
        table.add_row("" if index else "files", str(path))
    console.print(table, highlight=False)
    if trouble is not None:
        raise UserError(f"the figures could not be drawn, --no-figures leaves them out: {trouble}")


def _what_ran(config: Mapping[str, Any]) -> list[tuple[str, str]]:
    from auroraqd.provenance import task_named

    archive = config.get("archive")
    kind = archive.get("type") if isinstance(archive, dict) else None
    emitters = [each for each in [config.get("emitter"), *_first_of_pairs(config.get("emitters"))] if isinstance(each, dict)]
    makers = [str(each.get("type")) for each in emitters if each.get("type") != "Genetic"]
    words = [task_named(config), config.get("descriptor"), kind, *makers, f"seed {config.get('seed')}"]
    return [("run", ", ".join(str(word) for word in words if word is not None))]


def _networks(repertoire: Any) -> list[tuple[str, str]]:
    """Of what auto-encoders are made, which they may have chosen by what they saw."""
    try:
        transformer = repertoire._origin.transformer()
    except ValueError:  # it was not saved, or is of a type that nobody said to trust
        return []
    parts = getattr(transformer, "fitted_", {"": transformer})
    found = [f"{name} {part.network_}".strip() for name, part in parts.items() if hasattr(part, "network_")]
    return [("" if index else "network", network) for index, network in enumerate(found)]


def _first_of_pairs(pairs: Any) -> list[Any]:
    return [pair[0] for pair in pairs if isinstance(pair, list) and pair] if isinstance(pairs, list) else []


_LATEST = 20  # generations, for the error on individuals that are new
_GENERALISES = 1.5  # times the error of what is stored, that the error on others may be


def _results(repertoire: Any, records: Sequence[Any]) -> list[tuple[str, str]]:
    from auroraqd.observations import shapes_of

    shapes = f"genotype {repertoire.genotype.shape[1:]}, observation {shapes_of(repertoire.observation)}"
    rows = [("repertoire", f"{len(repertoire):,} individuals: {shapes}, descriptor {repertoire.descriptor.shape[1:]}")]
    if not records:
        return rows
    last = records[-1]
    counts = ", ".join(f"{getattr(last, name):,} {name}" for name in ("new", "replaced", "rejected", "invalid"))
    rows += [("evaluations", f"{last.evaluations:,} in {last.generation:,} generations: {counts}")]
    rows += [("l", f"{last.l:.6g}")] if last.l == last.l else []
    rows += _errors(records)
    if last.max_fitness > last.mean_fitness:
        rows += [("fitness", f"mean {last.mean_fitness:.6g}, highest {last.max_fitness:.6g}")]
    if last.refused:
        rows += [("refused", f"{last.refused:,} updates of the descriptor failed, or would have lost what was found")]
    outlying = repertoire.outlying()
    if len(outlying):
        shown = ", ".join(map(str, outlying[:10])) + ", ..." * (len(outlying) > 10)
        rows += [("far outside", f"rows {shown}: set aside when the descriptor is fitted")]
    return [*rows, ("time", f"{last.seconds:.1f} s, {_duration(last.seconds / max(last.evaluations, 1))} an evaluation")]


def _duration(seconds: float) -> str:
    """In the unit that leaves one to three digits before the point."""
    factor, unit = next(((f, unit) for f, unit in ((1e6, "us"), (1e3, "ms")) if round(f * seconds, 2) < 1000), (1, "s"))
    return f"{factor * seconds:.2f} {unit}"


def _errors(records: Sequence[Any]) -> list[tuple[str, str]]:
    """How well the descriptor reconstructs what it knows, and what it does not know."""
    stored, new = records[-1].rmse, [record.rmse_new for record in records[-_LATEST:]]
    new = [value for value in new if value == value]
    if stored != stored:
        return []
    rows = [("RMSE", f"{stored:.4f} (reconstruction of what is stored, observations scaled to [-1, 1])")]
    if new:
        others = sum(new) / len(new)
        verdict = "" if others <= _GENERALISES * stored else ": the descriptor does not generalise"
        rows += [("", f"{others:.4f} of individuals it was not fitted on, the last {len(new)} generations{verdict}")]
    return rows
