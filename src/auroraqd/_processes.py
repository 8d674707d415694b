"""Worker processes as an executor: one that dies, or is ended because it hangs, is replaced alone."""

import multiprocessing
from collections.abc import Callable, Collection
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any

from auroraqd._workers import one_thread


class WorkerDied(Exception):
    """The process that something was submitted to has died, or was ended.

    Args:
        began: whether it had begun with it.
    """

    def __init__(self, began: bool):
        super().__init__("its process died" if began else "the process that it waited for died")
        self.began = began


class Processes(Executor):
    """Processes of this machine, spawned, one thread each. What one of them takes with it when it dies is `WorkerDied`.

    Each is a pool of the standard library's of its own, for there one that dies breaks the pool. It starts when there is work
    for it. To be used by one thread at a time.

    Args:
        workers: how many.
        start: called in each before anything else.
        arguments: of it, by the place of the process, from 0 on; one that takes the place of another is asked for anew.
    """

    def __init__(self, workers: int, start: Callable[..., object], arguments: Callable[[int], tuple] = lambda place: ()):
        self.workers = workers
        self._start, self._arguments = start, arguments
        self._processes: dict[int, _Process] = {}  # by place

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        """To one that does nothing, if there is one; else it waits for the one for which the fewest wait."""
        return self.submit_to(range(self.workers), partial(fn, *args, **kwargs))

    def submit_to(self, places: Collection[int], call: Callable[[], Any]) -> Future:
        """The same, to those in some places."""
        while True:
            place = min(places, key=self._busy)
            try:
                return self._at(place).submit(call)
            except BrokenProcessPool:  # it died while nobody looked; there will be another
                self._processes[place].died = True

    def fill(self, call: Callable[[], Any]) -> dict[int, Future]:
        """Start a process in each place that has none, and have each do this first; returns what was submitted, by place."""
        return {place: self._at(place).submit(call) for place in range(self.workers) if not self._alive(place)}

    def end(self, future: Future) -> None:
        """End the process that does this, whatever it is doing."""
        for process in self._processes.values():
            if future in process.calls:
                process.kill()

    def kill(self) -> None:
        """End all processes, whatever they are doing."""
        for process in self._processes.values():
            process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `concurrent.futures.Executor`."""
        for process in self._processes.values():
            process.pool.shutdown(wait=wait or process.died, cancel_futures=cancel_futures)

    def _alive(self, place: int) -> bool:
        return place in self._processes and not self._processes[place].died

    def _busy(self, place: int) -> tuple[int, bool]:
        alive = self._alive(place)
        return len(self._processes[place].calls) if alive else 0, not alive

    def _at(self, place: int) -> "_Process":
        if not self._alive(place):
            if place in self._processes:  # a pool that goes before it has dealt with that locks itself up, with Python 3.13.0
                self._processes[place].pool.shutdown()
            self._processes[place] = _Process(self._start, self._arguments(place))
        return self._processes[place]


class _Process:
    """A process, and what it does and is to do, in this order."""

    def __init__(self, start: Callable[..., object], arguments: tuple):
        context = multiprocessing.get_context("spawn")
        self.pool = ProcessPoolExecutor(1, context, initializer=start, initargs=arguments)
        self.calls: list[Future] = []
        self.died = False

    def submit(self, call: Callable[[], Any]) -> Future:
        with one_thread():  # it starts when it is first needed
            inner = self.pool.submit(call)
        future: Future = Future()
        future.set_running_or_notify_cancel()
        self.calls.append(future)
        inner.add_done_callback(partial(self._done, future))
        return future

    def _done(self, future: Future, inner: Future) -> None:
        """In a thread of the pool: it may take no locks of ours."""
        error = CancelledError() if inner.cancelled() else inner.exception()
        if isinstance(error, BrokenProcessPool):
            self.died = True
            error = WorkerDied(began=self.calls[0] is future)
        else:
            self.calls.remove(future)
        if error is None:
            future.set_result(inner.result())
        else:
            future.set_exception(error)

    def kill(self) -> None:
        self.died = True
        for process in list((self.pool._processes or {}).values()):
            process.kill()
