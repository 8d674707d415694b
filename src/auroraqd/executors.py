"""Workers: processes of this machine, or of a cluster, as executors of `concurrent.futures` for `auroraqd.evaluate`.

Two things that these can and others cannot: `prepare` waits until the workers are there and have the task, so that the time
they take to start is not taken for a slow evaluation; `kill` ends workers that hang.
"""

import logging
import multiprocessing
import os
import pickle
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from functools import partial
from typing import Any, NamedTuple

from auroraqd._checks import whole
from auroraqd._workers import cores, one_thread, settle

START = 120.0  # s, that workers may take to start
_RESTART = 30.0  # s, that a cluster may take to start workers again
_CONNECT = 10.0  # s, for a scheduler to answer
_log = logging.getLogger("auroraqd")


def processes(workers: int | None = None) -> Callable[[], Executor]:
    """A factory of process pools for `over`, on this machine: spawned, one thread each, gone with their parent.

    Args:
        workers: how many; by default one for each core that this process may use.
    """
    workers = len(cores()) if workers is None else whole("workers", workers)
    return partial(_ProcessPool, workers)


def dask(client: Any) -> Callable[[], Executor]:
    """A factory for `over` of executors on a Dask cluster: local, SSH, Slurm, Kubernetes, ... Needs the extra `cluster`.

    Args:
        client: a `distributed.Client`, or the address of a scheduler, like "tcp://node1:8786".

    Raises:
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
            raise ValueError(f"there is no Dask scheduler at {address}: {error}") from None
    return partial(_DaskExecutor, client)


class Refused(NamedTuple):
    """What a worker answers when it is of no use to try again."""

    error: type[Exception]
    text: str


_loaded: tuple[bytes, Any] | None = None  # in a worker: the last task
_together: Any = None  # in a worker of ours: where all meet


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


def _ready(content: bytes, name: str) -> "Refused | None":
    """In a worker: load the task, and say if that cannot be."""
    found = load(content, name)
    return found if isinstance(found, Refused) else None


def _ready_together(content: bytes, name: str) -> "Refused | None":
    """In a worker of ours: the same, and wait until all are ready, so that each loads it once."""
    refused = _ready(content, name)
    _together.wait(START)
    return refused


def _check(refusals: "Sequence[Refused | None]") -> None:
    for refused in refusals:
        if refused is not None:
            raise refused.error(refused.text)


class _ProcessPool(ProcessPoolExecutor):
    """A pool whose processes start together, and can be ended."""

    def __init__(self, workers: int):
        self.workers = workers
        context = multiprocessing.get_context("spawn")
        super().__init__(workers, context, initializer=_begin, initargs=(context.Barrier(workers),))

    def prepare(self, content: bytes, name: str) -> None:
        """Wait until all workers are there and have the task."""
        _check([future.result() for future in [self.submit(_ready_together, content, name) for _ in range(self.workers)]])

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        with one_thread():  # processes start when they are first needed
            return super().submit(fn, *args, **kwargs)

    def kill(self) -> None:
        """End all processes, whatever they are doing."""
        for process in list((self._processes or {}).values()):
            process.kill()


def _begin(barrier: Any) -> None:
    global _together
    _together = barrier
    settle()


async def _exit() -> None:
    """In a worker: end it, whatever it is doing."""
    os._exit(1)


class _DaskExecutor(Executor):
    """An executor on a Dask cluster. The scheduler itself replaces workers that die."""

    def __init__(self, client: Any):
        self._client = client
        self._sent: dict[Future, Any] = {}  # and not finished, with Dask's own futures

    @property
    def workers(self) -> int:
        """Threads of all workers there are now; waits for the first."""
        if not self._client.nthreads():
            _log.warning("waiting for workers of the Dask cluster %s", self._client.scheduler.address)
            self._client.wait_for_workers(1)
        return sum(self._client.nthreads().values())

    def prepare(self, content: bytes, name: str) -> None:
        """Make the task ready on all workers there are now."""
        assert self.workers
        found = self._client.run(_ready, content, name, on_error="ignore")  # one that has just died
        _check([refused and refused._replace(text=f"{refused.text} (worker {worker})") for worker, refused in found.items()])

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        future: Future = Future()
        future.set_running_or_notify_cancel()
        self._sent[future] = sent = self._client.submit(fn, *args, **kwargs, pure=False)
        sent.add_done_callback(partial(self._finished, future))
        return future

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
        pass  # the client belongs to who made it
