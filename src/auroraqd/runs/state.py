"""All that a run is, as plain values and arrays, and back.

Beside `Aurora` itself this is the one place that knows what a run consists of; what is missing here would be missing after a
crash. Wall-clock times are left out, so equal runs have equal states.
"""

import array as typed
import json
import os
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import shown
from auroraqd.archives.base import Archive
from auroraqd.archives.unstructured import UnstructuredArchive
from auroraqd.aurora import SURVIVAL, Aurora
from auroraqd.control.update import Attempts
from auroraqd.descriptors.descriptor import Descriptor
from auroraqd.emitters.base import EmitterError, Shared, shared
from auroraqd.emitters.genetic import Genetic
from auroraqd.emitters.proposal import Asked, Proposal
from auroraqd.history import History, Record
from auroraqd.individuals import KNOWN, Columns
from auroraqd.runs.parts import archive_as_json, archive_made, as_json, made

_STRATEGIES = ("resolution", "schedule")
_PLAIN = ("n_genes", "batch_size", "generation", "evaluations", "seed", "_refits", "_update_due", "_counts")
_SINCE = {"robust": True, "survival": SURVIVAL, "_refused": 0, "_tickets": 0, "_part": 0}  # and not in files of version 0.2.0
_LATER = ("_next_evaluation", "_current")  # likewise, but following from the rest
_RECORDED = tuple(name for name in Record._fields if name != "seconds")
_TASKS = ("_task", "_next_task", "_earlier_task", "_made")  # in config.json: equal runs have equal states, whoever made them
_TIMES = ("_seconds", "_until")
_ON_THE_WAY = ("_waiting", "_asked", "_events", "_latest")
_OTHERS = ("archive", *_STRATEGIES, "history", "_rng", "_descriptor", *_ON_THE_WAY, "_emitters", "_attempts", *_TASKS)

FIELDS = {*_PLAIN, *_SINCE, *_LATER, *_TIMES, *_OTHERS}
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
    archive, asked = aurora.archive, list(aurora._asked.values())
    emitted = [_state_of_emitter(emitter) for emitter in aurora._emitters.emitters]
    values = {
        **{name: getattr(aurora, name) for name in (*_PLAIN, *_SINCE, *_LATER)},
        "attempts": list(aurora._attempts),
        "settings": settings_of(aurora),
        "random": aurora._rng.bit_generator.state,
        "archive": archive.state,
        "history_gap": aurora.history.gap,
        "shape": list(aurora.descriptor.shape),
        "layout": aurora.descriptor.layout,
        "asked": [[a.proposal.ticket, len(a.proposal.genotype), a.proposal.first, a.alone] for a in asked],
        "emitters": [state.values for state in emitted],
    }
    arrays = {
        **archive.columns,
        **{f"archive.{name}": array for name, array in archive.constants.items()},
        "history": _recorded(aurora),
        **_prefixed("waiting", aurora._waiting or {}),
        **_prefixed("pending", _joined([a.proposal for a in asked])),
    }
    if len(aurora._events):
        arrays["events"] = aurora.events
    if not len(archive):
        arrays.update({name: getattr(archive, name) for name, kind in KNOWN.items() if kind.always})
    for number, state in enumerate(emitted):
        arrays.update(_prefixed(f"emitter{number}", state.arrays))
    return State(values, arrays)


def is_of(state: State, aurora: Aurora) -> bool:
    """Whether it is the same run, earlier or later: what both recorded of a generation is the same, bit for bit.

    Where they have no generation in common, the settings must be the same.
    """
    before, now = state.arrays["history"], _recorded(aurora)[:, : state.arrays["history"].shape[1]]
    _, ours, theirs = np.intersect1d(now[:, 0], before[:, 0], return_indices=True)
    if not len(ours):
        return state.values["settings"] == json.loads(json.dumps(settings_of(aurora)))
    return state.values["seed"] == aurora.seed and np.array_equal(now[ours], before[theirs], equal_nan=True)


def _recorded(aurora: Aurora) -> np.ndarray:
    """What is known of each generation, but for its time, (records, fields)."""
    rows = [[getattr(record, name) for name in _RECORDED] for record in aurora.history.records]
    return np.array(rows, np.float64).reshape(-1, len(_RECORDED))


