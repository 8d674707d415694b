"""The body of the hexapod, as a model of MuJoCo that is written here, whole or damaged.

Lengths, masses and where the legs are, are those of the robot of [1] as its makers published it (a torso of 0.24 x 0.2 x
0.04 m, links of 0.06, 0.085 and 0.1275 m, feet of 0.025 m, 3.36 kg) [2]. Ours are what makes a servo: its stiffness and
damping, its inertia, and a torque of at most 2.5 N m, about that at which small servos of this kind stall. Ours too: feet and
torso touch the floor, and nothing else touches anything. Legs hardly reach each other: feet of random gaits of full amplitude
are never less than 4.9 cm apart, and would touch at 5.

[1] A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.
[2] resibots/hexapod_common, hexapod_models/URDF/pexod.urdf.
"""

import math
from dataclasses import dataclass, fields
from typing import Any

from auroraqd._checks import number, shown, whole

LEGS = 6
SERVOS = 3  # of a leg, from the torso outwards
TIMESTEP = 0.0075  # s, of the physics: thrice as fine, speeds of random gaits correlate at 0.995 with these
SETTLED = 0.16  # m, about the height of a torso that stands

_TORSO, _TORSO_MASS = (0.12, 0.1, 0.02), 1.031  # half sides in m; kg
_COXA, _FEMUR, _TIBIA = 0.06, 0.085, 0.1275  # m
_MASSES = 0.02, 0.184, 0.184  # kg, of the three
_FOOT, _THICK = 0.025, 0.012  # m, radii
_HIPS = (
    (-0.14, 0.08, 0.3),
    (-0.01, 0.08, 0.0),
    (0.12, 0.08, -0.3),
    (0.12, -0.08, 0.3),
    (-0.01, -0.08, 0.0),
    (-0.14, -0.08, -0.3),
)
"""Of each leg: x, y in m, and how it is turned, rad. The first three are on the left, from the rear to the front."""

_GREY = 'rgba="0.3 0.32 0.37 1"'
_RANGES = math.pi / 8, math.pi / 4, math.pi / 4  # of the servos to both sides, rad: what controllers of [1] command at most
_STIFFNESS, _DAMPING, _INERTIA, _TORQUE = 25.0, 0.6, 0.01, 2.5  # N m / rad, N m s / rad, kg m^2, N m
_STOP = 50  # degrees: a leg without power does not fold further
_GRAVITY = 9.81  # m/s^2
_STEEPEST = 60  # degrees


@dataclass(frozen=True)
class Damage:
    """What is wrong with a hexapod, or with the floor that it walks on.

    Legs are numbered 0, 1, 2 on the left, from the rear to the front, and 3, 4, 5 on the right, from the front to the rear.
    Controllers know nothing of it: they command all servos as before.

    Args:
        gone: legs that are lost.
        short: legs that lost half of their last link.
        limp: legs without power.
        stuck: legs that stay in their middle position.
        torque: of all servos, and their stiffness, as a share of what they were.
        friction: of the floor, 1 as it was.
        slope: degrees, upwards; -5 is downhill.

    Raises:
        ValueError: there is no such leg, no leg is left that a controller moves, or a number is out of range.

    Examples:
        >>> import auroraqd
        >>> damage = auroraqd.tasks.Damage(gone=(1, 4))  # both in the middle
        >>> auroraqd.tasks.Hexapod(damage=damage).n_genes
        36
    """

    gone: tuple[int, ...] = ()
    short: tuple[int, ...] = ()
    limp: tuple[int, ...] = ()
    stuck: tuple[int, ...] = ()
    torque: float = 1.0
    friction: float = 1.0
    slope: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gone", "short", "limp", "stuck"):
            legs = getattr(self, name)
            if not isinstance(legs, list | tuple):
                raise ValueError(f"{name} must be legs, like (0,), got {shown(legs)}")
            legs = tuple(sorted({whole(f"a leg that is {name}", leg, least=0, most=LEGS - 1) for leg in legs}))
            object.__setattr__(self, name, legs)  # in one way, so that equal damages are equal
        number("torque of a damage", self.torque, least=0.01, most=1, wanted="a share, from 0.01 to 1")
        number("friction of a damage", self.friction, least=1e-3, most=10, wanted="from 0.001 to 10")
        number("slope of a damage", self.slope, least=-_STEEPEST, most=_STEEPEST, wanted="from -60 to 60")
        if len({*self.gone, *self.limp, *self.stuck}) == LEGS:
            raise ValueError(f"a damage must leave a leg that moves, and of {self} all are gone, limp or stuck")

    def __str__(self) -> str:
        """What differs from a robot that is whole, in short."""
        parts = [f"{f.name}={getattr(self, f.name)}" for f in fields(self) if getattr(self, f.name) != f.default]
        return ", ".join(parts) or "no damage"

    @property
    def legs(self) -> list[int]:
        """Those that are there."""
        return [leg for leg in range(LEGS) if leg not in self.gone]


