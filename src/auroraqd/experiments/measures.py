"""What repertoires are judged by, as data: each a number for a repertoire, at the end of a run or at any generation of it.

A measure takes a look at the individuals there are, and keeps no more of them than it needs. The score may have to wait: a
repertoire that is its own reference is only complete at the end.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np


class Measure(Protocol):
    """A number for a repertoire."""

    @property
    def name(self) -> str:
        """Its column in tables."""
        ...

    @property
    def title(self) -> str:
        """What it is called in tables and figures."""
        ...

    @property
    def form(self) -> str:
        """How it is written."""
        ...

    @property
    def followed(self) -> bool:
        """Whether it is taken during a run too."""
        ...

    @property
    def logarithmic(self) -> bool:
        """Whether its axis is."""
        ...

    def look(self, individuals: Any) -> Any:
        """What it needs of an archive or a repertoire."""
        ...

    def score(self, looked: Any, reference: Any) -> float:
        """The number, given what it saw of the individuals, and at the end of the reference."""
        ...


@dataclass(frozen=True)
class Coverage:
    """How individuals lie in ground-truth space, beside those of the reference.

    Args:
        name, title, form, followed, logarithmic: see `Measure`.
        function: of the ground truth of the reference, (n, d), and of the individuals, (m, d).
    """

    name: str
    title: str
    function: Callable[[np.ndarray, np.ndarray], float]
    form: str = "{:.4f}"
    followed: bool = False
    logarithmic: bool = False

    def look(self, individuals: Any) -> np.ndarray:
        """Their ground truth."""
        return individuals.ground_truth.copy()

    def score(self, looked: np.ndarray, reference: np.ndarray) -> float:
        """See the class."""
        return self.function(reference, looked)


@dataclass(frozen=True)
class Own:
    """A number of the individuals alone; it needs no reference.

    Args:
        name, title, form, followed, logarithmic: see `Measure`.
        function: of an archive or a repertoire.
    """

    name: str
    title: str
    function: Callable[[Any], float]
    form: str = "{:.1f}"
    followed: bool = False
    logarithmic: bool = False

    def look(self, individuals: Any) -> float:
        """The number itself."""
        return self.function(individuals)

    def score(self, looked: float, reference: float) -> float:
        """See the class."""
        return looked
