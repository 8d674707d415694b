"""Resolution: how the distance threshold l of an unstructured archive follows the descriptors.

A resolution is a callable `resolution(descriptors)` from (n, d) float64 to l, used at every update of the descriptor. One that
aims at a number of individuals says so in an attribute `individuals`: an update that leaves as many has lost nothing. One with
a method `control(archive, generation)` moves l itself, after each generation; then it is called for the first l alone.

In one and two dimensions `VAT` cuts the space that descriptors span into cells of one size. In more, nearly all of the volume
of a ball is far from what was found, and as many cells of it leave few individuals; there `Size` asks for a number of them.
"""

import warnings
from dataclasses import dataclass
from math import exp, lgamma, log, pi
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from auroraqd._checks import flag, number, numbers, whole
from auroraqd._compiled import compiled
from auroraqd.descriptors.scaling import beyond

_FAR = 2.0  # times as far from the middle as 99 of 100 descriptors: an archive spreads evenly, so 1.2 is what is seen
_SAMPLE = 20_000  # descriptors that `Size` looks at, at most
_GAIN, _REBUILT = 5e-6, 10  # of `CSC`: change of l for each individual too few, and generations between two rebuilds
_LEAST = 1e-150  # l, of which the square is a number
_FLAT = 1e-9  # side of a box, as a share of the longest, that is none


@dataclass(frozen=True)
class VAT:
    """l from the volume of the descriptors: the number of cells of size l that their ball holds stays the same.

    In two dimensions l = L / sqrt(60000), with L the largest distance between two descriptors: the value of the authors'
    re-released ballistic example. In d dimensions the ball of diameter L holds as many cells l^d:
    l = L / 2 * (V_d / cells)^(1 / d), V_d the volume of the unit ball.

    L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022, call it
    volume adaptive threshold.

    Args:
        cells: cells in a ball of diameter L; 47124 is 60000 pi / 4.
        robust: whether descriptors more than twice as far from the median as 99 of 100 are passed over, with a warning: one
            simulation that blew up would make cells so large that they hold all others. False is the rule of the paper.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> square = np.array([[0.0, 0.0], [0.0, 3.0], [4.0, 0.0], [4.0, 3.0]])  # its diagonal is 5
        >>> round(auroraqd.VAT()(square), 6)
        0.020412
        >>> round(5 / 60000**0.5, 6)
        0.020412
    """

    cells: float = 60000 * pi / 4
    robust: bool = True

    def __post_init__(self) -> None:
        number("cells", self.cells, least=1e-300, wanted="above 0")
        flag("robust", self.robust)

    @np.errstate(over="ignore", invalid="ignore")  # at the ends of float64 it is infinite
    def __call__(self, descriptors: np.ndarray) -> float:
        """L over `descriptors`, (n, d), n >= 1, turned into l."""
        descriptors = _points(descriptors)
        d = descriptors.shape[1]
        descriptors = without_far(descriptors) if self.robust else descriptors
        unit_ball = d / 2 * log(pi) - lgamma(d / 2 + 1)  # the logarithm of its volume
        return largest_distance(descriptors) / 2 * exp((unit_ball - log(self.cells)) / d)


@dataclass(frozen=True)
class Fixed:
    """The same l for ever.

    Args:
        l: distance threshold, in units of the descriptor.

    Examples:
        >>> import auroraqd
        >>> auroraqd.Fixed(l=0.05)([[0.0, 0.0], [1.0, 1.0]])
        0.05
    """

    l: float

    def __post_init__(self) -> None:
        number("l", self.l)

    def __call__(self, descriptors: np.ndarray) -> float:
        """l."""
        return self.l


