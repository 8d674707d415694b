"""Statistics of replications: medians, quartiles, and rank-sum tests, as the paper has them."""

from collections.abc import Sequence
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

    values: dict[str, list[float]] = {}
    for result in results:
        value = result.value(measure)
        if np.isfinite(value):
            values.setdefault(result.variant, []).append(value)
    names = [name for name, measured in values.items() if len(measured) > 1]
    return {
        (one, other): float(mannwhitneyu(values[one], values[other]).pvalue)
        for i, one in enumerate(names)
        for other in names[i + 1 :]
    }
