"""The octopus arm, as a model of MuJoCo that is written here: a flex, which is a solid of tetrahedra, plates, and muscles.

A square bar of soft foam (0.6 m long, 0.06 m wide, a Young's modulus of 10 kPa), as dense as the water that it is in, hangs in
four parts between stiff plates, which are a twentieth of its mass each. Its vertices lie in nine slices of a middle and four
corners. Those of every other slice are fixed to a plate, the others move freely. The wedges between a middle and two corners of
one slice and the same of the next are cut into three tetrahedra. A muscle runs along each of the four edges of each part, from
plate to plate. Water resists as MuJoCo has it for bodies of any kind, by their boxes of inertia.

All of it is ours; arms of an octopus that muscles bend in water have been learned to control since [1], in two dimensions.
There are plates, and muscles that have no force once they are 30% shorter, because a flex does not resist being turned inside
out: pulled at a vertex, a corner is, and so is foam that is pressed to half its length. With a step of an eighth, 40 random
arms end within 1.2 mm of where they do with this one.

[1] Y. Engel, P. Szabo, D. Volkinshtein, Learning to control an octopus arm with Gaussian process temporal difference methods,
NIPS 2005.
"""

import math
from typing import Any, NamedTuple

import numpy as np

PARTS, CORNERS = 4, 4
PLATES = PARTS + 1
SLICES = 2 * PARTS + 1
MUSCLES = PARTS * CORNERS
TIMESTEP = 0.002  # s, of the physics
_LENGTH, _WIDTH, _ABOVE = 0.6, 0.06, 0.8  # m
_WATER = 1000.0  # kg/m^3
_MASS = _WATER * _LENGTH * _WIDTH**2
_YOUNG, _POISSON, _DAMPING = 1e4, 0.2, 0.005  # Pa, of one, s
_FORCE = 5.0  # N, of a muscle at most
_RADIUS = 0.005  # m, of the skin around its vertices
_THICK = 0.006  # m, of a plate
_SHORTEST, _LONGEST = 0.7, 1.3  # of a muscle, in its lengths at rest; at the shortest it has no force
_SIDES = (-1, -1), (1, -1), (1, 1), (-1, 1)  # of the corners, x and y


class Vertex(NamedTuple):
    """Of the body.

    Attributes:
        slice: from where it hangs, 0, to the tip; the even ones are plates.
        corner: 0 to 3, or 4, its middle.
    """

    slice: int
    corner: int

    @property
    def name(self) -> str:
        """In the model, of its site, and of its body if it moves freely."""
        return f"vertex_{self.slice}_{self.corner}"

    @property
    def body(self) -> str:
        """That it is of."""
        return self.name if self.slice % 2 else f"plate_{self.slice // 2}"

    @property
    def aside(self) -> np.ndarray:
        """From the middle of its slice, x, y, z in m."""
        x, y = (0, 0) if self.corner == CORNERS else _SIDES[self.corner]
        return _WIDTH / 2 * np.array([x, y, 0])

    @property
    def place(self) -> np.ndarray:
        """x, y, z in m, before it moves."""
        return self.aside + np.array([0, 0, _ABOVE - _LENGTH * self.slice / (SLICES - 1)])


VERTICES = [Vertex(i, j) for i in range(SLICES) for j in range(CORNERS + 1)]
_ORDER = range(PLATES - 1, -1, -1)  # the tip first: what moves, for cameras and films
PLACES = [7 * _ORDER.index(plate) for plate in range(1, PLATES)]
"""Where in qpos the places of the plates that move begin, from above to the tip; seven numbers are of each."""


