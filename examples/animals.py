"""A dog, or a fly, that a package ships learns to move: models of dm-control, with what they sense as streams.

AURORA senses where the body goes, and which parts of it touch something, at ten moments of an episode, and learns from both how
movements differ. Only the models of the package are used, so that it needs none of what it depends on; they are loaded from
where it is installed.

    pip install ".[robots]" && pip install --no-deps dm-control
    python examples/animals.py             # the dog: 40 generations of 50, some minutes
    python examples/animals.py 20 fly      # a fruit fly on its six legs: longer

Writes the run folder `runs/dog`, with figures, and a video where MuJoCo can draw.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv

import auroraqd
from auroraqd.report import film, write_figures

FLY = "locomotion/walkers/assets/build_fruitfly"
MODELS = {"dog": "suite/dog.xml", "fly": f"{FLY}/fruitfly.xml"}
SKIP = {"dog": 4, "fly": 50}  # steps of the physics in one of control
STEPS = {"dog": 100, "fly": 100}  # two seconds, and half a second
MOVES = {"dog": "", "fly": ("coxa", "femur", "tibia")}  # how the names of actuators begin that are moved
BELOW = 0.13  # cm, how far the floor is below the middle of a fly that stands


class Animal(MujocoEnv):
    """An animal of dm-control."""

    metadata = {"render_modes": ["rgb_array"]}

    def __init__(self, animal, **options):
        package = find_spec("dm_control")
        if package is None or package.origin is None:
            raise ValueError("dm-control is not installed: pip install --no-deps dm-control")
        self.animal = animal
        super().__init__(str(Path(package.origin).parent / MODELS[animal]), SKIP[animal], None, **options)
        if self.model.nkey:
            self.init_qpos = self.model.key(0).qpos.copy()
        if animal == "fly":
            self.init_qpos[2] = BELOW
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(self._get_obs()),))

    def _initialize_simulation(self):
        spec = mujoco.MjSpec.from_file(self.fullpath)
        if self.animal == "fly":
            spec.meshdir = "assets"
            spec.option.timestep = 2e-4
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], rgba=[0.8, 0.8, 0.8, 1])
        model = spec.compile()
        return model, mujoco.MjData(model)

    def _get_obs(self):
        return np.concatenate([self.data.qpos[2:], self.data.qvel])

    def reset_model(self):
        """It stands."""
        self.set_state(self.init_qpos, self.init_qvel)
        return self._get_obs()

    def step(self, action):
        """The reward is how far it goes forwards."""
        before = self.data.qpos[0]
        self.do_simulation(action, self.frame_skip)
        return self._get_obs(), self.data.qpos[0] - before, False, False, {}


class Some:
    """An open-loop controller that moves some actuators by sinusoids, and leaves the others in the middle of their range."""

    def __init__(self, moved, waves):
        self.moved, self.waves = moved, waves

    def n_genes(self, actuators):
        """Of those that move."""
        return self.waves.n_genes(len(self.moved))

    def __call__(self, genotypes, actuators, time):
        """Controls in [-1, 1]."""
        controls = np.zeros((len(genotypes), len(time), actuators))
        controls[..., self.moved] = self.waves(genotypes, len(self.moved), time)
        return controls


gymnasium.register("Animal-v0", entry_point=Animal)


def main(generations=40, animal="dog"):
    try:
        model = gymnasium.make("Animal-v0", animal=animal).unwrapped.model
    except ValueError as error:
        sys.exit(str(error))
    names = [model.actuator(index).name for index in range(model.nu)]
    moved = [index for index, name in enumerate(names) if name.startswith(MOVES[animal])]
    fastest = 2.0 if animal == "dog" else 15.0  # Hz
    task = auroraqd.tasks.Gym(
        "Animal-v0",
        controller=Some(moved, auroraqd.tasks.Sinusoids(fastest / 4, fastest)),
        steps=STEPS[animal],
        samples=10,
        observe={"way": "positions", "touch": "contacts"},
        options={"animal": animal},
    )
    aurora = auroraqd.Aurora(
        task.n_genes,
        auroraqd.AutoEncoder(n_components=3),
        batch_size=50 if animal == "dog" else 20,
        selection=auroraqd.Uniform(),
        variation=auroraqd.IsoLine(0.02, 0.2),
        resolution=auroraqd.Size(500),
        schedule=auroraqd.Doubling(10),
        seed=0,
    )
    folder = f"runs/{animal}"
    aurora.run(task, generations=int(generations))
    auroraqd.save(aurora, folder)
    repertoire = auroraqd.load(folder)
    write_figures(folder)
    distance = np.linalg.norm(repertoire.ground_truth, axis=1)
    unit = "m" if animal == "dog" else "cm"
    print(f"{len(repertoire)} individuals of {animal}, {len(moved)} actuators, the farthest goes {distance.max():.2f} {unit}")
    try:
        film(task, repertoire.genotype[repertoire.sample(4)], f"{folder}/figures/skills.gif")
    except ValueError as error:  # no library to draw with
        print(error)


if __name__ == "__main__":
    main(*sys.argv[1:])
