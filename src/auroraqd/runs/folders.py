"""Run folders: what a run leaves on disk, and how it goes on from there.

    config.json                       the settings, enough to run it again, and the versions and machine it ran on
    history.csv                       one `auroraqd.history.Record` a line
    repertoire.safetensors            a checkpoint: the columns of the archive, the descriptor they were found with, and all
                                      else that the run needs to go on; with a checksum
    repertoire.previous.safetensors   the checkpoint before it, while there is one
    observations/                     the observations of both, where they are large, in files of their own
    snapshots/                        some of the skills at each update of the descriptor (`auroraqd.runs.snapshots`)
    figures/                          pictures

Files are written beside their place, synced and moved there, so a crash leaves the old file or the new one, never half of
one. Loading runs no code from a file: arrays are safetensors, learned descriptors too or by skops, and nothing is unpickled.
"""

import json
import math
import os
import platform
import warnings
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from auroraqd._checks import flag, function, instance, mapping, shown
from auroraqd._files import as_path, folder_at, read_table, replacing, room_in, text_of
from auroraqd.archives.base import Archive
from auroraqd.aurora import Aurora
from auroraqd.descriptors.descriptor import NAMES, OBSERVATION, Descriptor, Transformer
from auroraqd.descriptors.scaling import Scaling
from auroraqd.history import History, Record
from auroraqd.individuals import KNOWN
from auroraqd.provenance import layers_in, made_again, made_by, task_in
from auroraqd.repertoire import Repertoire
from auroraqd.runs import _pieces, _tensors, _transformers
from auroraqd.runs._saved import as_layout, check_arrays, check_values
from auroraqd.runs.state import State, is_of, restored, settings_of, state_of

CONFIG, HISTORY, REPERTOIRE, FIGURES = "config.json", "history.csv", "repertoire.safetensors", "figures"
PREVIOUS = "repertoire.previous.safetensors"
_PICTURES = ("repertoire.*", "history.*", "skills.*", "skill-*.*")  # in figures/, of what is stored
_FORMAT = "auroraqd repertoire 2"
_LEARNED, _BUDGET = "learned", "generations"
_LOW, _HIGH, _LIMIT, _TRANSFORMER = "scaling.low", "scaling.high", "scaling.limit", "transformer.skops"
_STATE = "state.json"
_Made = TypeVar("_Made")
_VERSIONS = ("auroraqd", "numpy", "scipy", "scikit-learn", "numba", "jax", "equinox", "optax")


def save(
    aurora: Aurora, folder: str | os.PathLike, *, config: Mapping[str, Any] | None = None, overwrite: bool = False
) -> Path:
    """Write a run folder, creating it if needed. An earlier moment of the same run is replaced.

    Args:
        aurora: the run, at any moment.
        folder: where.
        config: what to keep as settings; by default those of `aurora`.
        overwrite: whether another run in the folder, or one that is further, may be replaced.

    Returns:
        The folder.

    Raises:
        OSError: it cannot be written.
        TypeError: the run or the folder is something else.
        ValueError: there is another run in the folder, or this one at a later generation, or one that cannot be read.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, "genotype", seed=0).run(task, generations=2)
        >>> sorted(path.name for path in auroraqd.save(aurora, "runs/saved").iterdir())
        ['config.json', 'history.csv', 'repertoire.safetensors']
    """
    folder = as_path("folder", folder)
    check_run(aurora)
    check_config(config)
    goes_on(aurora, folder, flag("overwrite", overwrite))
    write(aurora, folder, config)
    return folder


def check_run(aurora: Any) -> None:
    """Raise TypeError unless it is a run: a repertoire alone cannot go on."""
    instance("aurora", aurora, Aurora, "a run, an auroraqd.Aurora")


def check_config(config: Any) -> None:
    """Raise TypeError or ValueError unless it can be kept as settings: before anything is written."""
    if config is None:
        return
    try:
        json.dumps(dict(mapping("config", config)))
    except (TypeError, ValueError, RecursionError) as error:
        raise TypeError(f"config must be a dictionary of JSON values, got {shown(config)}: {error}") from None


def _checked_trust(trusted: Any) -> list[str]:
    several = isinstance(trusted, Sequence | AbstractSet) and not isinstance(trusted, str)
    if not several or not all(isinstance(name, str) for name in trusted):
        raise TypeError(f'trusted must be names of types, like ["mymodule.MyEncoder"], got {shown(trusted)}')
    return list(trusted)


