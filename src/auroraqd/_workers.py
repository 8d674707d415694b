"""Worker processes: each with libraries that keep to one thread, and gone when their parent is, however it ends."""

import multiprocessing
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import wait

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")


def cores() -> list[int]:
    """The cores that this process may use."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


@contextmanager
def one_thread() -> Iterator[None]:
    """An environment for processes to start in: their libraries keep to one thread, and they read this program again only if
    it is in a file: of one on standard input, multiprocessing would look for a file "<stdin>".
    """
    wanted = {
        **dict.fromkeys(_THREADS, "1"),
        "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false",
    }
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    main = vars(sys.modules["__main__"])
    file = main.get("__file__")
    nowhere = file is not None and not os.path.exists(file)
    if nowhere:
        del main["__file__"]
    try:
        yield
    finally:
        if nowhere:
            main["__file__"] = file
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def settle(core: int | None = None) -> None:
    """In a new worker: leave Ctrl-C to the parent, end with it, and keep to a core."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})  # which is also how many threads XLA starts


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
