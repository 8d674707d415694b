"""What every emitter promises, and how several share a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from auroraqd._checks import number, shown
from auroraqd.archives.base import Archive


@runtime_checkable
class Emitter(Protocol):
    """See `auroraqd.emitters`."""

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Genotypes to evaluate, (n, n_genes) in [0, 1], and the ids of their parents, (n,), -1 for none."""
        ...


class EmitterError(RuntimeError):
    """An emitter raised when it was told something. The state of the run is whole: what was found is kept, and it can go on."""


class Calls:
    """Calls of what emitters may have; what they raise is kept until the state that they are told of is whole.

    Args:
        when: of which moment errors are said.
    """

    def __init__(self, when: str) -> None:
        self._when = when
        self._failure: EmitterError | None = None

    def call(self, emitter: Any, method: str, *arguments: Any) -> None:
        """Call a method of an emitter, if it has it."""
        if not hasattr(emitter, method):
            return
        try:
            getattr(emitter, method)(*arguments)
        except Exception as error:
            if self._failure is None:
                what = f"{type(error).__name__}: {error}" if f"{error}" else type(error).__name__
                self._failure = EmitterError(
                    f"emitter {type(emitter).__name__} raised in `{method}`, {self._when}: {what}; what was found is kept"
                )
                self._failure.__cause__ = error

    def end(self) -> None:
        """Raise what was raised first, if anything was.

        Raises:
            EmitterError: an emitter raised.
        """
        if self._failure is not None:
            raise self._failure


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