def write(
    aurora: Aurora,
    folder: Path,
    config: Mapping[str, Any] | None,
    *,
    keep: bool = False,
    pieces: Sequence[_pieces.Piece] = (),
) -> Sequence[_pieces.Piece]:
    """As `save`; if `keep`, the checkpoint that is there becomes the one before.

    Args:
        aurora, folder, config: see `save`.
        keep: else the checkpoint before, if there is one, is removed: it may be of another run.
        pieces: what this returned for the checkpoint that is there, if it is of the same run.

    Returns:
        Large observations, and where they are.
    """
    check_no_layer(aurora._task, folder)
    folder_at(folder)
    _write(folder / HISTORY, _history_csv(aurora.history.records))
    if keep:
        _keep(folder)
    arrays, kind = _contents(aurora, config)
    arrays, pieces = _pieces.apart(folder, arrays, pieces)
    _tensors.write(folder / REPERTOIRE, arrays, _FORMAT, kind)
    if not keep:
        (folder / PREVIOUS).unlink(missing_ok=True)
    _pieces.remove_others(folder, pieces, lambda: _tensors.read(folder / PREVIOUS, _FORMAT)[0])
    write_config(aurora, folder, config)
    for path in [path for pattern in _PICTURES for path in (folder / FIGURES).glob(pattern)]:
        path.unlink()  # it shows what was there before
    return pieces


def check_no_layer(task: Mapping[str, Any] | None, folder: Path) -> None:
    """Raise ValueError if a described task executes skills of a folder, in which its own are to be."""
    if folder.resolve() in [Path(layer).resolve() for layer in layers_in(task)]:
        raise ValueError(f"{folder} is a layer of the task, which executes skills from there: choose another folder")


def write_config(aurora: Aurora, folder: Path, config: Mapping[str, Any] | None) -> None:
    """The settings alone, as `save` writes them."""
    config = {**(settings_of(aurora) if config is None else config), "environment": environment()}
    aurora._made = aurora._made or made_by()
    config["provenance"] = {**aurora._made, "task": aurora._task}
    _write(folder / CONFIG, json.dumps(config, indent=2) + "\n")


def _keep(folder: Path) -> None:
    """Give the checkpoint a second name, so that there is one under the first until it is replaced."""
    with suppress(FileNotFoundError):
        (folder / PREVIOUS).unlink(missing_ok=True)
        try:
            (folder / PREVIOUS).hardlink_to(folder / REPERTOIRE)
        except (OSError, NotImplementedError):  # a file system without them
            (folder / REPERTOIRE).replace(folder / PREVIOUS)


def load(folder: str | os.PathLike, *, trusted: Sequence[str] = ()) -> Repertoire:
    """The repertoire of a run folder, also of a run that is under way.

    Args:
        folder: as written by `auroraqd run`, `auroraqd.save` or `auroraqd.Checkpoints`.
        trusted: full names of the types, beyond scikit-learn's, that may be created to load the descriptor,
            for instance `["mymodule.MyEncoder"]`. Needed by `Repertoire.describe` only.

    Raises:
        TypeError: an argument is of the wrong kind.
        FileNotFoundError: the folder, or the repertoire in it, does not exist.
        ValueError: the repertoire is damaged, and so is the checkpoint before it; or it is of another format.

    Warns:
        UserWarning: it is damaged, and the checkpoint before it is taken.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, "genotype", seed=0).run(task, generations=2)
        >>> repertoire = auroraqd.load(auroraqd.save(aurora, "runs/loaded"))
        >>> repertoire.genotype.shape == aurora.archive.genotype.shape
        True
    """
    trusted = _checked_trust(trusted)

    def repertoire(arrays: dict[str, np.ndarray], kind: str) -> Repertoire:
        arrays = _pieces.together(Path(folder), arrays)
        columns = {name: arrays.pop(name) for name in KNOWN if name in arrays}
        return Repertoire(columns, _Origin(as_path("folder", folder).absolute(), kind, arrays, trusted))

    return _read(folder, repertoire)


@dataclass(frozen=True)
class _Origin:
    """The run of a repertoire: its folder, and what its checkpoint holds beside the columns."""

    folder: Path
    kind: str
    arrays: Mapping[str, np.ndarray]
    trusted: Sequence[str]

    def descriptor(self) -> Descriptor:
        return _descriptor(self.kind, self.arrays, _values(self.arrays), self.trusted)

    def transformer(self) -> Transformer | None:
        return _transformer(self.arrays, self.trusted) if self.kind == _LEARNED else None

    def seed(self) -> int:
        return _values(self.arrays)["seed"]

    def config(self) -> dict[str, Any]:
        return load_config(self.folder)

    def history(self) -> History:
        return History.restored(load_history(self.folder), gap=1)


