"""Ctrl-C, and what else asks a process to end, held back while a state is half changed."""

import _signal  # pyright: ignore[reportMissingImports]
import signal
import threading
from typing import Any

# By `_signal`, which `signal` builds upon and makes members of enumerations of its results, at ten times the cost.
_SIGNALS = (int(signal.SIGINT), int(signal.SIGTERM))
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
        self._received: list[tuple[Any, ...]] = []
        # SIGINT is the first to be held back and the last to be let go, so that it cannot come in between.
        self._handlers = [(number, handler) for number in _SIGNALS if callable(handler := _signal.getsignal(number))]
        try:
            for number, _ in self._handlers:
                _signal.signal(number, self._hold)
            _depth = 1
        except BaseException:  # of a signal that came before its turn
            self._let_go()
            raise

    def __exit__(self, *_: object) -> None:
        if self._handlers is None:
            return
        self._let_go()
        for arguments in self._received:
            handler = _signal.getsignal(arguments[0])
            if callable(handler):
                handler(*arguments)

    def _hold(self, *arguments: Any) -> None:
        self._received.append(arguments)

    def _let_go(self) -> None:
        global _depth
        _depth = 0
        for number, handler in reversed(self._handlers or ()):
            _signal.signal(number, handler)
