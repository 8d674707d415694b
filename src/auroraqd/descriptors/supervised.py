"""Descriptors that learn from the fitness too: of what is observed, that which has to do with it [1].

A transformer whose `fit` needs a `y` is given the fitness, and so are scikit-learn's regressors, classifiers, and pipelines
with one of these. Classifiers and `NeighborhoodComponentsAnalysis` want classes: then it is cut into quantiles. A `y=None`, as
of scikit-learn's unsupervised transformers, stays None.

[1] E. Meyerson, J. Lehman, R. Miikkulainen, Learning behavior characterizations for novelty search, GECCO 2016.
"""

import inspect
import sys
from typing import Any

import numpy as np

_CLASSES = 10


def is_supervised(transformer: Any) -> bool:
    """Whether it learns from the fitness."""
    return any(_needs_y(step) for step in _steps(transformer))


def wants_classes(transformer: Any) -> bool:
    """Whether it takes the fitness in classes."""
    return any(_is_of(step, "ClassifierMixin") or _is_nca(step) for step in _steps(transformer))


def target(transformer: Any, fitness: np.ndarray | None) -> np.ndarray | None:
    """The y to fit a transformer with, (n,), of fitness, (n,) finite; None if it needs none.

    Raises:
        ValueError: there is no fitness, or it does not differ as much as it must.
    """
    if not is_supervised(transformer):
        return None
    if fitness is None:
        raise ValueError("it learns from the fitness too, which is not known of a prior")
    if not wants_classes(transformer):
        _check_differs(fitness, 2)
        return fitness.copy()
    least = 1 + max([_components(step) for step in _steps(transformer) if _is_of(step, "ClassifierMixin")], default=1)
    return quantiles(fitness, max(_CLASSES, least), least)


def quantiles(fitness: np.ndarray, most: int, least: int) -> np.ndarray:
    """Classes of fitness, (n,) to (n,) int64: of about as many different values each, and no more than half as many as rows.

    Args:
        fitness: (n,), finite.
        most, least: classes.

    Raises:
        ValueError: there would be fewer than the least.
    """
    _check_differs(fitness, least)
    values, which = np.unique(fitness, return_inverse=True)
    count = min(most, len(values), len(fitness) // 2)
    if count < least:
        raise ValueError(f"fitness must be that of {2 * least} individuals at least, for {least} classes, got {len(fitness)}")
    return which * count // len(values)


def _check_differs(fitness: np.ndarray, least: int) -> None:
    found = len(np.unique(fitness))
    if found < least:
        same = " and is the same for all" if found == 1 else ""
        raise ValueError(
            f"fitness must have {least} different values at least to learn from, got {found} of {len(fitness)}{same}"
        )


def _steps(transformer: Any) -> list[Any]:
    """Itself, or what a pipeline consists of."""
    steps = getattr(transformer, "steps", None)
    return [part for _, step in steps for part in _steps(step)] if isinstance(steps, list) else [transformer]


def _needs_y(step: Any) -> bool:
    try:
        y = inspect.signature(step.fit).parameters.get("y")
    except (AttributeError, TypeError, ValueError):  # "passthrough", or a method that tells nothing
        return False
    required = y is not None and y.default is inspect.Parameter.empty
    return required or _is_of(step, "RegressorMixin") or _is_of(step, "ClassifierMixin")


def _is_of(step: Any, mixin: str) -> bool:
    """Whether it is one of scikit-learn's, which takes time to import: if it is, it has been."""
    base = sys.modules.get("sklearn.base")
    return base is not None and isinstance(step, getattr(base, mixin))


def _is_nca(step: Any) -> bool:
    neighbors = sys.modules.get("sklearn.neighbors")
    return neighbors is not None and isinstance(step, neighbors.NeighborhoodComponentsAnalysis)


def _components(step: Any) -> int:
    components = getattr(step, "n_components", None)
    return int(components) if isinstance(components, int | np.integer) else 1
