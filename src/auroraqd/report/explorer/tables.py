"""Numbers as a page holds them: arrays of few bytes, which the browser gets as they are."""

import base64
from typing import Any

import numpy as np

NARROW = 32
"""Columns, at most, of which all digits of a float32 are kept. Of more, each column has 65,536 steps of its range."""

_PACKED = 2**15  # bytes of an array that is packed, at least
_LARGEST = float(np.finfo(np.float32).max)
_STEPS = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65_535, np.dtype(np.int8): 127}


def table(rows: np.ndarray, dtype: Any = None) -> dict[str, Any]:
    """Rows of numbers, (n, columns), as `values`, (n, columns), and perhaps `low` and `step`, (columns,) each.

    Entry (i, j) is values[i, j], or low[j] + step[j] values[i, j] where these are given.

    Args:
        rows: of numbers.
        dtype: of whole numbers, to round to. By default float32 for few columns, and uint16 for many.
    """
    if dtype is None:
        if rows.shape[1] <= NARROW or not np.isfinite(rows).all():
            return {"values": single(rows)}
        dtype = np.uint16
    dtype = np.dtype(dtype)
    rows = rows.astype(np.float64)
    if dtype.kind == "i":  # around 0
        low = np.zeros(rows.shape[1])
        step = np.abs(rows).max(axis=0, initial=0) / _STEPS[dtype]
    else:
        low = rows.min(axis=0) if len(rows) else np.zeros(rows.shape[1])
        step = (rows.max(axis=0, initial=-np.inf) - low) / _STEPS[dtype] if len(rows) else np.zeros(rows.shape[1])
    values = np.round((rows - low) / np.where(step > 0, step, 1)).astype(dtype)
    return {"values": values, "low": low.tolist(), "step": step.tolist()}


def single(rows: np.ndarray) -> np.ndarray:
    """As float32, which has no larger numbers than 3.4e38."""
    return np.clip(rows, -_LARGEST, _LARGEST).astype(np.float32)


def back(kept: dict[str, Any]) -> np.ndarray:
    """The numbers of a table, (n, columns), as the browser reads them."""
    values = kept["values"].astype(np.float64)
    return values if "low" not in kept else np.array(kept["low"]) + np.array(kept["step"]) * values


def wholes(values: np.ndarray) -> np.ndarray:
    """Whole numbers, (n,), as int32 if they fit, and else as float64: the browser has no longer ones."""
    small = len(values) == 0 or (values.min() >= -(2**31) and values.max() < 2**31)
    return values.astype(np.int32 if small else np.float64)


def packed(value: Any) -> Any:
    """The same, with large arrays as text: {"base64", "dtype", "shape"}, little-endian.

    Bokeh would compress them, which makes those of a run hardly smaller, and the browser slow to begin.
    """
    if isinstance(value, dict):
        return {name: packed(each) for name, each in value.items()}
    if isinstance(value, list):
        return [packed(each) for each in value]
    if not isinstance(value, np.ndarray) or value.nbytes < _PACKED:
        return value
    ordered = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
    return {"base64": base64.b64encode(ordered.tobytes()).decode(), "dtype": value.dtype.name, "shape": list(value.shape)}