@dataclass(frozen=True)
class Size:
    """l by which about so many individuals are stored in the end, from the distances between those stored now.

    Of the descriptors, always the one farthest from all before is taken [1]; the j-th is at a distance r_j from the others, so
    j of them keep r_j apart. Where descriptors are few, r_j falls as j^(-1/D), D the dimensions that they really fill. The l
    that is wanted is r_j at j = individuals, found there or, where fewer than four times as many are stored, by this law from
    r_j at a quarter of them: what will fill the gaps is not there yet. Between updates more are stored, as the robot finds new
    regions: on the tasks of the paper 1.2 to 1.5 times as many after 1,000 generations, and before the first update up to 4.5
    times.

    [1] T. Gonzalez, Clustering to minimize the maximum intercluster distance, Theoretical Computer Science 38, 1985.

    Args:
        individuals: how many to store.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> descriptors = np.random.default_rng(0).random((4000, 3))
        >>> few, many = auroraqd.Size(100)(descriptors), auroraqd.Size(1000)(descriptors)
        >>> few > many  # fewer individuals are farther apart
        True
    """

    individuals: int = 10_000

    def __post_init__(self) -> None:
        whole("individuals", self.individuals)

    @np.errstate(over="ignore", invalid="ignore")
    def __call__(self, descriptors: np.ndarray) -> float:
        """l from `descriptors`, (n, d), n >= 1; 0 if they are all the same."""
        points = without_far(_points(descriptors))
        if len(points) > _SAMPLE:
            points = points[np.random.default_rng(0).choice(len(points), _SAMPLE, replace=False)]
        taken = max(len(points) // 4, 2)  # of two there is one distance
        apart = separations(points, min(taken, self.individuals))
        apart = apart[apart > 0]
        if len(apart) == 0 or len(apart) == self.individuals - 1:  # the first has no distance
            return float(apart[-1]) if len(apart) else 0.0
        last = len(apart) - 1
        first = last // 4
        fall = log(apart[first] / apart[last]) / log((last + 2) / (first + 2)) if last > first else 1 / points.shape[1]
        fall = min(max(fall, 1 / points.shape[1]), 1.0)  # 1 / D
        return float(apart[last] * exp(fall * log((last + 2) / self.individuals)))


@dataclass(frozen=True)
class CSC:
    """Container size control: l falls while fewer individuals are stored than wanted, and grows while more are [1].

    After each generation l becomes l (1 - 5e-6 (target - n)), n the individuals stored. In every tenth all are added again,
    with (1 - epsilon) l, epsilon that of the archive: no closer than that any two are by its rule, so those go that a larger l
    has brought too close. The first l is half the side of a cube of which `target` fill the box of the descriptors along their
    principal axes: 0.5 (V / target)^(1 / d), V and d of those axes along which descriptors differ. When the descriptor is
    refitted, l changes as the side of that cube does: in the source, descriptors are scaled by the range of those stored.

    [1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022.

    Args:
        target: individuals to store.

    Raises:
        ValueError: it is no whole number, or below 1.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> descriptors = np.random.default_rng(0).random((4000, 2))
        >>> round(auroraqd.CSC(target=100)(descriptors), 2)
        0.07
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, "genotype", resolution=auroraqd.CSC(target=500), seed=0)
        >>> len(aurora.run(task, generations=5).archive) > 0
        True
    """

    target: int = 10_000

    def __post_init__(self) -> None:
        whole("target", self.target)

    @property
    def individuals(self) -> int:
        """The individuals that it aims at."""
        return self.target

    def __call__(self, descriptors: np.ndarray) -> float:
        """The first l, from `descriptors`, (n, d), n >= 1; 0 if they are all the same."""
        descriptors = _points(descriptors)
        size = np.abs(descriptors).max() or 1.0  # squares neither overflow nor vanish
        centred = descriptors / size - (descriptors / size).mean(axis=0)
        _, axes = np.linalg.eigh(centred.T @ centred)
        sides = np.ptp(centred @ axes, axis=0)
        sides = sides[sides > _FLAT * sides.max()]
        return float(size * 0.5 * np.exp(np.mean(np.log(sides)) - log(self.target) / len(sides))) if len(sides) else 0.0

    def rescaled(self, l: float, before: np.ndarray, after: np.ndarray) -> float:
        """l above 0, when the descriptors of the same individuals, (n, d), change from `before` to `after`: as their box."""
        was, now = self(before), self(after)
        return max(l / was * now, _LEAST) if was > 0 and now > 0 else l

    def control(self, archive: Any, generation: int) -> None:
        """Move l of an `UnstructuredArchive` with individuals, after this generation, the first being 1."""
        l = archive.l or self(archive.descriptor)
        if l == 0:  # there is one individual, or there are copies of it
            return
        l = max(l * max(1 - _GAIN * (self.target - len(archive)), 0.5), _LEAST)
        if generation % _REBUILT == 0:
            error = archive.reconstruction_error
            archive.redescribe(archive.descriptor.copy(), reconstruction_error=error, l=(1 - archive.epsilon) * l)
        archive.adjust(l)


@dataclass(frozen=True)
class Automatic:
    """`VAT(cells)` in one and two dimensions, `Size(individuals)` in more.

    Args:
        cells, individuals: see there.
    """

    cells: float = VAT.cells
    individuals: int = Size.individuals

    def __post_init__(self) -> None:
        VAT(self.cells)
        Size(self.individuals)

    def __call__(self, descriptors: np.ndarray) -> float:
        """l from `descriptors`, (n, d), n >= 1."""
        descriptors = _points(descriptors)
        return (VAT(self.cells) if descriptors.shape[1] <= 2 else Size(self.individuals))(descriptors)


def _points(descriptors: np.ndarray) -> np.ndarray:
    return numbers("descriptors", descriptors, " of shape (n, d)", axes=2, some=True, finite=True)


def without_far(descriptors: np.ndarray) -> np.ndarray:
    """Descriptors, (n, d), without those far outside, one in a hundred at most; with a warning that says how many there are."""
    near = descriptors / (np.abs(descriptors).max() or 1.0)  # squares neither overflow nor vanish
    far = beyond(np.linalg.norm(near - np.median(near, axis=0), axis=1), _FAR)
    if not far.any():
        return descriptors
    largest, count = np.abs(descriptors[far]).max(), np.count_nonzero(far)
    warnings.warn(
        f"{count} of {len(far):,} descriptors {'lies' if count == 1 else 'lie'} far outside the others, up to {largest:.3g}, "
        "not counted for the distance threshold l",
        stacklevel=2,
    )
    return descriptors[~far]


def separations(points: np.ndarray, n: int) -> np.ndarray:
    """Distances, (at most n - 1,), at which points, (m, d), are taken, always the one farthest from all before; the first is
    the one farthest from the mean.
    """
    n = min(n, len(points))
    apart = np.empty(max(n - 1, 0))
    _separations(np.ascontiguousarray(points), int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax()), apart)
    return apart


