"""What arguments must be, and how to say what came: one sentence with the argument's name, what was wanted and what came."""

import reprlib
from collections.abc import Callable, Mapping
from dataclasses import fields
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np

_LONGEST = 200  # characters of what came, in a message
_MOST_ENTRIES = 2**40  # of an array: one that repeats itself takes no memory, and what is made of it would
_MOST = 2**63 - 1
_short = reprlib.Repr()
_short.maxstring = _short.maxother = 100
MOST_SEED = 2**128 - 1
"""The largest seed: as large as what seeds come from."""


def shown(value: Any) -> str:
    """A value in short, in one line, whatever it is."""
    try:
        text = " ".join(_short.repr(value).split())
    except Exception:  # a whole number of thousands of digits has none in Python, and what others make may have none at all
        return f"{'an' if type(value).__name__[0] in 'aeiou' else 'a'} {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def instance(name: str, value: Any, kind: Any, wanted: str) -> Any:
    """The value, if it is of a kind.

    Raises:
        TypeError: it is not.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be {wanted}, got {shown(value)}")
    return value


def mapping(name: str, value: Any) -> Mapping:
    """The value, if it is a dictionary or the like."""
    return instance(name, value, Mapping, "a dictionary, of values by name")


def function(name: str, value: Any) -> Callable:
    """The value, if it can be called and is no class.

    Raises:
        TypeError: it cannot, or is one.
    """
    if isinstance(value, type) or not callable(value):
        raise TypeError(f"{name} must be callable, an instance and not a class, got {shown(value)}")
    return value


def flag(name: str, value: Any) -> bool:
    """The value as a bool.

    Raises:
        ValueError: it is neither True nor False.
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def one_of(name: str, value: Any, choices: Any) -> str:
    """The value, if it is one of these words.

    Raises:
        ValueError: it is not.
    """
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, got {shown(value)}")
    return value


def whole(name: str, value: Any, *, least: int = 1, most: int | None = None) -> int:
    """The value as an int, of at most 64 bits if nothing else is said.

    Raises:
        ValueError: it is no whole number, or out of range.
    """
    numeric = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (numeric and least <= value <= (_MOST if most is None else most)):
        unbounded = most is None and not (numeric and value > _MOST)
        limit = f"{least} or more" if unbounded else f"from {least} to {_MOST if most is None else most}"
        raise ValueError(f"{name} must be a whole number, {limit}, got {shown(value)}")
    return int(value)


def wholes(name: str, values: Any, wanted: str, *, most: int | None = None) -> tuple[int, ...]:
    """A sequence of whole numbers, 1 or more.

    Raises:
        ValueError: it is something else.
    """
    if not isinstance(values, list | tuple | range | np.ndarray) or (isinstance(values, np.ndarray) and values.ndim == 0):
        raise ValueError(f"{name} must be {wanted}, got {shown(values)}")
    return tuple(whole(name, value, most=most) for value in values)


def number(name: str, value: Any, *, least: float = 0.0, most: float = np.inf, wanted: str = "0 or more") -> float:
    """The value as a float: finite, at least `least`, at most `most`.

    Raises:
        ValueError: it is no number, or out of range.
    """
    numeric = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    try:
        result = float(value) if numeric else np.nan
    except OverflowError:  # a whole number of Python's
        result = np.nan
    if not (least <= result <= most and abs(result) < np.inf):
        raise ValueError(f"{name} must be a finite number, {wanted}, got {shown(value)}")
    return result


def numbers(
    name: str,
    values: Any,
    shape: str = "",
    *,
    axes: int | None = None,
    rows: bool = False,
    some: bool = False,
    finite: bool = False,
) -> np.ndarray:
    """An array of float64: see `numeric`."""
    array = numeric(name, values, shape, axes=axes, rows=rows, some=some, finite=finite)
    return array.astype(np.float64, copy=False)


def numeric(
    name: str,
    values: Any,
    shape: str = "",
    *,
    axes: int | None = None,
    rows: bool = False,
    some: bool = False,
    finite: bool = False,
) -> np.ndarray:
    """An array of numbers, of the dtype that they have, if it is one of numbers. The one way in for arrays of others.

    None is no number, and not NaN; nor are digits in a string, complex numbers, times, or masked entries.

    Args:
        name: of the argument.
        values: what came.
        shape: that is wanted, for the message: " of shape (n,)".
        axes: how many there must be.
        rows: whether there must be one at least.
        some: whether there must be an entry at least.
        finite: whether a NaN or an infinity is refused.

    Raises:
        ValueError: they are no numbers of at most 64 bits, or not rows of one shape; or something else than wanted.
    """
    try:
        array = _array(values)
    except (TypeError, ValueError, OverflowError) as error:
        got = getattr(values, "dtype", None)
        came = shown(values) if got is None or getattr(got, "kind", "O") == "O" else f"an array of {got}"
        uneven = "inhomogeneous" in str(error)
        wanted = shape or (" with rows of one shape" if uneven else "")
        why = ": its rows differ in shape" if shape and uneven else ""
        raise ValueError(f"{name} must be numbers{wanted}, got {came}{why}") from None
    if array.size > _MOST_ENTRIES:
        raise ValueError(f"{name} must have at most {_MOST_ENTRIES:,} entries, got shape {array.shape}")
    if array.dtype.itemsize > 8:
        raise ValueError(f"{name} must be numbers of at most 64 bits, got {array.dtype}")
    if axes not in (None, array.ndim) or (rows and array.ndim == 0) or (some and array.size == 0):
        wanted = shape.removeprefix(" of shape ") or {1: "(n,)", 2: "(n, columns)"}.get(axes or 0, "(n, ...)")
        raise ValueError(f"{name} must have shape {wanted}{', with entries' if some else ''}, got {array.shape}")
    if finite and not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got a NaN or an infinity")
    return array


