"""Files: replaced as a whole, so that a crash leaves the old one or the new one, never half of one; and tables of records."""

import contextlib
import csv
import math
import mmap
import os
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from auroraqd._checks import shown

_MOST = 2**63  # of a whole number in a table
_MOST_BYTES = 2**30  # of a file of text
_Row = TypeVar("_Row", bound=tuple)


def as_path(name: str, value: Any) -> Path:
    """A path, of what the user gave as one.

    Raises:
        TypeError, ValueError: it is none.
    """
    try:
        path = Path(value)
    except TypeError:
        raise TypeError(f"{name} must be a path, got {shown(value)}") from None
    if "\0" in str(path):
        raise ValueError(f"{name} must be a path, got {shown(value)}")
    return path


def told(error: OSError, what: str) -> OSError:
    """The same kind of error as a sentence, without the number: what could not be done, and why."""
    try:
        sentence = type(error)(f"{what}: {error.strerror or error}")
    except TypeError:  # a kind that is made in another way
        sentence = OSError(f"{what}: {error.strerror or error}")
    sentence.errno = error.errno
    return sentence


def folder_at(path: Path) -> Path:
    """A folder, created with those above it if need be.

    Raises:
        OSError: there cannot be one.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        what = "a link that leads nowhere" if path.is_symlink() and not path.exists() else "a file"
        raise NotADirectoryError(f"{path} must be a folder, and is {what}") from None
    except OSError as error:
        raise told(error, f"the folder {path} could not be created") from None
    return path


@contextlib.contextmanager
def replacing(path: Path, *, lasting: bool = True) -> Iterator[Any]:
    """A binary file that takes the place of `path` when it is complete and on disk, and not before.

    Args:
        path: of the file.
        lasting: whether to wait until it is on disk. What is not waited for survives the end of the process, and may be lost,
            or damaged, where the machine itself stops.

    Raises:
        OSError: it cannot be written; what was there before stays.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):  # not of another file
            raise told(error, f"{path} could not be written") from error
        raise
    if lasting:
        _sync_folder(path.parent)


def mapped(folder: Path, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """An array in a file of a folder instead of memory. The file has no name, and goes when the array does.

    Raises:
        OSError: there cannot be such a file, or the disk has not the room.
    """
    size = math.prod(shape) * dtype.itemsize
    if size == 0:
        return np.empty(shape, dtype)
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            if hasattr(os, "posix_fallocate"):  # where a disk that is full would else end the process when it is written to
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                file.truncate(size)
            memory = mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise told(error, f"{folder} has no room for {size:,} bytes of observations") from None
    return np.frombuffer(memory, dtype).reshape(shape)


def room_in(folder: str | os.PathLike) -> Callable[[tuple[int, ...], np.dtype], np.ndarray]:
    """Makes arrays for observations in a folder, which is created if needed; see `mapped`."""
    return partial(mapped, folder_at(as_path("observations", folder).absolute()))


def _sync_folder(folder: Path) -> None:
    """Make the move itself last; not every system can open a folder."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def text_of(path: Path) -> str:
    """What a file of text holds.

    Raises:
        ValueError: it is damaged: no text, or more than anybody wrote.
    """
    size = path.stat().st_size
    if size > _MOST_BYTES:  # it may have holes, which memory has not
        raise ValueError(f"{path} is damaged: it has {size:,} bytes")
    try:
        return path.read_text()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is damaged: {error}") from None


def read_table(path: Path, kind: type[_Row], *, rest: str | None = None) -> list[_Row]:
    """The records of a CSV file whose columns are the fields of a `NamedTuple`, of strings and numbers.

    Args:
        path: of the file.
        kind: of the records.
        rest: a field that holds all further columns, numbers, as a dictionary. Without it there must be none.

    Raises:
        ValueError: the file is damaged.
    """
    fields: dict[str, Any] = {name: of for name, of in kind.__annotations__.items() if name != rest}
    try:
        header, *rows = list(csv.reader(text_of(path).splitlines())) or [[]]
        wanted = set(fields) - set(getattr(kind, "_field_defaults"))  # noqa: B009 - of a `NamedTuple`; earlier versions had fewer
        if not wanted <= set(header) or len(set(header)) < len(header) or (rest is None and len(header) > len(fields)):
            raise ValueError(f"the columns must be {', '.join(fields)}")
        for line, row in enumerate(rows, start=2):
            if len(row) != len(header):
                raise ValueError(f"line {line} must have {len(header)} columns, got {len(row)}")
        return [_record(kind, fields, dict(zip(header, row, strict=True)), rest) for row in rows]
    except (ValueError, csv.Error) as error:
        text = f"{error}"
        raise ValueError(text if text.startswith(f"{path} is damaged") else f"{path} is damaged: {text}") from None


def _record(kind: type[_Row], fields: dict[str, Any], row: dict[str, str], rest: str | None) -> _Row:
    values = {name: _cell(name, of, row.pop(name)) for name, of in fields.items() if name in row}
    for name, value in values.items():
        if isinstance(value, int) and abs(value) > _MOST:
            raise ValueError(f"{name} is too large")
    return kind(**values, **({} if rest is None else {rest: {name: _cell(name, float, value) for name, value in row.items()}}))


def _cell(name: str, kind: Any, text: str) -> Any:
    try:
        return kind(text)
    except ValueError:
        raise ValueError(f"{name} must be a {'whole ' * (kind is int)}number, got {shown(text)}") from None
