"""Training of an auto-encoder: compiled loops of epochs.

The protocol is the paper's (Sec. "Dimensionality reduction algorithms"): several repeats, each with a new split into training
and validation rows and each continuing the same weights; a repeat ends early when the validation error, averaged over a
number of epochs, rises.

**Noise.** An encoder of many weights and few rows learns by heart what its few dimensions cannot tell, and then misplaces what
is unlike those rows. What it reads in training may therefore be blurred by noise, while the reconstruction is compared with the
row itself: a denoising auto-encoder [1]. Here the noise of a repeat is as large as the share of the variance that the repeat
before left unexplained: next to none for behaviours of two parameters in two dimensions, much for a robot of many joints.
Beyond a thousand rows its variance falls as their number grows: noise is a penalty on slopes, whose weight is that variance
[2], and the more rows there are, the less of a penalty it takes.

[1] P. Vincent et al., Extracting and composing robust features with denoising autoencoders, ICML 2008.
[2] C. M. Bishop, Training with noise is equivalent to Tikhonov regularization, Neural Computation 7, 1995.

Short rows lie in memory as a whole, scaled. The loop is compiled for few numbers of them, some thousands and each fourfold, not
for each number: rows beyond the last are padding that no mini-batch draws. Python only looks in between, about twice a second,
to show progress. Long ones, images, are read in parts of a few mini-batches from where they are stored, in their dtype, and
scaled a mini-batch at a time; that loop is compiled once for any number of them.
"""

import copy
import math
import time
import warnings
from collections.abc import Callable, Generator, Iterator
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from auroraqd._interrupts import uninterrupted
from auroraqd.descriptors.layers import AutoEncoderNetwork
from auroraqd.descriptors.networks import Network
from auroraqd.descriptors.scaling import Scaler
from auroraqd.observations import FlatRows

Array = Any
_LEAST_ROWS = 256
_FEW_ROWS = 1000  # up to which noise is as large as it is for fewer
# Fewer rows are filled up to the first of these, or to the second, of entries: compiling for fewer takes longer.
_SOME_ROWS, _SOME_ENTRIES = 4096, 2**18
_REPORT = 0.5  # s between two looks at the training
_EPSILON = 1e-12  # under roots, whose slope at 0 is infinite
_ADAGRAD_START = 0.1  # TensorFlow's default, which the reference kept
_RISE = 0.3  # share of a training over which beta rises from 0
_FREE = 0.5  # nats of each latent dimension that cost the same as none


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
    beta: float = 0.0
    noise: float = 0.0


class Data(NamedTuple):
    """What to train on.

    Attributes:
        x: (n, features): scaled rows, float32, or observations as they are, to be read in parts.
        scaler: of observations as they are; None for scaled rows.
        targets: (n, m) float32, whose distances those in the latent space are to be proportional to; None: the rows themselves.
        variance: the mean over scaled rows of their squared distance to the mean row; of several streams one each.
    """

    x: np.ndarray | FlatRows
    scaler: Scaler | None = None
    targets: np.ndarray | None = None
    variance: float | np.ndarray = 1.0


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
    targets: Array | None  # (padded, m)
    variance: Array
    noise: Array | None  # (features,), of what is read: its standard deviation
    train: Array  # (padded,) rows to train on, the first n_train valid
    n_train: Array
    check: Array  # (padded,) rows to validate on
    n_check: Array


def train(
    network: AutoEncoderNetwork,
    data: Data,
    kind: Network,
    protocol: Protocol,
    rng: np.random.Generator,
    listener: Callable[[Progress], Any] | None = None,
    unexplained: float = 0.0,
) -> Trained:
    """Train a network of this kind from these weights on, which leave this share of the variance unexplained; 0: not known.

    When an epoch gives a NaN or an infinity, training ends with the weights that were the best before. JAX chooses the device;
    where that is none of a processor and has not enough memory, the processor trains.

    Warns:
        UserWarning: it had not.
    """
    again = copy.deepcopy(rng)
    try:
        return _trained(network, data, kind, protocol, rng, listener, unexplained)
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error) or jax.default_backend() == "cpu":
            raise
        short = f"the {jax.default_backend()} has not enough memory to train AutoEncoder on {len(data.x):,} observations"
    warnings.warn(f"{short}, so the processor does: it takes longer. A smaller batch_size may help", stacklevel=2)
    with jax.default_device(jax.devices("cpu")[0]):
        return _trained(network, data, kind, protocol, again, listener, unexplained)


