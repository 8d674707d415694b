"""Networks of the auto-encoder: Equinox modules that map rows to rows.

They work on JAX arrays, for training, and on NumPy arrays of any precision, for use: a descriptor in float64 is then a matter
of NumPy alone, with no compilation, for batches of any size.

- `mlp`: dense layers, for observations of any shape.
- `convolutional`: the network of the AURORA paper (Sec. "Experimental validation"; sizes, kernels and activations from the
  authors' re-released ballistic example), for trajectories and other short time series.
"""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from auroraqd._checks import rows_of

Array = Any  # of NumPy or of JAX

KERNEL = (6, 2)  # steps, channels
_MAPS = 2
_DENSE = 5
_MOST_ENTRIES = 1000  # convolutions are products with square matrices of this size: see `Convolution`


class AutoEncoderNetwork(eqx.Module):
    """An encoder and a decoder.

    Attributes:
        encoder: layers from (n, features) to (n, n_components).
        decoder: layers from there back to (n, features).
    """

    encoder: tuple[eqx.Module, ...]
    decoder: tuple[eqx.Module, ...]

    def encode(self, x: Array) -> Array:
        """(n, features) to (n, n_components)."""
        return _through(self.encoder, x)

    def decode(self, z: Array) -> Array:
        """(n, n_components) to (n, features)."""
        return _through(self.decoder, z)


def random(
    kind: str, shape: Sequence[int], n_components: int, hidden: Sequence[int], rng: np.random.Generator
) -> AutoEncoderNetwork:
    """A network of a kind, "mlp" or "convolutional", for observations of a shape, with random weights."""
    if kind == "convolutional":
        return convolutional(tuple(shape), n_components, rng)
    return mlp(math.prod(shape), n_components, hidden, rng)


def filled(
    weights: Sequence[np.ndarray], kind: str, shape: Sequence[int], n_components: int, hidden: Sequence[int]
) -> AutoEncoderNetwork:
    """The same with these weights, in the order of `jax.tree.leaves`."""
    structure = jax.tree.structure(random(kind, shape, n_components, hidden, np.random.default_rng(0)))
    return jax.tree.unflatten(structure, weights)


def mlp(features: int, n_components: int, hidden: Sequence[int], rng: np.random.Generator) -> AutoEncoderNetwork:
    """Dense layers of these widths between input and latent space, mirrored back; tanh inside, linear at both ends."""
    widths = [features, *hidden, n_components]
    return AutoEncoderNetwork(_dense_layers(widths, rng), _dense_layers(widths[::-1], rng))


def convolutional(shape: tuple[int, ...], n_components: int, rng: np.random.Generator) -> AutoEncoderNetwork:
    """The network of the paper for observations of (steps, channels): 11,809 parameters for (50, 2) and two components.

    Raises:
        ValueError: the observations are no time series, or too long a one.
    """
    if len(shape) != 2:
        raise ValueError(
            f"network 'convolutional' is for time series, observations of shape (n, steps, channels), got {rows_of(shape)}: "
            "network 'mlp' takes any shape"
        )
    features = math.prod(shape)
    if features > _MOST_ENTRIES:
        raise ValueError(
            f"network 'convolutional' takes time series of at most {_MOST_ENTRIES} entries, got {shape[0]} steps of "
            f"{shape[1]} channels: network 'mlp' takes any"
        )
    encoder = (
        Convolution.random(shape, 1, _MAPS, "leaky_relu", rng),
        MaxPooling(shape, _MAPS),
        Dense.random(_MAPS * features, _DENSE, "tanh", rng),
        Dense.random(_DENSE, n_components, "linear", rng),
    )
    decoder = (
        Dense.random(n_components, _DENSE, "tanh", rng),
        Dense.random(_DENSE, features, "tanh", rng),
        Convolution.random(shape, 1, _MAPS, "leaky_relu", rng),
        Convolution.random(shape, _MAPS, 1, "leaky_relu", rng),
        Dense.random(features, features, "linear", rng),
    )
    return AutoEncoderNetwork(encoder, decoder)


