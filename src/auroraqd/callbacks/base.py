"""What a callback is: a function that is called after each generation, or an object with some of five methods::

start(aurora)               the run begins, or goes on
told(aurora, batch, info)   individuals were evaluated: the `Columns` of all, the descriptor of invalid ones NaN, and their
                            `Info`. Those that wait for the first fit of the descriptor are told once it is fitted
update(aurora)              the descriptor was updated in the generation that is done
generation(aurora)          a generation is done; the run stops when it returns True
end(aurora)                 the run ends, whatever ends it
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from auroraqd._checks import shown

METHODS = ("start", "told", "update", "generation", "end")


class Callbacks:
    """Several callbacks as one.

    Args:
        given: one, a sequence of them, or None.

    Raises:
        TypeError: one is none.
    """

    def __init__(self, given: Any) -> None:
        several = [] if given is None else list(given) if isinstance(given, Sequence) else [given]
        for callback in several:
            has = any(callable(getattr(callback, name, None)) for name in METHODS)
            if isinstance(callback, type) or not (has or callable(callback)):
                raise TypeError(
                    "callback must be callable, an instance and not a class, or have one of the methods "
                    f"{', '.join(METHODS)}, got {shown(callback)}"
                )
        self._several = several
        self._descriptor: Any = None

    def and_then(self, last: Any) -> Callbacks:
        """These, and another after them."""
        return Callbacks([*self._several, last])

    def start(self, aurora: Any) -> None:
        """The run begins."""
        self._descriptor = aurora.descriptor
        self._call("start", aurora)

    def told(self, aurora: Any) -> None:
        """Individuals were evaluated."""
        listening = [callback.told for callback in self._several if callable(getattr(callback, "told", None))]
        if listening:
            batch, info = aurora.latest
            for told in listening:
                told(aurora, batch, info)

    def generation(self, aurora: Any) -> bool:
        """A generation is done: call all, in order. Returns whether the run is to stop."""
        if aurora.descriptor is not self._descriptor:
            self._descriptor = aurora.descriptor
            self._call("update", aurora)
        return any([_is_true(_after_generation(callback)(aurora)) for callback in self._several])

    def end(self, aurora: Any) -> None:
        """The run ends: tell all, also if one of them raises."""
        failure: BaseException | None = None
        for callback in self._several:
            try:
                getattr(callback, "end", _nothing)(aurora)
            except Exception as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _call(self, name: str, *arguments: Any) -> None:
        for callback in self._several:
            getattr(callback, name, _nothing)(*arguments)


def _after_generation(callback: Any) -> Callable[[Any], Any]:
    own = getattr(callback, "generation", None)
    return own if callable(own) else callback if callable(callback) else _nothing


def _nothing(*_: Any) -> None:
    pass


def _is_true(value: Any) -> bool:
    """Whether it is True, of Python or of NumPy: what else a callback returns means nothing."""
    return isinstance(value, bool | np.bool_) and bool(value)
