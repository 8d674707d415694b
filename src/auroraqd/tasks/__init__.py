"""Tasks: what a robot does and senses when it is given genotypes.

A task is any callable from genotypes, (n, n_genes) in [0, 1], to an `Evaluation`, or to a tuple of fitness, observation
and, if known, ground truth, or to observations alone, (n, ...), which is to explore for its own sake. Observations may be a
mapping of several arrays, streams, each (n, ...): see `auroraqd.observations`. A row with a NaN or
an infinity in fitness or observation is an invalid individual: that is how a task reports a crash. A task with an attribute
`seeded` that is true is given a seed for each individual as well: see `auroraqd.tasks.noise`.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import numeric
from auroraqd.observations import observations, streams_of


class Evaluation(NamedTuple):
    """What n individuals did.

    Attributes:
        fitness: (n,), quality, larger is better.
        observation: (n, ...), sensory data; or a mapping of names to several of them, streams.
        ground_truth: (n, ...), what an expert would call the behaviour, for hand-coded descriptors and for metrics, or None.
    """

    fitness: Any
    observation: Any
    ground_truth: Any = None


class TaskError(RuntimeError):
    """A task raised, or returned something else than it promised. What was found before stays."""


def name_of(task: Callable) -> str:
    """What to call a task in a message."""
    return getattr(task, "__name__", type(task).__name__)


def called(task: Callable[..., Any], genotypes: np.ndarray, seeds: np.ndarray | None) -> Any:
    """What a task returns for genotypes, (n, n_genes), with their seeds, (n,) uint64, if it wants them."""
    if not getattr(task, "seeded", False):
        return task(genotypes)
    if seeds is None:
        raise ValueError("it is seeded, and needs a seed for each genotype, (n,) whole numbers")
    return task(genotypes, seeds)


def evaluated(task: Callable[..., Any], genotypes: np.ndarray, seeds: np.ndarray | None, when: str) -> Evaluation:
    """Evaluate genotypes.

    Args:
        task: see the module docstring.
        genotypes: (n, n_genes).
        seeds: (n,) uint64, for a task that wants them; None for others.
        when: that is, for messages, "at generation 3" for instance.

    Raises:
        TaskError: the task raised, or returned something that is no evaluation of n individuals.
    """
    where = f"task {name_of(task)} {when}"
    try:
        result = called(task, genotypes, seeds)
    except Exception as error:
        how = f"it was called with genotypes of shape {genotypes.shape}"
        if isinstance(error, TypeError) and "seeds" in str(error) and not getattr(task, "seeded", False):
            how += ", and without seeds: a task that takes them must say so, my_task.seeded = True"
        raise TaskError(f"{where} raised {type(error).__name__}: {error} ({how})") from error
    except SystemExit as error:
        raise TaskError(f"{where} called sys.exit({error})") from error
    try:
        return as_evaluation(result, len(genotypes))
    except ValueError as error:
        raise TaskError(f"{where}: {error}") from None


def as_evaluation(result: Any, n: int) -> Evaluation:
    """What a task returned for n individuals, as arrays of numbers.

    Raises:
        ValueError: it is no evaluation, or one of wrong shape, number of rows, or dtype.
    """
    if isinstance(result, Mapping) and "fitness" in result:
        raise ValueError(
            "it must return a tuple of fitness, observation and optionally ground truth, and returned a dictionary with a "
            "fitness; a dictionary is an observation of several streams"
        )
    if _is_observation(result):
        result = np.zeros(n), result
    if not isinstance(result, tuple) or len(result) not in (2, 3):
        raise ValueError(
            "it must return a tuple of fitness, observation and optionally ground truth, or observations alone, (n, ...), "
            f"got {_came(result)}"
        )
    return checked(Evaluation(*result), n)


def _came(result: Any) -> str:
    if isinstance(result, tuple):
        return f"tuple of {len(result)}"
    if isinstance(result, np.ndarray) and result.ndim == 1:
        return f"an array of shape {result.shape}: observations of one number each are observation[:, None]"
    return type(result).__name__


def _is_observation(result: Any) -> bool:
    """Whether it is an observation alone; (n,) may be fitness."""
    if isinstance(result, tuple):
        return False
    if isinstance(result, Mapping) or (isinstance(result, np.ndarray) and result.dtype.names is not None):
        return True
    return hasattr(result, "__array__") and np.ndim(result) > 1


def checked(evaluation: Evaluation, n: int) -> Evaluation:
    """The evaluation of n individuals as arrays of numbers.

    Raises:
        ValueError: wrong shape, number of rows, or dtype.
    """
    fitness = _rows("fitness", evaluation.fitness, n)
    if fitness.ndim != 1:
        raise ValueError(f"fitness must have shape ({n},), got {fitness.shape}")
    observation = _of_each("observation", observations("observation", evaluation.observation), n)
    for name, stream in streams_of(observation).items():
        if stream.ndim == 1 and stream is observation:
            raise ValueError(
                f"observation must have shape (n, ...), got {observation.shape}: of one number each, write observation[:, None]"
            )
        if math.prod(stream.shape[1:]) == 0:
            raise ValueError(f"{name} must have entries, got shape {stream.shape}")
    truth = None if evaluation.ground_truth is None else _rows("ground_truth", evaluation.ground_truth, n)
    if truth is not None and math.prod(truth.shape[1:]) == 0:
        raise ValueError(f"ground_truth must have entries, got shape {truth.shape}")
    return Evaluation(fitness.astype(np.float64), observation, truth)


def _rows(name: str, values: Any, n: int) -> np.ndarray:
    return _of_each(name, numeric(name, values), n)


def _of_each(name: str, array: np.ndarray, n: int) -> np.ndarray:
    if array.ndim == 0 or len(array) != n:
        raise ValueError(f"{name} must have {n} rows, one for each genotype, got shape {array.shape}")
    return array


from auroraqd.tasks._episodes import Episode  # noqa: E402 - tasks use Evaluation
from auroraqd.tasks._sensing import Camera  # noqa: E402
from auroraqd.tasks.air_hockey import AirHockey  # noqa: E402
from auroraqd.tasks.air_hockey_camera import AirHockeyCamera  # noqa: E402
from auroraqd.tasks.ballistic import Ballistic  # noqa: E402
from auroraqd.tasks.controllers import MLP, ClosedLoop, OpenLoop, Sinusoids, Splines, SquareWaves  # noqa: E402
from auroraqd.tasks.functions import Genes, each, from_jax  # noqa: E402
from auroraqd.tasks.gym import Gym  # noqa: E402
from auroraqd.tasks.hexapod import DAMAGES, Damage, Hexapod  # noqa: E402
from auroraqd.tasks.hierarchical import Hierarchical  # noqa: E402
from auroraqd.tasks.maze import Maze  # noqa: E402
from auroraqd.tasks.noise import repeated  # noqa: E402
from auroraqd.tasks.octopus_arm import OctopusArm  # noqa: E402

__all__ = [
    "DAMAGES",
    "MLP",
    "AirHockey",
    "AirHockeyCamera",
    "Ballistic",
    "Camera",
    "ClosedLoop",
    "Damage",
    "Episode",
    "Evaluation",
    "Genes",
    "Gym",
    "Hexapod",
    "Hierarchical",
    "Maze",
    "OctopusArm",
    "OpenLoop",
    "Sinusoids",
    "Splines",
    "SquareWaves",
    "TaskError",
    "each",
    "from_jax",
    "repeated",
]
