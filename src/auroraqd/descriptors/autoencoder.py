"""Auto-encoders as descriptors: what trajectories, images or sensor readings have in common, in a few numbers.

An encoder maps an observation to its latent position, the descriptor; a decoder maps it back. Both are trained together to
reconstruct the observations (paper, Sec. "Dimensionality reduction algorithms"). `AutoEncoder` is an estimator in the style
of scikit-learn, so it works outside Aurora as well.

**Distances.** A plain auto-encoder is free to bend its latent space: equal steps there may be large changes of behaviour in
one place and small ones in another, and an archive, which spaces individuals evenly in the latent space, then covers
behaviours unevenly. `isometry` weighs a term that keeps distances: see `auroraqd.descriptors.training.distortion`.

**Variational.** With `beta` above 0 the encoder gives a normal distribution for each observation, of which a sample is decoded,
and beta times its divergence from the unit normal is added to what is minimised [1, 2]. Its mean is the descriptor. The latent
space then has the scale of a unit normal and no holes: what is drawn from it decodes to something like the observations. Two
things keep the latent space from telling nothing ("posterior collapse"): beta rises from 0 over the first three tenths of a
training [3], and a dimension's first half nat costs nothing [4].

[1] D. P. Kingma, M. Welling, Auto-encoding variational Bayes, ICLR 2014.
[2] I. Higgins et al., beta-VAE: learning basic visual concepts with a constrained variational framework, ICLR 2017.
[3] S. R. Bowman et al., Generating sentences from a continuous space, CoNLL 2016.
[4] D. P. Kingma et al., Improved variational inference with inverse autoregressive flow, NIPS 2016.
"""

from __future__ import annotations

import copy
import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.exceptions import NotFittedError

from auroraqd._checks import MOST_SEED, flag, number, numbers, numeric, one_of, rows_of, shown, whole
from auroraqd._interrupts import uninterrupted
from auroraqd.descriptors import distances, networks
from auroraqd.descriptors.descriptor import Mismatch
from auroraqd.descriptors.networks import MLP, Convolutional, Fused, Network
from auroraqd.descriptors.scaling import Scaler, Scaling
from auroraqd.observations import FlatRows, finite_rows, flat, has_streams, observations, streams_of

if TYPE_CHECKING:
    from auroraqd.descriptors.inference import InUse
    from auroraqd.descriptors.training import Data, Progress, Protocol, Trained

