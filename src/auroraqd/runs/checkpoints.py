"""Checkpoints: a run is saved now and then while it goes on, so that no crash costs more than a few seconds of it."""

import gc
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from filelock import FileLock, Timeout

from auroraqd._checks import flag, function, number
from auroraqd._files import as_path, folder_at, told
from auroraqd._interrupts import uninterrupted
from auroraqd.aurora import Aurora
from auroraqd.emitters.base import EmitterError
from auroraqd.runs import _transformers, folders
from auroraqd.runs._pieces import Piece

LOCK = ".lock"
_SHARE = 0.02  # of the time of a run, at most, for checkpoints between its beginning and its end


class Checkpoints:
    """A context in which a run is saved: when its object is called and it is time to, and at the end, whatever ends it.

    With `ask` and `tell`, call it after each. The last two checkpoints are kept. While the context is open, no other process
    can open one on the same folder.

    Args:
        aurora: the run.
        folder: where; see `auroraqd.runs.folders`. Created if needed.
        every: seconds between two checkpoints, at least; the first is due at once. More, if writing takes long: checkpoints
            take no more than 2% of the time. 0: one at every call.
        config: what to keep as settings; by default those of `aurora`.
        overwrite: whether another run in the folder, or one that is further, may be replaced.
        report: told, in a sentence, when a checkpoint could not be written, because the disk is full for instance. The run goes
            on, and it is tried again. By default a warning.

    Raises:
        TypeError: the run or the folder is something else.
        ValueError: the descriptor cannot be saved; there is another run in the folder; `every` is negative.
        BlockingIOError: another process has a run in the folder.
        RuntimeError: it is opened twice, or called when it is not open.
        OSError: on entry, there cannot be such a folder; at the end, the run could not be saved.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, "genotype", seed=0)
        >>> with auroraqd.Checkpoints(aurora, "runs/mine") as checkpoints:
        ...     aurora = aurora.run(task, generations=5, callback=checkpoints)
        >>> auroraqd.resume("runs/mine").generation  # after a crash, or to go on further
        5
    """

    def __init__(
        self,
        aurora: Aurora,
        folder: str | os.PathLike,
        *,
        every: float = 10.0,
        config: Mapping[str, Any] | None = None,
        overwrite: bool = False,
        report: Callable[[str], Any] = lambda text: warnings.warn(text, stacklevel=4),
    ) -> None:
        folders.check_run(aurora)
        self.aurora = aurora
        self.folder = as_path("folder", folder).absolute()  # a task may change the current folder
        self._every = number("every", every)
        folders.check_config(config)
        self._config = config
        self._overwrite = flag("overwrite", overwrite)
        self._report = function("report", report)
        self._lock = FileLock(self.folder / LOCK, timeout=0)
        self._keep = False  # whether the checkpoint in the folder is of this run
        self._first = False  # whether there was nothing in the folder
        self._next = 0.0
        self._saved: tuple[object, ...] | None = None
        self._pieces: Sequence[Piece] = ()

    def __enter__(self) -> "Checkpoints":
        if self._lock.is_locked:
            raise RuntimeError("these checkpoints are open already: one `with` block at a time")
        if not isinstance(self.aurora.descriptor.source, str):
            _transformers.check(self.aurora.descriptor.source)
        folder_at(self.folder)
        try:
            with uninterrupted():  # or it is locked, and nobody knows
                self._lock.acquire()
        except Timeout:
            raise BlockingIOError(f"{self.folder} is in use: another process has a run there") from None
        except OSError as error:
            raise told(error, f"nothing can be written into {self.folder}") from None
        try:
            self._keep = folders.goes_on(self.aurora, self.folder, self._overwrite)
            self._first = not (self.folder / folders.CONFIG).exists()
            if self._first:  # from the settings alone a run can be done again, should it crash before the first checkpoint
                folders.write_config(self.aurora, self.folder, self._config)
        except BaseException:
            self._lock.release()
            raise
        self._next = time.monotonic()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            with uninterrupted():  # an impatient second Ctrl-C
                if not self.saved and (self.aurora.evaluations or self._saved):
                    self._save()
                elif self._first and self._saved is None:  # nothing was found
                    (self.folder / folders.CONFIG).unlink(missing_ok=True)
        finally:
            self._lock.release()  # the file stays: to remove it would let two others lock two files of one name

    @property
    def saved(self) -> bool:
        """Whether the run as it is now is in the folder."""
        return self._now() == self._saved

    def __call__(self, aurora: Aurora | None = None) -> None:
        """Save the run, if it is time to. The argument is that of a callback of `Aurora.run`, and is not needed."""
        if not self._lock.is_locked:
            raise RuntimeError("checkpoints are written inside their `with` block, while no other process can")
        began = time.monotonic()
        if began < self._next:
            return
        try:
            with uninterrupted():
                self._save()
        except (OSError, EmitterError) as error:
            self._report(f"no checkpoint at generation {self.aurora.generation}: {error}")
        now = time.monotonic()
        self._next = now + (self._every and max(self._every, (now - began) / _SHARE))

    def _save(self) -> None:
        with _collector_waiting():
            self._pieces = folders.write(self.aurora, self.folder, self._config, keep=self._keep, pieces=self._pieces)
        self._keep = True
        self._saved = self._now()

    def _now(self) -> tuple[object, ...]:
        """What changes whenever the run does."""
        aurora = self.aurora
        return aurora.generation, aurora.evaluations, len(aurora.events), aurora.pending is not None


@contextmanager
def _collector_waiting() -> Iterator[None]:
    """Put off Python's garbage collection, which takes longer than a checkpoint, and which the many numbers of one set off."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
