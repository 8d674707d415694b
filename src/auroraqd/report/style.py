"""What all figures have in common: their look, their colours, how they are written."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from auroraqd._files import replacing

_CORNERS = np.array([[[38, 70, 160], [0, 160, 135]], [[200, 40, 120], [245, 180, 30]]]) / 255  # [x, y] of the unit square
_DPI = 150
STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "font.size": 9,
    "svg.fonttype": "none",
    "svg.hashsalt": "auroraqd",  # or the same run would give another file each time
}


class Picture(Figure):
    """A figure that notebooks show, also where pyplot was never imported."""

    def _repr_png_(self) -> bytes:
        return png_of(self, self.dpi)


def png_of(figure: Figure, dpi: float) -> bytes:
    """A figure as PNG."""
    before, content = (figure.dpi, figure.canvas), io.BytesIO()
    figure.dpi = dpi
    try:
        with mpl.rc_context(STYLE):
            FigureCanvasAgg(figure).print_png(content)
    finally:
        figure.dpi, canvas = before
        figure.set_canvas(canvas)
    return content.getvalue()


def save_figure(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG and as SVG; returns the files.

    Raises:
        OSError: they cannot be written.
    """
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    before = figure.dpi, figure.canvas, figure.get_layout_engine()
    figure.dpi = _DPI
    try:
        # By the canvas itself: `Figure.savefig` draws twice, and lays out each time, which takes as long as drawing.
        with mpl.rc_context(STYLE):
            with replacing(png) as file:
                FigureCanvasAgg(figure).print_png(file, pil_kwargs={"compress_level": 4})  # as small as 6 makes it, and sooner
            figure.set_layout_engine("none")
            with replacing(svg) as file:
                FigureCanvasSVG(figure).print_svg(file, metadata={"Date": None})
    finally:
        dpi, canvas, engine = before
        figure.dpi = dpi
        figure.set_canvas(canvas)
        figure.set_layout_engine(engine if engine is not None else "none")
    return [png, svg]


def two_dimensional_colors(places: np.ndarray, box: np.ndarray | None = None) -> np.ndarray:
    """A colour for each place, (n, 2) to (n, 3): four corners, blended, over the box of the places or of others, (m, 2)."""
    box = places if box is None else box
    low, extent = box.min(axis=0), np.ptp(box, axis=0)
    x, y = ((places - low) / np.where(extent > 0, extent, 1)).T[..., None]
    bottom = (1 - x) * _CORNERS[0, 0] + x * _CORNERS[1, 0]
    top = (1 - x) * _CORNERS[0, 1] + x * _CORNERS[1, 1]
    return np.clip((1 - y) * bottom + y * top, 0, 1)


def scatter(axes: Axes, places: np.ndarray, colors: np.ndarray) -> None:
    """Places, (n, 2), as points that are the smaller the more they are."""
    size = np.clip(20_000 / len(places), 1.5, 30)
    axes.scatter(*places.T, s=size, c=colors, linewidths=0, rasterized=True)


def trajectories(axes: Axes, paths: np.ndarray, colors: np.ndarray) -> None:
    """Trajectories, (n, steps, 2), as thin lines."""
    lines = LineCollection(list(paths), colors=list(colors), linewidths=0.5, alpha=0.6, rasterized=True)
    axes.add_collection(lines)
    axes.autoscale()
