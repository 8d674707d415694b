"""Layers of auto-encoders: Equinox modules that map rows to rows.

Dense ones work on JAX arrays, for training, and on NumPy arrays of any precision, for use: in float64, a copy in another batch
differs by rounding only, and nothing has to be compiled for batches of many sizes. The others are for JAX; what stands for them
in use says `auroraqd.descriptors.inference`.
"""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from auroraqd.descriptors.distances import blurs

Array = Any  # of NumPy or of JAX

KERNEL = (6, 2)  # steps, channels
LEAK = 0.2  # slope of the rectifier below 0
_BLOCK = KERNEL[0] - 1  # steps of a sequence that come out of a product: it reads these and as many more
BEFORE = (KERNEL[0] - 1) // 2  # steps that a kernel reaches back; of channels none
_MOST_OVERLAP = 2  # stride of kernels that overlap: those of larger ones would take most of the time


_MOST_LOGARITHM = 10.0  # of a variance in latent space, and of its inverse, as shares of
_FIRST_LOGARITHM = -4.0  # that of weights that are not trained: little noise, as long as the means are to be found


class AutoEncoderNetwork(eqx.Module):
    """An encoder and a decoder.

    Attributes:
        encoder: layers from (n, features) to (n, n_components).
        decoder: layers from there back to (n, features).
        variance: of a variational one, what reads the same as the last layer of the encoder: see `posterior`.
    """

    encoder: tuple[eqx.Module, ...]
    decoder: tuple[eqx.Module, ...]
    variance: Any = None

    def variational(self) -> "AutoEncoderNetwork":
        """The same with variances of latent positions, which are the same for all rows as yet."""
        nothing = jax.tree.map(np.zeros_like, self.encoder[-1])
        return AutoEncoderNetwork(self.encoder, self.decoder, nothing)

    def posterior(self, x: Array) -> tuple[Array, Array]:
        """Of a variational one: latent means, and logarithms of the variances about them, (n, n_components) each."""
        *first, last = self.encoder
        read = through(first, x)
        logarithm = _MOST_LOGARITHM * jnp.tanh(self.variance(read) / _MOST_LOGARITHM)
        return last(read), _FIRST_LOGARITHM + logarithm  # pyright: ignore[reportCallIssue]

    def encode(self, x: Array) -> Array:
        """(n, features) to (n, n_components)."""
        return through(self.encoder, x)

    def decode(self, z: Array) -> Array:
        """(n, n_components) to (n, features)."""
        return through(self.decoder, z)


def through(layers: Sequence[Any], x: Array) -> Array:
    """Rows after all of these layers."""
    for layer in layers:
        x = layer(x)
    return x


def dense_layers(widths: Sequence[int], rng: np.random.Generator) -> tuple["Dense", ...]:
    """Dense layers between these widths; tanh inside, linear at the end."""
    activations = ["tanh"] * (len(widths) - 2) + ["linear"]
    return tuple(Dense.random(a, b, name, rng) for a, b, name in zip(widths, widths[1:], activations, strict=False))


