"""The air-hockey task in an engine, Box2D 3, with a kinematic arm that follows the same law; and how far ours is from it."""

from typing import NamedTuple

import numpy as np
import pyb2d3

from auroraqd.tasks import AirHockey, air_hockey

START = np.array([0.55, 0.5])
SOON = 5  # samples: half a second


class Agreement(NamedTuple):
    """How many pucks move in both, and in either; of those that move in both, the distance in metres, half a second after the
    first contact and at the end."""

    both: int
    either: int
    soon: np.ndarray
    end: np.ndarray


def moved(observation):
    return np.abs(observation - START).max(axis=(1, 2)) > 1e-3


def pushing(moving, still, seed=0):
    """Random genotypes of which so many move the puck, and so many do not."""
    genotypes = np.random.default_rng(seed).random((20 * (moving + still), 8))
    moves = moved(AirHockey()(genotypes).observation)
    return np.concatenate([genotypes[moves][:moving], genotypes[~moves][:still]])


def compare(genotypes, threshold):
    """Run genotypes here and there."""
    ours = AirHockey(restitution_threshold=threshold)(genotypes).observation
    theirs = np.array([engine(*movement, threshold) for movement in zip(*air_hockey.movement(genotypes), strict=True)])
    one, other = moved(ours), moved(theirs)
    both = one & other
    first = (np.abs(ours[both] - START).max(axis=2) > 1e-3).argmax(axis=1)
    apart = np.linalg.norm(ours[both] - theirs[both], axis=2)
    soon = apart[np.arange(len(apart)), np.minimum(first + SOON, air_hockey.STEPS - 1)]
    return Agreement(int(both.sum()), int((one | other).sum()), soon, apart[:, -1])


def engine(start, change, threshold, step=0.01, pucks=1):
    """The same movement of the arm, kinematic, in Box2D 3: the puck every 0.1 s; of several, (50, pucks, 2)."""
    world = pyb2d3.World(gravity=(0, 0), restitution_threshold=threshold)

    def add(body, shape, restitution=0.0):
        definition = pyb2d3.shape_def(density=0.2)
        definition.material.friction = 0.8
        definition.material.restitution = restitution
        body.create_shape(definition, shape)
        return body

    room = world.create_static_body(position=(0, 0))
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        add(room, pyb2d3.box(0.01 if x else 1, 0.01 if y else 1, center=(x, y)))
    half = air_hockey.LINK / 2
    box = pyb2d3.box(half, air_hockey.HALF_WIDTH, center=(half, 0))
    arm = [add(world.create_kinematic_body(position=(0, 0)), box) for _ in range(4)]
    arm.append(add(world.create_kinematic_body(position=(0, 0)), pyb2d3.circle(radius=air_hockey.TIP)))
    disc = pyb2d3.circle(radius=air_hockey.PUCK)
    discs = [add(world.create_dynamic_body(position=place), disc, 0.8) for place in air_hockey.PLACES[:pucks]]

    times = step * np.arange(round(5 / step) + 1)
    angles = np.cumsum(start + change * (1 - np.exp(-0.3 * times))[:, None], axis=1)
    ends = np.cumsum(air_hockey.LINK * np.stack([np.cos(angles), np.sin(angles)], axis=2), axis=1)
    angles, places = np.pad(angles, [(0, 0), (0, 1)]), np.pad(ends, [(0, 0), (1, 0), (0, 0)])
    movement = [values.tolist() for values in (angles, places, np.diff(angles, axis=0) / step, np.diff(places, axis=0) / step)]

    path = []
    for angle, place, spin, velocity in zip(*movement, strict=False):  # the last pose is where the last step ends
        for i, body in enumerate(arm):
            body.set_transform(tuple(place[i]), pyb2d3.make_rot(angle[i]))
            body.linear_velocity = tuple(velocity[i])
            body.angular_velocity = spin[i]
        world.step(step, 4)
        path.append([(puck.position[0], puck.position[1]) for puck in discs])
    return np.array(path)[9::10] if pucks > 1 else np.array(path)[9::10, 0]
