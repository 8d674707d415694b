"""What of an episode is observed: positions, velocities, contacts, pictures, or what the environment itself senses."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import flag, number, numbers, shown, whole, whole_numbers
from auroraqd.tasks._drawing import Canvas, moving_body
from auroraqd.tasks._environments import Environments
from auroraqd.tasks._episodes import Episode

_WORDS = ("positions", "velocities", "contacts", "observation", "camera")
_LARGEST = 4096  # pixels of a side
_LUMINANCE = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601


@dataclass(frozen=True)
class Camera:
    """A camera that looks at a robot of MuJoCo, for `Gym(observe=...)`.

    It stands still, the same for all, so pictures tell where a robot is; or it follows, and they tell how it holds itself. The
    pictures are drawn by MuJoCo with EGL or OSMesa, whichever there is (MUJOCO_GL names one), without a display or a GPU. The
    same library on the same machine draws the same, bit for bit.

    Args:
        size: of a picture in pixels, or (height, width).
        frames: moments of the episode, evenly spaced, the last at the end; their colours are channels.
        grey: one channel a frame, not three.
        name: of a camera that the model has; what follows is then not used.
        distance: metres from what it looks at; by default twice the extent of the model.
        azimuth, elevation: degrees, where it looks to; -90 is down.
        lookat: x, y, z of what it looks at, in metres; by default where the body of the first joint, the torso of most robots,
            is in the beginning.
        follow: whether it follows that body.

    Raises:
        ValueError: an argument is of the wrong kind, or out of range.

    Examples:
        >>> import auroraqd
        >>> from_above = auroraqd.tasks.Camera(32, frames=3, grey=True, elevation=-90)
        >>> from_above.shape  # and task = auroraqd.tasks.Gym("Ant-v5", observe=from_above)
        (32, 32, 3)
    """

    size: int | tuple[int, int] = 64
    frames: int = 1
    grey: bool = False
    name: str | None = None
    distance: float | None = None
    azimuth: float = 90.0
    elevation: float = -50.0
    lookat: tuple[float, float, float] | None = None
    follow: bool = False

    def __post_init__(self) -> None:
        pair = isinstance(self.size, list | tuple) and len(self.size) == 2
        for side in self.size if pair else (self.size,):  # pyright: ignore[reportGeneralTypeIssues]
            whole("size of a camera", side, most=_LARGEST)
        whole("frames of a camera", self.frames)
        flag("grey", self.grey)
        flag("follow", self.follow)
        if self.name is not None and not isinstance(self.name, str):
            raise ValueError(f"name of a camera must be one that the model has, got {shown(self.name)}")
        if self.distance is not None and number("distance of a camera", self.distance) == 0:
            raise ValueError("distance of a camera must be more than 0")
        number("azimuth", self.azimuth, least=-360, most=360, wanted="from -360 to 360")
        number("elevation", self.elevation, least=-90, most=90, wanted="from -90 to 90")
        if self.lookat is not None and numbers("lookat", self.lookat, " of shape (3,)", axes=1, finite=True).shape != (3,):
            raise ValueError(f"lookat must be x, y and z, got {shown(self.lookat)}")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of a picture: height, width, channels."""
        height, width = self.size if isinstance(self.size, list | tuple) else (self.size, self.size)
        return height, width, self.frames * (1 if self.grey else 3)


class Sense(NamedTuple):
    """One thing that is observed.

    Attributes:
        column: of an `Episode`, that it follows from.
        moments: steps at which it is seen.
        of: from the column at these moments, (n, moments, ...), to what is seen, (n, ...).
    """

    column: str
    moments: np.ndarray
    of: Callable[[np.ndarray], np.ndarray]

    def __call__(self, episode: Episode) -> np.ndarray:
        """(n, ...)."""
        return self.of(self._at_moments(episode))

    def valid(self, episode: Episode) -> np.ndarray:
        """(n,) bool, where it has something to see at all moments."""
        return np.asarray(np.isfinite(self._at_moments(episode)).all(axis=(1, 2)))

    def _at_moments(self, episode: Episode) -> np.ndarray:
        return getattr(episode, self.column)[:, self.moments]


