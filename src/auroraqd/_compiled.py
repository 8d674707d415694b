"""Kernels: functions that Numba compiles, and keeps on disk wherever there is a place for them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

import numba
from numba.core import config, event

from auroraqd._caches import home_is_known, private_folder, say_where_kernels_are

_F = TypeVar("_F", bound=Callable)
_FOLDER = "CACHE_DIR"  # of Numba's configuration: what NUMBA_CACHE_DIR says


def compiled(**options: Any) -> Callable[[_F], _F]:
    """Numba's `njit(cache=True, **options)`, which also works where Numba finds no folder to keep kernels in.

    Numba looks for one when a function is decorated: `NUMBA_CACHE_DIR`, beside the module, the cache of the user. Where none
    of them can be written, in an image of a container for instance, it raises. Then it is given our private folder, or none.
    """

    def decorated(function: Any) -> Any:
        given = getattr(config, _FOLDER)
        if given or home_is_known():
            with suppress(RuntimeError):  # no locator available
                return numba.njit(cache=True, **options)(function)
        say_where_kernels_are()
        folder = private_folder()
        if folder is None:
            return numba.njit(**options)(function)
        setattr(config, _FOLDER, str(folder / "kernels"))
        try:
            return numba.njit(cache=True, **options)(function)
        finally:
            setattr(config, _FOLDER, given)  # functions of others are no concern of ours

    return decorated


@contextmanager
def compiling(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell` when the first kernel is really compiled, and not found on disk."""

    class Listener(event.Listener):
        told = False

        def on_start(self, event: event.Event) -> None:
            if not self.told:
                self.told = True
                tell()

        def on_end(self, event: event.Event) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield
