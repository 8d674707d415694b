"""Episodes of robots, simulated in two ways with one outcome: MuJoCo's rollout, or the environments' own steps.

The rollout is multi-threaded, but knows neither the environment's reward and observation nor when it terminates. The steps of
environments are Python, which threads take in turn, around MuJoCo's physics, which run in all threads at once.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import numbers
from auroraqd._workers import cores
from auroraqd.tasks._environments import Environments

Seeds = Sequence[int | None]
"""Of each episode; None: without noise."""

MOST_BYTES = 1 << 28  # of states that are kept at once


class Episode(NamedTuple):
    """What n robots did, at each step of control.

    After an episode has terminated, positions, velocities and observation stay as they were last, and control and reward are
    0. From where a simulation diverges on, all is NaN.

    Attributes:
        time: (steps,) seconds, at the end of each step.
        control: (n, steps, actuators), in the units of the actuators; of discrete actions (n, steps), which was taken.
        length: (n,), steps until it terminated.
        qpos: (n, steps, nq), positions, as MuJoCo has them; None if it is not MuJoCo's.
        qvel: (n, steps, nv), velocities, likewise.
        observation: (n, steps, entries), the environment's own, flat; None in MuJoCo's rollout.
        reward: (n, steps), the environment's own; None in MuJoCo's rollout.
        sensors: (n, steps, entries), of the model, as MuJoCo has them; None if there are none, and of environments that are
            stepped.
    """

    time: np.ndarray
    control: np.ndarray
    length: np.ndarray
    qpos: Any = None
    qvel: Any = None
    observation: Any = None
    reward: Any = None
    sensors: Any = None


def joined(episodes: Sequence[Episode]) -> Episode:
    """The episodes of all, of equal time."""
    time, *columns = zip(*episodes, strict=True)
    every: list[Any] = [None if column[0] is None else np.concatenate(column) for column in columns]
    return Episode(time[0], *every)


def threads() -> int:
    """That simulate, if none are asked for: one for each core, or OMP_NUM_THREADS, which is 1 in workers, if that is less."""
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return min(len(cores()), max(int(limit), 1)) if limit.isdigit() else len(cores())


def threads_that_step(environments: Environments, asked: int | None) -> int:
    """Of environments: as many as are asked for. If none are, one, but for Gymnasium's own of MuJoCo, which share nothing."""
    if environments.model is None or environments.first.unwrapped.render_mode == "human":
        return 1  # Python alone gains nothing; a window is of one thread
    return asked or (threads() if environments.gymnasiums_own else 1)


