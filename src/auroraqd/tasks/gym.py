"""Robots of Gymnasium, Ant-v5 or CartPole-v1 for instance, moved by controllers. Needs the extra `robots`."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from auroraqd._checks import flag, instance, numbers, seeds_for, shown, whole, whole_numbers
from auroraqd.observations import joined as streams
from auroraqd.tasks import Evaluation
from auroraqd.tasks._environments import Environments
from auroraqd.tasks._episodes import MOST_BYTES as _MOST_BYTES
from auroraqd.tasks._episodes import Episode, Rollout, Seeds, joined, stepped, threads, threads_that_step
from auroraqd.tasks._sensing import Camera, Sense, Senses
from auroraqd.tasks.controllers import ClosedLoop, OpenLoop, Sinusoids, is_closed_loop

_MOST_STEPS, _MOST_THREADS = 10**7, 10_000
_SIDE_BY_SIDE = 16  # environments that a thread steps; with more of them, each step is no faster


@dataclass
class Gym:
    """A task of an environment of Gymnasium.

    Observations are what is chosen at `samples` moments, (n, samples, chosen); the ground truth is the last of them,
    (n, chosen). A camera's are pictures, (n, height, width, channels) uint8. Several things are streams, each in its own shape
    and dtype. The ground truth of robots of MuJoCo is then their last `positions`; of others there is none. An individual whose
    simulation diverges, or whose controller returns a NaN, is invalid.

    The task chooses how to simulate. What an open-loop controller does with a robot of MuJoCo is computed by MuJoCo's own
    multi-threaded rollout, of whole batches, when nothing asks for more than positions and velocities, and the environment's
    own step is seen to do the same. All else steps environments, side by side. Two things differ then: an episode ends when the
    environment terminates it (a robot that has fallen, for instance), and stays as it was last; and of what a step costs only
    MuJoCo's part is done by several threads, so that more is to be had from processes, `auroraqd.evaluate.over`.

    Args:
        env_id: of Gymnasium.
        controller: open-loop or closed-loop; see `auroraqd.tasks.controllers` for what one must do.
        steps: of control, an episode; the environment's own limit does not count.
        samples: moments that are observed, evenly spaced, the last at the end.
        positions: which of MuJoCo's qpos are observed; the first two are often the torso's place in the world, and the default.
        observe: what is observed instead: numbers of entries of the environment's own observation, flattened; "observation",
            all of it; the name of a stream of one that is a Dict; of robots of MuJoCo also "camera", or a `Camera`,
            "positions", "velocities", and "contacts", which bodies touch something. A list of names, or a dictionary of these
            by names of your own, are streams. Of environments that are not MuJoCo's, all that they sense by default.
        fitness: from an `Episode` to (n,), of which MuJoCo's rollout leaves reward and observation out; or "return", the sum of
            the environment's own rewards; None: 0, only explore.
        noisy: begin as the environment does, with its noise, of a seed for each individual; the task is then called as
            `task(genotypes, seeds)`. Otherwise robots of MuJoCo begin in their initial state without noise, and others as they
            do with seed 0.
        modify: changes the model of MuJoCo after it is loaded, in place, a damaged robot for instance. Workers need a function
            of a module.
        threads: that simulate robots of MuJoCo; what they find is the same bit for bit. By default one for each core, or
            OMP_NUM_THREADS, which is 1 in workers, if that is less. Environments that are stepped and not Gymnasium's own get
            one, unless you ask for more, which they must not mind: one must share nothing with another that changes.
        options: of the environment, as `gymnasium.make` takes them.

    Attributes:
        n_genes: of the controller, for this robot.

    Raises:
        ValueError: the extra is not installed, there is no such environment, it has not what is asked for, or an argument is
            out of range.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Gym("CartPole-v1", controller=auroraqd.tasks.MLP(hidden=()), steps=20, samples=5)
        >>> task([[0.5] * task.n_genes]).observation.shape
        (1, 5, 4)
    """

    env_id: str
    controller: OpenLoop | ClosedLoop = field(default_factory=Sinusoids)
    steps: int = 200
    samples: int = 20
    positions: Sequence[int] | None = None
    observe: Sequence[int] | Sequence[str] | Camera | Mapping[str, Any] | str | None = None
    fitness: Callable[[Episode], np.ndarray] | Literal["return"] | None = None
    noisy: bool = False
    modify: Callable[[Any], object] | None = None
    threads: int | None = None
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        instance("env_id", self.env_id, str, "the name of an environment")
        whole("steps", self.steps, most=_MOST_STEPS)
        whole("samples", self.samples, most=self.steps)
        if self.threads is not None:
            whole("threads", self.threads, most=_MOST_THREADS)
        if not (self.fitness is None or callable(self.fitness) or (isinstance(self.fitness, str) and self.fitness == "return")):
            raise ValueError(f'fitness must be a function of an Episode, "return" or None, got {shown(self.fitness)}')
        if self.modify is not None and not callable(self.modify):
            raise ValueError(f"modify must be a function that changes a model of MuJoCo, got {shown(self.modify)}")
        if self.positions is not None:
            whole_numbers("positions", self.positions, axes=1)
        if not isinstance(self.options, dict):
            raise ValueError(f"options must be a dictionary, as gymnasium.make takes them, got {shown(self.options)}")
        flag("noisy", self.noisy)
        if self.positions is not None and not (self.observe is None or self._at_large):
            raise ValueError("positions and observe are two ways to say what is observed: give one of them")
        self._open()

    def __getstate__(self) -> dict[str, Any]:
        made = ("_environments", "_rollout", "_threads", "_lock", "_senses", "_streams", "_truth")
        return {name: value for name, value in self.__dict__.items() if name not in made}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._open()

    @property
    def _at_large(self) -> bool:
        """Whether what is observed is no choice of entries, of which the last are the ground truth."""
        return isinstance(self.observe, Mapping | Camera | str) or _names(self.observe)

    def _open(self) -> None:
        closed = is_closed_loop(self.controller)
        self._lock = threading.Lock()  # a worker of many threads has one task
        self._environments = Environments(self.env_id, self.options, self.modify)
        self.__name__ = self.env_id
        self._sense(Senses(self._environments, self.env_id, self.steps, self.samples, self.positions))
        actuators = self._environments.actuators
        sizes = (self._environments.observations, actuators) if closed else (actuators,)
        self.n_genes: int = whole("n_genes of the controller", self.controller.n_genes(*sizes))
        self._rollout, self._threads = None, threads_that_step(self._environments, self.threads)
        by_steps = closed or self.fitness == "return" or any(s.column == "observation" for s in self._senses.values())
        if not (by_steps or self.model is None or "max_episode_steps" in self.options):
            rollout = Rollout(self._environments, self.threads or threads())
            self._rollout = rollout if rollout.agrees() else None

    def _sense(self, senses: Senses) -> None:
        """See to what is observed, and what is the ground truth."""
        wanted: Any = self.observe
        if wanted is None:
            of_mujoco, names = self.model is not None, list(self._environments.streams)
            wanted = "positions" if of_mujoco else names or "observation"
        if _names(wanted):
            if len(set(wanted)) < len(wanted):
                raise ValueError(f"observe must name each stream once, got {shown(list(wanted))}")
            wanted = {name: name for name in wanted}
        found = senses.several(wanted) if isinstance(wanted, Mapping) else senses.one("observe", wanted)
        self._streams = isinstance(found, dict)
        self._senses: dict[str, Sense] = found if isinstance(found, dict) else {"": found}
        self._truth: Sense | None = None
        if self._at_large:
            self._truth = None if self.model is None else senses.positions()
        elif not isinstance(found, dict):
            self._truth = found

    @property
    def seeded(self) -> bool:
        """Whether it is called with seeds."""
        return self.noisy

    @property
    def interval(self) -> float:
        """Seconds of a step of control."""
        return self._environments.interval

    @property
    def model(self) -> Any:
        """MuJoCo's model of the robot, modified if it is; None if it is not of MuJoCo."""
        return self._environments.model

    def __call__(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> Evaluation:
        """The evaluation of genotypes, (n, n_genes), with seeds (n,), whole numbers, if it is noisy.

        Raises:
            ValueError: no genotypes, another number of genes, seeds that are missing or too many, or a controller or fitness
                that returns another shape than it must.
        """
        parts = [self._evaluation(episode) for episode in self._episodes(genotypes, seeds)]
        columns = zip(*parts, strict=True)
        return Evaluation(*(None if column[0] is None else np.concatenate(column) for column in columns))

    def episode(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> Episode:
        """All that robots do with these genotypes, (n, n_genes), with seeds (n,) if it is noisy.

        Raises:
            ValueError: as when it is called.
        """
        return joined(list(self._episodes(genotypes, seeds)))

    def _episodes(self, genotypes: np.ndarray, seeds: np.ndarray | None) -> Iterator[Episode]:
        """As many at once as fit."""
        genotypes = numbers(f"genotypes of {self.env_id}", genotypes, f" of shape (n, {self.n_genes})")
        if genotypes.ndim != 2 or genotypes.shape[1] != self.n_genes:
            raise ValueError(f"genotypes of {self.env_id} must have shape (n, {self.n_genes}), got {genotypes.shape}")
        if len(genotypes) == 0:
            raise ValueError("there must be at least one genotype")
        if not self.noisy and seeds is not None:
            raise ValueError(f"seeds are for noisy=True, and {self.env_id} was made without")
        each: Seeds = [None] * len(genotypes)
        if self.noisy:
            each = [int(seed) for seed in seeds_for(f"seeds of {self.env_id}, which is noisy,", seeds, len(genotypes))]
        if self._rollout is not None:
            rows = _MOST_BYTES // self._rollout.bytes(self.steps)
        else:
            rows = min(_MOST_BYTES // (8 * self.steps * self._environments.observations), _SIDE_BY_SIDE * self._threads)
        rows = max(rows, 1)
        for start in range(0, len(genotypes), rows):
            with self._lock:
                episode = self._simulated(genotypes[start : start + rows], each[start : start + rows])
            yield episode

    def _simulated(self, genotypes: np.ndarray, seeds: Seeds) -> Episode:
        actuators = self._environments.actuators
        if is_closed_loop(self.controller):
            policy = self.controller.policy(genotypes, self._environments.observations, actuators)
            if not callable(policy):
                raise ValueError(f"the policy of the controller must be a function of what is sensed, got {shown(policy)}")
            return self._stepped(lambda step, sensed: policy(sensed), seeds)
        controller: Any = self.controller
        controls = numbers("controls", controller(genotypes, actuators, self.interval * np.arange(self.steps)))
        wanted = (len(genotypes), self.steps, actuators)
        if controls.shape != wanted:
            raise ValueError(f"the controller must return shape {wanted}, got {controls.shape}")
        if self._rollout is not None:
            return self._rollout(controls, seeds)
        return self._stepped(lambda step, sensed: controls[:, step], seeds)

    def _stepped(self, controller: Callable[[int, np.ndarray], np.ndarray], seeds: Seeds) -> Episode:
        return stepped(self._environments, controller, self.steps, seeds, self._threads)

    def _evaluation(self, episode: Episode) -> Evaluation:
        n = len(episode.length)
        if self.fitness is None:
            fitness = np.zeros(n)
        elif callable(self.fitness):
            fitness = self._fitness(self.fitness, episode)
        else:
            fitness = episode.reward.sum(axis=1)
        if fitness.shape != (n,):
            raise ValueError(f"fitness must return shape ({n},), got {fitness.shape}")
        valid = np.logical_and.reduce([sense.valid(episode) for sense in self._senses.values()])  # whole numbers cannot say
        seen = {name: sense(episode) for name, sense in self._senses.items()}
        observation = streams(seen) if self._streams else next(iter(seen.values()))
        truth = None if self._truth is None else self._truth(episode)[:, -1]
        return Evaluation(np.where(valid, fitness, np.nan), observation, truth)

    def _fitness(self, function: Callable[[Episode], np.ndarray], episode: Episode) -> np.ndarray:
        """What a function makes of an episode, with a hint if it may have asked for what the episode does not have."""
        missing = [name for name in ("qpos", "qvel", "observation", "reward") if getattr(episode, name) is None]
        hint = f"; an episode of {self.env_id} has no {' and no '.join(missing)} here" if missing else ""
        if "reward" in missing:
            hint += (
                ', for MuJoCo\'s rollout knows none: write fitness="return" for the sum of rewards, or '
                f'options={{"max_episode_steps": {self.steps}}}, with which the environment is stepped'
            )
        try:
            returned = function(episode)
        except (AttributeError, TypeError, ValueError, IndexError) as error:  # what None leads to
            if not missing or not ("None" in str(error) or isinstance(error, np.exceptions.AxisError)):
                raise
            raise ValueError(f"fitness raised {type(error).__name__}: {error}{hint}") from error
        try:
            return numbers("what fitness returns", returned)
        except ValueError as error:
            raise ValueError(f"{error}{hint * ('None' in str(error))}") from None


def _names(chosen: Any) -> bool:
    """Whether they are names of streams, one at least."""
    several = isinstance(chosen, Sequence) and not isinstance(chosen, str | bytes)
    return several and len(chosen) > 0 and all(isinstance(name, str) for name in chosen)
