"""What the state in a checkpoint must be, before anything is made of it: names, kinds, ranges, and shapes against each other.

A file with the right checksum may still have been made by somebody else, or by a mistake.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from auroraqd._checks import MOST_SEED, check_genotypes, number, shown, whole
from auroraqd.history import Record
from auroraqd.observations import Layout, has_streams, layout_of, streams_of

_MOST = 2**53  # of what is counted: beyond it, floats leave numbers out
_MOST_ENTRIES = 10**8  # of an observation
_STATUSES = ("rejected", "new", "replaced", "invalid")
_GENERATOR = {
    "state": 2**128 - 1,
    "inc": 2**128 - 1,
    "has_uint32": 1,
    "uinteger": 2**32 - 1,
}  # of PCG64, and how large they are


def check_values(values: Any) -> None:
    """Raise ValueError unless these are the values of a state; those that earlier versions lack may be missing."""
    _object("the state", values)
    for name, check in {**_VALUES, **{name: check for name, check in _SINCE.items() if name in values}}.items():
        if name not in values:
            raise ValueError(f"the state has no {name}")
        check(name, values[name])


def check_arrays(values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError unless the arrays beside the columns fit each other, and the values, which have been checked.

    Args:
        values: of a state.
        arrays: of the checkpoint, by name.
    """
    _check_history(values, arrays)
    _check_observations(values, arrays)
    for prefix in ("pending", "waiting"):
        names = [name for name in arrays if name.startswith(f"{prefix}.")]
        if names:
            _check_individuals(prefix, {name.partition(".")[2]: arrays[name] for name in names}, values["n_genes"])
    asked, pending = values.get("asked"), arrays.get("pending.genotype")
    if asked is not None and sum(n for _, n, *_ in asked) != (0 if pending is None else len(pending)):
        raise ValueError(f"asked must be as many individuals as are pending, got {shown(asked)}")
    if "events" in arrays:
        check_array("events", arrays["events"], axes=2, dtype=np.int64)
        if arrays["events"].shape[1] != 2:
            raise ValueError(f"events must have shape (n, 2), got {arrays['events'].shape}")
    stored = arrays.get("genotype")
    if stored is not None and len(stored) and stored.shape[1:] != (values["n_genes"],):
        raise ValueError(f"genotype must have shape (n, {values['n_genes']}), got {stored.shape}")


def check_array(
    name: str, array: Any, axes: int | None = None, dtype: type | None = None, finite: bool = False, n: int | None = None
) -> None:
    """Raise ValueError unless it is an array of numbers like this; None: any."""
    if array is None:
        raise ValueError(f"{name} is missing")
    if array.dtype != dtype if dtype is not None else array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be {'numbers' if dtype is None else dtype.__name__}, got {array.dtype}")
    if array.ndim == 0 or axes not in (None, array.ndim) or n not in (None, len(array)):
        wanted = "rows" if axes is None else f"{axes} axes"
        raise ValueError(f"{name} must have {wanted}{'' if n is None else f', {n} in all'}, got shape {array.shape}")
    if finite and not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got a NaN or an infinity")


