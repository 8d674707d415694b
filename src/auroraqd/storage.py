"""Run folders: what a run leaves on disk.

    config.json              the settings, enough to run it again, and the versions and machine it ran on
    history.csv              one `auroraqd.history.Record` a line
    repertoire.safetensors   the columns of the archive, with the descriptor they were found with
    figures/                 pictures

Files are written beside their place, synced and moved there, so a crash leaves the old file or the new one, never half of
one. Loading runs no code from a file: arrays are safetensors, scikit-learn estimators go through skops, and nothing is
unpickled.
"""

import io
import json
import math
import os
import platform
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as save_tensors

from auroraqd._files import read_table, replacing
from auroraqd.aurora import Aurora
from auroraqd.descriptor import OBSERVATION, Descriptor
from auroraqd.history import Record
from auroraqd.repertoire import OPTIONAL, REQUIRED, Repertoire
from auroraqd.scaling import Scaling

CONFIG, HISTORY, REPERTOIRE, FIGURES = "config.json", "history.csv", "repertoire.safetensors", "figures"
_PICTURES = ("repertoire.*", "history.*", "skills.*", "skill-*.*")  # in figures/, of what is stored
_FORMAT = "auroraqd repertoire 1"  # the one metadata key: with several, safetensors writes them in any order
_LEARNED = "learned"
_TRUSTED = ("auroraqd.autoencoder.AutoEncoder",)  # beyond scikit-learn's
_VERSIONS = ("auroraqd", "numpy", "scipy", "scikit-learn", "numba", "jax", "equinox", "optax")


def save(aurora: Aurora, folder: str | os.PathLike, *, config: Mapping[str, Any] | None = None) -> Path:
    """Write a run folder, creating it if needed; its files are replaced.

    Args:
        aurora: the run.
        folder: where.
        config: what to keep as settings; by default those of `aurora`.

    Returns:
        The folder.

    Raises:
        OSError: it cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    config = {**(settings_of(aurora) if config is None else config), "environment": environment()}
    _write(folder / REPERTOIRE, _repertoire_bytes(aurora))
    _write(folder / HISTORY, _history_csv(aurora.history.records).encode())
    _write(folder / CONFIG, (json.dumps(config, indent=2) + "\n").encode())
    for path in [path for pattern in _PICTURES for path in (folder / FIGURES).glob(pattern)]:
        path.unlink()  # it shows what was there before
    return folder


def load(folder: str | os.PathLike, *, trusted: Sequence[str] = ()) -> Repertoire:
    """The repertoire of a run folder.

    Args:
        folder: as written by `auroraqd run` or `auroraqd.save`.
        trusted: full names of the types, beyond scikit-learn's, that may be created to load the descriptor,
            for instance `["mymodule.MyEncoder"]`. Needed by `Repertoire.describe` only.

    Raises:
        FileNotFoundError: the folder, or the repertoire in it, does not exist.
        ValueError: the repertoire is damaged, or of another format.
    """
    path = _existing(folder, REPERTOIRE)
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dictionary
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{path} is damaged: {error}") from None
    if _FORMAT not in metadata:
        raise ValueError(f"{path} must be of the format {_FORMAT!r}, got one with the metadata {metadata}")
    columns = {name: arrays.pop(name) for name in (*REQUIRED, *OPTIONAL) if name in arrays}
    return Repertoire(columns, lambda: _load_descriptor(metadata[_FORMAT], arrays, columns, trusted))


def load_config(folder: str | os.PathLike) -> dict[str, Any]:
    """The settings of a run folder.

    Raises:
        FileNotFoundError: there are none.
        ValueError: they are damaged.
    """
    path = _existing(folder, CONFIG)
    try:
        config = json.loads(path.read_text())
    except (ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is damaged: {error}") from None
    if not isinstance(config, dict):
        raise ValueError(f"{path} must hold a JSON object")
    return config


def load_history(folder: str | os.PathLike) -> list[Record]:
    """The records of a run folder.

    Raises:
        FileNotFoundError: there are none.
        ValueError: they are damaged.
    """
    return read_table(_existing(folder, HISTORY), Record)


def settings_of(aurora: Aurora) -> dict[str, Any]:
    """The settings of a run as JSON values."""
    archive = aurora.archive
    return {
        "n_genes": aurora.n_genes,
        "descriptor": _named(aurora.descriptor.source),
        "seed": aurora.seed,
        "batch_size": aurora.batch_size,
        "archive": {"type": type(archive).__name__, **archive.settings},
        **{name: as_json(getattr(aurora, name)) for name in ("selection", "variation", "resolution", "schedule")},
    }


def _named(source: Any) -> str:
    """What a descriptor is called: its `repr` if that says more than where it lies in memory."""
    text = source if isinstance(source, str) else repr(source)
    return type(source).__qualname__ if " object at 0x" in text else text


def as_json(strategy: Any) -> Any:
    """A strategy as its type and fields, or what it is called if it is no dataclass."""
    if is_dataclass(strategy) and not isinstance(strategy, type):
        return {"type": type(strategy).__name__, **asdict(strategy)}
    return None if strategy is None else getattr(strategy, "__qualname__", repr(strategy))


def environment() -> dict[str, Any]:
    """What bit-for-bit repetition depends on besides the settings."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in _VERSIONS},
        "machine": platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
    }


