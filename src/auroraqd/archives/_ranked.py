"""The nearest of those that are as fit, by brute force: compiled kernels.

A tree does not help where only some of the points count, and they are others for each. Distances to blocks of points are
vectorised; squares are added in the order of the dimensions, so a distance is the same from either end, and whenever it is
measured. Neighbours equally near come in the order of their rows.
"""

import numpy as np
from numba import njit

from auroraqd._compiled import compiled

_BLOCK = 64


def nearest(points: np.ndarray, fitness: np.ndarray, which: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """The k nearest among those as fit or fitter, itself excepted.

    Args:
        points: (n, d) float64.
        fitness: (n,); a constant one lets all count.
        which: (m,) rows of those that ask.
        k: neighbours.

    Returns:
        (m, k) squared distances, ascending, and (m, k) int64 rows; infinity and -1 where there are fewer.
    """
    squared, rows = np.full((len(which), k), np.inf), np.full((len(which), k), -1)
    _nearest(_columns(points), np.array(fitness), which, squared, rows)
    return squared, rows


def mean_distance(squared: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(m,) means of the distances that `nearest` found, over as many as there are; infinite of none."""
    means = np.empty(len(squared))
    _mean_distance(squared, rows, means)
    return means


def disturb(points: np.ndarray, fitness: np.ndarray, reach: np.ndarray, by: np.ndarray, by_fitness: np.ndarray) -> None:
    """Set the reach of all to -1 among whose nearest one of these others belongs, as it comes or goes.

    Args:
        points: (n, d) float64.
        fitness: (n,).
        reach: (n,) squared distances to the k-th nearest, infinite where there are fewer, negative where not known; changed.
        by: (m, d), the others.
        by_fitness: (m,), theirs.
    """
    _disturb(_columns(points), np.array(fitness), reach, by, by_fitness)


def _columns(points: np.ndarray) -> np.ndarray:
    """(d, n) copy of (n, d): arrays that can only be read are another type to the compiler."""
    return np.array(points.T, order="C")


@compiled(nogil=True)
def _nearest(columns, fitness, which, squared, rows):
    """See `nearest`; columns: (d, n)."""
    n, k = columns.shape[1], squared.shape[1]
    distance, slots = np.empty(_BLOCK), np.empty(_BLOCK, np.int64)
    for i in range(which.shape[0]):
        own, least = which[i], fitness[which[i]]
        x, near, who = columns[:, own].copy(), squared[i], rows[i]
        found, bound = 0, np.inf
        for start in range(0, n, _BLOCK):
            size = min(_BLOCK, n - start)
            _distances(columns, start, x, distance[:size])
            for hit in range(_within(distance, bound, fitness[start : start + size], least, slots)):
                row, value = start + slots[hit], distance[slots[hit]]
                if row == own or (found == k and value >= bound):
                    continue
                place = min(found, k - 1)
                found = min(found + 1, k)
                while place > 0 and near[place - 1] > value:
                    near[place], who[place] = near[place - 1], who[place - 1]
                    place -= 1
                near[place], who[place] = value, row
                if found == k:
                    bound = near[k - 1]


@compiled(nogil=True)
def _mean_distance(squared, rows, means):
    """See `mean_distance`."""
    for i in range(squared.shape[0]):
        total, count = 0.0, 0
        for j in range(squared.shape[1]):
            if rows[i, j] >= 0:
                total += np.sqrt(squared[i, j])
                count += 1
        means[i] = total / count if count > 0 else np.inf


@compiled(nogil=True)
def _disturb(columns, fitness, reach, by, by_fitness):
    """See `disturb`; columns: (d, n)."""
    n = columns.shape[1]
    distance = np.empty(_BLOCK)
    for start in range(0, n, _BLOCK):
        end = min(start + _BLOCK, n)
        fit, far = fitness[start:end], reach[start:end]
        for i in range(by.shape[0]):
            _distances(columns, start, by[i], distance[: end - start])
            theirs = by_fitness[i]
            for j in range(far.shape[0]):
                near = (theirs >= fit[j]) & (distance[j] <= far[j])
                far[j] = -1.0 if near else far[j]


@njit(inline="always")
def _distances(columns, start, x, out):
    """Squared distances from x, (d,), to as many points, (d, n) columns, from `start` on. The loops vectorise."""
    size = out.shape[0]
    value, line = x[0], columns[0, start : start + size]
    for j in range(size):
        difference = line[j] - value
        out[j] = difference * difference
    for c in range(1, columns.shape[0]):
        value, line = x[c], columns[c, start : start + size]
        for j in range(size):
            difference = line[j] - value
            out[j] += difference * difference


@njit(inline="always")
def _within(distance, bound, fitness, least, slots):
    """Which of those as fit are no farther than the bound, into slots; how many. There is no branch to mispredict."""
    hits = 0
    for j in range(fitness.shape[0]):
        slots[hits] = j
        hits += (distance[j] <= bound) & (fitness[j] >= least)
    return hits
