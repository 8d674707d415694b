"""The figures of a page, as models of Bokeh: empty where the browser fills them.

Bokeh is an extra, and imported by whoever imports this.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import MouseMove, Tap
from bokeh.models import BoxSelectTool, ColorBar, ColumnDataSource, CustomJS, LassoSelectTool, LinearColorMapper, Plot, Range1d
from bokeh.palettes import Cividis256
from bokeh.plotting import figure

from auroraqd.report.explorer.compared import box
from auroraqd.report.explorer.tables import packed

_BACKED_OFF = 0.1  # opacity of skills beside those that are selected
PALETTE = tuple(Cividis256)
"""Of numbers: it reads the same to the colour-blind."""


def document(runs: Sequence[Mapping[str, Any]]) -> tuple[Document, list[dict[str, Any]]]:
    """The document of a page, and its maps, in order: `run`, `space`, and the `figure`.

    Args:
        runs: as `auroraqd.report.explorer.runs.content` has them, with colours by `place`.
    """
    document = Document()
    spaces = ["truth"] if len(runs) > 1 else [space for space in ("descriptor", "truth", "genes") if space in runs[0]["spaces"]]
    maps, colors = [], LinearColorMapper(palette=PALETTE, low=0, high=1, nan_color="#888888")
    sources = [_points(run, spaces) for run in runs]
    then = _empty("color", *(f"{space}_{axis}" for space in spaces for axis in "xy"))
    for number, run in enumerate(runs):
        for space in spaces:
            plot = _map(f"map{len(maps)}", sources[number], space, len(run["rows"]))
            if len(runs) == 1 and run["moments"]:
                _add_then(plot, then, space, max(len(moment["id"]) for moment in run["moments"]))
            maps.append({"run": number, "space": space, "figure": plot})
    if len(runs) > 1:
        x, y = (Range1d(start=low, end=high) for low, high in box(runs, spaces[0]))
        for each in maps:
            each["figure"].x_range, each["figure"].y_range = x, y
    bar = ColorBar(color_mapper=colors, visible=False, height=8, padding=4, background_fill_color=None)
    maps[0]["figure"].add_layout(bar, "below")
    models: dict[str, Any] = {
        "maps": maps,
        "sources": sources,
        "colors": colors,
        "bar": bar,
        "then": then,
        "palette": _numbers(PALETTE),
    }
    models["lines"] = {"skill": _lines("skill"), "set": _lines("set")}
    for plot in [*(each["figure"] for each in maps), *models["lines"].values()]:
        document.add_root(plot)
    data = packed({"runs": list(runs)})
    document.js_on_event("document_ready", CustomJS(args={"models": models, "data": data}, code="explorer.start(models, data)"))
    return document, maps


def _numbers(palette: Sequence[str]) -> np.ndarray:
    return np.array([int(color[1:] + "ff", 16) for color in palette], np.uint32)


def _points(run: Mapping[str, Any], spaces: Sequence[str]) -> ColumnDataSource:
    """The skills of a run, by their place in each space that is shown."""
    places: dict[str, Any] = {"color": run["place"]}
    for space in spaces:
        table, main = run["spaces"][space]["table"], run["spaces"][space]["main"]
        columns = table["values"] if main is None else main
        flat = columns.shape[1] == 1
        places[f"{space}_x"], places[f"{space}_y"] = columns[:, 0], np.zeros(len(columns)) if flat else columns[:, 1]
    return ColumnDataSource(places)


def _empty(*columns: str) -> ColumnDataSource:
    return ColumnDataSource({column: [] for column in columns})


def _plain(name: str, tools: str, **options: Any) -> Any:
    plot = figure(name=name, tools=tools, sizing_mode="stretch_both", min_width=100, min_height=100, **options)
    plot.toolbar.logo = None
    plot.axis.minor_tick_line_color = None
    plot.axis.axis_label_text_font_style = "normal"
    plot.grid.grid_line_alpha = 0.6
    plot.background_fill_color = plot.border_fill_color = plot.outline_line_color = None
    return plot


def _map(name: str, source: ColumnDataSource, space: str, n: int) -> Plot:
    """Skills as points; the page draws what is pointed at above them."""
    plot = _plain(
        name, "pan,wheel_zoom,reset,save", output_backend="webgl", active_scroll="wheel_zoom", toolbar_location="above"
    )
    points = plot.scatter(
        f"{space}_x",
        f"{space}_y",
        source=source,
        size=_size(n),
        line_color=None,
        fill_color="color",
        fill_alpha=0.9,
        nonselection_fill_alpha=_BACKED_OFF,
        nonselection_fill_color="color",
        name="points",
        visible=False,  # until the page is laid out: each step of that would draw them, which takes long without a GPU
    )
    lasso = LassoSelectTool(persistent=False, continuous=False, renderers=[points])
    plot.add_tools(BoxSelectTool(persistent=False, renderers=[points]), lasso)
    plot.toolbar.active_drag = lasso
    for event, function in ((MouseMove, "move"), (Tap, "tap")):
        plot.js_on_event(event, CustomJS(args={"name": name}, code=f"explorer.{function}(name, cb_obj)"))
    return plot


def _size(n: int) -> float:
    """Of n points, in pixels."""
    return float(np.clip(260 / max(n, 1) ** 0.5, 2.5, 9))


def _add_then(plot: Any, source: ColumnDataSource, space: str, n: int) -> None:
    """Skills as they were at another time, in place of those of now."""
    look: dict[str, Any] = {"fill_color": "color", "fill_alpha": 0.9, "line_color": None, "size": _size(n)}
    plot.scatter(f"{space}_x", f"{space}_y", source=source, visible=False, name="then", **look)


def _lines(name: str) -> Plot:
    """Paths or series as lines, and what moves; on the upper canvas, or the axes would be drawn again each time."""
    plot = _plain(f"{name}-lines", "", x_range=Range1d(), y_range=Range1d())
    lines = _empty("xs", "ys", "color", "width", "alpha", "dash")
    plot.multi_line(
        "xs",
        "ys",
        source=lines,
        line_color="color",
        line_width="width",
        line_alpha="alpha",
        line_dash="dash",
        name="lines",
        line_join="round",
        level="overlay",
    )
    plot.scatter(
        "x",
        "y",
        source=_empty("x", "y", "color", "size"),
        size="size",
        color="color",
        line_color=None,
        name="samples",
        level="overlay",
    )
    plot.line("x", "y", source=_empty("x", "y"), line_width=1.5, name="border")
    if name == "skill":
        plot.line("x", "y", source=_empty("x", "y"), level="overlay", line_width=4, line_cap="round", name="arm")
        plot.circle("x", "y", radius="radius", source=_empty("x", "y", "radius"), level="overlay", fill_alpha=0.5, name="body")
    return plot
