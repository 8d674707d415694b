"""`auroraqd watch`: to follow a run in the terminal, by what it has left on disk."""

import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from rich.live import Live
from rich.table import Table
from rich.text import Text

from auroraqd.cli._shared import UserError, console

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDEST, _TALLEST = 100, 20  # characters of what is shown, and of its map
_LEAST_MAP = 6
_LINES = 12  # of the terminal that are not of the map


class _Seen(NamedTuple):
    """What is known of a run: of each part the last that could be read."""

    config: dict[str, Any] = {}
    records: Sequence[Any] = ()
    skills: Any = None
    files: tuple[float, ...] = ()  # when they were written
    trouble: str = ""


def watch(
    folder: Annotated[Path, typer.Argument(help="Run folder, of a run that is under way or has ended.")],
    once: Annotated[
        bool, typer.Option("--once", help="Show it as it is now, and end; so it is where the output is no terminal.")
    ] = False,
    every: Annotated[float, typer.Option(min=0.1, help="Seconds between two looks.")] = 1.0,
) -> None:
    """Follow a run in the terminal: how many skills it has, how it goes, and a map of what it has found. Ctrl-C ends it.

    It reads what the run has saved, and changes nothing.

    Example: auroraqd watch runs/first
    """
    from auroraqd.runs import folders

    folders.load_config(folder)  # or it is no run folder
    seen = _look(folder, _Seen())
    if once or not console.is_terminal:
        if seen.trouble:
            raise UserError(seen.trouble)
        console.print(_shown(folder, seen))
        return
    with suppress(KeyboardInterrupt), Live(_shown(folder, seen), console=console, auto_refresh=False) as live:
        while True:
            time.sleep(every)
            seen = _look(folder, seen)
            live.update(_shown(folder, seen), refresh=True)


def _look(folder: Path, before: _Seen) -> _Seen:
    """What is known now; what cannot be read, while it is written for instance, stays as it was."""
    from auroraqd.runs import folders

    files = tuple(_written(folder / name) for name in (folders.HISTORY, folders.REPERTOIRE, folders.PREVIOUS))
    if files == before.files and not before.trouble:
        return before
    found: dict[str, Any] = {"files": files}
    trouble = ""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the checkpoint before the last is taken
        for name, read in (("config", folders.load_config), ("records", folders.load_history), ("skills", folders.load)):
            try:
                found[name] = read(folder)
            except FileNotFoundError:  # none is there yet
                continue
            except (OSError, ValueError) as error:
                trouble = str(error)
    return before._replace(**found, trouble=trouble)


def _written(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _shown(folder: Path, seen: _Seen) -> "RenderableType":
    """What there is to see of a run, as many lines as there is room for."""
    grid = Table.grid(padding=(0, 1))
    grid.add_row(_title(folder, seen))
    if seen.trouble:
        grid.add_row(Text(_printable(f"what was read before is shown: {seen.trouble}"), style="yellow"))
    if not seen.records or seen.skills is None:
        grid.add_row("no checkpoint yet")
        return grid
    width, plain = min(console.width, _WIDEST), console.options.ascii_only
    grid.add_row(_curves(seen.records, width, plain))
    grid.add_row(_map(seen.skills, width, plain))
    return grid


def _title(folder: Path, seen: _Seen) -> Text:
    config, records = seen.config, seen.records
    words = [config.get("task"), config.get("descriptor"), f"seed {config.get('seed')}"]
    title = Text.assemble((_printable(str(folder)), "bold"), "  ", _printable(", ".join(str(word) for word in words if word)))
    if records:
        of = config.get("generations")
        title.append(f"\ngeneration {records[-1].generation:,}" + (f" of {of:,}" if isinstance(of, int) else ""))
        title.append(f", {records[-1].evaluations:,} evaluations, saved {_ago(time.time() - seen.files[0])} ago")
    return title


def _curves(records: Sequence[Any], width: int, plain: bool) -> Table:
    """Size, l, additions and error over the generations."""
    import numpy as np

    table = Table.grid(padding=(0, 1))
    added = np.array([record.new + record.replaced for record in records], np.float64)
    gaps = np.diff([record.generation for record in records], prepend=0)
    rate = np.diff(added, prepend=0) / np.maximum(gaps, 1)
    curves: dict[str, tuple[Sequence[float], str]] = {
        "skills": ([record.size for record in records], "{:,.0f}"),
        "l": ([record.l for record in records], "{:.4g}"),
        "added a generation": (list(rate), "{:,.0f}"),
        "error": ([record.rmse for record in records], "{:.4f}"),
        "fitness, mean": ([record.mean_fitness for record in records], "{:.4g}"),
    }
    from auroraqd.cli._drawn import sparkline

    for name, (values, form) in curves.items():
        known = [value for value in values if value == value]
        if not known or (name.startswith("fitness") and min(known) == max(known)):
            continue
        line = sparkline(values, max(width - 34, 8), plain=plain)
        last = form.format(values[-1]) if values[-1] == values[-1] else ""
        table.add_row(name, Text(line, style="cyan", no_wrap=True), Text(last, style="bold", justify="right"))
    return table


def _map(skills: Any, width: int, plain: bool) -> Text:
    from auroraqd.cli._drawn import character_map

    places, name = _plane(skills)
    height = min(max(console.height - _LINES, _LEAST_MAP), _TALLEST)
    lines = character_map(places, min(width, 3 * height), height, plain=plain)
    return Text("\n".join([f"{name}, {len(skills):,} skills", *lines]), no_wrap=True)


def _plane(skills: Any) -> tuple[Any, str]:
    """Places of skills, (n, 2), and where that is."""
    import numpy as np

    truth = skills.ground_truth
    if truth is not None and truth.ndim == 2 and truth.shape[1] >= 2:
        return truth[:, :2], "ground truth"
    descriptor = skills.descriptor
    if descriptor.shape[1] == 1:
        return np.column_stack([descriptor[:, 0], skills.fitness]), "descriptor and fitness"
    widest = np.sort(np.argsort(-np.ptp(descriptor, axis=0), kind="stable")[:2]) if len(descriptor) else np.array([], int)
    return (descriptor[:, widest] if len(widest) else np.empty((0, 2))), "descriptor space"


def _printable(text: str) -> str:
    """Without what would move the cursor, or change the terminal: names are of others."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _ago(seconds: float) -> str:
    for size, unit in ((86400, "d"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{max(seconds, 0):.0f} s"
