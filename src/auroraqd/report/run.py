"""The figures of one run, in the manner of the paper (Fig. "Ballistic task").

An individual has one colour in all panels, given by its place in ground-truth space, so that places correspond.
"""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from auroraqd._checks import instance
from auroraqd._files import folder_at
from auroraqd.history import Record
from auroraqd.repertoire import Repertoire
from auroraqd.report.scenes import scene_of, trajectories_of
from auroraqd.report.skills import SHEET, skills_figure
from auroraqd.report.style import STYLE, Picture, save_figure, scatter, trajectories, two_dimensional_colors
from auroraqd.runs import folders

_MOST_TRAJECTORIES = 600


def write_figures(folder: str | Path) -> list[Path]:
    """Draw the figures of a run folder into `folder/figures`, as PNG and SVG; returns the files.

    Raises:
        FileNotFoundError, ValueError: see `auroraqd.load`.
        OSError: they cannot be written.

    Warns:
        UserWarning: a figure could not be drawn, and is left out.
    """
    repertoire, records = folders.load(folder), folders.load_history(folder)
    config = folders.load_config(folder)
    target = folder_at(Path(folder) / folders.FIGURES)
    figures: dict[str, Callable[[], Figure]] = {"history": lambda: history_figure(records)}
    if len(repertoire):
        figures = {"repertoire": lambda: repertoire_figure(repertoire), **figures}
    if len(repertoire) and repertoire.fitness.min() < repertoire.fitness.max():  # a constant one is for pure exploration
        figures["fitness"] = lambda: fitness_figure(repertoire)
    if trajectories_of(repertoire) is not None:
        figures["skills"] = lambda: skills_figure(repertoire, scene_of(config, repertoire), repertoire.sample(SHEET))
    return [path for name, draw in figures.items() for path in _drawn(name, draw, target)]


def _drawn(name: str, draw: Callable[[], Figure], target: Path) -> list[Path]:
    """The files of a figure; none, and a warning, if it cannot be drawn: numbers may be too large for Matplotlib."""
    try:
        with np.errstate(over="raise", invalid="raise"):
            return save_figure(draw(), target, name)
    except OSError:
        raise
    except Exception as error:
        warnings.warn(f"the figure {name} could not be drawn: {error}", stacklevel=3)
        return []


def repertoire_figure(repertoire: Repertoire) -> Figure:
    """Descriptor space, ground-truth space where there is one, and trajectories where the observations are some.

    Raises:
        ValueError: the repertoire is empty.
    """
    _check_any(repertoire)
    truth = repertoire.ground_truth
    panels = [("Descriptor space", _draw_descriptors)]
    if truth is not None and truth.ndim == 2 and truth.shape[1] >= 2:
        panels.append(("Ground truth", _draw_truth))
        colors, key = two_dimensional_colors(truth[:, :2].astype(np.float64)), "ground truth"
    else:
        colors, key = two_dimensional_colors(_plane(repertoire)), "descriptor space"
    if trajectories_of(repertoire) is not None:
        panels.append(("Trajectories", _draw_trajectories))
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=(4.4 * len(panels), 4.4), layout="constrained")
        separator = "; " if len(panels) > 1 else "\n"  # one panel is not wide enough for a line
        figure.suptitle(f"{len(repertoire):,} individuals{separator}coloured by their place in {key}", fontsize=11)
        for axes, (title, draw) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            axes.set_title(title)
            draw(axes, repertoire, colors)
    return figure


def fitness_figure(repertoire: Repertoire) -> Figure:
    """Fitness over descriptor space, and over ground-truth space where there is one: what each behaviour is worth.

    Raises:
        ValueError: the repertoire is empty.
    """
    _check_any(repertoire)
    truth = repertoire.ground_truth
    panels: list[tuple[str, Any]] = [("Descriptor space", _draw_descriptors)]
    if truth is not None and truth.ndim == 2 and truth.shape[1] >= 2:
        panels.append(("Ground truth", _draw_truth))
    low, high = np.quantile(repertoire.fitness, [0.01, 0.99])  # or one bad individual would take all of the colours
    scale = ScalarMappable(Normalize(low, high if high > low else low + np.ptp(repertoire.fitness)), "viridis")
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=(4.4 * len(panels) + 0.8, 4.4), layout="constrained")
        places = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, (title, draw) in zip(places, panels, strict=True):
            axes.set_title(title)
            draw(axes, repertoire, scale.to_rgba(repertoire.fitness))
        figure.colorbar(scale, ax=list(places), label="fitness", extend="both", shrink=0.8)
    return figure


