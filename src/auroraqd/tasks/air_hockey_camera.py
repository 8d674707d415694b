"""The air-hockey task through a camera: what a robot knows of it that sees the room from above."""

from dataclasses import dataclass

import numpy as np

from auroraqd import tasks
from auroraqd._checks import flag, number, whole
from auroraqd._compiled import compiled
from auroraqd.tasks._pixels import disc, line
from auroraqd.tasks.air_hockey import HALF_WIDTH, JOINTS, PUCK, STEPS, WALL, AirHockey, joints

_LARGEST = 1024  # pixels of a side
_BRIGHT, _ARM = 255.0, 120.0


@dataclass(frozen=True)
class AirHockeyCamera:
    """`AirHockey`, seen from above: a few frames of the puck's way, and no positions.

    Called with genotypes, (n, 8) in [0, 1], it returns an `Evaluation`:

    - fitness (n,): 0;
    - observation (n, size, size, frames) uint8: the room from wall to wall, y upwards, at moments that are evenly spaced, the
      last at the end; the puck is bright;
    - ground_truth (n, 2): x and y of the puck at the end, in metres.

    Args:
        restitution_threshold: as in `AirHockey`.
        size: pixels of a side.
        frames: how many, one a channel.
        arm: whether the arm is seen, too, half as bright.

    Raises:
        ValueError: genotypes has the wrong shape, or leaves [0, 1]; an argument is out of range.

    Examples:
        >>> import auroraqd
        >>> seen = auroraqd.tasks.AirHockeyCamera()([[0.5] * 8])  # an arm that does not move
        >>> seen.observation.shape, seen.observation.dtype
        ((1, 32, 32, 3), dtype('uint8'))
        >>> bool((seen.observation[..., 0] == seen.observation[..., 2]).all())  # nor does the puck
        True
    """

    restitution_threshold: float = 0.0
    size: int = 32
    frames: int = 3
    arm: bool = False

    def __post_init__(self) -> None:
        number("restitution_threshold", self.restitution_threshold)
        whole("size", self.size, most=_LARGEST)
        whole("frames", self.frames, most=STEPS)
        flag("arm", self.arm)

    @property
    def n_genes(self) -> int:
        """Genes of a controller."""
        return 2 * JOINTS

    def __call__(self, genotypes: np.ndarray) -> "tasks.Evaluation":
        """See the class."""
        evaluation = AirHockey(self.restitution_threshold)(genotypes)
        moments = np.linspace(0, STEPS, self.frames + 1)[1:].round().astype(int) - 1
        seen = evaluation.observation[:, moments]
        arms = joints(np.asarray(genotypes, np.float64))[:, moments] if self.arm else np.empty((len(seen), self.frames, 0, 2))
        pictures = np.zeros((len(seen), self.size, self.size, self.frames), np.uint8)
        _draw(seen, arms, pictures)
        return evaluation._replace(observation=pictures)


@compiled(nogil=True, error_model="numpy")
def _draw(pucks, arms, pictures):
    """Fill pictures, (n, size, size, frames), of pucks, (n, frames, 2), and arms, (n, frames, joints, 2), in metres."""
    scale = pictures.shape[1] / (2 * WALL)  # pixels a metre
    for i in range(pictures.shape[0]):
        for k in range(pictures.shape[3]):
            picture = pictures[i, :, :, k]
            for joint in range(arms.shape[2] - 1):
                x, y, u, v = arms[i, k, joint, 0], arms[i, k, joint, 1], arms[i, k, joint + 1, 0], arms[i, k, joint + 1, 1]
                line(
                    picture,
                    (WALL - y) * scale,
                    (WALL + x) * scale,
                    (WALL - v) * scale,
                    (WALL + u) * scale,
                    HALF_WIDTH * scale,
                    _ARM,
                )
            disc(picture, (WALL - pucks[i, k, 1]) * scale, (WALL + pucks[i, k, 0]) * scale, PUCK * scale, _BRIGHT)
