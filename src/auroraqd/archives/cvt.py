"""CVT-MAP-Elites: cells are the regions around centroids, in any number of dimensions.

The centroids of a centroidal Voronoi tessellation are spread like samples of the space of descriptors, found by k-means
[1]. `tessellate` finds them, `CVTArchive` takes them or any others.

[1] V. Vassiliades, K. Chatzilygeroudis, J.-B. Mouret, Using Centroidal Voronoi Tessellations to Scale Up the
Multidimensional Archive of Phenotypic Elites Algorithm, IEEE TEVC 2018.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._caches import cache_folder
from auroraqd._checks import MOST_SEED, flag, numbers, shown, whole
from auroraqd._files import replacing
from auroraqd.archives._nearest import Nearest
from auroraqd.archives.grid import CellArchive

_CACHE_VERSION = 1
_MOST_STEPS = 10**6


class Tessellation(NamedTuple):
    """Centroids and how they were found.

    Attributes:
        centroids: (cells, d) float64, distinct.
        asked: centroids asked for.
        samples: samples they were made of.
        steps: Lloyd steps done.
    """

    centroids: np.ndarray
    asked: int
    samples: int
    steps: int

    def __str__(self) -> str:
        return f"{len(self.centroids)} distinct centroids of {self.asked}, from {self.samples} samples in {self.steps} steps"


def tessellate(samples: ArrayLike, cells: int, *, steps: int = 5, seed: int = 0, cache: bool = True) -> Tessellation:
    """Spread centroids like samples, by k-means (Lloyd's algorithm, scikit-learn's).

    The result is kept in the user's cache folder (`AURORAQD_CACHE`, or `auroraqd` in that of the system) and found again by
    the content of the arguments.

    Args:
        samples: (n, d), n >= cells.
        cells: how many centroids. Fewer when samples coincide.
        steps: most Lloyd steps.
        seed: of the choice of the samples to start from.
        cache: whether to look for the result on disk, and keep it there.

    Raises:
        ValueError: wrong shape, a NaN or an infinity, or fewer samples than cells.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> samples = np.random.default_rng(0).random((1000, 3))
        >>> print(auroraqd.tessellate(samples, cells=50, cache=False))
        50 distinct centroids of 50, from 1000 samples in 5 steps
    """
    samples = _points("samples", samples)
    cells, steps, seed = (
        whole("cells", cells),
        whole("steps", steps, most=_MOST_STEPS),
        whole("seed", seed, least=0, most=MOST_SEED),
    )
    if len(samples) < cells:
        raise ValueError(f"samples must be at least as many as cells, {shown(cells)}, got {len(samples)}")
    path = _cache_path(samples, cells, steps, seed) if flag("cache", cache) else None
    found = None if path is None else _read(path)
    if found is not None and found.centroids.shape[1] == samples.shape[1] and len(found.centroids) <= cells:
        return found
    result = _lloyd(samples, cells, steps, seed)
    if path is not None:
        _write(path, result)
    return result


def _lloyd(samples: np.ndarray, cells: int, steps: int, seed: int) -> Tessellation:
    from sklearn.cluster import KMeans

    if np.abs(samples).max() > 2.0**900:  # their differences and sums are to be numbers too
        found = _lloyd(samples * 2.0**-200, cells, steps, seed)
        return found._replace(centroids=found.centroids * 2.0**200)
    distinct = np.unique(samples, axis=0)
    if len(distinct) <= cells:
        return Tessellation(distinct, cells, len(samples), 0)
    start = distinct[np.sort(np.random.default_rng(seed).choice(len(distinct), cells, replace=False))]
    # In single precision, about the middle: centroids are where they are wanted, not where they are exact.
    middle = samples.mean(axis=0)
    unit = float(np.abs(samples - middle).max()) or 1.0
    means = KMeans(
        cells,
        init=((start - middle) / unit).astype(np.float32),
        n_init=1,  # pyright: ignore[reportArgumentType]
        max_iter=steps,
        tol=0,
        algorithm="lloyd",
    )
    means.fit(((samples - middle) / unit).astype(np.float32))
    centroids = np.unique(means.cluster_centers_.astype(np.float64) * unit + middle, axis=0)
    return Tessellation(centroids, cells, len(samples), int(means.n_iter_))


class CVTArchive(CellArchive):
    """MAP-Elites on the Voronoi cells of centroids: an individual belongs to the nearest, of several the first.

    Nearest is exact: bounds in few dimensions and single precision leave a few centroids, and direct differences in double
    precision decide among them.

    Args:
        centroids: (cells, d), or a `Tessellation`. Repeated rows count once.

    Attributes:
        tessellation: the centroids, (cells, d) float64, and where they come from.

    Raises:
        ValueError: wrong shape, or a NaN or an infinity.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> archive = auroraqd.CVTArchive([[0.0, 0.0], [1.0, 1.0]])
        >>> descriptor = np.array([[0.1, 0.2], [0.2, 0.1], [0.9, 0.8]])
        >>> archive.add(np.zeros((3, 1)), np.zeros(3), descriptor, descriptor)
        array([1, 0, 1], dtype=int8)
    """

    def __init__(self, centroids: ArrayLike | Tessellation) -> None:
        super().__init__()
        given = centroids.centroids if isinstance(centroids, Tessellation) else centroids
        points = _points("centroids", given)
        _, first = np.unique(points, axis=0, return_index=True)
        counts = centroids[1:] if isinstance(centroids, Tessellation) else (len(points), 0, 0)
        named = zip(("asked", "samples", "steps"), counts, strict=True)
        asked, samples, steps = (whole(f"{name} of the centroids", count, least=0) for name, count in named)
        points = points[np.sort(first)]
        points.flags.writeable = False
        self.tessellation = Tessellation(points, asked, samples, steps)
        self._nearest = Nearest(points)

    def __repr__(self) -> str:
        return f"CVTArchive({self.tessellation}): {len(self)} individuals"

    @property
    def settings(self) -> dict[str, Any]:
        """How the centroids were found, as JSON values."""
        t = self.tessellation
        return {"centroids": len(t.centroids), "asked": t.asked, "samples": t.samples, "steps": t.steps}

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """The centroids."""
        return {"centroids": self.tessellation.centroids}

    @classmethod
    def made(cls, settings: Mapping[str, Any], constants: Mapping[str, np.ndarray]) -> CVTArchive:
        """As `Archive.made`."""
        return cls(Tessellation(constants["centroids"], settings["asked"], settings["samples"], settings["steps"]))

    @property
    def n_cells(self) -> int:
        """Distinct centroids."""
        return len(self.tessellation.centroids)

    @property
    def n_dimensions(self) -> int:
        """Dimensions of the centroids."""
        return self.tessellation.centroids.shape[1]

    def _cells(self, descriptor: np.ndarray) -> np.ndarray:
        return self._nearest(descriptor)


def _points(name: str, values: ArrayLike) -> np.ndarray:
    return np.ascontiguousarray(numbers(name, values, " of shape (n, d)", axes=2, some=True, finite=True))


def _cache_path(samples: np.ndarray, cells: int, steps: int, seed: int) -> Path | None:
    digest = hashlib.sha256(repr((_CACHE_VERSION, samples.shape, cells, steps, seed)).encode())
    digest.update(samples.data)
    folder = cache_folder()
    return None if folder is None else folder / f"centroids-{digest.hexdigest()[:32]}.safetensors"


def _read(path: Path) -> Tessellation | None:
    """What is kept there, or None when there is nothing that can be read."""
    from safetensors import SafetensorError
    from safetensors.numpy import load_file

    try:
        arrays = load_file(path)
        return Tessellation(_points("centroids", arrays["centroids"]), *(int(number) for number in arrays["counts"]))
    except (OSError, SafetensorError, KeyError, TypeError, ValueError):
        return None


def _write(path: Path, found: Tessellation) -> None:
    from safetensors.numpy import save

    with contextlib.suppress(OSError), replacing(path) as file:  # a cache that cannot be written costs time, nothing else
        file.write(save({"centroids": found.centroids, "counts": np.array(found[1:], np.int64)}))
