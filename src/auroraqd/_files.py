"""Files: replaced as a whole, so that a crash leaves the old one or the new one, never half of one; and tables of records."""

import contextlib
import csv
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

_Row = TypeVar("_Row", bound=tuple)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Any]:
    """A binary file that takes the place of `path` when it is complete and on disk, and not before."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Make the move itself last; not every system can open a folder."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def read_table(path: Path, kind: type[_Row]) -> list[_Row]:
    """The records of a CSV file whose columns are the fields of a `NamedTuple`, of strings and numbers.

    Raises:
        ValueError: the file is damaged.
    """
    fields: dict[str, Any] = kind.__annotations__
    try:
        with path.open(newline="") as file:
            header, *rows = csv.reader(file)
        if header != list(fields):
            raise ValueError(f"the columns must be {', '.join(fields)}")
        return [kind(*(of(value) for of, value in zip(fields.values(), row, strict=True))) for row in rows]
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path} is damaged: {error}") from None