class Senses:
    """What may be observed in environments of one kind.

    Args:
        environments: of Gymnasium.
        called: of them, for messages.
        steps, samples: of an episode.
        positions: which of MuJoCo's qpos are meant by positions; None: the first two.

    Raises:
        ValueError: there are no such positions.
    """

    def __init__(self, environments: Environments, called: str, steps: int, samples: int, positions: Sequence[int] | None):
        self._environments, self._called, self._steps = environments, called, steps
        self._moments = moments(steps, samples)
        if environments.model is None and positions is not None:
            raise ValueError(
                f"positions are of MuJoCo, and env_id {called!r} is not an environment of MuJoCo: "
                "choose entries of its observation with observe"
            )
        there = 0 if environments.model is None else environments.model.nq
        self._positions = list(range(min(2, there))) if positions is None else self._chosen("positions", positions, there)

    def positions(self) -> Sense:
        """Of a robot of MuJoCo, (n, samples, chosen)."""
        chosen = self._positions
        return Sense("qpos", self._moments, lambda poses: poses[..., chosen])

    def entries(self, name: str, wanted: Any = None) -> Sense:
        """Of the environment's own observation, flat, (n, samples, wanted); None: all."""
        there = self._environments.observations
        if there == 0:
            raise ValueError(f"{self._called} senses nothing, for its observation has no entries: there is nothing to observe")
        chosen = self._chosen(name, range(there) if wanted is None else wanted, there)
        return Sense("observation", self._moments, lambda sensed: sensed[..., chosen])

    def several(self, wanted: Mapping[Any, Any]) -> dict[str, Sense]:
        """Streams, by names that are given."""
        if not wanted:
            raise ValueError("observe must have a stream at least, got none")
        odd = [name for name in wanted if not isinstance(name, str) or not name.isidentifier()]
        if odd:
            raise ValueError(
                f"streams of {self._called} must have names as of variables, got {shown(odd[0])}: with observe, choose others, "
                "by names of your own, or entries by their numbers"
            )
        return {name: self.one(f"observe {name}", what) for name, what in wanted.items()}

    def one(self, name: str, what: Any) -> Sense:
        """A stream of an environment whose observation is a Dict; what a word says; a camera; or numbers of entries."""
        there = self._environments.streams
        if isinstance(what, str) and what in there:
            return Sense("observation", self._moments, there[what].of)
        if isinstance(what, str) and what == "observation":
            return self.entries(name)
        if isinstance(what, Camera) or (isinstance(what, str) and what in _WORDS):
            return self._of_mujoco(name, what)
        if isinstance(what, str) or not np.iterable(what):
            raise ValueError(
                f"{name} must be one of {', '.join([*there, *_WORDS])}, an auroraqd.tasks.Camera, or numbers of entries of the "
                f"observation of {self._called}, got {shown(what)}"
            )
        return self.entries(name, whole_numbers(name, what, axes=1).tolist())

    def _of_mujoco(self, name: str, what: "Camera | str") -> Sense:
        model = self._environments.model
        if model is None:
            word = what if isinstance(what, str) else "camera"
            raise ValueError(f"{name} asks for {word}, which is MuJoCo's, and {self._called} is not an environment of MuJoCo")
        if what == "positions":
            return self.positions()
        if what == "velocities":
            return Sense("qvel", self._moments, lambda velocities: velocities)
        if what == "contacts":
            return Sense("qpos", self._moments, Contacts(model))
        camera = what if isinstance(what, Camera) else Camera()
        if camera.frames > self._steps:
            raise ValueError(f"frames of a camera must be at most {self._steps}, the steps of an episode, got {camera.frames}")
        start = self._environments.first.unwrapped.init_qpos
        return Sense("qpos", moments(self._steps, camera.frames), Pictures(model, start, camera, self._called))

    def _chosen(self, name: str, wanted: Sequence[int], there: int) -> list[int]:
        if not len(wanted) or any(not 0 <= index < there for index in wanted):
            raise ValueError(f"{name} must be of 0 to {there - 1} for {self._called}, got {list(wanted)}")
        return list(wanted)


