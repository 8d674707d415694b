"""Affine descriptors, PCA above all, as two matrices: what Aurora asks of a descriptor in one pass over the observations.

A call of a scikit-learn pipeline costs as much as everything else in a generation, and so does storing the scaled and the
reconstructed observations of a batch, which nobody reads. Each row is computed on its own, so the same observation has the
same descriptor, to the last bit, in any batch.
"""

from typing import Any, NamedTuple

import numpy as np

from auroraqd._compiled import compiled
from auroraqd.descriptors.scaling import Scaler


class Affine(NamedTuple):
    """From observations, flattened to (n, features), to descriptors, (n, d), and back to scaled observations.

    Attributes:
        center, factor, limit: (features,) each, of the scaling to [-1, 1], and how far outside anything may lie.
        weight, offset: (d, features) and (d,): a scaled observation to its descriptor.
        back, back_offset: (d, features) and (features,): a descriptor to the scaled observation expected there.
    """

    center: np.ndarray
    factor: np.ndarray
    limit: np.ndarray
    weight: np.ndarray
    offset: np.ndarray
    back: np.ndarray
    back_offset: np.ndarray

    @classmethod
    def of(cls, scaler: Scaler, encode: Any, decode: Any) -> "Affine":
        """Two affine functions, from scaled observations, (n, features), and back, as matrices."""
        weight, offset = _matrix(encode, len(scaler.center))
        scaling = scaler.center, scaler.factor, scaler.limit
        return cls(*scaling, np.ascontiguousarray(weight.T), offset, *_matrix(decode, len(offset)))

    def describe(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Descriptors, (n, d), and the root mean square errors of their reconstructions, (n,), on the scale [-1, 1]."""
        observation = np.ascontiguousarray(observation, np.float64)[:]
        observation.flags.writeable = False  # a column of an archive is not either: one kernel for both
        z, error = np.empty((len(observation), len(self.offset))), np.empty(len(observation))
        _describe(observation, *self, z, error)
        return z, error

    def reconstruct(self, z: np.ndarray) -> np.ndarray:
        """Scaled observations, (n, features), expected at descriptors, (n, d)."""
        return z @ self.back + self.back_offset


def _matrix(function: Any, n: int) -> tuple[np.ndarray, np.ndarray]:
    """An affine function of (rows, n) as `x @ weight + offset`."""
    values = np.asarray(function(np.vstack([np.zeros(n), np.eye(n)])), np.float64)
    return np.ascontiguousarray(values[1:] - values[0]), values[0]


@compiled(nogil=True, fastmath={"reassoc", "contract"})
def _describe(observation, center, factor, limit, weight, offset, back, back_offset, z, error):
    """Fill z, (n, d), and error, (n,); see `Affine`."""
    features = observation.shape[1]
    row = np.empty(features)
    for i in range(observation.shape[0]):
        for j in range(features):
            row[j] = min(max((observation[i, j] - center[j]) * factor[j], -limit[j]), limit[j])
        for c in range(weight.shape[0]):
            total = 0.0
            for j in range(features):
                total += row[j] * weight[c, j]
            z[i, c] = total + offset[c]
        for j in range(features):
            row[j] -= back_offset[j]
        for c in range(weight.shape[0]):
            value = z[i, c]
            for j in range(features):
                row[j] -= value * back[c, j]
        total = 0.0
        for j in range(features):
            total += row[j] * row[j]
        error[i] = np.sqrt(total / features)
