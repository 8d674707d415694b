"""Statistics of replications: medians, quartiles and rank-sum tests, as the paper has them; and effect sizes.

A p-value says whether two variants differ, and with enough runs everything does. The effect size says by how much: the
probability that a run of the one has the larger value, A of Vargha and Delaney [1]: 0.5 where they are alike, 0 and 1 where
they do not overlap. Its interval is that of Newcombe [2], which does not vanish where they do not. Where many pairs are tested,
some differ by chance: Holm's correction [3] bounds the probability of a single such one.

[1] A. Vargha, H. D. Delaney, A Critique and Improvement of the CL Common Language Effect Size Statistics of McGraw and Wong,
Journal of Educational and Behavioral Statistics 25(2), 2000.
[2] R. G. Newcombe, Confidence intervals for an effect size measure based on the Mann-Whitney statistic. Part 2: asymptotic
methods and evaluation, Statistics in Medicine 25(4), 2006, method 5.
[3] S. Holm, A Simple Sequentially Rejective Multiple Test Procedure, Scandinavian Journal of Statistics 6(2), 1979.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from auroraqd.experiments.replication import Result
from auroraqd.experiments.variants import Experiment, Variant


class Quartiles(NamedTuple):
    """Median, first and third quartile; NaN where nothing was measured."""

    median: float
    first: float
    third: float

    @classmethod
    def of(cls, values: np.ndarray) -> "Quartiles":
        """Of the values, (n,), that are finite."""
        values = values[np.isfinite(values)]
        if len(values) == 0:
            return cls(np.nan, np.nan, np.nan)
        first, median, third = np.quantile(values, [0.25, 0.5, 0.75])
        return cls(float(median), float(first), float(third))


class Summary(NamedTuple):
    """A variant over its replications."""

    variant: Variant
    replications: int
    measures: dict[str, Quartiles]


def columns(experiment: Experiment) -> tuple[str, ...]:
    """What is summarised, measures of the experiment among them."""
    return ("size", *(measure.name for measure in experiment.measures), "rmse", "rmse_metres", "seconds")


def summaries(results: Sequence[Result], experiment: Experiment) -> list[Summary]:
    """A summary of each variant that has results, in the order of the experiment."""
    found = []
    for name, variant in experiment.variants.items():
        rows = [result for result in results if result.variant == name]
        if rows:
            measures = {m: Quartiles.of(np.array([row.value(m) for row in rows])) for m in columns(experiment)}
            found.append(Summary(variant, len(rows), measures))
    return found


def rank_sums(results: Sequence[Result], measure: str) -> dict[tuple[str, str], float]:
    """The two-sided p-value of the Wilcoxon rank-sum test (Mann-Whitney U) for each pair of variants.

    Exact where there are no ties and few replications, as SciPy decides. Pairs of which one has fewer than two values are
    left out.
    """
    from scipy.stats import mannwhitneyu

    values = values_of(results, measure)
    return {(one, other): float(mannwhitneyu(values[one], values[other]).pvalue) for one, other in _pairs(values)}


def values_of(results: Sequence[Result], measure: str) -> dict[str, np.ndarray]:
    """What the runs of each variant came to, those that are finite."""
    values: dict[str, list[float]] = {}
    for result in results:
        value = result.value(measure)
        if np.isfinite(value):
            values.setdefault(result.variant, []).append(value)
    return {name: np.array(measured) for name, measured in values.items()}


def _pairs(values: Mapping[str, np.ndarray]) -> list[tuple[str, str]]:
    names = [name for name, measured in values.items() if len(measured) > 1]
    return [(one, other) for i, one in enumerate(names) for other in names[i + 1 :]]


class Effect(NamedTuple):
    """The probability that a run of one variant has a larger value than one of another; ties count half.

    Attributes:
        a: estimated.
        low, high: its 95% interval.
    """

    a: float
    low: float
    high: float

    @classmethod
    def of(cls, one: np.ndarray, other: np.ndarray) -> "Effect":
        """Of the values of both, (n,) and (m,).

        Examples:
            >>> import numpy as np
            >>> from auroraqd.experiments.statistics import Effect
            >>> print("{:.2f} ({:.2f}, {:.2f})".format(*Effect.of(np.array([4.0, 5.0, 6.0]), np.array([1.0, 2.0, 3.0]))))
            1.00 (0.56, 1.00)
        """
        a = float((np.sign(one[:, None] - other).mean() + 1) / 2)
        return cls(a, 1 - _upper(1 - a, len(one), len(other)), _upper(a, len(one), len(other)))


def _upper(a: float, n: int, m: int) -> float:
    """The largest probability that an estimate does not lie significantly below [2]."""
    from scipy.optimize import brentq
    from scipy.special import ndtri

    if a == 1:
        return 1.0
    z, more = float(ndtri(0.975)), (n + m) / 2 - 1

    def excess(p: float) -> float:
        return (p - a) ** 2 - z**2 * p * (1 - p) * (1 + more * ((1 - p) / (2 - p) + p / (1 + p))) / (n * m)

    # Below 0 at the estimate itself, and above at 1; of an estimate of 0 a little above it.
    return float(brentq(excess, max(a, 1e-12), 1.0))  # pyright: ignore[reportArgumentType]


def holm(pvalues: Sequence[float]) -> list[float]:
    """P-values corrected for how many they are: the smallest times n, the next times n - 1, never smaller than the one before.

    Examples:
        >>> from auroraqd.experiments.statistics import holm
        >>> holm([0.25, 0.03, 0.01])
        [0.25, 0.06, 0.03]
    """
    corrected, before = [0.0] * len(pvalues), 0.0
    for rank, i in enumerate(np.argsort(pvalues, kind="stable").tolist()):
        before = corrected[i] = max(before, min(1.0, (len(pvalues) - rank) * pvalues[i]))
    return corrected


class Comparison(NamedTuple):
    """Two variants beside each other.

    Attributes:
        p: of the rank-sum test, two-sided; corrected: for all pairs of the same measure, by Holm.
        effect: the probability that the first has the larger value.
    """

    p: float
    corrected: float
    effect: Effect

    @property
    def swapped(self) -> "Comparison":
        """The second beside the first."""
        a, low, high = self.effect
        return self._replace(effect=Effect(1 - a, 1 - high, 1 - low))


def comparisons(results: Sequence[Result], measure: str) -> dict[tuple[str, str], Comparison]:
    """All pairs of variants with two values or more: the test, corrected for all of them, and the effect size."""
    tests, values = rank_sums(results, measure), values_of(results, measure)
    corrected = holm(list(tests.values()))
    return {
        pair: Comparison(p, q, Effect.of(values[pair[0]], values[pair[1]]))
        for (pair, p), q in zip(tests.items(), corrected, strict=True)
    }
