"""Asynchronous running: a worker that is free gets new offspring of the archive as it is then, and waits for nobody.

Robots and simulators do not end together, and a generation lasts as long as the slowest of its individuals. Here individuals
are told as they come, and `batch_size` of them are a generation: schedules, records and callbacks count as ever. What comes
when depends on the workers, so the order is kept: a run is repeated bit for bit by `replay`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from auroraqd.callbacks.base import Callbacks
from auroraqd.emitters.proposal import Event, Proposal
from auroraqd.observations import by_stream
from auroraqd.running import tell
from auroraqd.tasks import Evaluation, TaskError, evaluated, name_of

if TYPE_CHECKING:
    from auroraqd.aurora import Aurora
    from auroraqd.running import Budget


def run(aurora: Aurora, task: Any, budget: Budget, known: np.ndarray | None, callbacks: Callbacks) -> None:
    """Evaluate on the workers of a task until the budget is used up, or a callback says so.

    What is out when a callback says so, or something is raised, stays asked for: the next call has it evaluated.
    """
    seeded = getattr(task, "seeded", False)
    name = name_of(task)
    with task.stream() as stream:

        def submit(proposal: Proposal) -> None:
            stream.submit(proposal.ticket, proposal.genotype, proposal.seeds if seeded else None)

        for proposal in aurora.out:  # of a call that ended before
            submit(proposal)
        if known is not None:
            submit(aurora._ask(known, alone=False))
        while True:
            with _said_of(name, aurora):
                wanted, chunk = stream.wanted, stream.chunk
            for _ in range(wanted):
                if (n := min(chunk, budget.left())) > 0:
                    submit(aurora.ask(n))
            with _said_of(name, aurora):
                if not stream.open:
                    return stream.end()
                finished = stream.finished()
            if _told(aurora, name, finished, callbacks):
                return None


@contextmanager
def _said_of(task: str, aurora: Aurora) -> Iterator[None]:
    """What workers raise is said of the task."""
    try:
        yield
    except (ValueError, RuntimeError) as error:
        raise TaskError(f"task {task} at generation {aurora.generation}: {error}") from error


def _told(aurora: Aurora, name: str, finished: list[tuple[int, Evaluation]], callbacks: Callbacks) -> bool:
    """Tell what is finished; returns whether the run is to stop."""
    stop = False
    for ticket, evaluation in finished:
        before = aurora.generation
        tell(aurora, name, evaluation, callbacks, ticket)
        stop = (aurora.generation > before and callbacks.generation(aurora)) or stop
    return stop


def replay(aurora: Aurora, task: Callable[..., Any], events: np.ndarray, callback: Any = None) -> None:
    """Do again what a run did, in the order in which it was done there.

    Args:
        aurora: as that one was made, at its beginning.
        task: of that one, or over any workers: results must not depend on them. What was invalid then, by the task or by the
            loss of a worker, is not evaluated again.
        events: of that one, (n, 2); see `Aurora.events`.
        callback: as in `Aurora.run`.

    Raises:
        TaskError: the task raised, or returned something else than promised.
        ValueError: the events are of another run.
    """
    callbacks = Callbacks(callback)
    aurora._remember(task)
    callbacks.start(aurora)
    try:
        _replay(aurora, task, events, callbacks)
    finally:
        callbacks.end(aurora)


def _replay(aurora: Aurora, task: Callable[..., Any], events: np.ndarray, callbacks: Callbacks) -> None:
    seeded = getattr(task, "seeded", False)
    proposals: dict[int, Proposal] = {}  # by their numbers
    known: dict[int, Evaluation] = {}  # by ticket: what has been evaluated and not told
    waiting: list[Proposal] = []
    happened = np.asarray(events).tolist()
    lost = {value for kind, value in happened if kind == Event.INVALID}
    for kind, value in happened:
        before = aurora.generation
        if kind == Event.ASKED:
            proposal = aurora.ask(value)
            proposals[proposal.ticket - aurora._ticket_base] = proposal
            waiting.append(proposal)
        elif kind == Event.ALONE:
            for _ in range(value):
                genotypes = aurora.ask()
                where = f"at generation {aurora.generation}"
                evaluation = evaluated(task, genotypes, aurora.seeds if seeded else None, where)
                tell(aurora, name_of(task), evaluation, callbacks)
        elif kind == Event.INVALID:
            continue
        elif value not in proposals:
            raise ValueError(f"events must be those of a run like this one, and there is no proposal {value} in it")
        elif kind == Event.WITHDRAWN:
            aurora.withdraw(proposals.pop(value).ticket)
        else:
            proposal = proposals.pop(value)
            if proposal.ticket not in known:
                known.update(_evaluated(task, waiting, lost, seeded, f"at generation {aurora.generation}"))
                waiting = []
            tell(aurora, name_of(task), known.pop(proposal.ticket), callbacks, proposal.ticket)
        if aurora.generation > before and callbacks.generation(aurora):
            return


def _evaluated(task: Callable, proposals: list[Proposal], lost: set[int], seeded: bool, when: str) -> dict[int, Evaluation]:
    """The evaluations of proposals, at once, by their tickets; those of lost numbers are invalid."""
    genotypes = np.concatenate([proposal.genotype for proposal in proposals])
    seeds = np.concatenate([proposal.seeds for proposal in proposals])
    there = np.array([number not in lost for proposal in proposals for number in proposal.born.tolist()])
    found = evaluated(task, genotypes[there], seeds[there] if seeded else None, when)
    ends = np.cumsum([len(proposal.genotype) for proposal in proposals])[:-1]
    parts = [
        [None] * len(proposals) if c is None else np.split(by_stream(partial(_spread, there=there), c), ends) for c in found
    ]
    return {p.ticket: Evaluation(*columns) for p, *columns in zip(proposals, *parts, strict=True)}


def _spread(rows: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Rows where they belong, (n,) bool; NaN, or 0 where there is none, elsewhere."""
    column = np.full((len(there), *rows.shape[1:]), np.nan if rows.dtype.kind == "f" else 0, rows.dtype)
    column[there] = rows
    return column
