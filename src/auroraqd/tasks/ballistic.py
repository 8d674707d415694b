"""The ballistic task (paper, Sec. "First scenario"): throw a point mass, watch it fly and bounce.

Constants are those of the authors' re-released example: mass 1 kg, steps of 1 s, forces up to 200 N.
"""

from dataclasses import dataclass

import numpy as np

from auroraqd import tasks
from auroraqd._checks import numbers
from auroraqd._compiled import compiled

STEPS = 50
"""Points of a trajectory, the first at the origin."""

_GRAVITY = 9.81  # m/s^2
_BOUNCE = 0.6  # share of the vertical speed that a bounce keeps
_MAX_FORCE = 200.0  # N
_MAX_ANGLE = np.pi / 2  # rad
_GROUND_TRUTH_SCALE = 2000.0  # m


@dataclass(frozen=True)
class Ballistic:
    """A force and its direction in, a trajectory out.

    Two genes, the angle and the magnitude of the force, each mapped to 0.1 + 0.8 gene of its range. Called with genotypes,
    (n, 2) in [0, 1], it returns an `Evaluation`:

    - fitness (n,): 0, as in the paper; NaN for throws too weak to leave the ground (F sin a <= 3 m g), which are invalid;
    - observation (n, 50, 2): x and y each second, in metres;
    - ground_truth (n, 2): x and y of the top of the first arc, from 0 to 2000 m scaled to [-1, 1].

    Raises:
        ValueError: genotypes has the wrong shape, or leaves [0, 1].

    Examples:
        >>> import auroraqd
        >>> throw = auroraqd.tasks.Ballistic()([[0.5, 0.5]])
        >>> throw.observation.shape
        (1, 50, 2)
        >>> throw.observation[0, :3].round(1)
        array([[  0. ,   0. ],
               [ 70.7,  60.9],
               [141.4, 112. ]])
    """

    @property
    def n_genes(self) -> int:
        """Genes of a controller."""
        return 2

    def __call__(self, genotypes: np.ndarray) -> "tasks.Evaluation":
        """See the class."""
        genotypes = numbers("genotypes", genotypes, " of shape (n, 2)")
        if genotypes.ndim != 2 or genotypes.shape[1] != 2:
            raise ValueError(f"genotypes must have shape (n, 2), got {genotypes.shape}")
        if not ((genotypes >= 0) & (genotypes <= 1)).all():
            raise ValueError("genotypes must be in [0, 1]")
        along, up = _force(0.1 + 0.8 * genotypes)
        fitness = np.where(up > 3 * _GRAVITY, 0.0, np.nan)
        return tasks.Evaluation(fitness, _trajectories(along, up), _top(along, up))

    def prior(self) -> np.ndarray:
        """(10000, 50, 2): the prior data set of the paper's pre-trained variants, 100 angles by 100 forces.

        Angles i / 100 pi / 2 and forces j / 100 200 N, for i, j = 0 to 99, those that never leave the ground included.
        """
        parameter = np.arange(100) / 100
        angle, force = np.meshgrid(parameter, parameter)
        return _trajectories(*_force(np.column_stack([angle.ravel(), force.ravel()])))

    def bounds(self) -> np.ndarray:
        """(2, 50, 2): the lowest and the highest x and y, in metres, that valid throws can reach, at every step."""
        gene = np.linspace(0, 1, 101)  # the extremes are reached at its ends
        evaluation = self(np.stack(np.meshgrid(gene, gene), axis=2).reshape(-1, 2))
        reached = evaluation.observation[np.isfinite(evaluation.fitness)].reshape(-1, 2)
        return np.stack([np.broadcast_to(corner, (STEPS, 2)) for corner in (reached.min(axis=0), reached.max(axis=0))])


def _force(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The horizontal and the vertical component, (n,) N each, of shares (n, 2) of the largest angle and force."""
    angle, force = share[:, 0] * _MAX_ANGLE, share[:, 1] * _MAX_FORCE
    return force * np.cos(angle), force * np.sin(angle)


def _trajectories(along: np.ndarray, up: np.ndarray) -> np.ndarray:
    observation = np.empty((len(along), STEPS, 2))
    _fly(along, up, observation)
    return observation


_LANES = 16  # throws that fly side by side


@compiled(nogil=True)
def _fly(along, up, trajectory):
    """Fill trajectories, (n, STEPS, 2), from the two components of the force, (n,) each: semi-implicit Euler, 1 s steps.

    A step waits for the one before, so several throws take it together, in vector registers.
    """
    n = along.shape[0]
    x, y, vx, vy, ay = np.empty((5, _LANES))
    path = np.zeros((STEPS, 2, _LANES))
    for start in range(0, n, _LANES):
        flying = min(_LANES, n - start)
        for i in range(_LANES):  # the last throws are repeated to fill the lanes
            throw = min(start + i, n - 1)
            x[i] = y[i] = vy[i] = 0.0
            vx[i], ay[i] = along[throw], up[throw] - _GRAVITY
        for step in range(1, STEPS):
            for i in range(_LANES):
                vy[i] += ay[i]
                x[i] += vx[i]
                height = y[i] + vy[i]
                down = height <= 0  # a bounce takes the place of this step's gravity
                y[i] = 0.0 if down else height
                ay[i] = -_BOUNCE * vy[i] if down else -_GRAVITY
                vy[i] = 0.0 if down else vy[i]
                path[step, 0, i] = x[i]
                path[step, 1, i] = y[i]
        for i in range(flying):
            for step in range(STEPS):
                trajectory[start + i, step, 0] = path[step, 0, i]
                trajectory[start + i, step, 1] = path[step, 1, i]


@compiled(nogil=True)
def _top(along, up):
    """The top of the first arc between the samples, of which the highest lies up to g / 8 above and half a step aside."""
    top = np.empty((len(along), 2))
    for i in range(len(along)):
        vy = up[i] - _GRAVITY
        t = up[i] / _GRAVITY - 1
        x = along[i] * t + along[i] / 2
        y = -_GRAVITY / 2 * (t * t) + vy * t + vy / 2
        top[i, 0] = x / _GROUND_TRUTH_SCALE * 2 - 1
        top[i, 1] = y / _GROUND_TRUTH_SCALE * 2 - 1
    return top
