"""Ctrl-C, and what else asks a process to end, held back while a state is half changed."""

import _signal  # pyright: ignore[reportMissingImports]
import signal
import threading
from collections.abc import Callable
from typing import Any

# By `_signal`, which `signal` builds upon and makes members of enumerations of its results, at ten times the cost.
_SIGNALS = (int(signal.SIGINT), int(signal.SIGTERM))
_MASKS = hasattr(_signal, "pthread_sigmask")  # not on Windows
_depth = 0
_received: list[int] = []  # while it is not 0


class _Relay:
    """Hands a signal on to its handler; in an `uninterrupted` block, when that is left."""

    def __init__(self, handler: Callable):
        self.handler = handler

    def __call__(self, number: int, frame: Any) -> None:
        if _depth:
            _received.append(number)
        else:
            self.handler(number, frame)


class relayed:
    """A block in which signals that have a Python handler are relayed to it, so that `uninterrupted` blocks within cost little.

    In other threads than the main one there is nothing to relay. A handler that is set within the block stays.
    """

    __slots__ = ("_relays",)

    def __enter__(self) -> None:
        self._relays: list[tuple[int, _Relay]] = []
        if threading.current_thread() is threading.main_thread():
            self._relays = _relays()

    def __exit__(self, *_: object) -> None:
        if self._relays:
            _restore(self._relays)


class uninterrupted:
    """A block in which signals that have a Python handler are held back; they are handled when it is left, however it is.

    In other threads than the main one there is nothing to hold back. Blocks may be nested. A class, because a generation
    enters several, and those of `contextlib` take three times as long.
    """

    __slots__ = ("_relays",)

    def __enter__(self) -> None:
        global _depth
        self._relays: list[tuple[int, _Relay]] | None = None
        if _depth or threading.current_thread() is not threading.main_thread():
            return
        self._relays = _relays()
        _depth = 1

    def __exit__(self, *_: object) -> None:
        global _depth
        if self._relays is None:
            return
        if self._relays or _received:
            return _restore(self._relays)
        try:
            _depth = 0  # from here on a signal may raise, and one that came just before must be handled nevertheless
        finally:
            if _received:
                _restore([])


def _relays() -> list[tuple[int, _Relay]]:
    """Relay the signals that have a handler, and are not relayed."""
    relays = [
        (number, _Relay(handler))
        for number in _SIGNALS
        if callable(handler := _signal.getsignal(number)) and type(handler) is not _Relay
    ]
    try:
        for number, relay in relays:
            _signal.signal(number, relay)
    except BaseException:  # of a signal that came before its turn
        _restore(relays)
        raise
    return relays


def _restore(relays: list[tuple[int, _Relay]]) -> None:
    """Restore all handlers, and then have handled what was received: the first may raise, and none must be left behind."""
    global _depth
    _depth = 1
    before = _signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS) if _MASKS else ()
    try:
        _depth = 0
        for number, relay in relays:
            if _signal.getsignal(number) is relay:
                _signal.signal(number, relay.handler)
        while _received:
            _signal.raise_signal(_received.pop(0))
    finally:
        if _MASKS:
            _signal.pthread_sigmask(signal.SIG_SETMASK, before)


def check_interrupt(error: BaseException) -> None:
    """Raise KeyboardInterrupt if one is behind an error: NumPy, when it is interrupted, may raise a TypeError from it."""
    behind: BaseException | None = error
    while behind is not None:
        if isinstance(behind, KeyboardInterrupt):
            raise behind
        behind = behind.__cause__ or behind.__context__
