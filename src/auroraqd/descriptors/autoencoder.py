"""Auto-encoders as descriptors: what trajectories, images or sensor readings have in common, in a few numbers.

An encoder maps an observation to its latent position, the descriptor; a decoder maps it back. Both are trained together to
reconstruct the observations (paper, Sec. "Dimensionality reduction algorithms"). `AutoEncoder` is an estimator in the style
of scikit-learn, so it works outside Aurora as well.

**Distances.** A plain auto-encoder is free to bend its latent space: equal steps there may be large changes of behaviour in
one place and small ones in another, and an archive, which spaces individuals evenly in the latent space, then covers
behaviours unevenly. `isometry` weighs a term that keeps distances: see `auroraqd.descriptors.training.distortion`.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.exceptions import NotFittedError

from auroraqd._checks import MOST_SEED, flag, number, numbers, numeric, one_of, rows_of, whole, wholes
from auroraqd._interrupts import uninterrupted
from auroraqd.descriptors.scaling import Scaler, Scaling

if TYPE_CHECKING:
    from auroraqd.descriptors.networks import AutoEncoderNetwork
    from auroraqd.descriptors.training import Progress, Protocol

_listener: ContextVar[Callable[[Progress], Any] | None] = ContextVar("listener", default=None)
_VERBOSE_GAP = 5.0  # s
_OBSERVATIONS = " of shape (n, ...)"
_EXPLAINED = 0.05  # share of the variance of the observations below which nothing has been learned
_MOST_WIDTH = 10**6  # of a layer
_ROWS = 256  # at a time, to be reconstructed


@contextmanager
def listening(listener: Callable[[Progress], Any]) -> Iterator[None]:
    """Within this block, have every training report to `listener`, about twice a second.

    Args:
        listener: called with an `auroraqd.descriptors.training.Progress`.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


