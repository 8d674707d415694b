"""Fitting a transformer; PCA among them by a solver that does not give up.

scikit-learn's PCA, unless told otherwise, decomposes small matrices by LAPACK's divide and conquer (gesdd), which does not
always converge on matrices with many equal singular values (scikit-learn issue 7113): on the first generation of a robot that
mostly stays where it is, most rows are the same. The eigenvalues of the covariance can always be found.
"""

import logging
import warnings
from typing import Any

import numpy as np

_COVARIANCE_FEATURES = 1000  # up to here scikit-learn, too, takes the covariance, if there are enough rows
_log = logging.getLogger("auroraqd")


def fit(transformer: Any, x: np.ndarray, y: np.ndarray | None = None, *, spare: bool = False) -> None:
    """Fit a transformer on x, and y if given; each `PCA(svd_solver="auto")`, alone or in a pipeline, by what always converges.

    That is what scikit-learn would take by the shape of x, unless rows repeat: then "covariance_eigh", up to 1,000 features.
    Should the solver fail all the same, another takes its place, with a warning. The parameter is "auto" again in the end.

    Args:
        transformer, x, y: see above.
        spare: whether x is too large to be copied, and needed no more: PCA overwrites it, and no other solver takes its place.

    Raises:
        Exception: whatever the transformer raises.
    """
    automatic = _automatic(transformer)
    if not automatic:
        _fit_on(transformer, x, y)
        return
    stable, copied = _stable(automatic, x), [pca.copy for pca in automatic]
    try:
        if spare:
            for pca in automatic:
                pca.copy = False
            _fit(transformer, automatic, x, y, "auto")
            return
        if _by_gesdd(x) and stable == "covariance_eigh" and len(np.unique(x, axis=0)) < len(x):
            _log.info("rows of %d observations repeat: PCA is fitted by %r", len(x), stable)
            _fit(transformer, automatic, x, y, stable)
        else:
            try:
                _fit(transformer, automatic, x, y, "auto")
            except np.linalg.LinAlgError as error:
                _fit(transformer, automatic, x, y, stable)
                warnings.warn(
                    f"PCA could not be fitted by scikit-learn's default solver ({error}); by {stable!r} it was", stacklevel=4
                )
    finally:
        for pca, copy in zip(automatic, copied, strict=True):
            pca.svd_solver, pca.copy = "auto", copy


def _fit(transformer: Any, automatic: list[Any], x: np.ndarray, y: np.ndarray | None, solver: str) -> None:
    for pca in automatic:
        pca.svd_solver = solver
    _fit_on(transformer, x, y)
    if not all(np.isfinite(pca.components_).all() for pca in automatic):
        raise np.linalg.LinAlgError("its components are not finite")


def _fit_on(transformer: Any, x: np.ndarray, y: np.ndarray | None) -> None:
    if y is None:
        transformer.fit(x)
    else:
        transformer.fit(x, y)


def _automatic(transformer: Any) -> list[Any]:
    """The PCA of scikit-learn in it whose solver is left open."""
    if type(transformer).__module__.startswith("sklearn."):
        from sklearn.decomposition import PCA
        from sklearn.pipeline import Pipeline

        steps = [step for _, step in transformer.steps] if type(transformer) is Pipeline else [transformer]
        return [step for step in steps if type(step) is PCA and step.svd_solver == "auto"]
    return []


def _by_gesdd(x: np.ndarray) -> bool:
    """Whether scikit-learn's default solver does not take the covariance anyway."""
    features = x[0].size
    return features > _COVARIANCE_FEATURES or len(x) < 10 * features


def _stable(automatic: list[Any], x: np.ndarray) -> str:
    """A solver without gesdd of the whole matrix; one whose cost does not grow with the cube of the features."""
    features = x[0].size
    if features <= _COVARIANCE_FEATURES:
        return "covariance_eigh"
    fewest = min(len(x), features)
    wanted = [pca.n_components for pca in automatic]
    return "arpack" if all(isinstance(n, int | np.integer) and 0 < n < fewest for n in wanted) else "covariance_eigh"
