"""`auroraqd show`, `explore`, `animate` and `deploy`: to look at what was found, and to take it away."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import chain
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
    """Show a skill as an animation: the robot, if MuJoCo draws it; else the way that was observed, and the arm.

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
    from auroraqd.report.robots import check_robot, robot_of
    from auroraqd.report.scenes import scene_of
    from auroraqd.report.skills import animate, check_rows

    rows = repertoire.sample(12) if skill is None else np.array([skill])
    check_rows(repertoire, rows)
    robot = robot_of(config, task)
    if robot is not None:
        check_robot(robot, repertoire.genotype.shape[1])
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
    folders: Annotated[
        list[Path], typer.Argument(help="Run folder; several are compared in their ground truth, into skills.html.")
    ],
    out: Annotated[Path | None, typer.Option(help="The .html file to write. [default: FOLDER/skills.html]")] = None,
    most: Annotated[int, typer.Option(min=1, help="Skills in the page; of more, as many are drawn at random.")] = 20_000,
    films: Annotated[
        int, typer.Option(min=0, max=64, help="Diverse skills of a robot of MuJoCo to film. Its task is imported.")
    ] = 0,
    task: Annotated[str | None, typer.Option(help="mymodule:my_task, the robot to film. [default: that of the run]")] = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Write no file, but show the run in a browser on this machine, while it goes on.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65_535, help="With --serve: where it listens. 0: any port that is free.")] = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file given by --out if it exists.")] = False,
) -> None:
    """Write a page to explore skills in a browser: one file, which needs no network and no server.

    Example: auroraqd explore runs/first --out skills.html
    """
    if serve:
        if out is not None or films or len(folders) > 1:
            raise UserError("--serve shows one run folder, whose robots are filmed when asked: leave out --out and --films")
        _serve(folders[0], port, most, task)
        return
    own = out is None and len(folders) == 1  # what was drawn of a run before is drawn anew, as its figures are
    path = folders[0] / "skills.html" if own else out or Path("skills.html")
    if path.exists() and not (own or overwrite):
        raise UserError(f"{path} exists: choose another file with --out, or replace it with --overwrite")
    with busy("drawing films" if films else "loading"), warnings_said():
        from auroraqd.report import explore
        from auroraqd.report.robots import robot_of

        explore(folders, path, most=most, films=films, task=None if task is None else robot_of({}, task))
    console.print(f"{path}, {path.stat().st_size / 1e6:.1f} MB: open it in a browser", highlight=False, soft_wrap=True)


def _serve(folder: Path, port: int, most: int, task: str | None) -> None:
    with busy("loading"):
        from auroraqd.report.explorer.serving import Server
        from auroraqd.report.robots import robot_of

        server = Server(folder, port, most=most, task=None if task is None else robot_of({}, task))
    with server, suppress(KeyboardInterrupt):
        console.print(server.url, highlight=False, soft_wrap=True)
        console.print(
            f"Open it in a browser on this machine: it follows {folder}. Ctrl-C ends it.", highlight=False, soft_wrap=True
        )
        server.serve_forever()
    console.print(f"{folder} is no longer served", highlight=False, soft_wrap=True)


