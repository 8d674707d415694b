"""What there is to see of an observation: a path in the plane, an image, or numbers over time."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from auroraqd.observations import streams_of

_LARGEST = 32  # pixels of a side, as they are shown
_CHANNELS = (1, 3, 4)
_MOST_SERIES = 12  # lines that the eye can tell apart


def by_worth(observation: np.ndarray) -> list[str]:
    """The streams of an observation, the one that is shown first: a path before an image, and that before others."""
    kinds = {name: Sight.of(stream.shape[1:], stream.dtype).kind for name, stream in streams_of(observation).items()}
    return sorted(kinds, key=lambda name: ("path", "image", "series").index(kinds[name]))


@dataclass(frozen=True)
class Sight:
    """How observations of a shape are shown.

    Args:
        kind: "path": points in the plane over time; "image"; "series": lines, or one of all numbers in their order.
        shape: of what is shown: (steps, 2); (height, width, channels); (steps, lines).
        factor: pixels of a side of the observation for each that is shown.
        given: the shape of an observation.
    """

    kind: Literal["path", "image", "series"]
    shape: tuple[int, ...]
    given: tuple[int, ...]
    factor: int = 1

    @classmethod
    def of(cls, shape: tuple[int, ...], dtype: Any) -> "Sight":
        """That of observations of this shape, (...), and dtype."""
        if len(shape) == 2 and shape[0] > 1 and shape[1] == 2 and np.dtype(dtype).kind != "b":  # two contacts are no place
            return cls("path", shape, shape)
        pixels = (*shape, 1) if len(shape) == 2 and (dtype == np.uint8 or shape[1] > _MOST_SERIES) else shape
        if len(pixels) == 3 and pixels[2] in _CHANNELS and min(pixels[:2]) > 1:
            factor = math.ceil(max(pixels[:2]) / _LARGEST)
            sides = (math.ceil(side / factor) for side in pixels[:2])
            return cls("image", (*sides, pixels[2]), shape, factor)
        steps, lines = shape if len(shape) == 2 and shape[1] <= _MOST_SERIES else (math.prod(shape), 1)
        return cls("series", (steps, lines), shape)

    @property
    def features(self) -> int:
        """Numbers that are shown of an observation."""
        return math.prod(self.shape)

    def seen(self, observation: np.ndarray) -> np.ndarray:
        """What is shown of observations, (n, ...), as (n, features) float64: of pixels their means."""
        rows = observation.astype(np.float64)
        if self.factor == 1:
            return rows.reshape(len(rows), self.features)
        height, width, channels = self.shape
        rows = rows.reshape(len(rows), *self.given[:2], channels)
        over = [(0, side * self.factor - given) for side, given in zip(self.shape[:2], self.given[:2], strict=True)]
        rows = np.pad(rows, [(0, 0), *over, (0, 0)], mode="edge")
        blocks = rows.reshape(len(rows), height, self.factor, width, self.factor, channels)
        return blocks.mean(axis=(2, 4)).reshape(len(rows), self.features)
