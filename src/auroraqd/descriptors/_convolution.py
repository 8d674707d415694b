"""Convolution and pooling of `networks.Convolutional` in use: compiled loops over rows, which do as the layers of the same name
in `auroraqd.descriptors.layers`.

A batch is some hundred rows of a hundred numbers, described in each generation. Products of matrices, by which training does
it, would first copy what they read, and take up to twice as long.
"""

import numpy as np

from auroraqd._compiled import compiled
from auroraqd.descriptors.layers import BEFORE, KERNEL, LEAK, Convolution, MaxPooling

_STEPS = KERNEL[0]


class Convolved:
    """A `Convolution` of rows of float64."""

    def __init__(self, layer: Convolution) -> None:
        self._kernel, self._bias = (np.ascontiguousarray(weight, np.float64) for weight in (layer.kernel, layer.bias))
        self._shape = layer.shape

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(n, steps * maps in * channels) to (n, steps * maps out * channels)."""
        (steps, channels), (maps_in, maps_out, _) = self._shape, self._kernel.shape
        out = np.empty((len(x), steps, maps_out, channels))
        _convolve(x.reshape(-1, steps, maps_in, channels), self._kernel, self._bias, out)
        return out.reshape(len(x), steps * maps_out * channels)


class Pooled:
    """A `MaxPooling` of rows of float64."""

    def __init__(self, layer: MaxPooling) -> None:
        self._shape, self._maps = layer.shape, layer.maps

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(n, steps * maps * channels) to (n, maps * steps * channels)."""
        steps, channels = self._shape
        out = np.empty((len(x), self._maps, steps, channels))
        _pool(x.reshape(-1, steps, self._maps, channels), out)
        return out.reshape(x.shape)


@compiled(nogil=True, fastmath={"contract"})
def _convolve(x, kernel, bias, out):
    """Fill out, (n, steps, maps out, channels), from x, (n, steps, maps in, channels).

    With a zero after the last channel of each step, the entries that a tap of the kernel reads lie in one piece.
    """
    n, steps, maps_in, channels = x.shape
    width = channels + 1
    size = steps * width
    padded = np.zeros((maps_in, (steps + _STEPS - 1) * width + 1))
    total = np.empty(size)
    for row in range(n):
        for m in range(maps_in):
            for s in range(steps):
                for c in range(channels):
                    padded[m, (s + BEFORE) * width + c] = x[row, s, m, c]
        for o in range(out.shape[2]):
            total[:] = bias[o]
            for m in range(maps_in):
                for s in range(_STEPS):
                    here, beside = kernel[m, o, 2 * s], kernel[m, o, 2 * s + 1]
                    read = padded[m, s * width : s * width + size + 1]
                    for i in range(size):
                        total[i] += here * read[i] + beside * read[i + 1]
            for s in range(steps):
                for c in range(channels):
                    value = total[s * width + c]
                    out[row, s, o, c] = max(value, LEAK * value)


@compiled(nogil=True)
def _pool(x, out):
    """Fill out, (n, maps, steps, channels), from x, (n, steps, maps, channels)."""
    n, steps, maps, channels = x.shape
    for row in range(n):
        for m in range(maps):
            for s in range(steps):
                following = min(s + 1, steps - 1)
                for c in range(channels):
                    beside = min(c + 1, channels - 1)
                    here = max(x[row, s, m, c], x[row, s, m, beside])
                    there = max(x[row, following, m, c], x[row, following, m, beside])
                    out[row, m, s, c] = max(here, there)