_listener: ContextVar[Callable[[Progress], Any] | None] = ContextVar("listener", default=None)
_VERBOSE_GAP = 5.0  # s
_OBSERVATIONS = " of shape (n, ...)"
_KEPT = 0.5  # squared correlation of latent distances with those that are wanted, likewise
_NOTHING = 1e-12  # variance of an entry on the [-1, 1] scale that is none
_EXPLAINED = 0.05  # share of the variance of the observations below which nothing has been learned
_METRICS = ("auto", "euclidean", "measured", "geodesic")
_NOISE = 6.0  # see `AutoEncoder`
_RETRIES = 2  # of a training that failed, each with
_SLOWER = 0.2  # times the learning rate of the one before
_ROWS = 256  # at a time, to be reconstructed
_SPREAD = 1e-4  # of latent positions about their mean, as a share of their distance from 0: less is none


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

    Each channel (last axis) is scaled to [-1, 1] by its range over the rows it is fitted on; of images, whole numbers of eight
    bits by 255. Training is repeated with new splits into training and validation rows, each repeat continuing the weights of
    the one before. A repeat ends when its epochs are used up or when the validation error, averaged over `patience` epochs,
    rises, and gives the weights with the lowest validation error. A training that diverges (NaN) or learns nothing is tried
    again twice, each time with a fifth of the learning rate; should all fail, a warning says so, and the best weights there
    are, those from before among them, stay.

    The defaults are what reaches the lowest error on throws never seen in the least time; `AutoEncoder.paper()` is the
    protocol of the paper.

    Args:
        n_components: size of the latent space.
        network: "auto" chooses by shape and dtype, see `auroraqd.descriptors.networks.chosen`, and `network_` says what;
            "image", strided convolutions for images; "recurrent", for long time series, (n, steps, channels); "mlp", dense
            layers for observations of any shape; "convolutional", the network of the paper for short time series. Or a value of
            `auroraqd.descriptors.networks`, or of a class of your own that derives from `Network` there.
        hidden: widths of the dense layers of "mlp", from input to latent space; mirrored in the decoder.
        isometry: weight of the term that keeps distances, against the squared error summed over the entries of an
            observation. 0: a plain auto-encoder.
        metric: of the distances that are kept. "euclidean": between scaled observations. "measured": of what changes smoothly
            with the behaviour, blurred images or rhythms of sequences. "geodesic": lengths of shortest paths along the graph of
            nearest neighbours by that measure, which say how far apart observations are that have nothing in common; see
            `auroraqd.descriptors.distances`. "auto": geodesic for images, measured for "recurrent", otherwise euclidean.
        noise: on what the encoder reads in training, against overfitting: its standard deviation, in the spread of the
            observations, times the share of their variance that is not explained, and less of more than 1,000 rows; see
            `auroraqd.descriptors.training`. A new network has none in its first repeat. None: with `network="auto"`, 6 where
            that chooses "mlp"; otherwise 0, none, streams among them.
        beta: weight of the divergence from a unit normal, in nats, against the same: a variational auto-encoder, see the
            module's documentation. 0: a plain one.
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
        network_: the network, a value of `auroraqd.descriptors.networks`.
        scaling_: how observations are scaled.

    Examples:
        >>> import auroraqd
        >>> throws = auroraqd.tasks.Ballistic().prior()[::50]
        >>> encoder = auroraqd.AutoEncoder(n_components=2, hidden=(16, 8), repeats=1, min_steps=100, random_state=0).fit(throws)
        >>> encoder.transform(throws).shape
        (200, 2)
        >>> encoder.inverse_transform([[0.0, 0.0]]).shape
        (1, 50, 2)
    """

    natural_shape = True  # for Aurora, which flattens for other transformers

    def __init__(
        self,
        n_components: int = 2,
        *,
        network: Literal["auto", "mlp", "convolutional", "image", "recurrent"] | Network = "auto",
        hidden: Sequence[int] = (128, 64, 32),
        isometry: float = 20.0,
        metric: Literal["auto", "euclidean", "measured", "geodesic"] = "auto",
        noise: float | None = None,
        beta: float = 0.0,
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
        self.metric = metric
        self.noise = noise
        self.beta = beta
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
        one_of("metric", self.metric, _METRICS)
        self._network((), np.dtype(np.float64))

    def reads_raw(self, shape: tuple[int, ...], dtype: np.dtype) -> bool:
        """Whether observations of this shape, without the rows, and dtype are to be given to `fit` as they are.

        `Aurora` asks for it: what it scales itself it has to copy.
        """
        return self._network(shape, dtype).raw

    def weighed(self, dtype: np.dtype, weights: Mapping[str, float]) -> AutoEncoder | None:
        """The same, with weights of streams, by their names, in its network; None where that does not fuse streams.

        `Streams` asks for it.
        """
        kind = self._network((), dtype)
        if not isinstance(kind, Fused):
            return None
        same = copy.copy(self)
        same.network = kind.weighed(weights)
        return same

    def fit(self, x: ArrayLike, y: object = None) -> AutoEncoder:
        """Learn from observations, (n, ...), n >= 1. `y` is passed over.

        Raises:
            Mismatch: a ValueError: the network does not take observations of this shape, or they have fewer entries than there
                are components.
            ValueError: a parameter is out of range, or `x` is empty, or has a NaN or an infinity.

        Whatever is raised, the estimator stays as it was.
        """
        with uninterrupted():  # half an import would be the end of JAX in this process
            from auroraqd.descriptors import training  # noqa: F401

        self.check_parameters()
        x, rows = _read(x)
        kind = self._network(rows.shape[1:], x.dtype)
        self._check_fits(kind, x, rows.shape[1:])
        self._warn_of_large_images(kind, x)
        if has_streams(x) and not isinstance(kind, Fused):
            x = rows = flat(x)
        shape = rows.shape[1:]
        architecture = _Architecture(kind, shape, int(self.n_components), self.beta > 0)
        goes_on = self.warm_start and architecture.is_that_of(self._architecture())
        fits = self.n_fits_ if goes_on else 0
        rng = np.random.default_rng(None if self.random_state is None else [self.random_state, fits])
        start = _filled(architecture, self.weights_ if goes_on else None, rng)
        scaling = kind.scaling(x)
        best, last = self._trained(x, rows, architecture, scaling, start, goes_on, rng)
        import jax

        self.weights_ = [np.asarray(leaf) for leaf in jax.tree.leaves(best.network)]
        self.network_ = kind
        self.architecture_ = architecture.as_json()
        self.low_, self.high_, _ = scaling
        self.epochs_ = last.epochs
        self.validation_rmse_ = last.rmse if last.validated else math.nan
        self.training_rmse_ = best.rmse
        self.n_fits_ = fits + 1
        self._use: InUse | None = None
        return self

    @np.errstate(over="ignore", invalid="ignore")
    def transform(self, x: ArrayLike) -> np.ndarray:
        """Latent positions, (n, n_components) float64, of observations, (n, ...); NaN where numbers are too large to scale.

        Raises:
            NotFittedError: `fit` has not been called.
            ValueError: wrong shape, or a NaN or an infinity.
        """
        use = self._in_use()
        return use.encode(self._rows(x))

    @np.errstate(over="ignore", invalid="ignore")
    def describe(self, x: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Latent positions, and the root mean square errors of the reconstructions, (n,), on the [-1, 1] scale.

        Raises: as `transform`.
        """
        use = self._in_use()
        z, squares = use.describe(self._rows(x))
        return z, np.sqrt(squares / math.prod(self.observation_shape_))

    @np.errstate(over="ignore", invalid="ignore")
    def inverse_transform(self, z: ArrayLike) -> np.ndarray:
        """Reconstructed observations, (n, ...) float64, of latent positions, (n, n_components).

        Raises:
            NotFittedError: `fit` has not been called.
            ValueError: wrong shape.
        """
        use = self._in_use()
        z = numbers("z", z)
        n_components = self.architecture_["n_components"]
        if z.ndim != 2 or z.shape[1] != n_components:
            raise ValueError(f"z must have shape (n, {n_components}), got {z.shape}")
        return use.scaler.inverse(use.decode(z)).reshape(len(z), *self.observation_shape_)

    @property
    def observation_shape_(self) -> tuple[int, ...]:
        """Shape of one observation."""
        return tuple(self.architecture_["shape"])

    @property
    def raw_(self) -> bool:
        """Whether it was fitted on observations that nobody had scaled, if `Aurora` did it."""
        return self.network_.raw

    @property
    def scaling_(self) -> Scaling:
        """How observations are scaled."""
        return Scaling(self.low_, self.high_)

    def __repr__(self, N_CHAR_MAX: int = 700) -> str:
        text = super().__repr__(N_CHAR_MAX)
        return f"{text}, which chose {self.network_}" if self.network == "auto" and hasattr(self, "network_") else text

    def __getstate__(self) -> dict[str, Any]:
        state: Any = super().__getstate__()
        return {name: value for name, value in state.items() if name != "_use"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """What earlier versions wrote had a network by its kind, no metric and no noise."""
        super().__setstate__(state)
        for name, value in {"metric": "euclidean", "beta": 0.0, "noise": 0.0}.items():
            if name not in state:
                setattr(self, name, value)
        architecture = state.get("architecture_", {})
        if "kind" in architecture:
            self.network_ = MLP(tuple(architecture["hidden"])) if architecture["kind"] == "mlp" else Convolutional()
            self.architecture_ = {name: architecture[name] for name in ("shape", "n_components")}

    def _rows(self, x: ArrayLike) -> np.ndarray:
        """Observations, (n, ...), as (n, features)."""
        if isinstance(x, Mapping) or (isinstance(x, np.ndarray) and has_streams(x)):
            x = flat(observations("x", x))
        x = numeric("x", x, _OBSERVATIONS, rows=True, finite=True)
        if x.shape[1:] != self.observation_shape_:
            raise ValueError(f"x must have shape {rows_of(self.observation_shape_)}, as in fit, got {x.shape}")
        return x.reshape(len(x), math.prod(self.observation_shape_))

    def _protocol(self) -> Protocol:
        from auroraqd.descriptors.training import Protocol

        whole("n_components", self.n_components, most=networks.MOST_WIDTH)
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
            beta=number("beta", self.beta),
            noise=0.0 if self.noise is None else number("noise", self.noise),
        )

    def _network(self, shape: tuple[int, ...], dtype: np.dtype) -> Network:
        """The network for observations of this shape, without the rows, and dtype."""
        if isinstance(self.network, Network):
            self.network.check()
            return self.network
        if not isinstance(self.network, str) or self.network not in networks.NAMES:
            raise ValueError(
                f"network must be one of {', '.join(networks.NAMES)}, or a value of auroraqd.descriptors.networks, got "
                f"{shown(self.network)}"
            )
        hidden = self.hidden if self.network in ("auto", "mlp") else ()
        MLP(hidden).check()
        if self.network == "auto":
            return networks.chosen(shape, dtype, hidden)
        return MLP(tuple(hidden)) if self.network == "mlp" else networks.NAMED[self.network]()

    def _check_fits(self, kind: Network, x: np.ndarray, shape: tuple[int, ...]) -> None:
        """Raise Mismatch where a network does not take observations, (n, ...), or streams, (n,), whose rows have this shape."""
        if self.n_components > math.prod(shape):
            raise Mismatch(
                f"n_components must be at most {math.prod(shape)}, the entries of an observation, got {self.n_components}"
            )
        try:
            if isinstance(kind, Fused):
                kind.check_streams(x)
            kind.check_shape(shape)
        except ValueError as error:
            streams = (
                f", of the streams {', '.join(streams_of(x))} joined: network 'auto' takes streams" if has_streams(x) else ""
            )
            raise Mismatch(f"{error}{streams}") from None

    def _warn_of_large_images(self, kind: Network, x: np.ndarray) -> None:
        """Say so where dense layers were chosen for what looks like images, because these are too large."""
        if isinstance(kind, Fused):
            dense = [x[name] for name, _, part in kind.parts if isinstance(part, MLP)]
        else:
            dense = [x] if self.network == "auto" else []
        large = [stream.shape[1:] for stream in dense if networks.is_large_image(stream.shape[1:], stream.dtype)]
        if large:
            warnings.warn(
                f"observations of shape {rows_of(large[0])} look like images, but convolutions take at most {networks.LARGEST} "
                "pixels a side: dense layers learn them, worse and more slowly. Make them smaller",
                stacklevel=3,
            )

    def _architecture(self) -> _Architecture | None:
        """What was fitted, whatever has become of the parameters; None before."""
        if not hasattr(self, "weights_"):
            return None
        known = self.architecture_
        return _Architecture(self.network_, tuple(known["shape"]), known["n_components"], known.get("variational", False))

    def _trained(
        self,
        x: np.ndarray,
        rows: np.ndarray | FlatRows,
        architecture: _Architecture,
        scaling: Scaling,
        start: Any,
        goes_on: bool,
        rng: np.random.Generator,
    ) -> tuple[_Tried, Trained]:
        """The best network that there is, and the last training: the first, unless it failed.

        Args:
            x: observations, (n, ...), or streams, (n,).
            rows: the same, of streams all entries.
            architecture, scaling: as it is, and how they are scaled.
            start: its weights.
            goes_on: whether these are of an earlier fit, to be kept if all fails.
            rng: for all that is random.
        """
        from auroraqd.descriptors.training import Trained, train

        kind = architecture.network
        data = self._data(x, rows, kind, scaling, rng)
        protocol = self._protocol()._replace(learning_rate=kind.rate * self.learning_rate)
        if self.noise is None and self.network == "auto" and isinstance(kind, MLP):
            protocol = protocol._replace(noise=_NOISE)

        def judged(trained: Trained) -> _Tried:
            return _Tried(trained.network, trained.diverged, *_quality(kind, trained.network, scaling, rows, data))

        tried = [judged(Trained(start, [], math.nan, False, False))] if goes_on else []
        unexplained = max(0.0, 1 - tried[0].explained) if goes_on else 0.0
        while True:
            trained = train(start, data, kind, protocol, rng, self._listener(), unexplained)
            tried.append(judged(trained))
            if not tried[-1].failed:
                return tried[-1], trained
            if len(tried) - goes_on > _RETRIES:
                self._warn(tried[-1], trained, len(x))
                return max(tried, key=lambda one: one.explained), trained
            protocol = protocol._replace(learning_rate=_SLOWER * protocol.learning_rate)
            start = start if goes_on else _filled(architecture, None, rng)

    def _data(
        self, x: np.ndarray, rows: np.ndarray | FlatRows, kind: Network, scaling: Scaling, rng: np.random.Generator
    ) -> Data:
        """What to train on."""
        from auroraqd.descriptors.training import Data

        metric = self.metric
        if metric == "auto":
            metric = "geodesic" if kind.geodesic else "measured" if kind.measures else "euclidean"
        targets = None if metric == "euclidean" or not self.isometry else kind.measured(x, scaling)
        if metric == "geodesic" and targets is not None:
            targets = distances.along_the_graph(targets, rng)
        features = math.prod(rows.shape[1:])
        scaler = scaling.scaler(features)
        variance = _variances(rows, scaler, kind.groups(features))
        if isinstance(rows, FlatRows):
            return Data(rows, scaler, targets, variance)
        if kind.raw:
            return Data(x.reshape(len(x), -1), scaler, targets, variance)
        return Data(scaler(x).astype(np.float32), None, targets, variance)

    def _scaler(self) -> Scaler:
        """Without a limit: whether there is one is for those to say who describe."""
        return self.scaling_.unlimited().scaler(math.prod(self.observation_shape_))

    def _in_use(self) -> InUse:
        """The fitted network. In NumPy it is one of float64: then a copy described in a batch of another size differs in its
        last bits only, which is what the archive's margin for copies is made for.
        """
        if not hasattr(self, "weights_"):
            raise NotFittedError("this AutoEncoder has not been fitted yet: call fit first")
        if getattr(self, "_use", None) is None:
            architecture = self._architecture()
            assert architecture is not None
            raw = architecture.network.raw
            weights = self.weights_ if raw else [weight.astype(np.float64) for weight in self.weights_]
            network = _filled(architecture, weights, np.random.default_rng(0))
            self._use = _put_to_use(architecture.network, network, self._scaler())
        assert self._use is not None
        return self._use

    def _warn(self, tried: _Tried, trained: Trained, n: int) -> None:
        """Say of a training that failed, the last of three, how."""
        if trained.diverged:
            warnings.warn(
                f"training of AutoEncoder diverged in repeat {len(trained.epochs)}, epoch {trained.epochs[-1]}: the last good "
                "weights stay; a lower learning_rate may help",
                stacklevel=4,
            )
        else:
            warnings.warn(
                f"the latent space of AutoEncoder has collapsed: the reconstructions of {n:,} observations, RMSE "
                f"{tried.rmse:.3g} on the [-1, 1] scale, are hardly better than their mean. A lower learning_rate, more "
                "epochs or another network may help",
                stacklevel=4,
            )

    def _listener(self) -> Callable[[Progress], Any] | None:
        return _Printer() if self.verbose else _listener.get()