def history_figure(records: Sequence[Record]) -> Figure:
    """Repertoire size, l and reconstruction error over generations; what a run does not have is left out."""
    labels = {
        "size": "individuals stored (fewer after an update)",
        "l": "distance threshold l",
        "rmse": "reconstruction RMSE, [-1, 1] scale",
        "mean_fitness": "mean fitness",
    }
    for record in instance("records", records, Sequence, "records of a history"):
        instance("records", record, Record, "records of a history")
    generation = np.array([record.generation for record in records])
    columns = {name: np.array([getattr(record, name) for record in records], float) for name in labels}
    columns = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    if not np.ptp(columns.get("mean_fitness", np.zeros(1))):  # a constant fitness, for pure exploration
        columns.pop("mean_fitness", None)
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=(4.4 * max(len(columns), 1), 3.2), layout="constrained")
        panels = figure.subplots(1, max(len(columns), 1), squeeze=False)[0]
        for axes, (name, values) in zip(panels, columns.items(), strict=False):
            axes.plot(generation, values, color="#2646a0", linewidth=1.3)
            axes.set(xlabel="generation", title=labels[name])
            axes.set_xlim(left=0)
            if name != "mean_fitness":
                axes.set_ylim(0, 1.05 * max(np.nanmax(values), 1e-12))
    return figure


def _check_any(repertoire: Repertoire) -> None:
    instance("repertoire", repertoire, Repertoire, "an auroraqd.Repertoire")
    if len(repertoire) == 0:
        raise ValueError("the repertoire is empty, nothing was stored in its run: there is nothing to draw")


def _plane(repertoire: Repertoire) -> np.ndarray:
    """Two coordinates for each individual: the two of its descriptor that vary most, or the only one and the fitness."""
    descriptor = repertoire.descriptor
    if descriptor.shape[1] == 1:
        return np.column_stack([descriptor[:, 0], repertoire.fitness])
    return descriptor[:, _widest(descriptor)]


def _widest(descriptor: np.ndarray) -> np.ndarray:
    """The two dimensions that vary most, in their order."""
    return np.sort(np.argsort(-descriptor.var(axis=0), kind="stable")[:2])


def _draw_descriptors(axes: Axes, repertoire: Repertoire, colors: np.ndarray) -> None:
    scatter(axes, _plane(repertoire), colors)
    d = repertoire.descriptor.shape[1]
    first, second = _widest(repertoire.descriptor) + 1 if d > 1 else (1, 0)
    axes.set(xlabel=f"descriptor {first}", ylabel=f"descriptor {second}" if second else "fitness")
    if d > 2:
        axes.set_title(f"Descriptor space, 2 of {d} dimensions")


def _draw_truth(axes: Axes, repertoire: Repertoire, colors: np.ndarray) -> None:
    assert repertoire.ground_truth is not None
    scatter(axes, repertoire.ground_truth[:, :2], colors)
    axes.set(xlabel="ground truth 1", ylabel="ground truth 2")


def _draw_trajectories(axes: Axes, repertoire: Repertoire, colors: np.ndarray) -> None:
    n = len(repertoire)
    shown = np.random.default_rng(0).permutation(n)[:_MOST_TRAJECTORIES]
    observed = trajectories_of(repertoire)
    assert observed is not None
    paths = observed[shown].astype(np.float64)
    trajectories(axes, paths, colors[shown])
    width, height = np.ptp(paths.reshape(-1, 2), axis=0)
    if 1 / 3 < width / max(height, 1e-300) < 3:  # a wide or a tall picture would be unreadable
        axes.set_aspect("equal")
    axes.set(xlabel="x", ylabel="y")
    if len(shown) < n:
        axes.set_title(f"Trajectories, {len(shown)} of {n:,}")
