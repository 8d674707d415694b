"""Where trajectories in the plane happen: what else there is to see than the body that moves, for each task."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auroraqd.observations import shapes_of, streams_of
from auroraqd.provenance import importable
from auroraqd.repertoire import Repertoire
from auroraqd.tasks import air_hockey

_AIR_HOCKEY = f"{air_hockey.__name__}:AirHockey"  # of a run from Python


@dataclass(frozen=True)
class Scene:
    """A place where a body moves.

    Args:
        low, high: (2,) its corners, in the units of the trajectories.
        walls: whether it ends there.
        radius: of the body, in the same units; 0 for a point.
        start: (2,) where the body is before the first sample, or None.
        others: streams of the observation that are the ways of more such bodies, and where these are before the first sample.
        arm: from genotypes, (n, n_genes), and the number of samples, to the joints of an arm, (n, steps, joints, 2), or None.
        interval: seconds between two samples, as it is shown.
    """

    low: np.ndarray
    high: np.ndarray
    walls: bool = False
    radius: float = 0.0
    start: np.ndarray | None = None
    others: Mapping[str, np.ndarray] = field(default_factory=dict)
    arm: Callable[[np.ndarray, int], np.ndarray] | None = None
    interval: float = 0.1


def scene_of(config: Mapping[str, Any], repertoire: Repertoire) -> Scene:
    """The scene of the task of a run; of one that is not known, the box of its trajectories.

    Args:
        config: of the run folder.
        repertoire: of the same.

    Raises:
        ValueError: the observations are not trajectories in the plane.
    """
    observation = trajectories_of(repertoire)
    if observation is None:
        raise ValueError(
            f"skills must be trajectories in the plane, observations or a stream of shape (steps, 2), got "
            f'{shapes_of(repertoire.observation)}: return what moves in the plane as streams, {{"robot": way[..., :2], ...}}'
        )
    if str(config.get("task")).partition(":")[0] == "air-hockey" or importable(config) == _AIR_HOCKEY:
        wall, streams = np.full(2, air_hockey.WALL), streams_of(repertoire.observation)
        start, *more = (np.array(place) for place in air_hockey.PLACES)
        others = {name: place for name, place in zip(air_hockey.NAMES[1:], more, strict=True) if name in streams}
        return Scene(-wall, wall, walls=True, radius=air_hockey.PUCK, start=start, others=others, arm=air_hockey.joints)
    low, high = (ends.astype(np.float64) for ends in (observation.min(axis=(0, 1)), observation.max(axis=(0, 1))))
    margin = 0.03 * np.maximum(high - low, 1e-9)
    return Scene(low - margin, high + margin)


def trajectories_of(repertoire: Repertoire) -> np.ndarray | None:
    """(n, steps, 2): the observations, or the first stream of them, that are points in the plane at several instants; of
    two contacts only where there are no others.

    None if there are none.
    """
    streams = [
        stream
        for stream in streams_of(repertoire.observation).values()
        if stream.ndim == 3 and len(stream) and stream.shape[1] > 1 and stream.shape[2] == 2
    ]
    return min(streams, key=lambda stream: stream.dtype == bool, default=None)
