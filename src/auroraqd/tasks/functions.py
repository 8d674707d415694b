"""A robot of one's own as a task: a function of one genotype, a JAX function, genes with names, bounds and units.

A function of a batch of genotypes is a task as it is. What is here makes one of what is not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import flag, function, number, numbers, numeric, seeds_for, shown, whole

_LEAST_ROWS = 16  # of a batch in JAX, which compiles anew for each number of rows: numbers are rounded up to powers of two
_WIDEST = 1e300  # of a bound, so that what is between two is a number too
_NAMES = ("fitness", "observation", "ground_truth")


@dataclass(frozen=True)
class Gene:
    """One parameter of a controller.

    Args:
        low, high: bounds, in its unit; low < high.
        unit: in words, "rad" for instance.
    """

    low: float
    high: float
    unit: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.unit, str):
            raise ValueError(f"the unit of a gene must be words, got {shown(self.unit)}")
        low, high = (
            number(name, getattr(self, name), least=-_WIDEST, most=_WIDEST, wanted="a bound") for name in ("low", "high")
        )
        if not low < high:
            raise ValueError(f"low of a gene must be below high, got {low:g} and {high:g}")


class Genes:
    """The parameters of a controller, by name.

    Args:
        genes: name to low and high, and a unit if wanted.

    Raises:
        ValueError: no genes, or bounds that are none.

    Examples:
        >>> import auroraqd
        >>> genes = auroraqd.tasks.Genes(amplitude=(0, 1.5, "rad"), frequency=(0.5, 2, "Hz"))
        >>> genes.scale([[0.0, 0.0], [1.0, 1.0]])
        array([[0. , 0.5],
               [1.5, 2. ]])
        >>> genes.unscale([[0.75, 2.0]])
        array([[0.5, 1. ]])
    """

    def __init__(self, **genes: tuple[float, float] | tuple[float, float, str]):
        if not genes:
            raise ValueError("there must be at least one gene")
        found = {}
        for name, gene in genes.items():
            try:
                if not isinstance(gene, list | tuple | np.ndarray) or not 2 <= len(gene) <= 3:
                    raise TypeError
                found[name] = Gene(gene[0], gene[1], *gene[2:])
            except ValueError as error:
                raise ValueError(f"gene {name} must be (low, high) or (low, high, unit), got {shown(gene)}: {error}") from None
            except (TypeError, LookupError):  # too few of them, too many, or none
                raise ValueError(f"gene {name} must be (low, high) or (low, high, unit), got {shown(gene)}") from None
        self._genes: Mapping[str, Gene] = found

    def __len__(self) -> int:
        return len(self._genes)

    def __repr__(self) -> str:
        return f"Genes({', '.join(f'{name}=({g.low:g}, {g.high:g}, {g.unit!r})' for name, g in self._genes.items())})"

    @property
    def names(self) -> list[str]:
        """In the order of the genotype."""
        return list(self._genes)

    @property
    def units(self) -> list[str]:
        """In the order of the genotype."""
        return [gene.unit for gene in self._genes.values()]

    @property
    def bounds(self) -> np.ndarray:
        """(n_genes, 2), low and high."""
        return np.array([(gene.low, gene.high) for gene in self._genes.values()], np.float64)

    def scale(self, genotypes: ArrayLike) -> np.ndarray:
        """Genotypes, (..., n_genes) in [0, 1], to values in their units, (..., n_genes).

        Raises:
            ValueError: another number of genes.
        """
        low, high = self.bounds.T
        with np.errstate(over="ignore"):
            return low + self._checked("genotypes", genotypes) * (high - low)

    def unscale(self, values: ArrayLike) -> np.ndarray:
        """Values in their units, (..., n_genes), to genotypes in [0, 1]: for controllers that are known.

        Raises:
            ValueError: another number of genes, or values out of bounds.
        """
        low, high = self.bounds.T
        array = self._checked("values", values)
        outside = (array < low) | (array > high) | np.isnan(array)
        if outside.any():
            where = tuple(np.argwhere(outside)[0])
            name = self.names[where[-1]]
            raise ValueError(f"values: {name} must be in [{low[where[-1]]:g}, {high[where[-1]]:g}], got {array[where]:g}")
        return np.clip((array - low) / (high - low), 0.0, 1.0)

    def _checked(self, name: str, rows: ArrayLike) -> np.ndarray:
        array = numbers(name, rows)
        if array.ndim == 0 or array.shape[-1] != len(self):
            raise ValueError(f"{name} must have {len(self)} genes ({', '.join(self.names)}), got shape {array.shape}")
        return array


class _OfOne:
    """A task of a function of one genotype."""

    def __init__(self, one: Callable[..., Any], n_genes: int | None = None, seeded: bool = False):
        self.function = function("function", one)
        self.seeded = flag("seeded", seeded)
        self.__name__ = getattr(one, "__name__", type(one).__name__)
        if n_genes is not None:
            self.n_genes = whole("n_genes", n_genes)

    def _seeds(self, seeds: Any, n: int) -> np.ndarray | None:
        """Seeds of n individuals, if it wants them, or is given some."""
        return None if seeds is None and not self.seeded else seeds_for(f"seeds of {self.__name__}", seeds, n)


class Each(_OfOne):
    """A task of a function of one genotype; what `each` returns."""

    def __call__(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> tuple | np.ndarray:
        """The evaluation of genotypes, (n, n_genes), one after the other; with their seeds, (n,), if it is seeded.

        Raises:
            ValueError: what it returns is no evaluation, or differs in kind or shape between genotypes.
        """
        genotypes = _genotypes(genotypes)
        checked = self._seeds(seeds, len(genotypes))
        if checked is None:
            results = [_columns(self.function(genotype), _copied) for genotype in genotypes]
        else:
            pairs = zip(genotypes, checked, strict=True)
            results = [_columns(self.function(genotype, int(seed)), _copied) for genotype, seed in pairs]
        kinds = {len(result) if isinstance(result, tuple) else None for result in results}
        if len(kinds) != 1:
            raise ValueError("it must return a tuple of the same length for each genotype, or always observation alone")
        if kinds == {None}:
            return _stacked("observation", results)
        return tuple(_stacked(name, column) for name, column in zip(_NAMES, zip(*results, strict=True), strict=False))


def each(function: Callable[..., Any], n_genes: int | None = None, *, seeded: bool = False) -> Each:
    """A task of a function of one genotype, (n_genes,) in [0, 1].

    Args:
        function: returns observation, (...), or a tuple of fitness, observation and, if known, ground truth. NaN: invalid.
        n_genes: kept as an attribute; the command line needs it.
        seeded: whether it is called as `function(genotype, seed)`, with a whole number that is the individual's own.

    Raises:
        TypeError, ValueError: an argument is of the wrong kind or out of range.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> def one(genotype):
        ...     angle, speed = np.pi * genotype[0], genotype[1]
        ...     return -speed, speed * np.array([np.cos(angle), np.sin(angle)])
        >>> task = auroraqd.tasks.each(one, n_genes=2)
        >>> fitness, observation = task(np.array([[0.0, 1.0], [0.5, 0.5]]))
        >>> fitness
        array([-1. , -0.5])
        >>> observation.round(2)
        array([[1. , 0. ],
               [0. , 0.5]])
    """
    return Each(function, n_genes, seeded)


class FromJax(_OfOne):
    """A task of a JAX function of one genotype; what `from_jax` returns."""

    _compiled: Any = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_compiled": None}  # each process compiles its own

    def __call__(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> tuple | np.ndarray:
        """The evaluation of genotypes, (n, n_genes), all at once; with keys from their seeds, (n,), if it is seeded.

        Raises:
            ValueError: what it returns is no evaluation, or it is no function that JAX can trace.
        """
        import jax

        if self._compiled is None:
            self._compiled = jax.jit(jax.vmap(self._of_arrays))
        columns = [_genotypes(genotypes)]
        n = len(columns[0])
        checked = self._seeds(seeds, n)
        if checked is not None:
            columns.append(np.ascontiguousarray(checked, np.uint64).view(np.uint32).reshape(n, 2))
        rows = max(_LEAST_ROWS, 1 << (n - 1).bit_length())
        padded = [np.concatenate([column, np.repeat(column[:1], rows - n, axis=0)]) for column in columns]
        keys = [jax.random.wrap_key_data(jax.numpy.asarray(data), impl="threefry2x32") for data in padded[1:]]
        try:
            with np.errstate(over="ignore"):  # in single precision
                found = self._compiled(padded[0], *keys)
        except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError) as error:
            raise ValueError(
                "it must be a function of jax.numpy, without `if` or float() of its values, for JAX to trace it, and a "
                f"function of NumPy is made a task by auroraqd.tasks.each instead, got {type(error).__name__}"
            ) from error
        first = partial(jax.tree.map, lambda column: np.asarray(column)[:n])
        return tuple(map(first, found)) if isinstance(found, tuple) else first(found)

    def _of_arrays(self, *arguments: Any) -> Any:
        return _columns(self.function(*arguments), _traced)


def from_jax(function: Callable[..., Any], n_genes: int | None = None, *, seeded: bool = False) -> FromJax:
    """A task of a JAX function of one genotype, (n_genes,) in [0, 1]; `jit` and `vmap` are applied.

    It runs on the device that JAX has, in the precision that JAX is set to (float32 unless it was told otherwise).

    Args:
        function: returns observation, (...), or a tuple of fitness, observation and, if known, ground truth. NaN: invalid.
        n_genes: kept as an attribute; the command line needs it.
        seeded: whether it is called as `function(genotype, key)`, with a JAX key that is the individual's own.

    Raises:
        TypeError, ValueError: an argument is of the wrong kind or out of range.

    Examples:
        >>> import jax.numpy as jnp
        >>> import numpy as np
        >>> import auroraqd
        >>> def one(genotype):
        ...     return genotype[1] * jnp.array([jnp.cos(genotype[0]), jnp.sin(genotype[0])])
        >>> task = auroraqd.tasks.from_jax(one, n_genes=2)
        >>> task(np.array([[0.0, 1.0], [0.0, 0.5]]))
        array([[1. , 0. ],
               [0.5, 0. ]], dtype=float32)
    """
    return FromJax(function, n_genes, seeded)


def _genotypes(genotypes: Any) -> np.ndarray:
    return numeric("genotypes", genotypes, " of shape (n, n_genes)", axes=2, some=True)


def _columns(result: Any, array: Callable[[str, Any], Any]) -> Any:
    """What a function returned for one genotype, as arrays: an observation, or a tuple of two or three.

    Args:
        result: what it returned.
        array: makes an array of numbers, of what is called so, in memory of its own: a function may return the same again,
            changed.

    Raises:
        ValueError: it is nothing of the kind.
    """
    wanted = "it must return a tuple of fitness, observation and optionally ground truth, or observation alone, (...)"
    if isinstance(result, tuple):
        parts = result[:2] if len(result) == 3 and result[2] is None else result  # an `Evaluation` without
        if len(parts) not in (2, 3):
            raise ValueError(f"{wanted}, got a tuple of {len(result)}")
        return tuple(_each_stream(array, name, part) for name, part in zip(_NAMES, parts, strict=False))
    if result is None or isinstance(result, str | bytes | set):
        raise ValueError(f"{wanted}, got {result if result is None else type(result).__name__}")
    observation = _each_stream(array, "observation", result)
    if not isinstance(observation, Mapping) and observation.ndim == 0:
        raise ValueError(
            f"{wanted}, got one number for a genotype: as observation of one entry it must be an array, of shape (1,)"
        )
    return observation


def _each_stream(array: Callable[[str, Any], Any], name: str, value: Any) -> Any:
    """An observation of streams, each made an array; anything else made one."""
    if not isinstance(value, Mapping) or name != "observation":
        return array(name, value)
    return {stream: array(f"{name} {stream}", rows) for stream, rows in value.items()}


def _copied(name: str, value: Any) -> np.ndarray:
    return numeric(f"{name} of a genotype", value).copy()


def _traced(name: str, value: Any) -> Any:
    """As an array of JAX, whose entries nobody knows yet."""
    import jax

    try:
        if value is None:  # earlier versions of JAX take it for NaN
            raise TypeError
        return jax.numpy.asarray(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} of a genotype must be numbers, got {shown(value)}") from None


def _stacked(name: str, rows: Any) -> Any:
    if isinstance(rows[0], Mapping):
        if any(not isinstance(row, Mapping) or row.keys() != rows[0].keys() for row in rows):
            raise ValueError(f"{name} must have the same streams for each genotype, {', '.join(map(str, rows[0]))}")
        return {stream: _stacked(f"{name} {stream}", [row[stream] for row in rows]) for stream in rows[0]}
    try:
        return np.stack([np.asarray(row) for row in rows])
    except ValueError:
        shapes = sorted({str(np.shape(row)) for row in rows})
        raise ValueError(f"{name} must have the same shape for each genotype, got {' and '.join(shapes[:3])}") from None
