"""Several runs beside each other: in one space of ground truth, with what their skills are worth as numbers."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from auroraqd import metrics
from auroraqd.repertoire import Repertoire

_BINS = 30
_MOST_DIMENSIONS = 3  # of a space that a repertoire can cover


def table(names: Sequence[str], repertoires: Sequence[Repertoire]) -> list[list[str]]:
    """A line a run, the first line says what is in the columns. All have a ground truth, of one shape."""
    truths = [_flat(repertoire.ground_truth) for repertoire in repertoires]
    everywhere = np.concatenate(truths)
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    columns: dict[str, list[str]] = {"run": list(names), "skills": [f"{len(repertoire):,}" for repertoire in repertoires]}
    if low.size <= _MOST_DIMENSIONS and (high > low).all():
        cells = " x ".join([str(_BINS)] * low.size)
        columns[f"coverage of {cells} cells"] = [f"{metrics.coverage(truth, _BINS, low, high):.1%}" for truth in truths]
    fitness = [repertoire.fitness for repertoire in repertoires]
    if any(np.ptp(values) > 0 for values in fitness):
        columns["mean fitness"] = [f"{values.mean():.4g}" for values in fitness]
        columns["highest"] = [f"{values.max():.4g}" for values in fitness]
    for name, form in (("evaluations", "{:,}"), ("rmse", "{:.4f}"), ("seconds", "{:.1f}")):
        found = [_last(repertoire, name) for repertoire in repertoires]
        if any(value is not None for value in found):
            columns[name.replace("rmse", "RMSE")] = ["" if value is None else form.format(value) for value in found]
    return [list(columns), *map(list, zip(*columns.values(), strict=True))]


def _flat(truth: Any) -> np.ndarray:
    """(n, columns) float64, the rows that are finite."""
    rows = np.asarray(truth, np.float64).reshape(len(truth), -1)
    return rows[np.isfinite(rows).all(axis=1)]


def _last(repertoire: Repertoire, name: str) -> float | None:
    """What the history says at the end, if there is one."""
    with suppress(OSError, ValueError):
        value = getattr(repertoire.history.last, name, None)
        return None if value is None or value != value else value
    return None


def box(runs: Sequence[Mapping[str, Any]], space: str) -> list[tuple[float, float]]:
    """What two axes show of all runs, as they are shown first: from and to, each."""
    ends = []
    for axis in range(2):
        found = np.concatenate(
            [run["spaces"][space]["table"]["values"][:, axis] for run in runs if _wide(run, space) > axis] or [[0.0]]
        )
        found = found[np.isfinite(found)]
        low, high = (float(found.min()), float(found.max())) if len(found) else (0.0, 0.0)
        margin = 0.05 * (high - low) or 1.0
        ends.append((low - margin, high + margin))
    return ends


def _wide(run: Mapping[str, Any], space: str) -> int:
    return run["spaces"][space]["table"]["values"].shape[1]
