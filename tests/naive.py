"""Plain-Python twins of the compiled kernels: slow, short, written from the rules and not from the kernels."""

import itertools
import math
from itertools import pairwise

import numpy as np


def squared_distance(a, b):
    """Euclidean, summed in the order of the dimensions."""
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += (float(y) - float(x)) * (float(y) - float(x))
    return total


def distance(a, b):
    return math.sqrt(squared_distance(a, b))


def novelty(points, x, excluded, k):
    """Mean distance to the k nearest, one index left out."""
    distances = sorted(distance(p, x) for i, p in enumerate(points) if i != excluded)[:k]
    total = 0.0
    for value in distances:
        total += value
    return total / len(distances) if distances else 0.0


def mean_without_smallest(squared, k):
    """Mean of the roots of all but the smallest of the k + 1 smallest, and the last of them."""
    roots = [math.sqrt(value) for value in sorted(squared)[1 : k + 1]]
    total = 0.0
    for root in roots:
        total += root
    return total / k, roots[-1]


def sign(value):
    return int(value > 0) - int(value < 0)


def replaces(f, n, f_nn, n_nn, epsilon, elitist):
    """Whether (f, n) takes the place of (f_nn, n_nn)."""
    if abs(n - n_nn) <= 1e-9 * n_nn:
        n = n_nn
    if f == f_nn:
        return n > n_nn
    if elitist:
        return f > f_nn
    return (
        f >= (1 - sign(f_nn) * epsilon) * f_nn
        and n >= (1 - sign(n_nn) * epsilon) * n_nn
        and (f - f_nn) * abs(n_nn) > -(n - n_nn) * abs(f_nn)
    )


class UnstructuredArchive:
    """The addition rule, one individual at a time, by brute force."""

    def __init__(self, l, k=15, epsilon=0.1, competition="dominance", capacity=None):
        self.l, self.k, self.epsilon, self.elitist, self.capacity = l, k, epsilon, competition == "elitist", capacity
        self.descriptor, self.fitness, self.id = [], [], []
        self.next_id = 0

    def add_one(self, descriptor, fitness):
        if not all(map(math.isfinite, [*descriptor, fitness])):
            return -1
        order = sorted((squared_distance(p, descriptor), i) for i, p in enumerate(self.descriptor))
        if not order or math.sqrt(order[0][0]) > self.l:
            if self.capacity is not None and len(order) >= self.capacity:
                return 0
            self.descriptor.append(list(descriptor))
            self.fitness.append(fitness)
            self.id.append(self.next_id)
            self.next_id += 1
            return 1
        nearest = order[0][1]
        if len(order) == 1:
            better = self.elitist and fitness > self.fitness[nearest]
        elif order[1][0] == 0 or math.sqrt(order[1][0]) < (1 - self.epsilon) * self.l:
            better = False
        else:
            better = replaces(
                fitness,
                novelty(self.descriptor, descriptor, nearest, self.k),
                self.fitness[nearest],
                novelty(self.descriptor, self.descriptor[nearest], nearest, self.k),
                self.epsilon,
                self.elitist,
            )
        if not better:
            return 0
        self.descriptor[nearest], self.fitness[nearest], self.id[nearest] = list(descriptor), fitness, self.next_id
        self.next_id += 1
        return 2

    def add(self, descriptors, fitness):
        return [self.add_one(d, f) for d, f in zip(descriptors, fitness, strict=True)]

    def redescribe(self, descriptors, l=None):
        self.l = self.l if l is None else l
        old = sorted(zip(self.id, descriptors, self.fitness, strict=True), key=lambda individual: individual[0])
        next_id = self.next_id
        self.descriptor, self.fitness, self.id = [], [], []
        for age, descriptor, fitness in old:
            self.next_id = age
            self.add_one(descriptor, fitness)
        self.next_id = next_id


def throw(along, up, steps=50):
    """A ballistic trajectory: mass 1 kg, steps of 1 s."""
    position, velocity = [0.0, 0.0], [0.0, 0.0]
    acceleration = [along, up - 9.81]
    points = [tuple(position)]
    for _ in range(steps - 1):
        velocity = [v + a for v, a in zip(velocity, acceleration, strict=True)]
        position = [p + v for p, v in zip(position, velocity, strict=True)]
        acceleration = [0.0, -9.81]
        if position[1] <= 0:
            position[1] = 0.0
            acceleration[1] = -0.6 * velocity[1]
            velocity[1] = 0.0
        points.append(tuple(position))
    return points


