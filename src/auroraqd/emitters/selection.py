"""Selection: which stored individuals become parents.

A selection is a callable `select(archive, n, rng)` that returns n rows of the archive, (n,) int64, with repetition. The
archive is not empty.
"""

from dataclasses import dataclass

import numpy as np

from auroraqd._checks import instance, whole
from auroraqd._compiled import compiled
from auroraqd.archives.base import Archive


@dataclass(frozen=True)
class Uniform:
    """Every individual with the same probability."""

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        _check(archive, n, rng)
        return rng.integers(len(archive), size=n)


@dataclass(frozen=True)
class Curiosity:
    """Roulette over the curiosity score, shifted so that the lowest negative score has probability 0.

    Weights are c - min(0, min c) [1]; individuals are equally likely while all weights are 0.

    [1] A. Cully, Y. Demiris, Quality and Diversity Optimization: A Unifying Modular Framework, IEEE TEVC 2018.
    """

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        _check(archive, n, rng)
        rows = np.empty(n, np.int64)
        if _roulette(archive.curiosity, rng.random(n), rows):
            return rows
        return rng.integers(len(archive), size=n)


def _check(archive: Archive, n: int, rng: np.random.Generator) -> None:
    instance("archive", archive, Archive, "an archive of auroraqd")
    instance("rng", rng, np.random.Generator, "a generator of numpy.random")
    whole("n", n, most=_MOST)
    if len(archive) == 0:
        raise ValueError("archive must hold individuals to select from, and is empty")


_MOST = 10**9  # rows at once
_BLOCK = 16


@compiled(nogil=True, fastmath={"reassoc", "nnan", "nsz"})
def _roulette(score, spins, rows):
    """Spin a wheel with slots as wide as the scores, shifted by the lowest if it is negative.

    Sums go by blocks, so that a spin looks into one block only. Scores are multiples of 1/2, of which sums are exact in any
    order: the compiler may vectorise them.

    Args:
        score: (n,) float64.
        spins: (m,) in [0, 1).
        rows: (m,) int64, set.

    Returns:
        False, and rows undefined, when all slots are of width 0.
    """
    low = 0.0
    for row in range(score.shape[0]):
        low = min(low, score[row])
    blocks = (score.shape[0] + _BLOCK - 1) // _BLOCK
    ends = np.empty(blocks)
    total = 0.0
    for block in range(blocks):
        width = 0.0
        for row in range(block * _BLOCK, min((block + 1) * _BLOCK, score.shape[0])):
            width += score[row] - low
        total += width
        ends[block] = total
    if total == 0:
        return False
    for i in range(spins.shape[0]):
        place = spins[i] * total
        block, after = 0, blocks - 1  # the first that ends beyond the place, or the last, is between these
        while block < after:
            middle = (block + after) // 2
            beyond = ends[middle] > place
            block, after = (block if beyond else middle + 1), (middle if beyond else after)
        row = block * _BLOCK
        end = (ends[block - 1] if block > 0 else 0.0) + score[row] - low
        while end <= place and row + 1 < score.shape[0]:
            row += 1
            end += score[row] - low
        rows[i] = row
    return True
