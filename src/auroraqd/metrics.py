"""Metrics of the paper: how well a repertoire covers a reference."""

import numpy as np

from auroraqd._checks import whole


def klc(reference: np.ndarray, compared: np.ndarray, bins: int = 30) -> float:
    """Kullback-Leibler coverage, D_KL(reference || compared), over a joint histogram (paper, Eq. 1).

    The histogram has `bins` bins in each dimension over the bounding box of the reference. A bin that the compared repertoire
    leaves empty counts as a probability of 1e-8. Individuals of the compared repertoire outside the box are not
    counted: see `outside`.

    Args:
        reference: (n, d), for instance the ground truth of a repertoire grown with the hand-coded descriptor.
        compared: (m, d), likewise of the repertoire to judge.

    Returns:
        0 when the two are distributed alike, larger the worse the reference is covered.

    Raises:
        ValueError: not two-dimensional, empty, NaN, or of different d.
    """
    bins = whole("bins", bins)
    reference, compared = _points("reference", reference), _points("compared", compared)
    if reference.shape[1] != compared.shape[1]:
        raise ValueError(f"reference and compared must have the same columns, got {reference.shape} and {compared.shape}")
    box = list(zip(reference.min(axis=0), reference.max(axis=0), strict=True))
    e, _ = np.histogramdd(reference, bins, box)
    a, _ = np.histogramdd(compared, bins, box)
    e /= e.sum()
    a = np.maximum(a / max(a.sum(), 1), 1e-8)
    covered = e > 0
    return float(np.sum(e[covered] * np.log(e[covered] / a[covered])))  # Eq. 1


def outside(reference: np.ndarray, compared: np.ndarray) -> float:
    """The share of the compared repertoire, (m, d), outside the bounding box of the reference, (n, d)."""
    reference, compared = _points("reference", reference), _points("compared", compared)
    return float(((compared < reference.min(axis=0)) | (compared > reference.max(axis=0))).any(axis=1).mean())


def _points(name: str, values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, np.float64)
    if values.ndim != 2 or len(values) == 0:
        raise ValueError(f"{name} must have shape (n, d) with n >= 1, got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite, got a NaN or an infinity")
    return values