def resume(
    folder: str | os.PathLike,
    *,
    trusted: Sequence[str] = (),
    any_environment: bool = False,
    observations: str | os.PathLike | None = None,
    **parts: Any,
) -> Aurora:
    """The run of a run folder as it was at its last checkpoint: it goes on as if it had never ended, bit for bit.

    Args:
        folder: as written by `auroraqd run`, `auroraqd.save` or `auroraqd.Checkpoints`.
        trusted: full names of the types, beyond scikit-learn's and auroraqd's, that may be created: of the descriptor, of
            strategies, emitters and archives.
        any_environment: whether to go on with other versions, or on another machine, than before: then rounding may differ,
            and the run takes another course.
        observations: a folder for those of the archive, as `Aurora` takes it.
        parts: `selection`, `variation` or `emitter`, `resolution`, `schedule`, or an empty `archive`, to use instead of the
            saved ones. Those that are not auroraqd's own must be given, or their types trusted, which are then made with the
            arguments that they keep in attributes of the same names.

    Raises:
        TypeError: an argument is of the wrong kind.
        FileNotFoundError: there is no such run.
        ValueError: the run is damaged, of another format, version or machine, or needs a part that is not given.

    Warns:
        UserWarning: the last checkpoint is damaged, and the one before it is taken.

    Examples:
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, "genotype", seed=0).run(task, generations=2)
        >>> again = auroraqd.resume(auroraqd.save(aurora, "runs/resumed"))
        >>> one, other = aurora.run(task, generations=2), again.run(task, generations=2)
        >>> bool((one.archive.genotype == other.archive.genotype).all())
        True
    """
    unknown = set(parts) - {"selection", "variation", "emitter", "resolution", "schedule", "archive"}
    if unknown:
        raise TypeError(
            f"resume takes a selection, variation, emitter, resolution, schedule or archive, not {', '.join(sorted(unknown))}"
        )
    for name in set(parts) - {"archive", "emitter"}:
        if name != "resolution" or parts[name] is not None:
            function(name, parts[name])
    instance("archive", parts.get("archive"), Archive | None, "an empty archive of auroraqd")
    trusted, any_environment = _checked_trust(trusted), flag("any_environment", any_environment)
    _existing(folder)
    path, config = Path(folder), {}
    if (path / REPERTOIRE).is_file() or (path / PREVIOUS).is_file():
        config = load_config(folder) if (path / CONFIG).is_file() or not any_environment else {}
        if not any_environment:
            _check_environment(folder, config.get("environment", {}))

    room = np.empty if observations is None else room_in(observations)

    def run(arrays: Mapping[str, np.ndarray], kind: str) -> Aurora:
        arrays, values = _pieces.together(path, arrays, room), _values(arrays)
        check_arrays(values, arrays)
        descriptor = _descriptor(kind, arrays, values, trusted)
        return restored(State(values, dict(arrays)), descriptor, _seconds(path), parts, trusted, observations)

    aurora = _read(folder, run, "cannot go on")
    aurora._task = aurora._earlier_task = task_in(config)
    aurora._made = made_again(config)
    return aurora


def goes_on(aurora: Aurora, folder: Path, overwrite: bool) -> bool:
    """Whether a folder holds an earlier moment of a run. Of a damaged checkpoint, the one before takes the place.

    Raises:
        ValueError: it holds something else, and `overwrite` does not allow to replace that.
    """
    if not (folder / REPERTOIRE).is_file() and not (folder / PREVIOUS).is_file():
        return False
    try:
        (generation, same), error = _last(folder, lambda arrays, _: _whose(State(_values(arrays), dict(arrays)), aurora))
    except ValueError:
        if overwrite:
            return False
        raise
    if error is not None:
        (folder / PREVIOUS).replace(folder / REPERTOIRE)
    if same and generation <= aurora.generation:
        return True
    if not overwrite:
        what = f"this run at generation {generation}, and it is at {aurora.generation}" if same else "another run"
        raise ValueError(
            f"{folder} holds {what}: choose another folder, or resume the run there, or replace it with overwrite=True"
        )
    return False