def _trained(
    network: AutoEncoderNetwork,
    data: Data,
    kind: Network,
    protocol: Protocol,
    rng: np.random.Generator,
    listener: Callable[[Progress], Any] | None,
    unexplained: float,
) -> Trained:
    steps = (_steps if data.scaler is None else _steps_in_parts)(network, data, kind, protocol, rng, unexplained)
    while True:
        try:
            with uninterrupted():  # JAX can lose an interrupt that comes while it traces or compiles
                progress = next(steps)
        except StopIteration as end:
            return end.value
        if listener is not None:
            listener(progress)


def _steps(
    network: AutoEncoderNetwork, data: Data, kind: Network, protocol: Protocol, rng: np.random.Generator, unexplained: float
) -> Generator[Progress, None, Trained]:
    """The training in pieces of about half a second; returns its result."""
    n = len(data.x)
    size, padded = _sizes(n, math.prod(data.x.shape[1:]), protocol.batch_size)
    assert isinstance(data.x, np.ndarray)  # scaled rows
    x, targets = (None if rows is None else _padded(rows, padded) for rows in (data.x, data.targets))
    weights, structure = eqx.partition(jax.tree.map(jnp.asarray, network), eqx.is_array)
    step = _compiled(structure, kind, _compiled_for(protocol, size))
    epochs, rmse, diverged = [], float("nan"), False
    validated = _held_back(n, protocol) > 0
    optimizer = step.optimizer.init(weights)
    for repeat in range(protocol.repeats):
        check, training = _split(n, protocol, rng)
        rows = _Rows(
            x,
            targets,
            jnp.float32(data.variance),
            _noise(data, kind, protocol, unexplained),
            _padded(training, padded),
            jnp.asarray(len(training)),
            _padded(check, padded),
            jnp.asarray(len(check)),
        )
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
            at_once = int(at_once * min(4.0, _REPORT / max(time.monotonic() - since, 1e-6)))
            at_once = min(max(1, at_once), max_epochs)
            yield Progress(repeat + 1, protocol.repeats, int(state.epoch), max_epochs, float(state.rmse), validated)
        epochs.append(int(state.epoch))
        rmse = float(state.best_rmse)
        unexplained = _unexplained(rmse, data)
        weights, optimizer = state.best, state.optimizer
        diverged = not bool(state.finite)
        if diverged:
            break
    trained = jax.tree.map(np.asarray, weights)
    return Trained(eqx.combine(trained, structure), epochs, rmse, validated, diverged)


def _noise(data: Data, kind: Network, protocol: Protocol, unexplained: float) -> Array | None:
    """The standard deviation of the noise on each entry, (features,), when this share of the variance is unexplained; None: no
    noise is wanted.
    """
    if not protocol.noise:
        return None
    sizes = np.array(kind.groups(math.prod(data.x.shape[1:])))
    spread = np.repeat(np.sqrt(np.atleast_1d(data.variance) / sizes), sizes)
    few = math.sqrt(min(1.0, _FEW_ROWS / len(data.x)))
    return jnp.asarray(few * protocol.noise * min(unexplained, 1.0) * spread, jnp.float32)


def _unexplained(rmse: float, data: Data) -> float:
    """The share of the variance of the rows."""
    variance = float(np.sum(data.variance))
    return rmse**2 * math.prod(data.x.shape[1:]) / variance if variance > 0 else 0.0


