"""A hexapod: a walking robot of six legs and 18 servos, whole or damaged, in MuJoCo. Needs the extra `robots`.

Robot, controller, fitness and hand-coded descriptor are those of [1]; what is ours is said in `auroraqd.tasks._hexapod_model`.
As in the code of [1], an individual is invalid whose torso touches the floor, or turns over.

[1] A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.
"""

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from auroraqd import tasks
from auroraqd._checks import check_genotypes, number, numbers, shown, whole
from auroraqd.observations import joined as streams
from auroraqd.tasks._environments import keep_from_writing
from auroraqd.tasks._episodes import MOST_BYTES, Episode, Simulator, joined, threads
from auroraqd.tasks._hexapod_model import LEGS, SERVOS, TIMESTEP, Damage, compiled
from auroraqd.tasks._sensing import Camera, Pictures, Sense, moments
from auroraqd.tasks.controllers import OpenLoop, SquareWaves, is_closed_loop

DAMAGES = {
    "rear-leg-gone": Damage(gone=(0,)),
    "middle-leg-gone": Damage(gone=(1,)),
    "front-leg-gone": Damage(gone=(2,)),
    "two-legs-gone": Damage(gone=(1, 5)),
    "leg-short": Damage(short=(4,)),
    "leg-limp": Damage(limp=(4,)),
    "leg-stuck": Damage(stuck=(2,)),
    "weak-motors": Damage(torque=0.3),
    "slope": Damage(slope=10.0),
    "slippery": Damage(friction=0.2),
}
"""Damages by name."""

INTERVAL = 0.015  # s, of control [1]
_SKIP = round(INTERVAL / TIMESTEP)
_STANDING = 1.0  # s, before an episode begins
_WORDS = ("contacts", "path", "joints", "camera")
_LONGEST = 1000.0  # s
_CONTROLLER = SquareWaves()
_MOST_THREADS = 10_000


