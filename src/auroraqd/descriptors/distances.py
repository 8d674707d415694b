"""Distances between observations that say how different behaviours are, also where entries do not.

Two images of a small disc differ by the same number of pixels wherever the discs are, as soon as they do not overlap; two
gaits of different frequency are out of step soon, whatever the difference. Three things help.

- **Several scales.** Blurred until they overlap, the discs differ the more the farther they are apart. Weighed so that each
  scale counts the same, distances of an image blurred at several scales come close to how far things have moved [1].
- **Rhythms.** How strongly a joint swings at which frequency changes smoothly with the gait, if frequencies are read as broadly
  as octaves [4, 5]; when it swings does not.
- **Shortest paths.** Distances between close observations are right, and far ones are sums of these, along a graph of the
  nearest neighbours [2]. Coordinates in which straight distances are these paths are found from some of the rows, the
  landmarks [3].

[1] S. Shirdhonkar, D. W. Jacobs, Approximate earth mover's distance in linear time, CVPR 2008 (there with wavelets).
[2] J. B. Tenenbaum, V. de Silva, J. C. Langford, A global geometric framework for nonlinear dimensionality reduction (Isomap),
    Science 290, 2000.
[3] V. de Silva, J. B. Tenenbaum, Global versus local methods in nonlinear dimensionality reduction (C-Isomap and landmark
    Isomap), NIPS 2002.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from auroraqd.descriptors.scaling import Scaling

_SCALES = (16, 8, 4)  # points a side at which blurred images are read; the blur is as wide as the gap between them
_PART = 256  # rows at a time
_NEIGHBOURS = 8
_MOST_NEIGHBOURS = 32  # of a graph in one piece; pieces that are left are joined
_LANDMARKS = 500
_AXES = 24  # of the coordinates, at most
_SLOW = 4  # points at which blurred sequences are read
_OCTAVE = 0.5  # between the frequencies at which spectra are read, and the width there
_MOST_CHANNELS = 64  # whose pairs are looked at
_TOGETHER = 0.7  # weight of pairs
_STILL = 1e-6  # deviation of a channel that does not move, on the [-1, 1] scale
_NOTHING = 1e-6  # eigenvalue, as a share of the largest, that is none


def flat(observation: np.ndarray, scaling: Scaling) -> np.ndarray:
    """Observations, (n, ...), scaled and flattened, (n, features) float32."""
    n, features = len(observation), observation[0].size if len(observation) else 0
    rows, scaler = np.empty((n, features), np.float32), scaling.scaler(features)
    for start in range(0, n, _PART):
        rows[start : start + _PART] = scaler(observation[start : start + _PART])
    return rows


def multiscale(images: np.ndarray, scaling: Scaling) -> np.ndarray:
    """Images, (n, h, w, channels), blurred at several scales, (n, m) float32, scaled.

    The blur of a scale is Gaussian, as wide as the gap between the points at which it is read: a 16th, an 8th and a quarter of
    the image. Zeros are around it. Each scale has the same weight for things that do not overlap at it.
    """
    n, h, w, channels = images.shape
    features, scaler = [], scaling.scaler(h * w * channels)
    for start in range(0, n, _PART):
        part = scaler(images[start : start + _PART]).astype(np.float32).reshape(-1, h, w, channels)
        blurred = [np.einsum("ph,nhwc,qw->npqc", a, part, b, optimize=True) for a, b in blurs(h, w)]
        features.append(np.concatenate([level.reshape(len(part), -1) for level in blurred], axis=1))
    return np.concatenate(features)


def rhythms(sequences: np.ndarray, scaling: Scaling) -> np.ndarray:
    """What changes smoothly with a gait, (n, m) float32, of sequences, (n, steps, channels), scaled.

    Three things beside each other, all in the unit of the root of an energy: of each channel the magnitudes of its spectrum,
    compressed by a root so that small swings tell their frequency too; where it is on average, at four times; and of each two
    channels how much they swing together.
    """
    n, steps, channels = sequences.shape
    scaler, window = scaling.scaler(steps * channels), np.hanning(steps + 2)[1:-1, None]
    window = window * np.sqrt(2 / (window**2).sum())  # the other half of an energy lies at negative frequencies
    bands, slow = _octaves(steps), _blur(steps, _SLOW)
    parts = []
    for start in range(0, n, _PART):
        x = scaler(sequences[start : start + _PART]).reshape(-1, steps, channels)
        swing = x - x.mean(axis=1, keepdims=True)
        magnitude = np.abs(np.fft.rfft(window * swing, axis=1))
        spectrum = np.einsum("bf,nfc->nbc", bands, magnitude, optimize=True)
        mean = np.einsum("pt,ntc->npc", slow, x, optimize=True)
        parts.append([part.reshape(len(x), -1).astype(np.float32) for part in (spectrum, mean, _common(swing))])
    spectrum, mean, common = (np.concatenate(part) for part in zip(*parts, strict=True))
    energy = np.sqrt((spectrum**2).mean() / max(spectrum.mean(), np.finfo(np.float32).tiny))  # is to stay what it was
    return np.concatenate([energy * np.sqrt(spectrum), mean, _TOGETHER * common], axis=1)


def _octaves(steps: int) -> np.ndarray:
    """(bands, frequencies): weights of those of a sequence of so many steps, the squares of each summing to 1."""
    frequency = np.log2(np.maximum(np.arange(steps // 2 + 1), 0.5))
    band = np.arange(0, np.log2(max(steps, 2)), _OCTAVE)
    weight = np.exp(-0.5 * ((frequency - band[:, None]) / _OCTAVE) ** 2)
    return weight / np.sqrt((weight**2).sum(axis=0))


def _common(swing: np.ndarray) -> np.ndarray:
    """(n, pairs): covariances of channels, (n, steps, channels), over the root of the product of their deviations."""
    steps, channels = swing.shape[1:]
    if not 1 < channels <= _MOST_CHANNELS:
        return np.zeros((len(swing), 0))
    covariance = swing.swapaxes(1, 2) @ swing / steps
    size = np.sqrt(swing.std(axis=1))
    one, other = np.triu_indices(channels)
    weight = np.where(one == other, 1, np.sqrt(2)) * np.sqrt(steps / channels)
    return weight * covariance[:, one, other] / np.maximum(size[:, one] * size[:, other], _STILL)


def blurs(height: int, width: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each scale two matrices, (points, height) and (points, width), that blur images from the left and the right."""
    return [(_blur(height, points), _blur(width, points)) for points in _SCALES]


