"""Selection: which stored individuals become parents.

A selection is a callable `select(archive, n, rng)` that returns n rows of the archive, (n,) int64, with repetition. The
archive is not empty.
"""

from dataclasses import dataclass

import numpy as np

from auroraqd.archive import Archive


@dataclass(frozen=True)
class Uniform:
    """Every individual with the same probability."""

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        return rng.integers(len(archive), size=n)


@dataclass(frozen=True)
class Curiosity:
    """Roulette over the curiosity score, shifted so that the lowest negative score has probability 0.

    Weights are c - min(0, min c) [1]; individuals are equally likely while all weights are 0.

    [1] A. Cully, Y. Demiris, Quality and Diversity Optimization: A Unifying Modular Framework, IEEE TEVC 2018.
    """

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        curiosity = archive.curiosity
        wheel = np.cumsum(curiosity - min(0.0, curiosity.min()))
        if wheel[-1] == 0:
            return rng.integers(len(archive), size=n)
        rows = np.searchsorted(wheel, rng.random(n) * wheel[-1], side="right")
        return np.minimum(rows, len(wheel) - 1)