@dataclass(frozen=True)
class Hexapod:
    """A robot of six legs that walks, or tries to.

    36 genes, of `SquareWaves`. Called with genotypes, (n, 36) in [0, 1], it returns an `Evaluation`:

    - fitness (n,): the speed forwards, in m/s, over the whole episode;
    - observation: what is chosen, at `samples` moments, evenly spaced, the last at the end;
    - ground_truth (n, 6): the share of the time for which each foot touches the floor, 0 for a leg that is gone.

    Individuals whose torso touches the floor, or turns over, or whose simulation diverges, are invalid.

    Args:
        observe: "contacts", which feet touch the floor, (n, samples, 6) bool; "path", x and y of the torso in metres,
            (n, samples, 2); "joints", their angles in rad, (n, samples, 18); "camera", or a `Camera`, pictures. Several names
            are streams.
        damage: a `Damage`, or a name of `auroraqd.tasks.DAMAGES`.
        seconds: of an episode.
        samples: moments that are observed.
        controller: open-loop, of 18 actuators: of each leg in turn, from the torso outwards.
        threads: that simulate; by default one for each core, or OMP_NUM_THREADS, which is 1 in workers, if that is less.

    Raises:
        ValueError: the extra is not installed, or an argument is out of range; genotypes has the wrong shape, or leaves [0, 1].

    Examples:
        >>> import auroraqd
        >>> hexapod = auroraqd.tasks.Hexapod(seconds=0.3, samples=4)
        >>> standing = hexapod([[0.0] * 36])  # amplitudes of 0
        >>> standing.observation.shape, standing.ground_truth
        ((1, 4, 6), array([[1., 1., 1., 1., 1., 1.]]))
        >>> auroraqd.tasks.Hexapod(damage="middle-leg-gone", seconds=0.3, samples=4)([[0.0] * 36]).ground_truth
        array([[1., 0., 1., 1., 1., 1.]])
    """

    observe: str | Sequence[str] | Camera = "contacts"
    damage: Damage | str | None = None
    seconds: float = 3.0
    samples: int = 30
    controller: OpenLoop = _CONTROLLER
    threads: int | None = None

    seeded: ClassVar[bool] = False

    def __post_init__(self) -> None:
        number("seconds", self.seconds, least=INTERVAL, most=_LONGEST, wanted=f"from {INTERVAL:g} to {_LONGEST:g}")
        whole("samples", self.samples, most=self.steps)
        if self.threads is not None:
            whole("threads", self.threads, most=_MOST_THREADS)
        if is_closed_loop(self.controller):
            raise ValueError(f"controller of a hexapod must be open-loop, for it senses nothing, got {shown(self.controller)}")
        _ = self._wrong, self.n_genes, self._senses  # or what is wrong would be said later

    def __repr__(self) -> str:
        given = [(f.name, getattr(self, f.name)) for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Hexapod({', '.join(f'{name}={value!r}' for name, value in given)})"

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def n_genes(self) -> int:
        """Genes of a controller."""
        return whole("n_genes of the controller", self.controller.n_genes(LEGS * SERVOS))

    @property
    def steps(self) -> int:
        """Of control, an episode."""
        return max(round(self.seconds / INTERVAL), 1)

    @property
    def interval(self) -> float:
        """Seconds of a step of control."""
        return INTERVAL

    @property
    def model(self) -> Any:
        """MuJoCo's model of the robot, damaged if it is."""
        return self._body.model

    def __call__(self, genotypes: np.ndarray) -> "tasks.Evaluation":
        """See the class."""
        return self.carried(genotypes)[0]

    def carried(self, genotypes: np.ndarray, state: np.ndarray | None = None) -> tuple["tasks.Evaluation", np.ndarray]:
        """Go on from the states in which others left the robots, for `Hierarchical`.

        Args:
            genotypes: (n, 36).
            state: (n, size), as this method returned it; None: they stand where they begin.

        Returns:
            What they do, speeds of this part, paths where the robots are; and the states they are in then, (n, size), NaN of
            those that are invalid, and stay it. MuJoCo's solver begins anew, by which two parts end some millimetres from where
            one of twice the length does.

        Raises:
            ValueError: as when it is called; the states have another shape.
        """
        evaluations, states = [], []
        for episode, begun, after in self._parts(genotypes, state):
            evaluation = self._evaluation(episode, begun)
            after[np.isnan(evaluation.fitness)] = np.nan
            evaluations.append(evaluation)
            states.append(after)
        return tasks.Evaluation(*map(np.concatenate, zip(*evaluations, strict=True))), np.concatenate(states)

    def episode(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> Episode:
        """All that robots do with these genotypes, (n, 36). Its sensors are how the torso, and then each leg, presses on the
        floor, in N. There is no noise: seeds are not used.
        """
        return joined([episode for episode, *_ in self._parts(genotypes, None)])

    @cached_property
    def _wrong(self) -> Damage:
        if isinstance(self.damage, str) and self.damage in DAMAGES:
            return DAMAGES[self.damage]
        if isinstance(self.damage, Damage | None):
            return self.damage or Damage()
        raise ValueError(f"damage must be an auroraqd.tasks.Damage, or one of {', '.join(DAMAGES)}, got {shown(self.damage)}")

    @cached_property
    def _body(self) -> "_Body":
        return _Body(self._wrong, self.threads or threads())

    @cached_property
    def _senses(self) -> dict[str, Sense]:
        """By name; of one alone, without streams, by ""."""
        wanted = self.observe
        if isinstance(wanted, str | Camera):
            return {"": self._sense(wanted)}
        if not isinstance(wanted, list | tuple) or not wanted or not all(isinstance(name, str) for name in wanted):
            raise ValueError(f"observe must be one of {', '.join(_WORDS)}, several of them, or a Camera, got {shown(wanted)}")
        if len(set(wanted)) < len(wanted):
            raise ValueError(f"observe must name each stream once, got {shown(list(wanted))}")
        return {name: self._sense(name) for name in wanted}

    def _sense(self, wanted: str | Camera) -> Sense:
        at = moments(self.steps, self.samples)
        if wanted == "contacts":
            return Sense("sensors", at, self._body.contacts)
        if wanted == "path":
            return Sense("qpos", at, lambda poses: poses[..., :2])
        if wanted == "joints":
            return Sense("qpos", at, self._body.angles)
        if isinstance(wanted, str) and wanted != "camera":
            raise ValueError(f"observe must be one of {', '.join(_WORDS)}, several of them, or a Camera, got {shown(wanted)}")
        camera = wanted if isinstance(wanted, Camera) else Camera()
        if camera.frames > self.steps:
            raise ValueError(f"frames of a camera must be at most {self.steps}, the steps of an episode, got {camera.frames}")
        pictures = Pictures(self.model, self._body.start, camera, "the hexapod")
        return Sense("qpos", moments(self.steps, camera.frames), pictures)

    def _parts(self, genotypes: np.ndarray, state: np.ndarray | None) -> Iterator[tuple[Episode, np.ndarray, np.ndarray]]:
        """Episodes, as many at once as fit, and the states in which they begin and end."""
        genotypes = numbers("genotypes", genotypes, f" of shape (n, {self.n_genes})", axes=2)
        check_genotypes("a hexapod must have", genotypes, (len(genotypes) or 1, self.n_genes))
        begun = self._body.standing(len(genotypes)) if state is None else numbers("state", state, axes=2)
        if begun.shape != (len(genotypes), self._body.size):
            raise ValueError(f"state must have shape {(len(genotypes), self._body.size)}, got {begun.shape}")
        rows = max(MOST_BYTES // self._body.bytes(self.steps), 1)
        time = INTERVAL * np.arange(self.steps)
        for start in range(0, len(genotypes), rows):
            part = genotypes[start : start + rows]
            controls = numbers("controls", self.controller(part, LEGS * SERVOS, time))
            wanted = (len(part), self.steps, LEGS * SERVOS)
            if controls.shape != wanted:
                raise ValueError(f"the controller must return shape {wanted}, got {controls.shape}")
            here = begun[start : start + rows]
            episode, after = self._body(controls, here)
            yield episode, here, after

    def _evaluation(self, episode: Episode, begun: np.ndarray) -> "tasks.Evaluation":
        forwards = episode.qpos[:, -1, 0] - begun[:, 1]  # after the clock
        fallen = self._body.fallen(episode)
        seen = {name: sense(episode) for name, sense in self._senses.items()}
        for stream in seen.values():
            if stream.dtype.kind == "f":
                stream[fallen] = np.nan
        touching = self._body.contacts(episode.sensors).mean(axis=1)
        touching[fallen] = np.nan
        fitness = np.where(fallen, np.nan, forwards / (INTERVAL * self.steps))
        return tasks.Evaluation(fitness, seen[""] if "" in seen else streams(seen), touching)


class _Body:
    """A robot that stands, ready to be simulated.

    Args:
        damage: of it.
        threads: that simulate it.

    Attributes:
        model: of MuJoCo.
        start: (nq,), how it stands.
        size: of a full state.

    Raises:
        ValueError: MuJoCo is not installed.
    """

    def __init__(self, damage: Damage, threads: int):
        try:
            mujoco: Any = import_module("mujoco")
        except ImportError:
            raise ValueError('MuJoCo is not installed: pip install "auroraqd[robots]"') from None
        keep_from_writing(mujoco)
        self.model = compiled(mujoco, damage)
        self._simulator = Simulator(self.model, _SKIP, threads)
        self._lock = threading.Lock()  # a worker of many threads has one task
        self._legs = np.array(damage.legs)
        self._stuck = [leg for leg in damage.legs if leg in damage.stuck]
        data = mujoco.MjData(self.model)
        mujoco.mj_step(self.model, data, round(_STANDING / TIMESTEP))
        data.time = 0
        self.start = data.qpos.copy()
        self._state, self._warm = self._simulator.state(data)
        self.size = len(self._state)

    def bytes(self, steps: int) -> int:
        """Of the states of an episode while it is simulated."""
        return self._simulator.bytes(steps)

    def standing(self, n: int) -> np.ndarray:
        """The states of robots that stand, (n, size)."""
        return np.repeat(self._state[None], n, axis=0)

    def __call__(self, controls: np.ndarray, begun: np.ndarray) -> tuple[Episode, np.ndarray]:
        """The episodes of controls in [-1, 1], (n, steps, 18), of all servos, those that are gone too, from states, (n, size);
        and the states in which they end. From states that are NaN, all is."""
        each = controls.reshape(*controls.shape[:2], LEGS, SERVOS).copy()
        each[:, :, self._stuck] = 0
        asked = each[:, :, self._legs].reshape(*controls.shape[:2], -1)
        there = np.asarray(np.isfinite(begun).all(axis=1))
        finite = np.asarray(np.isfinite(controls).all(axis=2)) & there[:, None]
        control = np.clip(np.where(finite[..., None], asked, 0), -1, 1) * self.model.actuator_ctrlrange[:, 1]
        start = np.where(there[:, None], begun, self._state)
        stands = np.asarray((start == self._state).all(axis=1))
        warm = np.where(stands[:, None], self._warm, 0)
        with self._lock:
            return self._simulator.carried(control, finite, start, warm)

    def contacts(self, sensors: np.ndarray) -> np.ndarray:
        """Which feet touch the floor, (n, moments, 6) bool."""
        touching = np.zeros((*sensors.shape[:2], LEGS), bool)
        touching[..., self._legs] = sensors[..., 1:] > 0
        return touching

    def angles(self, poses: np.ndarray) -> np.ndarray:
        """Of all joints, (n, moments, 18); of legs that are gone 0."""
        angles = np.zeros((*poses.shape[:2], LEGS, SERVOS))
        angles[:, :, self._legs] = poses[..., 7:].reshape(*poses.shape[:2], -1, SERVOS)
        return angles.reshape(*poses.shape[:2], -1)

    def fallen(self, episode: Episode) -> np.ndarray:
        """(n,) bool, whose torso touches the floor or turns over at some time, or who diverges."""
        x, y = episode.qpos[..., 4], episode.qpos[..., 5]  # of the quaternion
        upright = 1 - 2 * (x**2 + y**2) > 0  # the cosine of the angle to the vertical; false of NaN
        return ~(upright & (episode.sensors[..., 0] <= 0)).all(axis=1)
