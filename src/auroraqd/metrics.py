"""Metrics of the paper, how well a repertoire covers a reference, how well observations are reconstructed; and QD-scores."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import flag, number, numbers, whole
from auroraqd.archives.grid import GridArchive

_EMPTY = 1e-8  # what the probability of an empty bin of the compared repertoire counts as
_MOST_BINS = 10**8
_AT_ONCE = 2**22  # distances: 32 MB
_MOST_SIDE = 50_000  # bins along a side of the room: pairs of squares are told apart by one whole number


def klc(reference: np.ndarray, compared: np.ndarray, bins: int = 30, *, marginal: bool = False) -> float:
    """Kullback-Leibler coverage, D_KL(reference || compared), over a histogram (paper, Eq. 1).

    The histogram has `bins` bins in each dimension over the bounding box of the reference. A bin that the compared repertoire
    leaves empty counts as a probability of 1e-8. Individuals of the compared repertoire outside the box are not
    counted: see `outside`.

    Args:
        reference: (n, d), for instance the ground truth of a repertoire grown with the hand-coded descriptor.
        compared: (m, d), likewise of the repertoire to judge.
        bins: in each dimension.
        marginal: whether to add up the coverages of each dimension alone, instead of one joint histogram. The paper does not
            say which it means; the joint one sees what the marginal ones cannot.

    Returns:
        0 when the two are distributed alike, larger the worse the reference is covered.

    Raises:
        ValueError: not two-dimensional, empty, NaN, or of different d; or a joint histogram of more than 10^8 bins.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> reference = np.random.default_rng(0).random((5000, 2))
        >>> auroraqd.metrics.klc(reference, reference, bins=10)
        0.0
        >>> auroraqd.metrics.klc(reference, reference[reference[:, 0] < 0.5], bins=10) > 1
        True
    """
    bins = whole("bins", bins, most=_MOST_BINS)
    reference, compared = _both(reference, compared)
    d = reference.shape[1]
    if flag("marginal", marginal):
        return sum(_divergence(reference[:, i : i + 1], compared[:, i : i + 1], bins) for i in range(d))
    if bins**d > _MOST_BINS:
        raise ValueError(
            f"a joint histogram of {bins} bins in each of {d} dimensions is too large: use marginal=True or fewer bins"
        )
    return _divergence(reference, compared, bins)


def _divergence(reference: np.ndarray, compared: np.ndarray, bins: int) -> float:
    # By a power of two, which changes no digit, so that the width of the box is a number too.
    scale = 2.0**-2 if np.abs(reference).max() > 2.0**1000 else 1.0
    reference, compared = scale * reference, scale * compared
    box = list(zip(reference.min(axis=0), reference.max(axis=0), strict=True))
    e, _ = np.histogramdd(reference, bins, box)
    a, _ = np.histogramdd(compared, bins, box)
    e /= e.sum()
    a = np.maximum(a / max(a.sum(), 1), _EMPTY)
    covered = e > 0
    return float(np.sum(e[covered] * np.log(e[covered] / a[covered])))  # Eq. 1


def outside(reference: np.ndarray, compared: np.ndarray) -> float:
    """The share of the compared repertoire, (m, d), outside the bounding box of the reference, (n, d).

    Examples:
        >>> import auroraqd
        >>> auroraqd.metrics.outside([[0.0, 0.0], [1.0, 1.0]], [[0.5, 0.5], [2.0, 0.5]])  # a share
        0.5
    """
    reference, compared = _both(reference, compared)
    return float(((compared < reference.min(axis=0)) | (compared > reference.max(axis=0))).any(axis=1).mean())


def reached(reference: np.ndarray, compared: np.ndarray, bins: int = 10) -> float:
    """The share of the regions of the reference, (n, d), in which the compared repertoire, (m, d), has an individual.

    Regions are the cells of a grid over the bounding box of the reference that hold one of it; an individual outside the box
    reaches none. How many there are in each does not matter, which is what `klc` is about.

    Args:
        reference, compared: see `klc`.
        bins: in each dimension.

    Examples:
        >>> import auroraqd
        >>> auroraqd.metrics.reached([[0.0, 0.0], [1.0, 1.0]], [[0.1, 0.1], [0.1, 0.9]], bins=2)  # a share
        0.5
    """
    bins = whole("bins", bins, most=_MOST_BINS)
    reference, compared = _both(reference, compared)
    low, high = reference.min(axis=0), reference.max(axis=0)
    inside = compared[((compared >= low) & (compared <= high)).all(axis=1)]
    there, ours = (_cells(points, low, high, bins) for points in (reference, inside))
    cells = {tuple(cell) for cell in there.tolist()}
    return len(cells & {tuple(cell) for cell in ours.tolist()}) / len(cells)


def _cells(points: np.ndarray, low: np.ndarray, high: np.ndarray, bins: int) -> np.ndarray:
    """The cells of a grid that points within it are in, (n, d), without repetition; where it has no width there is one."""
    width = high / 2 - low / 2  # halves: the box may be as wide as numbers go
    share = np.divide(points / 2 - low / 2, width, out=np.zeros_like(points), where=width > 0)
    return np.unique(np.minimum(np.floor(share * bins), bins - 1).astype(np.int64), axis=0)


def diversity(trajectories: np.ndarray, bins: int = 10, *, low: float = -1.0, high: float = 1.0) -> float:
    """Diversity of trajectories in a square room (paper, Sec. "Second scenario").

    The room is cut into bins x bins squares. For each square, the share of all squares that the trajectories ending there pass
    through; summed over the squares: bins^2 at most. A trajectory passes through the squares that its samples are in, not
    through those it jumps over between two samples.

    Args:
        trajectories: (n, steps, 2).
        bins: along each side.
        low, high: the walls of the room, in the units of the trajectories; what is outside counts to the squares at the border.

    Raises:
        ValueError: wrong shape, a NaN or an infinity, or no room.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> straight = np.linspace([-0.9, -0.9], [0.9, 0.9], 50)  # along the diagonal of a room from -1 to 1
        >>> auroraqd.metrics.diversity(straight[None], bins=10)  # it passes 10 of 100 squares
        0.1
    """
    square = squares(trajectories, bins, low=low, high=high)
    pairs = np.unique(square[:, -1:] * bins**2 + square)  # where they end, and what they pass
    return len(pairs) / bins**2


def squares(trajectories: np.ndarray, bins: int = 10, *, low: float = -1.0, high: float = 1.0) -> np.ndarray:
    """The squares that trajectories are in, (n, steps, 2) to (n, steps): bins * (place along x) + place along y.

    For the parameters, and what is raised, see `diversity`.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> auroraqd.metrics.squares(np.array([[[-0.9, -0.9], [0.9, 0.9]]]), bins=2).shape
        (1, 2)
    """
    bins = whole("bins", bins, most=_MOST_SIDE)
    trajectories = numbers("trajectories", trajectories)
    if trajectories.ndim != 3 or trajectories.shape[2] != 2 or trajectories.shape[1] == 0:
        raise ValueError(f"trajectories must have shape (n, steps, 2) with steps >= 1, got {trajectories.shape}")
    if not np.isfinite(trajectories).all():
        raise ValueError("trajectories must be finite, got a NaN or an infinity")
    low, high = (number(name, value, least=-np.inf, wanted="a wall") for name, value in (("low", low), ("high", high)))
    if not low < high:
        raise ValueError(f"low must be below high, got {low:g} and {high:g}")
    inside = np.clip(trajectories, low, high) / 2 - low / 2  # halves: the room may be as wide as numbers go
    place = np.minimum(np.floor(inside / (high / 2 - low / 2) * bins), bins - 1).astype(np.int64)
    return place[:, :, 0] * bins + place[:, :, 1]


def reconstruction_error(observation: np.ndarray, reconstruction: np.ndarray) -> np.ndarray:
    """Root mean square error over the entries of each observation, (n, ...) and (n, ...) to (n,), in their units.

    Raises:
        ValueError: not of one shape.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> auroraqd.metrics.reconstruction_error(np.zeros((2, 4)), np.array([[0.0] * 4, [2.0] * 4]))
        array([0., 2.])
    """
    observation, reconstruction = numbers("observation", observation), numbers("reconstruction", reconstruction)
    if observation.shape != reconstruction.shape or observation.ndim < 2 or 0 in observation.shape[1:]:
        raise ValueError(
            f"observation and reconstruction must have one shape (n, ...), got {observation.shape} and {reconstruction.shape}"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # infinite, where it is larger than numbers go
        return np.sqrt(((reconstruction - observation) ** 2).mean(axis=tuple(range(1, observation.ndim))))


def coverage(points: ArrayLike, bins: int | Sequence[int], low: ArrayLike = -1.0, high: ArrayLike = 1.0) -> float:
    """The share of the cells of a grid that points, (n, d), are in: from 0 to 1.

    Args:
        points: (n, d), for instance ground truths, in a space that the repertoires to compare share.
        bins: cells in each dimension, a number or d of them.
        low, high: the corners of the box that is cut into cells, numbers or d each. A point outside counts to the nearest cell
            at the border, as in pyribs.

    Raises:
        ValueError: points are no finite (n, d), or there is no such box.

    Examples:
        >>> import auroraqd
        >>> auroraqd.metrics.coverage([[0.1, 0.1], [0.2, 0.2], [0.9, 0.9]], bins=2, low=0, high=1)
        0.5
    """
    values = _some_points("points", points)
    grid = grid_of(bins, low, high, values.shape[1])
    return len(np.unique(grid.cell_of(values))) / grid.n_cells


def effective_cells(points: ArrayLike, bins: int | Sequence[int], low: ArrayLike = -1.0, high: ArrayLike = 1.0) -> float:
    """In how many cells of a grid points, (n, d), would be if they were as spread out and each as full as the others.

    The exponential of the entropy of how they are distributed over the cells (the Hill number of order 1 [1]): 1 where all are
    in one cell, and all cells there are where each holds as many. 0 without points.

    [1] M. O. Hill, Diversity and Evenness: A Unifying Notation and Its Consequences, Ecology 54, 1973.

    Args:
        points, bins, low, high: see `coverage`, and what is raised.

    Examples:
        >>> import auroraqd
        >>> round(auroraqd.metrics.effective_cells([[0.1, 0.1], [0.2, 0.2], [0.9, 0.9]], bins=2, low=0, high=1), 2)
        1.89
    """
    values = _some_points("points", points)
    _, counts = np.unique(grid_of(bins, low, high, values.shape[1]).cell_of(values), return_counts=True)
    share = counts / max(len(values), 1)
    return float(np.exp(-(share * np.log(share)).sum())) if len(values) else 0.0


def qd_score(
    points: ArrayLike,
    fitness: ArrayLike,
    bins: int | Sequence[int],
    low: ArrayLike = -1.0,
    high: ArrayLike = 1.0,
    *,
    offset: float = 0.0,
) -> float:
    """The QD-score: the fitness of the fittest in each cell of a grid, summed over the cells that are not empty [1].

    [1] J. K. Pugh, L. B. Soros, P. A. Szerlip, K. O. Stanley, Confronting the challenge of quality diversity, GECCO 2015.

    Args:
        points, bins, low, high: see `coverage`.
        fitness: (n,).
        offset: subtracted from each: the least fitness there can be, so that no cell makes the score worse by being filled.

    Raises:
        ValueError: see `coverage`; or fitness is no finite (n,), or offset no finite number.

    Examples:
        >>> import auroraqd
        >>> points, fitness = [[0.1, 0.1], [0.2, 0.2], [0.9, 0.9]], [1.0, 2.0, 3.0]
        >>> auroraqd.metrics.qd_score(points, fitness, bins=2, low=0, high=1)
        5.0
    """
    values = _some_points("points", points)
    fitness = _fitness(fitness, len(values))
    offset = number("offset", offset, least=-np.inf, wanted="subtracted from each fitness")
    cells, which = np.unique(grid_of(bins, low, high, values.shape[1]).cell_of(values), return_inverse=True)
    best = np.full(len(cells), -np.inf)
    np.maximum.at(best, which, fitness)
    return float(np.sum(best - offset))


def grid_of(bins: int | Sequence[int], low: ArrayLike, high: ArrayLike, d: int) -> GridArchive:
    """An empty grid of d dimensions.

    Raises:
        ValueError: there is none of these bins and corners.
    """
    several = list(bins) if isinstance(bins, Sequence | np.ndarray) and not isinstance(bins, str) else [bins] * d
    if len(several) != d:
        raise ValueError(f"bins must be a number, or {d}, one for each dimension, got {len(several)}")
    return GridArchive([whole("bins", count) for count in several], low=low, high=high)


def soft_qd_score(descriptor: ArrayLike, fitness: ArrayLike, sigma: float, *, samples: int = 10_000, seed: int = 0) -> float:
    """The soft QD-score, which needs no cells: the integral over all b of max_n f_n exp(-(b - b_n)^2 / (2 sigma^2)).

    By Monte Carlo: S times the mean, over b drawn around the individuals, of max_n / sum_n of these terms, where S, the sum of
    f_n (2 pi sigma^2)^(d/2), is the score of as many that are far apart. That is right on average, in any dimension, and needs
    no box. The ratio is at most 1, so the standard error is at most S / (2 sqrt(samples)), half a percent of S by default, and
    next to 0 where individuals are many sigmas apart.

    Args:
        descriptor: (n, d), b_n.
        fitness: (n,), f_n, none below 0: subtract the least there can be.
        sigma: how far an individual reaches, in the units of the descriptor.
        samples: of b.
        seed: of them. The same gives the same score.

    Raises:
        ValueError: not of these shapes, a NaN or an infinity, a fitness below 0, or no sigma.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> one = auroraqd.metrics.soft_qd_score([[0.0, 0.0]], [1.0], sigma=0.1)
        >>> bool(np.isclose(one, 2 * np.pi * 0.1**2))  # the integral of one bell
        True
    """
    from scipy.spatial.distance import cdist

    values = _some_points("descriptor", descriptor)
    fitness = _fitness(fitness, len(values))
    sigma = number("sigma", sigma, least=1e-300, wanted="above 0")
    samples, rng = whole("samples", samples), np.random.default_rng(whole("seed", seed, least=0))
    if (fitness < 0).any():
        raise ValueError(f"fitness must be 0 or more, subtract the least there can be, got {fitness.min():g}")
    values, fitness = values[fitness > 0] / sigma, fitness[fitness > 0]
    if len(values) == 0:
        return 0.0
    sums = np.cumsum(fitness / fitness.max())
    places = (np.arange(samples) + rng.random()) / samples * sums[-1]  # evenly over them, which is better than by chance
    around = np.minimum(np.searchsorted(sums, places, side="right"), len(sums) - 1)
    total = 0.0
    for rows in np.array_split(around, -(-samples * len(values) // _AT_ONCE)):
        b = values[rows] + rng.standard_normal((len(rows), values.shape[1]))
        terms = np.log(fitness) - cdist(b, values, "sqeuclidean") / 2
        total += float(np.sum(1 / np.exp(terms - terms.max(axis=1, keepdims=True)).sum(axis=1)))
    return float(fitness.sum() * (2 * np.pi * sigma**2) ** (values.shape[1] / 2) * total / samples)


def _some_points(name: str, points: ArrayLike) -> np.ndarray:
    """Of a repertoire, which may be empty."""
    values = numbers(name, points, " of shape (n, d)", axes=2, finite=True)
    if values.shape[1] == 0:
        raise ValueError(f"{name} must have shape (n, d) with d >= 1, got {values.shape}")
    return values


def _fitness(values: ArrayLike, n: int) -> np.ndarray:
    fitness = numbers("fitness", values, f" of shape ({n},)", axes=1, finite=True)
    if len(fitness) != n:
        raise ValueError(f"fitness must have shape ({n},), as there are points, got {fitness.shape}")
    return fitness


def _both(reference: np.ndarray, compared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A reference and what is compared with it: points in one space."""
    reference, compared = _points("reference", reference), _points("compared", compared)
    if reference.shape[1] != compared.shape[1]:
        raise ValueError(f"reference and compared must have the same columns, got {reference.shape} and {compared.shape}")
    return reference, compared


def _points(name: str, values: np.ndarray) -> np.ndarray:
    return numbers(name, values, " of shape (n, d)", axes=2, some=True, finite=True)
