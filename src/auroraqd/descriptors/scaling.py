"""Scaling: each channel of an observation from its range to [-1, 1], which is what learned descriptors read.

A range hangs on its two ends, and one simulation that blew up would press all others into a point. `far_outside` finds such
individuals, so that what is learned is learned from the others. What comes later counts as at most ten thousand times as far
out as the range goes: any two that blew up would be new to each other, all would be stored, and their offspring after them,
until an update keeps them and not the others. A robot that at last touches something goes a thousand times as far, if at all.

Of several streams, each is scaled like that, and then so weighted that it counts alike, whatever its width: the mean square of
all entries is the mean over the streams of theirs.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from auroraqd.observations import features_of, has_streams, streams_of

_TYPICAL = 0.99  # share of the individuals that say how large the others may be
_FEWEST = 20  # individuals: of fewer nobody can say which is not like the others
_BLOCK = 2**18  # bytes looked at together, which fit into a cache
_FAR = 10.0  # times as far from the middle as `_TYPICAL` of the individuals
_MOST = 0.75  # share of the individuals that are nearly alike beside others that are
_FARTHEST = 1e4  # times as far: what is, makes all others alike, and later ones do not count as farther


def far_outside(observation: np.ndarray) -> np.ndarray:
    """(n,) bool: observations, (n, ..., channels), with an entry far outside the range of the others, one in a hundred at most.

    Far is ten times as far from the middle, the median over the observations of the middle of their own range, as 99 of 100
    observations get, in one channel. Where 99 of 100 do not leave the middle at all, nothing is far.
    """
    return outlying(observation)[0]


def outlying(observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Observations, (n, ..., channels), that are `far_outside`, (n,) bool; and those that dwarf the others, however many.

    That is ten thousand times as far from the middle as three quarters of the observations get, in one channel.
    """
    if has_streams(observation):
        far, dwarfing = zip(*map(outlying, streams_of(observation).values()), strict=True)
        return np.logical_or.reduce(far), np.logical_or.reduce(dwarfing)
    if len(observation) < _FEWEST or observation.dtype.itemsize == 1:  # pixels have no room for it
        return np.zeros(len(observation), bool), np.zeros(len(observation), bool)
    rows = _by_channel(observation)
    low, high = _by_row(np.minimum, rows).astype(np.float64), _by_row(np.maximum, rows).astype(np.float64)
    middle = 2 * np.median(low / 4 + high / 4, axis=0)
    with np.errstate(over="ignore"):  # at the ends of float64: infinitely far is far
        distance = np.maximum(high - middle, middle - low)
        far, dwarfing = beyond(distance, _FAR), beyond(distance, _FARTHEST, _MOST)
    return np.asarray(far.any(axis=1)), np.asarray(dwarfing.any(axis=1))


def beyond(distance: np.ndarray, times: float, share: float = _TYPICAL) -> np.ndarray:
    """(n, ...) bool: which of n distances are more than so many times as large as a share of them are at most.

    None are where fewer than 20 are known, or where that share is 0.
    """
    if len(distance) < _FEWEST:
        return np.zeros(distance.shape, bool)
    rank = int(share * (len(distance) - 1))  # never the last
    typical = np.partition(distance, rank, axis=0)[rank]
    return (distance > times * typical) & (typical > 0)


def _by_channel(observation: np.ndarray) -> np.ndarray:
    """(n, ..., channels) to (n, entries, channels); (n,) has one channel."""
    return observation.reshape(len(observation), -1, observation.shape[-1] if observation.ndim > 1 else 1)


