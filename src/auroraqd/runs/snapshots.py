"""Snapshots: how the descriptor space of a run looked at each update of the descriptor, before and after: it can be seen being
learned.

    snapshots/00000051.safetensors    after 51 generations, of which the last began with an update

Each holds some of the skills, the same ones as long as they stay: those whose ids come first in an order that is drawn once and
for all. They are for looking, and the run does not need them to go on.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import instance, whole
from auroraqd._files import as_path, folder_at
from auroraqd.aurora import Aurora
from auroraqd.control.schedule import Doubling
from auroraqd.runs import _tensors

SNAPSHOTS = "snapshots"
_FORMAT = "auroraqd snapshot 1"
_MOST_FILES = 64
_NUMBERS, _FEWEST = 64_000, 100  # of a moment, at most; skills, however many numbers each has
_MIXED = np.uint64(0x9E3779B97F4A7C15)  # 2^64 by the golden ratio: products with it look random
_LARGEST = float(np.finfo(np.float32).max)
_GROWTH = Doubling()
_MOMENTS = ("before", "after")


class Snapshot(NamedTuple):
    """Some of the skills of a run at a moment.

    Attributes:
        generation, evaluations: done.
        moment: "before" an update of the descriptor, or "after" it; or "" where there was none.
        size: individuals that were stored.
        l: distance threshold; NaN for an archive that has none.
        id: (n,) int64.
        descriptor: (n, d) float32.
        ground_truth: (n, columns) float32, or None.
    """

    generation: int
    evaluations: int
    moment: str
    size: int
    l: float
    id: np.ndarray
    descriptor: np.ndarray
    ground_truth: np.ndarray | None


class Snapshots:
    """A callback that keeps small snapshots of a run in its folder, at each update of the descriptor, before and after.

    A run whose descriptor is never updated has them at generations 0, 50, 150, 350, and so on. 64 are kept: of more, those go
    that are the closest to others.

    A run that goes on keeps those up to where it is; a run from the start, or of another seed, replaces them. A snapshot that
    cannot be written does not end the run: it says so once, in a warning.

    Args:
        folder: of the run; they are in `snapshots` within.
        most: skills of a snapshot; fewer where descriptors and ground truth are of more than 32 numbers.

    Raises:
        TypeError, ValueError: an argument is of the wrong kind or out of range.

    Examples:
        >>> import auroraqd
        >>> from pathlib import Path
        >>> from sklearn.decomposition import PCA
        >>> aurora = auroraqd.Aurora(2, PCA(n_components=2), batch_size=50, seed=0)
        >>> aurora = aurora.run(auroraqd.tasks.Ballistic(), generations=60, callback=auroraqd.Snapshots("runs/mine"))
        >>> folder = auroraqd.save(aurora, "runs/mine")
        >>> sorted(path.name for path in Path("runs/mine/snapshots").iterdir())
        ['00000001.safetensors', '00000051.safetensors']
    """

    def __init__(self, folder: str | os.PathLike, *, most: int = 2000) -> None:
        self._folder = as_path("folder", folder).absolute() / SNAPSHOTS  # a task may change the current folder
        self._most = whole("most", most)
        self._before: dict[str, Any] = {}
        self._updated = self._failed = False

    def start(self, aurora: Aurora) -> None:
        """The run begins, or goes on: what is of another, or of later, goes."""
        instance("aurora", aurora, Aurora, "a run, an auroraqd.Aurora")
        self._updated = False
        self._before = _state(aurora)
        for path in _files(self._folder):
            try:
                values = json.loads(_tensors.text(path, _FORMAT))
                stays = values["seed"] == aurora.seed and values["generation"] <= aurora.generation
            except (OSError, ValueError, KeyError, TypeError):
                stays = False
            if not stays:
                path.unlink(missing_ok=True)

    def update(self, aurora: Aurora) -> None:
        """The descriptor was updated in the generation that is done."""
        self._updated = True

    def generation(self, aurora: Aurora) -> None:
        """A generation is done."""
        # An update puts all into new arrays: those of the generation before are as they were.
        now = _state(aurora)
        if (self._updated or _GROWTH(aurora.generation - 1)) and now["size"]:
            moments = {"before": self._before, "after": now} if self._updated else {"": now}
            try:
                self._write(aurora, {name: state for name, state in moments.items() if state["size"]})
            except OSError as error:
                if not self._failed:
                    warnings.warn(f"no snapshot of generation {aurora.generation}, and the run goes on: {error}", stacklevel=4)
                self._failed = True
        self._updated, self._before = False, now

    def _write(self, aurora: Aurora, moments: Mapping[str, dict[str, Any]]) -> None:
        arrays, states = {}, []
        for number, (moment, state) in enumerate(moments.items()):
            chosen = _chosen(state, self._most)
            arrays |= {f"{name}.{number}": rows for name, rows in chosen.items()}
            states.append({name: state[name] for name in ("generation", "evaluations", "size", "l")} | {"moment": moment})
        values = {"seed": aurora.seed, "generation": aurora.generation, "moments": states}
        folder_at(self._folder)
        path = self._folder / f"{aurora.generation:08d}.safetensors"
        _tensors.write(path, arrays, _FORMAT, json.dumps(values), lasting=False)
        files = _files(self._folder)
        if len(files) > _MOST_FILES:
            _most_crowded(files).unlink(missing_ok=True)


def load_snapshots(folder: str | os.PathLike, seed: int, until: int) -> list[Snapshot]:
    """The snapshots of a run, in order; none where there are none.

    Those that are damaged are left out: they are for looking.

    Args:
        folder: of the run.
        seed: of the run.
        until: the last generation that is of interest.
    """
    return [snapshot for path in _files(Path(folder) / SNAPSHOTS) for snapshot in _read(path, seed, until)]


def remove_snapshots(folder: Path) -> None:
    """Remove those of a run that was in the folder."""
    for path in _files(folder / SNAPSHOTS):
        path.unlink(missing_ok=True)


def _files(folder: Path) -> list[Path]:
    """Those of the snapshots, in the order of generations."""
    return sorted(path for path in folder.glob("*.safetensors") if path.stem.isdecimal())


def _read(path: Path, seed: int, until: int) -> Iterator[Snapshot]:
    try:
        arrays, text = _tensors.read(path, _FORMAT)
        values = json.loads(text)
        if values["seed"] != seed or values["generation"] > until:
            return
        found = []
        for number, state in enumerate(values["moments"]):
            snapshot = Snapshot(
                generation=state["generation"],
                evaluations=state["evaluations"],
                moment=state["moment"],
                size=state["size"],
                l=np.nan if state["l"] is None else float(state["l"]),
                id=arrays[f"id.{number}"],
                descriptor=arrays[f"descriptor.{number}"],
                ground_truth=arrays.get(f"ground_truth.{number}"),
            )
            _check(snapshot)
            found.append(snapshot)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return
    yield from found


def _check(snapshot: Snapshot) -> None:
    """Raise ValueError unless it is what was written."""
    ids, descriptor, truth = snapshot.id, snapshot.descriptor, snapshot.ground_truth
    counts = (snapshot.generation, snapshot.evaluations, snapshot.size)
    if snapshot.moment not in ("", *_MOMENTS) or not all(type(count) is int for count in counts):
        raise ValueError("its moments cannot be read")
    wide = [descriptor, *([] if truth is None else [truth])]
    if ids.dtype != np.int64 or ids.ndim != 1 or any(rows.ndim != 2 or len(rows) != len(ids) for rows in wide):
        raise ValueError("its arrays do not fit together")
    if any(rows.dtype != np.float32 or rows.shape[1] == 0 for rows in wide) or not np.isfinite(descriptor).all():
        raise ValueError("its arrays are not those of skills")


def _state(aurora: Aurora) -> dict[str, Any]:
    """What there is to keep of a run as it is now: views, which cost nothing."""
    archive = aurora.archive
    l = getattr(archive, "l", None)
    return {
        "generation": aurora.generation,
        "evaluations": aurora.evaluations,
        "size": len(archive),
        "l": None if l is None or l != l else float(l),
        "id": archive.id,
        "descriptor": archive.descriptor,
        "ground_truth": archive.ground_truth,
    }


def _chosen(state: Mapping[str, Any], most: int) -> dict[str, np.ndarray]:
    """The columns of some of the skills of a state, in the order of their ids."""
    ids, n = state["id"], len(state["id"])
    wide = {name: state[name].reshape(n, -1) for name in ("descriptor", "ground_truth") if state[name] is not None}
    wide = {name: rows for name, rows in wide.items() if rows.shape[1]}
    numbers = sum(rows.shape[1] for rows in wide.values())
    rows = first_of(ids, min(most, max(_NUMBERS // numbers, _FEWEST)))
    return {"id": ids[rows], **{name: _single(column[rows]) for name, column in wide.items()}}


def first_of(ids: np.ndarray, most: int) -> np.ndarray:
    """Rows of the ids, (n,), that come first in an order that looks random, and is always the same; in the order of rows."""
    if len(ids) <= most:
        return np.arange(len(ids))
    return np.sort(np.argpartition(ids.astype(np.uint64) * _MIXED, most)[:most])


def _single(rows: np.ndarray) -> np.ndarray:
    return np.clip(rows.astype(np.float64), -_LARGEST, _LARGEST).astype(np.float32)


def _most_crowded(files: list[Path]) -> Path:
    """That whose neighbours are the closest together; the first and the last stay."""
    generations = np.array([int(path.stem) for path in files])
    return files[1 + int(np.argmin(generations[2:] - generations[:-2]))]