def compiled(mujoco: Any, damage: Damage) -> Any:
    """The model of MuJoCo. Its sensors are how the torso, and then each leg that is there, presses on the floor, in N."""
    return mujoco.MjModel.from_xml_string(mjcf(damage))


def mjcf(damage: Damage) -> str:
    """The model as XML. A slope is a force of gravity that leans back: the floor stays where it is."""
    tilt = math.radians(damage.slope)
    legs = "".join(_leg(leg, damage) for leg in damage.legs)
    servos = "".join(_servo(leg, joint, damage) for leg in damage.legs for joint in range(SERVOS))
    touches = "".join(f'<touch site="foot_{leg}"/>' for leg in damage.legs)
    torso = " ".join(map(str, _TORSO))
    return f"""
    <mujoco model="hexapod">
      <option timestep="{TIMESTEP}" integrator="implicitfast"
              gravity="{-_GRAVITY * math.sin(tilt)} 0 {-_GRAVITY * math.cos(tilt)}"/>
      <statistic extent="0.5"/>
      <visual>
        <headlight ambient="0.45 0.45 0.45" diffuse="0.45 0.45 0.45" specular="0.1 0.1 0.1"/>
        <map znear="0.02"/>
      </visual>
      <default>
        <geom contype="0" conaffinity="0"/>
        <joint armature="{_INERTIA}" damping="{_DAMPING}"/>
        <site group="4"/>
      </default>
      <asset>
        <texture type="skybox" builtin="flat" rgb1="1 1 1" width="64" height="64"/>
        <texture name="checks" type="2d" builtin="checker" rgb1="0.2 0.3 0.4" rgb2="0.6 0.7 0.8" width="64" height="64"/>
        <material name="checks" texture="checks" texrepeat="2 2" texuniform="true"/>
      </asset>
      <worldbody>
        <light pos="0 0 3" dir="0.2 0.3 -1" directional="true" diffuse="0.5 0.5 0.5"/>
        <geom name="floor" type="plane" size="0 0 1" material="checks" conaffinity="1"
              friction="{damage.friction} 0.005 0.0001"/>
        <body name="torso" pos="0 0 {SETTLED}">
          <freejoint/>
          <geom type="box" size="{torso}" mass="{_TORSO_MASS}" contype="1" friction="0 0 0" rgba="0.15 0.35 0.65 1"/>
          <geom type="sphere" size="0.015" pos="0.1 0 0.02" mass="0" rgba="0.95 0.7 0.1 1"/>
          <site name="torso" type="box" size="{torso}"/>
          {legs}
        </body>
      </worldbody>
      <actuator>{servos}</actuator>
      <sensor><touch site="torso"/>{touches}</sensor>
    </mujoco>"""


def _leg(leg: int, damage: Damage) -> str:
    """Outwards along y, on the right against it; the last link hangs down."""
    x, y, turned = _HIPS[leg]
    out = math.copysign(1, y)
    tibia = _TIBIA / 2 if leg in damage.short else _TIBIA
    coxa_mass, femur_mass, tibia_mass = _MASSES
    tibia_mass *= tibia / _TIBIA

    def link(length: float, mass: float) -> str:
        return f'<geom type="capsule" size="{_THICK}" fromto="0 0 0 0 {out * length} 0" mass="{mass}" {_GREY}/>'

    return f"""
          <body pos="{x} {y} 0" euler="0 0 {math.degrees(turned)}">
            <joint name="hip_{leg}" axis="0 0 1" range="-90 90"/>
            {link(_COXA, coxa_mass)}
            <body pos="0 {out * _COXA} 0">
              <joint name="lift_{leg}" axis="{out} 0 0" range="-{_STOP} {_STOP}"/>
              {link(_FEMUR, femur_mass)}
              <body pos="0 {out * _FEMUR} 0">
                <joint name="knee_{leg}" axis="{out} 0 0" range="-{_STOP} {_STOP}"/>
                <geom type="capsule" size="{_THICK}" fromto="0 0 0 0 0 {-tibia}" mass="{tibia_mass}" {_GREY}/>
                <geom type="sphere" size="{_FOOT}" pos="0 0 {-tibia}" mass="0" contype="1" friction="0 0 0"
                      rgba="0.8 0.25 0.2 1"/>
                <site name="foot_{leg}" size="{1.2 * _FOOT}" pos="0 0 {-tibia}"/>
              </body>
            </body>
          </body>"""


def _servo(leg: int, joint: int, damage: Damage) -> str:
    share = 0.0 if leg in damage.limp else damage.torque
    name, reach = ("hip", "lift", "knee")[joint], _RANGES[joint]
    limit = max(share * _TORQUE, 1e-9)  # a range must not be empty
    return f"""
        <position name="{name}_{leg}" joint="{name}_{leg}" kp="{share * _STIFFNESS}" ctrlrange="{-reach} {reach}"
                  forcerange="{-limit} {limit}"/>"""
