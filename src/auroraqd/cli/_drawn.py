"""Numbers as characters: a line of small bars, and a map of places, for a terminal."""

from collections.abc import Sequence
from typing import Any

import numpy as np

_BARS, _PLAIN_BARS = "▁▂▃▄▅▆▇█", "_.-=+*%#"
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # of a Braille pattern, from its top left
_BRAILLE = 0x2800
_SHADES = " .:+*#"


def sparkline(values: Sequence[float], width: int, *, plain: bool = False) -> str:
    """A bar for each of as many values as there is width, from the least to the most; where there is none, a space.

    Args:
        values: over time; of more than there is width, the last of each stretch.
        width: characters, at most.
        plain: whether to use ASCII alone.
    """
    bars, numbers = _PLAIN_BARS if plain else _BARS, np.array(values, np.float64)
    if len(numbers) > width:
        numbers = numbers[np.linspace(0, len(numbers) - 1, width).round().astype(int)]
    finite = numbers[np.isfinite(numbers)]
    if not len(finite):
        return " " * len(numbers)
    half = finite.min() / 2, finite.max() / 2  # halves, so that the range of the largest numbers is finite
    share = (numbers / 2 - half[0]) / (half[1] - half[0] or 1)
    return "".join(bars[int(part * (len(bars) - 1) + 0.5)] if part == part and abs(part) <= 1 else " " for part in share)


def character_map(places: Any, width: int, height: int, *, plain: bool = False) -> list[str]:
    """Lines in which there are dots where there are places; the upper end of the second axis is at the top.

    Args:
        places: (n, 2); those that are not finite are left out.
        width, height: characters.
        plain: whether to use ASCII alone: then a denser character stands for more places.
    """
    rows, columns = (1, 1) if plain else (4, 2)
    counts = _counts(np.asarray(places, np.float64), height * rows, width * columns)
    if plain:
        level = np.ceil(np.log1p(counts) / max(np.log1p(counts.max()), 1e-9) * (len(_SHADES) - 1)).astype(int)
        return ["".join(_SHADES[k] for k in line) for line in level]
    blocks = (counts > 0).reshape(height, rows, width, columns)
    codes = _BRAILLE + (blocks * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(code) for code in line) for line in codes]


def _counts(places: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """How many places are in each cell of a grid over them, (rows, columns), from the top."""
    places = places[np.isfinite(places).all(axis=1)] / 2
    if not len(places):
        return np.zeros((rows, columns), np.int64)
    low, extent = places.min(axis=0), np.ptp(places, axis=0)
    share = (places - low) / np.where(extent > 0, extent, 1)
    x, y = (np.minimum((share * (columns, rows)).astype(int), (columns - 1, rows - 1))).T
    counts = np.zeros((rows, columns), np.int64)
    np.add.at(counts, (rows - 1 - y, x), 1)
    return counts
