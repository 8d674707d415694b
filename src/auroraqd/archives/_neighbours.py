"""Nearest neighbours among the descriptors of an archive, and sequential insertion: compiled kernels.

An unstructured archive asks the same two questions of every individual: which stored descriptors are nearest, and how far
are the k nearest on average (its novelty). The answers come from a k-d tree whose leaves are buckets: small blocks of
points, stored coordinate by coordinate so that the distances to a whole bucket are one vectorised loop.

Why a tree and not a grid of cells of side l: learned descriptors are uneven and have outliers, l changes at every update,
and three dimensions already need hundreds of cells a query. The tree has no scale of its own, serves any number of
dimensions, and stays exact.

Exactness. Distances are direct differences summed in the order of the dimensions, in float64. The distance to a node's
bounding box is computed with the same operations, each of them monotonic under rounding, so it never exceeds the computed
distance to a point in the box: pruning cannot change an answer, not even in the last bit. Equal distances are resolved by
the lowest row. Answers therefore do not depend on the shape of the tree.

Everything here takes and returns arrays; `Tree` is a tuple of arrays. Kernels are serial and release the interpreter lock.
They stay in one file: Numba's cache on disk notices a change of a kernel's own file only, not of those it calls into.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from auroraqd._compiled import compiled

BUCKET = 32  # points a leaf can hold
_SLACK = 1.06  # neighbours that moved away since a reach was measured; found by trying
_LANES = 16  # numbers that vectorised loops take at a time
_DEPTH_LIMIT = 4000  # a deeper tree is rebuilt at once: it is the size of the stacks below

# Positions in a line of Tree.node; the corners of the box follow from _BOX on.
_LINK, _AXIS, _SPLIT, _BOX = range(4)
# Positions in Tree.meta.
_NODES, _BUCKETS, _DEPTH, _BUILT_DEPTH, _CHANGES = range(5)

NOVELTY_MARGIN = 1e-9
"""A novelty counts as larger only by more than this share of the other: a copy of a stored individual, described in a batch
of another size, differs from it by rounding alone and must not pass for more novel."""


# Kernels allocate nothing, so they can do without Numba's reference counts (`_nrt`): counting the arrays of a tuple at each
# call, with atomic operations, took 30% of the time of an addition. They are inlined into those that Python calls, for a call
# hands over some hundred numbers that describe the arrays: a third of the time of a search.
_kernel = compiled(nogil=True, _nrt=False, forceinline=True)


class Tree(NamedTuple):
    """A k-d tree over rows of points, all distinct. Children are adjacent nodes; a leaf owns one bucket.

    Attributes:
        node: (nodes, 3 + 2 d) float64. A line for each node, so that a visit costs one miss of the cache: its link, axis and
            split (points with `x[axis] < split` are below the first child, the others below the second), then the lower and
            the upper corner of a box that holds every point below it.
        integer: (nodes, 3 + 2 d) int64, the same memory, to read link and axis. The link is the first of two children, or
            `-1 - bucket` for a leaf.
        filled: (buckets,) int32. Points in a bucket.
        rows: (buckets, BUCKET) int32. Their rows.
        points: (buckets, d, BUCKET) float64. Their coordinates, first `filled` of each line valid.
        meta: (5,) int64. Nodes and buckets in use, depth now and after the last build, insertions since.
    """

    node: np.ndarray
    integer: np.ndarray
    filled: np.ndarray
    rows: np.ndarray
    points: np.ndarray
    meta: np.ndarray


def _allocated(d, buckets):
    """Room for a tree of this many buckets."""
    node = np.empty((2 * buckets, _BOX + 2 * d))
    return Tree(
        node=node,
        integer=node.view(np.int64),
        filled=np.empty(buckets, np.int32),
        rows=np.empty((buckets, BUCKET), np.int32),
        points=np.zeros((buckets, d, BUCKET)),
        meta=np.zeros(5, np.int64),
    )


def empty(d):
    """A tree without points in d dimensions: one leaf."""
    tree = _allocated(d, 4)
    tree.integer[0, _LINK], tree.filled[0] = -1, 0
    tree.node[0, _BOX : _BOX + d], tree.node[0, _BOX + d :] = np.inf, -np.inf
    tree.meta[_NODES] = tree.meta[_BUCKETS] = 1
    return tree


def _grown(tree):
    """The same tree with room for half as many buckets again."""
    grown = _allocated(tree.points.shape[1], tree.filled.shape[0] * 3 // 2)
    for column, old in zip(grown, tree, strict=True):
        column[: len(old)] = old
    return grown


def build(points):
    """A tree over all rows of `points`, (n, d) float64, distinct.

    They are inserted in random order (the same every time), which leaves the tree balanced and its boxes tight.
    """
    tree = empty(points.shape[1])
    order = np.random.default_rng(0).permutation(len(points))
    done = 0
    while done < len(points):
        if done:
            tree = _grown(tree)
        done = _insert_rows(tree, points, order, done)
    tree.meta[_BUILT_DEPTH] = tree.meta[_DEPTH]
    tree.meta[_CHANGES] = 0
    return tree


@_kernel
def _insert_rows(tree, points, order, start):
    """Insert rows in this order until there is no free bucket; returns how many are in."""
    for i in range(start, order.shape[0]):
        if tree.meta[_BUCKETS] == tree.filled.shape[0]:
            return i
        _insert(tree, order[i], points[order[i]])
    return order.shape[0]


@njit(inline="always")
def _make_leaf(tree, node, bucket):
    """An empty leaf: its box is inside out."""
    tree.integer[node, _LINK] = -1 - bucket
    tree.filled[bucket] = 0
    d = tree.points.shape[1]
    for j in range(d):
        tree.node[node, _BOX + j] = np.inf
        tree.node[node, _BOX + d + j] = -np.inf


@njit(inline="always")
def _widen(tree, node, x):
    d = x.shape[0]
    for j in range(d):
        if x[j] < tree.node[node, _BOX + j]:
            tree.node[node, _BOX + j] = x[j]
        if x[j] > tree.node[node, _BOX + d + j]:
            tree.node[node, _BOX + d + j] = x[j]


@njit(inline="always")
def _put(tree, node, bucket, row, x):
    """Append a point to a leaf that has room."""
    slot = tree.filled[bucket]
    tree.rows[bucket, slot] = row
    for j in range(x.shape[0]):
        tree.points[bucket, j, slot] = x[j]
    tree.filled[bucket] = slot + 1
    _widen(tree, node, x)


@_kernel
def _split_leaf(tree, node):
    """Share the points of a full leaf between two new ones, in the middle of the axis along which they spread most.

    Boxes become tight again. The leaf's bucket becomes the first child's.
    """
    bucket = -1 - tree.integer[node, _LINK]
    other, first = tree.meta[_BUCKETS], tree.meta[_NODES]
    rows, points = tree.rows[bucket], tree.points[bucket]
    axis, split, widest = 0, 0.0, -1.0
    for j in range(points.shape[0]):
        low, high = points[j, 0], points[j, 0]
        for slot in range(1, BUCKET):
            low, high = min(low, points[j, slot]), max(high, points[j, slot])
        if high - low > widest:
            middle = 0.5 * low + 0.5 * high
            axis, widest = j, high - low
            split = middle if middle > low else high  # so that neither side is empty, whatever the rounding
    tree.meta[_BUCKETS] += 1
    tree.meta[_NODES] += 2
    _make_leaf(tree, first, bucket)
    _make_leaf(tree, first + 1, other)
    tree.integer[node, _LINK], tree.integer[node, _AXIS], tree.node[node, _SPLIT] = first, axis, split
    for slot in range(BUCKET):  # a point that stays moves to a slot that has been read already
        below = points[axis, slot] < split
        _put(tree, first if below else first + 1, bucket if below else other, rows[slot], points[:, slot])


@_kernel
def _insert(tree, row, x):
    """Insert a point that equals none of those stored; there must be a free bucket. Returns the bucket it went to."""
    node, depth = 0, 0
    while True:
        link = tree.integer[node, _LINK]
        if link >= 0:
            _widen(tree, node, x)
            node = link + (x[tree.integer[node, _AXIS]] >= tree.node[node, _SPLIT])
            depth += 1
        elif tree.filled[-1 - link] == BUCKET:
            _split_leaf(tree, node)
        else:
            _put(tree, node, -1 - link, row, x)
            break
    tree.meta[_DEPTH] = max(tree.meta[_DEPTH], depth)
    tree.meta[_CHANGES] += 1
    return -1 - link


@_kernel
def _remove(tree, row, x):
    """Remove the point of this row, stored at x. Boxes stay as they are: too wide is still right."""
    rows = tree.rows
    node = 0
    while tree.integer[node, _LINK] >= 0:
        node = tree.integer[node, _LINK] + (x[tree.integer[node, _AXIS]] >= tree.node[node, _SPLIT])
    bucket = -1 - tree.integer[node, _LINK]
    last = tree.filled[bucket] - 1
    slot = 0
    while rows[bucket, slot] != row:
        slot += 1
    rows[bucket, slot] = rows[bucket, last]
    for j in range(x.shape[0]):
        tree.points[bucket, j, slot] = tree.points[bucket, j, last]
    tree.filled[bucket] = last


@njit(inline="always")
def _box_distance(tree, node, x):
    """Squared distance to the box of a node; see the module docstring for why it may be compared without a margin."""
    total = 0.0
    d = x.shape[0]
    for j in range(d):
        outside = max(max(tree.node[node, _BOX + j] - x[j], x[j] - tree.node[node, _BOX + d + j]), 0.0)
        total += outside * outside
    return total


@njit(inline="always")
def _bucket_distances(points, bucket, x, out):
    """Squared distances to all slots of a bucket, the empty ones included: a loop without conditions vectorises.

    Its length must not be a constant, or the compiler unrolls the loop before it can vectorise it.
    """
    coordinates = points[bucket]
    slots = out.shape[0]
    value, line = x[0], coordinates[0]
    for slot in range(slots):
        difference = line[slot] - value
        out[slot] = difference * difference
    for j in range(1, x.shape[0]):
        value, line = x[j], coordinates[j]
        for slot in range(slots):
            difference = line[slot] - value
            out[slot] += difference * difference


@njit(inline="always")
def _bucket_distances_of_both(points, bucket, x, y, from_x, from_y):
    """As `_bucket_distances`, from two points at once."""
    coordinates = points[bucket]
    slots = from_x.shape[0]
    a, b, line = x[0], y[0], coordinates[0]
    for slot in range(slots):
        to_x, to_y = line[slot] - a, line[slot] - b
        from_x[slot] = to_x * to_x
        from_y[slot] = to_y * to_y
    for j in range(1, x.shape[0]):
        a, b, line = x[j], y[j], coordinates[j]
        for slot in range(slots):
            to_x, to_y = line[slot] - a, line[slot] - b
            from_x[slot] += to_x * to_x
            from_y[slot] += to_y * to_y


@njit(inline="always")
def _within(distances, n, bound, slots):
    """Which of the first n distances are at most `bound`, into slots; how many. There is no branch to mispredict."""
    hits = 0
    for slot in range(n):
        slots[hits] = slot
        hits += distances[slot] <= bound
    return hits


@njit(inline="always")
def _descend(tree, node, x, bound, stack, top):
    """From a node to the leaf on x's side, pushing the other children that may hold points within the bound.

    The distance to the splitting plane, one number, rules most of them out before the distance to their box.
    """
    link = tree.integer[node, _LINK]
    while link >= 0:
        beyond = x[tree.integer[node, _AXIS]] - tree.node[node, _SPLIT]
        near = link + (beyond >= 0)
        if beyond * beyond <= bound:
            far = link + (beyond < 0)
            distance = _box_distance(tree, far, x)
            if distance <= bound:
                stack.node[top] = far
                stack.distance[top] = distance
                top += 1
        node = near
        link = tree.integer[node, _LINK]
    return -1 - link, top


class _Stack(NamedTuple):
    node: np.ndarray
    distance: np.ndarray


class Scratch(NamedTuple):
    """Working memory of one caller, made by `scratch`."""

    stack: _Stack  # nodes still to visit, with the squared distance to their boxes
    distance: np.ndarray  # squared distances to the points of one bucket
    other: np.ndarray  # the same, from another point
    slots: np.ndarray  # those of them that matter
    nearest: np.ndarray  # smallest squared distances so far
    near: np.ndarray  # squared distances from an individual to the points near it,
    near_other: np.ndarray  # and from the stored one it competes with
    ranked: np.ndarray


def scratch(k):
    """Working memory for novelty over k neighbours."""
    near = 64
    return Scratch(
        stack=_Stack(np.empty(_DEPTH_LIMIT + 2, np.int64), np.empty(_DEPTH_LIMIT + 2)),
        distance=np.empty(BUCKET),
        other=np.empty(BUCKET),
        slots=np.empty(BUCKET, np.int64),
        nearest=np.empty(k + 1),
        near=np.empty(near),
        near_other=np.empty(near),
        ranked=np.empty(near),
    )


@_kernel
def _two_nearest(tree, x, bound, enough, scratch):
    """Row of the nearest point within a squared distance below `bound` (-1: none), and the two smallest squared distances.

    Of points equally near, the lowest row. Where there is no first or second, its distance is `bound`. Stops as soon as two
    points are found nearer than `enough`, squared, which may then not be the nearest.
    """
    filled, rows, points = tree.filled, tree.rows, tree.points
    stack, distances, slots = scratch.stack, scratch.distance, scratch.slots
    row, first, second = -1, bound, bound
    stack.node[0] = 0
    stack.distance[0] = 0.0
    top = 1
    while top > 0 and second >= enough:
        top -= 1
        if stack.distance[top] > second:
            continue
        bucket, top = _descend(tree, stack.node[top], x, second, stack, top)
        _bucket_distances(points, bucket, x, distances)
        for i in range(_within(distances, filled[bucket], second, slots)):
            slot = slots[i]
            distance = distances[slot]
            if distance < first or (distance == first and row >= 0 and rows[bucket, slot] < row):
                second = first
                first = distance
                row = rows[bucket, slot]
            elif distance < second:
                second = distance
    return row, first, second


@_kernel
def _novelty(tree, x, k, scratch):
    """Mean distance from x to the second to (k + 1)-th nearest points, and the last of these distances.

    The nearest is left out: it is x itself, or the one x competes with. With fewer than k others, the mean distance to those
    there are, and infinity. The mean of none is 0.
    """
    filled, points = tree.filled, tree.points
    stack, distances, nearest = scratch.stack, scratch.distance, scratch.nearest
    found, bound = 0, np.inf
    stack.node[0] = 0
    stack.distance[0] = 0.0
    top = 1
    while top > 0:
        top -= 1
        if stack.distance[top] > bound:
            continue
        bucket, top = _descend(tree, stack.node[top], x, bound, stack, top)
        _bucket_distances(points, bucket, x, distances)
        for slot in range(filled[bucket]):
            distance = distances[slot]
            if found == k + 1 and distance >= bound:
                continue
            place = min(found, k)
            found = min(found + 1, k + 1)
            while place > 0 and nearest[place - 1] > distance:
                nearest[place] = nearest[place - 1]
                place -= 1
            nearest[place] = distance
            if found == k + 1:
                bound = nearest[k]
    total = 0.0
    for i in range(1, found):
        total += np.sqrt(nearest[i])
    return total / max(found - 1, 1), np.sqrt(bound)


@_kernel
def _mean_without_smallest(squared, n, k, scratch):
    """Mean of the roots of the second to (k + 1)-th smallest of n values, added in ascending order, and the last root.

    Ranks instead of sorting: for some twenty values it takes less than half the time, without a branch to mispredict. Equal
    values share a rank, and the places after it are theirs too.
    """
    ranked = scratch.ranked
    whole = (n + _LANES - 1) // _LANES * _LANES
    for i in range(n, whole):
        squared[i] = np.inf
    for i in range(k + 1):
        ranked[i] = -1.0
    for i in range(n):
        value, smaller = squared[i], 0
        for j in range(whole):
            smaller += squared[j] < value
        ranked[smaller] = value
    total, value = 0.0, ranked[0]
    for i in range(1, k + 1):
        value = max(value, ranked[i])
        total += np.sqrt(value)
    return total / k, np.sqrt(value)


@_kernel
def _near_both(tree, x, y, distance, guess, k, scratch):
    """Squared distances, from x and from y, to the points near them into scratch; how many, and a radius.

    They are all the points in a ball around x that encloses the ball around y of that radius: `guess`, or less when more
    points than fit are in it. The ball then shrinks to the k nearest of y found so far. Stops, and says -1, if that fails.
    """
    filled, points = tree.filled, tree.points
    stack, from_x, from_y = scratch.stack, scratch.distance, scratch.other
    near_x, near_y = scratch.near, scratch.near_other
    radius = _enclosing(guess, distance)
    n = 0
    stack.node[0] = 0
    stack.distance[0] = 0.0
    top = 1
    while top > 0:
        top -= 1
        if stack.distance[top] > radius:
            continue
        if n + BUCKET > near_x.shape[0]:
            _, kth = _mean_without_smallest(near_y, n, k, scratch)
            guess = min(guess, kth)
            radius = _enclosing(guess, distance)
            found, n = n, 0
            for i in range(found):
                near_x[n], near_y[n] = near_x[i], near_y[i]
                n += near_x[i] <= radius
            if n + BUCKET > near_x.shape[0]:
                return -1, guess
        bucket, top = _descend(tree, stack.node[top], x, radius, stack, top)
        _bucket_distances_of_both(points, bucket, x, y, from_x, from_y)
        for slot in range(filled[bucket]):
            near_x[n] = from_x[slot]
            near_y[n] = from_y[slot]
            n += from_x[slot] <= radius
    return n, guess


@njit(inline="always")
def _enclosing(radius, distance):
    """Squared radius of a ball that encloses, whatever the rounding, one of this radius at this distance."""
    outer = (radius + distance) * (1 + 1e-9)
    return outer * outer


@_kernel
def _competing_novelties(tree, x, y, row, distance, size, reach, k, scratch):
    """Novelty of x and of the stored y at this row, `distance` away, both without y; and the reach of x.

    `reach[row]` remembers how far the k nearest of y were last time. If a ball a little larger still holds k points, then the
    ball around x that encloses it holds the k nearest of x, and one walk answers for both. It is a guess that costs only
    time when it fails. In more than three dimensions the enclosing ball is too large for it to pay.
    """
    wanted = min(k, size - 1)
    if reach[row] > 0 and x.shape[0] <= 3:
        n, radius = _near_both(tree, x, y, distance, reach[row] * _SLACK, wanted, scratch)
        if n > wanted:  # y is among them
            stored_novelty, stored_kth = _mean_without_smallest(scratch.near_other, n, wanted, scratch)
            if stored_kth <= radius:
                novelty, kth = _mean_without_smallest(scratch.near, n, wanted, scratch)
                reach[row] = stored_kth
                return novelty, kth, stored_novelty
    novelty, kth = _novelty(tree, x, k, scratch)
    stored_novelty, reach[row] = _novelty(tree, y, k, scratch)
    return novelty, kth, stored_novelty


@_kernel
def _reach_nearby(tree, bucket, reach):
    """A first guess at the reach of a new point: that of another in its bucket, 0 if none is known."""
    for slot in range(tree.filled[bucket]):
        known = reach[tree.rows[bucket, slot]]
        if 0 < known < np.inf:
            return known
    return 0.0


class Rule(NamedTuple):
    """Parameters of the addition rule: see `auroraqd.UnstructuredArchive`."""

    l: float
    k: int
    epsilon: float
    elitist: bool
    capacity: int


class Batch(NamedTuple):
    """Individuals to add.

    Attributes:
        descriptor: (n, d) float64.
        fitness: (n,) float64.
        status: (n,) int8, set: 0 rejected, 1 new, 2 replaced another. A row that holds -1 is skipped.
        target: (n,) int64, set: the row of the archive an individual was stored in, -1 when it was not.
    """

    descriptor: np.ndarray
    fitness: np.ndarray
    status: np.ndarray
    target: np.ndarray


class Stored(NamedTuple):
    """The columns of an archive that decide an addition, with room to grow.

    Attributes:
        descriptor: (capacity, d) float64.
        fitness: (capacity,) float64.
        reach: (capacity,) float64. See `_competing_novelties`; 0 where nothing is known.
    """

    descriptor: np.ndarray
    fitness: np.ndarray
    reach: np.ndarray


@_kernel
def replaces(fitness, novelty, stored_fitness, stored_novelty, epsilon, elitist):
    """Whether an individual replaces the stored one it competes with.

    Exclusive epsilon-dominance on (fitness, novelty) [1, Sec. "Container"], or, `elitist`, the higher fitness, and novelty
    between equals. Individuals of equal fitness compare novelty alone, whatever the value of that fitness: with a constant
    fitness of 0 the third condition would read 0 > 0, and nothing would ever be replaced.

    [1] A. Cully, Y. Demiris, Quality and Diversity Optimization: A Unifying Modular Framework, IEEE TEVC 2018.
    """
    if abs(novelty - stored_novelty) <= NOVELTY_MARGIN * stored_novelty:
        novelty = stored_novelty
    if fitness == stored_fitness:
        return novelty > stored_novelty
    if elitist:
        return fitness > stored_fitness
    if fitness < (1 - np.sign(stored_fitness) * epsilon) * stored_fitness:
        return False
    if novelty < (1 - epsilon) * stored_novelty:
        return False
    return (fitness - stored_fitness) * stored_novelty > -(novelty - stored_novelty) * abs(stored_fitness)


def room(d, rows):
    """Columns with this much room."""
    return Stored(np.empty((rows, d)), np.empty(rows), np.empty(rows))


def indexed(descriptor, fitness):
    """Tree and columns of individuals that are stored already: (n, d) and (n,)."""
    stored = room(descriptor.shape[1], len(fitness))
    stored.descriptor[:], stored.fitness[:], stored.reach[:] = descriptor, fitness, 0.0
    return build(stored.descriptor), stored


def more_room(stored, size, rows):
    """The same first `size` individuals, with room for `rows` more and for growth by half."""
    grown = room(stored.descriptor.shape[1], max(size + rows, size + size // 2))
    for column, old in zip(grown, stored, strict=True):
        column[:size] = old[:size]
    return grown


@_kernel
def _verdict(tree, x, fitness, stored, size, rule, scratch):
    """Status of one individual (0 rejected, 1 new, 2 replaces) and the row it goes to."""
    crowded = (1 - rule.epsilon) * rule.l
    row, first, second = _two_nearest(tree, x, rule.l * rule.l * (1 + 1e-12) + 1e-300, crowded * crowded * (1 - 1e-12), scratch)
    distance = np.sqrt(first)
    if row < 0 or distance > rule.l:
        return (1, size) if size < rule.capacity else (0, -1)
    stored_fitness = stored.fitness[row]
    if size == 1:  # no second neighbour, no novelty: only a better fitness could decide, and the paper's rule rejects
        return (2, row) if rule.elitist and fitness > stored_fitness else (0, -1)
    # A distance of 0 to two stored points happens only by underflow; rejecting keeps the stored points distinct.
    if second == 0 or np.sqrt(second) < crowded:
        return 0, -1
    # The novelties of two differ by their distance at most, and that of the stored one is no smaller than the distance to the
    # second, but for as much: of copies it need not be measured. Where squares may have left the range of numbers, it is.
    copy = 1e-280 < second < 1e280 and distance <= 0.5 * NOVELTY_MARGIN * np.sqrt(second)
    if copy and fitness == stored_fitness:
        return 0, -1
    novelty = kth = stored_novelty = 0.0
    if fitness == stored_fitness or not rule.elitist:
        novelty, kth, stored_novelty = _competing_novelties(
            tree, x, stored.descriptor[row], row, distance, size, stored.reach, rule.k, scratch
        )
    if replaces(fitness, novelty, stored_fitness, stored_novelty, rule.epsilon, rule.elitist):
        stored.reach[row] = kth
        return 2, row
    return 0, -1


@njit(inline="always")
def _wants_rebuild(meta, size):
    """Whether a build would pay: boxes are wide after many replacements, or the tree is deep after one-sided growth."""
    if meta[_CHANGES] > 2 * size + 1000 or meta[_DEPTH] >= _DEPTH_LIMIT:
        return True
    return meta[_DEPTH] > 2 * meta[_BUILT_DEPTH] + 16 and 16 * meta[_CHANGES] > size + 16000


@_kernel
def _add(tree, start, batch, stored, size, rule, scratch):
    """Add the individuals from `start` on, until the tree has no free bucket or wants a build.

    Returns the first individual not yet considered, and the number of individuals stored.
    """
    for i in range(start, batch.descriptor.shape[0]):
        if tree.meta[_BUCKETS] == tree.filled.shape[0] or _wants_rebuild(tree.meta, size):
            return i, size
        batch.target[i] = -1
        if batch.status[i] < 0:
            continue
        x = batch.descriptor[i]
        batch.status[i], row = _verdict(tree, x, batch.fitness[i], stored, size, rule, scratch)
        if row < 0:
            continue
        batch.target[i] = row
        if batch.status[i] == 2:
            _remove(tree, row, stored.descriptor[row])
        else:
            stored.reach[row] = 0.0  # not known yet
            size += 1
        for j in range(x.shape[0]):
            stored.descriptor[row, j] = x[j]
        stored.fitness[row] = batch.fitness[i]
        bucket = _insert(tree, row, x)
        if stored.reach[row] == 0:
            stored.reach[row] = _reach_nearby(tree, bucket, stored.reach)
    return batch.descriptor.shape[0], size


def add(tree, batch, stored, size, rule, scratch):
    """Add individuals one at a time, in order, each to an archive that holds the ones before it.

    Args:
        tree: over the first `size` rows of `stored`.
        batch: n individuals; their status and target are set.
        stored: room for `size + n` individuals; changed.
        size: individuals stored.
        rule: how they compete.
        scratch: working memory for `rule.k` neighbours, to be kept from call to call.

    Returns:
        The tree, and the number of individuals stored after.
    """
    done = 0
    while True:
        done, size = _add(tree, done, batch, stored, size, rule, scratch)
        if done == len(batch.descriptor):
            return tree, size
        if tree.meta[_BUCKETS] == tree.filled.shape[0]:
            tree = _grown(tree)
        else:
            tree = build(stored.descriptor[:size])


def novelties(tree, stored, k, rows):
    """Novelty of some of the points that are stored, and how far the k-th neighbour is, for each.

    Args:
        tree: over the rows of `stored`.
        stored: (n, d).
        k: neighbours.
        rows: (m,) int64, of whom.

    Returns:
        (m,) mean distances to the k nearest, oneself left out, and (m,) distances to the k-th, infinite where there are fewer.
    """
    novelty, reach = np.empty(len(rows)), np.empty(len(rows))
    _novelties(tree, stored, k, scratch(k), rows, novelty, reach)
    return novelty, reach


@_kernel
def _novelties(tree, stored, k, scratch, rows, novelty, reach):
    for i in range(rows.shape[0]):
        novelty[i], reach[i] = _novelty(tree, stored[rows[i]], k, scratch)
