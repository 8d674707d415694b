"""Schedule: at which generations the descriptor is refitted and l redefined.

A schedule is a callable `schedule(generation)`; a generation's number is how many came before it. Every schedule but
`Never` includes generation 0.
"""

from dataclasses import dataclass

from auroraqd._checks import whole


@dataclass(frozen=True)
class Doubling:
    """Updates with doubling gaps: 0, first, 3 first, 7 first, ... (paper, Sec. "AURORA": 0, 50, 150, 350, ..., 3150).

    Args:
        first: generations before the first update after generation 0.

    Examples:
        >>> import auroraqd
        >>> [generation for generation in range(1000) if auroraqd.Doubling(50)(generation)]
        [0, 50, 150, 350, 750]
    """

    first: int = 50

    def __post_init__(self) -> None:
        whole("first", self.first)

    def __call__(self, generation: int) -> bool:
        """Whether to update before this generation is added."""
        gaps, remainder = divmod(whole("generation", generation, least=0), self.first)
        return remainder == 0 and (gaps + 1) & gaps == 0  # 0, 1, 3, 7, ...: one less than a power of two


@dataclass(frozen=True)
class Widening:
    """Updates with gaps that grow by the same number of generations each, up to a largest [1].

    [1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022, where the
    gaps are those of the defaults.

    Args:
        first: generations before the first update after generation 0.
        more: by which each gap is longer than the one before.
        most: the longest gap.

    Examples:
        >>> import auroraqd
        >>> [generation for generation in range(200) if auroraqd.Widening()(generation)]
        [0, 20, 50, 90, 140]
    """

    first: int = 20
    more: int = 10
    most: int = 1000

    def __post_init__(self) -> None:
        whole("first", self.first)
        whole("more", self.more, least=0)
        if whole("most", self.most) < self.first:
            raise ValueError(f"first must be most or less, got first {self.first} and most {self.most}")

    def __call__(self, generation: int) -> bool:
        """Whether to update before this generation is added."""
        left, gap = whole("generation", generation, least=0), self.first
        while left > 0:
            if gap == self.most or self.more == 0:
                return left % gap == 0
            left, gap = left - gap, min(gap + self.more, self.most)
        return left == 0


@dataclass(frozen=True)
class Every:
    """Updates at regular gaps.

    Args:
        generations: the gap.

    Examples:
        >>> import auroraqd
        >>> [generation for generation in range(350) if auroraqd.Every(100)(generation)]
        [0, 100, 200, 300]
    """

    generations: int

    def __post_init__(self) -> None:
        whole("generations", self.generations)

    def __call__(self, generation: int) -> bool:
        """Whether to update before this generation is added."""
        return whole("generation", generation, least=0) % self.generations == 0


@dataclass(frozen=True)
class Never:
    """No updates: a learned descriptor is fitted once, on the first generation or before (`prior`), and l set then; of other
    descriptors l stays what the archive was given.

    Examples:
        >>> import auroraqd
        >>> any(auroraqd.Never()(generation) for generation in range(1000))
        False
    """

    def __call__(self, generation: int) -> bool:
        """False."""
        return False