def _by_row(extreme: np.ufunc, rows: np.ndarray) -> np.ndarray:
    """The least or the largest entry of each row and channel, (n, entries, channels) to (n, channels).

    Halves are laid over each other: `reduce` along the middle axis has loops as short as there are channels, and takes five
    times as long.
    """
    found = np.empty((len(rows), rows.shape[2]), rows.dtype)
    block = max(1, _BLOCK // (rows[:1].nbytes or 1))
    for start in range(0, len(rows), block):
        part = rows[start : start + block]
        while (entries := part.shape[1]) > 1:
            half = entries // 2
            folded = extreme(part[:, :half], part[:, half : 2 * half])
            if entries % 2:
                extreme(folded[:, 0], part[:, -1], out=folded[:, 0])
            part = folded
        found[start : start + block] = part[:, 0]
    return found


class Scaling(NamedTuple):
    """Each channel (last axis) of an observation from its range to [-1, 1]; a constant channel to 0.

    Attributes:
        low, high: (channels,) float64; of streams one for each entry, wider or narrower than its range as the stream counts
            less or more.
        limit: (channels,), how far from 0 an entry may lie when it is scaled; or (1,), of all.
    """

    low: np.ndarray
    high: np.ndarray
    limit: np.ndarray = np.full(1, _FARTHEST)

    @classmethod
    def of(cls, observation: np.ndarray, weights: Mapping[str, float] | None = None) -> "Scaling":
        """The range of each channel of (n, ..., channels), or of each channel of each stream, which may have weights."""
        if has_streams(observation):
            return cls._of_streams(observation, weights or {})
        # Over the individuals first, which is along memory.
        ends = (_by_channel(end[None])[0] for end in (observation.min(axis=0), observation.max(axis=0)))
        low, high = (extreme(end, axis=0).astype(np.float64) for extreme, end in zip((np.min, np.max), ends, strict=True))
        return cls(low, high)

    @classmethod
    def _of_streams(cls, observation: np.ndarray, weights: Mapping[str, float]) -> "Scaling":
        streams = streams_of(observation)
        total = sum(weights.get(name, 1.0) ** 2 for name in streams)
        ends = []
        for name, stream in streams.items():
            width = math.prod(stream.shape[1:])
            factor = weights.get(name, 1.0) * math.sqrt(features_of(observation) / (total * width))
            low, high = (np.tile(end, width // len(end)) for end in cls.of(stream)[:2])
            center, half = high / 2 + low / 2, (high / 2 - low / 2) / factor
            ends.append((center - half, center + half, np.full(width, _FARTHEST * factor)))
        return cls(*(np.nan_to_num(np.concatenate(parts)) for parts in zip(*ends, strict=True)))

    def unlimited(self) -> "Scaling":
        """The same, by which everything lies where it lies."""
        return self._replace(limit=np.full(1, np.inf))

    @classmethod
    def pixels(cls, images: np.ndarray) -> "Scaling":
        """Of images, (n, h, w, channels): from 0 to 255 where they are whole numbers of eight bits, from 0 to 1 where they
        stay within, and otherwise as `of`.
        """
        low, high = np.zeros(images.shape[-1]), np.ones(images.shape[-1])
        if images.dtype == np.uint8:
            return cls(low, 255 * high)
        return cls(low, high) if images.min() >= 0 and images.max() <= 1 else cls.of(images)

    def scaler(self, features: int) -> "Scaler":
        """What scales observations of this many features in all."""
        half = self.high / 2 - self.low / 2
        constant = half <= np.finfo(np.float64).tiny  # which says nothing of how far it may go
        half = np.where(constant, 1.0, half)
        limit = np.where(constant, np.inf, np.broadcast_to(self.limit, half.shape))
        return Scaler(*(np.tile(part, features // len(half)) for part in (self.high / 2 + self.low / 2, 1 / half, half, limit)))


class Scaler(NamedTuple):
    """(n, ...) observations to (n, features) float64, scaled, and no farther from 0 than `limit`.

    One entry a feature, not a channel: it is faster.
    """

    center: np.ndarray
    factor: np.ndarray
    half: np.ndarray
    limit: np.ndarray

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        flat = observation.reshape(len(observation), len(self.center)) - self.center
        flat *= self.factor
        return np.clip(flat, -self.limit, self.limit, out=flat)

    def within(self, observation: np.ndarray) -> np.ndarray:
        """(n, features), not scaled: no farther out than `limit` allows; whole numbers and bools have no room and stay."""
        if observation.dtype.kind != "f" or np.isinf(self.limit).all():
            return observation
        with np.errstate(over="ignore"):  # at the ends of float64: anything is within
            most = self.limit * self.half
        return np.clip(observation, self.center - most, self.center + most).astype(observation.dtype, copy=False)

    def inverse(self, x: np.ndarray) -> np.ndarray:
        """(n, features), scaled, back to the units of the observations."""
        return x * self.half + self.center