def xml() -> str:
    """The model."""
    free = [vertex for vertex in VERTICES if vertex.slice % 2]
    muscles = [(f"muscle_{part}_{corner}", part, corner) for part in range(PARTS) for corner in range(CORNERS)]
    local = [np.zeros(3) if vertex.slice % 2 else vertex.aside for vertex in VERTICES]
    tetrahedra = [VERTICES.index(vertex) for element in elements() for vertex in element]
    return f"""<mujoco model="octopus_arm">
      <option timestep="{TIMESTEP}" integrator="Euler" gravity="0 0 0" density="{_WATER}" viscosity="0.001"/>
      <visual><headlight ambient="0.4 0.4 0.4"/></visual>
      <asset>
        <texture name="floor" type="2d" builtin="checker" rgb1="0.85 0.85 0.85" rgb2="0.75 0.75 0.75" width="64" height="64"/>
        <material name="floor" texture="floor" texrepeat="40 40"/>
      </asset>
      <worldbody>
        <light pos="0 0 3" dir="0 0 -1"/>
        <geom name="floor" type="plane" size="4 4 0.1" material="floor" contype="0" conaffinity="0"/>
        {"".join(map(_plate, _ORDER))}
        {"".join(map(_body, free))}
      </worldbody>
      <deformable>
        <flex name="foam" dim="3" radius="{_RADIUS}" rgba="0.9 0.55 0.45 1" body="{" ".join(v.body for v in VERTICES)}"
              vertex="{_text(np.concatenate(local))}" element="{_text(tetrahedra)}">
          <contact contype="0" conaffinity="0" selfcollide="none"/>
          <elasticity young="{_YOUNG}" poisson="{_POISSON}" damping="{_DAMPING}"/>
        </flex>
      </deformable>
      <tendon>{"".join(_tendon(*muscle) for muscle in muscles)}</tendon>
      <actuator>{"".join(_muscle(*muscle) for muscle in muscles)}</actuator>
    </mujoco>"""


def elements() -> list[tuple[Vertex, ...]]:
    """The tetrahedra, each with a positive volume."""
    found = []
    for upper in range(SLICES - 1):
        for corner in range(CORNERS):
            sides = corner, (corner + 1) % CORNERS
            wedge = CORNERS, *(sides if (corner + upper) % 2 else sides[::-1])  # so that it has no twist
            a, b = ([Vertex(i, j) for j in wedge] for i in (upper, upper + 1))
            found += [(a[0], a[1], a[2], b[2]), (a[0], a[1], b[2], b[1]), (a[0], b[1], b[2], b[0])]
    return [element if _volume(element) > 0 else (*element[:2], element[3], element[2]) for element in found]


def _volume(element: tuple[Vertex, ...]) -> float:
    first, *others = (vertex.place for vertex in element)
    return float(np.linalg.det(np.array(others) - first)) / 6


def _plate(plate: int) -> str:
    middle = Vertex(2 * plate, CORNERS)
    corners = (Vertex(2 * plate, corner) for corner in range(CORNERS))
    sites = "".join(f'<site name="{v.name}" pos="{_text(v.aside)}" size="0.005" rgba="0 0 0 0"/>' for v in corners)
    return f"""
        <body name="{middle.body}" pos="{_text(middle.place)}">
          {"<freejoint/>" if plate else ""}
          <geom type="box" size="{_WIDTH / 2} {_WIDTH / 2} {_THICK / 2}" mass="{_MASS / 20}" contype="0" conaffinity="0"
                rgba="0.35 0.37 0.42 1"/>
          {sites}
        </body>"""


def _body(vertex: Vertex) -> str:
    mass = _MASS * (1 - PLATES / 20) / PARTS / (CORNERS + 1)
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    return f"""
        <body name="{vertex.name}" pos="{_text(vertex.place)}">
          <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/>
          {slides}
        </body>"""


def _tendon(name: str, part: int, corner: int) -> str:
    sites = "".join(f'<site site="{Vertex(2 * plate, corner).name}"/>' for plate in (part, part + 1))
    return f'<spatial name="{name}" width="0.004" rgba="0.6 0.1 0.15 1">{sites}</spatial>'


def _muscle(name: str, part: int, corner: int) -> str:
    length = math.dist(Vertex(2 * part, corner).place, Vertex(2 * part + 2, corner).place)
    return f"""
        <muscle name="{name}" tendon="{name}" ctrlrange="0 1" force="{_FORCE}" range="0.5 1.3" fpmax="0.01" vmax="100"
                lengthrange="{_SHORTEST * length} {_LONGEST * length}"/>"""


def _text(values: Any) -> str:
    return " ".join(map(str, values))
