"""Small pictures, for notebooks: skills as points, and how many there were over time."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from auroraqd.history import History
from auroraqd.individuals import Individuals
from auroraqd.report.style import STYLE, png_of, scatter, two_dimensional_colors

_INCHES, _DPI = (2.4, 2.1), 100


def individuals(of: Individuals) -> bytes | None:
    """PNG of individuals in the ground truth, or, where there is none of two dimensions, in descriptor space; None of none."""
    if len(of) == 0:
        return None
    truth, descriptor = of.ground_truth, of.descriptor
    if truth is not None and truth.ndim == 2 and truth.shape[1] >= 2:
        places, name = truth[:, :2], "ground truth"
    elif descriptor.shape[1] == 1:
        places, name = np.column_stack([descriptor[:, 0], of.fitness]), "descriptor, fitness"
    else:
        places, name = descriptor[:, np.sort(np.argsort(-descriptor.var(axis=0), kind="stable")[:2])], "descriptor space"
    places = places[np.isfinite(places).all(axis=1)].astype(np.float64)
    figure, axes = _figure(name)
    scatter(axes, places, two_dimensional_colors(places))
    return png_of(figure, _DPI)


def history(of: History) -> bytes | None:
    """PNG of the individuals stored over the generations; None before the first."""
    if len(of) == 0:
        return None
    figure, axes = _figure("individuals stored")
    axes.plot(of.column("generation"), of.column("size"), color="#2646a0", linewidth=1.3)
    axes.set_ylim(0)
    return png_of(figure, _DPI)


def _figure(title: str) -> tuple[Figure, Axes]:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=_INCHES, layout="constrained")
        axes = figure.subplots()
    axes.set_title(title, fontsize=8)
    axes.tick_params(labelsize=7)
    return figure, axes
