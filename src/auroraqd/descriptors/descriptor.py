"""Behavioural descriptors: the few numbers that say how two behaviours differ.

A descriptor is read off the ground truth (a hand-coded descriptor), off the genotype, is the whole observation, or is learned
from the observations by any object with scikit-learn's `fit` and `transform`. This module turns each into one immutable
value, `Descriptor`, which Aurora replaces when it is refitted.
"""

import copy
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import numbers, rows_of, shown
from auroraqd._interrupts import check_interrupt
from auroraqd.descriptors import _solvers, supervised
from auroraqd.descriptors._affine import Affine
from auroraqd.descriptors.scaling import Scaler, Scaling
from auroraqd.individuals import Columns
from auroraqd.observations import Layout, described, features_of, finite_rows, flat, layout_of, observations, unflattened

HAND_CODED = "hand-coded"
GENOTYPE = "genotype"
OBSERVATION = "observation"
NAMES = (HAND_CODED, GENOTYPE, OBSERVATION)


_FOLDED_FEATURES, _FOLDED_COMPONENTS = 2048, 32
"""What an affine transformer reads and gives, at most, to become matrices: to find them takes the square of the first, and
products of larger ones are faster elsewhere."""


_MOST_SCALED = 2**22
"""Entries of observations that are scaled at a time, 32 MiB."""


_MOST_IN_FULL = 2**25
"""Entries of observations that a transformer is fitted on in float64, 256 MiB; more are in float32."""


class DescriptorError(ValueError):
    """A descriptor cannot be fitted, or describes in a way that it must not. What was found before stays."""


class Mismatch(DescriptorError):
    """A descriptor is for other observations than the task gives: no more of them will mend that, so it is not tried again."""


@runtime_checkable
class Transformer(Protocol):
    """What Aurora needs of a learned descriptor. `inverse_transform`, where present, gives reconstructions.

    It is fitted on scaled observations, float64; in float32 on more than 2^25 entries.

    One with an attribute `natural_shape` that is true gets observations in the shape of the task, (n, ...), instead. One with a
    method `reads_raw(shape, dtype)`, which is true for what is observed, gets them as they are stored, not scaled; once fitted
    it says by `scaling_` how it scales them, and `raw_` is true. One whose `fit` needs a `y` gets the fitness too: see
    `auroraqd.descriptors.supervised`.
    """

    def fit(self, x: np.ndarray) -> Any:
        """Learn from x, (n, features)."""
        ...

    def transform(self, x: np.ndarray) -> np.ndarray:
        """Map x, (n, features), to descriptors, (n, d)."""
        ...