def _array(values: Any) -> np.ndarray:
    """As an array of booleans, whole numbers or floats; raises what NumPy raises, or TypeError."""
    if type(values) is np.ndarray and values.dtype.kind in "biuf":  # the common case, which must cost nothing
        return values
    if _masked(values):
        raise TypeError
    array = np.asarray(values)
    if array.dtype.kind in "biuf":
        return array
    if array.dtype.kind != "O" or not all(isinstance(entry, Real | Decimal | np.bool_) for entry in array.flat):
        raise TypeError
    return array.astype(np.float64)


def _masked(values: Any) -> bool:
    """Whether entries are masked: NumPy would take what lies under the mask."""
    if isinstance(values, list | tuple):
        return any(_masked(entry) for entry in values if isinstance(entry, np.ma.MaskedArray | list | tuple))
    return bool(np.ma.is_masked(values))


def whole_numbers(name: str, values: Any, *, axes: int | None = None, some: bool = False) -> np.ndarray:
    """An array of int64, which may be empty: see `numeric`.

    Raises:
        ValueError: they are no whole numbers of at most 64 bits, or of another shape.
    """
    array = numeric(name, values, axes=axes, some=some)
    if array.dtype.kind not in "iu" and array.size:
        raise ValueError(f"{name} must be whole numbers, got {shown(values)}")
    if array.dtype == np.uint64 and (array > _MOST).any():
        raise ValueError(f"{name} must be below 2^63, got {array.max()}")
    return array.astype(np.int64, copy=False)


def check_genotypes(must: str, genotypes: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless genotypes have this shape and are in [0, 1]; `must`: who must what, "variation must return"."""
    if genotypes.shape != shape:
        raise ValueError(f"{must} genotypes of shape {shape}, got {genotypes.shape}")
    if not (np.minimum.reduce(genotypes, axis=None) >= 0 and np.maximum.reduce(genotypes, axis=None) <= 1):  # as min, faster
        outside = genotypes[~((genotypes >= 0) & (genotypes <= 1))]
        raise ValueError(f"{must} genotypes in [0, 1], got {outside[0]:g}")


def seeds_for(name: str, seeds: Any, n: int) -> np.ndarray:
    """Seeds, one for each of n individuals, (n,) whole numbers.

    Raises:
        ValueError: they are something else.
    """
    if not isinstance(seeds, np.ndarray):
        # Of whole numbers on both sides of 2**63, NumPy would make floats.
        words = isinstance(seeds, str | bytes)
        seeds = np.asarray(list(seeds) if np.iterable(seeds) and not words else seeds, object)
    if seeds.shape != (n,):
        came = f"shape {seeds.shape}" if seeds.ndim else shown(seeds[()])
        raise ValueError(f"{name} must have shape ({n},), got {came}")
    if seeds.dtype.kind in "iu":
        return seeds
    wrong = [seed for seed in seeds.tolist() if not isinstance(seed, int | np.integer) or isinstance(seed, bool)]
    if wrong:
        raise ValueError(f"{name} must be whole numbers, got {type(wrong[0]).__name__} {shown(wrong[0])}")
    return seeds  # Python's own are of any size


def in_words(self: Any) -> str:
    """A dataclass as its `repr` has it, but functions and objects by what they are called, and not by where they lie."""
    return f"{type(self).__qualname__}({', '.join(f'{f.name}={_named(getattr(self, f.name))}' for f in fields(self))})"


def _named(value: Any) -> str:
    text = getattr(value, "__qualname__", None) or repr(value)
    return type(value).__qualname__ if " at 0x" in text else text


def rows_of(shape: tuple[int, ...]) -> str:
    """The shape of rows, for messages: "(n, 50, 2)"."""
    return f"({', '.join(map(str, ('n', *shape)))}{'' if shape else ','})"


def in_short(columns: Any) -> str:
    """A named tuple of arrays by their shapes, or values where there are few."""
    texts = [_in_short(name, value) for name, value in zip(columns._fields, columns, strict=True)]
    return f"{type(columns).__name__}({', '.join(texts)})"


def _in_short(name: str, value: Any) -> str:
    streams = getattr(getattr(value, "dtype", None), "names", None)
    if streams is not None:
        return ", ".join(_in_short(f"{name} {stream}", value[stream]) for stream in streams)
    return f"{name}={value}" if value is None or np.size(value) <= 10 else f"{name}: {value.dtype} {value.shape}"
