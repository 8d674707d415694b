"""What arguments must be, and how to say what came: one sentence with the argument's name, what was wanted and what came."""

import reprlib
from typing import Any

import numpy as np


def whole(name: str, value: Any, *, least: int = 1, most: int | None = None) -> int:
    """The value as an int.

    Raises:
        ValueError: it is no whole number, or out of range.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, int | np.integer)
        or value < least
        or (most is not None and value > most)
    ):
        limit = f"{least} or more" if most is None else f"from {least} to {most}"
        raise ValueError(f"{name} must be a whole number, {limit}, got {value!r}")
    return int(value)


def number(name: str, value: Any, *, least: float = 0.0, most: float = np.inf, wanted: str = "0 or more") -> float:
    """The value as a float: finite, at least `least`, at most `most`.

    Raises:
        ValueError: it is no number, or out of range.
    """
    numeric = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not (numeric and least <= value <= most and abs(value) < np.inf):
        raise ValueError(f"{name} must be a finite number, {wanted}, got {value!r}")
    return float(value)


def numbers(name: str, values: Any, shape: str = "") -> np.ndarray:
    """An array of float64.

    Args:
        name: of the argument.
        values: what came.
        shape: that is wanted, for the message: " of shape (n,)".

    Raises:
        ValueError: they are no numbers, or not rows of one shape. None is no number, and not NaN.
    """
    return numeric(name, values, shape).astype(np.float64, copy=False)


def numeric(name: str, values: Any, shape: str = "") -> np.ndarray:
    """As `numbers`, of the dtype that they have, if it is one of numbers."""
    try:
        array = np.asarray(values)
        if array.dtype.kind in "biuf":
            return array
        if array.dtype.kind != "O" or any(entry is None or isinstance(entry, str | bytes) for entry in array.flat):
            raise TypeError
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numbers{shape}, got {reprlib.repr(values)}") from None


def whole_numbers(name: str, values: Any) -> np.ndarray:
    """The values as an array of int64.

    Raises:
        ValueError: they are no whole numbers, or not rows of one shape.
    """
    try:
        array = np.asarray(values)
    except ValueError:
        raise ValueError(f"{name} must be an array of whole numbers") from None
    if array.dtype.kind not in "iu" and array.size:
        raise ValueError(f"{name} must be whole numbers, got {array.dtype}")
    return array.astype(np.int64, copy=False)


def seeds_for(name: str, seeds: Any, n: int) -> np.ndarray:
    """Seeds, one for each of n individuals, (n,) whole numbers.

    Raises:
        ValueError: they are something else.
    """
    if not isinstance(seeds, np.ndarray):
        # Of whole numbers on both sides of 2**63, NumPy would make floats.
        seeds = np.asarray(list(seeds) if np.iterable(seeds) else seeds, object)
    if seeds.shape != (n,):
        came = f"shape {seeds.shape}" if seeds.ndim else reprlib.repr(seeds[()])
        raise ValueError(f"{name} must have shape ({n},), got {came}")
    if seeds.dtype.kind in "iu":
        return seeds
    wrong = [seed for seed in seeds.tolist() if not isinstance(seed, int | np.integer) or isinstance(seed, bool)]
    if wrong:
        raise ValueError(f"{name} must be whole numbers, got {type(wrong[0]).__name__} {wrong[0]!r}")
    return seeds  # Python's own are of any size


def rows_of(shape: tuple[int, ...]) -> str:
    """The shape of rows, for messages: "(n, 50, 2)"."""
    return f"({', '.join(map(str, ('n', *shape)))}{'' if shape else ','})"


def in_short(columns: Any) -> str:
    """A named tuple of arrays by their shapes, or values where there are few."""
    texts = [
        f"{name}={value}" if value is None or np.size(value) <= 10 else f"{name}: {value.dtype} {value.shape}"
        for name, value in zip(columns._fields, columns, strict=True)
    ]
    return f"{type(columns).__name__}({', '.join(texts)})"


def finite_rows(rows: np.ndarray) -> np.ndarray:
    """(n,) bool: which rows of (n, ...) hold neither a NaN nor an infinity."""
    if rows.dtype.kind != "f":
        return np.ones(len(rows), bool)
    finite = np.isfinite(rows)
    if rows.ndim == 1:
        return finite
    if finite.all():  # the common case, at once instead of row by row
        return np.ones(len(rows), bool)
    return np.asarray(finite.reshape(len(rows), -1).all(axis=1))
