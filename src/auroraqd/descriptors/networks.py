"""Networks of the auto-encoder, as values: what they are made of, how they read observations, and what they minimise.

`AutoEncoder(network=...)` takes one of these, or its name; "auto" chooses by the shape and the dtype of the observations. One
of your own derives from `Network`. Nothing here imports JAX before a network is built.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from auroraqd._checks import number, rows_of, whole, wholes
from auroraqd.descriptors.distances import flat, multiscale, rhythms
from auroraqd.descriptors.scaling import Scaling
from auroraqd.observations import described, layout_of

if TYPE_CHECKING:
    from auroraqd.descriptors.layers import AutoEncoderNetwork

Array = Any  # of JAX
MOST_WIDTH = 10**6  # of a layer
_SMALLEST, LARGEST, _MOST_CHANNELS = 16, 128, 16  # of images: pixels a side, and channels, a few frames among them
_MOST_COLOURS = 4
_MOST_ENTRIES = 1000  # of a time series: its convolutions are products with square matrices of this size
_LONG = 100  # steps of a time series for which a recurrent network is better
_GRID = 16  # cells a side, at most, after the first layer for images
_LEAST_VARIANCE = 1e-5  # of an entry: images may all be the same
_COARSE = 4  # cells a side, at most, before the dense layers


class Network(ABC):
    """What an auto-encoder is made of. A frozen dataclass with numbers, texts or tuples of these as fields.

    Attributes:
        raw: whether mini-batches are read from the observations as they are, in their dtype, and scaled one at a time.
        geodesic: whether `metric="auto"` stands for shortest paths; and if not,
        measures: whether it stands for distances of what is `measured`.
        rate: times the learning rate of the `AutoEncoder`: wide or deep networks need a smaller one.
    """

    raw: ClassVar[bool] = True
    geodesic: ClassVar[bool] = False
    measures: ClassVar[bool] = False
    rate: ClassVar[float] = 1.0

    @property
    def steps(self) -> int | None:
        """The most steps of the optimiser in a repeat; None: no limit but the epochs."""
        return None

    def check(self) -> None:
        """Raise ValueError where a field is out of range."""
        return None

    def check_shape(self, shape: tuple[int, ...]) -> None:
        """Raise ValueError where observations of this shape, without the rows, are none that it takes.

        Of streams, it is the shape of a row of all their entries.
        """
        return None

    def scaling(self, observation: np.ndarray) -> Scaling:
        """How observations, (n, ...), are scaled: each channel by its range."""
        return Scaling.of(observation)

    def groups(self, features: int) -> tuple[int, ...]:
        """How many entries of a row belong together: those of each stream. There is a variance of each group."""
        return (features,)

    @abstractmethod
    def build(self, shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
        """An encoder and a decoder with random weights, for rows of scaled observations of this shape, flattened."""

    def loss(self, x: Array, reconstruction: Array, variance: Array) -> Array:
        """What is minimised, (n,), of scaled rows, (n, features), and their reconstructions: the squared error, summed.

        Args:
            x, reconstruction: of JAX.
            variance: the mean over the rows of their squared distance to the mean row; of several groups one each.
        """
        return ((reconstruction - x) ** 2).sum(axis=1)

    def measured(self, observation: np.ndarray, scaling: Scaling) -> np.ndarray:
        """Rows, (n, m) float32, whose distances say how much observations, (n, ...), differ from those close to them."""
        return flat(observation, scaling)


@dataclass(frozen=True)
class MLP(Network):
    """Dense layers with tanh between them, for observations of any shape.

    Args:
        hidden: their widths, from input to latent space; mirrored in the decoder.

    Examples:
        >>> import auroraqd
        >>> from auroraqd.descriptors.networks import MLP
        >>> auroraqd.AutoEncoder(n_components=2, network=MLP(hidden=(64, 32)))
        AutoEncoder(network=MLP(hidden=(64, 32)))
    """

    hidden: Sequence[int] = (128, 64, 32)
    raw: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if isinstance(self.hidden, list):
            object.__setattr__(self, "hidden", tuple(self.hidden))  # a value can be hashed

    def check(self) -> None:
        """See `Network`."""
        wholes("hidden", self.hidden, "widths of layers like (128, 64)", most=MOST_WIDTH)

    def build(self, shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
        """See `Network`."""
        from auroraqd.descriptors.layers import AutoEncoderNetwork, dense_layers

        widths = [math.prod(shape), *self.hidden, n_components]
        return AutoEncoderNetwork(dense_layers(widths, rng), dense_layers(widths[::-1], rng))


@dataclass(frozen=True)
class Convolutional(Network):
    """The network of the AURORA paper, for short time series, (steps, channels): 11,809 parameters for (50, 2).

    Sec. "Experimental validation"; sizes, kernels and activations from the authors' re-released ballistic example.
    """

    raw: ClassVar[bool] = False
    _maps: ClassVar[int] = 2
    _dense: ClassVar[int] = 5

    def check_shape(self, shape: tuple[int, ...]) -> None:
        """See `Network`."""
        _check_sequence("convolutional", shape)
        if math.prod(shape) > _MOST_ENTRIES:
            raise ValueError(
                f"network 'convolutional' takes time series of at most {_MOST_ENTRIES} entries, got {shape[0]} steps of "
                f"{shape[1]} channels: network 'mlp' takes any"
            )

    def build(self, shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
        """See `Network`."""
        from auroraqd.descriptors.layers import AutoEncoderNetwork, Convolution, Dense, MaxPooling

        features, maps = math.prod(shape), self._maps
        encoder = (
            Convolution.random(shape, 1, maps, rng),
            MaxPooling(shape, maps),
            Dense.random(maps * features, self._dense, "tanh", rng),
            Dense.random(self._dense, n_components, "linear", rng),
        )
        decoder = (
            Dense.random(n_components, self._dense, "tanh", rng),
            Dense.random(self._dense, features, "tanh", rng),
            Convolution.random(shape, 1, maps, rng),
            Convolution.random(shape, maps, 1, rng),
            Dense.random(features, features, "linear", rng),
        )
        return AutoEncoderNetwork(encoder, decoder)


@dataclass(frozen=True)
class Image(Network):
    """Strided convolutions, for images (h, w) or (h, w, channels) of 16 to 128 pixels a side, a few frames as channels.

    Whole numbers of eight bits are scaled by 255, and numbers in [0, 1] are taken as they are: the background stays where it
    is. Others are scaled by their range. The squared error counts as a share of the variance of the observations, so that it
    weighs the same for images of all sizes.

    Args:
        maps: of the convolutions, from the first, whose stride leaves a grid of at most 16 x 16, to the last; each further one
            halves the grid, down to 4 x 4 at the least.
        hidden: width of the dense layer before the latent space.
        error: weight of the squared error.
        steps: the most steps of the optimiser in a repeat.

    Examples:
        >>> import auroraqd
        >>> from auroraqd.descriptors.networks import Image
        >>> auroraqd.AutoEncoder(n_components=2, network=Image(maps=(16, 32), steps=100)).network.maps
        (16, 32)
    """

    maps: Sequence[int] = (16, 32, 32)
    hidden: int = 128
    error: float = 20.0
    steps: int = 200  # pyright: ignore[reportIncompatibleMethodOverride]
    geodesic: ClassVar[bool] = True
    rate: ClassVar[float] = 0.2

    def __post_init__(self) -> None:
        if isinstance(self.maps, list):
            object.__setattr__(self, "maps", tuple(self.maps))  # a value can be hashed

    def check(self) -> None:
        """See `Network`."""
        if not wholes("maps", self.maps, "numbers of maps like (16, 32)", most=MOST_WIDTH):
            raise ValueError("maps must be numbers of maps like (16, 32), one at least, got none")
        whole("hidden", self.hidden, most=MOST_WIDTH)
        number("error", self.error)
        whole("steps", self.steps)

    def check_shape(self, shape: tuple[int, ...]) -> None:
        """See `Network`."""
        if not is_image(shape):
            raise ValueError(
                f"network 'image' is for images, observations of shape (n, height, width) or (n, height, width, channels), "
                f"from {_SMALLEST} to {LARGEST} pixels a side and of at most {_MOST_CHANNELS} channels, got {rows_of(shape)}"
            )

    def scaling(self, observation: np.ndarray) -> Scaling:
        """See the class."""
        return Scaling.pixels(observation.reshape(len(observation), *_with_channels(observation.shape[1:])))

    def build(self, shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
        """See `Network`."""
        from auroraqd.descriptors.layers import image_network

        return image_network(_with_channels(shape), n_components, self.maps, self.hidden, (_GRID, _COARSE), rng)

    def loss(self, x: Array, reconstruction: Array, variance: Array) -> Array:
        """See the class."""
        return self.error * _share(x, reconstruction, variance)

    def measured(self, observation: np.ndarray, scaling: Scaling) -> np.ndarray:
        """Blurred, at several scales: distances of sharp images say nothing as soon as what is seen does not overlap."""
        return multiscale(observation.reshape(len(observation), *_with_channels(observation.shape[1:])), scaling)


@dataclass(frozen=True)
class Recurrent(Network):
    """Gated recurrent units, sequence to sequence, for long time series of many channels, (steps, channels).

    One layer reads the sequence, another tells it again. The squared error counts as of `Image`. Distances are those of
    rhythms: see `auroraqd.descriptors.distances.rhythms`.

    Args:
        units: of each layer.
        updates: of their states, at most: of a longer sequence several steps are read together.
        error: weight of the squared error.
        steps: the most steps of the optimiser in a repeat.

    Examples:
        >>> import auroraqd
        >>> from auroraqd.descriptors.networks import Recurrent
        >>> auroraqd.AutoEncoder(n_components=2, network=Recurrent(units=32)).network.units
        32
    """

    units: int = 64
    updates: int = 25
    error: float = 20.0
    steps: int = 200  # pyright: ignore[reportIncompatibleMethodOverride]
    measures: ClassVar[bool] = True
    rate: ClassVar[float] = 0.3

    def check(self) -> None:
        """See `Network`."""
        whole("units", self.units, most=MOST_WIDTH)
        whole("updates", self.updates, most=MOST_WIDTH)
        number("error", self.error)
        whole("steps", self.steps)

    def check_shape(self, shape: tuple[int, ...]) -> None:
        """See `Network`."""
        _check_sequence("recurrent", shape)

    def build(self, shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
        """See `Network`."""
        from auroraqd.descriptors.layers import recurrent_network

        return recurrent_network((shape[0], shape[1]), n_components, self.units, self.updates, rng)

    def loss(self, x: Array, reconstruction: Array, variance: Array) -> Array:
        """See the class."""
        return self.error * _share(x, reconstruction, variance)

    def measured(self, observation: np.ndarray, scaling: Scaling) -> np.ndarray:
        """Rhythms: distances between sequences say nothing once they are out of step."""
        return rhythms(observation, scaling)


@dataclass(frozen=True)
class Fused(Network):
    """A network for each stream, fused into one latent space: an encoder each, dense layers that read what all give, and back.

    Errors are balanced: of each stream the squared error counts as a share of the variance of that stream, and all streams
    alike. So do distances: those of each stream are over their spread, as its own network measures them.

    Args:
        parts: of each stream its name, the shape of a row and its network; in the order of their names.
        width: what each encoder gives, and each decoder reads.
        hidden: width of the dense layers between.
        error: weight of the squared error.
        steps: the most steps of the optimiser in a repeat.
        weights: how much distances along each stream count, in the order of `parts`; none: 1 each. Errors count by their
            squares.

    Examples:
        >>> import numpy as np
        >>> from auroraqd.descriptors.networks import Fused
        >>> Fused.of(np.dtype([("camera", np.uint8, (32, 32)), ("joints", float, (20, 4))]))
        Fused(camera=Image(), joints=MLP())
    """

    parts: tuple[tuple[str, tuple[int, ...], Network], ...]
    width: int = 16
    hidden: int = 64
    error: float = 20.0
    steps: int = 200  # pyright: ignore[reportIncompatibleMethodOverride]
    weights: tuple[float, ...] = ()
    measures: ClassVar[bool] = True

    @classmethod
    def of(cls, dtype: np.dtype, hidden: Sequence[int] = MLP.hidden) -> Fused:
        """What `network="auto"` stands for, of streams with this structured dtype; `hidden` is of those that are an `MLP`."""
        kinds = [(name, dtype[name].base, dtype[name].shape) for name in dtype.names or ()]
        return cls(tuple((name, shape or (1,), chosen(shape or (1,), base, hidden)) for name, base, shape in kinds))

    def weighed(self, weights: Mapping[str, float]) -> Fused:
        """The same, with weights of streams by their names, 1 where there is none."""
        return replace(self, weights=tuple(float(weights.get(name, 1.0)) for name, _, _ in self.parts))

    def __repr__(self) -> str:
        parts = [f"{name}={_briefly(network)}" for name, _, network in self.parts]
        return f"Fused({', '.join([*parts, *([f'weights={self.weights}'] if self.weights else [])])})"

    @property
    def geodesic(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether that of a stream is."""
        return any(network.geodesic for _, _, network in self.parts)

    @property
    def rate(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The least of the streams."""
        return min(network.rate for _, _, network in self.parts)

    def check(self) -> None:
        """See `Network`."""
        if not self.parts:
            raise ValueError("parts must be of one stream at least, got none")
        for _, shape, network in self.parts:
            network.check()
            network.check_shape(shape)
        for name in ("width", "hidden"):
            whole(name, getattr(self, name), most=MOST_WIDTH)
        number("error", self.error)
        whole("steps", self.steps)
        if self.weights and (len(self.weights) != len(self.parts) or not all(weight > 0 for weight in self.weights)):
            raise ValueError(f"weights must be {len(self.parts)} numbers above 0, one for each stream, got {self.weights}")

    def check_streams(self, observation: np.ndarray) -> None:
        """Raise ValueError where observations, (n, ...) or (n,) of streams, are none that it takes."""
        layout = layout_of(observation)
        found = None if layout is None else tuple((name, shape or (1,)) for name, shape in layout)
        wanted = tuple((name, shape) for name, shape, _ in self.parts)
        if found != wanted:
            raise ValueError(f"network 'Fused' takes {described(wanted)}, got {described(found)}")

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(math.prod(shape) for _, shape, _ in self.parts)

    @property
    def _counts(self) -> tuple[float, ...]:
        return self.weights or (1.0,) * len(self.parts)

    def groups(self, features: int) -> tuple[int, ...]:
        """See `Network`."""
        return self._sizes

    def scaling(self, observation: np.ndarray) -> Scaling:
        """Each stream as its network does it."""
        ends = [
            (np.tile(scaling.low, n // len(scaling.low)), np.tile(scaling.high, n // len(scaling.high)))
            for scaling, n in zip(self._scalings(observation), self._sizes, strict=True)
        ]
        low, high = (np.concatenate(end) for end in zip(*ends, strict=True))
        return Scaling(low, high)

    def _scalings(self, observation: np.ndarray) -> list[Scaling]:
        return [network.scaling(rows) for network, rows in self._rows(observation)]

    def _rows(self, observation: np.ndarray) -> list[tuple[Network, np.ndarray]]:
        """Of each stream its network, and its rows."""
        return [(network, observation[name].reshape(len(observation), *shape)) for name, shape, network in self.parts]

    def build(self, shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
        """See `Network`."""
        from auroraqd.descriptors.layers import fused_network

        parts = [network.build(part, self.width, rng) for _, part, network in self.parts]
        return fused_network(parts, self._sizes, n_components, self.width, self.hidden, rng)

    def loss(self, x: Array, reconstruction: Array, variance: Array) -> Array:
        """See the class."""
        ends, variances = np.cumsum(self._sizes).tolist(), variance.reshape(-1)  # of one stream it is a number
        squares = [count**2 for count in self._counts]
        shares = [
            squares[i] * _share(x[:, end - size : end], reconstruction[:, end - size : end], variances[i])
            for i, (size, end) in enumerate(zip(self._sizes, ends, strict=True))
        ]
        return self.error * sum(shares) / sum(squares)

    def measured(self, observation: np.ndarray, scaling: Scaling) -> np.ndarray:
        """What the network of each stream measures, over its spread, times its weight."""
        found = []
        for (network, rows), count in zip(self._rows(observation), self._counts, strict=True):
            part = network.measured(rows, network.scaling(rows))
            spread = np.sqrt(part.var(axis=0, dtype=np.float64).sum())
            found.append(np.float32(count) * (part / np.float32(spread) if spread > 0 else part))
        return np.concatenate(found, axis=1)


def _briefly(network: Network) -> str:
    """What differs from the defaults."""
    known = fields(network)  # pyright: ignore[reportArgumentType] - all are dataclasses
    given = [f"{f.name}={getattr(network, f.name)!r}" for f in known if getattr(network, f.name) != f.default]
    return f"{type(network).__name__}({', '.join(given)})"


NAMED: dict[str, type[Network]] = {"mlp": MLP, "convolutional": Convolutional, "image": Image, "recurrent": Recurrent}
NAMES = ("auto", *NAMED)


def chosen(shape: tuple[int, ...], dtype: np.dtype, hidden: Sequence[int]) -> Network:
    """The network for observations of this shape, without the rows, and dtype: what `network="auto"` stands for.

    Streams are fused, each by what is chosen for it alone.

    (h, w, channels) is an image if its sides are 16 to 128, and so is (h, w) of whole numbers of eight bits. (steps, channels)
    is a long time series from 100 steps and 1,000 entries on. All else is for dense layers.
    """
    if dtype.names is not None:
        return Fused.of(dtype, hidden)
    if is_image(shape) and (len(shape) == 3 or dtype == np.uint8):
        return Image()
    if len(shape) == 2 and shape[0] >= _LONG and math.prod(shape) >= _MOST_ENTRIES:
        return Recurrent()
    return MLP(tuple(hidden))


def is_image(shape: tuple[int, ...]) -> bool:
    """Whether observations of this shape can be images."""
    sides = all(_SMALLEST <= side <= LARGEST for side in shape[:2])
    return len(shape) in (2, 3) and sides and _with_channels(shape)[2] <= _MOST_CHANNELS


def is_large_image(shape: tuple[int, ...], dtype: np.dtype) -> bool:
    """Whether observations of this shape and dtype look like images, but have more pixels a side than `Image` takes."""
    colours = len(shape) == 2 or (len(shape) == 3 and shape[2] <= _MOST_COLOURS)
    return dtype == np.uint8 and colours and min(shape[:2]) >= _SMALLEST and max(shape[:2]) > LARGEST


def _check_sequence(name: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless observations of this shape, without the rows, are time series."""
    if len(shape) != 2:
        raise ValueError(
            f"network '{name}' is for time series, observations of shape (n, steps, channels), got {rows_of(shape)}: network "
            "'mlp' takes any shape"
        )


def _share(x: Array, reconstruction: Array, variance: Array) -> Array:
    """Squared errors, (n,), as shares of the variance of the observations: they weigh the same whatever the shape."""
    return ((reconstruction - x) ** 2).sum(axis=1) / (variance + _LEAST_VARIANCE * x.shape[1])


def _with_channels(shape: tuple[int, ...]) -> tuple[int, int, int]:
    return (shape[0], shape[1], shape[2] if len(shape) == 3 else 1)
