"""Large observations, images for instance, in files of their own beside a checkpoint: pieces, each of which is written once.

An individual never changes what it observed. So a checkpoint writes the observations of those that came since the one before,
and names the pieces in which the others are. Observations of individuals that went stay in their pieces until they are more
than those of individuals that are stored; then all are written anew.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from auroraqd._checks import shown
from auroraqd._files import folder_at
from auroraqd.individuals import check_like
from auroraqd.runs import _tensors
from auroraqd.runs._saved import check_array

FOLDER = "observations"
_FORMAT = "auroraqd observations 1"
_NAMES, _COLUMN = "observation.pieces", "observation"  # of a checkpoint: instead of the column, the names
_NAME = re.compile(r"[0-9]{8}\.safetensors")
_LARGE = 2**26  # bytes: fewer are no reason for files of their own
_MOST_BYTES = 2**24  # of a piece: some times as much is needed to write it, where memory may have come to its end
_MOST_PIECES = 256  # of a checkpoint, beyond those that are needed


class Piece(NamedTuple):
    """A file, by its name, and the ids of the individuals in it, (n,)."""

    name: str
    ids: np.ndarray


def apart(
    folder: Path, arrays: Mapping[str, np.ndarray], pieces: Sequence[Piece]
) -> tuple[Mapping[str, np.ndarray], Sequence[Piece]]:
    """Arrays of a checkpoint with a large column of observations in pieces, and these.

    Args:
        folder: of the run.
        arrays: by name.
        pieces: those that were written for the checkpoint before, of the same run.

    Raises:
        OSError: a piece cannot be written.
    """
    observation, ids = arrays[_COLUMN], arrays["id"]
    if observation.nbytes < _LARGE:
        return arrays, ()
    rows = np.flatnonzero(~np.isin(ids, np.concatenate([np.empty(0, np.int64), *(piece.ids for piece in pieces)])))
    at_once = max(_MOST_BYTES * len(observation) // observation.nbytes, 1)
    many = _MOST_PIECES + 2 * len(ids) // at_once
    if len(pieces) > many or sum(len(piece.ids) for piece in pieces) + len(rows) > 2 * len(ids):
        pieces, rows = (), np.arange(len(ids))
    for begin in range(0, len(rows), at_once):
        some = rows[begin : begin + at_once]
        pieces = (*pieces, _written(folder_at(folder / FOLDER), ids[some], observation[some]))
    names = json.dumps([piece.name for piece in pieces]).encode()
    rest = {name: array for name, array in arrays.items() if name != _COLUMN}
    return {**rest, _NAMES: np.frombuffer(names, np.uint8)}, pieces


def _written(folder: Path, ids: np.ndarray, observation: np.ndarray) -> Piece:
    """A new piece: under no name of another, which an earlier checkpoint may need."""
    latest = max((int(path.stem) for path in _files(folder)), default=0)
    name = f"{latest + 1:08d}.safetensors"
    _tensors.write(folder / name, {"id": ids, _COLUMN: observation}, _FORMAT, "")
    return Piece(name, ids)


def together(
    folder: Path, arrays: Mapping[str, np.ndarray], room: Callable[[tuple[int, ...], np.dtype], np.ndarray] = np.empty
) -> dict[str, np.ndarray]:
    """The arrays of a checkpoint, with its observations if they are in pieces.

    Args:
        folder: of the run.
        arrays: by name, as `apart` gave them.
        room: makes an array for the observations, of a shape and a dtype.

    Raises:
        ValueError: a piece is damaged, or missing, or is not of this checkpoint.
    """
    if _NAMES not in arrays:
        return dict(arrays)
    ids, found = arrays["id"], None
    check_array("id", ids, axes=1, dtype=np.int64)
    if not len(ids):
        raise ValueError("observations must be those of individuals, and there are none")
    order = np.argsort(ids)
    missing = np.ones(len(ids), bool)
    for name in _names(arrays):
        piece_ids, rows = _read(folder / FOLDER / name)
        found = room((len(ids), *rows.shape[1:]), rows.dtype) if found is None else found
        check_like(name, rows, found)
        place = np.searchsorted(ids, piece_ids, sorter=order)
        place[place == len(ids)] = 0
        target = order[place]
        here = ids[target] == piece_ids
        found[target[here]], missing[target[here]] = rows[here], False
    if found is None or missing.any():
        raise ValueError(f"the observations of {np.count_nonzero(missing)} individuals are in none of its pieces")
    return {**{name: array for name, array in arrays.items() if name != _NAMES}, _COLUMN: found}


def _names(arrays: Mapping[str, np.ndarray]) -> list[str]:
    """Of the pieces that a checkpoint needs."""
    if _NAMES not in arrays:
        return []
    names = json.loads(arrays[_NAMES].tobytes())
    if not isinstance(names, list) or not all(isinstance(name, str) and _NAME.fullmatch(name) for name in names):
        raise ValueError(f"{_NAMES} must be names of files, got {shown(names)}")
    return names


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The ids, (n,), and the observations, (n, ...), of a piece."""
    try:
        arrays, _ = _tensors.read(path, _FORMAT)
    except FileNotFoundError:
        raise ValueError(f"{path} is missing") from None
    ids, rows = arrays["id"], arrays[_COLUMN]
    check_array(f"id in {path.name}", ids, axes=1, dtype=np.int64)
    if rows.ndim == 0 or len(rows) != len(ids):
        raise ValueError(f"{path} must hold as many observations as ids, {len(ids)}, got shape {rows.shape}")
    return ids, rows


def remove_others(folder: Path, pieces: Sequence[Piece], before: Callable[[], Mapping[str, np.ndarray]]) -> None:
    """Remove the pieces that are neither these nor of the checkpoint before, if it can be read; a call gives its arrays."""
    needed = {piece.name for piece in pieces}
    others = [path for path in _files(folder / FOLDER) if path.name not in needed]
    if not others:
        return
    try:
        needed.update(_names(before()))
    except FileNotFoundError:
        pass
    except (OSError, ValueError):
        return
    for path in others:
        if path.name not in needed:
            path.unlink(missing_ok=True)
    with suppress(OSError):  # it is not empty
        (folder / FOLDER).rmdir()


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.safetensors") if _NAME.fullmatch(path.name)]
