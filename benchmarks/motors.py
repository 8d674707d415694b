"""What the motors of the arm are worth: random controllers of the air-hockey task in an engine, Box2D 3, with an arm of bodies.

    pip install "auroraqd[develop]"
    python benchmarks/motors.py               # some minutes a kind of arm and core
    python benchmarks/motors.py --quick       # to see it work: seconds; no conclusions can be drawn

In `auroraqd.tasks.AirHockey` the arm moves as its servos say, whatever it hits, itself included. In the code of the follow-up
[1] it is made of four links and a tip, driven by motors of at most 1 N m, and links that are not next to each other collide.
Here are both, in one engine, beside the task itself: in how many of 40 x 40 squares pucks end after as many controllers as
random search tries in 100, 200, ... generations of 128, how many controllers move the puck, and how far the arm ends from where
its servos would bring it.

[1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022; the published
coverage is read off its figure.
"""

import argparse
import multiprocessing
from contextlib import nullcontext
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pyb2d3

from auroraqd import metrics
from auroraqd._workers import cores
from auroraqd.tasks import AirHockey, air_hockey
from auroraqd.tasks.air_hockey import HALF_WIDTH, JOINTS, LINK, PHASE, PUCK, RATE, START, STEPS, TIP

BATCH = 128
PUBLISHED = {100: 0.651, 200: 0.789, 400: 0.862, 1000: 0.890}
STEP = 0.01  # s
TORQUE = 1.0  # N m
KINDS = {"motors, links collide": (TORQUE, True), "motors": (TORQUE, False), "motors of 1,000 N m": (1000.0, False)}
_ARM, _OTHERS = 2, 1  # categories of what collides


class Ending(NamedTuple):
    """Where a movement ended.

    Attributes:
        path: (50, 2), of the puck.
        short: radians, the largest distance of a joint from where its servo would have brought it.
    """

    path: np.ndarray
    short: float


def _shape(
    body: Any, shape: Any, density: float, restitution: float = 0.0, mask: int = _ARM | _OTHERS, category: int = _OTHERS
) -> Any:
    definition = pyb2d3.shape_def(density=density)
    definition.material.friction = 0.8
    definition.material.restitution = restitution
    definition.filter.category_bits = category
    definition.filter.mask_bits = mask
    body.create_shape(definition, shape)
    return body


def moved(genes: np.ndarray, torque: float, collide: bool) -> Ending:
    """Both movements of an arm of bodies, (8,) genes, the puck placed between them."""
    world = pyb2d3.World(gravity=(0, 0), restitution_threshold=0.0)
    room = world.create_static_body(position=(0, 0))
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        _shape(room, pyb2d3.box(0.01 if x else 1, 0.01 if y else 1, center=(x, y)), 0.0)
    of_arm = {"category": _ARM, "mask": _ARM | _OTHERS if collide else _OTHERS}
    base = _shape(world.create_static_body(position=(0, 0)), pyb2d3.box(0.0225, 0.0225), 0.0, **of_arm)
    last, joints = base, []
    for i in range(JOINTS):
        link = world.create_dynamic_body(position=((i + 0.5) * LINK, 0))
        link.enabled_sleep = False  # an arm that is slow is not at rest
        _shape(link, pyb2d3.box(LINK / 2, HALF_WIDTH), 1.5**-i, **of_arm)
        joints.append(_servo(world, last, link, (LINK / 2 if i else 0.0, 0.0), (-LINK / 2, 0.0), torque))
        last = link
    tip = _shape(world.create_dynamic_body(position=(JOINTS * LINK, 0)), pyb2d3.circle(radius=TIP), 0.1, **of_arm)
    _servo(world, last, tip, (LINK / 2, 0.0), (0.0, 0.0), torque)

    targets = (2 * genes - 1) * np.pi
    _drive(world, joints, targets[:JOINTS])
    puck = _shape(world.create_dynamic_body(position=START), pyb2d3.circle(radius=PUCK), 0.2, 0.8)
    path = _drive(world, joints, targets[JOINTS:], puck)
    start, change = air_hockey.movement(genes[None])
    meant = start[0] + change[0] * (1 - np.exp(-RATE * PHASE))
    return Ending(path, float(np.abs([joint.angle for joint in joints] - meant).max()))


def _servo(world: Any, a: Any, b: Any, at_a: tuple[float, float], at_b: tuple[float, float], torque: float) -> Any:
    limits = {"enable_limit": True, "lower_angle": -np.pi, "upper_angle": np.pi}
    return world.create_revolute_joint(
        body_a=a, body_b=b, local_anchor_a=at_a, local_anchor_b=at_b, enable_motor=True, max_motor_torque=torque, **limits
    )


def _drive(world: Any, joints: list[Any], targets: np.ndarray, puck: Any = None) -> np.ndarray:
    """A movement of 5 s; the puck every 0.1 s."""
    path = []
    for i in range(round(PHASE / STEP)):
        for joint, target in zip(joints, targets, strict=True):
            joint.motor_speed = RATE * (target - joint.angle)
        world.step(STEP, 4)
        if puck is not None and (i + 1) % round(PHASE / STEP / STEPS) == 0:
            path.append((puck.position[0], puck.position[1]))
    return np.array(path)


def row(name: str, ends: np.ndarray, moves: float, short: str, generations: list[int]) -> str:
    """A line of the table."""
    covered = [f"{metrics.coverage(ends[: g * BATCH], 40):.3f}" for g in generations]
    return f"| {name} | {' | '.join(covered)} | {moves:.1%} | {short} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generations", type=int, default=200, help="of 128 controllers, that are tried at most")
    parser.add_argument("--jobs", type=int, default=len(cores()), help="processes")
    parser.add_argument("--quick", action="store_true", help="one generation, in one process")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    most = 1 if args.quick else args.generations
    generations = [g for g in PUBLISHED if g <= most] or [most]
    genotypes = np.random.default_rng(args.seed).random((most * BATCH, 2 * JOINTS))
    print(f"| arm | {' | '.join(f'{g} generations' for g in generations)} | move the puck | short of its target, rad |")
    print(f"|---|{'---|' * len(generations)}---|---|")
    print(f"| published | {' | '.join(f'{PUBLISHED[g]:.3f}' if g in PUBLISHED else '' for g in generations)} | | |")
    ours = AirHockey()(genotypes).observation
    print(row("`AirHockey`", ours[:, -1], float((np.abs(ours - START).max(axis=(1, 2)) > 1e-3).mean()), "0", generations))
    pool = nullcontext() if args.quick else multiprocessing.get_context("spawn").Pool(args.jobs)
    with pool as workers:
        for name, (torque, collide) in KINDS.items():
            trial = partial(moved, torque=torque, collide=collide)
            found = list(map(trial, genotypes)) if workers is None else workers.map(trial, genotypes, chunksize=16)
            paths = np.array([one.path for one in found])
            short = np.quantile([one.short for one in found], [0.5, 0.9])
            moves = float((np.abs(paths - START).max(axis=(1, 2)) > 1e-3).mean())
            rests = f"{short[0]:.3f}, of one in ten more than {short[1]:.2f}"
            print(row(name, paths[:, -1], moves, rests, generations), flush=True)


if __name__ == "__main__":
    main()
