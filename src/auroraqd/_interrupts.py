"""Ctrl-C, and what else asks a process to end, held back while a state is half changed."""

import _signal  # pyright: ignore[reportMissingImports]
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# By `_signal`, which `signal` builds upon and makes members of enumerations of its results, at ten times the cost.
_SIGNALS = (int(signal.SIGINT), int(signal.SIGTERM))
_depth = 0


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back signals that have a Python handler until the block is left; then they are handled.

    In other threads than the main one there is nothing to hold back. Blocks may be nested.
    """
    global _depth
    if _depth or threading.current_thread() is not threading.main_thread():
        yield
        return
    received = []
    # SIGINT is the first to be held back and the last to be let go, so that it cannot come in between.
    handlers = [(number, handler) for number in _SIGNALS if callable(handler := _signal.getsignal(number))]
    try:
        for number, _ in handlers:
            _signal.signal(number, lambda *arguments: received.append(arguments))
        _depth = 1
        yield
    finally:
        _depth = 0
        for number, handler in reversed(handlers):
            _signal.signal(number, handler)
    for arguments in received:
        handler = _signal.getsignal(arguments[0])
        if callable(handler):
            handler(*arguments)
