"""What the learned descriptor imagines, as something that a browser can compute: an affine map, or a grid of samples."""

from collections.abc import Callable
from typing import Any

import numpy as np

from auroraqd.report.explorer.tables import single, table

_SIDE = {1: 256, 2: 40}  # of the grid, by dimensions
_TRIED = 64  # places at which a map is compared with an affine one
_MARGIN = 0.05  # of the range of descriptors, on either side
_EXACT = 1e-5  # of the range of what is decoded

Decode = Callable[[np.ndarray], np.ndarray]
"""From places, (n, d), to what is seen there, (n, features)."""


def decoder(decode: Decode, descriptor: np.ndarray) -> dict[str, Any] | None:
    """A decoder of places in descriptor space for the browser; None where there is none: it is neither affine nor of a plane.

    Args:
        decode: of the learned descriptor.
        descriptor: (n, d), of all skills, at least one.
    """
    return _affine(decode, descriptor) or _grid(decode, descriptor)


def _affine(decode: Decode, descriptor: np.ndarray) -> dict[str, Any] | None:
    """Its value at the middle, and its slopes, if that is all."""
    d = descriptor.shape[1]
    low, extent = _box(descriptor)
    middle = low + extent / 2
    ends = decode(np.vstack([middle, middle + np.diag(extent)]))
    slopes = (ends[1:] - ends[0]) / extent[:, None]
    places = low + extent * np.random.default_rng(0).random((_TRIED, d))
    there = decode(places)
    if np.abs(there - ends[0] - (places - middle) @ slopes).max() > _EXACT * max(np.ptp(there), 1e-300):
        return None
    return {"kind": "affine", "middle": middle.tolist(), "matrix": single(np.vstack([ends[:1], slopes]))}


def _grid(decode: Decode, descriptor: np.ndarray) -> dict[str, Any] | None:
    d = descriptor.shape[1]
    if d not in _SIDE:
        return None
    low, extent = _box(descriptor)
    sides = [
        np.linspace(at - _MARGIN * size, at + (1 + _MARGIN) * size, _SIDE[d]) for at, size in zip(low, extent, strict=True)
    ]
    places = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, d)
    return {
        "kind": "grid",
        "low": [side[0] for side in sides],
        "high": [side[-1] for side in sides],
        "side": _SIDE[d],
        "table": table(decode(places), np.uint16),
    }


def _box(descriptor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    extent = np.ptp(descriptor, axis=0)
    return descriptor.min(axis=0), np.where(extent > 0, extent, 1.0)