def _prefixed(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{prefix}.{name}": array for name, array in arrays.items()}


def _joined(proposals: Sequence[Proposal]) -> dict[str, np.ndarray]:
    """The columns of proposals, one after the other; none of none."""
    names = ("genotype", "parent", "emitter")
    return {name: np.concatenate([getattr(p, name) for p in proposals]) for name in names} if proposals else {}


def _state_of_emitter(emitter: Any) -> State:
    """What an emitter remembers, JSON values and arrays apart."""
    called = f"emitter {type(emitter).__name__}"
    if not callable(getattr(emitter, "state", dict)):
        raise TypeError(f"{called} must have a method state(), got {shown(emitter.state)}")
    if not hasattr(emitter, "state"):
        return State({}, {})
    try:
        found = emitter.state()
    except Exception as error:
        raise EmitterError(f"{called} raised in `state`: {type(error).__name__}: {error}; it cannot be saved") from error
    wanted = "must return a dictionary of JSON values and arrays of numbers, by names without / and ., as its state"
    if not isinstance(found, Mapping) or not all(isinstance(name, str) and not set("/.") & set(name) for name in found):
        raise EmitterError(f"{called} {wanted}, got {shown(found)}")
    arrays = {name: value for name, value in found.items() if isinstance(value, np.ndarray)}
    values = {name: value for name, value in found.items() if name not in arrays}
    for name, value in found.items():
        if not (value.dtype.kind in "biuf" and value.dtype.itemsize <= 8 if name in arrays else _is_json(value)):
            raise EmitterError(f"{called} {wanted}, got {shown(value)} for {name}")
    return State(values, arrays)


def _is_json(value: Any) -> bool:
    try:
        json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        return False
    return True


def restored(
    state: State,
    descriptor: Descriptor,
    seconds: Mapping[int, float],
    parts: Mapping[str, Any],
    trusted: Sequence[str] = (),
    observations: str | os.PathLike | None = None,
) -> Aurora:
    """The run again.

    Args:
        state: of the run.
        descriptor: of the run.
        seconds: by generation, what the history said; NaN where it is not known.
        parts: strategies and an empty archive to use instead of those of the state, by name. Needed where these are neither of
            auroraqd nor trusted.
        trusted: full names of the classes that may be made.
        observations: a folder for those of the archive; see `Archive.keep_observations`.

    Raises:
        OSError: the folder cannot be written.
        ValueError: a part is needed and not given.
    """
    values, arrays = state
    aurora = Aurora.__new__(Aurora)
    for name in _PLAIN:
        setattr(aurora, name, values[name])
    for name, value in _SINCE.items():
        setattr(aurora, name, values.get(name, value))
    aurora._attempts = Attempts(*values.get("attempts", ()))
    settings = values["settings"]
    for name in _STRATEGIES:
        setattr(aurora, name, parts[name] if name in parts else made(name, settings[name], trusted))
    aurora._emitters = _emitters(settings, parts, trusted)
    for number, emitter in enumerate(aurora._emitters.emitters):
        if hasattr(emitter, "restore") and number < len(values["emitters"]):  # of more than there were, the rest are new
            emitter.restore({**values["emitters"][number], **_named(f"emitter{number}", arrays)})
    archive = archive_made(settings["archive"], _named("archive", arrays), parts.get("archive"), trusted)
    if observations is not None:
        archive.keep_observations(observations)
    archive.restore({name: array for name, array in arrays.items() if name in KNOWN or name in archive.own}, values["archive"])
    records = [_record(row, seconds) for row in arrays["history"]]
    rng = np.random.default_rng()
    rng.bit_generator.state = values["random"]
    if aurora.resolution is not None and not isinstance(archive, UnstructuredArchive):
        raise ValueError(f"resolution is for an archive with a distance threshold l, and {type(archive).__name__} has none")
    _check_described(archive, descriptor)
    aurora.archive, aurora._descriptor, aurora._rng = archive, descriptor, rng
    aurora.history = History.restored(records, values["history_gap"])
    aurora._seconds = seconds.get(records[-1].generation, 0.0) if records else 0.0
    aurora._until = 0.0
    aurora._task = aurora._next_task = aurora._earlier_task = aurora._made = aurora._latest = None
    waiting = _individuals(_named("waiting", arrays))
    aurora._waiting = waiting if waiting.rows else None
    aurora._events = typed.array("q", arrays["events"].tobytes() if "events" in arrays else b"")
    _ask_again(aurora, values, _individuals(_named("pending", arrays)))
    return aurora


def _individuals(arrays: Mapping[str, np.ndarray]) -> Columns:
    """Individuals on their way into the archive. Earlier versions did not keep when they were born, nor who made them."""
    n = len(arrays.get("genotype", ()))
    renamed = {{"parent_id": "parent"}.get(name, name): array for name, array in arrays.items() if name != "parent_row"}
    return Columns({"born": np.full(n, -1), "emitter": np.zeros(n, np.int64), **renamed} if n else {})


def _ask_again(aurora: Aurora, values: Mapping[str, Any], columns: Columns) -> None:
    """Restore what was asked for and not told."""
    asked = values.get("asked")
    if asked is None:  # of version 0.2.0: the one batch
        asked = [[aurora._ticket_base, columns.rows, aurora.evaluations, True]] if columns.rows else []
        aurora._tickets = len(asked)
    aurora._asked, aurora._current, start = {}, None, 0
    aurora._next_evaluation = values.get("_next_evaluation", aurora.evaluations + columns.rows)
    for ticket, n, first, alone in asked:
        rows = slice(start, start + n)
        genotype, parent, emitter = (columns[name][rows] for name in ("genotype", "parent", "emitter"))
        proposal = Proposal(ticket, genotype, parent, emitter, first, aurora.seed)
        aurora._asked[ticket] = Asked(proposal, alone, time.perf_counter())
        aurora._current, start = ticket if alone else aurora._current, start + n


def _emitters(settings: Mapping[str, Any], parts: Mapping[str, Any], trusted: Sequence[str]) -> Shared:
    """The emitters of a run."""
    before = settings.get("emitters", [])
    if len(before) > 1 and parts.keys() & {"selection", "variation", "emitter"}:
        _check_all_given(before, parts.get("emitter"))
    if "emitter" in parts:
        return shared(parts["emitter"])
    if "emitters" not in settings or {"selection", "variation"} & set(parts):
        short = ("selection", "variation")
        return shared(Genetic(*(parts[name] if name in parts else made(name, settings[name], trusted) for name in short)))
    return shared([(made("emitter", emitter, trusted), share) for emitter, share in settings["emitters"]])


def _check_all_given(before: Sequence[Any], given: Any) -> None:
    """Raise ValueError where one emitter, or a selection or variation, would take the place of several unasked."""
    if isinstance(given, Sequence):
        return
    types = [emitter.get("type") if isinstance(emitter, Mapping) else emitter for emitter, _ in before]
    names = ", ".join(str(one).rpartition(".")[2] for one in types)
    raise ValueError(
        f"the run has {len(before)} emitters, {names}, and what is given would take the place of all: give a list, "
        "emitter=[...], of all of them, or of those that are to go on"
    )


def _check_described(archive: Archive, descriptor: Descriptor) -> None:
    """Raise ValueError unless the descriptor gives descriptors like those that are stored."""
    if len(archive) == 0 or not descriptor.ready:
        return
    values, _ = descriptor.describe(archive.columns.take(np.zeros(1, np.int64)))
    if values.shape[1] != archive.descriptor.shape[1]:
        raise ValueError(
            f"descriptor must have {values.shape[1]} dimensions, as {descriptor} gives, got {archive.descriptor.shape[1]}"
        )


def settings_of(aurora: Aurora) -> dict[str, Any]:
    """The settings of a run as JSON values."""
    genetic = aurora._genetic
    emitters = [[as_json(emitter), share] for emitter, share in zip(*aurora._emitters, strict=True)]
    made_by = (
        {"selection": as_json(genetic.selection), "variation": as_json(genetic.variation)}
        if genetic
        else {"emitters": emitters}
    )
    return {
        "n_genes": aurora.n_genes,
        "descriptor": _called(aurora.descriptor.source),
        "seed": aurora.seed,
        "batch_size": aurora.batch_size,
        "robust": aurora.robust,
        "survival": aurora.survival,
        "archive": archive_as_json(aurora.archive),
        **made_by,
        **{name: as_json(getattr(aurora, name)) for name in _STRATEGIES},
    }


def _called(source: Any) -> str:
    """What a descriptor is called: its `repr` if that says more than where it lies in memory."""
    text = source if isinstance(source, str) else repr(source)
    return type(source).__qualname__ if " object at 0x" in text else text


def _named(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The arrays whose names begin like this, without it."""
    return {name.partition(".")[2]: array for name, array in arrays.items() if name.startswith(f"{prefix}.")}


def _record(row: np.ndarray, seconds: Mapping[int, float]) -> Record:
    names = _RECORDED[: len(row)]  # earlier versions had fewer
    values: Any = {name: Record.__annotations__[name](value) for name, value in zip(names, row.tolist(), strict=True)}
    return Record(**values, seconds=seconds.get(int(row[0]), float("nan")))
