"""Many runs at once: one worker process a core, each with libraries that keep to one thread.

Workers are spawned, not forked, and end with their parent, however it ends. The run of a worker that dies is tried once more,
and then given up; the others go on.
"""

import multiprocessing
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager, nullcontext
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as ready
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from auroraqd._processes import Processes, WorkerDied
from auroraqd._workers import cores, settle
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.replication import Job, Point, Result, replicate
from auroraqd.experiments.settings import Settings
from auroraqd.experiments.variants import Experiment
from auroraqd.runs.folders import load, load_history

_REPORT = 0.5  # s between two reports of a worker


class Status(NamedTuple):
    """How far a run is."""

    variant: str
    replication: int
    generation: int
    generations: int
    size: int
    pid: int  # of its process
    training: str  # what the descriptor is doing, when it is being trained


class Listener(Protocol):
    """Who is told how an experiment goes."""

    def progress(self, status: Status) -> None:
        """A run has come this far."""

    def finished(self, result: Result) -> None:
        """A run is done."""

    def failed_run(self, job: Job, reason: str) -> None:
        """A run is given up."""


def plan(
    ledger: Ledger, experiment: Experiment, names: Sequence[str], replications: int, base: Settings
) -> tuple[list[Job], dict[str, Settings]]:
    """The runs that are missing, in an order in which the references come first.

    The reference of each replication, if the experiment has one, is grown even if it is not asked for, and once more where only
    its numbers are there.

    Args:
        ledger: what is done.
        experiment: what to do.
        names: of its variants, those that are asked for.
        replications: of each.
        base: what they have in common.

    Returns:
        The jobs, and the settings of each variant.

    Raises:
        ValueError: the ledger holds results of other settings.
    """
    needed = [experiment.reference] if experiment.reference is not None else []
    settings = {name: experiment.variants[name].of(base, 0) for name in dict.fromkeys([*needed, *names])}
    ledger.check(settings)

    def job(name: str, replication: int, reference: Path | None) -> Job:
        made = experiment.variants[name].of(base, replication)
        return Job(
            name, replication, made, ledger.run_folder(name, replication), reference, experiment.measures, experiment.name
        )

    jobs = []
    for replication in range(replications):
        missing = [name for name in names if replication not in ledger.done(name)]
        reference = None
        if experiment.reference is not None:
            reference = ledger.run_folder(experiment.reference, replication)
            others = [name for name in missing if name != experiment.reference]
            have = replication in ledger.done(experiment.reference)
            if experiment.reference in missing or (others and not (have and _complete(reference, base.generations))):
                jobs.append(job(experiment.reference, replication, None))
            missing = others
        jobs += [job(name, replication, reference) for name in missing]
    return sorted(jobs, key=lambda job: job.reference is not None), settings


def _complete(folder: Path, generations: int) -> bool:
    """Whether there is a repertoire that can be read, of a run that was not interrupted."""
    try:
        return len(load(folder)) > 0 and load_history(folder)[-1].generation == generations
    except (OSError, ValueError, IndexError):
        return False


def execute(
    jobs: Sequence[Job],
    settings: Mapping[str, Settings],
    ledger: Ledger,
    workers: int,
    listener: Listener,
    cluster: Executor | None = None,
) -> None:
    """Do the runs and write each down as soon as it is done.

    When it is interrupted, it goes on when it is called again with the runs that are still missing: those under way from
    their last checkpoint.

    Args:
        jobs: what to do.
        settings: of each variant.
        ledger: where to write it down.
        workers: runs at once.
        listener: who is told.
        cluster: an executor whose workers see the folder of the ledger, which must be absolute; None: processes of here.
    """
    waiting, running, died = list(jobs), dict[Future, Job](), set[tuple[str, int]]()
    with _pool(min(workers, len(jobs)), listener) if cluster is None else nullcontext(cluster) as pool:
        while waiting or running:
            needed = {job.folder for job in [*waiting, *running.values()] if job.reference is None}
            for job in [job for job in waiting if job.reference not in needed][: workers - len(running)]:
                running[pool.submit(_work, job)] = job
                waiting.remove(job)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                job = running.pop(future)
                try:
                    result, points = future.result()
                except WorkerDied:
                    if job.run in died:
                        waiting = _without(waiting, job, "its process died, twice", listener)
                    else:
                        died.add(job.run)
                        waiting.insert(0, job)
                except Exception as error:
                    waiting = _without(waiting, job, f"{type(error).__name__}: {error}", listener)
                else:
                    ledger.add(settings[job.variant], result, points)
                    listener.finished(result)


def _without(waiting: list[Job], failed: Job, reason: str, listener: Listener) -> list[Job]:
    """Give up a run, and those that have it as their reference."""
    listener.failed_run(failed, reason)
    orphans = [job for job in waiting if failed.reference is None and job.reference == failed.folder]
    for job in orphans:
        listener.failed_run(job, "its reference failed")
    return [job for job in waiting if job not in orphans]


@contextmanager
def _pool(workers: int, listener: Listener) -> Iterator[Processes]:
    """Processes that report to a listener, each through a pipe of its own, on a core of its own as long as there are enough."""
    there, pipes, over = cores(), list[Any](), threading.Event()

    def arguments(place: int) -> tuple[int, Connection]:
        reader, writer = multiprocessing.Pipe(duplex=False)
        pipes.append(reader)
        return there[place % len(there)], writer

    relay = threading.Thread(target=_relay, args=(pipes, over, listener), daemon=True)
    relay.start()
    pool = Processes(workers, _start, arguments)
    try:
        yield pool
    except BaseException:
        pool.kill()
        raise
    finally:
        pool.shutdown()
        over.set()
        relay.join()


def _relay(pipes: list[Any], over: threading.Event, listener: Listener) -> None:
    """Tell a listener what processes report."""
    while not over.is_set():
        found: list[Any] = ready(list(pipes), _REPORT)
        for pipe in found:
            try:
                listener.progress(pipe.recv())
            except (EOFError, OSError):  # it has died
                pipes.remove(pipe)


_reports: Connection | None = None


def _start(core: int, reports: Connection) -> None:
    """Set a worker up."""
    global _reports
    _reports = reports
    settle(core)


def _work(job: Job) -> tuple[Result, list[Point]]:
    """In a worker: do a run, and report now and then."""
    from auroraqd.descriptors.autoencoder import listening

    reporter = _Reporter(job)
    with listening(reporter.training):
        return replicate(job, reporter.generation)


class _Reporter:
    """Tells the parent how far a run is."""

    def __init__(self, job: Job):
        self._job = job
        self._next = 0.0
        self._generation = self._size = 0

    def generation(self, aurora: Any) -> None:
        """After a generation."""
        self._generation, self._size = aurora.generation, len(aurora.archive)
        self._send("")

    def training(self, progress: Any) -> None:
        """During a training."""
        self._send(f"training {progress.repeat}/{progress.repeats}, error {progress.error:.4f}")

    def _send(self, training: str) -> None:
        now = time.monotonic()
        if _reports is not None and now >= self._next:  # the workers of a cluster have nobody to tell
            self._next = now + _REPORT
            job = self._job
            _reports.send(
                Status(
                    job.variant, job.replication, self._generation, job.settings.generations, self._size, os.getpid(), training
                )
            )
