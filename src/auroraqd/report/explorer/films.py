"""Films of robots for a page: of each skill one picture, with all frames below each other, of which the page shows one."""

import base64
import io
from typing import Any

import numpy as np
from PIL import Image

from auroraqd.repertoire import Repertoire, diverse
from auroraqd.report.robots import Studio, check_robot, robot_of
from auroraqd.tasks import Gym, Hexapod
from auroraqd.tasks.noise import other_seeds

MOST = 64
"""Films of a page."""
_FRAMES = 48
_SIZE = 256, 192  # pixels of a frame, wide and high
_QUALITY = 40  # of a picture, of 100


def films(repertoire: Repertoire, n: int, task: Gym | Hexapod | None = None) -> dict[int, dict[str, Any]]:
    """Films of n skills that are spread over descriptor space; see `filmed`."""
    return filmed(repertoire, diverse(repertoire.descriptor, n), task)


def filmed(repertoire: Repertoire, rows: np.ndarray, task: Gym | Hexapod | None = None) -> dict[int, dict[str, Any]]:
    """Films of skills, by their rows.

    Each has its `image`, an address that holds the picture itself; how many `frames` are in it, from the top; and how many
    `seconds` the robot takes.

    Args:
        repertoire: of a robot of MuJoCo.
        rows: which skills, (n,); those that are invalid when they are done again are left out.
        task: the robot; by default that of the run, which is imported.

    Raises:
        ValueError: the task is not of MuJoCo, or of another number of genes, or not to be found; there is nothing to draw with.
    """
    task = robot_of(repertoire.config) if task is None else task
    if task is None:
        raise ValueError("the task of the run is no robot that MuJoCo draws, or cannot be imported here: name it with task")
    check_robot(task, repertoire.genotype.shape[1])
    poses = task.episode(repertoire.genotype[rows], other_seeds(0, len(rows)) if task.seeded else None).qpos
    valid = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
    shown = np.unique(np.linspace(0, task.steps - 1, _FRAMES).round().astype(int))
    if not len(valid):
        return {}
    studio = Studio(task.model, poses[valid][:, shown], _SIZE, together=False)
    try:
        seconds = task.interval * task.steps
        return {
            int(rows[row]): {"image": _picture(studio, number, len(shown)), "frames": len(shown), "seconds": seconds}
            for number, row in enumerate(valid)
        }
    finally:
        studio.close()


def _picture(studio: Studio, row: int, frames: int) -> str:
    strip, file = np.concatenate([studio.picture(row, frame) for frame in range(frames)]), io.BytesIO()
    Image.fromarray(strip).save(file, "WEBP", quality=_QUALITY)
    return f"data:image/webp;base64,{base64.b64encode(file.getvalue()).decode()}"
