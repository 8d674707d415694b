"""Variation: how offspring differ from their parents.

A variation is a callable `vary(parents, rng)` from genes in [0, 1] to genes in [0, 1]. It has one child for each row of
parents, (n, n_genes), or, with an attribute `n_parents` of 2 or more, for each group of parents, (n, n_parents, n_genes);
curiosity is credited to the first of a group.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from auroraqd._checks import flag, instance, number, numbers
from auroraqd._compiled import compiled


@dataclass(frozen=True)
class Polynomial:
    """Polynomial mutation of Deb & Agrawal: small steps likely, large ones possible.

    Args:
        rate: probability that a gene mutates. The AURORA experiments use 0.1.
        eta: distribution index; a larger one makes smaller steps. The AURORA experiments use 10.
        at_least_one: mutate one gene, drawn uniformly, where none would be. An unmutated copy is a wasted evaluation: with
            two genes and a rate of 0.1, 81% of them. The AURORA experiments leave it to chance (False).

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> parents = np.full((2, 3), 0.5)
        >>> children = auroraqd.Polynomial(rate=0.1)(parents, np.random.default_rng(0))
        >>> (children != parents).any(axis=1)  # each has at least one gene that mutated
        array([ True,  True])
    """

    rate: float = 0.1
    eta: float = 10.0
    at_least_one: bool = True

    def __post_init__(self) -> None:
        number("rate", self.rate, most=1, wanted="a probability, from 0 to 1")
        number("eta", self.eta)
        flag("at_least_one", self.at_least_one)

    def __call__(self, parents: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n, n_genes) parents to (n, n_genes) children."""
        parents = _genes(parents, rng)
        mutated = _mutated(parents.shape, self.rate, self.at_least_one, rng)
        children = parents.copy()
        _step(children, mutated, rng.random(np.count_nonzero(mutated)), 1 / (self.eta + 1))
        return children


@dataclass(frozen=True)
class Gaussian:
    """Gaussian mutation.

    Args:
        sigma: standard deviation of a step; genes span [0, 1].
        rate: probability that a gene mutates.
        at_least_one: mutate one gene, drawn uniformly, where none would be.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> auroraqd.Gaussian(sigma=0.05)(np.full((2, 3), 0.5), np.random.default_rng(0)).shape
        (2, 3)
    """

    sigma: float = 0.05
    rate: float = 1.0
    at_least_one: bool = True

    def __post_init__(self) -> None:
        number("rate", self.rate, most=1, wanted="a probability, from 0 to 1")
        number("sigma", self.sigma, least=1e-300, wanted="above 0")
        flag("at_least_one", self.at_least_one)

    def __call__(self, parents: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n, n_genes) parents to (n, n_genes) children."""
        parents = _genes(parents, rng)
        mutated = _mutated(parents.shape, self.rate, self.at_least_one, rng)
        return _clipped(parents + mutated * rng.normal(0, self.sigma, parents.shape))


@dataclass(frozen=True)
class IsoLine:
    """Iso+line variation: Gaussian noise, and a step along the line to another parent.

    V. Vassiliades, J.-B. Mouret, Discovering the Elite Hypervolume by Leveraging Interspecies Correlation, GECCO 2018.

    Args:
        iso_sigma: standard deviation of the isotropic noise.
        line_sigma: standard deviation of the step along the line, as a share of the distance to the other parent.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> pairs = np.random.default_rng(0).random((4, 2, 3))
        >>> auroraqd.IsoLine()(pairs, np.random.default_rng(0)).shape
        (4, 3)
    """

    n_parents: ClassVar[int] = 2

    iso_sigma: float = 0.01
    line_sigma: float = 0.2

    def __post_init__(self) -> None:
        if number("iso_sigma", self.iso_sigma) + number("line_sigma", self.line_sigma) == 0:
            raise ValueError("iso_sigma and line_sigma must not both be 0")

    def __call__(self, parents: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n, 2, n_genes) pairs of parents to (n, n_genes) children."""
        parents = _genes(parents, rng, axes=3)
        first, second = parents[:, 0], parents[:, 1]
        children = first + rng.normal(0, self.iso_sigma, first.shape)
        children += rng.normal(0, self.line_sigma, (len(first), 1)) * (second - first)
        return _clipped(children)


def _genes(parents: np.ndarray, rng: np.random.Generator, axes: int = 2) -> np.ndarray:
    """Parents as they must be."""
    instance("rng", rng, np.random.Generator, "a generator of numpy.random")
    wanted = " of shape (n, n_genes)" if axes == 2 else " of shape (n, 2, n_genes)"
    array = numbers("parents", parents, wanted, axes=axes)
    if axes == 3 and array.shape[1] != 2:
        raise ValueError(f"parents must have shape (n, 2, n_genes), got {array.shape}")
    return array


def _clipped(children: np.ndarray) -> np.ndarray:
    """The same array, its genes in [0, 1]. Half the time of `np.clip`."""
    np.maximum(children, 0, out=children)
    return np.minimum(children, 1, out=children)


def _mutated(shape: tuple[int, int], rate: float, at_least_one: bool, rng: np.random.Generator) -> np.ndarray:
    """Which genes mutate: (n, n_genes) bool."""
    mutated = rng.random(shape) < rate
    if at_least_one:
        _fill(mutated, rng.random(len(mutated)))
    return mutated


@compiled(nogil=True)
def _fill(mutated, spins):
    """Choose a gene in each row of (n, n_genes) bool that has none, by its spin, (n,) in [0, 1)."""
    for i in range(mutated.shape[0]):
        if not mutated[i].any():
            mutated[i, int(spins[i] * mutated.shape[1])] = True


@compiled(nogil=True)
def _step(genes, mutated, spins, exponent):
    """Change the genes that mutate, (n, n_genes), each by one spin in [0, 1), row by row, and no farther than to 0 or 1."""
    drawn = 0
    for i in range(genes.shape[0]):
        for j in range(genes.shape[1]):
            if mutated[i, j]:
                r = spins[drawn]
                drawn += 1
                # (2r)^(1/(eta+1)) - 1 for r < 0.5, and its mirror image above
                size = 1 - (2 * min(r, 1 - r)) ** exponent
                genes[i, j] = min(max(genes[i, j] + (-size if r < 0.5 else size), 0.0), 1.0)
