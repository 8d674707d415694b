"""The nearest of many fixed points, exactly: what a CVT archive asks of every descriptor.

Behaviours lie close to a space of few dimensions. Let V be orthonormal directions that descriptors x, seen so far, nearly lie
in, and r(x) what is left of x. Then, by the inequality of Cauchy and Schwarz, for each point c

    |c|^2 - 2 x.c >= |c|^2 - 2 (V x).(V c) - 2 |r(x)| |r(c)|

and the right side, a product of some 20 numbers instead of 100, leaves few points to look at. Directions are added, at least
as many as there are, when descriptors come that do not lie in them; with all d of them, which noise needs, the bound is the
distance itself, and the screening the matrix product of all with all.

The screening is in single precision with a margin for its rounding. What it leaves is decided by direct differences in double
precision, so that answers, ties included, are those of looking at every point.
"""

import numpy as np

from auroraqd._compiled import compiled

_BLOCK = 1024  # points a matrix product
_GROUP = 64  # points whose smallest bound is kept; divides _BLOCK
_ROWS = 1024  # descriptors at a time
_FAR = 1e4  # times as far from the middle as any point
_LEAST = 14  # directions
_REST = 0.1  # of the length of descriptors, that may be outside of the directions
_REMEMBERED = 8192  # descriptors
_TIED = 64  # points that may be equally near but for rounding, before all are looked at
_NOWHERE = 1e30  # a square that no point has, of rows that fill the last group

_kernel = compiled(nogil=True, _nrt=False)


class Nearest:
    """The index of the point nearest to each of some others; of several the first.

    It remembers the last descriptors that it was asked for, for offspring are often copies.

    Args:
        points: (n, d) float64, finite and distinct.
    """

    def __init__(self, points: np.ndarray) -> None:
        self._points = points
        # Scores are of points moved near the origin and scaled down, so that single precision neither runs out of range nor
        # loses more than it must.
        self._middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
        self._unit = float(np.abs(points - self._middle).max()) or 1.0
        self._reach = float(np.sqrt((((points - self._middle) / self._unit) ** 2).sum(axis=1).max()))
        self._known: dict[bytes, int] = {}
        self._directions = np.empty((points.shape[1], 0))
        self._screen = np.empty((0, 0), np.float32)

    @property
    def directions(self) -> int:
        """How many directions there are by now."""
        return self._directions.shape[1]

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(n, d) finite float64 to (n,) int64."""
        parts = [self._of(x[start : start + _ROWS]) for start in range(0, len(x), _ROWS)]
        return np.concatenate(parts) if parts else np.empty(0, np.int64)

    def _of(self, x: np.ndarray) -> np.ndarray:
        if len(self._known) + len(x) > _REMEMBERED:
            self._known.clear()
        keys = [row.tobytes() for row in x]
        new = {key: i for i, key in enumerate(keys) if key not in self._known}
        if new:
            self._known.update(zip(new, self._found(x[list(new.values())]).tolist(), strict=True))
        return np.array([self._known[key] for key in keys])

    def _found(self, x: np.ndarray) -> np.ndarray:
        n, d = x.shape
        with np.errstate(over="ignore"):  # what is infinite is far
            near = (x - self._middle) / self._unit
        length = np.abs(near).max(axis=1) * np.sqrt(d)  # at most: for the bounds below
        far = length > _FAR  # bounds say too little: all points are looked at
        near[far], length[far] = 0, 0
        along, rest = self._split(near)
        asked = np.column_stack([-2 * along, np.ones(n), -2 * rest]).astype(np.float32)
        # Rounding of the inputs and of a sum of products [Higham, Accuracy and Stability, Sec. 3.1], on both sides.
        slack = 2 * (asked.shape[1] + 4) * np.finfo(np.float32).eps * (self._reach**2 + 2 * self._reach * length)
        # By a power of two, which changes no digit, so that squares neither overflow nor vanish.
        size = np.maximum(np.abs(x / 2 - self._middle / 2).max(axis=1), self._unit / 2)
        scale = np.exp2(-np.clip(np.frexp(size)[1], -1000, 1000).astype(float))
        tied, count = np.empty((n, _TIED), np.int64), np.empty(n, np.int64)
        # A score is a squared distance in units, less |x|^2.
        with np.errstate(over="ignore"):  # of what is far
            toward = (scale * self._unit) ** -2.0, slack - (near**2).sum(axis=1)
        _refine(self._points, x, scale, self._screen, asked, self._lowest(asked), *toward, tied, count)
        count[far] = _TIED + 1
        nearest = tied[:, 0]
        for i in np.flatnonzero(count > 1):
            rows = np.sort(tied[i, : count[i]]) if count[i] <= _TIED else np.arange(len(self._points))
            nearest[i] = rows[self._distances(rows, x[i], scale[i]).argmin()]
        return nearest

    def _distances(self, rows: np.ndarray, x: np.ndarray, scale: float) -> np.ndarray:
        """Squared, scaled, from one descriptor to some points."""
        parts = [rows[start : start + _BLOCK] for start in range(0, len(rows), _BLOCK)]
        return np.concatenate([((self._points[part] * scale - x * scale) ** 2).sum(axis=1) for part in parts])

    def _lowest(self, asked: np.ndarray) -> np.ndarray:
        """The lowest bound in each group of points, (n, groups)."""
        lowest = np.full((len(self._screen) // _GROUP, len(asked)), np.inf, np.float32)
        columns = np.ascontiguousarray(asked.T)
        for start in range(0, len(self._screen), _BLOCK):
            bounds = self._screen[start : start + _BLOCK] @ columns
            _smallest(bounds, lowest[start // _GROUP : (start + len(bounds)) // _GROUP])
        return np.ascontiguousarray(lowest.T)

    def _split(self, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Along the directions, (n, k), and the length of the rest, (n,), after more were added if need be."""
        along, rest = _parts(near, self._directions)
        allowed = _REST * np.sqrt((near**2).mean(axis=0).sum())
        have, d = self._directions.shape[1], len(self._directions)
        if not self._screen.size or (have < d and np.sqrt((rest**2).mean()) > allowed):
            outside = near - along @ self._directions.T
            _, lengths, more = np.linalg.svd(outside)
            left = np.sqrt(np.append(np.cumsum(lengths[::-1] ** 2)[::-1], 0) / len(near))  # with the first few of them
            needed = int((left > allowed / 2).argmin()) if left[-1] <= allowed / 2 else len(left)
            wanted = max(have + needed, 2 * have, _LEAST)
            basis = np.linalg.qr(np.column_stack([self._directions, more.T]))[0]
            self._directions = basis[:, : wanted if 2 * wanted < d else d]
            self._screen = self._screened()
            along, rest = _parts(near, self._directions)
        return along, rest

    def _screened(self) -> np.ndarray:
        """What bounds are made of, (points, k + 2): the points along the directions, their squares, the lengths of the rest."""
        screen = np.zeros((len(self._points) + -len(self._points) % _GROUP, self._directions.shape[1] + 2), np.float32)
        screen[len(self._points) :, -2] = _NOWHERE
        for start in range(0, len(self._points), _BLOCK):
            near = (self._points[start : start + _BLOCK] - self._middle) / self._unit
            along, rest = _parts(near, self._directions)
            screen[start : start + len(near)] = np.column_stack([along, (near**2).sum(axis=1), rest])
        return screen


