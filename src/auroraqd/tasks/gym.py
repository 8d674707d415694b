"""Robots of Gymnasium that MuJoCo simulates, moved by open-loop controllers: Ant, HalfCheetah, Swimmer, and others like them.

What an open-loop controller will do is known before it starts, so whole batches are given to MuJoCo's own multi-threaded
rollout. It computes the same states as stepping the environment does. Needs the extra `robots`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import number, whole
from auroraqd._workers import cores
from auroraqd.tasks import Evaluation

_MOST_BYTES = 1 << 28  # of states that are kept at once


@dataclass(frozen=True)
class Sinusoids:
    """An open-loop controller: each actuator follows a sine of its own amplitude, phase and offset, all of one frequency.

    Genes, in this order: amplitudes, phases and offsets of all actuators, and the frequency.

    Args:
        slowest, fastest: bounds of the frequency in Hz.
        offset: the largest, in half ranges of the actuators.
    """

    slowest: float = 0.5
    fastest: float = 2.0
    offset: float = 0.5

    def __post_init__(self) -> None:
        number("slowest", self.slowest)
        number("fastest", self.fastest, least=self.slowest, wanted="at least slowest")
        number("offset", self.offset)

    def n_genes(self, actuators: int) -> int:
        """For a robot with this many actuators."""
        return 3 * actuators + 1

    def __call__(self, genotypes: np.ndarray, actuators: int, time: np.ndarray) -> np.ndarray:
        """Controls in [-1, 1], (n, steps, actuators), of genotypes, (n, n_genes), at times in seconds, (steps,)."""
        amplitude, phase, offset = np.split(genotypes[:, None, : 3 * actuators], 3, axis=2)
        frequency = self.slowest + (self.fastest - self.slowest) * genotypes[:, -1]
        waves = np.sin(2 * np.pi * (frequency[:, None, None] * time[:, None] + phase))
        return np.clip(amplitude * waves + self.offset * (2 * offset - 1), -1, 1)


class Episode(NamedTuple):
    """What n robots did, at each step of control.

    Attributes:
        time: (steps,) seconds, at the end of each step.
        qpos: (n, steps, nq), positions, as MuJoCo has them.
        qvel: (n, steps, nv), velocities.
        control: (n, steps, actuators), in the units of the actuators.
    """

    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    control: np.ndarray


@dataclass
class Gym:
    """A task of a MuJoCo environment of Gymnasium. It begins in the environment's own initial state, without its noise.

    Observations are the chosen positions at `samples` moments, (n, samples, positions); the ground truth is where they end,
    (n, positions). An individual whose simulation diverges is invalid.

    Args:
        env_id: of Gymnasium, "Ant-v5" for instance.
        controller: an open-loop controller; see `Sinusoids` for what it must do.
        steps: of control, an episode.
        samples: moments that are observed, evenly spaced, the last at the end.
        positions: which of MuJoCo's qpos are observed; the first two are the torso's place in the world.
        fitness: from an `Episode` to (n,); None: 0, only explore.
        threads: of the rollout; by default one for each core.
        options: of the environment, as `gymnasium.make` takes them.

    Attributes:
        n_genes: of the controller, for this robot.

    Raises:
        ValueError: the extra is not installed, there is no such environment, it is not one of MuJoCo, or an argument is out of
            range.
    """

    env_id: str
    controller: Any = field(default_factory=Sinusoids)
    steps: int = 200
    samples: int = 20
    positions: Sequence[int] = (0, 1)
    fitness: Callable[[Episode], np.ndarray] | None = None
    threads: int | None = None
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        whole("steps", self.steps)
        whole("samples", self.samples, most=self.steps)
        if self.threads is not None:
            whole("threads", self.threads)
        self._open()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_env", "_datas", "_start")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._open()

    def _open(self) -> None:
        try:
            gymnasium, mujoco = map(import_module, ("gymnasium", "mujoco"))
        except ImportError:
            raise ValueError('Gymnasium and MuJoCo are not installed: pip install "auroraqd[robots]"') from None
        try:
            self._env: Any = gymnasium.make(self.env_id, **self.options).unwrapped
        except (gymnasium.error.Error, TypeError) as error:
            raise ValueError(f"env_id {self.env_id!r} cannot be made: {error}") from None
        if not hasattr(self._env, "model") or not hasattr(self._env, "frame_skip"):
            raise ValueError(f"env_id {self.env_id!r} is not an environment of MuJoCo")
        model = self._env.model
        wrong = [index for index in self.positions if not 0 <= index < model.nq]
        if wrong or not len(self.positions):
            raise ValueError(f"positions must be of 0 to {model.nq - 1} for {self.env_id}, got {list(self.positions)}")
        self._datas = [mujoco.MjData(model) for _ in range(self.threads or len(cores()))]
        data = self._datas[0]
        data.qpos[:], data.qvel[:] = self._env.init_qpos, self._env.init_qvel
        self._start = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, self._start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.__name__ = self.env_id
        self.n_genes = self.controller.n_genes(model.nu)

    @property
    def interval(self) -> float:
        """Seconds of a step of control."""
        return float(self._env.model.opt.timestep * self._env.frame_skip)

    def __call__(self, genotypes: np.ndarray) -> Evaluation:
        """The evaluation of genotypes, (n, n_genes).

        Raises:
            ValueError: another number of genes, or a controller or fitness that returns another shape than it must.
        """
        genotypes = np.asarray(genotypes, np.float64)
        if genotypes.ndim != 2 or genotypes.shape[1] != self.n_genes:
            raise ValueError(f"genotypes of {self.env_id} must have shape (n, {self.n_genes}), got {genotypes.shape}")
        row = self.steps * self._env.frame_skip * (len(self._start) + self._env.model.nu) * 8
        rows = max(_MOST_BYTES // row, 1)
        parts = [self._evaluated(genotypes[start : start + rows]) for start in range(0, max(len(genotypes), 1), rows)]
        return Evaluation(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def episode(self, genotypes: np.ndarray) -> Episode:
        """What robots do with these genotypes, (n, n_genes). From where a simulation diverges on all is NaN."""
        rollout = import_module("mujoco.rollout").rollout
        model, skip, n = self._env.model, self._env.frame_skip, len(genotypes)
        time = self.interval * np.arange(self.steps)
        control = np.asarray(self.controller(genotypes, model.nu, time), np.float64)
        if control.shape != (n, self.steps, model.nu):
            raise ValueError(f"the controller must return shape {(n, self.steps, model.nu)}, got {control.shape}")
        low, high = model.actuator_ctrlrange.T
        control = low + (control + 1) / 2 * (high - low)
        states, _ = rollout(model, self._datas, np.tile(self._start, (n, 1)), np.repeat(control, skip, axis=1))
        states = states[:, skip - 1 :: skip]
        ended = time + self.interval
        states[np.abs(states[:, :, 0] - ended) > self.interval / 2] = np.nan  # MuJoCo's clock stops when it diverges
        return Episode(ended, states[..., 1 : 1 + model.nq], states[..., 1 + model.nq : 1 + model.nq + model.nv], control)

    def _evaluated(self, genotypes: np.ndarray) -> Evaluation:
        episode = self.episode(genotypes)
        moments = np.linspace(0, self.steps, self.samples + 1)[1:].round().astype(int) - 1
        path = episode.qpos[:, moments][..., list(self.positions)]
        fitness = np.zeros(len(genotypes)) if self.fitness is None else np.asarray(self.fitness(episode), np.float64)
        if fitness.shape != (len(genotypes),):
            raise ValueError(f"fitness must return shape ({len(genotypes)},), got {fitness.shape}")
        return Evaluation(fitness, path, path[:, -1])