def _check_history(values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    history = arrays.get("history")
    check_array("history", history, axes=2, dtype=np.float64)
    assert history is not None
    names = [name for name in Record._fields if name != "seconds"][: history.shape[1]]  # earlier versions had fewer
    if len(history) == 0:
        if values["generation"]:
            raise ValueError(f"history must have records until generation {values['generation']}, got none")
        return
    if history.shape[1] != len(names) or "invalid" not in names:
        raise ValueError(f"history must have a column for each field of a record, got {history.shape[1]}")
    counts = history[:, [i for i, name in enumerate(names) if Record.__annotations__[name] in (int, "int")]]
    if not ((counts >= 0) & (counts <= _MOST) & (counts == np.floor(counts))).all():
        raise ValueError("history must count in whole numbers, 0 or more")
    if not (np.diff(history[:, 0]) > 0).all() or history[-1, 0] != values["generation"]:
        raise ValueError(f"history must go up to generation {values['generation']}, one record after the other")


def _check_observations(values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """The shape that the descriptor was fitted on, its scaling, and the observations that are stored."""
    low, high, stored = arrays.get("scaling.low"), arrays.get("scaling.high"), arrays.get("observation")
    if low is None and high is None:
        return
    shape, layout = tuple(values["shape"]), as_layout(values.get("layout"))
    if (limit := arrays.get("scaling.limit")) is not None:
        check_array("scaling.limit", limit, axes=1, dtype=np.float64)
        if len(limit) not in (1, *shape[-1:]) or not (limit > 0).all():
            raise ValueError(f"scaling.limit must be one for all or one for each channel, above 0, got {shown(limit)}")
    if layout is not None:
        if shape != (sum(math.prod(one) for _, one in layout),):
            raise ValueError(f"layout must be of {shown(shape)} entries, got {shown(layout)}")
        for name, bounds in (("scaling.low", low), ("scaling.high", high)):
            check_array(name, bounds, axes=1, dtype=np.float64, finite=True, n=shape[0])
        if stored is not None and len(stored) and layout_of(stored) != layout:
            raise ValueError(f"layout must be that of the observations stored, {shown(layout_of(stored))}, got {shown(layout)}")
        return
    channels = shape[-1] if shape else 1
    for name, bounds in (("scaling.low", low), ("scaling.high", high)):
        check_array(name, bounds, axes=1, dtype=np.float64, finite=True, n=channels)
    if stored is not None and len(stored) and (stored.shape[1:] != shape or has_streams(stored)):
        raise ValueError(f"shape must be that of the observations stored, {stored.shape[1:]}, got {shape}")


def _check_individuals(prefix: str, columns: Mapping[str, np.ndarray], n_genes: int) -> None:
    """Individuals on their way into the archive."""
    genotype = columns.get("genotype")
    check_array(f"{prefix}.genotype", genotype, axes=2, dtype=np.float64, finite=True)
    assert genotype is not None
    least = 1 if prefix == "pending" else 0
    if len(genotype) < least or genotype.shape[1] != n_genes:
        raise ValueError(f"{prefix}.genotype must have shape (n, {n_genes}), got {genotype.shape}")
    if len(genotype):
        check_genotypes(f"{prefix} must have", genotype, genotype.shape)
    check_array(f"{prefix}.parent", columns.get("parent", columns.get("parent_id")), axes=1, dtype=np.int64, n=len(genotype))
    for name in ("born", "emitter"):
        if name in columns:  # not in files of version 0.2.0
            check_array(f"{prefix}.{name}", columns[name], axes=1, dtype=np.int64, n=len(genotype))
    if prefix == "waiting":
        check_array("waiting.fitness", columns.get("fitness"), axes=1, dtype=np.float64, finite=True, n=len(genotype))
        for name, stream in streams_of(columns.get("observation", np.empty(0))).items():
            check_array(f"waiting.{name}", stream, finite=True, n=len(genotype))
        if "ground_truth" in columns:
            check_array("waiting.ground_truth", columns["ground_truth"], n=len(genotype))


def _object(name: str, value: Any) -> None:
    if not isinstance(value, dict):
        raise ValueError(f"{name} must be an object, got {shown(value)}")


def _true_or_false(name: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false, got {shown(value)}")


def _count(name: str, value: Any) -> None:
    whole(name, value, least=0, most=_MOST)


def _or_none(check: Callable[[str, Any], Any], name: str, value: Any) -> None:
    if value is not None:
        check(name, value)


def _counts(name: str, value: Any) -> None:
    _object(name, value)
    if sorted(value) != sorted(_STATUSES):
        raise ValueError(f"{name} must count {', '.join(_STATUSES)}, got {shown(sorted(value))}")
    for status, count in value.items():
        _count(f"{name} {status}", count)


def _settings(name: str, value: Any) -> None:
    _object(name, value)
    for part in ("resolution", "schedule", *(() if "emitters" in value else ("selection", "variation"))):
        if part not in value:
            raise ValueError(f"{name} has no {part}")
    _object(f"archive of the {name}", value.get("archive"))


def _generator(name: str, value: Any) -> None:
    """The state of NumPy's default generator of random numbers."""
    _object(name, value)
    if value.get("bit_generator") != "PCG64":
        raise ValueError(f"{name} must be of PCG64, got {shown(value.get('bit_generator'))}")
    _object(f"state of {name}", value.get("state"))
    for part, most in _GENERATOR.items():
        holder = value if part.endswith(("uint32", "uinteger")) else value["state"]
        whole(f"{part} of {name}", holder.get(part), least=0, most=most)


def _shape(name: str, value: Any) -> None:
    if not isinstance(value, list):
        raise ValueError(f"{name} must be whole numbers, got {shown(value)}")
    entries = 1
    for extent in value:
        entries *= whole(name, extent, most=_MOST_ENTRIES)
        if entries > _MOST_ENTRIES:
            raise ValueError(f"{name} must be of at most {_MOST_ENTRIES:,} entries, got {shown(value)}")


def as_layout(value: list | None) -> Layout | None:
    """The streams of an observation as a descriptor has them."""
    return None if value is None else tuple((name, tuple(shape)) for name, shape in value)


def _layout(name: str, value: Any) -> None:
    if not isinstance(value, list) or not all(isinstance(one, list) and len(one) == 2 for one in value) or not value:
        raise ValueError(f"{name} must be a list of names and shapes, got {shown(value)}")
    for stream, shape in value:
        if not isinstance(stream, str):
            raise ValueError(f"{name} must have names, got {shown(stream)}")
        _shape(f"{name} {stream}", shape)


def _attempts(name: str, value: Any) -> None:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"{name} must be two numbers, got {shown(value)}")
    whole(name, value[0], least=0, most=10_000)  # the next comes after two to the power of it
    _or_none(partial(whole, least=0), name, value[1])


def _asked(name: str, value: Any) -> None:
    if not isinstance(value, list) or not all(isinstance(one, list) and len(one) == 4 for one in value):
        raise ValueError(f"{name} must be a list of lists of four, got {shown(value)}")
    for ticket, n, first, alone in value:
        whole(f"ticket of {name}", ticket, least=0)
        whole(f"size of {name}", n, most=_MOST)
        _count(f"number of {name}", first)
        _true_or_false(f"kind of {name}", alone)
    if sum(alone for *_, alone in value) > 1 or len({ticket for ticket, *_ in value}) < len(value):
        raise ValueError(f"{name} must be of different tickets, and one batch at most, got {shown(value)}")


def _objects(name: str, value: Any) -> None:
    if not isinstance(value, list):
        raise ValueError(f"{name} must be a list, got {shown(value)}")
    for one in value:
        _object(name, one)


_VALUES: dict[str, Callable[[str, Any], Any]] = {
    "n_genes": partial(whole, most=_MOST),
    "batch_size": partial(whole, most=_MOST),
    "generation": _count,
    "evaluations": _count,
    "seed": partial(whole, least=0, most=MOST_SEED),
    "_refits": _true_or_false,
    "_update_due": _true_or_false,
    "_counts": _counts,
    "settings": _settings,
    "random": _generator,
    "archive": _object,
    "history_gap": partial(whole, most=_MOST),
    "shape": _shape,
}
_SINCE: dict[str, Callable[[str, Any], Any]] = {  # what files of version 0.2.0, or runs from Python, lack
    "robust": _true_or_false,
    "survival": partial(number, most=1, wanted="a share, from 0 to 1"),
    "_refused": _count,
    "attempts": _attempts,
    "layout": partial(_or_none, _layout),
    "asked": _asked,
    "emitters": _objects,
    "_tickets": _count,
    "_part": _count,
    "_next_evaluation": _count,
    "config": _object,
}
