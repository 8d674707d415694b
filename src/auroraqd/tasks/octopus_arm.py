"""The arm of an octopus: a soft bar in water that sixteen muscles bend, in MuJoCo. Needs the extra `robots`.

Its body is a flex of MuJoCo, of tetrahedra, between stiff plates: see `auroraqd.tasks._octopus_arm_model`. It has no joints,
and no one says in how many ways it can bend.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module

from auroraqd.tasks._octopus_arm_model import PLACES
from auroraqd.tasks._sensing import Sense, Senses, moments
from auroraqd.tasks.controllers import ClosedLoop, OpenLoop, Splines
from auroraqd.tasks.gym import Gym

ENVIRONMENT = "auroraqd/OctopusArm-v0"
"""Of Gymnasium, once an `OctopusArm` has been made."""


@dataclass
class OctopusArm(Gym):
    """A soft arm that reaches, and waves.

    A `Gym` of an environment that comes with auroraqd: what is said there holds here, and its other arguments are the same.
    There are sixteen muscles, four for each quarter of the arm, from above to the tip. A control of -1 lets one go, 1 pulls
    with all its force. A policy senses how long each muscle is, in lengths at rest, and its speed, in those a second. The
    environment's reward is minus the mean square of how much the muscles are asked to pull, from 0 to 1.

    Called with genotypes, (n, n_genes), it returns an `Evaluation`:

    - fitness (n,): as is asked for, by default 0;
    - observation (n, samples, 12): where the four plates are that move, x, y and z of each in metres, from above to the tip; or
      what is asked for;
    - ground_truth (n, 3): where the tip is in the end, x, y and z in metres. At rest it is at (0, 0, 0.2), and the arm hangs
      from (0, 0, 0.8).

    Args:
        controller: by default curves through three moments, for each muscle.
        steps: of control, of 20 ms each.
        samples: moments that are observed.
        positions: of MuJoCo's qpos; by default the places of the plates.

    Raises:
        ValueError: as a `Gym`; or MuJoCo is older than 3.16.

    Examples:
        >>> import auroraqd
        >>> arm = auroraqd.tasks.OctopusArm(steps=10, samples=5)
        >>> arm.n_genes
        48
        >>> arm([[0.5] * arm.n_genes]).observation.shape
        (1, 5, 12)
    """

    env_id: str = field(default=ENVIRONMENT, init=False, repr=False)
    controller: OpenLoop | ClosedLoop = field(default_factory=lambda: Splines(knots=3))
    steps: int = 100
    positions: Sequence[int] | None = tuple(place + axis for place in PLACES for axis in range(3))

    def _open(self) -> None:
        with suppress(ImportError):  # which is said where an environment is made
            registration = import_module("gymnasium.envs.registration")
            if ENVIRONMENT not in registration.registry:
                registration.register(ENVIRONMENT, "auroraqd.tasks._octopus_arm_environment:OctopusArmEnvironment")
        super()._open()

    def _sense(self, senses: Senses) -> None:
        super()._sense(senses)
        self._truth = Sense("qpos", moments(self.steps, self.samples), lambda poses: poses[..., :3])
