"""Streams described each by its own: a descriptor whose dimensions are those of several.

Joints, contacts and a camera are learned by what suits each of them, and their descriptors put beside each other. Each is so
scaled that the individuals it is fitted on lie as far from their mean as those of the others, whatever the transformers give:
then no stream drowns another in the distances that the archive looks at. Weights say what is to count more.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone

from auroraqd._checks import mapping, number, numbers, shown
from auroraqd.descriptors.descriptor import Descriptor, DescriptorError, Mismatch, Transformer
from auroraqd.descriptors.networks import Network
from auroraqd.descriptors.scaling import Scaling
from auroraqd.individuals import Columns
from auroraqd.observations import (
    check_same_streams,
    features_of,
    finite_rows,
    flat,
    has_streams,
    joined,
    layout_of,
    observations,
    streams_of,
    unflattened,
)

_PLAIN = bool, int, float, str, tuple, Network, type(None)  # parameters that are equal if they are alike
_LIGHTEST, _HEAVIEST = 1e-6, 1e6  # weights, whose squares are of use in float32


class _Part(NamedTuple):
    """What describes some of the streams, once it is fitted.

    Attributes:
        descriptor: of one stream, or of all.
        factor: its values are multiplied by.
        d: how many they are.
    """

    descriptor: Descriptor
    factor: float
    d: int


class Streams:
    """A learned descriptor of observations of several streams.

        auroraqd.Streams(joints=PCA(3), camera=auroraqd.AutoEncoder(2))
        auroraqd.Streams(PCA(3), weights={"camera": 0.5})

    Args:
        together: a transformer that gets all streams, as one that is given to `Aurora` by itself: scaled, flattened and joined.
            An `AutoEncoder` gets them as they are, and the weights in its network.
        weights: of streams by their names, from 1e-6 to 1e6, 1 where there is none: how much distances along each count.
        each: instead, a transformer for each stream, by its name; None leaves it out, also of one for all. See the module
            docstring.

    Raises:
        TypeError, ValueError: a transformer that is none, a weight out of range, or both kinds of transformers.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> from sklearn.decomposition import PCA
        >>> def robot(genotypes):
        ...     joints = np.cumsum(np.repeat(genotypes[:, None], 10, axis=1), axis=1)
        ...     return {"joints": joints, "contact": genotypes > 0.5}
        >>> descriptor = auroraqd.Streams(joints=PCA(2), contact=None)  # contacts are kept, and not described
        >>> aurora = auroraqd.Aurora(3, descriptor, seed=0).run(robot, generations=2)
        >>> aurora.archive.observation["joints"].shape[1:], aurora.archive.descriptor.shape[1:]
        ((10, 3), (2,))
    """

    __module__ = "auroraqd"

    def __init__(
        self, together: Transformer | None = None, /, *, weights: Mapping[str, float] | None = None, **each: Transformer | None
    ) -> None:
        if (together is None) == (not any(transformer is not None for transformer in each.values())):
            raise ValueError("Streams must be of one transformer for all, or of one for each: Streams(joints=PCA(3), ...)")
        self.together, self.each = together, each
        self.weights = {} if weights is None else dict(mapping("weights", weights))
        self._parts: dict[str, _Part] = {}
        self._like = np.empty(0)  # no rows, of the streams it was fitted on
        self.check_parameters()

    def __repr__(self) -> str:
        parts = [repr(self.together)] if self.together is not None else []
        parts += [f"weights={self.weights}"] if self.weights else []
        return f"Streams({', '.join([*parts, *(f'{name}={transformer!r}' for name, transformer in self.each.items())])})"

    def check_parameters(self) -> None:
        """Raise TypeError or ValueError where a parameter is wrong."""
        for name, transformer in self._transformers.items():
            if isinstance(transformer, type | Streams) or not isinstance(transformer, Transformer):
                raise TypeError(
                    f"Streams must be of objects with fit and transform, got {shown(transformer)} for {name or 'all'}"
                )
            if hasattr(transformer, "check_parameters"):
                transformer.check_parameters()  # pyright: ignore[reportAttributeAccessIssue]
        for name, weight in self.weights.items():
            if not isinstance(name, str):
                raise ValueError(f"weights must be of streams, by their names, got {shown(name)}")
            if name in self.each and self.each[name] is None:
                raise ValueError(f"weights must be of streams that are described, got {name}, which {name}=None leaves out")
            hint = f", and {name}=None leaves a stream out" if weight == 0 else ""
            number(
                f"weights[{name!r}]", weight, least=_LIGHTEST, most=_HEAVIEST, wanted=f"{_LIGHTEST:g} to {_HEAVIEST:g}{hint}"
            )

    @property
    def _transformers(self) -> dict[str, Transformer]:
        """By stream; one for all is called ""."""
        if self.together is not None:
            return {"": self.together}
        return {name: transformer for name, transformer in self.each.items() if transformer is not None}

    @property
    def fitted_(self) -> dict[str, Any]:
        """The fitted transformer of each stream, by its name; one for all is called ""."""
        return {name: part.descriptor.transformer for name, part in self._parts.items()}

    @property
    def n_components(self) -> int:
        """The most that one of its transformers has: more rows than that are needed to fit it."""
        found = [getattr(transformer, "n_components", 1) for transformer in self._transformers.values()]
        return max((int(n) for n in found if isinstance(n, int | np.integer)), default=1)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters of the transformers, as scikit-learn has them: `joints__random_state`."""
        transformers = {name or "together": t for name, t in self._transformers.items() if hasattr(t, "get_params")}
        return {f"{name}__{key}": v for name, t in transformers.items() for key, v in t.get_params().items()}  # pyright: ignore

    def set_params(self, **parameters: Any) -> Streams:
        """Set some of `get_params`, of what is fitted too."""
        known = self.get_params()
        for name, value in parameters.items():
            if name not in known:
                raise ValueError(f"Streams has no parameter {name!r}; it has {', '.join(known)}")
            which, _, parameter = name.partition("__")
            which = "" if which == "together" else which
            for transformer in (self._transformers[which], self.fitted_.get(which)):
                if transformer is not None:
                    transformer.set_params(**{parameter: value})  # pyright: ignore[reportAttributeAccessIssue]
        return self

    def __sklearn_clone__(self) -> Streams:
        """The same, not fitted: what `sklearn.base.clone` gives."""
        each: dict[str, Any] = {name: clone(given, safe=False) for name, given in self.each.items()}
        together: Any = clone(self.together, safe=False)
        return Streams(together, weights=self.weights, **each)

    def reads_raw(self, shape: tuple[int, ...], dtype: np.dtype) -> bool:
        """Whether observations of this shape, without the rows, and dtype are given to `fit` as they are: streams are."""
        return dtype.names is not None

    def fit(self, x: np.ndarray | Mapping[str, ArrayLike], y: object = None) -> Streams:
        """Learn from observations of streams, (n,), or a mapping of them; what was fitted before may go on. `y` is passed over.

        Raises:
            ValueError: they are no numbers.
            DescriptorError: they are not of the streams that there is something for, or a transformer cannot be fitted.
        """
        x = observations("x", x)
        if not has_streams(x):
            raise Mismatch("Streams must be fitted on streams, a mapping of names to arrays, got observations of one array")
        self._check_names(list(streams_of(x)))
        if len(x) == 0 or not finite_rows(x).all():
            raise ValueError(f"x must be finite, of one row at least, got {'a NaN or an infinity' if len(x) else 'no row'}")
        parts = {}
        for name, transformer in self._transformers.items():
            rows = self._read_by(name, x)
            transformer, weights = (transformer, None) if name else self._weighed(transformer, rows.dtype)
            before = self._parts[name].descriptor.transformer if name in self._parts else None
            source = before if before is not None and _alike(before, transformer) else transformer
            try:
                descriptor = Descriptor(source).refitted(rows, weights=weights)
            except DescriptorError as error:
                raise type(error)(f"{name}: {error}" if name else str(error)) from error
            z = descriptor.describe_observation(rows)
            spread = float(np.sqrt(z.var(axis=0).sum())) if name else 1.0
            weight = self.weights.get(name, 1.0)
            parts[name] = _Part(descriptor, weight / spread if spread > 0 else weight, z.shape[1])
        self._parts, self._like = parts, x[:0].copy()
        self.scaling_ = Scaling.of(x, self.weights)
        return self

    def _read_by(self, name: str, x: np.ndarray) -> np.ndarray:
        """What of observations the transformer of a stream reads; the one for all, "", what is not left out."""
        if name:
            return x[name]
        names = [stream for stream in streams_of(x) if stream not in self.each]
        return x if len(names) == len(streams_of(x)) else x[names]

    def _weighed(self, together: Any, dtype: np.dtype) -> tuple[Transformer, dict[str, float]]:
        """What gets all streams, and the weights of a joint scaling: none where it has them itself."""
        itself = together.weighed(dtype, self.weights) if self.weights and hasattr(together, "weighed") else None
        return (together, self.weights) if itself is None else (itself, {})

    def _check_names(self, names: list[str]) -> None:
        missing = [] if self.together is not None else [name for name in names if name not in self.each]
        if missing:
            known = f", got {', '.join(self.each)}"
            raise Mismatch(
                f"Streams must say how to describe {', '.join(missing)} (None leaves it out), of {', '.join(names)}{known}"
            )
        unknown = [name for name in [*self.each, *self.weights] if name not in names]
        if unknown:
            raise Mismatch(f"Streams must be of streams that are observed, {', '.join(names)}, got {', '.join(unknown)}")

    @property
    def raw_(self) -> bool:
        """Whether it reads observations as they are."""
        return True

    def transform(self, x: np.ndarray | Mapping[str, ArrayLike]) -> np.ndarray:
        """Descriptors, (n, d), of streams, (n,), or a mapping of them, or of all their entries, (n, features).

        Raises:
            RuntimeError: `fit` has not been called.
            ValueError: they are none, others than it was fitted on, or not finite.
        """
        streams = self._streams(x)
        parts = self._parts.items()
        return np.hstack(
            [part.factor * part.descriptor.describe_observation(self._read_by(name, streams)) for name, part in parts]
        )

    def describe(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Descriptors, (n, d), and the root mean squares, (n,), of the errors of reconstructions that the parts have."""
        streams = self._streams(x)
        values, squares = [], []
        for name, part in self._parts.items():
            z, error = part.descriptor.describe(Columns({"observation": self._read_by(name, streams)}))
            values.append(part.factor * z)
            assert error is not None  # or there would be no inverse
            squares.append(error**2)
        return np.hstack(values), np.sqrt(np.mean(squares, axis=0))

    def inverse_transform(self, z: np.ndarray) -> np.ndarray:
        """Entries of streams, (n, features), expected at descriptors, (n, d); of one that is left out, its middle.

        Raises:
            RuntimeError: `fit` has not been called.
            ValueError: wrong shape.
            NotImplementedError: one of the transformers has no inverse.
        """
        self._check_fitted()
        z, d = numbers("z", z, " of shape (n, d)", axes=2), sum(part.d for part in self._parts.values())
        if z.shape[1] != d:
            raise ValueError(f"z must have shape (n, {d}), got {z.shape}")
        if any(part.descriptor.decode is None for part in self._parts.values()):
            raise NotImplementedError("a stream cannot be reconstructed")
        n, layout = len(z), layout_of(self._like)
        assert layout is not None
        middle = self.scaling_.low / 2 + self.scaling_.high / 2
        found = {name: stream.copy() for name, stream in streams_of(unflattened(np.tile(middle, (n, 1)), layout)).items()}
        start = 0
        for name, part in self._parts.items():
            rows = part.descriptor.reconstruct(z[:, start : start + part.d] / part.factor)
            found.update({name: rows} if name else streams_of(rows))
            start += part.d
        return flat(joined(found))

    def _check_fitted(self) -> None:
        if not self._parts:
            raise RuntimeError("Streams must be fitted before they describe anything: call fit first")

    def _streams(self, x: np.ndarray | Mapping[str, ArrayLike]) -> np.ndarray:
        """As they were observed."""
        self._check_fitted()
        layout = layout_of(self._like)
        assert layout is not None  # it is fitted
        if isinstance(x, np.ndarray) and layout_of(x) == layout:  # as in each generation
            return x
        if isinstance(x, Mapping) or (isinstance(x, np.ndarray) and has_streams(x)):
            x = observations("x", x)
            check_same_streams("x", x, self._like)
            return x
        x, features = numbers("x", x, " of shape (n, features)", axes=2, finite=True), features_of(self._like)
        if x.shape[1] != features:
            raise ValueError(f"x must have shape (n, {features}), got {x.shape}")
        kinds = {name: stream.dtype for name, stream in streams_of(self._like).items()}
        rows = unflattened(x, layout)
        return joined({name: stream.astype(kinds[name]) for name, stream in streams_of(rows).items()})

    def __getstate__(self) -> dict[str, Any]:
        parts = [
            {
                "name": name,
                "transformer": part.descriptor.source,
                "low": part.descriptor.scaling.low,  # pyright: ignore[reportOptionalMemberAccess]
                "high": part.descriptor.scaling.high,  # pyright: ignore[reportOptionalMemberAccess]
                "limit": part.descriptor.scaling.limit,  # pyright: ignore[reportOptionalMemberAccess]
                "shape": list(part.descriptor.shape),
                "factor": part.factor,
                "d": part.d,
            }
            for name, part in self._parts.items()
        ]
        given = {"together": self.together, "each": self.each, "weights": self.weights}
        if not parts:
            return given
        like = [[name, stream.dtype.str, list(stream.shape[1:])] for name, stream in streams_of(self._like).items()]
        return {**given, "parts": parts, "like": like, **self.scaling_._asdict()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.together, self.each, self.weights = state["together"], dict(state["each"]), dict(state["weights"])
        self._parts, self._like = {}, np.empty(0)
        if "parts" not in state:
            return
        self._like = joined({name: np.empty((0, *shape), kind) for name, kind, shape in state["like"]})
        for part in state["parts"]:
            layout = None if part["name"] else layout_of(self._read_by("", self._like))
            scaling = Scaling(part["low"], part["high"], part["limit"])
            descriptor = Descriptor(copy.copy(part["transformer"])).restored(scaling, tuple(part["shape"]), layout)
            self._parts[part["name"]] = _Part(descriptor, part["factor"], part["d"])
        self.scaling_ = Scaling(state["low"], state["high"], state["limit"])


def _alike(fitted: Any, given: Any) -> bool:
    """Whether a transformer that was fitted has the parameters of one that is given, so that it may go on."""
    if not hasattr(given, "get_params"):
        return True
    one, other = (
        {name: value for name, value in transformer.get_params().items() if isinstance(value, _PLAIN)}
        for transformer in (fitted, given)
    )
    return one == other