def _blur(size: int, points: int) -> np.ndarray:
    """(points, size) float32: Gaussian weights, the square of each row summing to 1, of pixels around evenly spaced points."""
    sigma = size / points
    offset = np.arange(size) - ((np.arange(points) + 0.5) * sigma - 0.5)[:, None]
    weight = np.exp(-0.5 * (offset / sigma) ** 2)
    return (weight / np.sqrt(sigma * np.sqrt(np.pi))).astype(np.float32)


def along_the_graph(
    rows: np.ndarray, rng: np.random.Generator, neighbours: int = _NEIGHBOURS, landmarks: int = _LANDMARKS
) -> np.ndarray:
    """Coordinates, (n, at most 24) float32, whose distances are about the lengths of shortest paths between rows.

    Paths go along the graph of each row's nearest neighbours: as many as make it one piece, from `neighbours` on; more than 32
    are not tried, and its pieces are joined where they come closest. Rows that are the same are one point of it.

    Args:
        rows: (n, features) float32, finite.
        rng: chooses the landmarks.
        neighbours: the fewest.
        landmarks: rows from which paths are found. Where there are no more rows than these, all are, and it is Isomap.
    """
    points, which = np.unique(rows, axis=0, return_inverse=True)
    if len(points) <= 2:
        return points[which.ravel(), :_AXES]
    graph = neighbour_graph(points, neighbours)
    chosen = np.sort(rng.permutation(len(points))[:landmarks])
    return _coordinates(paths(graph, chosen), chosen)[which.ravel()]


