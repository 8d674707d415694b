"""All that a run is, as plain values and arrays, and back.

Beside `Aurora` itself this is the one place that knows what a run consists of; what is missing here would be missing after a
crash. Wall-clock times are left out, so equal runs have equal states.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from auroraqd import resolution, schedule, selection, variation
from auroraqd._checks import shown
from auroraqd.archive import Archive, UnstructuredArchive
from auroraqd.aurora import SURVIVAL, Aurora
from auroraqd.batch import Batch, Pending
from auroraqd.cells import GridArchive
from auroraqd.cvt import CVTArchive, Tessellation
from auroraqd.descriptor import Descriptor
from auroraqd.history import History, Record
from auroraqd.population import COLUMNS
from auroraqd.update import Attempts

_STRATEGIES = {"selection": selection, "variation": variation, "resolution": resolution, "schedule": schedule}
_PLAIN = ("n_genes", "batch_size", "generation", "evaluations", "seed", "_refits", "_update_due", "_counts")
_SINCE = {"robust": True, "survival": SURVIVAL, "_refused": 0}  # plain too, and not in files of version 0.2.0
_RECORDED = tuple(name for name in Record._fields if name != "seconds")
_TASKS = ("_task", "_earlier_task", "_made")  # in config.json: equal runs have equal states, whoever made them
_OTHERS = ("archive", *_STRATEGIES, "history", "_rng", "_descriptor", "_waiting", "_pending", "_seconds", "_attempts", *_TASKS)

FIELDS = {*_PLAIN, *_SINCE, *_OTHERS}
"""All attributes of `Aurora` that are kept, or derived again. What users add to theirs is not kept."""


class State(NamedTuple):
    """A run but for its descriptor and for times.

    Attributes:
        values: JSON values.
        arrays: by name.
    """

    values: dict[str, Any]
    arrays: dict[str, np.ndarray]


def state_of(aurora: Aurora) -> State:
    """The state of a run at any moment, also between `ask` and `tell`."""
    archive, records = aurora.archive, aurora.history.records
    values = {
        **{name: getattr(aurora, name) for name in (*_PLAIN, *_SINCE)},
        "attempts": list(aurora._attempts),
        "settings": settings_of(aurora),
        "random": aurora._rng.bit_generator.state,
        "archive": archive.state,
        "history_gap": aurora.history.gap,
        "shape": list(aurora.descriptor.shape),
        "rearranged": None if aurora._pending is None else aurora._pending.rearranged,
    }
    columns = {name: getattr(archive, name) for name in COLUMNS}
    arrays = {
        **{name: column for name, column in columns.items() if column is not None},
        **{f"archive.{name}": array for name, array in archive.constants.items()},
        "history": np.array([[getattr(r, name) for name in _RECORDED] for r in records], np.float64).reshape(
            -1, len(_RECORDED)
        ),
    }
    for prefix, batch in (("pending", aurora._pending), ("waiting", aurora._waiting)):
        fields = {} if batch is None else batch._asdict()
        arrays.update({f"{prefix}.{name}": array for name, array in fields.items() if isinstance(array, np.ndarray)})
    return State(values, arrays)


def restored(state: State, descriptor: Descriptor, seconds: Mapping[int, float], parts: Mapping[str, Any]) -> Aurora:
    """The run again.

    Args:
        state: of the run.
        descriptor: of the run.
        seconds: by generation, what the history said; NaN where it is not known.
        parts: strategies and an empty archive to use instead of those of the state, by name. Needed where these are not of
            auroraqd.

    Raises:
        ValueError: a part is needed and not given.
    """
    values, arrays = state
    aurora = Aurora.__new__(Aurora)
    for name in _PLAIN:
        setattr(aurora, name, values[name])
    for name, value in _SINCE.items():
        setattr(aurora, name, values.get(name, value))
    aurora._attempts = Attempts(*values.get("attempts", ()))
    for name, module in _STRATEGIES.items():
        setattr(aurora, name, parts[name] if name in parts else _strategy(name, values["settings"][name], module))
    archive = _archive(values["settings"]["archive"], _named("archive", arrays), parts.get("archive"))
    archive.restore({name: arrays[name] for name in COLUMNS if name in arrays}, values["archive"])
    records = [_record(row, seconds) for row in arrays["history"]]
    rng = np.random.default_rng()
    rng.bit_generator.state = values["random"]
    pending, waiting = _named("pending", arrays), _named("waiting", arrays)
    if aurora.resolution is not None and not isinstance(archive, UnstructuredArchive):
        raise ValueError(f"resolution is for an archive with a distance threshold l, and {type(archive).__name__} has none")
    _check_described(archive, descriptor)
    aurora.archive, aurora._descriptor, aurora._rng = archive, descriptor, rng
    aurora.history = History.restored(records, values["history_gap"])
    aurora._seconds = seconds.get(records[-1].generation, 0.0) if records else 0.0
    if waiting:  # an earlier version did not keep when they were born
        waiting = {"ground_truth": None, "born": np.full(len(waiting["genotype"]), -1), **waiting}
    aurora._task = aurora._earlier_task = aurora._made = None
    aurora._waiting = Batch(**waiting) if waiting else None
    aurora._pending = Pending(**pending, rearranged=values["rearranged"], since=time.perf_counter()) if pending else None
    return aurora


def _check_described(archive: Archive, descriptor: Descriptor) -> None:
    """Raise ValueError unless the descriptor gives descriptors like those that are stored."""
    if len(archive) == 0 or not descriptor.ready:
        return
    truth = archive.ground_truth
    values, _ = descriptor.describe(archive.genotype[:1], archive.observation[:1], None if truth is None else truth[:1])
    if values.shape[1] != archive.descriptor.shape[1]:
        raise ValueError(
            f"descriptor must have {values.shape[1]} dimensions, as {descriptor} gives, got {archive.descriptor.shape[1]}"
        )


def settings_of(aurora: Aurora) -> dict[str, Any]:
    """The settings of a run as JSON values."""
    archive = aurora.archive
    return {
        "n_genes": aurora.n_genes,
        "descriptor": _called(aurora.descriptor.source),
        "seed": aurora.seed,
        "batch_size": aurora.batch_size,
        "robust": aurora.robust,
        "survival": aurora.survival,
        "archive": {"type": type(archive).__name__, **archive.settings},
        **{name: as_json(getattr(aurora, name)) for name in _STRATEGIES},
    }


def as_json(strategy: Any) -> Any:
    """A strategy as its type and fields, or what it is called if it is no dataclass."""
    if is_dataclass(strategy) and not isinstance(strategy, type):
        return {"type": type(strategy).__name__, **asdict(strategy)}
    return None if strategy is None else getattr(strategy, "__qualname__", repr(strategy))


def _called(source: Any) -> str:
    """What a descriptor is called: its `repr` if that says more than where it lies in memory."""
    text = source if isinstance(source, str) else repr(source)
    return type(source).__qualname__ if " object at 0x" in text else text


def _strategy(name: str, value: Any, module: Any) -> Any:
    """A strategy from what `as_json` made of it."""
    if value is None and name == "resolution":
        return None
    options = dict(value) if isinstance(value, Mapping) else {"type": value}
    kind = getattr(module, str(options.pop("type", None)), None)
    if not isinstance(value, Mapping) or not is_dataclass(kind):
        raise ValueError(f"{name} was {shown(value)}, which is not of auroraqd: give it again, resume(..., {name}=...)")
    return kind(**options)  # pyright: ignore[reportCallIssue] - a type


def _archive(settings: Mapping[str, Any], constants: Mapping[str, np.ndarray], given: Archive | None) -> Archive:
    """An empty archive from its settings and constants, or the one given if it is of the same type."""
    options = dict(settings)
    kind = options.pop("type")
    if given is not None:
        if type(given).__name__ != kind or len(given):
            raise ValueError(f"archive must be an empty {kind}, as before, got {shown(given)}")
        return given
    if kind == CVTArchive.__name__:
        return CVTArchive(Tessellation(constants["centroids"], options["asked"], options["samples"], options["steps"]))
    for known in (UnstructuredArchive, GridArchive):
        if kind == known.__name__:
            return known(**options)
    raise ValueError(f"archive was of the type {kind}, which is not of auroraqd: give an empty one, resume(..., archive=...)")


def _named(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The arrays whose names begin like this, without it."""
    return {name.partition(".")[2]: array for name, array in arrays.items() if name.startswith(f"{prefix}.")}


def _record(row: np.ndarray, seconds: Mapping[int, float]) -> Record:
    names = _RECORDED[: len(row)]  # earlier versions had fewer
    values: Any = {name: Record.__annotations__[name](value) for name, value in zip(names, row.tolist(), strict=True)}
    return Record(**values, seconds=seconds.get(int(row[0]), float("nan")))
