"""The octopus arm as an environment of Gymnasium, which imports this module when one is made."""

from importlib import import_module
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv

from auroraqd.tasks._octopus_arm_model import MUSCLES, TIMESTEP, xml

INTERVAL = 0.02  # s, of control
_LEAST = 3, 16  # of MuJoCo: with several vertices of a flex fixed to one body, others blow up, or end the process


class OctopusArmEnvironment(MujocoEnv):
    """See `auroraqd.tasks.OctopusArm`. Options are those of `MujocoEnv`, render_mode for instance."""

    metadata = {"render_modes": ["human", "rgb_array", "depth_array"]}

    def __init__(self, **options: Any):
        space = gymnasium.spaces.Box(-np.inf, np.inf, (2 * MUSCLES,))
        super().__init__(__file__, round(INTERVAL / TIMESTEP), space, **options)

    def _initialize_simulation(self) -> tuple[Any, Any]:
        """The model is made here, not read from a file."""
        mujoco: Any = import_module("mujoco")
        if tuple(map(int, mujoco.__version__.split(".")[:2])) < _LEAST:
            raise ValueError(f"it needs MuJoCo {'.'.join(map(str, _LEAST))} or later, got {mujoco.__version__}")
        model = mujoco.MjModel.from_xml_string(xml())
        model.vis.global_.offwidth, model.vis.global_.offheight = self.width, self.height
        return model, mujoco.MjData(model)

    def _get_obs(self) -> np.ndarray:
        rest = self.model.tendon_length0
        return np.concatenate([self.data.ten_length / rest, self.data.ten_velocity / rest])

    def reset_model(self) -> np.ndarray:
        """It hangs straight; there is no noise."""
        self.set_state(self.init_qpos, self.init_qvel)
        return self._get_obs()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.float64, bool, bool, dict[str, np.float64]]:
        """The reward is minus the effort."""
        self.do_simulation(action, self.frame_skip)
        return self._get_obs(), -np.square(action).mean(dtype=np.float64), False, False, {}
