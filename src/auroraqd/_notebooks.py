"""What notebooks show of an object: a table of a few lines, and a small picture beside it. Nothing in it can run."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

from auroraqd.observations import shapes_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from auroraqd.individuals import Individuals

_CELL = "text-align:left;padding:1px 12px 1px 0"


def figure_of(what: str, *given: Any) -> Figure:
    """A figure of `auroraqd.report`, which is above all that it draws, and is imported, with Matplotlib, when one is wanted."""
    return getattr(import_module("auroraqd.report"), what)(*given)


def card(title: str, facts: Mapping[str, object], thumbnail: str, of: Any) -> str:
    """HTML of a table and a picture.

    Args:
        title: of the table.
        facts: by name; those that are None are left out.
        thumbnail: the function of `auroraqd.report.thumbnails` that draws it.
        of: what it draws. Where that cannot be drawn, numbers may be too large for Matplotlib, the table is alone.
    """
    rows = "".join(
        f'<tr><th style="{_CELL}">{escape(name)}</th><td style="{_CELL}">{escape(str(value))}</td></tr>'
        for name, value in facts.items()
        if value is not None
    )
    table = f'<table><tr><th colspan="2" style="{_CELL}">{escape(title)}</th></tr>{rows}</table>'
    return f'<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:center">{table}{_image(thumbnail, of)}</div>'


def _image(thumbnail: str, of: Any) -> str:
    try:
        png = getattr(import_module("auroraqd.report.thumbnails"), thumbnail)(of)
    except Exception:  # of Matplotlib or of numbers: what is known is shown without
        return ""
    return "" if png is None else f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def facts_of(individuals: Individuals) -> dict[str, object]:
    """What there is to say of stored individuals."""
    n, fitness, l = len(individuals), individuals.fitness, getattr(individuals, "l", None)  # of an archive
    threshold = None if l is None or l != l else f"{l:.4g}"
    if n == 0:
        return {"l": threshold, "individuals": 0}
    truth = individuals.ground_truth
    return {
        "l": threshold,
        "individuals": f"{n:,}",
        "genotype": individuals.genotype.shape[1:],
        "observation": shapes_of(individuals.observation),
        "descriptor": individuals.descriptor.shape[1:],
        "ground truth": None if truth is None else truth.shape[1:],
        "fitness": f"mean {fitness.mean():.4g}, highest {fitness.max():.4g}" if fitness.min() < fitness.max() else None,
    }
