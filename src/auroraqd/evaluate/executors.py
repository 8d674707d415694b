"""Workers: processes of this machine, or of a cluster, as executors of `concurrent.futures` for `auroraqd.evaluate`.

What a worker does with a piece of work is here too, so that it has imported all it needs when it says that it is ready.
Things that these can and others cannot: `prepare` waits until the workers are there and have the task, so that the time
they take to start is not taken for a slow evaluation; `kill` ends workers that hang, and `end`, of processes, the one that
does something; `submit_elsewhere` keeps work from some workers.
"""

import logging
import math
import os
import pickle
import time
import uuid
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import CancelledError, Executor, Future
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import shown, whole
from auroraqd._processes import Processes
from auroraqd._workers import cores, settle
from auroraqd.evaluate._trust import Worker, this_worker
from auroraqd.tasks import Evaluation, as_evaluation, called

_MOST = 10_000  # workers on one machine
START = 120.0  # s, that workers may take to start
_RESTART = 30.0  # s, that a cluster may take to start workers again
_CONNECT = 10.0  # s, for a scheduler to answer
_log = logging.getLogger("auroraqd")


def processes(workers: int | None = None) -> Callable[[], Executor]:
    """A factory of process pools for `over`, on this machine: spawned, one thread each, gone with their parent.

    Args:
        workers: how many; by default one for each core that this process may use.

    Examples:
        >>> import auroraqd
        >>> spread = auroraqd.evaluate.over(auroraqd.evaluate.processes(8), auroraqd.tasks.Ballistic())  # none is started yet
    """
    workers = len(cores()) if workers is None else whole("workers", workers, most=_MOST)
    return partial(_Processes, workers)