def paths(graph: Any, start: np.ndarray) -> np.ndarray:
    """(len(start), n): lengths of the shortest paths from these rows of a graph to all."""
    from scipy.sparse.csgraph import dijkstra

    return dijkstra(graph, directed=False, indices=start)


def neighbour_graph(points: np.ndarray, neighbours: int = _NEIGHBOURS) -> Any:
    """The graph of each point's nearest neighbours, (n, n) sparse, in one piece. Points, (n, features), must differ."""
    from scipy.sparse.csgraph import connected_components
    from sklearn.neighbors import NearestNeighbors

    n = len(points)
    most = min(_MOST_NEIGHBOURS, n - 1)
    search = NearestNeighbors(n_neighbors=most, algorithm="brute").fit(points)
    distance, neighbour = search.kneighbors()
    k = min(neighbours, most)
    while True:
        graph = _graph(distance[:, :k], neighbour[:, :k])
        pieces, piece = connected_components(graph, directed=False)
        if pieces == 1:
            return graph
        if k == most:
            return _joined(graph, points, piece)
        k = min(k + max(1, k // 2), most)


def _graph(distance: np.ndarray, neighbour: np.ndarray) -> Any:
    from scipy.sparse import csr_array

    n, k = distance.shape
    length = np.maximum(distance.ravel(), np.finfo(np.float32).tiny)  # 0 would be no edge
    starts = np.arange(0, n * k + 1, k, dtype=np.int32)  # before 1.15 SciPy finds no paths in a graph of wider numbers
    one_way = csr_array((length, neighbour.ravel().astype(np.int32), starts), shape=(n, n))
    return one_way.maximum(one_way.T)


def _joined(graph: Any, points: np.ndarray, piece: np.ndarray) -> Any:
    """A graph in several pieces, (n,) their numbers, with edges from the smallest to what is closest, until it is one."""
    from scipy.sparse import csr_array
    from sklearn.metrics import pairwise_distances_argmin_min

    graph, piece = graph.copy(), piece.copy()
    while True:
        numbers, sizes = np.unique(piece, return_counts=True)
        if len(numbers) == 1:
            return graph
        smallest = piece == numbers[sizes.argmin()]
        inside, outside = np.flatnonzero(smallest), np.flatnonzero(~smallest)
        closest, distance = pairwise_distances_argmin_min(points[inside], points[outside])
        i = distance.argmin()
        a, b = inside[i], outside[closest[i]]
        edge = csr_array(([distance[i]] * 2, ([a, b], [b, a])), shape=graph.shape)
        graph = graph + edge
        piece[inside] = piece[b]


def _coordinates(length: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Coordinates, (n, axes) float32, from path lengths, (landmarks, n): classical scaling of the landmarks, and where the
    others must then be [3].
    """
    squares = length**2
    among = squares[:, landmarks]
    mean = among.mean(axis=0)
    centred = -0.5 * (among - mean - mean[:, None] + mean.mean())
    values, vectors = np.linalg.eigh(centred)
    values, vectors = values[::-1][:_AXES], vectors[:, ::-1][:, :_AXES]
    kept = values > _NOTHING * values[0]
    return (-0.5 * (squares.T - mean) @ (vectors[:, kept] / np.sqrt(values[kept]))).astype(np.float32)


def kept(wanted: np.ndarray, z: np.ndarray) -> float:
    """How well distances between positions, (n, d), tell those between wanted ones, (n, m): the square of their correlation."""
    from scipy.spatial.distance import pdist

    far, given = (distance - distance.mean() for distance in (pdist(wanted), pdist(z))) if len(z) > 1 else (np.zeros(1),) * 2
    size = (far @ far) * (given @ given)
    return float((far @ given) ** 2 / size) if size > 0 else 0.0