def _sizes(n: int, features: int, batch_size: int | None) -> tuple[int, int]:
    """Rows a step, and rows with padding: a multiple of it, of which there are few for all n."""
    if batch_size is None:  # padding would cost as much as rows do
        size = -(-n // _LEAST_ROWS) * _LEAST_ROWS
        return size, size
    padded = _LEAST_ROWS
    while padded < n or (padded < _SOME_ROWS and padded * features < _SOME_ENTRIES):
        padded *= 4
    size = min(batch_size, padded)
    return size, -(-padded // size) * size


def _held_back(n: int, protocol: Protocol) -> int:
    """Rows of n to validate on and not to train on."""
    return min(round(protocol.validation * n), n - 1) if n > protocol.split_above else 0


def _split(n: int, protocol: Protocol, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the rows to validate on, and to train on; the same where none are held back."""
    order = rng.permutation(n).astype(np.int32)
    n_check = _held_back(n, protocol)
    return (order[:n_check], order[n_check:]) if n_check else (order, order)


def _padded(rows: np.ndarray, n: int) -> Array:
    """Rows, and zeros after them, n in all."""
    return jnp.asarray(np.concatenate([rows, np.zeros((n - len(rows), *rows.shape[1:]), rows.dtype)]))


def _compiled_for(protocol: Protocol, size: int) -> Protocol:
    """Without what only changes how long the loop runs."""
    some = float(protocol.noise > 0)
    return protocol._replace(batch_size=size, max_epochs=0, min_steps=0, repeats=0, validation=0, split_above=0, noise=some)


def _is_random(protocol: Protocol) -> bool:
    """Whether a step is, beyond the choice of its rows."""
    return protocol.beta > 0 or protocol.noise > 0


class _Span(NamedTuple):
    """Where a repeat is in the training, for the learning rate."""

    start: Array  # share of the training done before
    share: Array  # of the training that it makes up at most
    max_epochs: Array


class _Batch(NamedTuple):
    """A mini-batch."""

    x: Array  # (size, features), scaled
    targets: Array | None  # (size, m): see `Data`
    valid: Array  # (size,) bool: rows that count
    variance: Array
    noise: Array | None  # as of `_Rows`


class _Chance(NamedTuple):
    """For a step that is random."""

    key: Array
    done: Array  # share of the training


class _Functions(NamedTuple):
    """What both loops are made of."""

    optimizer: optax.GradientTransformation
    objective: Callable[..., tuple[Array, Array]]
    step: Callable[..., tuple[Any, Any]]


@cache
def _functions(structure: Any, kind: Network, protocol: Protocol) -> _Functions:
    if protocol.optimizer == "adam":
        scale = optax.scale_by_adam()
    else:
        scale = optax.scale_by_rss(initial_accumulator_value=_ADAGRAD_START)
    optimizer = optax.chain(optax.clip_by_global_norm(protocol.clip), scale) if protocol.clip else scale
    optimizer = optax.flatten(optimizer)  # one pass over all weights, not some over each

    def encoded(network: Any, batch: _Batch, chance: _Chance | None) -> tuple[Array, Array, Array | None]:
        """Latent positions, what of them is decoded, and what is to be small of a variational network."""
        x = batch.x
        if batch.noise is not None and chance is not None:
            x = x + batch.noise * jax.random.normal(jax.random.fold_in(chance.key, 1), x.shape)
        if not protocol.beta:
            z = network.encode(x)
            return z, z, None
        mean, logarithm = network.posterior(x)
        cost = protocol.beta * divergence(mean, logarithm, batch.valid)
        if chance is None:
            return mean, mean, cost
        drawn = mean + jnp.exp(logarithm / 2) * jax.random.normal(chance.key, mean.shape)
        return mean, drawn, jnp.minimum(chance.done / _RISE, 1) * cost

    def objective(weights: Any, batch: _Batch, chance: _Chance | None = None) -> tuple[Array, Array]:
        """Of a mini-batch: the loss, and the sum of squared errors. Without chance: of what is read as it is, and of means."""
        network = eqx.combine(weights, structure)
        x, targets, valid, variance, _ = batch
        z, drawn, cost = encoded(network, batch, chance)
        decoded = network.decode(drawn)
        squares = jnp.where(valid, ((decoded - x) ** 2).sum(axis=1), 0).sum()
        loss = jnp.where(valid, kind.loss(x, decoded, variance), 0).sum() / valid.sum()
        if protocol.isometry:
            loss = loss + protocol.isometry * distortion(x if targets is None else targets, z, valid)
        return loss if cost is None else loss + cost, squares

    def step(weights: Any, slots: Any, done: Array, key: Array | None, batch: _Batch) -> tuple[Any, Any]:
        """One of the optimiser, when this share of the training is done, with a key for what is random, if something is."""
        chance = None if key is None else _Chance(key, done)
        gradient, _ = jax.grad(objective, has_aux=True)(weights, batch, chance)
        update, slots = optimizer.update(gradient, slots, weights)
        rate = protocol.learning_rate * (_one_cycle(done, protocol.warmup) if protocol.decay == "cosine" else 1.0)
        return jax.tree.map(lambda w, u: w - rate * u, weights, update), slots

    return _Functions(optimizer, objective, step)


class _Compiled(NamedTuple):
    optimizer: optax.GradientTransformation
    epochs: Callable[..., _State]


@cache
def _compiled(structure: Any, kind: Network, protocol: Protocol) -> _Compiled:
    optimizer, objective, one_step = _functions(structure, kind, protocol)
    size = protocol.batch_size
    assert size is not None

    def batch(rows: _Rows, order: Array, n: Array, i: Array) -> _Batch:
        chosen = jax.lax.dynamic_slice(order, (i * size,), (size,))
        targets = None if rows.targets is None else rows.targets[chosen]
        return _Batch(rows.x[chosen], targets, i * size + jnp.arange(size) < n, rows.variance, rows.noise)

    def epoch(state: _State, rows: _Rows, span: _Span) -> _State:
        key, shuffle = jax.random.split(state.key)
        order = rows.train[_shuffled(shuffle, len(rows.train), rows.n_train)]
        steps = (rows.n_train + size - 1) // size

        def step(i: Array, carried: tuple[Any, Any]) -> tuple[Any, Any]:
            done = span.start + span.share * (state.epoch + i / steps) / span.max_epochs
            key = jax.random.fold_in(shuffle, i) if _is_random(protocol) else None
            return one_step(*carried, done, key, batch(rows, order, rows.n_train, i))

        weights, slots = jax.lax.fori_loop(0, steps, step, (state.network, state.optimizer))

        def check(i: Array, carried: tuple[Array, Array]) -> tuple[Array, Array]:
            of = batch(rows, rows.check, rows.n_check, i)
            loss, squares = objective(weights, of)
            return carried[0] + loss * of.valid.sum(), carried[1] + squares

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


def _shuffled(key: Array, padded: int, n: Array) -> Array:
    """The numbers from 0 to `padded`, the first n of them in random order, the others after them.

    A lot and the number that drew it in one word are sorted in a fifth of the time that XLA takes for pairs of them. Of 2^k
    numbers, lots have 32 - k bits; equal ones keep the order of their numbers.
    """
    numbers = jnp.arange(padded, dtype=jnp.uint32)
    mask = jnp.uint32(2 ** (padded - 1).bit_length() - 1)
    lots = jnp.where(numbers < n, jax.random.bits(key, (padded,), jnp.uint32) & ~mask, ~mask)
    return (jnp.sort(lots | numbers) & mask).astype(jnp.int32)


_PART = 16  # mini-batches that are read at a time, a power of four, where rows are not held in memory; and of
_OF_STREAMS = 4  # rows that are made of streams, in float32


class _InParts(NamedTuple):
    train: Callable[..., tuple[Any, Any]]
    check: Callable[..., tuple[Array, Array]]


class _Part(NamedTuple):
    """Some rows, of which the first n are valid, and how they are scaled."""

    x: Array  # (_PART * size, features), in their own dtype
    targets: Array | None
    n: Array
    center: Array
    factor: Array
    variance: Array
    noise: Array | None  # as of `_Rows`


@cache
def _compiled_in_parts(structure: Any, kind: Network, protocol: Protocol) -> _InParts:
    _, objective, one_step = _functions(structure, kind, protocol)
    size = protocol.batch_size
    assert size is not None

    def batch(part: _Part, i: Array) -> _Batch:
        def rows(values: Array) -> Array:
            return jax.lax.dynamic_slice_in_dim(values, i * size, size)

        x = (rows(part.x).astype(jnp.float32) - part.center) * part.factor
        targets = None if part.targets is None else rows(part.targets)
        return _Batch(x, targets, i * size + jnp.arange(size) < part.n, part.variance, part.noise)

    @jax.jit
    def train(weights: Any, slots: Any, part: _Part, done: Array, gain: Array, key: Array | None) -> tuple[Any, Any]:
        """Steps on a part, the share `done` of the training being done before, and `gain` more with each."""

        def step(i: Array, carried: tuple[Any, Any]) -> tuple[Any, Any]:
            chance = None if key is None else jax.random.fold_in(key, i)
            return one_step(*carried, done + i * gain, chance, batch(part, i))

        return jax.lax.fori_loop(0, (part.n + size - 1) // size, step, (weights, slots))

    @jax.jit
    def check(weights: Any, part: _Part) -> tuple[Array, Array]:
        """The loss and the squared error, summed over the rows of a part."""

        def add(i: Array, carried: tuple[Array, Array]) -> tuple[Array, Array]:
            of = batch(part, i)
            loss, squares = objective(weights, of)
            return carried[0] + loss * of.valid.sum(), carried[1] + squares

        return jax.lax.fori_loop(0, (part.n + size - 1) // size, add, (jnp.float32(0), jnp.float32(0)))

    return _InParts(train, check)


def _steps_in_parts(
    network: AutoEncoderNetwork, data: Data, kind: Network, protocol: Protocol, rng: np.random.Generator, unexplained: float
) -> Generator[Progress, None, Trained]:
    """As `_steps`, of rows that are read in parts."""
    n = len(data.x)
    size = n if protocol.batch_size is None else min(protocol.batch_size, n)
    weights, structure = eqx.partition(jax.tree.map(jnp.asarray, network), eqx.is_array)
    compiled = _compiled_in_parts(structure, kind, _compiled_for(protocol, size))
    slots = _functions(structure, kind, _compiled_for(protocol, size)).optimizer.init(weights)
    validated, epochs, rmse, diverged, told = _held_back(n, protocol) > 0, [], float("nan"), False, 0.0
    for repeat in range(protocol.repeats):
        check, training = _split(n, protocol, rng)
        most = len(training) if kind.steps is None else kind.steps * size  # rows of an epoch
        steps = -(-min(len(training), most) // size)
        max_epochs = max(protocol.max_epochs, -(-protocol.min_steps // steps))
        if kind.steps is not None:
            max_epochs = min(max_epochs, kind.steps // steps)
        best, best_error, errors = weights, np.inf, []
        noise = _noise(data, kind, protocol, unexplained)
        while len(errors) < max_epochs and not diverged and not _has_risen(errors, protocol.patience):
            done, gain = (repeat + len(errors) / max_epochs) / protocol.repeats, 1 / (protocol.repeats * max_epochs * steps)
            for first, part in _parts(data, rng.permutation(training)[:most], size, noise):
                key = jax.random.key(int(rng.integers(2**31))) if _is_random(protocol) else None
                since = np.float32(done + gain * (first // size))
                weights, slots = compiled.train(weights, slots, part, since, np.float32(gain), key)
            sums = [compiled.check(weights, part) for _, part in _parts(data, check, size, noise)]
            error, squares = (float(sum(values)) / len(check) for values in zip(*sums, strict=True))
            errors.append(error)
            diverged = not np.isfinite(error)
            if error < best_error:
                best, best_error, rmse = weights, error, float(np.sqrt(squares / data.x.shape[1]))
            if time.monotonic() >= told or diverged or len(errors) == max_epochs:
                told = time.monotonic() + _REPORT
                shown = float(np.sqrt(squares / data.x.shape[1]))
                yield Progress(repeat + 1, protocol.repeats, len(errors), max_epochs, shown, validated)
        weights, unexplained = best, _unexplained(rmse, data)
        epochs.append(len(errors))
        if diverged:
            break
    return Trained(eqx.combine(jax.tree.map(np.asarray, weights), structure), epochs, rmse, validated, diverged)


def _parts(data: Data, rows: np.ndarray, size: int, noise: Array | None) -> Iterator[tuple[int, _Part]]:
    """The rows of these numbers in parts of a fixed number, and at which of them each begins."""
    assert data.scaler is not None
    center, factor = (jnp.asarray(values, jnp.float32) for values in (data.scaler.center, data.scaler.factor))
    batches, most = 1, _OF_STREAMS if isinstance(data.x, FlatRows) else _PART
    while batches < min(most, -(-len(rows) // size)):
        batches *= 4  # few lengths: it is compiled for each
    length = size * batches
    for first in range(0, len(rows), length):
        chosen = rows[first : first + length]
        x, targets = (None if of is None else _padded(of[chosen], length) for of in (data.x, data.targets))
        assert x is not None
        yield first, _Part(x, targets, jnp.asarray(len(chosen)), center, factor, jnp.float32(data.variance), noise)


def _has_risen(errors: list[float], patience: int) -> bool:
    """As `_rising`, of all errors so far."""
    return len(errors) >= 2 * patience and sum(errors[-patience:]) > sum(errors[-2 * patience : -patience])


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


def divergence(mean: Array, logarithm: Array, valid: Array) -> Array:
    """The Kullback-Leibler divergence of normal distributions from that of mean 0 and variance 1, in nats, the mean over rows.

    0.5 sum(m^2 + v - log v - 1) over the dimensions [1, App. B]. Each counts 0.5 at the least: below, nothing presses it to say
    less [2].

    [1] D. P. Kingma, M. Welling, Auto-encoding variational Bayes, ICLR 2014.
    [2] D. P. Kingma et al., Improved variational inference with inverse autoregressive flow, NIPS 2016, App. C.8 ("free bits").

    Args:
        mean, logarithm: (n, d), of the variance the logarithm.
        valid: (n,) bool: rows that count.
    """
    nats = 0.5 * (mean**2 + jnp.exp(logarithm) - logarithm - 1)
    return jnp.maximum(jnp.where(valid[:, None], nats, 0).sum(axis=0) / valid.sum(), _FREE).sum()


def _distances(x: Array, pairs: Array) -> Array:
    squares = (x**2).sum(axis=1)
    squared = squares[:, None] + squares[None, :] - 2 * x @ x.T
    return jnp.where(pairs, jnp.sqrt(jnp.maximum(squared, 0) + _EPSILON), 0)