class _Architecture(NamedTuple):
    """What weights are of."""

    network: Network
    shape: tuple[int, ...]  # of an observation
    n_components: int
    variational: bool

    def is_that_of(self, known: _Architecture | None) -> bool:
        """Whether its weights can go on as those of this one; how much streams count is no matter."""
        return known is not None and known._replace(network=_unweighed(known.network)) == self._replace(
            network=_unweighed(self.network)
        )

    def as_json(self) -> dict[str, Any]:
        """What `network_` does not say."""
        known = {"shape": list(self.shape), "n_components": self.n_components}
        return {**known, "variational": True} if self.variational else known


def _unweighed(network: Network) -> Network:
    return network.weighed({}) if isinstance(network, Fused) else network


class _Tried(NamedTuple):
    """A training, and what came of it."""

    network: Any
    diverged: bool
    rmse: float  # of all rows
    explained: float  # share of the variance of the rows
    kept: float  # how well latent distances tell those that are wanted, of some rows
    spread: float  # of latent positions, as a share of their size

    @property
    def failed(self) -> bool:
        """Whether it diverged, or nothing was learned."""
        learned = self.explained >= _EXPLAINED or self.kept >= _KEPT
        return self.diverged or not learned or self.spread < _SPREAD


def _filled(of: _Architecture, weights: Sequence[np.ndarray] | None, rng: np.random.Generator) -> Any:
    """A network of this kind with these weights, in the order of `jax.tree.leaves`; None: random ones."""
    import jax

    made = of.network.build(of.shape, of.n_components, rng if weights is None else np.random.default_rng(0))
    made = made.variational() if of.variational else made
    return made if weights is None else jax.tree.unflatten(jax.tree.structure(made), weights)