@dataclass(frozen=True)
class Descriptor:
    """How to describe individuals. Immutable: `refitted` gives a new one.

    Args:
        source: "hand-coded" (the ground truth), "genotype", "observation" (all of it, scaled and flattened), or a learned
            descriptor: a fitted or unfitted `Transformer`.
        scaling: of the observations it was fitted on; None while unfitted, and for descriptors that do not read them.
    """

    source: str | Transformer
    scaling: Scaling | None = None
    shape: tuple[int, ...] = ()  # of one observation; of streams, how many entries all have
    layout: Layout | None = None  # of its streams, if it has some
    scaler: Scaler | None = None  # observations, (n, ...), to (n, features)
    encode: Any = None  # (n, features), scaled, to descriptors
    decode: Any = None  # descriptors to (n, features), scaled, or None
    affine: Affine | None = None  # all of these at once, where they are affine
    raw: bool = False  # encode reads observations as they are, and decode gives them

    def __str__(self) -> str:
        return f"{self.source!r}" if isinstance(self.source, str) else f"the transform of {type(self.source).__name__}"

    def __repr__(self) -> str:
        fitted = f", of observations {rows_of(self.shape)}" if self.scaling is not None else ""
        return f"Descriptor({self.source!r}{fitted})"

    @property
    def transformer(self) -> "Transformer | None":
        """The object that is learned, fitted once `ready`; None where the descriptor is read off, not learned."""
        return None if isinstance(self.source, str) else self.source

    @classmethod
    def checked(cls, source: "str | Transformer", rng: np.random.Generator) -> "Descriptor":
        """A descriptor from what a user gives.

        A transformer is copied, so that it is Aurora's alone, and seeded where it has a `random_state` of None, so that a
        seed of Aurora reproduces the run.
        """
        if isinstance(source, str):
            if source not in NAMES:
                raise ValueError(f"descriptor must be one of {', '.join(NAMES)}, or a transformer, got {source!r}")
            return cls(source)
        if isinstance(source, type) or not isinstance(source, Transformer):
            made = f", of which one must be made: {source.__name__}(...)" if isinstance(source, type) else ""
            raise TypeError(
                f"descriptor must be one of {', '.join(NAMES)}, or an object with fit and transform, got {shown(source)}{made}"
            )
        if hasattr(source, "check_parameters"):
            source.check_parameters()  # pyright: ignore[reportAttributeAccessIssue]
        return cls(_seeded(copy.deepcopy(source), rng))

    @property
    def learned(self) -> bool:
        """Whether it is fitted on observations. Of "observation", that is the scaling."""
        return self.source not in (HAND_CODED, GENOTYPE)

    @property
    def ready(self) -> bool:
        """Whether it can describe."""
        return not self.learned or self.encode is not None

    def rows_to_fit(self, features: int) -> int:
        """The fewest observations that can be fitted: one more than the components, where the transformer has a number."""
        if isinstance(self.source, str):
            return 1
        last = self.source.steps[-1][1] if hasattr(self.source, "steps") else self.source  # type: ignore[union-attr]
        components = getattr(last, "n_components", 1)
        rows = 1 + min(int(components), features) if isinstance(components, int | np.integer) else 2
        return 2 * rows if supervised.wants_classes(self.source) else rows  # two of each class

    def readable(self, individuals: Columns) -> np.ndarray:
        """(n,) bool: individuals without a NaN or an infinity in the observation, and in the ground truth if it reads it."""
        finite = finite_rows(individuals["observation"])
        if self.source == HAND_CODED and "ground_truth" in individuals:
            return finite & finite_rows(individuals["ground_truth"])
        return finite

    def refitted(
        self,
        observation: np.ndarray,
        fitness: np.ndarray | None = None,
        *,
        weights: Mapping[str, float] | None = None,
        limited: bool = True,
    ) -> "Descriptor":
        """A new descriptor, learned from observations; the old one stays as it was, whatever happens.

        Args:
            observation: (n, ...).
            fitness: (n,), of which it learns too if it is supervised.
            weights: by which streams count.
            limited: whether later ones count as no farther out than the range of these allows; see `scaling`.

        Raises:
            DescriptorError: the transformer cannot be fitted.
        """
        layout = layout_of(observation)
        shape = observation.shape[1:] if layout is None else (features_of(observation),)
        if isinstance(self.source, str):
            return self.restored(Scaling.of(observation), shape, layout, limited=limited)
        transformer: Any = self._copied(self.source)
        raw = not weights and _reads_raw(transformer, shape, observation.dtype)  # weights are those of a joint scaling
        scaling = None if raw else Scaling.of(observation, weights)
        x = observation if scaling is None else _scaled(scaling.scaler(math.prod(shape)), observation)
        x = x.reshape(len(x), *shape) if _natural(transformer) and layout_of(x) is None else x
        spare = scaling is not None and x.size > _MOST_IN_FULL
        try:
            _solvers.fit(transformer, x, supervised.target(transformer, fitness), spare=spare)
        except Mismatch:
            raise
        except Exception as error:
            check_interrupt(error)
            name, n_components = type(transformer).__name__, getattr(transformer, "n_components", None)
            beyond = isinstance(n_components, int) and n_components > math.prod(shape)  # more observations will not mend that
            kind = Mismatch if beyond else DescriptorError
            raise kind(f"{name} could not be fitted on observations of shape {x.shape}: {error}") from error
        if type(transformer).__module__.startswith("sklearn."):
            # A copy has each array in one piece, as a file has it. In pieces, products would be rounded in another way, and a
            # run that goes on from a file would take another course.
            transformer = self._copied(transformer)
        scaling = transformer.scaling_ if scaling is None else scaling
        return Descriptor(transformer).restored(scaling, shape, layout, raw, limited=limited)

    @staticmethod
    def _copied(transformer: Any) -> Any:
        try:
            return copy.deepcopy(transformer)
        except Exception as error:
            raise DescriptorError(f"{type(transformer).__name__} could not be copied to be fitted anew: {error}") from error

    def restored(
        self,
        scaling: Scaling,
        shape: tuple[int, ...],
        layout: Layout | None = None,
        raw: bool | None = None,
        *,
        limited: bool = True,
    ) -> "Descriptor":
        """The descriptor of a transformer that has been fitted on observations like these, scaled like this.

        Args:
            scaling, shape, layout: see the class.
            raw: whether the transformer scales them itself; None: as it says, `raw_`.
            limited: False lifts the limit that the scaling has.
        """
        features, scaling = math.prod(shape), scaling if limited else scaling.unlimited()
        raw = bool(getattr(self.source, "raw_", False)) if raw is None else raw
        fitted = replace(self, scaling=scaling, shape=shape, layout=layout, scaler=scaling.scaler(features), raw=raw)
        if isinstance(self.source, str):
            return replace(fitted, encode=_unchanged)
        encode, decode = _functions(self.source, shape)
        if decode is not None and _is_small(encode, features) and _is_affine(self.source):
            affine = Affine.of(scaling.scaler(features), encode, decode)
            return replace(fitted, encode=encode, decode=affine.reconstruct, affine=affine)
        return replace(fitted, encode=encode, decode=decode)

    def describe_observation(self, observation: ArrayLike) -> np.ndarray:
        """Descriptors, (n, d) float64, of observations, (n, ...).

        Raises:
            RuntimeError: the descriptor is not learned, or not fitted yet.
            ValueError: the observations have another shape than those it was fitted on, or a NaN or an infinity.
        """
        if not self.learned:
            raise RuntimeError(f"the descriptor {self.source!r} is not learned from observations")
        if not self.ready:
            raise RuntimeError("the descriptor has not been fitted yet: run a generation first")
        observation = np.atleast_1d(observations("observation", observation))
        if not finite_rows(observation).all():
            raise ValueError("observation must be finite, got a NaN or an infinity")
        if self.affine is not None:
            return self.affine.describe(self._flat(observation))[0]
        return np.concatenate([self._encoded(self._read_by_it(part)) for part in _parts(observation, math.prod(self.shape))])

    def reconstruct(self, descriptor: ArrayLike) -> np.ndarray:
        """Observations, (n, ...) float64 in the units of the task, reconstructed from descriptors, (n, d).

        Raises:
            RuntimeError: the descriptor is not learned, not fitted yet, or cannot reconstruct.
            ValueError: the descriptors are no numbers, or of the wrong shape.
        """
        if self.decode is None or self.scaler is None:
            raise RuntimeError(f"{self} cannot reconstruct observations: it has no inverse, or has not been fitted yet")
        z = numbers("descriptor", descriptor, " of shape (n, d)")
        if z.ndim != 2:
            raise ValueError(f"descriptor must have shape (n, d), got {z.shape}")
        try:
            x = np.asarray(self.decode(z), np.float64)
        except Exception as error:
            raise DescriptorError(f"the inverse of {self} raised, for descriptor of shape {z.shape}: {error}") from error
        rows = (x if self.raw else self.scaler.inverse(x)).reshape(len(z), *self.shape)
        return rows if self.layout is None else unflattened(rows, self.layout)

    def describe(self, individuals: Columns) -> tuple[np.ndarray, np.ndarray | None]:
        """Descriptors, (n, d) float64, and the root mean square error of each reconstruction, (n,), or None.

        The error is over the entries of an observation, on the [-1, 1] scale of the descriptor's input.

        Raises:
            DescriptorError: there is no ground truth to read, or the transformer raises or returns something else than (n, d).
        """
        if not self.learned:
            return self._read(individuals), None
        observation = individuals["observation"]
        if self.affine is not None:
            return self.affine.describe(self._flat(observation))
        described = [self._described(part) for part in _parts(observation, math.prod(self.shape))]
        z, errors = zip(*described, strict=True)
        return np.concatenate(z), None if errors[0] is None else np.concatenate(errors)

    def _described(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """As `describe`."""
        x = self._read_by_it(observation)
        if self.raw and self.decode is not None and hasattr(self.source, "describe"):
            return self.source.describe(x.reshape(len(x), *self.shape))  # pyright: ignore[reportAttributeAccessIssue]
        z = self._encoded(x)
        if self.decode is None:
            return z, None
        reconstruction = np.asarray(self.decode(z), np.float64)
        if reconstruction.shape != x.shape:
            raise DescriptorError(f"the inverse of {self} must return shape {x.shape}, got {reconstruction.shape}")
        assert self.scaler is not None  # it is ready
        difference = (reconstruction - x) * self.scaler.factor if self.raw else reconstruction - x
        return z, np.sqrt(np.einsum("ij,ij->i", difference, difference) / x.shape[1])

    def _flat(self, observation: np.ndarray) -> np.ndarray:
        """(n, ...) to (n, features)."""
        layout = layout_of(observation)
        if layout != self.layout:
            wanted = f"{described(self.layout)}, as those it was fitted on"
            raise DescriptorError(f"observation must be {wanted}, got {described(layout)}")
        if self.layout is not None:
            return flat(observation)
        if observation.shape[1:] != self.shape or observation.ndim == 0:
            raise DescriptorError(
                f"observation must have shape {rows_of(self.shape)}, as those it was fitted on, got {observation.shape}"
            )
        return observation.reshape(len(observation), math.prod(self.shape))

    def _read_by_it(self, observation: np.ndarray) -> np.ndarray:
        """Observations, (n, ...), as (n, features), scaled unless the transformer does that."""
        assert self.scaler is not None  # it is ready
        flat = self._flat(observation)
        return self.scaler.within(flat) if self.raw else self.scaler(flat)

    def _encoded(self, x: np.ndarray) -> np.ndarray:
        try:
            z = np.asarray(self.encode(x), np.float64)
        except Exception as error:
            raise DescriptorError(f"{self} raised {type(error).__name__}: {error}") from error
        if z.ndim != 2 or len(z) != len(x) or z.shape[1] == 0:
            raise DescriptorError(f"{self} must return shape ({len(x)}, descriptor dimensions), got {z.shape}")
        return z

    def _read(self, individuals: Columns) -> np.ndarray:
        if self.source == GENOTYPE:
            return individuals["genotype"]
        if "ground_truth" not in individuals:
            raise DescriptorError("a hand-coded descriptor reads the ground truth, but the task gives none")
        return np.asarray(individuals["ground_truth"], np.float64).reshape(individuals.rows, -1)


def _parts(observation: np.ndarray, features: int) -> list[np.ndarray]:
    """Rows of observations in parts that take little memory when they are scaled; as a whole, where that is little."""
    n = len(observation)
    rows = n if n * features <= _MOST_SCALED else max(1, _MOST_SCALED // features)
    return [observation[start : start + rows] for start in range(0, max(n, 1), max(rows, 1))]


def _scaled(scaler: Scaler, observation: np.ndarray) -> np.ndarray:
    """Observations, (n, ...), or streams, (n,), as (n, features), scaled: many in float32, a part at a time, to save memory."""
    n, features = len(observation), len(scaler.center)
    if n * features <= _MOST_IN_FULL:
        return scaler(flat(observation))
    x, start = np.empty((n, features), np.float32), 0
    for part in _parts(observation, features):
        x[start : start + len(part)] = scaler(flat(part))
        start += len(part)
    return x


def _seeded(transformer: Any, rng: np.random.Generator) -> Any:
    """The same object, its parameters called `random_state` that are None set to numbers."""
    if hasattr(transformer, "get_params") and hasattr(transformer, "set_params"):
        parameters = transformer.get_params().items()
        unseeded = sorted(name for name, value in parameters if name.split("__")[-1] == "random_state" and value is None)
        transformer.set_params(**{name: int(rng.integers(2**31)) for name in unseeded})
    return transformer


def _natural(transformer: Any) -> bool:
    """Whether the transformer takes observations in the shape of the task."""
    return bool(getattr(transformer, "natural_shape", False))


def _reads_raw(transformer: Any, shape: tuple[int, ...], dtype: np.dtype) -> bool:
    """Whether the transformer takes observations as they are."""
    asked = getattr(transformer, "reads_raw", None)
    return asked is not None and bool(asked(shape, dtype))


def _unchanged(x: np.ndarray) -> np.ndarray:
    return x


def _functions(transformer: Any, shape: tuple[int, ...]) -> tuple[Any, Any]:
    """`transform` and `inverse_transform` of a fitted transformer as functions of and to (n, features).

    The second is None where there is none that works: some transformers have one for some settings only.
    """
    encode, decode = transformer.transform, getattr(transformer, "inverse_transform", None)
    if _natural(transformer):
        encode = _Composed(encode, before=shape)
        decode = decode and _Composed(decode, after=(math.prod(shape),))
    return encode, decode if decode is not None and _works(transformer, encode, decode, math.prod(shape)) else None


def _works(transformer: Any, encode: Any, decode: Any, features: int) -> bool:
    """Whether there is an inverse. Why not is said, unless there is none: some transformers have one for some settings only."""
    wanted, found = (1, features), None
    try:
        found = np.shape(decode(encode(np.zeros(wanted))))
        reason = "" if found == wanted else f"it returns shape {found} for one observation, and not {wanted}"
    except Exception as error:
        # scikit-learn's KernelPCA has an inverse only if it is asked to fit one, and says so by a NotFittedError.
        none = isinstance(error, NotImplementedError) or type(error).__name__ == "NotFittedError"
        reason = "" if none else f"{type(error).__name__}: {error}"
    if reason:
        warnings.warn(
            f"the inverse_transform of {type(transformer).__name__} does not work, so there are no reconstructions and no "
            f"errors of them: {reason}",
            stacklevel=4,
        )
    return found == wanted


class _Composed(NamedTuple):
    """A function of rows that are reshaped before it, or whose results are reshaped after it."""

    function: Any
    before: tuple[int, ...] | None = None
    after: tuple[int, ...] | None = None

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        rows = self.function(rows if self.before is None else rows.reshape(len(rows), *self.before))
        return rows if self.after is None else rows.reshape(len(rows), *self.after)


def _is_small(encode: Any, features: int) -> bool:
    """Whether matrices pay for an affine function of (n, features)."""
    return features <= _FOLDED_FEATURES and np.shape(encode(np.zeros((1, features))))[1] <= _FOLDED_COMPONENTS


def _is_affine(transformer: Any) -> bool:
    """Whether `transform` is known to be affine: PCA, and linear pre-processing before it."""
    if not type(transformer).__module__.startswith("sklearn."):
        return False
    from sklearn import decomposition, pipeline, preprocessing

    if type(transformer) is pipeline.Pipeline:
        return all(step in (None, "passthrough") or _is_affine(step) for _, step in transformer.steps)
    affine = (
        decomposition.PCA,
        decomposition.IncrementalPCA,
        decomposition.TruncatedSVD,
        preprocessing.StandardScaler,
        preprocessing.MaxAbsScaler,
    )
    return type(transformer) in affine