def image_network(
    shape: tuple[int, int, int],
    n_components: int,
    maps: Sequence[int],
    hidden: int,
    grid: tuple[int, int],
    rng: np.random.Generator,
) -> AutoEncoderNetwork:
    """Strided convolutions and dense layers, and the same back, for rows of images of shape (h, w, channels).

    The dense layer reads the image blurred at several scales as well, which changes smoothly with what is seen: with it, images
    unlike those trained on are placed far better.

    Args:
        shape: of an image.
        n_components: size of the latent space.
        maps: of the convolutions; the last ones are left out where the grid is small enough without.
        hidden: width of the dense layer.
        grid: cells a side, at most, after the first convolution, and before the dense layer.
        rng: for the weights.
    """
    shapes, strides = [shape], []
    for count in maps:
        longest, first = max(shapes[-1][:2]), not strides
        if not first and longest <= grid[1]:
            break
        strides.append(-(-longest // grid[0]) if first else 2)
        height, width = (-(-side // strides[-1]) for side in shapes[-1][:2])
        shapes.append((height, width, count))
    inside, convolutions, back = math.prod(shapes[-1]), [], []
    for i, stride in enumerate(strides):
        overlap = stride <= _MOST_OVERLAP
        convolutions.append(Strided.random(shapes[i], stride, shapes[i + 1][2], "silu", rng, overlap))
        activation = "silu" if i else "linear"
        back.insert(0, Unstrided.random(shapes[i + 1], stride, shapes[i], activation, rng, overlap))
    encoder = (
        Beside((Scales(shape),), tuple(convolutions)),
        Dense.random(sum(a.shape[0] * b.shape[0] for a, b in blurs(*shape[:2])) * shape[2] + inside, hidden, "silu", rng),
        Dense.random(hidden, n_components, "linear", rng),
    )
    decoder = (
        Dense.random(n_components, hidden, "silu", rng),
        Dense.random(hidden, hidden, "silu", rng),
        Dense.random(hidden, inside, "silu", rng),
        *back,
        Offset(np.zeros(math.prod(shape), np.float32)),
    )
    return AutoEncoderNetwork(encoder, decoder)


def recurrent_network(
    shape: tuple[int, int], n_components: int, units: int, most: int, rng: np.random.Generator
) -> AutoEncoderNetwork:
    """Gated recurrent units that read a sequence, and such that tell it, for rows of shape (steps, channels).

    Args:
        shape: of a sequence.
        n_components: size of the latent space.
        units: of each of the two layers.
        most: updates of their states, at most: as many steps as needed are read together.
        rng: for the weights.
    """
    together = -(-shape[0] // most)
    encoder = (Reader.random(shape, together, units, rng), Dense.random(2 * units, n_components, "linear", rng))
    decoder = (
        Dense.random(n_components, units, "tanh", rng),
        Teller.random(shape, together, units, rng),
        Offset(np.zeros(math.prod(shape), np.float32)),
    )
    return AutoEncoderNetwork(encoder, decoder)


def fused_network(
    parts: Sequence[AutoEncoderNetwork],
    sizes: Sequence[int],
    n_components: int,
    width: int,
    hidden: int,
    rng: np.random.Generator,
) -> AutoEncoderNetwork:
    """One latent space of several networks: dense layers between what their encoders give and their decoders read.

    Args:
        parts: networks with `width` components each.
        sizes: entries that each of them reads.
        n_components: size of the latent space.
        width, hidden: of what is between.
        rng: for the weights.
    """
    beside = width * len(parts)
    encoder = (
        Each(tuple(part.encoder for part in parts), tuple(sizes)),
        Dense.random(beside, hidden, "silu", rng),
        Dense.random(hidden, n_components, "linear", rng),
    )
    decoder = (
        Dense.random(n_components, hidden, "silu", rng),
        Dense.random(hidden, beside, "linear", rng),
        Each(tuple(part.decoder for part in parts), (width,) * len(parts)),
    )
    return AutoEncoderNetwork(encoder, decoder)


class Dense(eqx.Module):
    """A fully connected layer."""

    weight: Array  # (inputs, outputs)
    bias: Array  # (outputs,)
    activation: str = eqx.field(static=True)

    @classmethod
    def random(cls, inputs: int, outputs: int, activation: str, rng: np.random.Generator) -> "Dense":
        """Weights uniform with the variance 2 / (inputs + outputs) [Glorot & Bengio, AISTATS 2010]."""
        return cls(_glorot((inputs, outputs), inputs + outputs, rng), np.zeros(outputs, np.float32), activation)

    def __call__(self, x: Array) -> Array:
        """(n, inputs) to (n, outputs)."""
        return _activated(self.activation, x @ self.weight + self.bias)


class Convolution(eqx.Module):
    """A convolution over (steps, channels) images, zeros around them so that they keep their size, and a leaky rectifier.

    Rows are images laid out as (steps, maps, channels). On a CPU, XLA's convolution of so few maps takes several times as long
    as products with a matrix that does the same for a block of steps, which reads two; so that is how it is done.
    """

    kernel: Array  # (maps in, maps out, KERNEL entries)
    bias: Array  # (maps out,)
    shape: tuple[int, int] = eqx.field(static=True)  # steps, channels

    @classmethod
    def random(cls, shape: tuple[int, ...], maps_in: int, maps_out: int, rng: np.random.Generator) -> "Convolution":
        """As `Dense.random`."""
        taps = math.prod(KERNEL)
        kernel = _glorot((maps_in, maps_out, taps), taps * (maps_in + maps_out), rng)
        return cls(kernel, np.zeros(maps_out, np.float32), (shape[0], shape[1]))

    def __call__(self, x: Array) -> Array:
        """(n, steps * maps in * channels) to (n, steps * maps out * channels)."""
        steps, n = self.shape[0], len(x)
        blocks = -(-steps // _BLOCK)
        weight = self._weight()
        read, given = weight.shape
        entries = (read - 1) // (2 * _BLOCK)  # of a step
        after = (blocks + 1) * _BLOCK - BEFORE - steps
        x = jnp.pad(x, ((0, 0), (BEFORE * entries, after * entries))).reshape(n, blocks + 1, _BLOCK * entries)
        pairs = jnp.concatenate([x[:, :-1], x[:, 1:], jnp.ones((n, blocks, 1), x.dtype)], axis=2)
        block = pairs.reshape(n * blocks, read) @ weight
        block = block.reshape(n, blocks * given)[:, : steps * (given // _BLOCK)]
        return _larger(block, LEAK * block)

    def _weight(self) -> Array:
        """(entries of two blocks in and 1, of a block out): all there is in one product, the bias too."""
        maps_in, maps_out, taps = self.kernel.shape
        channels = self.shape[1]
        matrix = self.kernel.reshape(-1, taps) @ _placements(channels)
        matrix = matrix.reshape(maps_in, maps_out, 2 * _BLOCK, channels, _BLOCK, channels).transpose(2, 0, 3, 4, 1, 5)
        bias = jnp.tile(jnp.repeat(self.bias, channels), _BLOCK)
        return jnp.concatenate([matrix.reshape(-1, len(bias)), bias[None]])


class Strided(eqx.Module):
    """A convolution over images, (h, w, channels), zeros around them; its kernel is as wide as its stride, or twice as wide.

    Images are cut into blocks of the stride, and a product with a matrix is taken over each of them, or over each 2 x 2: in a
    loop on a CPU that takes a twentieth of the time of XLA's own convolution.
    """

    weight: Array  # (1 or 4 blocks of stride * stride * channels, maps out)
    bias: Array  # (maps out,)
    shape: tuple[int, int, int] = eqx.field(static=True)
    stride: int = eqx.field(static=True)
    activation: str = eqx.field(static=True)
    overlap: bool = eqx.field(static=True, default=True)  # of kernels

    @classmethod
    def random(
        cls,
        shape: tuple[int, int, int],
        stride: int,
        maps: int,
        activation: str,
        rng: np.random.Generator,
        overlap: bool = True,
    ) -> "Strided":
        """Weights uniform, with the variance 1 / inputs [LeCun et al., 1998]."""
        inputs = (4 if overlap else 1) * stride**2 * shape[2]
        return cls(_lecun(inputs, maps, rng), np.zeros(maps, np.float32), shape, stride, activation, overlap)

    def __call__(self, x: Array) -> Array:
        """(n, h * w * channels) to (n, ceil(h / stride) * ceil(w / stride) * maps)."""
        (height, width, channels), s = self.shape, self.stride
        rows, columns, before = _blocks(self.shape, s, self.overlap)
        ends = (rows * s - height - before, columns * s - width - before)
        images = x.reshape(-1, height, width, channels)
        images = jnp.pad(images, ((0, 0), (before, ends[0]), (before, ends[1]), (0, 0)))
        blocks = images.reshape(-1, rows, s, columns, s, channels).transpose(0, 1, 3, 2, 4, 5)
        blocks = blocks.reshape(-1, rows, columns, s * s * channels)
        blocks = _squares(blocks) if self.overlap else blocks
        return _activated(self.activation, blocks @ self.weight + self.bias).reshape(len(x), -1)


class Unstrided(eqx.Module):
    """The transpose of `Strided`: from its grid to images. Blocks that overlap add up."""

    weight: Array  # (1 or 4 cells of maps in, stride * stride * channels)
    bias: Array  # (channels,)
    grid: tuple[int, int, int] = eqx.field(static=True)  # rows, columns, maps in
    shape: tuple[int, int, int] = eqx.field(static=True)  # h, w, channels
    stride: int = eqx.field(static=True)
    activation: str = eqx.field(static=True)
    overlap: bool = eqx.field(static=True, default=True)

    @classmethod
    def random(
        cls,
        grid: tuple[int, int, int],
        stride: int,
        shape: tuple[int, int, int],
        activation: str,
        rng: np.random.Generator,
        overlap: bool = True,
    ) -> "Unstrided":
        """As `Strided.random`."""
        weight = _lecun((4 if overlap else 1) * grid[2], stride**2 * shape[2], rng)
        return cls(weight, np.zeros(shape[2], np.float32), grid, shape, stride, activation, overlap)

    def __call__(self, x: Array) -> Array:
        """(n, rows * columns * maps in) to (n, h * w * channels)."""
        (height, width, channels), s = self.shape, self.stride
        rows, columns, before = _blocks(self.shape, s, self.overlap)
        cells = x.reshape(-1, *self.grid)
        cells = _squares(jnp.pad(cells, ((0, 0), (1, 1), (1, 1), (0, 0)))) if self.overlap else cells
        blocks = (cells @ self.weight).reshape(-1, rows, columns, s, s, channels)
        images = blocks.transpose(0, 1, 3, 2, 4, 5).reshape(-1, rows * s, columns * s, channels)
        images = images[:, before : before + height, before : before + width]
        return _activated(self.activation, images + self.bias).reshape(len(x), -1)


def _blocks(shape: tuple[int, int, int], stride: int, overlap: bool) -> tuple[int, int, int]:
    """Rows and columns of blocks that images are cut into, and zeros before them."""
    rows, columns = (-(-side // stride) + overlap for side in shape[:2])
    return rows, columns, overlap * (stride // 2)


class Reader(eqx.Module):
    """Gated recurrent units that read a sequence; its last steps are repeated to fill the last of those read together.

    K. Cho et al., Learning phrase representations using RNN encoder-decoder for statistical machine translation, EMNLP 2014.
    """

    cell: eqx.nn.GRUCell
    shape: tuple[int, int] = eqx.field(static=True)  # steps, channels
    together: int = eqx.field(static=True)  # steps

    @classmethod
    def random(cls, shape: tuple[int, int], together: int, units: int, rng: np.random.Generator) -> "Reader":
        """With the weights that Equinox gives."""
        return cls(eqx.nn.GRUCell(together * shape[1], units, key=_key(rng)), shape, together)

    def __call__(self, x: Array) -> Array:
        """(n, steps * channels) to (n, 2 units): the last state, and the mean of all."""
        (steps, channels), updates = self.shape, -(-self.shape[0] // self.together)
        missing = updates * self.together - steps
        x = jnp.pad(x.reshape(-1, steps, channels), ((0, 0), (0, missing), (0, 0)), mode="edge")
        given = x.reshape(-1, updates, self.together * channels).swapaxes(0, 1)
        start = jnp.zeros((x.shape[0], self.cell.hidden_size))
        states = _states(self.cell, given, start)
        return jnp.concatenate([states[-1], states.mean(axis=0)], axis=1)


class Teller(eqx.Module):
    """The way back: from what its units are in the beginning, and are told at each update, to a sequence."""

    cell: eqx.nn.GRUCell
    out: Dense
    shape: tuple[int, int] = eqx.field(static=True)  # steps, channels
    together: int = eqx.field(static=True)  # steps

    @classmethod
    def random(cls, shape: tuple[int, int], together: int, units: int, rng: np.random.Generator) -> "Teller":
        """As `Reader.random`."""
        out = Dense.random(units, together * shape[1], "linear", rng)
        return cls(eqx.nn.GRUCell(units, units, key=_key(rng)), out, shape, together)

    def __call__(self, x: Array) -> Array:
        """(n, units) to (n, steps * channels)."""
        (steps, channels), updates = self.shape, -(-self.shape[0] // self.together)
        states = _states(self.cell, jnp.broadcast_to(x, (updates, *x.shape)), x)
        told = self.out(states).swapaxes(0, 1).reshape(len(x), -1, channels)
        return told[:, :steps].reshape(len(x), -1)


def _states(cell: eqx.nn.GRUCell, given: Array, start: Array) -> Array:
    """The states, (updates, n, units), of units that are given (updates, n, features), from a start, (n, units), on."""

    def update(state: Array, entry: Array) -> tuple[Array, Array]:
        state = jax.vmap(cell)(entry, state)
        return state, state

    return jax.lax.scan(update, start, given)[1]


def _key(rng: np.random.Generator) -> Array:
    return jax.random.key(int(rng.integers(2**31)))


class Beside(eqx.Module):
    """Two stacks of layers that read the same rows; what they give lies side by side."""

    one: tuple[eqx.Module, ...]
    other: tuple[eqx.Module, ...]

    def __call__(self, x: Array) -> Array:
        """(n, features) to (n, those of one + those of the other)."""
        return jnp.concatenate([through(self.one, x), through(self.other, x)], axis=1)


class Each(eqx.Module):
    """Stacks of layers, each of which reads some of the entries of a row; what they give lies side by side."""

    stacks: tuple[tuple[eqx.Module, ...], ...]
    sizes: tuple[int, ...] = eqx.field(static=True)  # entries for each

    def __call__(self, x: Array) -> Array:
        """(n, sum of sizes) to (n, those of all)."""
        ends = np.cumsum(self.sizes).tolist()
        given = [x[:, end - size : end] for size, end in zip(self.sizes, ends, strict=True)]
        return jnp.concatenate([through(stack, part) for stack, part in zip(self.stacks, given, strict=True)], axis=1)


class Scales(eqx.Module):
    """Images, (h, w, channels), blurred at several scales: see `auroraqd.descriptors.distances.multiscale`. Not learned."""

    shape: tuple[int, int, int] = eqx.field(static=True)

    def __call__(self, x: Array) -> Array:
        """(n, h * w * channels) to (n, features)."""
        images = (x.reshape(-1, *self.shape) + 1) / 2  # black is nothing
        levels = [jnp.einsum("ph,nhwc,qw->npqc", a, images, b) for a, b in blurs(self.shape[0], self.shape[1])]
        return jnp.concatenate([level.reshape(len(x), -1) for level in levels], axis=1)


class Offset(eqx.Module):
    """What is added to each row: the background of images."""

    bias: Array  # (features,)

    def __call__(self, x: Array) -> Array:
        """(n, features) to the same."""
        return x + self.bias


def _squares(cells: Array) -> Array:
    """(n, rows, columns, maps) to (n, rows - 1, columns - 1, 4 maps): each cell, and those right of it, below, and both."""
    return jnp.concatenate([cells[:, :-1, :-1], cells[:, :-1, 1:], cells[:, 1:, :-1], cells[:, 1:, 1:]], axis=-1)


class MaxPooling(eqx.Module):
    """The maximum over 2 x 2 windows of each image, stride 1; windows at the end are cut off by the border.

    Reads images laid out as (steps, maps, channels) and gives them as (maps, steps, channels).
    """

    shape: tuple[int, int] = eqx.field(static=True)
    maps: int = eqx.field(static=True)

    def __init__(self, shape: tuple[int, ...], maps: int):
        self.shape, self.maps = (shape[0], shape[1]), maps

    def __call__(self, x: Array) -> Array:
        """(n, maps * steps * channels) to the same."""
        steps, channels = self.shape
        images = _pooled(x.reshape(-1, steps * self.maps, channels), 2)
        images = _pooled(images.reshape(-1, steps, self.maps * channels), 1)
        return images.reshape(-1, steps, self.maps, channels).swapaxes(1, 2).reshape(x.shape)


def _pooled(images: Array, axis: int) -> Array:
    """Each entry or the next along this axis, which is larger. Of three axes: XLA takes longer over four."""
    here, last = jnp.split(images, [images.shape[axis] - 1], axis=axis)
    following = jax.lax.slice_in_dim(images, 1, None, axis=axis)
    return jnp.concatenate([_larger(here, following), last], axis=axis)


def _placements(channels: int) -> np.ndarray:
    """(KERNEL entries, 2 _BLOCK * channels * _BLOCK * channels) of 0 and 1: which entry of the kernel leads from which input of
    two blocks, in turn, to which output of one.

    As TensorFlow's "same" padding: of an even number of zeros lacking, one more comes after than before.
    """
    given, got = (np.divmod(np.arange(steps * channels), channels) for steps in (2 * _BLOCK, _BLOCK))
    row = given[0][:, None] - got[0][None, :]  # [input, output]
    column = given[1][:, None] - got[1][None, :] + (KERNEL[1] - 1) // 2
    entry = np.where((row >= 0) & (row < KERNEL[0]) & (column >= 0) & (column < KERNEL[1]), row * KERNEL[1] + column, -1)
    return (entry.reshape(1, -1) == np.arange(math.prod(KERNEL))[:, None]).astype(np.float32)


def _glorot(shape: tuple[int, ...], fans: int, rng: np.random.Generator) -> np.ndarray:
    limit = math.sqrt(6 / fans)
    return rng.uniform(-limit, limit, shape).astype(np.float32)


def _lecun(inputs: int, outputs: int, rng: np.random.Generator) -> np.ndarray:
    limit = math.sqrt(3 / inputs)
    return rng.uniform(-limit, limit, (inputs, outputs)).astype(np.float32)


def _activated(name: str, x: Array) -> Array:
    if name == "silu":  # of networks that are compiled
        return jax.nn.silu(x)
    if name == "tanh":
        return x.__array_namespace__().tanh(x)
    return x


def _larger(a: Array, b: Array) -> Array:
    """Of each two entries. The maximum of JAX shares its slope among equals, which took a quarter of the time of a step."""
    return jnp.where(a >= b, a, b)
