"""The explorer: a repertoire as one HTML file, to look at skills in a browser, without a server and without a network.

Bokeh draws, whose code is within the file: its figures share what is selected, it draws many points by WebGL, and it calls
functions of the page. What is ours of that is `page.js`; `runs` says what of a run is in the page.
"""

import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auroraqd._checks import whole
from auroraqd._files import as_path, folder_at, replacing

if TYPE_CHECKING:
    from auroraqd.report.explorer.runs import Source

MOST = 20_000
"""Skills of a page, if nothing else is said: more, the eye cannot tell apart."""
_MOST_RUNS = 12
_HERE = files(__name__)


def explore(run: Any, path: str | os.PathLike = "skills.html", *, most: int = MOST) -> Path:
    """Write a page to look at the skills of a run, or at those of several beside each other: one file that needs no network.

    Needs Bokeh, the extra `explore`.

    Args:
        run: a run folder, an `Aurora`, or a `Repertoire`; or a sequence of these, of tasks with the same ground truth, which
            are compared in its space.
        path: of the file, which is replaced if it is there; its folder is created if needed.
        most: skills in the page; of more, as many are drawn at random, and the page says so. There are fewer where
            observations are large, so that the page stays below 15 MB.

    Returns:
        The path.

    Raises:
        TypeError: a run, or the path, is something else.
        FileNotFoundError: there is no such run.
        ValueError: Bokeh is not installed; a run is damaged or has no skill; of several, one has no ground truth, or one
            of another shape.
        OSError: the file cannot be written.
    """
    path = as_path("path", path)
    whole("most", most, least=1)
    several = isinstance(run, Sequence) and not isinstance(run, str | bytes | os.PathLike)
    given = list(run) if several else [run]
    if not 1 <= len(given) <= _MOST_RUNS:
        raise ValueError(f"run must be one, or from 1 to {_MOST_RUNS} of them, got {len(given)}")
    if os.path.isdir(path):  # of a name that is too long, Path.is_dir raises
        raise IsADirectoryError(f"path {path} must be of a file, and is a folder")
    page = _page(given, most)
    folder_at(path.parent)
    with replacing(path) as file:
        file.write(page.encode())
    return path


def _page(given: list[Any], most: int) -> str:
    try:
        from bokeh.embed import file_html
        from bokeh.resources import Resources
    except ImportError:
        raise ValueError('Bokeh is not installed: pip install "auroraqd[explore]"') from None
    from auroraqd.report.explorer.compared import table
    from auroraqd.report.explorer.figures import document
    from auroraqd.report.explorer.runs import content, source_of

    sources = [source_of(one) for one in given]
    _check(sources)
    runs = [content(source, max(most // len(sources), 1), 1 / len(sources)) for source in sources]
    _colour(runs)
    names = [source.name for source in sources]
    rows = table(names, [source.repertoire for source in sources]) if len(runs) > 1 else []
    shown, maps = document(runs)
    texts = {name: (_HERE / f"page.{name}").read_text() for name in ("css", "js")}
    return file_html(
        shown,
        resources=Resources(mode="inline"),
        title=" and ".join(names),
        template=(_HERE / "page.html").read_text(),
        template_variables={**texts, "maps": maps, "compared": rows},
    )


def _colour(runs: list[dict[str, Any]]) -> None:
    """Give skills their colours, by their places in all of the runs together."""
    from auroraqd.report.explorer.colours import place_colours

    everywhere = np.concatenate([run.pop("places") for run in runs])
    colours = place_colours(everywhere)
    ends = np.cumsum([len(run["rows"]) for run in runs])
    for run, own in zip(runs, np.split(colours, ends[:-1]), strict=True):
        run["place"] = own
        for moment in run["moments"]:  # a place in the ground truth has one colour at all times
            box = everywhere if run["placed"] == "ground truth" else None
            moment["colours"] = place_colours(moment.pop("colours_by"), box)


def _check(sources: "list[Source]") -> None:
    """Raise ValueError unless there are skills, and, of several runs, of one space."""
    from auroraqd.report.explorer.runs import check_any

    for source in sources:
        check_any(source.name, len(source.repertoire))
    if len(sources) < 2:
        return
    truths = [source.repertoire.ground_truth for source in sources]
    for source, truth in zip(sources, truths, strict=True):
        if truth is None:
            raise ValueError(f"run: several are compared by their ground truth, and {source.name} has none")
        if truth.shape[1:] != truths[0].shape[1:]:  # pyright: ignore[reportOptionalMemberAccess]
            raise ValueError(
                f"run: several are compared by their ground truth, of one shape, and {source.name} has {truth.shape[1:]}"
            )
