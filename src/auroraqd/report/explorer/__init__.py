"""The explorer: a repertoire as one HTML file, to look at skills in a browser, without a server and without a network.

Bokeh draws, whose code is within the file: its figures share what is selected, it draws many points by WebGL, and it calls
functions of the page. What is ours of that is `page.js`; `runs` says what of a run is in the page. `serving` shows the page of
a run that goes on.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auroraqd._checks import instance, whole
from auroraqd._files import as_path, folder_at, replacing
from auroraqd.tasks import Gym, Hexapod

if TYPE_CHECKING:
    from auroraqd.report.explorer.runs import Source

MOST = 20_000
"""Skills of a page, if nothing else is said: more, the eye cannot tell apart."""
_MOST_RUNS = 12
_MOST_FILMS = 64
_FRAME = "width:100%;height:900px;border:0"


class Page(type(Path())):
    """The path of a page, which a notebook shows inline."""

    def _repr_html_(self) -> str | None:
        """The page, if it is there, in a frame of its own: nothing in it reaches the notebook."""
        if not self.is_file():
            return None
        return (
            f'<iframe title="{escape(self.name)}" sandbox="allow-scripts allow-downloads" style="{_FRAME}" '
            f'srcdoc="{escape(self.read_text(encoding="utf-8"))}"></iframe>'
        )


def explore(
    run: Any, path: str | os.PathLike = "skills.html", *, most: int = MOST, films: int = 0, task: Gym | Hexapod | None = None
) -> Path:
    """Write a page to look at the skills of a run, or at those of several beside each other: one file that needs no network.

    Needs Bokeh, the extra `explore`. A notebook shows the page that is returned.

    Args:
        run: a run folder, an `Aurora`, or a `Repertoire`; or a sequence of these, of tasks with the same ground truth, which
            are compared in its space.
        path: of the file, which is replaced if it is there; its folder is created if needed.
        most: skills in the page; of more, as many are drawn at random, and the page says so. There are fewer where
            observations are large, so that the page stays below 15 MB.
        films: skills of robots of MuJoCo that are filmed, spread over descriptor space, at most 64 of all runs.
        task: the robot that is filmed; by default that of the run, which is imported.

    Returns:
        The path.

    Raises:
        TypeError: a run, the path, or the task is something else.
        FileNotFoundError: there is no such run.
        ValueError: Bokeh is not installed; a run is damaged or has no skill; of several, one has no ground truth, or one
            of another shape; there is no robot to film, or nothing to draw it with.
        OSError: the file cannot be written.
    """
    path = as_path("path", path)
    whole("most", most, least=1)
    whole("films", films, least=0, most=_MOST_FILMS)
    if task is not None:
        instance("task", task, Gym, "a robot, an auroraqd.tasks.Gym")
    several = isinstance(run, Sequence) and not isinstance(run, str | bytes | os.PathLike)
    given = list(run) if several else [run]
    if not 1 <= len(given) <= _MOST_RUNS:
        raise ValueError(f"run must be one, or from 1 to {_MOST_RUNS} of them, got {len(given)}")
    if os.path.isdir(path):  # of a name that is too long, Path.is_dir raises
        raise IsADirectoryError(f"path {path} must be of a file, and is a folder")
    page = _page(given, most, films, task)
    folder_at(path.parent)
    with replacing(path) as file:
        file.write(page.encode())
    return Page(path)


def _page(given: list[Any], most: int, films: int, task: Gym | Hexapod | None) -> str:
    from auroraqd.report.explorer.page import check_bokeh, check_skills, written
    from auroraqd.report.explorer.runs import source_of

    check_bokeh()
    sources = [source_of(one) for one in given]
    check_skills(sources)
    return written([_filmed(source, films // len(sources), task) for source in sources], most)


def _filmed(source: "Source", n: int, task: Gym | Hexapod | None) -> "Source":
    if n == 0:
        return source
    from auroraqd.report.explorer.films import films

    return replace(source, films=films(source.repertoire, n, task))
