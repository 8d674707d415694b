"""Updates: the descriptor is refitted, l redefined, and all that is stored described anew (paper, Sec. "AURORA").

An update changes what every individual is known by, so one bad fit could end a run or empty its archive. It is looked at
before it is taken: a descriptor that cannot be fitted, that does not describe all that is stored, that maps it to one point, or
by which most of it would be lost, is refused. Then the one before stays, and it is tried again: in the next generation, and,
should that fail too, ever later. Before a first fit there is none: individuals wait until it succeeds.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from auroraqd.descriptors.descriptor import Descriptor, DescriptorError, Mismatch
from auroraqd.descriptors.scaling import outlying
from auroraqd.individuals import Columns
from auroraqd.observations import streams_of

FIRST_FITS = 10  # times that a first fit is tried again, with ever more individuals
_LONGEST = 20  # doublings of the time to wait: more than any run has
_ROUNDING = 1e-10  # spread, as a share of the size of the numbers, that is none
_NARROW = 1e-9  # likewise of a dimension beside the widest


class RefusedUpdate(DescriptorError):
    """An update that would do harm, and why; what it would have changed is as it was."""


class Attempts(NamedTuple):
    """Updates refused since the last that was taken, and the generation at which it is tried again."""

    refused: int = 0
    due: int | None = None

    def after(self, generation: int) -> Attempts:
        """One more was refused in this generation: the next is due in 1, 2, 4, ... generations."""
        return Attempts(self.refused + 1, generation + 2 ** min(self.refused, _LONGEST))


class Update(NamedTuple):
    """What an update would change.

    Attributes:
        descriptor: refitted, if it is learned.
        values: (n, d), of all that is stored; of the individuals to be added, where nothing is.
        error: (n,), of their reconstructions, or None.
        l: the new distance threshold; None: as it is.
    """

    descriptor: Descriptor
    values: np.ndarray
    error: np.ndarray | None
    l: float | None


def updated(
    descriptor: Descriptor,
    individuals: Columns,
    before: np.ndarray | None,
    *,
    refit: bool,
    robust: bool,
    resolution: Callable[[np.ndarray], Any] | None,
) -> Update:
    """What an update would change.

    Args:
        descriptor: as it is.
        individuals: n, that it is updated on.
        before: (n, d), their descriptors so far; None while there are none.
        refit: whether the descriptor is fitted on them.
        robust: whether observations far outside the others are set aside for that, and later ones limited.
        resolution: gives l.

    Raises:
        RefusedUpdate: it would do harm.
        DescriptorError: a descriptor that is not learned cannot describe, or one that is learned is for other observations.
    """
    called = f"on {individuals.rows:,} observations"
    try:
        if refit:
            fitted = _fitted_on(individuals, robust)
            descriptor = descriptor.refitted(fitted["observation"], fitted.get("fitness"), limited=robust)
        values, error = descriptor.describe(individuals)
    except DescriptorError as error:
        if not descriptor.learned or isinstance(error, Mismatch):
            raise
        raise RefusedUpdate(f"{error} ({called})") from error
    if not np.isfinite(values).all():
        raise RefusedUpdate(f"{descriptor} gave a NaN or an infinity for individuals that are stored ({called})")
    _check_spread(
        values, before, said=f"{descriptor} ({called})", transformed=not isinstance(descriptor.source, str) and before is None
    )
    return Update(descriptor, values, error, None if resolution is None else _threshold(resolution, values))


def _fitted_on(individuals: Columns, robust: bool) -> Columns:
    """The observations to fit a descriptor on, without those far outside, and their fitness."""
    x = individuals["observation"]
    streams = streams_of(x).values()
    if len(x) > 1 and all(np.array_equal(s[0], s[-1]) and (s == s[0]).all() for s in streams):
        raise RefusedUpdate(f"all {len(x):,} observations are the same, so there is nothing to learn a descriptor from")
    if not robust:
        return individuals
    far, dwarfing = outlying(x)
    if (more := dwarfing & ~far).any():
        warnings.warn(
            f"{np.count_nonzero(more):,} of {len(x):,} observations have {_largest(x, more)}, ten thousand times as far out as "
            "three quarters of the others, which are alike beside them. If their simulations blew up, return NaN for them: "
            f"evaluation {_listed(individuals['born'][more])}",
            stacklevel=6,
        )
    if not far.any():
        return individuals
    count = np.count_nonzero(far)
    warnings.warn(
        f"{count} of {len(x):,} observations {'lies' if count == 1 else 'lie'} far outside the others, with "
        f"{_largest(x, far)}, set aside for the fit: evaluation {_listed(individuals['born'][far])}. What is stored stays",
        stacklevel=6,
    )
    return individuals.only("observation", "fitness").take(~far)


def _largest(x: np.ndarray, which: np.ndarray) -> str:
    return f"entries up to {max(np.abs(s[which].astype(np.float64)).max() for s in streams_of(x).values()):.3g}"


def _listed(numbers: np.ndarray) -> str:
    return f"{', '.join(map(str, numbers[:5]))}{', ...' * (len(numbers) > 5)}"


def _check_spread(values: np.ndarray, before: np.ndarray | None, *, said: str, transformed: bool) -> None:
    """Refuse descriptors, (n, d), that do not tell individuals apart, or no longer in a dimension in which they did."""
    if len(values) < 2:
        return
    with np.errstate(over="ignore"):
        spread = np.ptp(values, axis=0)
    if spread.max() <= _ROUNDING * np.abs(values).max():
        raise RefusedUpdate(f"{said} maps all {len(values):,} individuals to one point")
    narrow = spread <= _NARROW * spread.max()
    if transformed and narrow.any():  # whole observations may well have constant entries
        warnings.warn(f"{said} has no spread in {_dimensions(narrow)}", stacklevel=6)
    if before is not None and before.shape == values.shape:
        was = np.ptp(before, axis=0)
        lost = narrow & (was > _NARROW * was.max())
        if lost.any():
            raise RefusedUpdate(f"{said} has no spread in {_dimensions(lost)}, in which individuals differed before")


def _dimensions(which: np.ndarray) -> str:
    numbers = ", ".join(str(number + 1) for number in np.flatnonzero(which))
    return f"dimension {numbers}" if which.sum() == 1 else f"dimensions {numbers}"


def _threshold(resolution: Callable[[np.ndarray], Any], values: np.ndarray) -> float | None:
    """l by a resolution; None, as it is, of one individual alone, which has no distance to others."""
    l: Any = resolution(values)
    if isinstance(l, int | float | np.integer | np.floating) and 0 < l < np.inf:
        return float(l)
    asked_for = getattr(resolution, "l", None) == l
    if l == 0 and (asked_for or len(values) == 1):
        return 0.0 if asked_for else None
    raise RefusedUpdate(f"{resolution} gives {l!r} for the distance threshold l, which must be a finite number above 0")