def top(along, up):
    """Where a throw from half a step's way comes to rest: v / g later, v^2 / 2 g higher. In metres."""
    speed = up - 9.81
    return along * (speed / 9.81 + 0.5), speed / 2 + speed**2 / (2 * 9.81)


def largest_distance(points):
    return max(distance(a, b) for a in points for b in points)


def separations(points, n):
    """Distances at which points are taken, always the one farthest from all before, beginning far from the mean."""
    mean = [sum(column) / len(points) for column in zip(*points, strict=True)]
    chosen = [max(range(len(points)), key=lambda i: squared_distance(points[i], mean))]
    apart = []
    while len(chosen) < min(n, len(points)):
        nearest = [min(squared_distance(point, points[j]) for j in chosen) for point in points]
        chosen.append(max(range(len(points)), key=lambda i: nearest[i]))
        apart.append(max(nearest) ** 0.5)
    return apart


def controlled(l, stored, target):
    """l after a generation of container size control."""
    return l * (1 - 5e-6 * (target - stored))


def far_outside(observations):
    """Which of (n, entries, channels) lie far outside the others, by sorting."""
    n, channels = len(observations), range(len(observations[0][0]))
    far = [False] * n
    for c in channels:
        ends = [(min(row[c] for row in rows), max(row[c] for row in rows)) for rows in observations]
        middles = sorted((low + high) / 2 for low, high in ends)
        middle = (middles[(n - 1) // 2] + middles[n // 2]) / 2
        distances = [max(high - middle, middle - low) for low, high in ends]
        typical = sorted(distances)[int(0.99 * (n - 1))]
        for i, distance in enumerate(distances):
            far[i] = far[i] or (n >= 20 and typical > 0 and distance > 10 * typical)
    return far


def energy(genes, step=0.01):
    """Of an arm whose joints turn at 0.3 / s times their distance to the target, for 5 s to each of two targets."""
    total = 0.0
    for first, second in zip(genes[:4], genes[4:], strict=True):
        angle = 0.0
        for target in ((2 * first - 1) * math.pi, (2 * second - 1) * math.pi):
            for _ in range(round(5 / step)):
                speed = 0.3 * (target - angle)
                total += speed**2
                angle += step * speed
    return total


def histograms(reference, compared, bins):
    """The share of each that is in the cells of the box of the reference, which are not empty."""
    lows = [min(p[j] for p in reference) for j in range(len(reference[0]))]
    highs = [max(p[j] for p in reference) for j in range(len(reference[0]))]

    def histogram(points):
        counts = {}
        for p in points:
            if any(not low <= v <= high for v, low, high in zip(p, lows, highs, strict=True)):
                continue
            cell = tuple(
                min(int((v - low) / (high - low) * bins), bins - 1) for v, low, high in zip(p, lows, highs, strict=True)
            )
            counts[cell] = counts.get(cell, 0) + 1
        return {cell: count / sum(counts.values()) for cell, count in counts.items()}

    return histogram(reference), histogram(compared)


def reached(reference, compared, bins):
    """The share of the cells of the one that the other is in."""
    e, a = histograms(reference, compared, bins)
    return sum(cell in a for cell in e) / len(e)


def klc(reference, compared, bins=30):
    """D_KL(reference || compared), joint histogram over the box of the reference."""
    e, a = histograms(reference, compared, bins)
    return sum(p * math.log(p / a.get(cell, 1e-8)) for cell, p in e.items())


def roulette(scores, spins):
    """Rows on a wheel whose slots are as wide as the shifted scores; None when there is no width."""
    low = min(0.0, *scores)
    total = sum(score - low for score in scores)
    if total == 0:
        return None
    rows = []
    for spin in spins:
        end = 0.0
        row = -1
        while end <= spin * total and row + 1 < len(scores):
            row += 1
            end += scores[row] - low
        rows.append(row)
    return rows


def in_proportion(weights, spins):
    """Rows on a wheel whose slots are as wide as the weights; those that are not finite have no width."""
    weights = [w if math.isfinite(w) else 0.0 for w in weights]
    ends, total = [], 0.0
    for weight in weights:
        total += weight / max(weights)
        ends.append(total)
    return [next(row for row, end in enumerate(ends) if end > spin * total) for spin in spins]


def credit(curiosity, stored_ids, ids, status):
    """Curiosity after children of these parents were given a status."""
    result = list(curiosity)
    for parent, value in zip(ids, status, strict=True):
        for row, stored in enumerate(stored_ids):
            if stored == parent:
                result[row] += 1.0 if value > 0 else -0.5
    return result


def settled(rows, fitness, occupants, stored_fitness, next_id):
    """Individuals take their rows, one after the other; the occupants and their fitness, lists by row, change.

    Returns who stays, the ids of those that went, the rows, -1 of those that do not stay, and how much fitter each is than the
    one whose place it took.
    """
    mine, gone, gain = {}, [], [math.nan] * len(rows)
    for i, row in enumerate(rows):
        if row < 0:
            continue
        if row < len(occupants):
            gone.append(occupants[row])
            gain[i] = fitness[i] - stored_fitness[row]
            occupants[row], stored_fitness[row] = next_id, fitness[i]
        else:
            occupants.append(next_id)
            stored_fitness.append(fitness[i])
        mine[next_id] = i
        next_id += 1
    staying = [i for id, i in mine.items() if id not in gone]
    return staying, gone, [row if i in staying else -1 for i, row in enumerate(rows)], gain


def fill(mutated, spins):
    """A gene for each row that has none."""
    return [
        row if any(row) else [gene == int(spin * len(row)) for gene in range(len(row))]
        for row, spin in zip(mutated, spins, strict=True)
    ]


def step(genes, mutated, spins, exponent):
    """One step for each gene that mutates, kept in [0, 1]."""
    left = iter(spins)

    def moved(gene):
        r = next(left)
        delta = (2 * r) ** exponent - 1 if r < 0.5 else 1 - (2 * (1 - r)) ** exponent
        return min(max(gene + delta, 0.0), 1.0)

    return [
        [moved(gene) if changes else gene for gene, changes in zip(*row, strict=True)]
        for row in zip(genes, mutated, strict=True)
    ]


def affine(observations, center, factor, limit, weight, offset, back, back_offset):
    """Descriptors of scaled observations, and root mean square errors of their reconstructions, row by row."""
    descriptors, errors = [], []
    for observation in observations:
        row = [(value - c) * f for value, c, f in zip(observation, center, factor, strict=True)]
        row = [max(-most, min(most, value)) for value, most in zip(row, limit, strict=True)]
        z = [b + sum(value * w for value, w in zip(row, line, strict=True)) for line, b in zip(weight, offset, strict=True)]
        expected = [b + sum(c * line[j] for c, line in zip(z, back, strict=True)) for j, b in enumerate(back_offset)]
        descriptors.append(z)
        errors.append(math.sqrt(sum((a - e) ** 2 for a, e in zip(row, expected, strict=True)) / len(row)))
    return descriptors, errors


def nearest_centroid(centroids, x):
    """The first of the nearest."""
    distances = [squared_distance(c, x) for c in centroids]
    return distances.index(min(distances))


def grid_cell(shape, low, high, x):
    """Row-major number of the cell of a grid; outside belongs to the border."""
    number = 0
    for cells, a, b, value in zip(shape, low, high, x, strict=True):
        inside = min(max(float(value), a), b)
        number = number * cells + min(int((inside - a) / (b - a) * cells), cells - 1)
    return number


def map_elites(cells, fitness):
    """Statuses, and the individual that each row ends up with."""
    status, rows, who = [], {}, []
    for i, (cell, f) in enumerate(zip(cells, fitness, strict=True)):
        if cell not in rows:
            rows[cell] = len(who)
            who.append(i)
            status.append(1)
        elif f > fitness[who[rows[cell]]]:
            who[rows[cell]] = i
            status.append(2)
        else:
            status.append(0)
    return status, who


def distortion(x, z):
    """Stress of the distances: z's, scaled as fits best, against x's."""
    pairs = [(i, j) for i in range(len(x)) for j in range(len(x)) if i != j]
    wanted = [distance(x[i], x[j]) for i, j in pairs]
    given = [distance(z[i], z[j]) for i, j in pairs]
    s = sum(w * g for w, g in zip(wanted, given, strict=True)) / sum(g * g for g in given)
    return sum((s * g - w) ** 2 for w, g in zip(wanted, given, strict=True)) / sum(w * w for w in wanted)


def convolution(image, kernel, bias):
    """One map of (steps, channels) to one, zeros outside, as TensorFlow's "same": more of them after than before."""
    steps, channels = len(image), len(image[0])
    before = [(len(kernel) - 1) // 2, (len(kernel[0]) - 1) // 2]
    out = []
    for t in range(steps):
        row = []
        for c in range(channels):
            total = bias
            for i, line in enumerate(kernel):
                for j, weight in enumerate(line):
                    u, v = t + i - before[0], c + j - before[1]
                    if 0 <= u < steps and 0 <= v < channels:
                        total += weight * image[u][v]
            row.append(total)
        out.append(row)
    return out


def max_pooling(image):
    """The largest of 2 x 2 from each place on, as far as there are."""
    steps, channels = len(image), len(image[0])
    return [
        [max(image[u][v] for u in range(t, min(t + 2, steps)) for v in range(c, min(c + 2, channels))) for c in range(channels)]
        for t in range(steps)
    ]


def arm(angles, length=0.225):
    """Joints of an arm with relative angles, and its links as pairs of end points."""
    x = y = total = 0.0
    joints = [(x, y)]
    for angle in angles:
        total += angle
        x, y = x + length * math.cos(total), y + length * math.sin(total)
        joints.append((x, y))
    return joints, list(pairwise(joints))


def gaps(links, place, half_width=0.009, radius=0.05):
    """From flat-ended links to a puck; a puck whose middle is inside counts as deep inside."""
    found = []
    for (ax, ay), (bx, by) in links:
        length = math.dist((ax, ay), (bx, by))
        ux, uy = (bx - ax) / length, (by - ay) / length
        along = (place[0] - ax) * ux + (place[1] - ay) * uy
        across = (place[1] - ay) * ux - (place[0] - ax) * uy
        beyond = max(-along, along - length, 0.0), max(abs(across) - half_width, 0.0)
        found.append(math.hypot(*beyond) - radius if any(beyond) else -math.inf)
    return found


def bounce(vx, vy, spin, normal, body, threshold, radius=0.05, restitution=0.8, friction=0.8):
    """Impact of a disc of mass 1 on an immovable body, from the momentum at the point of contact."""
    contact = (-radius * normal[0], -radius * normal[1])
    point = (vx - spin * contact[1] - body[0], vy + spin * contact[0] - body[1])
    tangent = (-normal[1], normal[0])
    approach = point[0] * normal[0] + point[1] * normal[1]
    slip = point[0] * tangent[0] + point[1] * tangent[1]
    if approach >= 0:
        return vx, vy, spin
    push = -approach * (1 + (restitution if -approach > threshold else 0))
    inertia = radius * radius / 2
    grip = -slip / (1 + radius * radius / inertia)
    grip = max(-friction * push, min(friction * push, grip))
    impulse = (push * normal[0] + grip * tangent[0], push * normal[1] + grip * tangent[1])
    torque = contact[0] * impulse[1] - contact[1] * impulse[0]
    return vx + impulse[0], vy + impulse[1], spin + torque / inertia


def strike(a, b, normal, threshold, radius=0.05, restitution=0.8, friction=0.8):
    """Two discs of mass 1, (vx, vy, spin) each, `normal` from the first to the second: impulses from a system of equations."""
    n, inertia = np.array(normal), radius**2 / 2
    t = np.array([-n[1], n[0]])
    jacobian = np.array(  # normal and tangential speed of the first point of contact past the second, of all six speeds
        [[*n, 0, *-n, 0], [*t, radius, *-t, radius]]
    )
    weights = np.diag([1, 1, 1 / inertia, 1, 1, 1 / inertia])
    speeds = np.array([*a, *b], float)
    closing, slip = jacobian @ speeds
    if closing <= 0:
        return speeds
    mass = jacobian @ weights @ jacobian.T  # how speeds of the contact answer to impulses
    push = -closing * (1 + (restitution if closing > threshold else 0)) / mass[0, 0]
    grip = np.clip(-slip / mass[1, 1], friction * push, -friction * push)
    return speeds + weights @ jacobian.T @ np.array([push, grip])


def pucks_alone(pucks, seconds, limit=0.94, radius=0.05, step=1e-4):
    """Pucks, (x, y, vx, vy, spin) each, in a room without an arm, in small steps: where they are."""
    pucks = [list(map(float, puck)) for puck in pucks]
    for _ in range(round(seconds / step)):
        for a, b in itertools.combinations(pucks, 2):
            x, y = b[0] - a[0], b[1] - a[1]
            distance = math.hypot(x, y)
            if distance <= 2 * radius:
                speeds = strike(a[2:], b[2:], (x / distance, y / distance), 0.0)
                a[2:], b[2:] = speeds[:3].tolist(), speeds[3:].tolist()
        for puck in pucks:
            for axis in range(2):
                for side in (-1, 1):
                    if puck[axis] * side >= limit:
                        normal = (-side, 0) if axis == 0 else (0, -side)
                        puck[2:] = bounce(*puck[2:], normal, (0.0, 0.0), 0.0)
            puck[0] += step * puck[2]
            puck[1] += step * puck[3]
    return pucks


def diversity(trajectories, bins, low=-1.0, high=1.0):
    """The share of squares passed by the trajectories that end in a square, summed over the squares."""

    def square(point):
        return tuple(min(max(math.floor((v - low) / (high - low) * bins), 0), bins - 1) for v in point)

    passed = {}
    for trajectory in trajectories:
        passed.setdefault(square(trajectory[-1]), set()).update(square(point) for point in trajectory)
    return sum(len(squares) for squares in passed.values()) / bins**2


def cell(point, bins, low, high):
    """The cell of a grid that a point is in, a place in each dimension; outside, the nearest."""
    place = []
    for x, n, a, b in zip(point, bins, low, high, strict=True):
        share = (min(max(x, a), b) - a) / (b - a)
        place.append(min(int(share * n), n - 1))
    return tuple(place)


def coverage(points, bins, low, high):
    return len({cell(p, bins, low, high) for p in points}) / math.prod(bins)


def effective_cells(points, bins, low, high):
    where = [cell(p, bins, low, high) for p in points]
    shares = [where.count(c) / len(where) for c in set(where)]
    return math.prod(share**-share for share in shares) if shares else 0.0


def qd_score(points, fitness, bins, low, high, offset):
    best = {}
    for point, f in zip(points, fitness, strict=True):
        where = cell(point, bins, low, high)
        best[where] = max(f, best.get(where, f))
    return sum(f - offset for f in best.values())


def soft_qd_score(points, fitness, sigma, h, margin=7):
    """In one or two dimensions, by the midpoint rule with steps of h sigma."""
    step = h * sigma
    axes = []
    for coordinates in zip(*points, strict=True):
        start, end = min(coordinates) - margin * sigma, max(coordinates) + margin * sigma
        axes.append([start + (i + 0.5) * step for i in range(int((end - start) / step) + 1)])
    total = 0.0
    for b in [(x,) for x in axes[0]] if len(axes) == 1 else [(x, y) for x in axes[0] for y in axes[1]]:
        total += max(f * math.exp(-squared_distance(p, b) / (2 * sigma * sigma)) for p, f in zip(points, fitness, strict=True))
    return total * step ** len(axes)


def dominated_novelty(descriptors, fitness, k):
    """Mean distance to the k nearest that are as fit, itself left out; infinite where there are none."""
    scores = []
    for i, (x, f) in enumerate(zip(descriptors, fitness, strict=True)):
        fitter = (p for j, (p, g) in enumerate(zip(descriptors, fitness, strict=True)) if j != i and g >= f)
        near = sorted(distance(p, x) for p in fitter)[:k]
        total = 0.0
        for value in near:
            total += value
        scores.append(total / len(near) if near else math.inf)
    return scores


class DominatedArchive:
    """Old and new together, the highest scores stay; of equal ones, who is older."""

    def __init__(self, capacity, k):
        self.capacity, self.k, self.stored, self.next_id = capacity, k, [], 0

    def add(self, descriptors, fitness):
        everyone = self.stored + [[None, list(d), f] for d, f in zip(descriptors, fitness, strict=True)]
        scores = dominated_novelty([d for _, d, _ in everyone], [f for _, _, f in everyone], self.k)
        best = sorted(range(len(everyone)), key=lambda i: (-scores[i], i))[: self.capacity]
        status = [int(i in best) for i in range(len(self.stored), len(everyone))]
        self.stored = [everyone[i] for i in sorted(best)]
        for individual in self.stored:
            if individual[0] is None:
                individual[0] = self.next_id
                self.next_id += 1
        return status


def fronts(points):
    """Of points with objectives to maximise: how often all that no other beats must be taken away until it is its turn."""

    def beats(a, b):
        return all(x >= y for x, y in zip(a, b, strict=True)) and a != b

    front, left, number = [None] * len(points), set(range(len(points))), 0
    while left:
        best = {i for i in left if not any(beats(points[j], points[i]) for j in left)}
        for i in best:
            front[i] = number
        left, number = left - best, number + 1
    return front


def crowding(points):
    """Gaps between the neighbours of each, summed over objectives, in shares of the range; infinite at both ends."""
    apart = [0.0] * len(points)
    for c in range(len(points[0])):
        order = sorted(range(len(points)), key=lambda i: points[i][c])
        span = points[order[-1]][c] - points[order[0]][c]
        for place, i in enumerate(order):
            if place in (0, len(order) - 1):
                apart[i] = math.inf
            elif span:
                apart[i] += (points[order[place + 1]][c] - points[order[place - 1]][c]) / span
    return apart


def gated(given, state, inputs, states, bias, bias_n):
    """States of gated recurrent units, one for each of the vectors that they are given, in turn.

    Weights, (3 units, features) and (3 units, units), are those of the reset, of the update and of what is new.
    """
    n, found = len(state), []

    def product(weights, vector, row):
        return sum(w * v for w, v in zip(weights[row], vector, strict=True))

    def logistic(value):
        return 1 / (1 + math.exp(-value))

    for vector in given:
        following = []
        for i in range(n):
            a, b, c = i, n + i, 2 * n + i
            reset = logistic(product(inputs, vector, a) + bias[a] + product(states, state, a))
            update = logistic(product(inputs, vector, b) + bias[b] + product(states, state, b))
            new = math.tanh(product(inputs, vector, c) + bias[c] + reset * (product(states, state, c) + bias_n[i]))
            following.append(new + update * (state[i] - new))
        state = following
        found.append(state)
    return found


def strided(image, weight, stride):
    """A strided convolution of an image, (h, w, channels), with a kernel of 2 x 2 blocks of the stride: lists in and out."""
    height, width, channels = len(image), len(image[0]), len(image[0][0])
    rows, columns, maps, before = -(-height // stride), -(-width // stride), len(weight[0]), stride // 2
    found = [[[0.0] * maps for _ in range(columns)] for _ in range(rows)]
    for i in range(rows):
        for j in range(columns):
            entry = 0
            for block in range(4):
                for a in range(stride):
                    for b in range(stride):
                        y = (i + block // 2) * stride + a - before
                        x = (j + block % 2) * stride + b - before
                        for c in range(channels):
                            if 0 <= y < height and 0 <= x < width:
                                for m in range(maps):
                                    found[i][j][m] += image[y][x][c] * weight[entry][m]
                            entry += 1
    return found


def picture(size, shapes):
    """Lines with round ends, each ((row, column), (row, column), radius, value), pixel by pixel."""

    def apart(point, start, end):
        length = math.dist(start, end)
        if length == 0:
            return math.dist(point, start)
        along = sum((p - a) * (b - a) for p, a, b in zip(point, start, end, strict=True)) / length
        if along <= 0:
            return math.dist(point, start)
        if along >= length:
            return math.dist(point, end)
        return math.sqrt(max(math.dist(point, start) ** 2 - along**2, 0))

    def brightness(point):
        covered = [(min(max(radius + 0.5 - apart(point, a, b), 0), 1), value) for a, b, radius, value in shapes]
        return max((int(share * value + 0.5) for share, value in covered), default=0)

    return [[brightness((i + 0.5, j + 0.5)) for j in range(size)] for i in range(size)]


def maze(weights, walls, steps, x=60.0, y=450.0, heading=math.pi / 4):
    """The places of the robot, step by step, and its effort."""

    def sight(angle):
        """By halves, of the line from the robot on, whether it crosses any wall."""
        direction = math.cos(angle), math.sin(angle)
        found = [100.0]
        for ax, ay, bx, by in walls:
            sides = [(px - x) * direction[1] - (py - y) * direction[0] for px, py in ((ax, ay), (bx, by))]
            if (sides[0] > 0) != (sides[1] > 0):
                share = sides[0] / (sides[0] - sides[1])
                px, py = ax + share * (bx - ax), ay + share * (by - ay)
                along = (px - x) * direction[0] + (py - y) * direction[1]
                if along >= 0:
                    found.append(along)
        return min(found)

    def nearest(px, py):
        points = []
        for ax, ay, bx, by in walls:
            share = ((px - ax) * (bx - ax) + (py - ay) * (by - ay)) / math.dist((ax, ay), (bx, by)) ** 2
            share = min(max(share, 0), 1)
            points.append((ax + share * (bx - ax), ay + share * (by - ay)))
        return min(points, key=lambda point: math.dist(point, (px, py)))

    first, biases = [weights[5 * i : 5 * i + 5] for i in range(5)], weights[25:30]
    last, ends = [weights[30 + 2 * i : 32 + 2 * i] for i in range(5)], weights[40:42]
    left = right = effort = 0.0
    places = []
    for _ in range(steps):
        senses = [*(sight(heading + turn) / 100 for turn in (-math.pi / 4, 0, math.pi / 4)), left, right]
        hidden = [math.tanh(biases[j] + sum(s * w[j] for s, w in zip(senses, first, strict=True))) for j in range(5)]
        wheels = [math.tanh(ends[j] + sum(h * w[j] for h, w in zip(hidden, last, strict=True))) for j in range(2)]
        effort += sum(wheel**2 for wheel in wheels)
        heading += 5 * (wheels[1] - wheels[0]) / 20
        forward = 5 * sum(wheels) / 2
        to = x + forward * math.cos(heading), y + forward * math.sin(heading)
        touched = nearest(*to)
        left = right = 0.0
        if math.dist(touched, to) > 10:
            x, y = to
        else:
            dx, dy = touched[0] - to[0], touched[1] - to[1]
            if dx * math.cos(heading) + dy * math.sin(heading) > 0:
                side = dy * math.cos(heading) - dx * math.sin(heading)
                left, right = float(side >= 0), float(side <= 0)
        places.append((x, y))
    return places, effort


def superiority(one, other):
    """How often a value of the one is larger than one of the other, ties counted half."""
    return sum((a > b) + (a == b) / 2 for a in one for b in other) / (len(one) * len(other))


def superiority_interval(a, n, m, z=1.959963984540054, steps=20_000):
    """The probabilities that an estimate does not lie significantly away from, the smallest and the largest, by trying."""
    inside = []
    for i in range(steps + 1):
        p = i / steps
        others = (n + m) / 2 - 1
        variance = p * (1 - p) * (1 + others * (1 - p) / (2 - p) + others * p / (1 + p)) / (n * m)
        if (p - a) ** 2 <= z * z * variance:
            inside.append(p)
    return min([a, *inside]), max([a, *inside])


def holm(pvalues):
    """The smallest level at which a step-down procedure rejects each."""
    n, corrected = len(pvalues), []
    for p in pvalues:
        up_to = sorted(q for q in pvalues if q <= p)
        corrected.append(min(1.0, max((n - i) * q for i, q in enumerate(up_to))))
    return corrected


def square_wave(amplitude, phase, duty, time, period=1.0):
    """The wave of the hexapod's controller at a time, sample by sample."""
    up = int(100 * duty)
    wave = [1.0 if i < up else -1.0 for i in range(100)]
    weights = {d: math.exp(-d * d / 18) for d in range(-10, 11)}
    at = (int(100 * time / period + 1e-9) + int(100 * phase)) % 100
    return amplitude * sum(weight * wave[(at + d) % 100] for d, weight in weights.items()) / sum(weights.values())