def dask(client: Any) -> Callable[[], Executor]:
    """A factory for `over` of executors on a Dask cluster: local, SSH, Slurm, Kubernetes, ... Needs the extra `cluster`.

    Args:
        client: a `distributed.Client`, or the address of a scheduler, like "tcp://node1:8786".

    Raises:
        TypeError: the client is something else.
        ValueError: the extra is not installed, or there is no scheduler there.
    """
    try:
        from distributed import Client
        from distributed.comm.addressing import resolve_address
    except ImportError:
        raise ValueError('Dask is not installed: pip install "auroraqd[cluster]"') from None
    if isinstance(client, str):
        address = client
        try:
            resolve_address(address)
            client = Client(address, timeout=_CONNECT, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise ValueError(f"client: there is no Dask scheduler at {shown(address)}: {error}") from None
    if not isinstance(client, Client):
        raise TypeError(f"client must be a distributed.Client, or the address of a scheduler, got {shown(client)}")
    return partial(_DaskExecutor, client)


class Refused(NamedTuple):
    """What a worker answers when it is of no use to try again."""

    error: type[Exception]
    text: str


class Answer(NamedTuple):
    """What a worker has done with a piece: one of the three."""

    worker: Worker
    evaluation: Evaluation | None = None
    error: str | None = None
    refused: Refused | None = None  # neither: it left the piece to others
    seconds: float = 0.0


_loaded: tuple[bytes, Any] | None = None  # in a worker: the last task


def load(content: bytes, name: str) -> "Callable | Refused":
    """In a worker: the task, kept for the next time."""
    global _loaded
    kept = _loaded  # other threads may change it
    if kept is None or kept[0] != content:
        try:
            kept = content, pickle.loads(content)  # sent by who runs this, in the same breath; not read from any file
        except Exception as error:
            return Refused(RuntimeError, f"the workers cannot load the task {name}: {type(error).__name__}: {error}")
        _loaded = kept
    return kept[1]


def work_on(
    content: bytes, name: str, work: tuple[np.ndarray, np.ndarray | None], elsewhere: frozenset, pause: float
) -> Answer:
    """In a worker: evaluate genotypes, with their seeds, and time it. No exception leaves it: not all can be sent."""
    worker = this_worker()
    if worker.among(elsewhere):
        time.sleep(pause)  # so that others are there first when it is sent again
        return Answer(worker)
    task = load(content, name)
    if isinstance(task, Refused):
        return Answer(worker, refused=task)
    since = time.perf_counter()
    try:
        result = called(task, *work)
    except SystemExit as error:  # or the worker would end
        return Answer(worker, error=f"it called sys.exit({error})")
    except Exception as error:
        return Answer(worker, error=f"{type(error).__name__}: {error}")
    seconds = time.perf_counter() - since
    try:
        evaluation = as_evaluation(result, len(work[0]))
    except ValueError as error:
        return Answer(worker, refused=Refused(ValueError, str(error)))
    columns: Any = (None if column is None else np.array(column) for column in evaluation)  # the task may use its own again
    return Answer(worker, Evaluation(*columns), seconds=seconds)


def _ready(content: bytes, name: str) -> "Worker | Refused":
    """In a worker: load the task, and say who that was, or that it cannot be."""
    found = load(content, name)
    return found if isinstance(found, Refused) else this_worker()


def _checked(answers: "Iterable[Worker | Refused]") -> list[Worker]:
    workers = []
    for answer in answers:
        if isinstance(answer, Refused):
            raise answer.error(answer.text)
        workers.append(answer)
    return workers


class _Processes(Processes):
    """Processes that have the task before they are given any work."""

    def __init__(self, workers: int):
        super().__init__(workers, settle)
        self._who: dict[int, Worker] = {}  # by place

    def prepare(self, content: bytes, name: str) -> list[Worker]:
        """Wait until there is a process in each place that has the task; returns all of them."""
        started = self.fill(partial(_ready, content, name))
        self._who.update(zip(started, _checked(future.result() for future in started.values()), strict=True))
        return list(self._who.values())

    def submit_elsewhere(self, avoided: Collection[object], fn: Callable, /, *args: Any) -> Future:
        """Submit to workers that are not among those avoided; if there are others."""
        others = [place for place, worker in self._who.items() if not worker.among(avoided)]
        return self.submit_to(others or range(self.workers), partial(fn, *args))


async def _exit() -> None:
    """In a worker: end it, whatever it is doing."""
    os._exit(1)


class _DaskExecutor(Executor):
    """An executor on a Dask cluster. The scheduler itself replaces workers that die."""

    def __init__(self, client: Any):
        self._client = client
        self._sent: dict[Future, Any] = {}  # and not finished, with Dask's own futures
        self._who: dict[str, Worker] = {}  # addresses of workers to their processes
        self._asked = -math.inf
        self._plugin: str | None = None

    @property
    def workers(self) -> int:
        """Threads of all workers there are now; waits for the first."""
        self._ask_for_lost()
        if not self._client.nthreads():
            _log.warning("waiting for workers of the Dask cluster %s", self._client.scheduler.address)
            while not self._client.nthreads():
                with suppress(TimeoutError):
                    self._client.wait_for_workers(1, timeout=_RESTART)
                self._ask_for_lost()
        return sum(self._client.nthreads().values())

    def _ask_for_lost(self) -> None:
        """Ask the cluster, from time to time, for the workers that it has given up.

        It gives up one that its nanny has not replaced within 15 s ("distributed.deploy.lost-worker-timeout"), for good.
        """
        if time.monotonic() < self._asked + _RESTART:
            return
        self._asked = time.monotonic()
        cluster = self._client.cluster  # None if somebody else has made it
        wanted, there = getattr(cluster, "worker_spec", {}), getattr(cluster, "workers", {})
        for name, worker in list(there.items()):
            status = getattr(getattr(worker, "status", None), "value", None)
            if status in ("closed", "failed"):  # it could not start, and the cluster would keep it as it is
                there.pop(name, None)
        lost = wanted.keys() - there.keys()
        if lost:
            _log.warning("the Dask cluster is asked for %d lost workers", len(lost))
            cluster.scale(len(wanted))  # which does nothing about those that are starting

    def prepare(self, content: bytes, name: str) -> list[Worker]:
        """Make the task ready on all workers there are now, and on those that come before they are given any work."""
        assert self.workers
        self._plugin = f"auroraqd-{uuid.uuid4()}"
        self._client.register_plugin(_loader(content, name), name=self._plugin)
        found = self._client.run(_ready, content, name, on_error="ignore")  # one that has just died
        return _checked(
            [
                answer._replace(text=f"{answer.text} (worker {address})") if isinstance(answer, Refused) else answer
                for address, answer in found.items()
            ]
        )

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        future: Future = Future()
        future.set_running_or_notify_cancel()
        self._sent[future] = sent = self._client.submit(fn, *args, **kwargs, pure=False)
        sent.add_done_callback(partial(self._finished, future))
        return future

    def submit_elsewhere(self, avoided: Collection[object], fn: Callable, /, *args: Any) -> Future:
        """Submit to workers that are not among those avoided, nor on a host that is; if there are others."""
        if not avoided:
            return self.submit(fn, *args)
        there = self._client.nthreads()
        if not self._who.keys() >= there.keys():
            self._who = self._client.run(this_worker, on_error="ignore")
        others = [address for address in there if address in self._who and not self._who[address].among(avoided)]
        # They may be gone by the time it is sent: anyone may take it then.
        return self.submit(fn, *args, workers=others, allow_other_workers=True) if others else self.submit(fn, *args)

    def _finished(self, future: Future, sent: Any) -> None:
        self._sent.pop(future, None)
        try:
            future.set_result(sent.result())
        except (Exception, CancelledError) as error:
            future.set_exception(error)

    def kill(self) -> None:
        """End the workers that are busy with what was sent from here, and wait until their nannies have started others."""
        sent = list(self._sent.values())
        self._sent.clear()
        if not sent:
            return
        keys, known = {future.key for future in sent}, self._client.scheduler_info(n_workers=-1)["workers"]
        busy = [worker for worker, theirs in self._client.processing().items() if keys & set(theirs)]
        self._client.cancel(sent, force=True)
        mortal = [worker for worker in busy if known.get(worker, {}).get("nanny")]
        if len(mortal) < len(busy):
            _log.warning("a Dask worker that hangs cannot be ended, for it has no nanny")
        if mortal:
            self._client.run(_exit, workers=mortal, wait=False)
            deadline = time.monotonic() + _RESTART
            while time.monotonic() < deadline and (
                set(mortal) & set(self._client.nthreads()) or len(self._client.nthreads()) < len(known)
            ):
                time.sleep(0.05)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        plugin, self._plugin = self._plugin, None
        if plugin is not None:
            self._client.unregister_worker_plugin(plugin)
        # the client belongs to who made it


def _loader(content: bytes, name: str) -> Any:
    """What loads the task when a worker joins a cluster, so that it is not taken for a slow evaluation."""
    from distributed import WorkerPlugin

    class Loader(WorkerPlugin):
        def setup(self, worker: Any) -> None:
            load(content, name)  # one that cannot says so when it is given work

    return Loader()
