"""Resolution: how the distance threshold l of an unstructured archive follows the descriptors.

A resolution is a callable `resolution(descriptors)` from (n, d) float64 to l, used at every update of the descriptor.
"""

from dataclasses import dataclass
from math import exp, lgamma, log, pi

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from auroraqd._checks import number


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
    """

    cells: float = 60000 * pi / 4

    def __post_init__(self) -> None:
        number("cells", self.cells, least=1e-300, wanted="above 0")

    def __call__(self, descriptors: np.ndarray) -> float:
        """L over `descriptors`, (n, d), n >= 1, turned into l."""
        d = descriptors.shape[1]
        unit_ball = d / 2 * log(pi) - lgamma(d / 2 + 1)  # the logarithm of its volume
        return largest_distance(descriptors) / 2 * exp((unit_ball - log(self.cells)) / d)


@dataclass(frozen=True)
class Fixed:
    """The same l for ever.

    Args:
        l: distance threshold, in units of the descriptor.
    """

    l: float

    def __post_init__(self) -> None:
        number("l", self.l)

    def __call__(self, descriptors: np.ndarray) -> float:
        """l."""
        return self.l


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
