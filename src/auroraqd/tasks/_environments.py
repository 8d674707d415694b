"""Environments of Gymnasium, as a task needs them: made when wanted, begun where wanted, with controls in [-1, 1]."""

import logging
import os
import re
import sys
from collections.abc import Callable
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

_SEEDS = 1 << 31  # environments take seeds of 31 bits
_log = logging.getLogger("auroraqd")
_said: set[str] = set()


class Part(NamedTuple):
    """Of flat observations, (..., observations).

    Attributes:
        entries: where it is.
        shape, dtype: of it alone.
    """

    entries: slice
    shape: tuple[int, ...]
    dtype: np.dtype

    def of(self, flat: np.ndarray) -> np.ndarray:
        """(..., *shape), where NaN is 0 if it can be none."""
        rows = flat[..., self.entries].reshape(*flat.shape[:-1], *self.shape)
        return (rows if self.dtype.kind == "f" else np.nan_to_num(rows)).astype(self.dtype)


class Environments:
    """Environments of one kind.

    Args:
        env_id, options: as `gymnasium.make` takes them.
        modify: changes the model of each, of MuJoCo.

    Attributes:
        model: MuJoCo's, or None.
        actuators: controls of a step.
        interval: seconds of a step.
    """

    def __init__(self, env_id: str, options: dict[str, Any], modify: Callable[[Any], object] | None):
        try:
            self._gymnasium, self._mujoco = map(import_module, ("gymnasium", "mujoco"))
        except ImportError:
            raise ValueError('Gymnasium and MuJoCo are not installed: pip install "auroraqd[robots]"') from None
        keep_from_writing(self._mujoco)
        if options.get("render_mode") == "human" and not _display():  # MuJoCo's windows would end this process
            raise ValueError(
                f"options of {env_id} must leave render_mode out, for 'human' opens windows and there is no display; "
                "`auroraqd animate` and `auroraqd.report.film` draw robots without one"
            )
        self._recipe = env_id, options, modify
        self._made = [self._make()]
        self.first = self._made[0]
        self.model: Any = getattr(self.first.unwrapped, "model", None) if self._of_mujoco() else None
        self.interval = self._interval()
        self._space = self.first.action_space
        self.actuators = self._actuators()

    def __call__(self, n: int) -> list[Any]:
        """The first n."""
        while len(self._made) < n:
            self._made.append(self._make())
        return self._made[:n]

    @cached_property
    def observations(self) -> int:
        """Numbers that a robot senses.

        Raises:
            ValueError: they are not always as many.
        """
        try:
            return int(self._gymnasium.spaces.flatdim(self.first.observation_space))
        except (NotImplementedError, ValueError):
            raise ValueError(f"observations of {self._recipe[0]} are not always as many numbers, which they must be") from None

    @property
    def streams(self) -> dict[str, Part]:
        """The parts of an observation that is a Dict, by name; of others none."""
        spaces, parts, start = self._gymnasium.spaces, {}, 0
        if not isinstance(self.first.observation_space, spaces.Dict):
            return {}
        for name, space in self.first.observation_space.spaces.items():
            stop = start + int(spaces.flatdim(space))
            plain = isinstance(space, spaces.Box | spaces.MultiBinary)  # others are flattened, numbers one-hot
            shape, dtype = (space.shape, space.dtype) if plain else ((stop - start,), np.dtype(np.float64))
            parts[name] = Part(slice(start, stop), tuple(map(int, shape)), dtype)
            start = stop
        return parts

    @property
    def gymnasiums_own(self) -> bool:
        """Whether they, and all that wraps them, are of Gymnasium."""
        layers = [self.first]
        while layers[-1] is not layers[-1].unwrapped:
            layers.append(layers[-1].env)
        return all(type(layer).__module__.startswith("gymnasium.") for layer in layers)

    def begin(self, env: Any, seed: int | None) -> np.ndarray:
        """Begin an episode, with the environment's own noise of this seed or, if None, without; return the observation."""
        sensed, _ = env.reset(seed=0 if seed is None else seed % _SEEDS)
        if seed is None and self.model is not None:
            inner = env.unwrapped
            self._mujoco.mj_resetData(inner.model, inner.data)
            inner.set_state(inner.init_qpos, inner.init_qvel)
            sensed = inner._get_obs()  # no public name, and all of Gymnasium's own have it
        return self.flat(sensed)

    def flat(self, sensed: Any) -> np.ndarray:
        """An observation of the environment as (observations,).

        Raises:
            ValueError: it is of another size than its space.
        """
        flat = self._gymnasium.spaces.flatten(self.first.observation_space, sensed)
        if flat.shape != (self.observations,):
            raise ValueError(
                f"observations of {self._recipe[0]} must be {self.observations} numbers, as its observation_space says, "
                f"got {flat.size}"
            )
        return flat

    def actions(self, controls: np.ndarray) -> np.ndarray:
        """Controls in [-1, 1], (..., actuators), as actions of the environment, (..., *its shape), of its dtype."""
        if isinstance(self._space, self._gymnasium.spaces.Discrete):
            return self._space.start + controls.argmax(axis=-1)
        low, high = self._space.low, self._space.high
        controls = np.clip(controls, -1, 1).reshape(controls.shape[:-1] + low.shape)
        return (low + (controls + 1) / 2 * (high - low)).astype(self._space.dtype)

    def finite(self, controls: np.ndarray) -> np.ndarray:
        """Where all controls of a step are finite, (...), of (..., actuators). If some are not, that is said once."""
        finite = np.asarray(np.isfinite(controls).all(axis=-1))
        if not finite.all():
            of = f"the controller of {self._recipe[0]}"
            _say_once(logging.WARNING, f"{of} returned NaN or infinity: individuals for which it does are invalid")
        return finite

    def diverged(self, env: Any) -> bool:
        """Whether the simulation has, since the episode began. MuJoCo then begins anew, and counts it."""
        if self.model is None:
            return False
        kinds = self._mujoco.mjtWarning
        warning = env.unwrapped.data.warning
        return any(warning[kind].number for kind in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC))

    def _make(self) -> Any:
        env_id, options, modify = self._recipe
        try:  # an episode is as long as the task says, so without a limit of the environment's own
            env = self._gymnasium.make(env_id, **{"max_episode_steps": -1, "disable_env_checker": True, **options})
        except (
            self._gymnasium.error.Error,
            TypeError,
            ValueError,
            OSError,
            ImportError,
            AttributeError,
            ArithmeticError,
        ) as error:
            raise ValueError(f"env_id {env_id!r} cannot be made: {error}") from None
        if modify is not None:
            if not self._of_mujoco(env):
                raise ValueError(f"modify changes a model of MuJoCo, and env_id {env_id!r} has none")
            try:
                modify(env.unwrapped.model)
            except Exception as error:
                raise ValueError(f"modify raised {type(error).__name__} for {env_id}: {error}") from error
        return env

    def _of_mujoco(self, env: Any = None) -> bool:
        inner = (env or self.first).unwrapped
        wanted = "model", "data", "frame_skip", "init_qpos", "init_qvel", "set_state", "_get_obs"
        return all(hasattr(inner, name) for name in wanted) and isinstance(inner.model, self._mujoco.MjModel)

    def _interval(self) -> float:
        inner = self.first.unwrapped
        if self.model is not None:
            return float(self.model.opt.timestep * inner.frame_skip)
        seconds = getattr(inner, "dt", None) or getattr(inner, "tau", None)
        return float(seconds or 1 / (inner.metadata.get("render_fps") or 1))

    def _actuators(self) -> int:
        spaces = self._gymnasium.spaces
        if isinstance(self._space, spaces.Discrete):
            return int(self._space.n)
        if isinstance(self._space, spaces.Box) and self._space.is_bounded() and self._space.dtype.kind == "f":
            if not (self._space.high > self._space.low).all():
                raise ValueError(f"actions of {self._recipe[0]} must have a range to move in (ctrlrange), got {self._space}")
            return int(np.prod(self._space.shape))
        raise ValueError(f"actions of {self._recipe[0]} must be discrete, or numbers with bounds, got {self._space}")


def _display() -> bool:
    """Whether windows can be opened. Where it is not Linux, there is a display."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def keep_from_writing(mujoco: Any) -> None:
    """MuJoCo writes its warnings to a file in the current folder, unless someone listens."""
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_heard)


def _heard(warning: str) -> None:
    level = logging.DEBUG if "deprecated" in warning else logging.WARNING  # of Gymnasium's own models
    _say_once(level, f"MuJoCo: {warning}")


def _say_once(level: int, message: str) -> None:
    kind = re.sub(r"\d", "", message)  # the joint, and the time
    if kind not in _said:
        _said.add(kind)
        _log.log(level, "%s (said once)", message)
