"""Which workers can be trusted: one whose failures others do not share is at fault itself, and not the individuals.

A worker that lost its GPU, its licence or its disk fails at once, and so draws to itself what the others would have done. It is
told by this: pieces of work that fail on it succeed elsewhere, and nothing succeeds on it.
"""

import os
import socket
from collections import Counter
from collections.abc import Collection
from typing import NamedTuple

_CONVICTED = 3  # failures that others do not share, and no success between them


class Worker(NamedTuple):
    """A process somewhere."""

    host: str
    pid: int

    def __str__(self) -> str:
        return f"process {self.pid} of {self.host}"

    def among(self, names: Collection[object]) -> bool:
        """Whether it is one of these workers, or on one of these hosts."""
        return self in names or self.host in names


def this_worker() -> Worker:
    """The process that calls."""
    return Worker(socket.gethostname(), os.getpid())


class Trust:
    """What is known about the workers of one executor."""

    def __init__(self) -> None:
        self.bad: set[Worker] = set()
        self._seen: set[Worker] = set()
        self._unshared: Counter[Worker] = Counter()
        self._complete = False  # whether there are no others than those seen, as far as anybody knows

    def met(self, worker: Worker) -> None:
        """It answered."""
        self._complete = self._complete and worker in self._seen
        self._seen.add(worker)

    def are(self, workers: Collection[Worker]) -> None:
        """These are there, and no others."""
        self._seen, self.bad = set(workers), self.bad & set(workers)
        self._complete = True

    def met_all(self) -> None:
        """Nobody else answers."""
        self._complete = True

    def succeeded(self, worker: Worker, failed_on: Collection[Worker]) -> list[Worker]:
        """It did a piece of work that had failed on others. Returns those that are bad, as is known by now."""
        self._unshared[worker] = 0
        self.bad.discard(worker)
        for other in set(failed_on) - {worker}:
            self._unshared[other] += 1
        return self._convict([other for other in failed_on if self._unshared[other] >= _CONVICTED])

    def refused(self, worker: Worker) -> list[Worker]:
        """It cannot load the task that others have done. Returns it, if that is news."""
        return self._convict([worker])

    def _convict(self, workers: list[Worker]) -> list[Worker]:
        found = [worker for worker in workers if worker in self._seen - self.bad]  # others are gone
        self.bad.update(found)
        if self._seen <= self.bad:  # then it is not the workers
            self.bad.clear()
            self._unshared.clear()
            return []
        return found

    def elsewhere(self, failed_on: Collection[Worker]) -> frozenset[object]:
        """Where a piece must not go: bad workers, and the hosts it failed on; on one host only, the workers it failed on.

        If nobody would be left, only bad workers.
        """
        hosts = {worker.host for worker in failed_on}
        names: set[object] = set(self.bad)
        names |= hosts if {worker.host for worker in self._seen} - hosts else set(failed_on)
        if self._complete and all(worker.among(names) for worker in self._seen):
            return frozenset(self.bad)
        return frozenset(names)
