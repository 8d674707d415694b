"""Refinement: from skills that come close to a goal to a genotype that comes closer, in a few trials.

A repertoire is a grid of skills, and a goal lies between them. What a small change of the genotype does to the outcome is read
off skills nearby: a linear model, by least squares weighted by closeness. Its solution, within a trust region and the bounds of
the genes, is tried (a step of Gauss and Newton, as Levenberg's and Marquardt's within a region [1, Chapters 4 and 10]), and
each trial makes the model better along the way it went, as in Broyden's method [1, Section 11.1].

Outcomes jump where contacts are made or lost, so only skills that are alike in what they observed belong to one model; and a
start from which two trials in a row fail is left for the next nearest skill.

[1] J. Nocedal, S. J. Wright, Numerical Optimization, second edition, Springer, 2006.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from auroraqd.descriptors.scaling import Scaling, far_outside
from auroraqd.observations import features_of, flat, streams_of

_CANDIDATES = 1000  # skills, the nearest by genotype, whose observations are looked at
_REACH = 0.1  # of the first trust region, where genes go from 0 to 1
_GROWTH, _CUT = 1.5, 0.5  # of the trust region after a trial that was better, and of the step of one that was not
_FAILURES = 2  # in a row, after which a start is left
_RIDGE = 1e-2  # of slopes: what nobody has tried has little effect
_CLOSE = 1e-4  # closer genotypes weigh no more: their slopes are rounding or noise


class Ruler(NamedTuple):
    """What outcomes are measured with: each channel (last axis) by its range in the repertoire.

    Attributes:
        half: (features,), half a range, of each entry of an outcome.
        stream: (features,) int, which stream it belongs to.
    """

    half: np.ndarray
    stream: np.ndarray

    @classmethod
    def of(cls, outcomes: np.ndarray) -> Ruler:
        """For outcomes, (n, ...), of streams too; those far outside all others do not say how long it is."""
        streams, usual = streams_of(outcomes), ~far_outside(outcomes)
        widths = [features_of(stream) for stream in streams.values()]
        halves = [Scaling.of(s[usual]).scaler(width).half for s, width in zip(streams.values(), widths, strict=True)]
        return cls(np.concatenate(halves), np.repeat(np.arange(len(widths)), widths))

    def apart(self, outcomes: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """From a goal, (features,), to outcomes, (n, ...): (n, entries that are given).

        Its length is the root mean square over the entries given, those that are not NaN, in which streams count alike.
        """
        given = ~np.isnan(goal)
        entries = np.bincount(self.stream[given])
        weight = 1 / self.half[given] / np.sqrt(entries[self.stream[given]] * np.count_nonzero(entries))
        parts = []
        for index, rows in enumerate(streams_of(outcomes).values()):
            wanted = goal[self.stream == index]
            parts.append(rows.reshape(len(rows), -1)[:, ~np.isnan(wanted)] - wanted[~np.isnan(wanted)])
        return np.concatenate(parts, axis=1) * weight


class Skills(NamedTuple):
    """What is known before the first trial.

    Attributes:
        genotype: (n, n_genes).
        outcome: (n, ...), of which goals are made.
        observation: (n, ...), in which those that belong to one model are alike.
        outcomes, observations: what measures them.
    """

    genotype: np.ndarray
    outcome: np.ndarray
    observation: np.ndarray
    outcomes: Ruler
    observations: Ruler

    def near(self, row: int) -> np.ndarray:
        """Rows of the skills that tell what small changes of one of them do."""
        apart = ((self.genotype - self.genotype[row]) ** 2).sum(axis=1)
        most = min(_CANDIDATES, len(apart))
        rows = np.argpartition(apart, most - 1)[:most]
        seen = flat(self.observation[row : row + 1])[0].astype(np.float64)
        apart = apart[rows] + (self.observations.apart(self.observation[rows], seen) ** 2).sum(axis=1)
        return rows[np.argsort(apart, kind="stable")[: 2 * self.genotype.shape[1] + 5]]


class Search:
    """The trials for one goal: ask for a genotype, tell its outcome.

    Args:
        skills: that are known.
        goal: (features,), NaN for what does not matter.
        starts: how many skills to start from, at most.
        rng: for a step where no skill tells which.
    """

    def __init__(self, skills: Skills, goal: np.ndarray, starts: int, rng: np.random.Generator):
        self._skills, self._goal, self._rng = skills, goal, rng
        error = np.linalg.norm(skills.outcomes.apart(skills.outcome, goal), axis=1)
        self._starts = np.argsort(error, kind="stable")[:starts].tolist()
        self.row: int = self._starts[0]
        """The nearest skill."""
        self.error = float(error[self.row])
        """Of the best so far."""
        self._tried: list[tuple[np.ndarray, np.ndarray]] = []
        self._start()
        self._best = self._here

    def _start(self) -> None:
        """Begin at the next skill, or, after the last, at the best so far."""
        if self._starts:
            row = self._starts.pop(0)
            near = np.append(row, self._skills.near(row))
            self._known = self._skills.genotype[near], self._skills.outcomes.apart(self._skills.outcome[near], self._goal)
            self._here = self._known[0][0], self._known[1][0]
        else:
            self._here = self._best
        self._radius, self._failures = _REACH, 0

    def ask(self) -> np.ndarray:
        """The genotype to try, (n_genes,)."""
        here, missing = self._here
        genotype = np.vstack([self._known[0], *(genotype for genotype, _ in self._tried)]) - here
        outcome = np.vstack([self._known[1], *(apart for _, apart in self._tried)]) - missing
        return here + step(slopes(genotype, outcome), -missing, -here, 1 - here, self._radius, self._rng)

    def tell(self, genotype: np.ndarray, outcome: np.ndarray) -> bool:
        """What a trial led to, (1, ...); returns whether it is the best so far. One with a NaN or an infinity failed."""
        apart = self._skills.outcomes.apart(outcome, self._goal)[0]
        error = float(np.linalg.norm(apart))
        worth = np.isfinite(error)
        if worth:
            self._tried.append((genotype, apart))
        best = worth and error < self.error
        if best:
            self._best, self.error = (genotype, apart), error
        if worth and error < np.linalg.norm(self._here[1]):
            self._here, self._failures = (genotype, apart), 0
            self._radius *= _GROWTH
        else:
            self._failures += 1
            self._radius = _CUT * float(np.linalg.norm(genotype - self._here[0]))
            if self._failures >= _FAILURES:
                self._start()
        return bool(best)


def slopes(genotype: np.ndarray, outcome: np.ndarray) -> np.ndarray:
    """How outcomes change with genes, (n_genes, m), of differences, (k, n_genes) and (k, m): weighted least squares."""
    weighted = genotype / ((genotype**2).sum(axis=1) + _CLOSE**2)[:, None]
    return np.linalg.solve(weighted.T @ genotype + _RIDGE * np.eye(genotype.shape[1]), weighted.T @ outcome)


def step(
    slope: np.ndarray, wanted: np.ndarray, low: np.ndarray, high: np.ndarray, radius: float, rng: np.random.Generator
) -> np.ndarray:
    """The shortest change of the genotype that changes the outcome as wanted, (n_genes,).

    Where it would leave the bounds, genes stay at them, and the others do what is left.

    Args:
        slope: (n_genes, m).
        wanted: (m,).
        low, high: (n_genes,), bounds of the change.
        radius: it is no longer.
        rng: for a step that long where no gene has an effect.
    """
    change, free = np.zeros(len(slope)), np.ones(len(slope), bool)
    while free.any():
        left = wanted - change[~free] @ slope[~free]
        change[free] = np.linalg.lstsq(slope[free].T, left, rcond=1e-6)[0]
        length = np.linalg.norm(change)
        if length == 0:
            change = rng.normal(size=len(slope))
            length = np.linalg.norm(change)
            change *= radius / length
            break
        change *= min(1.0, radius / length)
        outside = free & ((change < low) | (change > high))
        if not outside.any():
            break
        change[outside] = np.clip(change, low, high)[outside]
        free &= ~outside
    return np.clip(change, low, high)
