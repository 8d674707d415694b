"""What the diversity score counts, in a picture (paper, Sec. "Second scenario", Fig. "Air hockey", left)."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from auroraqd.metrics import squares
from auroraqd.report.style import STYLE

_TRAJECTORIES = 3  # in each example
_PASSED, _END = "#b5c7ea", "#5f82c9"
_LINES = ("#c8287a", "#e09a20", "#0e8a72")


def diversity_figure(trajectories: np.ndarray, bins: int = 10) -> Figure:
    """Two sets of trajectories that end in the same square: three that are alike, three that are not.

    The squares that a set passes are filled; their share of all squares is what the set adds to the score.

    Args:
        trajectories: (n, steps, 2), of a repertoire, in a room from -1 to 1.
        bins: along each side.
    """
    passed = squares(trajectories, bins)
    ends, counts = np.unique(passed[:, -1], return_counts=True)
    # The end that is reached in the most ways, of those that are reached often enough.
    often = ends[counts >= min(_TRAJECTORIES, counts.max())]
    end = max(often, key=lambda square: len(np.unique(passed[passed[:, -1] == square])))
    rows = np.flatnonzero(passed[:, -1] == end)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7, 3.9), layout="constrained")
        for axes, chosen in zip(figure.subplots(1, 2), (_alike(trajectories, rows), _different(passed, rows)), strict=True):
            _draw(axes, trajectories[chosen], passed[chosen], bins)
    return figure


def _alike(trajectories: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The three of these rows that are nearest to one that is as long as most are."""
    length = np.linalg.norm(np.diff(trajectories[rows], axis=1), axis=2).sum(axis=1)
    middle = rows[np.argsort(length, kind="stable")[len(rows) // 2]]
    distance = ((trajectories[rows] - trajectories[middle]) ** 2).sum(axis=(1, 2))
    return rows[np.argsort(distance, kind="stable")[:_TRAJECTORIES]]


def _different(passed: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Three of these rows, each the one that adds the most squares to those before."""
    chosen: list[int] = []
    seen: set[int] = set()
    for _ in range(min(_TRAJECTORIES, len(rows))):
        best = max((row for row in rows if row not in chosen), key=lambda row: len(set(passed[row].tolist()) - seen))
        chosen.append(int(best))
        seen |= set(passed[best].tolist())
    return np.array(chosen)


def _draw(axes: Axes, trajectories: np.ndarray, passed: np.ndarray, bins: int) -> None:
    side = 2 / bins
    filled = np.unique(passed)
    for square in filled:
        x, y = divmod(int(square), bins)
        color = _END if square == passed[0, -1] else _PASSED
        axes.add_patch(Rectangle((-1 + x * side, -1 + y * side), side, side, color=color, linewidth=0))
    for color, trajectory in zip(_LINES, trajectories, strict=False):
        axes.plot(*trajectory.T, color=color, linewidth=1.3, marker="o", markersize=1.8)
    ticks = np.linspace(-1, 1, bins + 1)
    axes.set(xlim=(-1, 1), ylim=(-1, 1), xticks=ticks, yticks=ticks, aspect="equal")
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(True)
    axes.tick_params(labelbottom=False, labelleft=False, length=0)
    axes.set_title(f"{len(filled)} of {bins**2} squares: adds {len(filled) / bins**2:.2f}")
