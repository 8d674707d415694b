"""Colours of places: two dimensions at once, which the colour-blind tell apart too."""

import numpy as np

# Across from blue over rose to orange, which is blue to yellow for most of the colour-blind; up from dark to light.
_DARK = np.array([[32, 62, 158], [138, 40, 120], [176, 74, 6]])
_LIGHT = np.array([[118, 190, 250], [240, 140, 190], [250, 208, 66]])
_UNKNOWN = 128


def place_colours(places: np.ndarray, box: np.ndarray | None = None) -> np.ndarray:
    """Colours by the place, (n, 2) to (n,) uint32 as Bokeh takes them: red, green, blue, opacity. NaN is grey.

    Args:
        places: of which the ends of the colours are the ends.
        box: others, (m, 2), whose ends are taken instead.
    """
    colours = np.full((len(places), 3), float(_UNKNOWN))
    finite = np.isfinite(places).all(axis=1)
    around = places if box is None else box
    around = around[np.isfinite(around).all(axis=1)].astype(np.float64)
    if finite.any() and len(around):
        low, extent = around.min(axis=0), np.ptp(around, axis=0)
        x, y = np.clip((places[finite].astype(np.float64) - low) / np.where(extent > 0, extent, 1), 0, 1).T
        low, high = (_across(x, row) for row in (_DARK, _LIGHT))
        colours[finite] = (1 - y[:, None]) * low + y[:, None] * high
    red, green, blue = np.round(colours).astype(np.uint32).T
    return red << 24 | green << 16 | blue << 8 | np.uint32(255)


def _across(x: np.ndarray, row: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(x, np.linspace(0, 1, len(row)), channel) for channel in row.T], axis=1)
