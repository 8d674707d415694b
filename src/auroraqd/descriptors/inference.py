"""Fitted networks in use: observations to latent positions and back.

Of short rows in NumPy and in float64, which needs no compilation and differs between batches by rounding alone. Of images by
a compiled function, in float32, in blocks of a fixed number of rows, so that it is compiled
once and an observation is described the same in a batch of any size.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from auroraqd.descriptors._convolution import Convolved, Pooled
from auroraqd.descriptors.layers import AutoEncoderNetwork, Convolution, MaxPooling, through
from auroraqd.descriptors.scaling import Scaler

_BLOCK = 32  # rows: a multiple of as many as a processor takes at once, or those left over are rounded in another way


class InUse(Protocol):
    """A network that maps observations, (n, features), as they are.

    Attributes:
        scaler: of observations.
    """

    scaler: Scaler

    def encode(self, x: np.ndarray) -> np.ndarray:
        """Latent positions, (n, d) float64."""
        ...

    def decode(self, z: np.ndarray) -> np.ndarray:
        """Scaled observations, (n, features) float64."""
        ...

    def describe(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Latent positions, and the sum of the squared errors of each scaled reconstruction, (n,)."""
        ...


class Plain:
    """In NumPy.

    Args:
        network: weights of any precision, which is that of the results.
        scaler: of observations.
    """

    def __init__(self, network: AutoEncoderNetwork, scaler: Scaler) -> None:
        # a method of a module of Equinox takes longer to look up than a layer takes
        self._encoder, self._decoder = ([_in_numpy(layer) for layer in of] for of in (network.encoder, network.decoder))
        self.scaler = scaler

    def encode(self, x: np.ndarray) -> np.ndarray:
        """See `InUse`."""
        return through(self._encoder, self.scaler(x))

    def decode(self, z: np.ndarray) -> np.ndarray:
        """See `InUse`."""
        return through(self._decoder, z)

    def describe(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `InUse`."""
        scaled = self.scaler(x)
        z = through(self._encoder, scaled)
        return z, ((self.decode(z) - scaled) ** 2).sum(axis=1)


def _in_numpy(layer: Any) -> Any:
    """What does the same on rows of float64."""
    if isinstance(layer, Convolution):
        return Convolved(layer)
    return Pooled(layer) if isinstance(layer, MaxPooling) else layer


class Compiled:
    """By JAX. Arguments as of `Plain`."""

    def __init__(self, network: AutoEncoderNetwork, scaler: Scaler) -> None:
        self._network = jax.tree.map(lambda weight: jnp.asarray(weight, jnp.float32), network)
        self.scaler = scaler
        self._scaling = tuple(jnp.asarray(part, jnp.float32) for part in (scaler.center, scaler.factor))

    def encode(self, x: np.ndarray) -> np.ndarray:
        """See `InUse`."""
        return self._in_blocks(_encode, x)[0]

    def decode(self, z: np.ndarray) -> np.ndarray:
        """See `InUse`."""
        return self._in_blocks(_decode, z.astype(np.float32))[0]

    def describe(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `InUse`."""
        z, squares = self._in_blocks(_describe, x)
        return z, squares

    def _in_blocks(self, function: Callable[..., tuple[Any, ...]], rows: np.ndarray) -> list[np.ndarray]:
        """What a function of blocks gives for all rows, in float64."""
        found = []
        for start in range(0, max(len(rows), 1), _BLOCK):  # of no rows, one block says what shape nothing has
            part = rows[start : start + _BLOCK]
            block = np.zeros((_BLOCK, *rows.shape[1:]), rows.dtype)
            block[: len(part)] = part
            found.append(
                [np.asarray(value, np.float64)[: len(part)] for value in function(self._network, self._scaling, block)]
            )
        return [np.concatenate(parts) for parts in zip(*found, strict=True)]


@jax.jit
def _encode(network: AutoEncoderNetwork, scaling: Any, x: Any) -> tuple[Any]:
    return (network.encode(_scaled(x, scaling)),)


@jax.jit
def _decode(network: AutoEncoderNetwork, scaling: Any, z: Any) -> tuple[Any]:
    return (network.decode(z),)


def _describe(network: AutoEncoderNetwork, scaling: Any, x: Any) -> tuple[Any, Any]:
    (z,) = _encode(network, scaling, x)  # the same function: in another one, compiled with the rest, rounding may differ
    return z, _squares(network, scaling, x, z)


@jax.jit
def _squares(network: AutoEncoderNetwork, scaling: Any, x: Any, z: Any) -> Any:
    return ((network.decode(z) - _scaled(x, scaling)) ** 2).sum(axis=1)


def _scaled(x: Any, scaling: Any) -> Any:
    center, factor = scaling
    return (x.astype(jnp.float32) - center) * factor