def _whose(state: State, aurora: Aurora) -> tuple[int, bool]:
    """The generation of a state, and whether it is of this run."""
    return state.values["generation"], is_of(state, aurora)


def changed(folder: Path, config: Mapping[str, Any]) -> list[str]:
    """What differs between these settings and those that the last checkpoint was saved with, in words.

    Args:
        folder: of the run.
        config: as `save` takes it. Of what it is silent about, and of how many generations there are to be, nothing is said.
    """
    before, _ = _last(folder, lambda arrays, _: _values(arrays).get("config", {}))
    now = json.loads(json.dumps(config))
    names = [name for name in before if name in now and before[name] != now[name]]
    return [f"{name} {shown(now[name])} and not {shown(before[name])}" for name in names]


def load_config(folder: str | os.PathLike) -> dict[str, Any]:
    """The settings of a run folder.

    Raises:
        FileNotFoundError: there are none.
        ValueError: they are damaged.
    """
    path = _existing(folder, CONFIG)
    try:
        config = json.loads(text_of(path))
    except (ValueError, RecursionError) as error:
        text = f"{error}"
        raise ValueError(text if text.startswith(f"{path} is damaged") else f"{path} is damaged: {text}") from None
    if not isinstance(config, dict):
        raise ValueError(f"{path} must hold a JSON object")
    return config


def given(aurora: Aurora, config: Mapping[str, Any]) -> dict[str, Any] | None:
    """What was given to `save` as settings of a run, by what `load_config` found; None if it was nothing."""
    kept = {name: value for name, value in config.items() if name not in ("environment", "provenance")}
    return None if kept == json.loads(json.dumps(settings_of(aurora))) else kept


def load_history(folder: str | os.PathLike) -> list[Record]:
    """The records of a run folder.

    Raises:
        FileNotFoundError: there are none.
        ValueError: they are damaged.
    """
    try:
        return read_table(_existing(folder, HISTORY), Record)
    except ValueError as error:
        raise ValueError(f"{error}; `auroraqd resume` writes it whole again") from None


def load_events(folder: str | os.PathLike) -> np.ndarray:
    """What happened in which order in a run that was told in parts, (n, 2); see `auroraqd.Aurora.events`.

    Raises:
        FileNotFoundError: there is no such run.
        ValueError: it is damaged.
    """
    events, error = _last(folder, lambda arrays, _: arrays.get("events", np.empty((0, 2), np.int64)))
    if error is not None:
        raise error
    return events


@cache
def environment() -> Mapping[str, Any]:
    """What bit-for-bit repetition depends on besides the settings. Asked once: it takes as long as a small checkpoint."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in _VERSIONS},
        "machine": platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
    }


def _check_environment(folder: str | os.PathLike, before: Any) -> None:
    if not isinstance(before, Mapping):
        raise ValueError(f"{Path(folder) / CONFIG} must hold an object as environment, got {shown(before)}")
    now = environment()
    differ = [f"{name} {before.get(name)} and not {now[name]}" for name in now if before.get(name) != now[name]]
    if differ:
        raise ValueError(
            f"{os.fspath(folder)} comes from another environment, {', '.join(differ)}: here it would take another course. "
            "To go on all the same: any_environment=True, or --any-environment"
        )


def _read(folder: str | os.PathLike, made: Callable[..., _Made], trouble: str = "is damaged") -> _Made:
    """What is made of the last checkpoint that is whole; with a warning if it is not the last."""
    result, error = _last(folder, made, trouble)
    if error is not None:
        warnings.warn(f"{error}; the checkpoint before it is taken", stacklevel=3)
    return result


def _last(folder: str | os.PathLike, made: Callable[..., _Made], trouble: str = "is damaged") -> tuple[_Made, Exception | None]:
    """What is made of the last checkpoint, its arrays and kind, and what is wrong with the one after it, if there is one."""

    def read(path: Path) -> _Made:
        arrays, kind = _tensors.read(path, _FORMAT)
        try:
            return made(arrays, kind)
        except (KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
            raise ValueError(f"{path} does not hold what a run needs: {shown(error)}") from error
        except ValueError as error:
            raise ValueError(f"{path} {trouble}: {error}") from error

    previous = as_path("folder", folder) / PREVIOUS
    try:
        return read(_existing(folder, REPERTOIRE)), None
    except (ValueError, FileNotFoundError) as error:
        if not previous.is_file():
            raise
        try:
            return read(previous), error
        except ValueError:
            raise error from None


def _values(arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The values of the state in a checkpoint, of the right kinds.

    Raises:
        ValueError: they are damaged.
    """
    try:
        values = json.loads(arrays[_STATE].tobytes())
    except (KeyError, ValueError, RecursionError) as error:
        raise ValueError(f"its state cannot be read: {shown(error)}") from None
    check_values(values)
    return values