def moments(steps: int, samples: int) -> np.ndarray:
    """Of so many steps, evenly spaced, the last at the end, (samples,)."""
    return np.linspace(0, steps, samples + 1)[1:].round().astype(int) - 1


class Contacts:
    """Which bodies of a model touch something, the ground for instance, so that a force acts.

    From poses, (n, moments, nq), to (n, moments, bodies) bool. Bodies are those of the model but for the world, in its order.
    Where there is no pose, nothing is touched.
    """

    def __init__(self, model: Any):
        self._model = model

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        mujoco: Any = import_module("mujoco")
        data = mujoco.MjData(self._model)
        touching = np.zeros((*poses.shape[:2], self._model.nbody), bool)
        for place in _posed(poses):
            data.qpos[:] = poses[place]
            mujoco.mj_fwdPosition(self._model, data)
            touching[place][list(_bodies_in(self._model, data.contact))] = True
        return touching[..., 1:]


def _bodies_in(model: Any, contacts: Any) -> Iterator[int]:
    """Of contacts in which a force acts: those of geoms, and those at vertices and elements of soft bodies."""
    acting = contacts.exclude == 0
    geoms, *soft = (sides[acting].ravel() for sides in (contacts.geom, contacts.flex, contacts.vert, contacts.elem))
    yield from model.geom_bodyid[geoms[geoms >= 0]]
    for flex, vertex, element in zip(*soft, strict=True):
        if flex >= 0:
            corners = model.flex_dim[flex] + 1
            first = model.flex_elemdataadr[flex] + corners * element
            vertices = [vertex] if vertex >= 0 else model.flex_elem[first : first + corners]
            bodies = model.flex_vertbodyid[model.flex_vertadr[flex] + vertices]
            yield from bodies[bodies >= 0]  # of a body that deforms as a whole there are none


class Pictures:
    """What a camera sees: from poses, (n, frames, nq), to pictures, (n, height, width, channels) uint8.

    Where there is no pose, the picture is black.

    Args:
        model: of MuJoCo.
        start: (nq,), the pose in the beginning.
        camera: that looks at it.
        called: the robot, for messages.

    Raises:
        ValueError: there is no such camera, or nothing to draw with.
    """

    def __init__(self, model: Any, start: np.ndarray, camera: Camera, called: str):
        self._model, self._camera = model, camera
        mujoco: Any = import_module("mujoco")
        self._view = mujoco.MjvCamera()
        if camera.name is None:
            self._stand(mujoco, start)
        else:
            names = [self._model.camera(index).name for index in range(self._model.ncam)]
            if camera.name not in names:
                there = f"there are {', '.join(filter(None, names))}" if any(names) else "it has none with a name"
                raise ValueError(
                    f"name of a camera must be one that the model of {called} has, got {shown(camera.name)}: {there}"
                )
            self._view.type, self._view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, names.index(camera.name)
        self._canvas = Canvas(self._model, *camera.shape[:2])

    def _stand(self, mujoco: Any, start: np.ndarray) -> None:
        camera, model, body = self._camera, self._model, moving_body(self._model)
        data = mujoco.MjData(model)
        data.qpos[:] = start
        mujoco.mj_kinematics(model, data)
        self._view.lookat[:] = data.xpos[body] if camera.lookat is None else camera.lookat
        self._view.distance = 2 * model.stat.extent if camera.distance is None else camera.distance
        self._view.azimuth, self._view.elevation = camera.azimuth, camera.elevation
        if camera.follow:
            self._view.type, self._view.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, body

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        shape = self._camera.shape
        channels = shape[2] // self._camera.frames
        pictures = np.zeros((len(poses), *shape), np.uint8)
        for row, frame in _posed(poses):
            picture = self._canvas.picture(poses[row, frame], self._view)
            if self._camera.grey:
                picture = (picture @ _LUMINANCE).round()[..., None]
            pictures[row, ..., frame * channels : (frame + 1) * channels] = picture
        return pictures


def _posed(poses: np.ndarray) -> list[tuple[int, ...]]:
    """Where there is a pose, row and moment."""
    return [place for place in np.ndindex(poses.shape[:2]) if np.isfinite(poses[place]).all()]
