"""The air-hockey task (paper, Sec. "Second scenario"): a four-joint arm pushes a puck that bounces off four walls.

Constants are those of the code of the follow-up [1]; the ones of the paper were never published. The motors there dominate
the masses, so the arm moves as its servos say, whatever it hits: its angles are known in closed form.

The puck moves in straight lines between contacts, so time advances from contact to contact, not in small steps: from a
distance to the nearest link and a bound of the speed at which it can shrink follows how long nothing can happen. Nothing
is jumped over at any speed. In contact, steps are short enough for a link to move the puck by little. When two pucks meet that
fly in straight lines is known in closed form.

[1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022.
"""

import math
from dataclasses import dataclass

import numpy as np

from auroraqd import tasks
from auroraqd._checks import flag, number, numbers, whole
from auroraqd._compiled import compiled

STEPS = 50
"""Points of a trajectory, the first after 0.1 s."""

JOINTS = 4
LINK = 0.225  # m, length
HALF_WIDTH = 0.009  # m, of a link
TIP = 0.0135  # m, radius of the disc at the end
WALL = 0.99  # m, from the middle of the room to a wall
PUCK = 0.05  # m, radius
START = (0.55, 0.5)  # m, where the puck is placed
PLACES = (START, (0.35, 0.65), (0.7, 0.3))  # m, where more of them are: ours, within reach and near the first
NAMES = ("first", "second", "third")  # of their streams
RATE = 0.3  # 1/s, joint speed over the distance to the target
PHASE = 5.0  # s, of each of the two movements
_FRICTION = 0.8  # geometric mean of 0.8 and 0.8
_RESTITUTION = 0.8  # the larger of 0.8 and 0

_NEAR = 1e-6  # m, a gap at which an unmoved puck counts as touched
_STILL = 1e-12  # m/s, what is slower rests: a puck that rubs on another in a corner never has a speed of 0
_CREEP = 2e-3  # m, how far bodies that touch may move towards each other at once
_INTERVAL = PHASE / STEPS
_STEP = 0.01  # s, of the simulation whose steps `energy` is summed over
_LIMIT = WALL - PUCK  # of the middle of the puck
_BODIES = JOINTS + 1  # links, and the tip
_STATE = 6  # of a puck: x, y, their speeds, spin, and the gap to the arm