def deploy(
    folder: Annotated[Path, typer.Argument(help="Run folder.")],
    out: Annotated[Path, typer.Option(help="Folder to create.")] = Path("robot"),
    rows: Annotated[str | None, typer.Option(help="Of the repertoire, like 3,17,250. [default: all]")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the files in the folder if it exists.")] = False,
) -> None:
    """Write a folder with skills for a robot that needs NumPy alone: arrays, a module that finds skills for goals, a README.

    Example: auroraqd deploy runs/first --out robot
    """
    from auroraqd.runs import folders

    if (out.exists() or out.is_symlink()) and not overwrite:
        raise UserError(f"{out} exists: choose another folder with --out, or replace its files with --overwrite")
    try:
        chosen = None if rows is None else [int(row) for row in rows.split(",")]
    except ValueError:
        raise UserError(
            f"--rows must be rows of the repertoire with commas between them, like 3,17,250, got {rows!r}"
        ) from None
    repertoire = folders.load(folder)
    try:
        made = repertoire.deploy(out, chosen, overwrite=overwrite)
    except IndexError as error:
        raise UserError(f"--{error}") from None
    number = len(repertoire) if chosen is None else len(chosen)
    size = sum(path.stat().st_size for path in made.iterdir()) / 1e3
    console.print(f"{made}: {number:,} skills, {size:,.0f} kB; see {made / 'README.md'}", highlight=False, soft_wrap=True)


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
    config = folders.load_config(folder)
    results = _results(repertoire, records, config.get("schedule"))
    shown = _what_ran(config), _networks(repertoire), _sizes(repertoire), results
    for name, value in chain.from_iterable(shown):
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


_SHARES = 0.8, 0.9, 0.95, 0.99
_LATEST = 20  # generations, for the error on individuals that are new
_GENERALISES = 1.5  # times the error of what is stored, that the error on others may be


def _results(repertoire: Any, records: Sequence[Any], schedule: Any) -> list[tuple[str, str]]:
    from auroraqd.observations import shapes_of

    shapes = f"genotype {repertoire.genotype.shape[1:]}, observation {shapes_of(repertoire.observation)}"
    rows = [("repertoire", f"{len(repertoire):,} individuals: {shapes}, descriptor {repertoire.descriptor.shape[1:]}")]
    if not records:
        return rows
    last = records[-1]
    counts = ", ".join(f"{getattr(last, name):,} {name}" for name in ("new", "replaced", "rejected", "invalid"))
    rows += [("evaluations", f"{last.evaluations:,} in {last.generation:,} generations: {counts}")]
    rows += [("l", f"{last.l:.6g}")] if last.l == last.l else []
    rows += _errors(records, schedule)
    if last.max_fitness > last.mean_fitness:
        rows += [("fitness", f"mean {last.mean_fitness:.6g}, highest {last.max_fitness:.6g}")]
    if last.refused:
        rows += [("refused", f"{last.refused:,} updates of the descriptor failed, or would have lost what was found")]
    outlying = repertoire.outlying()
    if len(outlying):
        shown = ", ".join(map(str, outlying[:10])) + ", ..." * (len(outlying) > 10)
        rows += [("far outside", f"rows {shown}: set aside when the descriptor is fitted")]
    return [*rows, ("time", f"{last.seconds:.1f} s, {_duration(last.seconds / max(last.evaluations, 1))} an evaluation")]


def _sizes(repertoire: Any) -> list[tuple[str, str]]:
    """How many dimensions observations have, which says how large a descriptor may be."""
    if not len(repertoire):
        return []
    shares = repertoire.explained()
    hold = ", ".join(f"{share:.0%}: {int((shares < share).sum()) + 1}" for share in _SHARES)
    seen = "; more than it takes, for it sees images" if _sees(repertoire.observation) else ""
    return [("dimensions", f"principal components that hold so much of the variance of what was observed: {hold}{seen}")]


def _sees(observation: Any) -> bool:
    """Whether a stream of observations is of images, of which pixels are many and what moves little."""
    from auroraqd.descriptors.networks import Image, chosen
    from auroraqd.observations import streams_of

    return any(isinstance(chosen(stream.shape[1:], stream.dtype, ()), Image) for stream in streams_of(observation).values())


def _last_update(first: int, last: int, schedule: Any) -> int:
    """The last of these numbers of generations after which an update was due; 0 for none, or a schedule that is not ours."""
    from auroraqd.runs.parts import made

    try:
        due = made("schedule", schedule, ())
    except ValueError:
        return 0
    return next((generation for generation in reversed(range(first, last)) if due(generation)), 0)


def _duration(seconds: float) -> str:
    """In the unit that leaves one to three digits before the point."""
    factor, unit = next(((f, unit) for f, unit in ((1e6, "us"), (1e3, "ms")) if round(f * seconds, 2) < 1000), (1, "s"))
    return f"{factor * seconds:.2f} {unit}"


def _errors(records: Sequence[Any], schedule: Any) -> list[tuple[str, str]]:
    """How well the descriptor reconstructs what it knows, and what it does not know, since it was last due to learn anew."""
    latest = records[-_LATEST:]
    stored, fitted = latest[-1].rmse, _last_update(latest[0].generation, latest[-1].generation, schedule)
    new = [record.rmse_new for record in latest if record.generation > fitted and record.rmse_new == record.rmse_new]
    if stored != stored:
        return []
    rows = [("RMSE", f"{stored:.4f} (reconstruction of what is stored, observations scaled to [-1, 1])")]
    if new:
        others = sum(new) / len(new)
        verdict = "" if others <= _GENERALISES * stored else ": the descriptor does not generalise"
        rows += [("", f"{others:.4f} of individuals it was not fitted on, the last {len(new)} generations{verdict}")]
    return rows
