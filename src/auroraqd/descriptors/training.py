"""Training of an auto-encoder: compiled loops of epochs.

The protocol is the paper's (Sec. "Dimensionality reduction algorithms"): several repeats, each with a new split into training
and validation rows and each continuing the same weights; a repeat ends early when the validation error, averaged over a
number of epochs, rises.

The loop is compiled once for each power of four of the number of rows, not for each number: rows beyond the last are padding
that no mini-batch draws. Python only looks in between, about twice a second, to show progress.
"""

import time
from collections.abc import Callable, Generator
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from auroraqd._interrupts import uninterrupted
from auroraqd.descriptors.networks import AutoEncoderNetwork

Array = Any
_LEAST_ROWS = 256
_REPORT = 0.5  # s between two looks at the training
_EPSILON = 1e-12  # under roots, whose slope at 0 is infinite
_ADAGRAD_START = 0.1  # TensorFlow's default, which the reference kept


class Protocol(NamedTuple):
    """How to train. Attributes are the parameters of `AutoEncoder` of the same name."""

    optimizer: str
    learning_rate: float
    decay: str
    warmup: float
    clip: float
    batch_size: int | None
    max_epochs: int
    min_steps: int
    patience: int
    repeats: int
    validation: float
    split_above: int
    isometry: float


class Progress(NamedTuple):
    """How far a training is."""

    repeat: int
    repeats: int
    epoch: int
    max_epochs: int
    error: float  # root mean square error of the validation rows, or of the training rows, where none are held back
    validated: bool

    def __str__(self) -> str:
        rows = "validation" if self.validated else "training"
        return f"repeat {self.repeat}/{self.repeats}, epoch {self.epoch}/{self.max_epochs}, {rows} RMSE {self.error:.4f}"


class Trained(NamedTuple):
    """What a training gave."""

    network: AutoEncoderNetwork
    epochs: list[int]  # done, for each repeat
    rmse: (
        float  # of the validation rows of the last repeat, with the final weights; of the training rows, if none are held back
    )
    validated: bool  # whether some are
    diverged: bool


class _State(NamedTuple):
    network: Any
    optimizer: Any
    best: Any  # weights with the lowest validation error so far
    best_error: Array
    errors: Array  # (2 patience,) objective on the validation rows, of epoch e at e modulo the length
    finite: Array  # whether that of the last epoch was
    rmse: Array  # of the last epoch
    best_rmse: Array
    epoch: Array
    key: Array
    over: Array


class _Rows(NamedTuple):
    x: Array  # (padded, features)
    train: Array  # (padded,) rows to train on, the first n_train valid
    n_train: Array
    check: Array  # (padded,) rows to validate on
    n_check: Array


def train(
    network: AutoEncoderNetwork,
    x: np.ndarray,
    protocol: Protocol,
    rng: np.random.Generator,
    listener: Callable[[Progress], Any] | None = None,
) -> Trained:
    """Train on rows, (n, features) float32, from these weights on.

    When an epoch gives a NaN or an infinity, training ends with the weights that were the best before.
    """
    steps = _steps(network, x, protocol, rng)
    while True:
        try:
            with uninterrupted():  # JAX can lose an interrupt that comes while it traces or compiles
                progress = next(steps)
        except StopIteration as end:
            return end.value
        if listener is not None:
            listener(progress)