def _seconds(folder: Path) -> dict[int, float]:
    """What the history says about times, by generation: they are in no checkpoint, for equal runs give equal checkpoints."""
    try:
        return {record.generation: record.seconds for record in load_history(folder)}
    except (OSError, ValueError) as error:
        warnings.warn(f"the times of the generations so far are lost: {error}", stacklevel=3)
        return {}


def _history_csv(records: Sequence[Record]) -> str:
    lines = [",".join(Record._fields)]
    lines += [",".join("nan" if isinstance(v, float) and math.isnan(v) else repr(v) for v in record) for record in records]
    return "\n".join(lines) + "\n"


def _contents(aurora: Aurora, config: Mapping[str, Any] | None) -> tuple[dict[str, np.ndarray], str]:
    """The arrays of a checkpoint, and the kind of the descriptor."""
    descriptor, state = aurora.descriptor, state_of(aurora)
    # How far a run is to go is no part of what it is.
    kept = {} if config is None else {"config": {name: value for name, value in config.items() if name != _BUDGET}}
    arrays = {**state.arrays, _STATE: np.frombuffer(json.dumps({**state.values, **kept}).encode(), np.uint8)}
    if descriptor.scaling is not None:
        arrays[_LOW], arrays[_HIGH], arrays[_LIMIT] = descriptor.scaling
    if isinstance(descriptor.source, str):
        return arrays, descriptor.source
    try:
        arrays[_TRANSFORMER] = np.frombuffer(_transformers.dumped(descriptor.source), np.uint8)
    except Exception as error:  # whatever a foreign object raises, the repertoire itself must not be lost
        warnings.warn(
            f"{type(descriptor.source).__name__} cannot be saved with the repertoire, which will not be able to describe new "
            f"observations, nor to go on: {error}",
            stacklevel=4,
        )
    return arrays, _LEARNED


def _descriptor(kind: str, arrays: Mapping[str, np.ndarray], values: Mapping[str, Any], trusted: Sequence[str]) -> Descriptor:
    """The descriptor of a checkpoint, whose values have been checked.

    Raises:
        ValueError: it was not saved, is damaged, or of a type that is not trusted.
    """
    if kind == _LEARNED:
        descriptor = Descriptor(_transformer(arrays, trusted))
    elif kind in NAMES:
        descriptor = Descriptor(kind)
    else:
        raise ValueError(f"the descriptor must be one of {', '.join(NAMES)}, or learned, got {shown(kind)}")
    if _LOW not in arrays or (kind != _LEARNED and kind != OBSERVATION):
        return descriptor
    try:
        scaling = Scaling(*(arrays[name] for name in (_LOW, _HIGH, _LIMIT) if name in arrays))  # before 0.3 none had a limit
        return descriptor.restored(scaling, tuple(values["shape"]), as_layout(values.get("layout")))
    except Exception as error:  # of what somebody wrote, anything
        raise ValueError(f"the descriptor is damaged: {type(error).__name__}: {error}") from None


def _transformer(arrays: Mapping[str, np.ndarray], trusted: Sequence[str]) -> Transformer:
    """What was learned, of a checkpoint of which something was. Raises: as `_descriptor`."""
    if _TRANSFORMER not in arrays:
        raise ValueError("the repertoire was saved without its transformer")
    transformer = _transformers.loaded(arrays[_TRANSFORMER].tobytes(), trusted)
    if not isinstance(transformer, Transformer):
        raise ValueError(f"the descriptor must have fit and transform, and is {shown(transformer)}")
    return transformer


def _existing(folder: str | os.PathLike, name: str = "") -> Path:
    if not as_path("folder", folder).is_dir():
        raise FileNotFoundError(f"there is no folder {os.fspath(folder)}")
    path = Path(folder) / name
    if name and not path.is_file():
        raise FileNotFoundError(f"{os.fspath(folder)} is no run folder: there is no {name} in it")
    return path


def _write(path: Path, text: str) -> None:
    with replacing(path) as file:
        file.write(text.encode())
