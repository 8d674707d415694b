"""Noise: tasks whose outcome depends on chance, which is made repeatable, or averaged.

A task with an attribute `seeded` that is true is called as `task(genotypes, seeds)`, with a seed of its own for each
individual, (n,) uint64. A seed follows from the seed of the run and the number of the evaluation, so the result of a run does
not depend on who evaluates what.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from auroraqd._checks import function, numeric, seeds_for, whole
from auroraqd.observations import by_stream
from auroraqd.tasks import Evaluation, as_evaluation, called, name_of

_MOST_TIMES = 10**6
_RUN, _AGAIN = 1, 2  # streams of their own, apart from the random numbers of the run itself


def seeds_of(seed: int, first: int, n: int) -> np.ndarray:
    """Seeds of the evaluations `first` to `first + n - 1` of a run, (n,) uint64.

    Args:
        seed: of the run.
        first: number of evaluations before.
        n: how many.
    """
    return _seeds(_RUN, seed, first, n)


def seeds_at(seed: int, born: np.ndarray) -> np.ndarray:
    """Seeds of the evaluations of these numbers, (n,) whole, of a run, (n,) uint64."""
    return np.array([seeds_of(seed, int(number), 1)[0] for number in born], np.uint64)


def other_seeds(seed: int, n: int) -> np.ndarray:
    """Seeds to evaluate what was found again, (n,) uint64: none is of a run, also of the same seed."""
    return _seeds(_AGAIN, seed, 0, n)


def _seeds(stream: int, seed: int, first: int, n: int) -> np.ndarray:
    return np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream,))).advance(first).random_raw(n)


class Repeated:
    """A task that evaluates each individual several times and averages; what `repeated` returns."""

    def __init__(self, task: Callable, times: int):
        self.task = function("task", task)
        self.times = whole("times", times, most=_MOST_TIMES)
        self.__name__ = name_of(task)

    def __getattr__(self, name: str) -> Any:
        """What the task says about itself, `n_genes` and `seeded` for instance."""
        if name.startswith("_") or name == "task":
            raise AttributeError(name)
        return getattr(self.task, name)

    def __call__(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> Evaluation:
        """The mean of several evaluations of genotypes, (n, n_genes).

        Raises:
            ValueError: the task returned something that is no evaluation.
        """
        genotypes = numeric("genotypes", genotypes, " of shape (n, n_genes)", axes=2, some=True)
        n = len(genotypes)
        if seeds is not None:
            each = seeds_for("seeds", seeds, n)
            seeds = np.array([np.random.PCG64(int(seed)).random_raw(self.times) for seed in each]).reshape(-1)
        result = called(self.task, np.repeat(genotypes, self.times, axis=0), seeds)
        evaluation = as_evaluation(result, n * self.times)
        return Evaluation(*(None if rows is None else by_stream(self._mean, rows) for rows in evaluation))

    def _mean(self, rows: np.ndarray) -> np.ndarray:
        return rows.reshape(-1, self.times, *rows.shape[1:]).mean(axis=1, dtype=np.float64)


def repeated(task: Callable[..., Any], times: int) -> Repeated:
    """A task that evaluates each individual `times` times, and averages fitness, observation and ground truth.

    One that is invalid once is invalid. Workers may be within or around: `repeated(over(...), 5)` spreads the repetitions too.

    Args:
        task: one whose outcome depends on chance, its own or that of the seeds it is given.
        times: how often.

    Raises:
        TypeError, ValueError: an argument is of the wrong kind or out of range.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> def windy(genotypes, seeds):
        ...     wind = np.array([np.random.default_rng(seed).normal() for seed in seeds])
        ...     return genotypes + wind[:, None]
        >>> windy.seeded = True
        >>> aurora = auroraqd.Aurora(2, "observation", seed=0)
        >>> aurora.run(auroraqd.tasks.repeated(windy, 5), generations=2).evaluations
        400
    """
    return Repeated(task, times)
