"""Selection: which stored individuals become parents.

A selection is a callable `select(archive, n, rng)` that returns n rows of the archive, (n,) int64, with repetition. The
archive is not empty.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import KDTree

from auroraqd._checks import function, in_words, instance, whole
from auroraqd._compiled import compiled
from auroraqd.archives.base import Archive
from auroraqd.archives.unstructured import UnstructuredArchive
from auroraqd.individuals import Individuals


@dataclass(frozen=True)
class Uniform:
    """Every individual with the same probability.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> aurora = auroraqd.Aurora(2, "genotype", seed=0).run(auroraqd.tasks.Ballistic(), generations=1)
        >>> auroraqd.Uniform()(aurora.archive, 1000, np.random.default_rng(0)).shape
        (1000,)
    """

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        _check(archive, n, rng)
        return rng.integers(len(archive), size=n)


@dataclass(frozen=True)
class Curiosity:
    """Roulette over the curiosity score, shifted so that the lowest negative score has probability 0.

    Weights are c - min(0, min c) [1]; individuals are equally likely while all weights are 0.

    [1] A. Cully, Y. Demiris, Quality and Diversity Optimization: A Unifying Modular Framework, IEEE TEVC 2018.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> aurora = auroraqd.Aurora(2, "genotype", seed=0).run(auroraqd.tasks.Ballistic(), generations=3)
        >>> rows = auroraqd.Curiosity()(aurora.archive, 1000, np.random.default_rng(0))
        >>> bool(aurora.archive.curiosity[rows].mean() > aurora.archive.curiosity.mean())
        True
    """

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        _check(archive, n, rng)
        rows = np.empty(n, np.int64)
        if _roulette(archive.curiosity, rng.random(n), rows):
            return rows
        return rng.integers(len(archive), size=n)


@dataclass(frozen=True)
class Novelty:
    """Roulette over the novelty, the mean distance to the k nearest in descriptor space: in proportion to it [1].

    An unstructured archive knows its novelties, by its own k; of another they are measured, with k = 15. Individuals are
    equally likely while all novelties are 0.

    [1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> aurora = auroraqd.Aurora(2, "genotype", seed=0).run(auroraqd.tasks.Ballistic(), generations=3)
        >>> novelty = aurora.archive.novelty()
        >>> rows = auroraqd.Novelty()(aurora.archive, 1000, np.random.default_rng(0))
        >>> bool(novelty[rows].mean() > novelty.mean())
        True
    """

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        _check(archive, n, rng)
        return in_proportion(novelty(archive), n, rng)


@dataclass(frozen=True)
class Surprise:
    """Roulette over the surprise, the error of the reconstruction from the descriptor: in proportion to it [1].

    An error that is no finite number counts 0; individuals are equally likely while all are 0.

    [1] G. Paolo, A. Laflaquiere, A. Coninx, S. Doncieux, Unsupervised Learning and Exploration of Reachable Outcome Space,
    ICRA 2020.

    Examples:
        >>> import auroraqd
        >>> from sklearn.decomposition import PCA
        >>> aurora = auroraqd.Aurora(2, PCA(n_components=2), selection=auroraqd.Surprise(), seed=0)
        >>> aurora.run(auroraqd.tasks.Ballistic(), generations=3).generation
        3
    """

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring.

        Raises:
            ValueError: the archive has no reconstruction errors.
        """
        _check(archive, n, rng)
        return in_proportion(surprise(archive, "Surprise"), n, rng)


@dataclass(frozen=True)
class Mixed:
    """One of two selections, by one fair coin a batch [1].

    [1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022.

    Args:
        a, b: selections.

    Examples:
        >>> import auroraqd
        >>> auroraqd.Mixed(auroraqd.Novelty(), auroraqd.Uniform())
        Mixed(a=Novelty(), b=Uniform())
    """

    a: Callable[[Archive, int, np.random.Generator], np.ndarray] = field(default_factory=Novelty)
    b: Callable[[Archive, int, np.random.Generator], np.ndarray] = field(default_factory=Surprise)

    __repr__ = in_words

    def __post_init__(self) -> None:
        function("a", self.a)
        function("b", self.b)

    def __call__(self, archive: Archive, n: int, rng: np.random.Generator) -> np.ndarray:
        """See the module docstring."""
        _check(archive, n, rng)
        return (self.a if rng.random() < 0.5 else self.b)(archive, n, rng)


def _check(archive: Archive, n: int, rng: np.random.Generator) -> None:
    instance("archive", archive, Archive, "an archive of auroraqd")
    instance("rng", rng, np.random.Generator, "a generator of numpy.random")
    whole("n", n, most=_MOST)
    if len(archive) == 0:
        raise ValueError("archive must hold individuals to select from, and is empty")


_MOST = 10**9  # rows at once
_NEIGHBOURS = 15


def novelty(archive: Archive) -> np.ndarray:
    """(n,) mean distance of each individual to its k nearest, by the k of the archive, or 15 where it has no novelty."""
    if isinstance(archive, UnstructuredArchive):
        return archive.novelty()
    k = min(_NEIGHBOURS, len(archive) - 1)
    if k < 1:
        return np.zeros(len(archive))
    distances, _ = KDTree(archive.descriptor).query(archive.descriptor, k + 1)
    return distances[:, 1:].mean(axis=1)  # the first is its own, or that of a copy


def surprise(individuals: Individuals, who: str) -> np.ndarray:
    """(n,) reconstruction errors.

    Raises:
        ValueError: there are none; said of `who` asks.
    """
    error = individuals.reconstruction_error
    if error is None:
        raise ValueError(
            f"{who} needs reconstruction errors, which descriptors give that are learned and have an inverse_transform, and "
            "this one gives none"
        )
    return error


def in_proportion(weights: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """n rows, (n,) int64, each as likely as its weight, (m,) 0 or more; those that are not finite count 0.

    Where all are 0, each is as likely as another.
    """
    weights = np.where(np.isfinite(weights), weights, 0.0)
    largest = weights.max()
    if largest == 0:
        return rng.integers(len(weights), size=n)
    ends = np.cumsum(weights / largest)
    last = np.flatnonzero(weights)[-1]
    return np.minimum(np.searchsorted(ends, rng.random(n) * ends[-1], side="right"), last)


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
    low = min(_lowest(score), 0.0)
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
    # Neither search has a branch that depends on the place: each that is guessed wrong costs as much as a block.
    for i in range(spins.shape[0]):
        place = spins[i] * total
        block, others = 0, blocks - 1  # the first that ends beyond the place, or the last, is this or one of the others
        while others > 0:
            half = (others + 1) // 2
            block += half if ends[block + half - 1] <= place else 0
            others -= half
        first = block * _BLOCK
        end, passed = ends[block - 1] if block > 0 else 0.0, 0
        for row in range(first, min(first + _BLOCK, score.shape[0]) - 1):
            end += score[row] - low
            passed += 1 if end <= place else 0
        rows[i] = first + passed
    return True


@compiled(nogil=True, fastmath={"nnan"})
def _lowest(score):
    """The lowest of (n,) scores, n >= 1; in lanes, as a minimum waits for the one before."""
    lanes = np.full(_BLOCK, score[0])
    whole = score.shape[0] - score.shape[0] % _BLOCK
    for start in range(0, whole, _BLOCK):
        for lane in range(_BLOCK):
            value = score[start + lane]
            lanes[lane] = value if value < lanes[lane] else lanes[lane]
    lowest = lanes.min()
    for row in range(whole, score.shape[0]):
        lowest = min(lowest, score[row])
    return lowest
