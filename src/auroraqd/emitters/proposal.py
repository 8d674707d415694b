"""Individuals on their way into the archive: asked for, and told."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from auroraqd._checks import in_short
from auroraqd.tasks.noise import seeds_of


class Proposal(NamedTuple):
    """Genotypes to evaluate.

    Attributes:
        ticket: by which they are told.
        genotype: (n, n_genes) in [0, 1].
        parent: (n,) int64, ids of their parents; -1 for those without.
        emitter: (n,) int64, the number of the emitter that made them; -1 for none.
        first: number of the first evaluation.
        seed: of the run.
    """

    ticket: int
    genotype: np.ndarray
    parent: np.ndarray
    emitter: np.ndarray
    first: int
    seed: int

    def __repr__(self) -> str:
        return in_short(self)

    @property
    def born(self) -> np.ndarray:
        """(n,) int64: the numbers of their evaluations."""
        return np.arange(self.first, self.first + len(self.genotype))

    @property
    def seeds(self) -> np.ndarray:
        """(n,) uint64: one for each, for a task whose outcome depends on chance."""
        return seeds_of(self.seed, self.first, len(self.genotype))


class Asked(NamedTuple):
    """A proposal that is out.

    Attributes:
        proposal: what was asked for.
        alone: whether it is a generation by itself.
        since: when that was, s.
    """

    proposal: Proposal
    alone: bool
    since: float


class Event(IntEnum):
    """What happens in a run that is told in parts, and the number that goes with it."""

    ASKED = 0  # so many individuals were asked for
    TOLD = 1  # the proposal of this number, the first is 0
    WITHDRAWN = 2  # likewise
    INVALID = 3  # the evaluation of this number; it is told next
    ALONE = 4  # so many generations were told by the batch