def _steps(
    network: AutoEncoderNetwork, x: np.ndarray, protocol: Protocol, rng: np.random.Generator
) -> Generator[Progress, None, Trained]:
    """The training in pieces of about half a second; returns its result."""
    n = len(x)
    size, padded = _sizes(n, protocol.batch_size)
    data = jnp.asarray(np.concatenate([x, np.zeros((padded - n, x.shape[1]), np.float32)]))
    weights, structure = eqx.partition(jax.tree.map(jnp.asarray, network), eqx.is_array)
    # What only changes how long the loop runs is left out of what it is compiled for.
    step = _compiled(
        structure, protocol._replace(batch_size=size, max_epochs=0, min_steps=0, repeats=0, validation=0, split_above=0)
    )
    epochs, rmse, diverged = [], float("nan"), False
    validated = _held_back(n, protocol) > 0
    optimizer = step.optimizer.init(weights)
    for repeat in range(protocol.repeats):
        rows = _split(data, n, protocol, rng)
        steps = -(-int(rows.n_train) // size)
        max_epochs = max(protocol.max_epochs, -(-protocol.min_steps // steps))
        state = _State(
            weights,
            optimizer,
            weights,
            jnp.asarray(jnp.inf, jnp.float32),
            jnp.full(2 * protocol.patience, jnp.nan, jnp.float32),
            jnp.asarray(True),
            jnp.asarray(jnp.nan, jnp.float32),
            jnp.asarray(jnp.nan, jnp.float32),
            jnp.asarray(0, jnp.int32),
            jax.random.key(int(rng.integers(2**31))),
            jnp.asarray(False),
        )
        span = _Span(np.float32(repeat / protocol.repeats), np.float32(1 / protocol.repeats), np.int32(max_epochs))
        at_once = 1
        while not bool(state.over):
            since = time.monotonic()
            state = step.epochs(state, rows, span, np.int32(at_once))
            jax.block_until_ready(state.over)
            at_once = max(1, int(at_once * min(4.0, _REPORT / max(time.monotonic() - since, 1e-6))))
            yield Progress(repeat + 1, protocol.repeats, int(state.epoch), max_epochs, float(state.rmse), validated)
        epochs.append(int(state.epoch))
        rmse = float(state.best_rmse)
        weights, optimizer = state.best, state.optimizer
        diverged = not bool(state.finite)
        if diverged:
            break
    trained = jax.tree.map(np.asarray, weights)
    return Trained(eqx.combine(trained, structure), epochs, rmse, validated, diverged)


def _sizes(n: int, batch_size: int | None) -> tuple[int, int]:
    """Rows a step, and rows with padding: a multiple of it, of which there are few for all n."""
    if batch_size is None:  # padding would cost as much as rows do
        size = -(-n // _LEAST_ROWS) * _LEAST_ROWS
        return size, size
    padded = _LEAST_ROWS
    while padded < n:
        padded *= 4
    size = min(batch_size, padded)
    return size, -(-padded // size) * size


def _held_back(n: int, protocol: Protocol) -> int:
    """Rows of n to validate on and not to train on."""
    return min(round(protocol.validation * n), n - 1) if n > protocol.split_above else 0


def _split(data: Array, n: int, protocol: Protocol, rng: np.random.Generator) -> _Rows:
    order = rng.permutation(n).astype(np.int32)
    n_check = _held_back(n, protocol)
    check, training = (order[:n_check], order[n_check:]) if n_check else (order, order)

    def filled(rows: np.ndarray) -> Array:
        return jnp.asarray(np.concatenate([rows, np.zeros(len(data) - len(rows), np.int32)]))

    return _Rows(data, filled(training), jnp.asarray(len(training)), filled(check), jnp.asarray(len(check)))


class _Span(NamedTuple):
    """Where a repeat is in the training, for the learning rate."""

    start: Array  # share of the training done before
    share: Array  # of the training that it makes up at most
    max_epochs: Array


class _Compiled(NamedTuple):
    optimizer: optax.GradientTransformation
    epochs: Callable[..., _State]


@cache
def _compiled(structure: Any, protocol: Protocol) -> _Compiled:
    size = protocol.batch_size
    assert size is not None
    if protocol.optimizer == "adam":
        scale = optax.scale_by_adam()
    else:
        scale = optax.scale_by_rss(initial_accumulator_value=_ADAGRAD_START)
    optimizer = optax.chain(optax.clip_by_global_norm(protocol.clip), scale) if protocol.clip else scale

    def objective(weights: Any, x: Array, valid: Array) -> tuple[Array, Array]:
        """Of a mini-batch (size, features) of which the rows `valid` count: the loss, and the sum of squared errors."""
        network = eqx.combine(weights, structure)
        z = network.encode(x)
        squares = jnp.where(valid, ((network.decode(z) - x) ** 2).sum(axis=1), 0).sum()
        loss = squares / valid.sum()
        if protocol.isometry:
            loss = loss + protocol.isometry * distortion(x, z, valid)
        return loss, squares

    def batch(rows: _Rows, order: Array, n: Array, i: Array) -> tuple[Array, Array]:
        chosen = jax.lax.dynamic_slice(order, (i * size,), (size,))
        return rows.x[chosen], i * size + jnp.arange(size) < n

    def epoch(state: _State, rows: _Rows, span: _Span) -> _State:
        key, shuffle = jax.random.split(state.key)
        lots = jnp.where(jnp.arange(len(rows.train)) < rows.n_train, jax.random.uniform(shuffle, (len(rows.train),)), 2)
        order = rows.train[jnp.argsort(lots)]
        steps = (rows.n_train + size - 1) // size

        def step(i: Array, carried: tuple[Any, Any]) -> tuple[Any, Any]:
            weights, slots = carried
            gradient, _ = jax.grad(objective, has_aux=True)(weights, *batch(rows, order, rows.n_train, i))
            update, slots = optimizer.update(gradient, slots, weights)
            done = span.start + span.share * (state.epoch + i / steps) / span.max_epochs
            rate = protocol.learning_rate * (_one_cycle(done, protocol.warmup) if protocol.decay == "cosine" else 1.0)
            return jax.tree.map(lambda w, u: w - rate * u, weights, update), slots

        weights, slots = jax.lax.fori_loop(0, steps, step, (state.network, state.optimizer))

        def check(i: Array, carried: tuple[Array, Array]) -> tuple[Array, Array]:
            x, valid = batch(rows, rows.check, rows.n_check, i)
            loss, squares = objective(weights, x, valid)
            return carried[0] + loss * valid.sum(), carried[1] + squares

        total, squares = jax.lax.fori_loop(0, (rows.n_check + size - 1) // size, check, (jnp.float32(0), jnp.float32(0)))
        error = total / rows.n_check
        errors = state.errors.at[state.epoch % len(state.errors)].set(error)
        rmse = jnp.sqrt(squares / rows.n_check / rows.x.shape[1])
        better = error < state.best_error
        done = state.epoch + 1
        return _State(
            weights,
            slots,
            jax.tree.map(lambda new, old: jnp.where(better, new, old), weights, state.best),
            jnp.where(better, error, state.best_error),
            errors,
            jnp.isfinite(error),
            rmse,
            jnp.where(better, rmse, state.best_rmse),
            done,
            key,
            ~jnp.isfinite(error) | (done >= span.max_epochs) | _rising(errors, done),
        )

    @jax.jit
    def epochs(state: _State, rows: _Rows, span: _Span, at_once: Array) -> _State:
        last = state.epoch + at_once
        return jax.lax.while_loop(lambda s: ~s.over & (s.epoch < last), lambda s: epoch(s, rows, span), state)

    return _Compiled(optimizer, epochs)


def _one_cycle(done: Array, warmup: float) -> Array:
    """Share of the learning rate when this share of the training is done: a linear rise, then half a cosine down to 0."""
    falling = 0.5 * (1 + jnp.cos(jnp.pi * (done - warmup) / (1 - warmup)))
    return jnp.where(done < warmup, done / max(warmup, 1e-9), falling)


def _rising(errors: Array, done: Array) -> Array:
    """Whether the mean of the last half of the errors is above that of the half before."""
    age = (done - 1 - jnp.arange(len(errors))) % len(errors)
    late = age < len(errors) // 2
    return (done >= len(errors)) & (jnp.where(late, errors, 0).sum() > jnp.where(late, 0, errors).sum())


def distortion(x: Array, z: Array, valid: Array) -> Array:
    """How far distances in the latent space are from being proportional to those of the observations, 0 when they are.

    mean((s |z_i - z_j| - |x_i - x_j|)^2) / mean(|x_i - x_j|^2) over all pairs, with the s that makes it smallest.
    """
    pairs = valid[:, None] & valid[None, :] & ~jnp.eye(len(x), dtype=bool)
    wanted = jax.lax.stop_gradient(_distances(x, pairs))
    given = _distances(z, pairs)
    s = (wanted * given).sum() / ((given**2).sum() + _EPSILON)
    return ((s * given - wanted) ** 2).sum() / ((wanted**2).sum() + _EPSILON)


def _distances(x: Array, pairs: Array) -> Array:
    squares = (x**2).sum(axis=1)
    squared = squares[:, None] + squares[None, :] - 2 * x @ x.T
    return jnp.where(pairs, jnp.sqrt(jnp.maximum(squared, 0) + _EPSILON), 0)