@compiled(nogil=True)
def _separations(points, first, apart):
    """Fill apart, (n - 1,): see `separations`."""
    nearest = np.full(points.shape[0], np.inf)
    chosen = first
    for j in range(apart.shape[0]):
        farthest, distance = 0, -1.0
        for i in range(points.shape[0]):
            squared = 0.0
            for c in range(points.shape[1]):
                step = points[i, c] - points[chosen, c]
                squared += step * step
            if squared < nearest[i]:
                nearest[i] = squared
            if nearest[i] > distance:
                farthest, distance = i, nearest[i]
        chosen = farthest
        apart[j] = np.sqrt(distance)


def largest_distance(points: np.ndarray) -> float:
    """Largest Euclidean distance between two of the points, (n, d): exact, without an n x n matrix."""
    if points.shape[1] in (2, 3) and len(points) > 100:
        try:
            points = points[ConvexHull(points).vertices]  # the two points farthest apart are on the hull
        except QhullError:
            pass  # flat or degenerate: the general way is right too
    # Points in order of their distance to the middle. A pair can beat the best only if the distances of both to the middle
    # add up to more, so each point meets only the ones far enough out.
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    radius = np.linalg.norm(points - middle, axis=1)
    order = np.argsort(-radius)
    points, radius = points[order], radius[order]
    best = 0.0
    for i in range(len(points)):
        if 2 * radius[i] * (1 + 1e-9) <= best:
            break
        others = points[i + 1 : i + 1 + np.searchsorted(-radius[i + 1 :], radius[i] * (1 + 1e-9) - best, side="right")]
        if len(others):
            best = max(best, np.sqrt(((others - points[i]) ** 2).sum(axis=1).max()))
    return float(best)
