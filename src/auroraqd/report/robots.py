"""Videos of robots: skills of a task of MuJoCo beside each other, drawn by MuJoCo itself, without a display or a GPU.

The camera stands still and shows the whole way of all, so that panels compare; a line follows the body that the first joint
moves, the torso of most robots.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from auroraqd._checks import numbers
from auroraqd._files import as_path
from auroraqd.report.videos import LAST, arrangement, video
from auroraqd.tasks import Gym, Hexapod, name_of
from auroraqd.tasks._drawing import Canvas, moving_body, moving_parts, places_of_parts

_WIDTH, _HEIGHT = 320, 240  # pixels of a panel
_RATE = 25.0  # most frames a second
_WAY = np.array([0.95, 0.2, 0.5, 1.0], np.float32)
_THICK = 0.004  # of the line, in distances of the camera
_MARGIN = 1.05


def film(
    task: Gym | Hexapod,
    genotypes: np.ndarray,
    path: str | Path,
    seeds: np.ndarray | None = None,
    names: Sequence[str] | None = None,
    listener: Callable[[int, int], object] = lambda done, frames: None,
) -> None:
    """Write a video of robots, beside each other, in real time.

    It draws with EGL or OSMesa, whichever there is; the environment variable MUJOCO_GL names one.

    Args:
        task: of a robot of MuJoCo.
        genotypes: (n, n_genes), of a few.
        path: ends in .gif or .mp4. A file that is there is replaced when the new one is complete.
        seeds: (n,), if the task is noisy.
        names: n, above each; by default their numbers.
        listener: told how many frames of how many are drawn.

    Raises:
        ValueError: the task is not of MuJoCo, there is nothing to draw, or to draw with or into, or an argument has another
            shape.
        TypeError: the path is none.
        OSError: it cannot be written.
    """
    check_robot(task)
    path, genotypes = as_path("path", path), numbers("genotypes", genotypes, " of shape (n, n_genes)")
    if genotypes.ndim != 2 or len(genotypes) == 0:
        raise ValueError(f"genotypes must have shape (n, n_genes), with at least one row, got {genotypes.shape}")
    names = [f"skill {row}" for row in range(len(genotypes))] if names is None else names
    if isinstance(names, str) or not isinstance(names, Sequence | np.ndarray) or len(names) != len(genotypes):
        came = len(names) if isinstance(names, Sequence | np.ndarray) and not isinstance(names, str) else repr(names)
        raise ValueError(f"names must be {len(genotypes)}, one for each genotype, got {came}")
    poses = task.episode(genotypes, seeds).qpos
    if not np.isfinite(poses).all():
        raise ValueError(f"genotypes must be of valid individuals, and row {_first_bad(poses)} is not")
    every = max(int(np.ceil(1 / (_RATE * task.interval) - 1e-9)), 1)
    shown = list(range(every - 1, task.steps, every)) or [task.steps - 1]
    rate = max(round(1 / (task.interval * every)), 1)
    frames = [*range(len(shown)), *[len(shown) - 1] * round(LAST * rate)]
    figure, images = _panels(names)
    studio = Studio(task.model, poses[:, shown])
    try:
        with video(figure, path, rate) as add:
            for done, frame in enumerate(frames):
                listener(done, len(frames))
                for row, image in enumerate(images):
                    if done == frame:
                        image.set_data(studio.picture(row, frame))
                add()
    finally:
        studio.close()


def check_robot(task: Any, n_genes: int | None = None) -> None:
    """Raise ValueError unless a task is of a robot that can be drawn, and of this number of genes."""
    if getattr(task, "model", None) is None:
        raise ValueError(f"task {name_of(task)} is not of MuJoCo, which would draw it")
    if len(moving_parts(task.model)) == 0:
        raise ValueError(
            f"task {name_of(task)} has nothing to film: no body that moves has a geom or is soft, in its model of MuJoCo"
        )
    if n_genes not in (None, task.n_genes):
        raise ValueError(f"task {name_of(task)} has {task.n_genes} genes, and the skills have {n_genes}")


def robot_of(config: Mapping[str, Any], named: str | None = None) -> Gym | Hexapod | None:
    """The task of a run, or the one that is named, if it is a robot that MuJoCo draws; None where that of the run is none, or
    is not here.

    Args:
        config: of the run folder. Its task is imported.
        named: "mymodule:my_task".

    Raises:
        ValueError: there is no such task, or it is no robot.
    """
    from auroraqd.experiments.settings import Settings, task_of

    try:
        task = Settings(task=named or task_of(config) or "ballistic").build_task()
    except ValueError:
        if named is not None:
            raise
        return None  # its module is not here
    if isinstance(task, Gym | Hexapod) and task.model is not None:
        return task
    if named is not None:
        raise ValueError(f"task {named} is no robot that MuJoCo draws, a Hexapod or a Gym of one of its environments")
    return None


def _first_bad(poses: np.ndarray) -> int:
    return int(np.argmin(np.isfinite(poses).all(axis=(1, 2))))


def _panels(names: Sequence[str]) -> tuple[Figure, list[Any]]:
    """A figure of pictures, pixel by pixel, with names above them."""
    title = 20
    lines, columns = arrangement(len(names))
    width, height = columns * _WIDTH, lines * (_HEIGHT + title)
    figure = Figure(figsize=(width / 100, height / 100))
    images = []
    for place, name in enumerate(names):
        line, column = divmod(place, columns)
        left, top = column * _WIDTH / width, 1 - line * (_HEIGHT + title) / height
        axes = figure.add_axes((left, top - (_HEIGHT + title) / height, _WIDTH / width, _HEIGHT / height))
        axes.set_axis_off()
        images.append(axes.imshow(np.zeros((_HEIGHT, _WIDTH, 3), np.uint8), interpolation="nearest", aspect="auto"))
        figure.text(left + _WIDTH / width / 2, top - title / height / 2, name, ha="center", va="center")
    return figure, images


class Studio:
    """Draws a robot in its poses, and the way of its torso.

    Args:
        model: of MuJoCo.
        poses: (n, frames, nq).
        size: of a picture, (width, height), in pixels.
        together: whether one camera sees all n, so that they compare; or each has its own, which is nearer.

    Raises:
        ValueError: there is no library to draw with.
    """

    def __init__(self, model: Any, poses: np.ndarray, size: tuple[int, int] = (_WIDTH, _HEIGHT), *, together: bool = True):
        self._mujoco: Any = import_module("mujoco")
        self._width, self._height = size
        self._canvas = Canvas(model, self._height, self._width, more=poses.shape[1])
        self._poses, data = poses, self._canvas.data
        self._radii = moving_parts(model)
        self._way, places = np.empty((*poses.shape[:2], 3)), np.empty((*poses.shape[:2], len(self._radii), 3))
        for place in np.ndindex(poses.shape[:2]):
            self._canvas.pose(poses[place])
            self._way[place], places[place] = data.xpos[moving_body(model)], places_of_parts(model, data)
        groups = [places.reshape(-1, len(self._radii), 3)] * len(poses) if together else places
        self._cameras = [self._standing(group) for group in groups]

    def picture(self, row: int, frame: int) -> np.ndarray:
        """(height, width, 3), uint8."""
        camera, way = self._cameras[row], self._way[row, : frame + 1]

        def add(scene: Any) -> None:
            for start, end in pairwise(way):
                self._line(scene, start, end, _THICK * camera.distance)

        return self._canvas.picture(self._poses[row, frame], camera, add)

    def close(self) -> None:
        """Give back what the library keeps."""
        self._canvas.close()

    def _line(self, scene: Any, start: np.ndarray, end: np.ndarray, thick: float) -> None:
        capsule, there = self._mujoco.mjtGeom.mjGEOM_CAPSULE, scene.ngeom
        if there == scene.maxgeom or np.array_equal(start, end):
            return
        geom = scene.geoms[there]
        self._mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.eye(3).ravel(), _WAY)
        self._mujoco.mjv_connector(geom, capsule, thick, start, end)
        scene.ngeom += 1

    def _standing(self, places: np.ndarray) -> Any:
        """A camera that sees all of these parts, (m, parts, 3): from the side if they keep to a plane, else from above."""
        low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        camera, model = self._mujoco.MjvCamera(), self._canvas.model
        camera.lookat[:] = (low + high) / 2
        camera.azimuth = 90
        camera.elevation = -15 if high[1] - low[1] < 0.25 * (high[0] - low[0]) else -50
        tilt = np.deg2rad(camera.elevation)
        right, forward = np.array([1, 0, 0]), np.array([0, np.cos(tilt), np.sin(tilt)])
        offset = places - camera.lookat
        aside = np.maximum(np.abs(offset @ right) * self._height / self._width, np.abs(offset @ np.cross(right, forward)))
        half = np.tan(np.deg2rad(model.vis.global_.fovy) / 2)
        camera.distance = _MARGIN * ((aside + self._radii) / half - offset @ forward).max()
        return camera
