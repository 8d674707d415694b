"""Adaptation: which skill of a repertoire works on a robot that is not the one of the repertoire, in a few trials.

A repertoire promises what each of its skills does. On a robot that lost a joint, or that is real where the repertoire is of a
simulator, many promises fail. Trial and error with a map of skills as prior knowledge [1]: a Gaussian process with the
promises as its mean learns from each trial how far promises hold for skills that are like the one tried, and the next skill to
try is the one with the highest upper confidence bound. Given a goal, it learns more than how good a trial was: where outcomes
have moved to, so that a skill that was made for another goal can be the one for this goal.

There may be several promises for each skill, one for each robot that this one may be: whole, without a leg, on a slope. Trials
tell which of them are likely [2], and what is expected is the mean over them, weighed by that.

[1] A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.
[2] R. Pautrat, K. Chatzilygeroudis, J.-B. Mouret, Bayesian Optimization with Automatic Prior Selection for Data-Efficient
Direct Policy Search, ICRA 2018, which takes the likelihood times the expected improvement; here it is a mean over the priors.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern

from auroraqd._checks import number, numbers, shown, whole

_MOST = 1e50  # of any number, so that neither squares nor shares of it overflow; and 1 / _MOST the least to divide by


class Best(NamedTuple):
    """The best trial so far: the row of the skill, and its performance."""

    row: int
    performance: float


class Adaptation:
    """Ask for a skill, try it, tell what happened.

    The model is a Gaussian process with a Matern 5/2 kernel of fixed length. A skill is tried once. Everything is
    deterministic: the same trials lead to the same next one.

    Args:
        space: (n, d), a skill a row: skills that are close in it are expected to fail alike. The descriptor; or, where the
            descriptor does not tell how a skill works, `numpy.hstack([descriptor, genotype])`. Columns are scaled to a spread
            of 1.
        promise: what each skill does according to the repertoire: (n,) its performance, larger is better; or, with a goal,
            (n, m) its outcome, a place or whatever numbers have a distance. Several, stacked: (priors, n), or (priors, n, m).
        goal: (m,), the outcome that is wanted: performance is minus the distance to it. None: the promise is performance.
        kappa: how much uncertain skills are favoured: the bound is the expected performance plus kappa standard deviations,
            of the performance or of the outcome.
        length: of the kernel, root mean square over the columns of the scaled space.
        scale: how far promises may fail, in their units, (m,) or one for all. By default the spread of the promises: a promise
            that fails says nothing. With several promises: how far the nearest of them may fail.
        noise: of a trial, as a share of the scale.

    Raises:
        ValueError: an argument has the wrong shape, is not finite, is out of range, or beyond 1e50 in size.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> space = np.linspace(0, 1, 50)[:, None]  # 50 skills, each promised to be as good as its row is high
        >>> adaptation = auroraqd.Adaptation(space, promise=space[:, 0])
        >>> for _ in range(6):
        ...     row = adaptation.ask()
        ...     adaptation.tell(row, 1 - abs(space[row, 0] - 0.4))  # on this robot those in the middle are best
        >>> bool(abs(space[adaptation.best.row, 0] - 0.4) < 0.1)
        True
    """

    def __init__(
        self,
        space: ArrayLike,
        promise: ArrayLike,
        goal: ArrayLike | None = None,
        *,
        kappa: float = 0.85,
        length: float = 0.4,
        scale: ArrayLike | None = None,
        noise: float = 0.1,
    ):
        space, promise = numbers("space", space, " of shape (n, d)"), numbers("promise", promise)
        if space.ndim != 2 or space.size == 0:
            raise ValueError(f"space must have shape (n, d), with at least one skill, got {space.shape}")
        promise = _stacked(promise, len(space), with_goal=goal is not None)
        self._goal = None if goal is None else numbers("goal", goal)
        if self._goal is not None and (self._goal.shape != promise.shape[2:] or not np.isfinite(self._goal).all()):
            raise ValueError(f"goal must be {promise.shape[2]} finite numbers, as an outcome, got {shown(goal)}")
        for name, values in (("space", space), ("promise", promise), ("goal", self._goal)):
            if values is not None and not (np.abs(values) <= _MOST).all():
                worst = values[~(np.abs(values) <= _MOST)][0]
                raise ValueError(f"{name} must be finite, and at most {_MOST:g} in size, got {worst:g}")
        self._kappa = number("kappa", kappa, most=_MOST, wanted=f"from 0 to {_MOST:g}")
        self._space = space / (_spread(space) * np.sqrt(space.shape[1]))
        self._promise = promise.copy()
        spread = _spread(promise.reshape(-1, promise.shape[2]))
        self._scale = spread if scale is None else numbers("scale", scale)
        if self._scale.shape not in ((), spread.shape) or not ((self._scale >= 1 / _MOST) & (self._scale <= _MOST)).all():
            wanted = f"one positive number, or {len(spread)}, from {1 / _MOST:g} to {_MOST:g}"
            raise ValueError(f"scale must be {wanted}, got {shown(scale)}")
        self._scale = np.broadcast_to(self._scale, spread.shape)
        kernel = Matern(number("length", length, least=1e-6, most=_MOST, wanted=f"from 1e-6 to {_MOST:g}"), "fixed", nu=2.5)
        wanted = f"from 1e-4, or copies have no inverse, to {_MOST:g}"
        variance = number("noise", noise, least=1e-4, most=_MOST, wanted=wanted) ** 2
        self._model = GaussianProcessRegressor(kernel, alpha=variance, optimizer=None)  # pyright: ignore[reportArgumentType] - its stub
        self._rows: list[int] = []
        self._outcomes: list[np.ndarray] = []
        self._tried = np.zeros(len(space), bool)
        self._posterior = np.full(len(promise), 1 / len(promise))
        self._belief: tuple[np.ndarray, np.ndarray] | None = None

    def __repr__(self) -> str:
        return f"Adaptation of {len(self._tried)} skills after {int(self._tried.sum())} tried: best {self.best}"

    def ask(self) -> int:
        """The row of the skill to try next.

        Raises:
            RuntimeError: all have been tried.
        """
        if self._tried.all():
            raise RuntimeError(f"all {len(self._tried)} skills have been tried")
        mean, deviation = self._believed()
        return int(np.where(self._tried, -np.inf, mean + self._kappa * deviation).argmax())

    def tell(self, row: int, outcome: ArrayLike) -> None:
        """Learn what a trial led to: any skill, whether it was asked for or not. One tried twice counts twice.

        Args:
            row: of the skill.
            outcome: the performance, or (m,) the outcome where outcomes were promised. NaN, one or all: the trial failed;
                nothing is learned from it but not to ask for this skill again.

        Raises:
            ValueError: there is no such row, or the outcome has the wrong shape, or entries beyond 1e50 in size.
        """
        row = whole("row", row, least=0, most=len(self._tried) - 1)
        columns = self._promise.shape[2]
        wanted = "a number" if self._goal is None else f"{columns} numbers, as promised"
        wanted = f"outcome must be {wanted}, finite and at most {_MOST:g} in size, or NaN for a trial that failed, got"
        try:
            told = numbers("outcome", outcome).reshape(-1).copy()  # who tells may use the array again
        except ValueError:
            raise ValueError(f"{wanted} {shown(outcome)}") from None
        failed = bool(np.isnan(told).any())
        if (np.abs(told) > _MOST).any() or (len(told) != columns and not (failed and len(told) == 1)):
            raise ValueError(f"{wanted} {shown(outcome)}")
        self._tried[row] = True
        if not failed:
            self._rows.append(row)
            self._outcomes.append(told)
            self._belief = None

    @property
    def best(self) -> Best | None:
        """The best trial so far; None before the first that did not fail."""
        if not self._rows:
            return None
        values = self._value(np.array(self._outcomes))
        return Best(self._rows[int(values.argmax())], float(values.max()))

    @property
    def posterior(self) -> np.ndarray:
        """(priors,) how likely each of the promises is after the trials so far; all were as likely before. One: 1."""
        self._believed()
        return self._posterior.copy()

    @property
    def expected(self) -> float:
        """The highest performance expected of a skill that was not tried, -inf if there is none.

        The rule of [1] to stop: the best trial is at least 0.9 of it, for performance that is positive. Given a goal, stop when
        the distance is small enough instead: a skill of uncertain outcome counts as far here, see `predict`.
        """
        return float(np.where(self._tried, -np.inf, self._believed()[0]).max())

    def predict(self) -> tuple[np.ndarray, np.ndarray]:
        """What is expected of each skill after the trials so far: its performance and the standard deviation, (n,) each.

        With a goal, the expected distance is the root mean square, and the deviation that of the outcome, all columns together.
        """
        mean, deviation = self._believed()
        return mean.copy(), deviation.copy()

    def _believed(self) -> tuple[np.ndarray, np.ndarray]:
        if self._belief is None:
            self._belief = self._predicted()
        return self._belief

    def _predicted(self) -> tuple[np.ndarray, np.ndarray]:
        moved, share = np.zeros_like(self._promise), np.ones((self._promise.shape[1], 1))
        if self._rows:
            moved, share = self._displaced()
        outcome = self._promise + self._scale * moved  # (priors, n, m), if the prior is this one
        mean = np.tensordot(self._posterior, outcome, axes=1)
        apart = np.tensordot(self._posterior, ((outcome - mean) ** 2).sum(axis=2), axes=1)  # what the priors disagree on
        deviation = np.sqrt(((self._scale * share) ** 2).sum(axis=1) + apart)
        if self._goal is None:
            return mean[:, 0], deviation
        return -np.hypot(np.linalg.norm(mean - self._goal, axis=1), deviation), deviation

    def _displaced(self) -> tuple[np.ndarray, np.ndarray]:
        """By how much each promise fails, (priors, n, m) in scales, and the deviation, (n, 1), which is the same of all.

        One model for all: they differ in what was promised, not in what was tried. How likely each promise makes the trials
        is the marginal likelihood, of which all but the squares is the same.
        """
        priors, n, columns = self._promise.shape
        failed = (np.array(self._outcomes) - self._promise[:, self._rows]) / self._scale  # (priors, trials, m)
        told = failed.transpose(1, 0, 2).reshape(len(self._rows), -1)
        self._model.fit(self._space[self._rows], told)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Predicted variances smaller than 0")  # of rounding, at what was tried
            mean, deviation = self._model.predict(self._space, return_std=True)
        squares = (told * self._model.alpha_.reshape(told.shape)).reshape(-1, priors, columns).sum(axis=(0, 2))
        likelihood = np.exp((squares.min() - squares) / 2)
        self._posterior = likelihood / likelihood.sum()
        moved = np.reshape(mean, (n, priors, columns)).transpose(1, 0, 2)
        return moved, np.reshape(deviation, (n, -1))[:, :1]

    def _value(self, outcomes: np.ndarray) -> np.ndarray:
        """Performance of outcomes, (k, m) to (k,)."""
        return outcomes[:, 0] if self._goal is None else -np.linalg.norm(outcomes - self._goal, axis=1)


def _stacked(promise: np.ndarray, n: int, *, with_goal: bool) -> np.ndarray:
    """Promises for n skills, (priors, n, m): of one there need be no first axis, of performance no last."""
    found = promise if with_goal else promise[..., None]
    found = found if found.ndim == 3 else found[None]
    if found.ndim != 3 or found.shape[1] != n:
        wanted = f"({n}, m) or (priors, {n}, m), for there is a goal" if with_goal else f"({n},) or (priors, {n})"
        raise ValueError(f"promise must have shape {wanted}, got {promise.shape}")
    if found.size == 0:
        raise ValueError(f"promise must have entries, got shape {promise.shape}")
    return found


def _spread(rows: np.ndarray) -> np.ndarray:
    """Standard deviation of each column, to divide by: that of a constant, or of what is all but one, is 1."""
    return np.where(np.ptp(rows, axis=0) > 1 / _MOST, np.maximum(rows.std(axis=0), 1 / _MOST), 1.0)
