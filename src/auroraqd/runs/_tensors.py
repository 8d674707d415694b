"""Files of arrays that know when they are damaged: safetensors with a checksum of all their bytes.

The checksum is an array of the file itself. It is taken with its own bytes at zero.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from auroraqd._files import replacing
from auroraqd.observations import has_streams, observations, streams_of

_CHECKSUM = "checksum"
_DIGEST = 32  # bytes
_OF = "/"  # between the name of an array and that of its stream
_MOST_HEADER = 10**8  # bytes, as safetensors has it


def write(path: Path, arrays: Mapping[str, np.ndarray], form: str, text: str, *, lasting: bool = True) -> None:
    """Write arrays, and a text with them, in place of a file that is there. Equal arrays give equal bytes.

    Args:
        path: of the file.
        arrays: by name.
        form: the name of the format.
        text: anything.
        lasting: see `auroraqd._files.replacing`.

    Raises:
        OSError: it cannot be written; what was there before stays.
    """
    contiguous = {name: np.asarray(array, order="C") for name, array in _apart(arrays).items()}
    # One entry of metadata: of several, safetensors does not keep the order.
    content = save({**contiguous, _CHECKSUM: np.zeros(_DIGEST, np.uint8)}, {form: text})
    place = _place(content, _header(content))
    with replacing(path, lasting=lasting) as file:
        file.write(memoryview(content)[: place.start])
        file.write(_digest(content, place))
        file.write(memoryview(content)[place.stop :])


def read(path: Path, form: str) -> tuple[dict[str, np.ndarray], str]:
    """The arrays of a file, by name, and the text with them.

    It takes twice the memory of the arrays for a moment.

    Raises:
        ValueError: it is damaged, or of another format.
        OSError: it cannot be read.
    """
    try:
        _check_size(path)
        content = path.read_bytes()
        header = _header(content)
        metadata = header.get("__metadata__", {})
        if form not in metadata:
            raise _OtherFormat(f"{path} must be of the format {form!r}, got one with the metadata {metadata}")
        place = _place(content, header)
        if content[place] != _digest(content, place):
            raise ValueError("its checksum is wrong")
        arrays = load(content)
    except _OtherFormat:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, SafetensorError) as error:
        raise ValueError(f"{path} is damaged: {error}") from None
    del arrays[_CHECKSUM]
    try:
        return _together(arrays), metadata[form]
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from None


def text(path: Path, form: str) -> str:
    """The text of a file alone, without a look at its arrays.

    Raises:
        ValueError: there is none: it is damaged, or of another format.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        if length > _MOST_HEADER:
            raise ValueError(f"{path} is damaged: it is cut off")
        header = json.loads(file.read(length))
    try:
        return header["__metadata__"][form]
    except (KeyError, TypeError):
        raise ValueError(f"{path} must be of the format {form!r}") from None


def _apart(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays, of those with streams each by itself: the format has no structured ones."""
    found = {}
    for name, array in arrays.items():
        streams = streams_of(array).items() if has_streams(array) else ()
        found.update({f"{name}{_OF}{stream}": rows for stream, rows in streams} or {name: array})
    return found


def _together(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What `_apart` was given."""
    found: dict[str, Any] = {}
    for name, array in arrays.items():
        whole, _, stream = name.partition(_OF)
        if stream:
            found.setdefault(whole, {})[stream] = array
        else:
            found[name] = array
    return {name: observations(name, array) if isinstance(array, dict) else array for name, array in found.items()}


class _OtherFormat(ValueError):
    """A file that may be whole, but is not what it should be."""


def _header(content: bytes) -> dict:
    """What is at the beginning of a safetensors file: its length in eight bytes, then JSON."""
    length = int.from_bytes(content[:8], "little")
    if len(content) < 8 + length:
        raise ValueError("it is cut off")
    return json.loads(content[8 : 8 + length])


def _check_size(path: Path) -> None:
    """Raise ValueError unless a file is as large as it says, before memory is asked for: it may have holes."""
    size = path.stat().st_size
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        if size < 8 + length or length > _MOST_HEADER:
            raise ValueError("it is cut off")
        parts = json.loads(file.read(length))
    ends = [part["data_offsets"][1] for name, part in parts.items() if name != "__metadata__"]
    if 8 + length + max(ends, default=0) != size:
        raise ValueError(f"it has {size:,} bytes, and not {8 + length + max(ends, default=0):,}")


def _place(content: bytes, header: dict) -> slice:
    """Where the checksum is."""
    if _CHECKSUM not in header:
        raise ValueError("it has no checksum")
    begin, end = header[_CHECKSUM]["data_offsets"]
    data = 8 + int.from_bytes(content[:8], "little")
    if not 0 <= begin <= end <= len(content) - data or end - begin != _DIGEST:
        raise ValueError("it is cut off")
    return slice(data + begin, data + end)


def _digest(content: bytes, place: slice) -> bytes:
    """The checksum, with zeros where it is."""
    digest, whole = hashlib.blake2b(digest_size=_DIGEST), memoryview(content)
    for part in (whole[: place.start], bytes(_DIGEST), whole[place.stop :]):
        digest.update(part)
    return digest.digest()
