"""Scaling: each channel of an observation from its range to [-1, 1], which is what learned descriptors read."""

from typing import NamedTuple

import numpy as np


class Scaling(NamedTuple):
    """Each channel (last axis) of an observation from its range to [-1, 1]; a constant channel to 0.

    Attributes:
        low, high: (channels,) float64.
    """

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, observation: np.ndarray) -> "Scaling":
        """The range of each channel of (n, ..., channels)."""
        channels = observation.reshape(-1, observation.shape[-1] if observation.ndim > 1 else 1)
        return cls(channels.min(axis=0).astype(np.float64), channels.max(axis=0).astype(np.float64))

    def scaler(self, features: int) -> "Scaler":
        """What scales observations of this many features in all."""
        half = self.high / 2 - self.low / 2
        half = np.where(half > np.finfo(np.float64).tiny, half, 1.0)
        repeats = features // len(half)
        return Scaler(np.tile(self.high / 2 + self.low / 2, repeats), np.tile(1 / half, repeats), np.tile(half, repeats))


class Scaler(NamedTuple):
    """(n, ...) observations to (n, features) float64, scaled. One entry a feature, not a channel: it is faster."""

    center: np.ndarray
    factor: np.ndarray
    half: np.ndarray

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        flat = observation.reshape(len(observation), len(self.center)) - self.center
        flat *= self.factor
        return flat

    def inverse(self, x: np.ndarray) -> np.ndarray:
        """(n, features), scaled, back to the units of the observations."""
        return x * self.half + self.center