def _put_to_use(kind: Network, network: Any, scaler: Scaler) -> InUse:
    from auroraqd.descriptors.inference import Compiled, Plain

    return (Compiled if kind.raw else Plain)(network, scaler)


def _read(x: Any) -> tuple[np.ndarray, np.ndarray | FlatRows]:
    """Observations, (n, ...), or streams, (n,), and the same by rows; of streams all entries of a row."""
    if not isinstance(x, Mapping) and not (isinstance(x, np.ndarray) and has_streams(x)):
        x = numeric("x", x, _OBSERVATIONS, rows=True, some=True, finite=True)
        return x, x
    x = observations("x", x)
    if len(x) == 0 or not finite_rows(x).all():
        raise ValueError(
            f"x must be finite, and of one row at least, got {'no row' if len(x) == 0 else 'a NaN or an infinity'}"
        )
    return x, FlatRows(x)


def _variances(rows: np.ndarray | FlatRows, scaler: Scaler, groups: tuple[int, ...]) -> float | np.ndarray:
    """The mean over observations, scaled, of their squared distance to the mean row; of several groups of entries one each."""
    n, ends = len(rows), np.cumsum(groups)
    total, squares = np.zeros(ends[-1]), np.zeros(len(groups))
    for start in range(0, n, _ROWS):
        part = scaler(rows[start : start + _ROWS])
        total += part.sum(axis=0)
        squares += [np.einsum("ij,ij->", of, of) for of in np.split(part, ends[:-1], axis=1)]
    means = np.split(total / n, ends[:-1])
    found = [max(float(square) / n - float(mean @ mean), 0.0) for square, mean in zip(squares, means, strict=True)]
    return found[0] if len(found) == 1 else np.array(found)


