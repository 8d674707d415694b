"""What is known of the tasks that come with auroraqd, beyond what a run keeps: genes by name, and what moves, and where."""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from auroraqd.provenance import genes_in, importable, task_in, task_named
from auroraqd.repertoire import Repertoire
from auroraqd.report.explorer.sights import Sight
from auroraqd.report.scenes import scene_of
from auroraqd.tasks import Genes, air_hockey, ballistic

_BALLISTIC, _AIR_HOCKEY = "ballistic", "air-hockey"
_OF = {f"{ballistic.__name__}:Ballistic": _BALLISTIC, f"{air_hockey.__name__}:AirHockey": _AIR_HOCKEY}
_ABOUT = {
    _BALLISTIC: "The robot throws: a skill is an angle and a force, and the way of what is thrown.",
    _AIR_HOCKEY: "The robot is an arm of four joints beside a puck: a skill is how the arm moves, and the way of the puck.",
}
_ROBOT = re.compile(r"Gym\(env_id='([^']*)'")
_ENDS = (0.1, 0.9)  # of what the throw's genes are mapped to, in shares of the largest angle and force
_SECONDS = 5.0  # that a skill takes to be shown


def task_of(config: Mapping[str, Any]) -> str | None:
    """The name of the task of a run, if it came with auroraqd."""
    named = str(config.get("task")).partition(":")[0]
    return named if named in _OF.values() else _OF.get(importable(config) or "")


def robot_in(config: Mapping[str, Any]) -> str | None:
    """The environment of Gymnasium of a run, if its task is one."""
    found = _ROBOT.match(str((task_in(config) or {}).get("repr")))
    return None if found is None else found[1]


def called(config: Mapping[str, Any]) -> str | None:
    """What the task of a run is called, as short as it is known."""
    return task_of(config) or robot_in(config) or task_named(config)


def about(config: Mapping[str, Any]) -> str:
    """A sentence on the robot of a run, if it is known."""
    robot = robot_in(config)
    return f"The robot is {robot}: a skill is how it moves." if robot else _ABOUT.get(task_of(config) or "", "")


def genes_of(config: Mapping[str, Any], n_genes: int) -> Genes | None:
    """The genes of the task of a run, if they are known."""
    task, genes = task_of(config), genes_in(config)
    if task == _BALLISTIC:
        low, high = _ENDS
        genes = Genes(angle=(low * math.pi / 2, high * math.pi / 2, "rad"), force=(low * 200, high * 200, "N"))
    elif task == _AIR_HOCKEY:
        moves = [f"{move} joint {joint + 1}" for move in ("first", "final") for joint in range(air_hockey.JOINTS)]
        genes = Genes(**dict.fromkeys(moves, (-math.pi, math.pi, "rad")))
    return genes if genes is not None and len(genes) == n_genes else None


def truth_names(config: Mapping[str, Any], columns: int) -> list[str]:
    """What the columns of the ground truth are."""
    known = {
        _BALLISTIC: ["top of the arc, x", "top of the arc, height"],
        _AIR_HOCKEY: ["end of the puck, x (m)", "end of the puck, y (m)"],
    }.get(task_of(config) or "", [])
    return known if len(known) == columns else [f"ground truth {column + 1}" for column in range(columns)]


def stage_of(config: Mapping[str, Any], repertoire: Repertoire, sight: Sight, observation: np.ndarray) -> dict[str, Any] | None:
    """Where the lines of what a run observed are drawn, and what moves beside them; None for images."""
    if sight.kind == "image":
        return None
    if sight.kind == "series":
        least, most = float(observation.min()), float(observation.max())
        return {"low": [0, least], "high": [sight.shape[0] - 1, most], "equal": False, "labels": ["step", ""]}
    scene, task, steps = scene_of(config, repertoire), task_of(config), sight.shape[0]
    width, height = scene.high - scene.low
    return {
        "low": scene.low.tolist(),
        "high": scene.high.tolist(),
        "equal": bool(1 / 3 < width / height < 3),  # others would be unreadable
        "labels": ["x (m)", "y (m)"] if task is not None else ["x", "y"],
        "walls": scene.walls,
        "ground": task == _BALLISTIC,
        "radius": scene.radius,
        "start": None if scene.start is None else scene.start.tolist(),
        "arm": _arm(steps) if task == _AIR_HOCKEY else None,
        "seconds": _SECONDS,
    }


def _arm(steps: int) -> dict[str, Any]:
    """An arm, at each sample: the angle of a joint is `first` times its first target plus `final` times its final one."""
    reached = 1 - math.exp(-air_hockey.RATE * air_hockey.PHASE)
    share = 1 - np.exp(-air_hockey.RATE * air_hockey.PHASE * np.arange(1, steps + 1) / steps)
    return {
        "joints": air_hockey.JOINTS,
        "link": air_hockey.LINK,
        "first": ((1 - share) * reached).tolist(),
        "final": share.tolist(),
    }
