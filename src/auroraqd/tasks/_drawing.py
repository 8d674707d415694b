"""MuJoCo's drawing of a robot, into memory: without a display or a GPU."""

import copy
import os
import sys
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from ctypes.util import find_library
from importlib import import_module
from typing import Any

import numpy as np

_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_MOST_GEOMS = 2000  # in a picture


_drawing = ThreadPoolExecutor(1, "auroraqd-drawing")  # a context belongs to the thread that made it: all to this one


class Canvas:
    """Where a robot is drawn, in pale surroundings.

    Args:
        model: of MuJoCo; a copy is drawn.
        height, width: of a picture, in pixels.
        more: geoms that will be added to those of the model, at most.

    Attributes:
        model, data: the copy, and where it is posed.

    Raises:
        ValueError: there is no library to draw with.
    """

    def __init__(self, model: Any, height: int, width: int, more: int = 0):
        self._mujoco: Any = import_module("mujoco")
        self.model = copy.deepcopy(model)  # of which only looks are changed
        _paler(self.model)
        self.model.vis.global_.offwidth, self.model.vis.global_.offheight = width, height
        self.data = self._mujoco.MjData(self.model)
        self._scene = self._mujoco.MjvScene(self.model, maxgeom=_MOST_GEOMS + more)
        self._size = self._mujoco.MjrRect(0, 0, width, height)
        self._context, self._drawn = _drawing.submit(_begin, self.model, height, width).result()
        self.close = weakref.finalize(self, _end, self._context, self._drawn)

    def pose(self, positions: np.ndarray) -> None:
        """Take a pose, (nq,)."""
        self.data.qpos[:] = positions
        self._mujoco.mj_forward(self.model, self.data)

    def picture(self, positions: np.ndarray, camera: Any, add: Callable[[Any], object] = lambda scene: None) -> np.ndarray:
        """A pose, (nq,), as a camera of MuJoCo sees it, (height, width, 3), uint8; with what is added to the scene."""
        return _drawing.submit(self._picture, positions, camera, add).result()

    def _picture(self, positions: np.ndarray, camera: Any, add: Callable[[Any], object]) -> np.ndarray:
        mujoco = self._mujoco
        self.pose(positions)
        every, scene = mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        mujoco.mjv_updateScene(self.model, self.data, mujoco.MjvOption(), mujoco.MjvPerturb(), camera, every, scene)
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # half the time to draw without a GPU, and hardly seen
        add(scene)
        picture = np.empty((self._size.height, self._size.width, 3), np.uint8)
        self._context.make_current()
        mujoco.mjr_render(self._size, scene, self._drawn)
        mujoco.mjr_readPixels(picture, None, self._size, self._drawn)
        return picture[::-1]


def _begin(model: Any, height: int, width: int) -> tuple[Any, Any]:
    """In the thread that draws: what MuJoCo draws into, and what it keeps there of a model."""
    mujoco: Any = import_module("mujoco")
    context = gl_context(width, height)
    context.make_current()
    drawn = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawn)
    return context, drawn


def _end(context: Any, drawn: Any) -> None:
    """Give back what the library keeps. In any other context than its own, what is drawn would free what is of others."""

    def free() -> None:
        context.make_current()
        drawn.free()
        context.free()

    with suppress(RuntimeError):  # the interpreter ends, and the thread has
        _drawing.submit(free)


def moving_body(model: Any) -> int:
    """The body that the first joint moves, the torso of most robots."""
    return int(model.jnt_bodyid[0]) if model.njnt else 0


def moving_parts(model: Any) -> np.ndarray:
    """The radii, in m, of what may move and is no ground: geoms, and the vertices of soft bodies, (parts,)."""
    soft = np.repeat(model.flex_radius, model.flex_vertnum) if model.nflex else np.empty(0)
    return np.concatenate([model.geom_rbound[_moving_geoms(model)], soft])


def places_of_parts(model: Any, data: Any) -> np.ndarray:
    """Where these are, (parts, 3), in m."""
    soft = data.flexvert_xpos.reshape(-1, 3)
    return np.concatenate([data.geom_xpos[_moving_geoms(model)], soft])


def _moving_geoms(model: Any) -> np.ndarray:
    return np.flatnonzero((model.geom_bodyid > 0) & (model.geom_type > 0))


def _paler(model: Any) -> None:
    """The ground in pale colours, of which robots stand out, and no reflections."""
    for material in {int(model.geom_matid[geom]) for geom in np.flatnonzero(model.geom_type == 0)} - {-1}:
        model.mat_reflectance[material] = 0
        for texture in {int(index) for index in model.mat_texid[material]} - {-1}:
            first, last = model.tex_adr[texture], model.tex_adr[texture] + _texels(model, texture)
            model.tex_data[first:last] = 190 + model.tex_data[first:last] * 0.15


def _texels(model: Any, texture: int) -> int:
    return int(model.tex_height[texture] * model.tex_width[texture] * model.tex_nchannel[texture])


def gl_context(width: int = 64, height: int = 64) -> Any:
    """What MuJoCo draws into: memory.

    Raises:
        ValueError: there is no library for it.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    try:
        if not sys.platform.startswith("linux"):
            return import_module("mujoco").GLContext(width, height)
        name = wanted if wanted in _LIBRARIES else next(name for name in _LIBRARIES if find_library(_LIBRARIES[name]))
        return import_module(f"mujoco.{name}").GLContext(width, height)
    except (StopIteration, ImportError, AttributeError, RuntimeError) as error:
        reason = f" ({error})" if str(error) else ""
        raise ValueError(
            "there is no library to draw robots with: install EGL or OSMesa, on Debian or Ubuntu with "
            f"apt-get install libegl1 libgl1{reason}"
        ) from None
