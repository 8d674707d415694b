"""Ctrl-C, and what else asks a process to end, held back while a state is half changed."""

import _signal  # pyright: ignore[reportMissingImports]
import signal
import threading
from typing import Any

# By `_signal`, which `signal` builds upon and makes members of enumerations of its results, at ten times the cost.
_SIGNALS = (int(signal.SIGINT), int(signal.SIGTERM))
_MASKS = hasattr(_signal, "pthread_sigmask")  # not on Windows
_depth = 0


class uninterrupted:
    """A block in which signals that have a Python handler are held back; they are handled when it is left, however it is.

    In other threads than the main one there is nothing to hold back. Blocks may be nested. A class, because a generation
    enters several, and those of `contextlib` take three times as long.
    """

    __slots__ = ("_handlers", "_received")

    def __enter__(self) -> None:
        global _depth
        self._handlers: list[tuple[int, Any]] | None = None
        if _depth or threading.current_thread() is not threading.main_thread():
            return
        self._received: list[int] = []
        self._handlers = [(number, handler) for number in _SIGNALS if callable(handler := _signal.getsignal(number))]
        try:
            for number, _ in self._handlers:
                _signal.signal(number, self._hold)
            _depth = 1
        except BaseException:  # of a signal that came before its turn
            self._let_go(self._handlers)
            raise

    def __exit__(self, *_: object) -> None:
        if self._handlers is not None:
            self._let_go(self._handlers)

    def _hold(self, number: int, _: object) -> None:
        self._received.append(number)

    def _let_go(self, handlers: list[tuple[int, Any]]) -> None:
        """Restore all handlers, and then have handled what was received: the first may raise, and none must be left behind."""
        global _depth
        before = _signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS) if _MASKS else ()
        try:
            _depth = 0
            for number, handler in handlers:
                _signal.signal(number, handler)
            for number in self._received:
                _signal.raise_signal(number)
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
