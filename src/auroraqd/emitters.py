"""Emitters: what makes the genotypes that are evaluated next.

An emitter has one method, and may have more:

    ask(archive, n, rng)            (genotypes, parents): (n, n_genes) in [0, 1], and (n,) ids of their parents, -1 for none
    tell(archive, batch, info)      what became of its genotypes: their `Columns`, all n of them, the descriptor of invalid ones
                                    NaN, and their `Info`, after the archive has taken them
    updated(archive, describe)      the descriptor has changed; `describe` gives the new one of any `Columns` with observations
    state, restore(state)           what it remembers, as a dict of JSON values and arrays, for checkpoints

It is not asked while nothing is stored, when genotypes are random, unless it has a true attribute `starts`. `Aurora` copies
what it is given, so that an emitter belongs to one run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from auroraqd._checks import number, shown
from auroraqd.archive import Archive
from auroraqd.selection import Curiosity
from auroraqd.variation import Polynomial


@runtime_checkable
class Emitter(Protocol):
    """See the module docstring."""

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Genotypes to evaluate, (n, n_genes) in [0, 1], and the ids of their parents, (n,), -1 for none."""
        ...


@dataclass(frozen=True)
class Genetic:
    """Offspring of selected individuals: the emitter of the AURORA paper.

    Args:
        selection: `select(archive, n, rng)` to n rows of the archive; see `auroraqd.selection`.
        variation: `vary(parents, rng)` to children; see `auroraqd.variation`.
    """

    selection: Callable[[Archive, int, np.random.Generator], np.ndarray] = field(default_factory=Curiosity)
    variation: Callable[[np.ndarray, np.random.Generator], np.ndarray] = field(default_factory=Polynomial)

    def __post_init__(self) -> None:
        for name in ("selection", "variation"):
            check_callable(name, getattr(self, name))

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Children and their parents; of a group of parents, the first.

        Raises:
            ValueError: the selection or the variation returned something else than it must.
        """
        n_parents = getattr(self.variation, "n_parents", 1)
        wanted = n * n_parents
        rows = np.asarray(self.selection(archive, wanted, rng))
        if rows.shape != (wanted,) or rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() >= len(archive):
            raise ValueError(f"selection must return ({wanted},) rows of the archive, got shape {rows.shape} of {rows.dtype}")
        if n_parents > 1:
            rows = rows.reshape(n, n_parents)
        genotype = archive.genotype
        children = np.array(self.variation(genotype.take(rows, axis=0), rng), np.float64)
        shape = n, genotype.shape[1]
        if children.shape != shape or not (children.min() >= 0 and children.max() <= 1):
            raise ValueError(f"variation must return genotypes of shape {shape} in [0, 1], got shape {children.shape}")
        return children, archive.id[rows if n_parents == 1 else rows[:, 0]]


class Shared(NamedTuple):
    """Emitters that share each batch.

    Attributes:
        emitters: of them, at least one.
        shares: of the batch, one each, that add up to 1.
    """

    emitters: tuple[Any, ...]
    shares: tuple[float, ...]

    def counts(self, n: int, rng: np.random.Generator) -> list[int]:
        """How many of n individuals each makes: its share, as near as whole numbers allow, and by chance what is left."""
        if len(self.emitters) == 1:
            return [n]
        exact = n * np.array(self.shares)
        counts = np.floor(exact + 1e-9).astype(int)
        left = n - int(counts.sum())
        if left:
            over = np.maximum(exact - counts, 0)
            counts += rng.multinomial(left, over / over.sum())
        return counts.tolist()


def shared(given: Any) -> Shared:
    """One emitter, several that share alike, or pairs of emitters and shares.

    Raises:
        TypeError, ValueError: something is no emitter, or a share no number above 0.
    """
    several = list(given) if isinstance(given, Sequence) else [given]
    if not several:
        raise ValueError("emitter must be one at least, got none")
    pairs = [one if isinstance(one, tuple) and len(one) == 2 else (one, 1.0) for one in several]
    for emitter, _ in pairs:
        if isinstance(emitter, type) or not isinstance(emitter, Emitter):
            raise TypeError(
                f"emitter must have a method ask(archive, n, rng), an instance and not a class, got {shown(emitter)}"
            )
    shares = [number("share of an emitter", share, least=1e-12, wanted="above 0") for _, share in pairs]
    return Shared(tuple(emitter for emitter, _ in pairs), tuple(share / sum(shares) for share in shares))


def check_callable(name: str, value: object) -> None:
    """Raise TypeError unless it can be called: an instance, not a class."""
    if isinstance(value, type) or not callable(value):
        raise TypeError(f"{name} must be callable, an instance and not a class, got {shown(value)}")