class AutoEncoder(TransformerMixin, BaseEstimator):
    """An auto-encoder with the interface of a scikit-learn transformer, for observations in their natural shape.

    Each channel (last axis) is scaled to [-1, 1] by its range over the rows it is fitted on. Training is repeated with new
    splits into training and validation rows, each repeat continuing the weights of the one before. A repeat ends when its
    epochs are used up or when the validation error, averaged over `patience` epochs, rises, and gives the weights with the
    lowest validation error. If training diverges (NaN), the last good weights stay and a warning says so.

    The defaults are what reaches the lowest error on throws never seen in the least time; `AutoEncoder.paper()` is the
    protocol of the paper.

    Args:
        n_components: size of the latent space.
        network: "mlp", dense layers for observations of any shape, or "convolutional", the network of the paper for short time
            series, (n, steps, channels).
        hidden: widths of the dense layers of "mlp", from input to latent space; mirrored in the decoder.
        isometry: weight of the term that keeps distances, against the squared error summed over the entries of an
            observation. 0: a plain auto-encoder.
        optimizer: "adam" or "adagrad".
        learning_rate: of the optimiser, at its highest.
        decay: "cosine" lets the learning rate rise from 0 and fall back to it over all repeats together; "none" keeps it.
        warmup: share of the training over which it rises: at full rate from the start, units that saturate never learn.
        clip: largest norm of a gradient; 0: no limit.
        batch_size: rows a step; None: all.
        max_epochs: the most epochs a repeat, unless
        min_steps: these steps of the optimiser take more epochs, as they do while there are few rows.
        patience: epochs over which the validation error is averaged.
        repeats: trainings with a new split.
        validation: share of the rows held back in each split; 0: none, and all errors are training errors.
        split_above: with this many rows or fewer there is no split either: what error they would have on others is not known.
        warm_start: whether another `fit` goes on with the weights there are. The optimiser always starts anew.
        verbose: whether `fit` prints its progress.
        random_state: seed of weights, splits and mini-batches. None: drawn from the system, or in `Aurora` from its seed.

    Attributes:
        epochs_: epochs done, for each repeat of the last `fit`.
        validation_rmse_: RMSE of the validation rows on the [-1, 1] scale at the end of the last `fit`, with the final weights;
            NaN where none were held back.
        training_rmse_: the same of all rows that `fit` was given.
    """

    natural_shape = True  # for Aurora, which flattens for other transformers

    def __init__(
        self,
        n_components: int = 2,
        *,
        network: Literal["mlp", "convolutional"] = "mlp",
        hidden: Sequence[int] = (128, 64, 32),
        isometry: float = 20.0,
        optimizer: Literal["adam", "adagrad"] = "adam",
        learning_rate: float = 1e-2,
        decay: Literal["cosine", "none"] = "cosine",
        warmup: float = 0.1,
        clip: float = 5.0,
        batch_size: int | None = 64,
        max_epochs: int = 12,
        min_steps: int = 500,
        patience: int = 50,
        repeats: int = 5,
        validation: float = 0.25,
        split_above: int = 500,
        warm_start: bool = True,
        verbose: bool = False,
        random_state: int | None = None,
    ) -> None:
        self.n_components = n_components
        self.network = network
        self.hidden = hidden
        self.isometry = isometry
        self.optimizer = optimizer
        self.learning_rate = learning_rate
        self.decay = decay
        self.warmup = warmup
        self.clip = clip
        self.batch_size = batch_size
        self.max_epochs = max_epochs
        self.min_steps = min_steps
        self.patience = patience
        self.repeats = repeats
        self.validation = validation
        self.split_above = split_above
        self.warm_start = warm_start
        self.verbose = verbose
        self.random_state = random_state

    @classmethod
    def paper(cls, n_components: int = 2, **options: Any) -> AutoEncoder:
        """The protocol of the paper, with the constants of the authors' re-released example: hours of training.

        Adagrad 0.1 on all rows at once, up to 25,000 epochs a repeat, validation error averaged over 500 epochs, the
        convolutional network, the squared error alone.

        Args:
            n_components: size of the latent space.
            options: parameters of `AutoEncoder` that are to differ.
        """
        literal = {
            "network": "convolutional",
            "isometry": 0.0,
            "optimizer": "adagrad",
            "learning_rate": 0.1,
            "decay": "none",
            "batch_size": None,
            "max_epochs": 25_000,
            "min_steps": 0,
            "patience": 500,
        }
        return cls(n_components, **{**literal, **options})

    def check_parameters(self) -> None:
        """What `fit` checks before it looks at any observations. `Aurora` asks for it at once, before a robot has moved.

        Raises:
            ValueError: a parameter is out of range.
        """
        self._protocol()
        self._architecture(())

    def fit(self, x: ArrayLike, y: object = None) -> AutoEncoder:
        """Learn from observations, (n, ...), n >= 1. `y` is passed over.

        Raises:
            ValueError: a parameter is out of range, or `x` is empty, has a NaN or an infinity, or a shape that the network does
                not take. The estimator stays as it was.
        """
        with uninterrupted():  # half an import would be the end of JAX in this process
            from auroraqd.descriptors import networks
            from auroraqd.descriptors.training import train

        protocol = self._protocol()
        x = numeric("x", x, _OBSERVATIONS, rows=True, some=True, finite=True)
        shape = x.shape[1:]
        if self.n_components > x[0].size:
            raise ValueError(
                f"n_components must be at most {x[0].size}, the entries of an observation, got {self.n_components}"
            )
        architecture = self._architecture(shape)
        goes_on = self.warm_start and getattr(self, "architecture_", None) == architecture
        fits = self.n_fits_ if goes_on else 0
        seed = None if self.random_state is None else [self.random_state, fits]
        rng = np.random.default_rng(seed)
        start = networks.filled(self.weights_, **architecture) if goes_on else networks.random(**architecture, rng=rng)
        scaling = Scaling.of(x)
        rows = scaling.scaler(x[0].size)(x).astype(np.float32)
        trained = train(start, rows, protocol, rng, self._listener())
        if trained.diverged:
            warnings.warn(
                f"training of AutoEncoder diverged in repeat {len(trained.epochs)}, epoch {trained.epochs[-1]}: the last good "
                "weights stay; a lower learning_rate may help",
                stacklevel=2,
            )
        import jax

        training_rmse, explained = _reconstruction(trained.network, rows)
        if explained < _EXPLAINED and not trained.diverged:
            warnings.warn(
                f"the latent space of AutoEncoder has collapsed: the reconstructions of {len(rows):,} observations, RMSE "
                f"{training_rmse:.3g} on the [-1, 1] scale, are hardly better than their mean. A lower learning_rate, more "
                "epochs or another network may help",
                stacklevel=2,
            )
        self.weights_ = [np.asarray(leaf) for leaf in jax.tree.leaves(trained.network)]
        self.architecture_ = architecture
        self.low_, self.high_ = scaling
        self.epochs_ = trained.epochs
        self.validation_rmse_ = trained.rmse if trained.validated else math.nan
        self.training_rmse_ = training_rmse
        self.n_fits_ = fits + 1
        self._use: tuple[Scaler, AutoEncoderNetwork] | None = None
        return self

    def transform(self, x: ArrayLike) -> np.ndarray:
        """Latent positions, (n, n_components) float64, of observations, (n, ...).

        Raises:
            NotFittedError: `fit` has not been called.
            ValueError: wrong shape, or a NaN or an infinity.
        """
        scaler, network = self._in_use()
        x = numeric("x", x, _OBSERVATIONS, rows=True, finite=True)
        if x.shape[1:] != self.observation_shape_:
            raise ValueError(f"x must have shape {rows_of(self.observation_shape_)}, as in fit, got {x.shape}")
        return network.encode(scaler(x))

    def inverse_transform(self, z: ArrayLike) -> np.ndarray:
        """Reconstructed observations, (n, ...) float64, of latent positions, (n, n_components).

        Raises:
            NotFittedError: `fit` has not been called.
            ValueError: wrong shape.
        """
        scaler, network = self._in_use()
        z = numbers("z", z)
        n_components = self.architecture_["n_components"]
        if z.ndim != 2 or z.shape[1] != n_components:
            raise ValueError(f"z must have shape (n, {n_components}), got {z.shape}")
        return scaler.inverse(network.decode(z)).reshape(len(z), *self.observation_shape_)

    @property
    def observation_shape_(self) -> tuple[int, ...]:
        """Shape of one observation."""
        return tuple(self.architecture_["shape"])

    def __getstate__(self) -> dict[str, Any]:
        state: Any = super().__getstate__()
        return {name: value for name, value in state.items() if name != "_use"}

    def _protocol(self) -> Protocol:
        from auroraqd.descriptors.training import Protocol

        whole("n_components", self.n_components, most=_MOST_WIDTH)
        one_of("optimizer", self.optimizer, ("adam", "adagrad"))
        one_of("decay", self.decay, ("cosine", "none"))
        flag("warm_start", self.warm_start)
        flag("verbose", self.verbose)
        if self.random_state is not None:
            whole("random_state", self.random_state, least=0, most=MOST_SEED)
        return Protocol(
            optimizer=self.optimizer,
            learning_rate=number("learning_rate", self.learning_rate),
            decay=self.decay,
            warmup=number("warmup", self.warmup, most=np.nextafter(1, 0), wanted="0 or more and below 1"),
            clip=number("clip", self.clip),
            batch_size=None if self.batch_size is None else whole("batch_size", self.batch_size),
            max_epochs=whole("max_epochs", self.max_epochs, most=1_000_000_000),
            min_steps=whole("min_steps", self.min_steps, least=0, most=1_000_000_000),
            patience=whole("patience", self.patience, most=1_000_000),
            repeats=whole("repeats", self.repeats, most=1_000_000),
            validation=number("validation", self.validation, most=np.nextafter(1, 0), wanted="0 or more and below 1"),
            split_above=whole("split_above", self.split_above, least=0),
            isometry=number("isometry", self.isometry),
        )

    def _architecture(self, shape: tuple[int, ...]) -> dict[str, Any]:
        """What the network is made of; kept as it was fitted, whatever becomes of the parameters."""
        one_of("network", self.network, ("mlp", "convolutional"))
        wanted = "widths of layers like (128, 64)"
        hidden = wholes("hidden", self.hidden, wanted, most=_MOST_WIDTH) if self.network == "mlp" else ()
        return {"kind": self.network, "shape": list(shape), "n_components": int(self.n_components), "hidden": list(hidden)}

    def _in_use(self) -> tuple[Scaler, AutoEncoderNetwork]:
        """The fitted network in float64: then a copy described in a batch of another size differs in its last bits only,
        which is what the archive's margin for copies is made for.
        """
        if not hasattr(self, "weights_"):
            raise NotFittedError("this AutoEncoder has not been fitted yet: call fit first")
        if getattr(self, "_use", None) is None:
            from auroraqd.descriptors import networks

            network = networks.filled([weight.astype(np.float64) for weight in self.weights_], **self.architecture_)
            self._use = Scaling(self.low_, self.high_).scaler(math.prod(self.observation_shape_)), network
        assert self._use is not None
        return self._use

    def _listener(self) -> Callable[[Progress], Any] | None:
        return _Printer() if self.verbose else _listener.get()


def _reconstruction(network: AutoEncoderNetwork, rows: np.ndarray) -> tuple[float, float]:
    """The root mean square error of scaled rows, (n, features), and the share of their variance that is explained.

    Of rows that are all the same, 1.
    """
    mean = rows.mean(axis=0, dtype=np.float64)
    wrong = variance = 0.0
    for start in range(0, len(rows), _ROWS):
        part = rows[start : start + _ROWS]
        wrong += float(((network.decode(network.encode(part)) - part).astype(np.float64) ** 2).sum())
        variance += float(((part - mean) ** 2).sum())
    return math.sqrt(wrong / rows.size), 1 - wrong / variance if variance > 0 else 1.0


class _Printer:
    """Prints the progress of a training, now and then."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, progress: Progress) -> None:
        if time.monotonic() >= self._next or progress.epoch == progress.max_epochs:
            print(progress)
            self._next = time.monotonic() + _VERBOSE_GAP


AutoEncoder.__module__ = "auroraqd"  # files name it so, wherever it lies