def _parts(near: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    along = near @ directions
    rest = near - along @ directions.T
    return along, np.sqrt((rest**2).sum(axis=1))


@_kernel
def _smallest(values, lowest):
    """The smallest of each group of rows, or what is there, if that is smaller."""
    for row in range(values.shape[0]):
        for i in range(values.shape[1]):
            if values[row, i] < lowest[row // _GROUP, i]:
                lowest[row // _GROUP, i] = values[row, i]


@_kernel
def _refine(points, x, scale, screen, asked, lowest, per, above, tied, count):
    """The nearest points, but for rounding, of each descriptor, and how many there are; more than fit: not all of them.

    Args:
        points, x: (m, d) and (n, d).
        scale: (n,). Distances are of points that are scaled by it.
        screen, asked: (m, padded, k) and (n, k), whose products are bounds.
        lowest: (n, groups), the lowest of them.
        per, above: (n,). A distance times `per` plus `above` compares with bounds.
        tied, count: (n, _TIED) and (n,), set.
    """
    near = 1 + 8 * (points.shape[1] + 4) * 2.0**-53  # what two orders of summation may differ by
    for i in range(x.shape[0]):
        first = 0
        for group in range(lowest.shape[1]):
            if lowest[i, group] < lowest[i, first]:
                first = group
        best, bound, found = np.inf, np.inf, 0
        for turn in range(-1, lowest.shape[1]):  # the most promising group before all others
            group = first if turn < 0 else turn
            if lowest[i, group] > bound or turn == first:
                continue
            for c in range(group * _GROUP, min((group + 1) * _GROUP, points.shape[0])):
                low = np.float32(0)
                for j in range(asked.shape[1]):
                    low += asked[i, j] * screen[c, j]
                if low > bound:
                    continue
                distance, limit = 0.0, best * near
                for j in range(points.shape[1]):
                    difference = points[c, j] * scale[i] - x[i, j] * scale[i]
                    distance += difference * difference
                if distance > limit:
                    continue
                if distance * near < best:
                    found = 0
                if distance < best:
                    best, bound = distance, distance * per[i] + above[i]
                if found < _TIED:
                    tied[i, found] = c
                found += 1
        count[i] = found