def _history_csv(records: Sequence[Record]) -> str:
    lines = [",".join(Record._fields)]
    lines += [",".join("nan" if isinstance(v, float) and math.isnan(v) else repr(v) for v in record) for record in records]
    return "\n".join(lines) + "\n"


def _repertoire_bytes(aurora: Aurora) -> bytes:
    archive, descriptor = aurora.archive, aurora.descriptor
    arrays = {name: getattr(archive, name) for name in (*REQUIRED, *OPTIONAL) if getattr(archive, name) is not None}
    kind = descriptor.source if isinstance(descriptor.source, str) else _LEARNED
    if descriptor.scaling is not None:
        arrays["scaling.low"], arrays["scaling.high"] = descriptor.scaling
        transformer = None if isinstance(descriptor.source, str) else _transformer_bytes(descriptor.source)
        if transformer is not None:
            arrays["transformer.skops"] = np.frombuffer(transformer, np.uint8)
    return save_tensors({name: np.ascontiguousarray(array) for name, array in arrays.items()}, {_FORMAT: kind})


def _transformer_bytes(transformer: Any) -> bytes | None:
    import skops.io

    try:
        return _canonical(skops.io.dumps(transformer))
    except Exception as error:  # whatever a foreign object raises, the repertoire itself must not be lost
        warnings.warn(
            f"{type(transformer).__name__} cannot be saved with the repertoire, which will not be able to describe new "
            f"observations: {error}",
            stacklevel=2,
        )
        return None


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
    schema = json.dumps(renumbered(json.loads(members.pop("schema.json")))).encode()
    renamed = {renumbered(name, "file"): members[name] for name in members}
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as target:
        for name, member in sorted({**renamed, "schema.json": schema}.items()):
            target.writestr(zipfile.ZipInfo(name), member)
    return out.getvalue()


def _load_descriptor(
    kind: str, arrays: Mapping[str, np.ndarray], columns: Mapping[str, np.ndarray], trusted: Sequence[str]
) -> Descriptor:
    shape = columns["observation"].shape[1:]
    if kind != _LEARNED:
        named = Descriptor(kind)
        return named.restored(Scaling(arrays["scaling.low"], arrays["scaling.high"]), shape) if kind == OBSERVATION else named
    if "transformer.skops" not in arrays:
        raise ValueError("the repertoire was saved without its transformer")
    import skops.io
    from skops.io.exceptions import UntrustedTypesFoundException

    try:
        transformer = skops.io.loads(arrays["transformer.skops"].tobytes(), trusted=[*_TRUSTED, *trusted])
    except UntrustedTypesFoundException as error:
        raise ValueError(
            f"the descriptor needs types that are not trusted. {error}. If you trust them: load(folder, trusted=[...])"
        ) from None
    except (ImportError, AttributeError) as error:
        raise ValueError(f"the descriptor needs a type that cannot be imported here: {error}") from None
    scaling = Scaling(arrays["scaling.low"], arrays["scaling.high"])
    return Descriptor(transformer).restored(scaling, shape)


def _existing(folder: str | os.PathLike, name: str) -> Path:
    if not Path(folder).is_dir():
        raise FileNotFoundError(f"there is no folder {os.fspath(folder)}")
    path = Path(folder) / name
    if not path.is_file():
        raise FileNotFoundError(f"{os.fspath(folder)} is no run folder: there is no {name} in it")
    return path


def _write(path: Path, content: bytes) -> None:
    try:
        with replacing(path) as file:
            file.write(content)
    except OSError as error:
        raise OSError(f"{path} could not be written: {error.strerror}") from error