def _quality(
    kind: Network, network: Any, scaling: Scaling, x: np.ndarray | FlatRows, data: Data
) -> tuple[float, float, float, float]:
    """RMSE, and shares as in `_Tried`, of a network. Of rows that are all the same, nothing is left to be explained."""
    n, features = len(x), math.prod(x.shape[1:])
    use, variance = _put_to_use(kind, network, scaling.scaler(features)), float(np.sum(data.variance))
    found = [use.describe(x[start : start + _ROWS].reshape(-1, features)) for start in range(0, n, _ROWS)]
    z, squares = (np.concatenate(parts) for parts in zip(*found, strict=True))
    rmse = math.sqrt(squares.sum() / (n * features))
    if variance <= _NOTHING * features:
        return rmse, 1.0, 1.0, 1.0
    some = np.linspace(0, n - 1, min(n, _ROWS)).astype(int)
    targets = data.targets[some] if data.targets is not None else scaling.scaler(features)(x[some])
    spread = np.linalg.norm(z.std(axis=0)) / max(np.sqrt((z**2).sum(axis=1).mean()), np.finfo(np.float64).tiny)
    return rmse, 1 - squares.mean() / variance, distances.kept(targets, z[some]), float(spread)


class _Printer:
    """Prints the progress of a training, now and then."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, progress: Progress) -> None:
        if time.monotonic() >= self._next or progress.epoch == progress.max_epochs:
            print(progress)
            self._next = time.monotonic() + _VERBOSE_GAP


AutoEncoder.__module__ = "auroraqd"  # files name it so, wherever it lies
