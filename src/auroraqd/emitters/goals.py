"""Goal exploration: what is tried next is what may reach a goal that was drawn in descriptor space."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from auroraqd._checks import number, whole
from auroraqd.archives.base import Archive
from auroraqd.emitters.variation import Gaussian


@dataclass(frozen=True)
class Goals:
    """Intrinsically motivated goal exploration in a learned goal space, IMGEP-UGL [1].

    A goal is drawn from the density of the descriptors that are stored (SciPy's `gaussian_kde`; where that is singular, one of
    the stored descriptors), and what is nearest to it is varied by a Gaussian step. Others are random: with a probability, and
    until as many have been evaluated as `first` says.

    [1] A. Pere, S. Forestier, O. Sigaud, P.-Y. Oudeyer, Unsupervised Learning of Goal Spaces for Intrinsically Motivated Goal
    Exploration, ICLR 2018.

    Args:
        random: probability that a genotype is random.
        sigma: standard deviation of a step; genes span [0, 1].
        first: evaluations that are random, at the beginning.

    Raises:
        ValueError: one is out of range.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(2, "hand-coded", emitter=auroraqd.emitters.Goals(random=0.1), seed=0)
        >>> aurora.run(task, generations=3).generation
        3
    """

    random: float = 0.2
    sigma: float = 0.05
    first: int = 100

    def __post_init__(self) -> None:
        number("random", self.random, most=1, wanted="a probability, from 0 to 1")
        number("sigma", self.sigma, least=1e-300, wanted="above 0")
        whole("first", self.first, least=0)

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See `auroraqd.emitters`. Of those that aim at a goal, the parent is what is nearest to it."""
        evaluated = max(int(archive.born.max()) + 1, len(archive))  # at least
        aims = rng.random(n) >= self.random
        aims[: max(self.first - evaluated, 0)] = False
        genotype, parent = rng.random((n, archive.genotype.shape[1])), np.full(n, -1)
        if aims.any():
            rows = nearest_to(goals(archive.descriptor, int(aims.sum()), rng), archive.descriptor)
            genotype[aims] = Gaussian(self.sigma)(archive.genotype[rows], rng)
            parent[aims] = archive.id[rows]
        return genotype, parent


def goals(descriptors: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """(n, d) points drawn from the density of descriptors, (m, d)."""
    from scipy.stats import gaussian_kde  # takes a second, which who needs no goals should not wait

    try:
        with np.errstate(all="ignore"):
            drawn = gaussian_kde(descriptors.T).resample(n, seed=rng).T
        if np.isfinite(drawn).all():
            return drawn
    except (np.linalg.LinAlgError, ValueError):  # they have no spread in some direction, or are fewer than dimensions
        pass
    return descriptors[rng.integers(len(descriptors), size=n)]


def nearest_to(points: np.ndarray, descriptors: np.ndarray) -> np.ndarray:
    """(n,) rows of the descriptors, (m, d), nearest to points, (n, d)."""
    _, rows = KDTree(descriptors).query(points)
    return np.asarray(rows, np.int64)
