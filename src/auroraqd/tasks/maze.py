"""A maze: a robot on two wheels that feels its way by lasers, and a camera above that sees where it ends.

The robot, its senses and its network are those of the follow-up [1], as far as they are published. Ours are the walls, which
are a picture there; that a network has biases, and tanh on both layers; that a robot that would touch a wall turns, but stays
where it is; and that a bumper is pressed as long as a wall on that side of its front holds the robot up.

[1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022.
"""

import math
from dataclasses import dataclass

import numpy as np

from auroraqd import tasks
from auroraqd._checks import numbers, whole
from auroraqd._compiled import compiled
from auroraqd.tasks._pixels import disc, line

SIDE = 600.0
"""Of the world, in the units of all lengths here."""

RADIUS = 10.0  # of the robot
START = (60.0, 450.0, math.pi / 4)  # x, y, and where it heads to
WALLS = np.array(
    [
        (0, 0, SIDE, 0),
        (SIDE, 0, SIDE, SIDE),
        (SIDE, SIDE, 0, SIDE),
        (0, SIDE, 0, 0),
        (0, 300, 380, 300),
        (380, 300, 380, 160),
        (200, 600, 200, 420),
        (400, 460, 600, 460),
        (180, 0, 180, 180),
    ]
)
"""Their ends, x and y of both."""

_LASERS = (-math.pi / 4, 0.0, math.pi / 4)  # from where it heads to
_RANGE = 100.0  # of a laser
_SPEED = 5.0  # of a wheel, a step
_WEIGHT = 5.0  # the largest
_SENSES, _HIDDEN, _WHEELS = 5, 5, 2
_FIRST = (_SENSES + 1) * _HIDDEN
_GENES = _FIRST + (_HIDDEN + 1) * _WHEELS
_LARGEST = 1024  # pixels of a side
_MOST_STEPS = 10**6
_WALL, _ROBOT = 90.0, 255.0  # how bright
_THIN = 5.0  # half the thickness of a wall, as it is drawn