@dataclass(frozen=True)
class AirHockey:
    """Two movements of an arm in, the path of a puck out.

    Eight genes: four first and four final target angles, each (2 gene - 1) pi, relative to the link before. From joints at 0
    the arm moves 5 s towards the first targets; the puck is placed at rest at (0.55, 0.5); the arm moves 5 s towards the
    final targets. Called with genotypes, (n, 8) in [0, 1], it returns an `Evaluation`:

    - fitness (n,): 0, as in the paper, or minus the `energy` of the movements;
    - observation (n, 50, 2): x and y of the puck every 0.1 s, in metres, from the middle of a room of 1.98 x 1.98 m;
    - ground_truth (n, 2): the last of them.

    With more pucks, each is a stream of the observation, "first", "second", "third", and ground_truth is (n, 2 pucks), first
    the first.

    Args:
        restitution_threshold: m/s, an impact that is not faster does not bounce. 0: the puck always bounces, as in the paper
            and in the follow-up; 1: Box2D's own, with which most pucks stick to what they hit.
        pucks: 1, as in the paper, or 2 or 3, which hit each other too. The second is placed at (0.35, 0.65), the third at
            (0.7, 0.3).
        energy: whether fitness is minus the `energy` of the movements, as in the follow-up.

    Raises:
        ValueError: genotypes has the wrong shape, or leaves [0, 1]; an argument is out of range.

    Examples:
        >>> import auroraqd
        >>> path = auroraqd.tasks.AirHockey()([[0.5] * 8])  # an arm that does not move
        >>> path.observation[0, -1]
        array([0.55, 0.5 ])
    """

    restitution_threshold: float = 0.0
    pucks: int = 1
    energy: bool = False

    def __post_init__(self) -> None:
        number("restitution_threshold", self.restitution_threshold)
        whole("pucks", self.pucks, most=len(PLACES))
        flag("energy", self.energy)

    def __repr__(self) -> str:
        # As earlier versions have it, to whom runs without these are the same.
        more = f", pucks={self.pucks}" * (self.pucks > 1) + ", energy=True" * self.energy
        return f"{type(self).__name__}(restitution_threshold={self.restitution_threshold!r}{more})"

    @property
    def n_genes(self) -> int:
        """Genes of a controller."""
        return 2 * JOINTS

    def __call__(self, genotypes: np.ndarray) -> "tasks.Evaluation":
        """See the class."""
        genotypes = numbers("genotypes", genotypes, f" of shape (n, {self.n_genes})")
        if genotypes.ndim != 2 or genotypes.shape[1] != self.n_genes:
            raise ValueError(f"genotypes must have shape (n, {self.n_genes}), got {genotypes.shape}")
        if not ((genotypes >= 0) & (genotypes <= 1)).all():
            raise ValueError("genotypes must be in [0, 1]")
        start, change = movement(genotypes)
        paths = np.empty((self.pucks, len(genotypes), STEPS, 2))
        _push(start, change, float(self.restitution_threshold), paths)
        observation = paths[0] if self.pucks == 1 else dict(zip(NAMES, paths, strict=False))
        fitness = -energy(genotypes) if self.energy else np.zeros(len(genotypes))
        return tasks.Evaluation(fitness, observation, np.concatenate(paths[:, :, -1], axis=1))

    def bounds(self) -> np.ndarray:
        """(2, 50, 2): the lowest and the highest x and y, in metres, at every step: the middle of the puck in the room.

        Of more pucks (2, 50 pucks, 2), first the first.
        """
        return np.stack([np.full((self.pucks * STEPS, 2), -_LIMIT), np.full((self.pucks * STEPS, 2), _LIMIT)])


