"""Learned descriptors as bytes and back: no code runs when they are read, and only trusted types are made.

skops does it, but for the few transformers of scikit-learn that are nothing but numbers and arrays, PCA above all. For its list
of what is trusted skops imports all of scikit-learn, which takes up to a third of the time of a short command.
"""

import io
import json
import math
import zipfile
from collections.abc import Sequence
from importlib import import_module
from typing import IO, Any

import numpy as np
from safetensors.numpy import load, save

_PLAIN = {
    "PCA": "sklearn.decomposition",
    "IncrementalPCA": "sklearn.decomposition",
    "TruncatedSVD": "sklearn.decomposition",
}
_REST = "json"  # what is no array; no attribute of theirs is called so
_ZIP = b"PK"  # how a file of skops begins
_PACKED = 200  # times that what is in a packed file may be larger than it
_NETWORKS = ("MLP", "Convolutional", "Image", "Recurrent", "Fused")
_TRUSTED = (  # beyond scikit-learn's
    "auroraqd.AutoEncoder",
    "auroraqd.Streams",
    *(f"auroraqd.descriptors.networks.{name}" for name in _NETWORKS),
)
_FORMERLY = {b'"auroraqd.autoencoder"': b'"auroraqd"'}  # where it was in version 0.2.0
_SCHEMA = "schema.json"


def dumped(transformer: Any) -> bytes:
    """A transformer, fitted or not. Equal ones give equal bytes.

    Raises:
        Exception: whatever a foreign object raises.
    """
    content = _plain(transformer)
    if content is not None:
        return content
    import skops.io

    return _canonical(skops.io.dumps(transformer))


def loaded(content: bytes, trusted: Sequence[str]) -> Any:
    """The transformer again.

    Args:
        content: what `dumped` gave.
        trusted: full names of the types, beyond scikit-learn's and ours, that may be created.

    Raises:
        ValueError: it needs a type that is not trusted, or cannot be imported; or it is damaged.
    """
    try:
        return _from_zip(content, trusted) if content.startswith(_ZIP) else _from_plain(content)
    except _Refused:
        raise
    except Exception as error:  # of a file that somebody wrote, anything
        raise ValueError(f"the descriptor is damaged: {type(error).__name__}: {error}") from None


class _Refused(ValueError):
    """A descriptor that may be whole, but is not to be made, or cannot be."""


def _from_zip(content: bytes, trusted: Sequence[str]) -> Any:
    import skops.io
    from skops.io.exceptions import UntrustedTypesFoundException

    _check_parts(content, 1)
    try:
        return skops.io.loads(_renamed(content), trusted=[*_TRUSTED, *trusted])
    except UntrustedTypesFoundException as error:
        raise _Refused(
            f"the descriptor needs types that are not trusted. {f'{error}'.rstrip('.')}. If you trust them, name them: "
            "trusted=[...], or --trusted"
        ) from None
    except (ImportError, AttributeError) as error:
        raise _Refused(f"the descriptor needs a type that cannot be imported here: {error}") from None


def _check_parts(content: bytes, most: int) -> None:
    """Raise ValueError if what a zip file says about itself does not hold, before anything in it is unpacked.

    Args:
        content: of the file.
        most: times its size that all in it may take. skops packs nothing; sparse matrices are packed, in files within it.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as source:
        if sum(part.file_size for part in source.infolist()) > most * len(content):
            raise ValueError(f"what is in it would take more than {most} times its size")
        for part in source.infolist():
            with source.open(part) as file:
                begin = file.read(len(_ZIP) + 4)
            if begin.startswith(_ZIP + b"\x03\x04"):
                _check_parts(source.read(part), _PACKED)
            elif begin.startswith(b"\x93NUMPY"):
                with source.open(part) as file:
                    _check_array(file, part.file_size)


def _check_array(file: IO[bytes], size: int) -> None:
    """Raise ValueError if an array of NumPy is larger than its file: memory for it would be asked for first."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if math.prod(shape) * dtype.itemsize > size:
        raise ValueError(f"an array of shape {shape} is larger than its file")


def check(transformer: Any) -> None:
    """Make sure that a transformer can be written and read again, by who trusts its types.

    Raises:
        ValueError: it cannot.
    """
    if _plain(transformer) is not None:
        return
    import skops.io

    try:
        content = dumped(transformer)
        loaded(content, skops.io.get_untrusted_types(data=content))
    except Exception as error:
        name = type(transformer).__name__
        raise ValueError(f"descriptor must be one that can be saved, and {name} cannot: {error}") from error


def _plain(transformer: Any) -> bytes | None:
    """A transformer that is listed as plain, as safetensors; None if it is not, or holds anything but numbers and arrays."""
    kind = type(transformer)
    if kind.__name__ not in _PLAIN or kind is not _plain_type(kind.__name__):
        return None
    arrays, rest, turned = {}, {}, []
    for name, value in sorted(vars(transformer).items()):
        if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
            if value.flags.fnc:  # the order in memory may decide how products are rounded
                turned.append(name)
                value = value.T
            arrays[name] = np.array(value, order="C")
        elif value is None or isinstance(value, bool | int | float | str):
            rest[name] = value
        else:
            return None
    text = json.dumps({"type": kind.__name__, "values": rest, "turned": turned})
    return save({**arrays, _REST: np.frombuffer(text.encode(), np.uint8)})


def _from_plain(content: bytes) -> Any:
    arrays = load(content)
    rest = json.loads(arrays.pop(_REST).tobytes())
    if rest["type"] not in _PLAIN:
        raise _Refused(f"the descriptor needs a type that is not known here: {rest['type']}")
    kind = _plain_type(rest["type"])
    transformer = kind.__new__(kind)
    vars(transformer).update(rest["values"])
    for name, array in arrays.items():
        array = array.T if name in rest["turned"] else array
        setattr(transformer, name, array[()])  # a number is an array without axes
    return transformer


def _plain_type(name: str) -> Any:
    return getattr(import_module(_PLAIN[name]), name)


def _canonical(content: bytes) -> bytes:
    """The same skops file, without the memory addresses and times in it: equal objects give equal bytes."""
    numbers: dict[str, str] = {}

    def renumbered(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: renumbered(entry, name) for name, entry in value.items()}
        if isinstance(value, list):
            return [renumbered(entry) for entry in value]
        if key == "__id__":
            return int(numbers.setdefault(str(value), str(len(numbers))))
        if key == "file":
            stem, dot, suffix = value.partition(".")
            return numbers.setdefault(stem, str(len(numbers))) + dot + suffix
        return value

    with zipfile.ZipFile(io.BytesIO(content)) as source:
        members = {name: source.read(name) for name in source.namelist()}
    schema = json.dumps(renumbered(json.loads(members.pop(_SCHEMA)))).encode()
    return _zipped({**{renumbered(name, "file"): member for name, member in members.items()}, _SCHEMA: schema})


def _renamed(content: bytes) -> bytes:
    """The same skops file, its classes where they are today."""
    with zipfile.ZipFile(io.BytesIO(content)) as source:
        if not any(old in source.read(_SCHEMA) for old in _FORMERLY):
            return content
        members = {name: source.read(name) for name in source.namelist()}
    for old, new in _FORMERLY.items():
        members[_SCHEMA] = members[_SCHEMA].replace(old, new)
    return _zipped(members)


def _zipped(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as target:
        for name, member in sorted(members.items()):
            target.writestr(zipfile.ZipInfo(name), member)
    return out.getvalue()
