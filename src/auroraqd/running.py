"""Running: generation after generation on a task, within a budget, with callbacks."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from auroraqd._checks import number, whole
from auroraqd._interrupts import relayed
from auroraqd.callbacks.base import Callbacks
from auroraqd.tasks import Evaluation, TaskError, evaluated, name_of

if TYPE_CHECKING:
    from auroraqd.aurora import Aurora


def run(
    aurora: Aurora, task: Callable, budget: Budget, known: np.ndarray | None, callback: Any, progress: bool, in_parts: bool
) -> None:
    """See `Aurora.run`, whose arguments have been checked, but for the callback."""
    callbacks = Callbacks(callback)
    how = aurora._remember(task)
    if how is not None:
        warnings.warn(f"{how} since the run was saved: what is found from now on may not go with the rest", stacklevel=3)
    before = aurora.evaluations
    with relayed(), _shown(aurora, budget) if progress else nullcontext() as show:
        both = callbacks if show is None else callbacks.and_then(show)
        both.start(aurora)
        try:
            _run(aurora, task, budget, known, both, in_parts)
        finally:
            both.end(aurora)
    if aurora.evaluations > before and aurora._all_invalid:
        warnings.warn(_nothing_valid(aurora, name_of(task)), stacklevel=3)


def _run(
    aurora: Aurora, task: Callable, budget: Budget, known: np.ndarray | None, callbacks: Callbacks, in_parts: bool
) -> None:
    while not budget.used_up():
        if in_parts and aurora.pending is None:
            from auroraqd import asynchronous

            return asynchronous.run(aurora, task, budget, known, callbacks)
        if aurora.pending is None and known is not None:
            aurora._ask_known(known)
            known = None
        if _generation(aurora, task, callbacks):
            return None
    return None


def _generation(aurora: Aurora, task: Callable, callbacks: Callbacks) -> bool:
    """Evaluate and tell a batch; returns whether the run is to stop."""
    genotypes = aurora.ask() if aurora.pending is None else aurora.pending
    seeds = aurora.seeds if getattr(task, "seeded", False) else None
    evaluation = evaluated(task, genotypes, seeds, f"at generation {aurora.generation}")
    tell(aurora, name_of(task), evaluation, callbacks)
    return callbacks.generation(aurora)


def tell(aurora: Aurora, task: str, evaluation: Evaluation, callbacks: Callbacks, ticket: int | None = None) -> None:
    """Tell a run, and then the callbacks, also if it is interrupted between the two, what individuals did.

    Raises:
        TaskError: it is not like what individuals did before, or there was never a valid one.
    """
    try:
        aurora._check_as_before(evaluation)
    except ValueError as error:
        raise TaskError(f"task {task} at generation {aurora.generation}: {error}") from error
    before = aurora._latest
    try:
        aurora._tell_checked(evaluation, aurora._asked_for(ticket))
    finally:
        if aurora._latest is not before:
            callbacks.told(aurora)
    if aurora._hopeless:
        raise TaskError(_nothing_valid(aurora, task))


def _nothing_valid(aurora: Aurora, task: str) -> str:
    return (
        f"task {task} gave no valid individual in {aurora.generation} generations: fitness or observation was NaN or infinite "
        f"for all {aurora.evaluations} evaluations"
    )


class Budget:
    """How much a call of `run` may use."""

    def __init__(
        self,
        aurora: Aurora,
        generations: int | None,
        evaluations: int | None,
        seconds: float | None,
        until_generation: int | None,
    ):
        if generations is None and evaluations is None and seconds is None and until_generation is None:
            raise ValueError("run needs a budget: generations, evaluations, seconds or until_generation")
        self._aurora = aurora
        self._generations = self._evaluations = self._deadline = np.inf
        if generations is not None:
            self._generations = aurora.generation + whole("generations", generations, least=0)
        if until_generation is not None:
            self._generations = min(self._generations, whole("until_generation", until_generation, least=0))
        if evaluations is not None:
            self._evaluations = aurora.evaluations + whole("evaluations", evaluations, least=0)
        if seconds is not None:
            self._deadline = time.monotonic() + number("seconds", seconds)

    @property
    def last_generation(self) -> int | None:
        """The generation after which it is used up, at the latest; None where only the time says."""
        aurora = self._aurora
        batches = np.ceil(max(self._evaluations - aurora.evaluations, 0) / aurora.batch_size)
        last = min(self._generations, aurora.generation + batches)
        return int(last) if np.isfinite(last) else None

    def left(self) -> int:
        """Individuals that may yet be asked for, where they are told in parts."""
        aurora = self._aurora
        if time.monotonic() >= self._deadline:
            return 0
        out = sum(len(proposal.genotype) for proposal in aurora.out)
        more = min(
            (self._generations - aurora.generation) * aurora.batch_size - aurora._part,
            self._evaluations - aurora.evaluations,
        )
        return int(min(max(more - out, 0), aurora.batch_size))

    def used_up(self) -> bool:
        """Whether one of the limits is reached."""
        return (
            self._aurora.generation >= self._generations
            or self._aurora.evaluations >= self._evaluations
            or time.monotonic() >= self._deadline
        )


def _shown(aurora: Aurora, budget: Budget) -> Any:
    """A context that shows the progress of a run, and gives a callback."""
    from auroraqd.callbacks.progress import shown  # Rich takes time to import

    return shown(aurora, budget.last_generation)