def movement(genotypes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The second movement, with the puck: joint angles where it begins, and from there to the final targets, (n, 4) each.

    At time t the angles are start + change (1 - exp(-0.3 t)).
    """
    targets = (2 * genotypes - 1) * np.pi
    start = (1 - math.exp(-RATE * PHASE)) * targets[:, :JOINTS]
    return start, targets[:, JOINTS:] - start


def energy(genotypes: np.ndarray) -> np.ndarray:
    """(n, 8) to (n,): the squared speeds of the joints in (rad/s)^2, summed over joints and the 1,000 steps of both movements.

    A joint's speed is 0.3 / s times its distance to the target, which falls to its exp(-0.003) in each step of 10 ms.
    """
    first = (2 * genotypes[:, :JOINTS] - 1) * np.pi
    _, second = movement(genotypes)
    steps = np.exp(-2 * RATE * np.arange(0, PHASE, _STEP)).sum()
    return RATE**2 * steps * ((first**2).sum(axis=1) + (second**2).sum(axis=1))


def joints(genotypes: np.ndarray, steps: int = STEPS) -> np.ndarray:
    """The base, the joints and the tip of the arm at each sample of the puck, (n, 8) to (n, steps, 5, 2), in metres."""
    start, change = movement(genotypes)
    share = 1 - np.exp(-RATE * PHASE * np.arange(1, steps + 1) / steps)
    angles = np.cumsum(start[:, None] + share[:, None] * change[:, None], axis=2)
    links = LINK * np.stack([np.cos(angles), np.sin(angles)], axis=3)
    return np.concatenate([np.zeros((len(genotypes), steps, 1, 2)), np.cumsum(links, axis=2)], axis=2)


@compiled(nogil=True, error_model="numpy")
def _push(start, change, threshold, paths):
    """Fill paths of the pucks, (pucks, n, STEPS, 2), for movements of the arm, (n, JOINTS) each."""
    arm = np.empty((_BODIES, 7))
    pucks = np.empty((paths.shape[0], _STATE))
    for i in range(start.shape[0]):
        _one(start[i], change[i], threshold, arm, pucks, paths[:, i])


@compiled(nogil=True, error_model="numpy")
def _one(start, change, threshold, arm, pucks, paths):
    """One movement, with all that happens: pucks in `pucks`, see `_STATE`, the arm in `arm`, see `_pose`."""
    pucks[:] = 0.0
    bound = _bound(change)
    _pose(start, change, 0.0, arm)
    for p in range(pucks.shape[0]):
        pucks[p, 0], pucks[p, 1] = PLACES[p]
        for _ in range(_BODIES):  # placed onto the arm: out of one link at a time
            gap = _contacts(arm, 0.0, threshold, pucks[p])
            if gap >= 0:
                break
        pucks[p, 2] = pucks[p, 3] = pucks[p, 4] = 0.0
    # Until one is touched, in shares of the movement: a share of it moves no point of the arm by more than `bound` times that.
    share = 0.0
    while bound > 0:
        _pose(start, change, share, arm)
        gap = _gap(arm, pucks[0, 0], pucks[0, 1])
        for p in range(1, pucks.shape[0]):
            gap = min(gap, _gap(arm, pucks[p, 0], pucks[p, 1]))
        if gap <= _NEAR:
            break
        share += gap / bound
        if share >= 1:
            break
    time = PHASE if share >= _share(PHASE) or bound == 0 else -math.log(1 - share) / RATE
    for k in range(STEPS):
        sample = (k + 1) * _INTERVAL
        while time < sample:
            time = _advance(start, change, bound, time, sample, threshold, arm, pucks)
        for p in range(pucks.shape[0]):
            paths[p, k, 0] = pucks[p, 0]
            paths[p, k, 1] = pucks[p, 1]


@compiled(nogil=True, error_model="numpy")
def _advance(start, change, bound, time, end, threshold, arm, pucks):
    """Contacts now, then a straight line for as long as there can be none; returns the new time."""
    share = _share(time)
    rate = RATE * (1 - share)
    _pose(start, change, share, arm)
    for p in range(pucks.shape[0]):
        pucks[p, 5] = _contacts(arm, rate, threshold, pucks[p])
    for p in range(1, pucks.shape[0]):
        for q in range(p):
            _collide(threshold, pucks[q], pucks[p])
    # A puck that is squeezed between another and a wall would be moved off the wall by rounding, again and again.
    near, least = (0.0, 1e-9) if pucks.shape[0] == 1 else (_NEAR, 1e-6)
    step = end - time
    for p in range(pucks.shape[0]):
        _walls(threshold, pucks[p], near)
        step = min(step, _free(bound * rate, pucks[p]))
    for p in range(1, pucks.shape[0]):
        for q in range(p):
            step = min(step, _meeting(pucks[q], pucks[p]))
    for p in range(pucks.shape[0]):
        pucks[p, 0] += step * pucks[p, 2]
        pucks[p, 1] += step * pucks[p, 3]
    return end if step >= end - time else time + max(step, least)


@compiled(nogil=True, error_model="numpy")
def _free(approach, puck):
    """For how long a puck can touch neither the arm, no point of which is faster than `approach`, nor a wall."""
    free, speed = np.inf, math.hypot(puck[2], puck[3]) + approach
    if speed > 0:
        free = max(puck[5], _CREEP) / speed
        for axis in range(2):
            if puck[2 + axis] > _STILL:
                free = min(free, (_LIMIT - puck[axis]) / puck[2 + axis])
            elif puck[2 + axis] < -_STILL:
                free = min(free, (-_LIMIT - puck[axis]) / puck[2 + axis])
    return free


@compiled(nogil=True, error_model="numpy")
def _meeting(a, b):
    """When two pucks that fly in straight lines touch; of two that touch, how long they may move towards each other at once."""
    x, y, u, v = b[0] - a[0], b[1] - a[1], b[2] - a[2], b[3] - a[3]
    distance, closing = math.hypot(x, y), -(x * u + y * v)
    if closing <= 0:
        return np.inf
    if distance - 2 * PUCK <= _NEAR:
        return _CREEP / math.hypot(u, v)
    beyond = distance * distance - 4 * PUCK * PUCK
    root = closing * closing - (u * u + v * v) * beyond
    return beyond / (closing + math.sqrt(root)) if root >= 0 else np.inf


@compiled(nogil=True, error_model="numpy")
def _share(time):
    """The share of the movement done after a time."""
    return 1 - math.exp(-RATE * time)


@compiled(nogil=True, error_model="numpy")
def _bound(change):
    """How far the whole movement can move any point of the arm: every joint turns all links after it."""
    total = turned = 0.0
    for joint in range(JOINTS):
        turned += change[joint]
        total += abs(turned) * (LINK + TIP)
    return total


@compiled(nogil=True, error_model="numpy")
def _pose(start, change, share, arm):
    """The arm when a share of its movement is done, a line for each link and for the tip.

    Where it begins, its direction, and how its beginning and its angle change with the share.
    """
    angle = x = y = dx = dy = turned = 0.0
    for link in range(JOINTS):
        angle += start[link] + change[link] * share
        turned += change[link]
        c, s = math.cos(angle), math.sin(angle)
        _set(arm[link], x, y, c, s, dx, dy, turned)
        x += LINK * c
        y += LINK * s
        dx -= LINK * s * turned
        dy += LINK * c * turned
    _set(arm[JOINTS], x, y, 1.0, 0.0, dx, dy, turned)


@compiled(nogil=True, error_model="numpy")
def _set(line, x, y, c, s, dx, dy, turned):
    line[0], line[1], line[2], line[3], line[4], line[5], line[6] = x, y, c, s, dx, dy, turned


@compiled(nogil=True, error_model="numpy")
def _separation(body, is_tip, px, py):
    """The gap between a body and the puck, negative where they overlap, and the normal from the body to the puck."""
    x, y = px - body[0], py - body[1]
    if is_tip:
        distance = math.hypot(x, y)
        if distance == 0:
            return -TIP - PUCK, 1.0, 0.0
        return distance - TIP - PUCK, x / distance, y / distance
    c, s = body[2], body[3]
    along, across = x * c + y * s, y * c - x * s  # in the frame of the link
    ax = along - min(max(along, 0.0), LINK)
    ay = across - min(max(across, -HALF_WIDTH), HALF_WIDTH)
    distance = math.hypot(ax, ay)
    if distance > 0:
        nx, ny = ax / distance, ay / distance
        gap = distance - PUCK
    else:  # the middle of the puck is in the link: out by the nearer side
        nx, ny = 0.0, 1.0 if across >= 0 else -1.0
        gap = abs(across) - HALF_WIDTH - PUCK
    return gap, nx * c - ny * s, nx * s + ny * c


@compiled(nogil=True, error_model="numpy")
def _gap(arm, x, y):
    """From the puck to the nearest part of the arm."""
    least = np.inf
    for body in range(_BODIES):
        least = min(least, _separation(arm[body], body == JOINTS, x, y)[0])
    return least


@compiled(nogil=True, error_model="numpy")
def _contacts(arm, rate, threshold, puck):
    """Move the puck out of what it overlaps, and let it bounce; returns the smallest gap there was.

    `rate` is how fast the share of the movement grows.
    """
    least = np.inf
    for body in range(_BODIES):
        gap, nx, ny = _separation(arm[body], body == JOINTS, puck[0], puck[1])
        least = min(least, gap)
        if gap <= _NEAR:
            puck[0] -= min(gap, 0.0) * nx
            puck[1] -= min(gap, 0.0) * ny
            # The point of contact moves with the body.
            x, y = puck[0] - PUCK * nx - arm[body, 0], puck[1] - PUCK * ny - arm[body, 1]
            u = rate * (arm[body, 4] - arm[body, 6] * y)
            v = rate * (arm[body, 5] + arm[body, 6] * x)
            bounce(puck, nx, ny, u, v, threshold)
    return least


@compiled(nogil=True, error_model="numpy")
def _collide(threshold, a, b):
    """Move two pucks out of each other, if they touch, and let them bounce."""
    x, y = b[0] - a[0], b[1] - a[1]
    distance = math.hypot(x, y)
    gap = distance - 2 * PUCK
    if gap > _NEAR:
        return
    nx, ny = (x / distance, y / distance) if distance > 0 else (1.0, 0.0)
    apart = min(gap, 0.0) / 2
    a[0] += apart * nx
    a[1] += apart * ny
    b[0] -= apart * nx
    b[1] -= apart * ny
    strike(a, b, nx, ny, threshold)


@compiled(nogil=True, error_model="numpy")
def _walls(threshold, puck, near):
    """Bounces off the walls, also off one that is nearer than `near`."""
    for axis in range(2):
        for side in (-1.0, 1.0):
            if puck[axis] * side >= _LIMIT - near:
                puck[axis] = side * _LIMIT
                bounce(puck, -side * (1 - axis), -side * axis, 0.0, 0.0, threshold)


@compiled(nogil=True, error_model="numpy")
def bounce(puck, nx, ny, u, v, threshold):
    """An impact of the puck on a body too heavy to be moved by it, with restitution and Coulomb friction.

    Args:
        puck: (5,) x, y, their speeds, spin; changed.
        nx, ny: normal, from the body to the puck.
        u, v: velocity of the body at the point of contact.
        threshold: m/s, an impact that is not faster does not bounce.
    """
    normal = (puck[2] - u) * nx + (puck[3] - v) * ny
    if normal >= 0:
        return
    push = -normal * (1 + (_RESTITUTION if -normal > threshold else 0.0))  # impulses for a mass of 1
    # Along the tangent (-ny, nx), where the spin of the puck adds to its speed; a disc's moment of inertia is r^2 / 2, so an
    # impulse changes the speed of the point of contact by three times itself.
    slip = (puck[3] - v) * nx - (puck[2] - u) * ny - puck[4] * PUCK
    grip = min(max(-slip / 3, -_FRICTION * push), _FRICTION * push)
    puck[2] += push * nx - grip * ny
    puck[3] += push * ny + grip * nx
    puck[4] -= 2 * grip / PUCK


@compiled(nogil=True, error_model="numpy")
def strike(a, b, nx, ny, threshold):
    """An impact of two pucks, as `bounce`: discs of one mass, of which each gets half of what a wall would give.

    Args:
        a, b: x, y, their speeds, spin of each; changed.
        nx, ny: normal, from the first to the second.
        threshold: m/s, an impact that is not faster does not bounce.
    """
    closing = (a[2] - b[2]) * nx + (a[3] - b[3]) * ny
    if closing <= 0:
        return
    push = closing * (1 + (_RESTITUTION if closing > threshold else 0.0)) / 2
    # An impulse along the tangent changes the slip of the two points of contact by three times itself each.
    slip = (a[3] - b[3]) * nx - (a[2] - b[2]) * ny + (a[4] + b[4]) * PUCK
    grip = min(max(-slip / 6, -_FRICTION * push), _FRICTION * push)
    a[2] -= push * nx + grip * ny
    a[3] -= push * ny - grip * nx
    a[4] += 2 * grip / PUCK
    b[2] += push * nx + grip * ny
    b[3] += push * ny - grip * nx
    b[4] += 2 * grip / PUCK
