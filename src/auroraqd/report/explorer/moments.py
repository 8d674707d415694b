"""How a run was at its updates: the skills of its snapshots as points of the maps, for a slider through time."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auroraqd.report.explorer.spaces import main_directions
from auroraqd.report.explorer.tables import single, table, wholes
from auroraqd.runs.snapshots import Snapshot, first_of

_MOST_UPDATES = 24  # that are in a page: with the skills of each, some 2 MB
_MOST_SKILLS = 2000


def moments(snapshots: Sequence[Snapshot], spaces: Mapping[str, Any], placed: str) -> list[dict[str, Any]]:
    """What a page holds of snapshots: values, and of each skill its id and its places.

    Args:
        snapshots: in order.
        spaces: of the skills as they are now, by which the ground truth is shown.
        placed: the space whose places give colours, as `auroraqd.report.explorer.runs` has it.
    """
    return [_moment(snapshot, spaces, placed) for snapshot in _some(snapshots)]


def _moment(snapshot: Snapshot, spaces: Mapping[str, Any], placed: str) -> dict[str, Any]:
    rows = first_of(snapshot.id, _MOST_SKILLS)
    places = {"descriptor": _own_plane(snapshot.descriptor[rows])}
    colours_by, space, truth = places["descriptor"], spaces.get("truth"), snapshot.ground_truth
    if space is not None and truth is not None and truth.shape[1] == len(space["names"]):
        places["truth"] = _plane_of(space, truth[rows])
        colours_by = truth[rows, :2] if placed == "ground truth" else colours_by
    return {
        "generation": snapshot.generation,
        "moment": snapshot.moment,
        "size": snapshot.size,
        "l": None if snapshot.l != snapshot.l else snapshot.l,
        "id": wholes(snapshot.id[rows]),
        "places": {name: table(plane, np.uint16 if np.isfinite(plane).all() else None) for name, plane in places.items()},
        "colours_by": colours_by,
    }


def _own_plane(descriptor: np.ndarray) -> np.ndarray:
    """The two directions in which descriptors vary most, (n, d) to (n, 2): those of other times mean something else."""
    if descriptor.shape[1] > 2 and len(descriptor) > 1:
        return single((descriptor - descriptor.mean(axis=0)) @ main_directions(descriptor).T)
    return _two(descriptor)


def _plane_of(space: Mapping[str, Any], values: np.ndarray) -> np.ndarray:
    """Values, (n, columns), where a map shows them at first, (n, 2)."""
    if space["main"] is None:
        return _two(values)
    return single((values - np.array(space["middle"])) @ np.array(space["directions"]).T)


def _two(values: np.ndarray) -> np.ndarray:
    return np.column_stack([values, np.zeros(len(values), values.dtype)])[:, :2]


def _some(snapshots: Sequence[Snapshot]) -> list[Snapshot]:
    """Those of as many updates as a page can hold, from the first to the last."""
    ends = [number for number, snapshot in enumerate(snapshots) if snapshot.moment != "before"]
    kept = {ends[k] for k in np.linspace(0, len(ends) - 1, _MOST_UPDATES).round().astype(int)} if ends else set()
    return [
        snapshot
        for number, snapshot in enumerate(snapshots)
        if number in kept or (snapshot.moment == "before" and number + 1 in kept)
    ]