def _through(layers: tuple[Any, ...], x: Array) -> Array:
    for layer in layers:
        x = layer(x)
    return x


def _dense_layers(widths: Sequence[int], rng: np.random.Generator) -> tuple["Dense", ...]:
    activations = ["tanh"] * (len(widths) - 2) + ["linear"]
    return tuple(Dense.random(a, b, name, rng) for a, b, name in zip(widths, widths[1:], activations, strict=False))


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
    """A convolution over (steps, channels) images, zeros around them so that they keep their size.

    Rows are images laid out as (maps, steps, channels). On a CPU, XLA's convolution of so few maps takes several times as
    long as a product with the matrix that does the same, so that is how it is done.
    """

    kernel: Array  # (maps in, maps out, KERNEL entries)
    bias: Array  # (maps out,)
    shape: tuple[int, int] = eqx.field(static=True)  # steps, channels
    activation: str = eqx.field(static=True)

    @classmethod
    def random(
        cls, shape: tuple[int, ...], maps_in: int, maps_out: int, activation: str, rng: np.random.Generator
    ) -> "Convolution":
        """As `Dense.random`."""
        taps = math.prod(KERNEL)
        kernel = _glorot((maps_in, maps_out, taps), taps * (maps_in + maps_out), rng)
        return cls(kernel, np.zeros(maps_out, np.float32), (shape[0], shape[1]), activation)

    def __call__(self, x: Array) -> Array:
        """(n, maps in * steps * channels) to (n, maps out * steps * channels)."""
        maps_in, maps_out, taps = self.kernel.shape
        size = math.prod(self.shape)
        matrix = self.kernel.reshape(-1, taps) @ _placements(self.shape).astype(self.kernel.dtype)
        matrix = matrix.reshape(maps_in, maps_out, size, size).transpose(0, 2, 1, 3).reshape(maps_in * size, maps_out * size)
        xp = self.kernel.__array_namespace__()
        return _activated(self.activation, x @ matrix + xp.repeat(self.bias, size))


class MaxPooling(eqx.Module):
    """The maximum over 2 x 2 windows of each image, stride 1; windows at the end are cut off by the border."""

    shape: tuple[int, int] = eqx.field(static=True)
    maps: int = eqx.field(static=True)

    def __init__(self, shape: tuple[int, ...], maps: int):
        self.shape, self.maps = (shape[0], shape[1]), maps

    def __call__(self, x: Array) -> Array:
        """(n, maps * steps * channels) to the same."""
        xp = x.__array_namespace__()
        images = x.reshape(-1, self.maps, *self.shape)
        for axis in (2, 3):
            following = [slice(None)] * 4
            following[axis] = slice(1, None)
            last = [slice(None)] * 4
            last[axis] = slice(-1, None)
            images = xp.maximum(images, xp.concatenate([images[tuple(following)], images[tuple(last)]], axis=axis))
        return images.reshape(x.shape)


def _placements(shape: tuple[int, int]) -> np.ndarray:
    """(KERNEL entries, size * size) of 0 and 1: which entry of the kernel leads from which input to which output.

    As TensorFlow's "same" padding: of an even number of zeros lacking, one more comes after than before.
    """
    step, channel = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    row = step[:, None] - step[None, :] + (KERNEL[0] - 1) // 2  # [input, output]
    column = channel[:, None] - channel[None, :] + (KERNEL[1] - 1) // 2
    entry = np.where((row >= 0) & (row < KERNEL[0]) & (column >= 0) & (column < KERNEL[1]), row * KERNEL[1] + column, -1)
    return (entry.reshape(1, -1) == np.arange(math.prod(KERNEL))[:, None]).astype(np.float32)


def _glorot(shape: tuple[int, ...], fans: int, rng: np.random.Generator) -> np.ndarray:
    limit = math.sqrt(6 / fans)
    return rng.uniform(-limit, limit, shape).astype(np.float32)


def _activated(name: str, x: Array) -> Array:
    xp = x.__array_namespace__()
    if name == "tanh":
        return xp.tanh(x)
    if name == "leaky_relu":
        return xp.maximum(x, 0.2 * x)
    return x
