"""The repertoires of several variants beside each other (paper, Figs. "Ballistic task" and "Air hockey task")."""

import textwrap
from collections.abc import Mapping
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from auroraqd.experiments.variants import Experiment
from auroraqd.repertoire import Repertoire
from auroraqd.report.style import STYLE, scatter, trajectories, two_dimensional_colors

_TRAJECTORIES = 400  # in a panel


class _Column(NamedTuple):
    """A variant."""

    repertoire: Repertoire
    colors: np.ndarray
    shown: np.ndarray  # rows, where all would be too many
    limits: tuple[np.ndarray, np.ndarray]  # of the ground truth of all variants


def panel_figure(repertoires: Mapping[str, Repertoire], experiment: Experiment) -> Figure:
    """For each variant, its descriptor space above and ground-truth space below; without a reference, trajectories between.

    An individual has one colour in all panels of its variant. Where ground truths are compared, it is that of its place among
    them; where there is no reference, that of its place in descriptor space, if this has two dimensions (as in the paper).

    Args:
        repertoires: by title, each with a ground truth of two columns.
        experiment: they are from.
    """
    truths = np.concatenate([_truth(repertoire) for repertoire in repertoires.values()])
    limits = truths.min(axis=0), truths.max(axis=0)
    rows = {"descriptor space": _descriptors, experiment.truth: _truths}
    if experiment.reference is None:
        between = {"trajectories": _trajectories, "reconstructed": _reconstructions}
        rows = {"descriptor space": _descriptors, **between, experiment.truth: _truths}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.9 * len(repertoires), 0.6 + 1.9 * len(rows)), layout="constrained")
        panels = figure.subplots(len(rows), len(repertoires), squeeze=False)
        for (title, repertoire), column in zip(repertoires.items(), panels.T, strict=True):
            plane = repertoire.descriptor.shape[1] == 2
            by_truth = experiment.reference is not None or not plane
            colors = (
                two_dimensional_colors(_truth(repertoire), truths)
                if by_truth
                else two_dimensional_colors(repertoire.descriptor)
            )
            shown = np.random.default_rng(0).permutation(len(repertoire))[:_TRAJECTORIES]
            for axes, draw in zip(column, rows.values(), strict=True):
                axes.set(xticks=[], yticks=[])
                draw(axes, _Column(repertoire, colors, shown, limits))
            column[0].set_title("\n".join(textwrap.wrap(title, 16)), fontsize=8)
            column[-1].set_xlabel(f"{len(repertoire):,} individuals")
        for axes, name in zip(panels[:, 0], rows, strict=True):
            axes.set_ylabel(name)
    return figure


def _truth(repertoire: Repertoire) -> np.ndarray:
    assert repertoire.ground_truth is not None  # all tasks of experiments have one
    return repertoire.ground_truth


def _descriptors(axes: Axes, column: _Column) -> None:
    descriptor = column.repertoire.descriptor
    if descriptor.shape[1] == 2:
        scatter(axes, descriptor, column.colors)
    else:
        _say(axes, f"{descriptor.shape[1]} dimensions")


def _truths(axes: Axes, column: _Column) -> None:
    scatter(axes, _truth(column.repertoire), column.colors)
    _same_box(axes, *column.limits)


def _trajectories(axes: Axes, column: _Column) -> None:
    trajectories(axes, column.repertoire.observation[column.shown], column.colors[column.shown])
    _same_box(axes, *column.limits)


def _reconstructions(axes: Axes, column: _Column) -> None:
    try:
        found = column.repertoire.reconstruct(column.repertoire.descriptor[column.shown])
    except RuntimeError:
        _say(axes, "none: the descriptor\nis not learned")
        return
    trajectories(axes, found, column.colors[column.shown])
    _same_box(axes, *column.limits)


def _say(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, color="gray")


def _same_box(axes: Axes, low: np.ndarray, high: np.ndarray) -> None:
    margin = 0.03 * (high - low)
    axes.set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]))
