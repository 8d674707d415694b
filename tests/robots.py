"""Tasks for workers, some of which misbehave. What they do is decided by the first gene.

They are here and not with their tests, for workers import what they are of, and many are started.
"""

import os
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

GENES = 3


def good(genotypes):
    path = np.cumsum(np.stack([np.cos(6 * genotypes), np.sin(6 * genotypes)], axis=2), axis=1)
    return -genotypes[:, 0], path, path[:, -1]


def slow(genotypes):
    time.sleep(0.002 * len(genotypes))
    return good(genotypes)


def bad(genotypes):
    return genotypes[:, 0] > 0.9


def raises(genotypes):
    if bad(genotypes).any():
        raise ArithmeticError("the solver did not converge")
    return good(genotypes)


def dies(genotypes):
    if bad(genotypes).any():
        os.kill(os.getpid(), signal.SIGKILL)
    return good(genotypes)


def leaves(genotypes):
    """As a library does that has been told to quit."""
    if bad(genotypes).any():
        os._exit(0)
    return good(genotypes)


def hangs(genotypes):
    if bad(genotypes).any():
        time.sleep(1000)
    return good(genotypes)


def always_raises(genotypes):
    raise ArithmeticError("no robot")


def always_hangs(genotypes):
    time.sleep(1000)


def always_dies(genotypes):
    os._exit(3)


def uneven(genotypes, seeds):
    """It takes as long as chance has it, and fails now and then."""
    rng = np.random.default_rng(int(seeds[0]))
    time.sleep(min(rng.lognormal(np.log(0.002), 1), 0.05))
    observation = np.cumsum(genotypes[:, :, None], axis=1)
    fitness = np.where(genotypes[:, 0] > 0.97, np.nan, -genotypes[:, 1])
    return fitness, observation


uneven.seeded = True


def deadly(genotypes):
    if (genotypes[:, 0] > 0.97).any():
        os._exit(1)
    return -genotypes[:, 1], np.cumsum(genotypes[:, :, None], axis=1)


def wrong(genotypes):
    return genotypes[:, 0], genotypes[:, 0]


def hopeless(genotypes):
    raise OSError("no such robot")


def wrong_shape(genotypes):
    return np.zeros(len(genotypes) + 1), genotypes


def no_tuple(genotypes):
    return None


def pictures(genotypes):
    """Observations that have no NaN."""
    return np.zeros(len(genotypes)), (255 * genotypes).astype(np.uint8)[..., None]


def exits(genotypes):
    if bad(genotypes).any():
        sys.exit(3)
    return good(genotypes)


def mixed_types(genotypes):
    return np.zeros(len(genotypes)), genotypes.astype(np.float32 if bad(genotypes).any() else np.float64)


def mixed_shapes(genotypes):
    return np.zeros(len(genotypes)), np.zeros((len(genotypes), 2 if bad(genotypes).any() else 3))


class WritesDown:
    """Notes what was done, and by whom, in a file."""

    def __init__(self, path, task, pause=0.1):
        self.path, self.task, self.pause = str(path), task, pause

    def __call__(self, genotypes):
        found = self.task(genotypes)
        time.sleep(self.pause)
        with open(self.path, "a") as file:
            file.write("".join(f"{gene!r} {os.getpid()}\n" for gene in genotypes[:, 0].tolist()))
        return found


class FailsOnce:
    """Raises, or ends its worker, the first time."""

    def __init__(self, mark, death=False):
        self.mark, self.death = str(mark), death

    def __call__(self, genotypes):
        mark = Path(self.mark)
        if bad(genotypes).any() and not mark.exists():
            mark.touch()
            if self.death:
                os.kill(os.getpid(), signal.SIGKILL)
            raise OSError("lost the connection")
        return good(genotypes)


class OneBadWorker:
    """Raises on the first worker that takes the mark, always and at once."""

    def __init__(self, mark, pause=0.01):
        self.mark, self.pause = str(mark), pause

    def __call__(self, genotypes):
        if took_mark(Path(self.mark)):
            raise OSError("the GPU has fallen off the bus")
        time.sleep(self.pause * len(genotypes))
        return good(genotypes)


def took_mark(mark):
    """Whether this process is the first that wanted the mark: all or nothing of its name is there for the others to read."""
    me = f"{socket.gethostname()}:{os.getpid()}"
    own = mark.with_name(f"{mark.name}-{os.getpid()}")
    if not mark.exists():  # once: a process that is killed while it writes must not leave an empty one
        own.write_text(me)
        with suppress(FileExistsError):
            os.link(own, mark)
    return mark.read_text() == me


class OneBadWorkerAndABadMoment:
    """The same; and the other worker, too, fails an individual once, the first that it gets."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __call__(self, genotypes):
        if took_mark(Path(self.mark)):
            raise OSError("the GPU has fallen off the bus")
        if took_mark(Path(self.mark).with_name("moment")) and len(genotypes) == 1 and not _had_its_moment:
            _had_its_moment.append(True)
            raise OSError("lost the connection")
        time.sleep(0.01 * len(genotypes))
        return good(genotypes)


_had_its_moment = []


class Unpicklable(Exception):
    """Cannot be sent back by a worker."""

    def __init__(self, one, two):
        super().__init__(f"{one} {two}")


def raises_unpicklable(genotypes):
    if bad(genotypes).any():
        raise Unpicklable("no", "contact")
    return good(genotypes)


class NotThere:
    """Its module cannot be imported by a worker."""

    def __call__(self, genotypes):
        return good(genotypes)

    def __reduce__(self):
        return _from_nowhere, ()


class LoadsSlowly:
    """Takes a second to load."""

    def __call__(self, genotypes):
        return good(genotypes)

    def __reduce__(self):
        return _loaded_slowly, ()


def _loaded_slowly():
    global _slowly_loaded
    time.sleep(1)
    _slowly_loaded = True
    return LoadsSlowly()


_slowly_loaded = False


def loaded():
    """In a worker: whether it has loaded the slow one."""
    return _slowly_loaded


class OnOneWorkerOnly:
    """The second worker that loads it cannot, and says so when the first has done something."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __call__(self, genotypes):
        time.sleep(0.02 * len(genotypes))
        return good(genotypes)

    def __reduce__(self):
        return _on_one_worker_only, (self.mark,)


def _on_one_worker_only(mark):
    try:
        Path(mark).open("x").close()
    except FileExistsError:
        time.sleep(0.5)
        raise ImportError("No module named 'simulator'") from None
    return OnOneWorkerOnly(mark)


def _from_nowhere():
    raise ImportError("No module named 'simulator'")


async def leave():
    """Ends a worker of a cluster."""
    os._exit(1)


class Careless:
    """Changes what it is given, before it raises too, and returns one array again and again."""

    def __init__(self):
        self.buffer = np.zeros((100, GENES))

    def __call__(self, genotypes):
        wrong = bad(genotypes).any()
        self.buffer[: len(genotypes)] = genotypes
        genotypes[:] = 0
        if wrong:
            raise ArithmeticError("the solver did not converge")
        return np.zeros(len(genotypes)), self.buffer[: len(genotypes)]


class Windy:
    """Where a step leads, and a push of the wind, which is the individual's own."""

    n_genes = 3
    seeded = True

    def __call__(self, genotypes, seeds):
        wind = np.array([np.random.default_rng(seed).normal(0, 0.1, 3) for seed in seeds])
        return -genotypes[:, 0], genotypes + wind, genotypes
