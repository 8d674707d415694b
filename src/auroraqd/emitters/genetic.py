"""The genetic emitter: selection, then variation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from auroraqd._checks import check_genotypes, function, in_words
from auroraqd.archives.base import Archive
from auroraqd.emitters.selection import Curiosity
from auroraqd.emitters.variation import Polynomial


@dataclass(frozen=True)
class Genetic:
    """Offspring of selected individuals: the emitter of the AURORA paper.

    Args:
        selection: `select(archive, n, rng)` to n rows of the archive; see `auroraqd.emitters.selection`.
        variation: `vary(parents, rng)` to children; see `auroraqd.emitters.variation`.

    Examples:
        >>> import auroraqd
        >>> from auroraqd.emitters import Genetic
        >>> emitter = Genetic(auroraqd.Uniform(), auroraqd.IsoLine(0.005, 0.05))
        >>> auroraqd.Aurora(2, "genotype", emitter=emitter, seed=0).selection
        Uniform()
    """

    selection: Callable[[Archive, int, np.random.Generator], np.ndarray] = field(default_factory=Curiosity)
    variation: Callable[[np.ndarray, np.random.Generator], np.ndarray] = field(default_factory=Polynomial)

    __repr__ = in_words

    def __post_init__(self) -> None:
        for name in ("selection", "variation"):
            function(name, getattr(self, name))

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Children and their parents; of a group of parents, the first.

        Raises:
            ValueError: the selection or the variation returned something else than it must.
        """
        n_parents = getattr(self.variation, "n_parents", 1)
        wanted = n * n_parents
        rows = np.asarray(self.selection(archive, wanted, rng))
        sound = rows.shape == (wanted,) and rows.dtype.kind in "iu"
        if not (sound and np.minimum.reduce(rows) >= 0 and np.maximum.reduce(rows) < len(archive)):
            raise ValueError(f"selection must return ({wanted},) rows of the archive, got shape {rows.shape} of {rows.dtype}")
        if n_parents > 1:
            rows = rows.reshape(n, n_parents)
        genotype = archive.genotype
        children = np.array(self.variation(genotype.take(rows, axis=0), rng), np.float64)
        check_genotypes("variation must return", children, (n, genotype.shape[1]))
        return children, archive.id[rows if n_parents == 1 else rows[:, 0]]