@dataclass(frozen=True)
class Maze:
    """Weights of a network in, a picture from above of where the robot ends out.

    42 genes: the weights of a network, (2 gene - 1) 5 each, from five senses (three lasers and two bumpers) over five hidden
    neurons to two wheels. Called with genotypes, (n, 42) in [0, 1], it returns an `Evaluation`:

    - fitness (n,): minus the sum of the squared outputs over all steps, for each and both wheels;
    - observation (n, size, size, 1) uint8: the maze at the end, y upwards; walls are grey, the robot is bright;
    - ground_truth (n, 2): x and y of the robot at the end, in a world of 600 x 600.

    Args:
        size: pixels of a side.
        steps: of an episode.

    Raises:
        ValueError: genotypes has the wrong shape, or leaves [0, 1]; an argument is out of range.

    Examples:
        >>> import auroraqd
        >>> still = auroraqd.tasks.Maze()([[0.5] * 42])  # a network of zeros
        >>> still.ground_truth, still.observation.shape
        (array([[ 60., 450.]]), (1, 64, 64, 1))
    """

    size: int = 64
    steps: int = 2000

    def __post_init__(self) -> None:
        whole("size", self.size, most=_LARGEST)
        whole("steps", self.steps, most=_MOST_STEPS)

    @property
    def n_genes(self) -> int:
        """Genes of a controller."""
        return _GENES

    def __call__(self, genotypes: np.ndarray) -> "tasks.Evaluation":
        """See the class."""
        fitness, paths = self._driven(genotypes, 1)
        pictures = np.zeros((len(paths), self.size, self.size), np.uint8)
        _draw(paths[:, -1], pictures)
        return tasks.Evaluation(fitness, pictures[..., None], paths[:, -1].copy())

    def paths(self, genotypes: np.ndarray, samples: int = 100) -> np.ndarray:
        """Where robots were on their way, (n, samples, 2), at moments that are evenly spaced, the last at the end: to draw.

        Raises:
            ValueError: as when it is called; or there are more samples than steps.
        """
        return self._driven(genotypes, whole("samples", samples, most=self.steps))[1]

    def _driven(self, genotypes: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
        genotypes = numbers("genotypes", genotypes, f" of shape (n, {_GENES})")
        if genotypes.ndim != 2 or genotypes.shape[1] != _GENES:
            raise ValueError(f"genotypes must have shape (n, {_GENES}), got {genotypes.shape}")
        if not ((genotypes >= 0) & (genotypes <= 1)).all():
            raise ValueError("genotypes must be in [0, 1]")
        weights = _WEIGHT * (2 * genotypes - 1)
        moments = np.linspace(0, self.steps, samples + 1)[1:].round().astype(np.int64)
        fitness, paths = np.empty(len(weights)), np.empty((len(weights), samples, 2))
        for row in range(len(weights)):
            fitness[row] = _drive(weights[row], WALLS, moments, paths[row])
        return fitness, paths


@compiled(nogil=True, error_model="numpy")
def _drive(weights, walls, moments, path):
    """Drive a robot with weights, (42,), and fill its path, (samples, 2), at moments; returns its fitness."""
    x, y, heading = START
    left = right = 0.0  # bumpers
    effort = 0.0
    senses, wheels = np.empty(_SENSES), np.empty(_WHEELS)
    sample = 0
    for step in range(1, moments[-1] + 1):
        for laser in range(3):
            senses[laser] = sight(walls, x, y, heading + _LASERS[laser]) / _RANGE
        senses[3], senses[4] = left, right
        think(weights, senses, wheels)
        effort += wheels[0] * wheels[0] + wheels[1] * wheels[1]
        heading += _SPEED * (wheels[1] - wheels[0]) / (2 * RADIUS)
        forward = _SPEED * (wheels[0] + wheels[1]) / 2
        to_x, to_y = x + forward * math.cos(heading), y + forward * math.sin(heading)
        gap, bearing = nearest(walls, to_x, to_y)
        left = right = 0.0
        if gap > RADIUS:
            x, y = to_x, to_y
        else:
            ahead = math.cos(bearing - heading)
            if ahead > 0:
                aside = math.sin(bearing - heading)
                left, right = 1.0 if aside >= 0 else 0.0, 1.0 if aside <= 0 else 0.0
        if step == moments[sample]:
            path[sample, 0], path[sample, 1] = x, y
            sample += 1
    return -effort


@compiled(nogil=True, error_model="numpy")
def think(weights, senses, wheels):
    """The outputs of the network, (2,), of what is sensed, (5,)."""
    for wheel in range(_WHEELS):
        wheels[wheel] = weights[_FIRST + _HIDDEN * _WHEELS + wheel]
    for neuron in range(_HIDDEN):
        total = weights[_SENSES * _HIDDEN + neuron]
        for sense in range(_SENSES):
            total += senses[sense] * weights[sense * _HIDDEN + neuron]
        value = math.tanh(total)
        for wheel in range(_WHEELS):
            wheels[wheel] += value * weights[_FIRST + neuron * _WHEELS + wheel]
    for wheel in range(_WHEELS):
        wheels[wheel] = math.tanh(wheels[wheel])


@compiled(nogil=True, error_model="numpy")
def sight(walls, x, y, angle):
    """How far it is to a wall in a direction, at most the range of a laser."""
    dx, dy = math.cos(angle), math.sin(angle)
    least = _RANGE
    for wall in range(len(walls)):
        ax, ay = walls[wall, 0] - x, walls[wall, 1] - y
        ux, uy = walls[wall, 2] - walls[wall, 0], walls[wall, 3] - walls[wall, 1]
        across = dx * uy - dy * ux
        if across != 0:  # else they are parallel
            along = (ax * uy - ay * ux) / across
            share = (ax * dy - ay * dx) / across
            if along >= 0 and 0 <= share <= 1:
                least = min(least, along)
    return least


@compiled(nogil=True, error_model="numpy")
def nearest(walls, x, y):
    """How far it is to the nearest point of a wall, and in which direction that lies."""
    least, bearing = np.inf, 0.0
    for wall in range(len(walls)):
        ux, uy = walls[wall, 2] - walls[wall, 0], walls[wall, 3] - walls[wall, 1]
        share = ((x - walls[wall, 0]) * ux + (y - walls[wall, 1]) * uy) / (ux * ux + uy * uy)
        share = min(max(share, 0.0), 1.0)
        dx, dy = walls[wall, 0] + share * ux - x, walls[wall, 1] + share * uy - y
        distance = math.hypot(dx, dy)
        if distance < least:
            least, bearing = distance, math.atan2(dy, dx)
    return least, bearing


@compiled(nogil=True, error_model="numpy")
def _draw(places, pictures):
    """Fill pictures, (n, size, size), of robots at places, (n, 2)."""
    size = pictures.shape[1]
    scale = size / SIDE
    empty = np.zeros((size, size), np.uint8)
    for wall in range(len(WALLS)):
        x, y, u, v = WALLS[wall]
        line(empty, (SIDE - y) * scale, x * scale, (SIDE - v) * scale, u * scale, _THIN * scale, _WALL)
    for i in range(len(pictures)):
        pictures[i] = empty
        disc(pictures[i], (SIDE - places[i, 1]) * scale, places[i, 0] * scale, RADIUS * scale, _ROBOT)