class Simulator:
    """MuJoCo's multi-threaded rollout of a model, for controls that are known before.

    Args:
        model: of MuJoCo.
        skip: steps of the physics in one of control.
        threads: how many.
    """

    def __init__(self, model: Any, skip: int, threads: int):
        self._mujoco = import_module("mujoco")
        self._model, self._skip = model, skip
        self._datas = [self._mujoco.MjData(model) for _ in range(threads)]
        self._kind = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._size = self._mujoco.mj_stateSize(model, self._kind)

    def bytes(self, steps: int) -> int:
        """Of the states of an episode while it is simulated."""
        return 8 * steps * self._skip * (self._size + self._model.nu + self._model.nsensordata)

    def state(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """Where an episode may begin: the full state of a simulation (size,), and what its solver begins with (nv,)."""
        state = np.empty(self._size)
        self._mujoco.mj_getState(self._model, data, state, self._kind)
        return state, data.qacc_warmstart.copy()

    def __call__(self, control: np.ndarray, finite: np.ndarray, start: np.ndarray, warm: np.ndarray) -> Episode:
        """The episodes of controls, (n, steps, nu), in the units of the actuators.

        From where they are not `finite`, (n, steps) bool, all is NaN. They begin in states, (n, size), the solver at (n, nv).
        """
        return self.carried(control, finite, start, warm)[0]

    def carried(
        self, control: np.ndarray, finite: np.ndarray, start: np.ndarray, warm: np.ndarray
    ) -> tuple[Episode, np.ndarray]:
        """Likewise; and the states in which they end, (n, size)."""
        rollout = import_module("mujoco.rollout").rollout
        model, skip = self._model, self._skip
        interval = model.opt.timestep * skip
        states, sensors = rollout(model, self._datas, start, np.repeat(control, skip, axis=1), initial_warmstart=warm)
        states, sensors = states[:, skip - 1 :: skip], sensors[:, skip - 1 :: skip]
        n, steps = control.shape[:2]
        time = interval * np.arange(1, steps + 1)
        diverged = np.asarray(
            np.abs(states[:, :, 0] - start[:, :1] - time) > interval / 2
        )  # MuJoCo's clock begins anew when it does
        gone = np.logical_or.accumulate(diverged | ~finite, axis=1)
        states[gone], sensors[gone] = np.nan, np.nan
        qpos, qvel = states[..., 1 : 1 + model.nq], states[..., 1 + model.nq : 1 + model.nq + model.nv]
        episode = Episode(time, control, np.full(n, steps), qpos, qvel, sensors=sensors if model.nsensordata else None)
        return episode, states[:, -1].copy()


class Rollout:
    """Environments, simulated by MuJoCo's rollout.

    Args:
        environments: of MuJoCo.
        threads: how many.
    """

    def __init__(self, environments: Environments, threads: int):
        self._environments = environments
        self._simulator = Simulator(environments.model, int(environments.first.unwrapped.frame_skip), threads)

    def bytes(self, steps: int) -> int:
        """Of the states of an episode while it is simulated."""
        return self._simulator.bytes(steps)

    def __call__(self, controls: np.ndarray, seeds: Seeds) -> Episode:
        """The episodes of controls in [-1, 1], (n, steps, actuators)."""
        finite = self._environments.finite(controls)
        control = self._environments.actions(np.where(finite[..., None], controls, 0)).astype(np.float64)
        return self._simulator(control, finite, *self._starts(seeds))

    def agrees(self) -> bool:
        """Whether the environment's own step does with controls what the rollout does. Those of others may do more."""
        environments, env = self._environments, self._environments.first
        if env.action_space.shape != (environments.model.nu,):
            return False
        controls = np.random.default_rng(0).uniform(-1, 1, (1, 3, environments.model.nu))
        expected = stepped(environments, lambda step, _: controls[:, step], 3, [0])
        found = self(controls[:, : int(expected.length[0])], [0])
        last = expected.length[0] - 1
        return all(
            np.allclose(a[:, last], b[:, last], rtol=1e-6, atol=1e-8, equal_nan=True)
            for a, b in ((found.qpos, expected.qpos), (found.qvel, expected.qvel))
        )

    def _starts(self, seeds: Seeds) -> tuple[np.ndarray, np.ndarray]:
        """Full states (n, size), and what the solver begins with (n, nv)."""
        env, begun = self._environments.first, []
        for row, seed in enumerate(seeds):
            if row and seed is None:
                begun.append(begun[0])
                continue
            self._environments.begin(env, seed)
            begun.append(self._simulator.state(env.unwrapped.data))
        starts, warm = zip(*begun, strict=True)
        return np.array(starts), np.array(warm)


def stepped(
    environments: Environments,
    controller: Callable[[int, np.ndarray], np.ndarray],
    steps: int,
    seeds: Seeds,
    threads: int = 1,
) -> Episode:
    """The episodes of environments that are stepped side by side, so that a controller is asked once for all at each step.

    A plain loop over environments that have not ended, and not a vector environment of Gymnasium, which has a fixed number and
    goes on with those that have ended. Each environment does its own step, so that threads change nothing but the time it
    takes: MuJoCo's physics run beside each other, and what an environment computes in Python, in turn.

    Args:
        environments: to take them from.
        controller: from the step, and what n robots sense, (n, observations), to controls in [-1, 1], (n, actuators).
        steps: of an episode that does not terminate.
        seeds: n.
        threads: that step; more than one only where environments share nothing.

    Raises:
        ValueError: the controller returned another shape, or an environment an observation of another.
    """
    n, envs, model = len(seeds), environments(len(seeds)), environments.model
    sensed, state = np.empty((n, environments.observations)), np.empty((n, model.nq + model.nv if model else 0))
    for row, env in enumerate(envs):
        sensed[row] = environments.begin(env, seeds[row])
    observation, states = np.empty((n, steps, sensed.shape[1])), np.empty((n, steps, state.shape[1]))
    control = np.zeros_like(environments.actions(np.zeros((n, steps, environments.actuators))))
    reward, length = np.zeros((n, steps)), np.full(n, steps)
    going, finite, diverged = np.ones(n, bool), np.ones(n, bool), np.zeros(n, bool)

    def step_of(step: int, actions: np.ndarray, rows: np.ndarray) -> None:
        for row in rows:
            env = envs[row]
            found, reward[row, step], terminated, truncated, _ = env.step(actions[row])
            sensed[row] = environments.flat(found)
            if model:
                state[row, : model.nq], state[row, model.nq :] = env.unwrapped.data.qpos, env.unwrapped.data.qvel
            going[row], diverged[row] = not (terminated or truncated), environments.diverged(env)

    with _side_by_side(threads) as side_by_side:
        for step in range(steps):
            controls = numbers("controls", controller(step, sensed.copy()))
            if controls.shape != (n, environments.actuators):
                raise ValueError(f"the controller must return shape {(n, environments.actuators)}, got {controls.shape}")
            rows = np.flatnonzero(going)  # of others the controller may return a NaN, for what they sense may be one
            finite[rows] = environments.finite(controls[rows])
            actions = environments.actions(np.where(finite[:, None], controls, 0))
            side_by_side(partial(step_of, step, actions), rows)
            control[rows, step] = actions[rows]
            invalid = rows[~finite[rows] | diverged[rows] | ~np.isfinite(sensed[rows]).all(axis=1)]
            sensed[invalid], state[invalid], reward[invalid, step], going[invalid] = np.nan, np.nan, np.nan, False
            length[rows[~going[rows]]] = step + 1
            observation[:, step], states[:, step] = sensed, state
            if not going.any():
                observation[:, step:], states[:, step:] = sensed[:, None], state[:, None]
                break
    qpos, qvel = (states[..., : model.nq], states[..., model.nq :]) if model else (None, None)
    return Episode(environments.interval * np.arange(1, steps + 1), control, length, qpos, qvel, observation, reward)


@contextmanager
def _side_by_side(threads: int) -> Iterator[Callable[[Callable[[np.ndarray], None], np.ndarray], None]]:
    """What calls a function with rows, each thread with some, and returns when all are done."""
    if threads == 1:
        yield lambda function, rows: function(rows)
        return
    with ThreadPoolExecutor(threads) as pool:

        def each_its_own(function: Callable[[np.ndarray], None], rows: np.ndarray) -> None:
            for _ in pool.map(function, [rows[first::threads] for first in range(min(threads, len(rows)))]):
                pass

        yield each_its_own
