"""Skills to look at: a contact sheet of diverse ones, and animations.

A skill is an individual whose observation is a trajectory in the plane; it is named by its row in the repertoire. Every frame
of an animation is a sample of its trajectory, nothing is interpolated.
"""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from auroraqd.observations import streams_of
from auroraqd.repertoire import Repertoire
from auroraqd.report.scenes import Scene, trajectories_of
from auroraqd.report.style import STYLE
from auroraqd.report.videos import LAST, arrangement, video

SHEET = 24
"""Skills on a contact sheet."""

_PANEL, _ALONE = 1.7, 4.0  # inches, of one skill of several, and of one alone
_EARLY, _LATE, _ARM = "#c9d3e8", ("#c8287a", "#2646a0", "#c07800"), "#444444"  # late: of each body


def skills_figure(repertoire: Repertoire, scene: Scene, rows: Sequence[int] | np.ndarray) -> Figure:
    """A contact sheet: of each skill, in the order given, the whole trajectory, darker over time, and where all ends."""
    with mpl.rc_context(STYLE):
        figure, panels = _grid(repertoire, scene, rows)
        for panel in panels:
            panel.show(panel.steps - 1)
    return figure


def animate(
    repertoire: Repertoire,
    scene: Scene,
    rows: Sequence[int] | np.ndarray,
    path: Path,
    listener: Callable[[int, int], object] = lambda done, frames: None,
) -> None:
    """Write an animation of skills, beside each other.

    Args:
        repertoire: with trajectories in the plane.
        scene: where they happen.
        rows: which skills.
        path: ends in .gif or .mp4. A file that is there is replaced when the new one is complete.
        listener: told how many frames of how many are drawn.

    Raises:
        ValueError: there is no such skill, the file has another ending, or there is no ffmpeg for .mp4.
        OSError: it cannot be written.
    """
    check_rows(repertoire, rows)
    with mpl.rc_context(STYLE):
        figure, panels = _grid(repertoire, scene, rows)
    frames = [*range(panels[0].steps), *[panels[0].steps - 1] * round(LAST / scene.interval)]
    with video(figure, path, round(1 / scene.interval)) as add:
        for done, step in enumerate(frames):
            listener(done, len(frames))
            for panel in panels:
                panel.show(step)
            add()


def check_rows(repertoire: Repertoire, rows: Sequence[int] | np.ndarray) -> None:
    """Raise ValueError unless there are these skills, and at least one of them."""
    if len(repertoire) == 0:
        raise ValueError("the repertoire is empty, nothing was stored in its run: there is no skill to show")
    if len(rows) == 0 or not all(0 <= row < len(repertoire) for row in rows):
        wrong = next((row for row in rows if not 0 <= row < len(repertoire)), "none")
        raise ValueError(f"skill must be a row of the repertoire, 0 to {len(repertoire) - 1}, got {wrong}")


def _grid(repertoire: Repertoire, scene: Scene, rows: Sequence[int] | np.ndarray) -> tuple[Figure, list["_Panel"]]:
    """A panel for each skill, about twice as wide as high."""
    lines, columns = arrangement(len(rows))
    size = _ALONE if len(rows) == 1 else _PANEL
    figure = Figure(figsize=(size * columns, (size + 0.2) * lines), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in panels[len(rows) :]:
        axes.set_visible(False)
    return figure, [_Panel(axes, repertoire, scene, int(row)) for axes, row in zip(panels, rows, strict=False)]


class _Body:
    """What moves, at any of the steps of its way, (steps, 2), from `start` on, if that is known."""

    def __init__(self, axes: Axes, way: np.ndarray, start: np.ndarray | None, radius: float, color: str):
        self._before = start is not None
        self._path = way if start is None else np.vstack([start, way])
        self._trail = LineCollection([], linewidths=1.6, capstyle="round")
        axes.add_collection(self._trail)
        self._colors = LinearSegmentedColormap.from_list("time", [_EARLY, color])(np.linspace(0, 1, len(self._path) - 1))
        (self._dot,) = axes.plot([], [], "o", markersize=3, color=color)
        self._disc = Circle(self._path[0], radius, color=color, alpha=0.35, visible=radius > 0)
        axes.add_patch(self._disc)

    def show(self, step: int) -> None:
        """Where it is at a sample, and the way until then."""
        way = self._path[: step + self._before + 1]
        self._trail.set_segments(list(np.stack([way[:-1], way[1:]], axis=1)))
        self._trail.set_color(list(self._colors[: len(way) - 1]))
        self._dot.set_data(*way[-1:].T)
        self._disc.set_center(way[-1])


class _Panel:
    """One skill, at any of its steps."""

    def __init__(self, axes: Axes, repertoire: Repertoire, scene: Scene, row: int):
        observed = trajectories_of(repertoire)
        assert observed is not None  # as `scene_of` has seen
        self.steps = observed.shape[1]
        streams = streams_of(repertoire.observation)
        ways = [(observed, scene.start), *((streams[name], start) for name, start in scene.others.items())]
        joints = None if scene.arm is None else scene.arm(repertoire.genotype[row : row + 1], self.steps)[0]
        axes.set(xticks=[], yticks=[], xlim=(scene.low[0], scene.high[0]), ylim=(scene.low[1], scene.high[1]))
        axes.set_title(f"skill {row}", fontsize=8, pad=2)
        for spine in axes.spines.values():
            spine.set_visible(True)
            spine.set(color="black" if scene.walls else "#dddddd", linewidth=1.5)
        width, height = scene.high - scene.low
        if 1 / 3 < width / height < 3:
            axes.set_aspect("equal")
        self._bodies = [
            _Body(axes, np.asarray(way[row], np.float64), start, scene.radius, color)
            for (way, start), color in zip(ways, itertools.cycle(_LATE), strict=False)
        ]
        self._joints = joints
        if joints is not None:
            axes.plot(*joints[0].T, color=_ARM, alpha=0.25, linewidth=1.5)  # where the arm begins
            (self._arm,) = axes.plot([], [], color=_ARM, marker="o", markersize=2, linewidth=1.5)

    def show(self, step: int) -> None:
        """What there is to see at a sample, and the way until then."""
        for body in self._bodies:
            body.show(step)
        if self._joints is not None:
            self._arm.set_data(*self._joints[step].T)
