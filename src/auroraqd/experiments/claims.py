"""What a paper claims, as data: each claim with its criterion, judged by code from results alone.

Here is what claims are made of; those of the paper are in `auroraqd.experiments.paper_claims`, those of the follow-up in
`auroraqd.experiments.follow_up`. A claim that is an order of two variants agrees if the rank-sum test tells them apart in that
order, at 5% after Holm's correction for all pairs of the same measure. A median agrees within a factor of 1.5. Claims that need
runs that are not there cannot be known, nor orders of variants with so few that no outcome would tell them apart.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np

from auroraqd.experiments.replication import Point, Result
from auroraqd.experiments.statistics import Comparison, comparisons, holm, values_of

FACTOR = 1.5  # between a median here and one of the paper
LEVEL = 0.05  # of tests
SETTLED = 0.9  # of its final size, from when on a repertoire has converged
WITHIN = f"the median is within a factor of {FACTOR:g}"
APART = f"told apart in this order, p < {LEVEL:g} after Holm"
TOGETHER = f"not told apart, p >= {LEVEL:g} after Holm"


class Verdict(Enum):
    """What becomes of a claim."""

    AGREES = "agrees"
    DIFFERS = "differs"
    UNKNOWN = "cannot be known"


class Finding(NamedTuple):
    """What the results say of a claim: in words, and whether it holds; None where they cannot say."""

    ours: str
    holds: bool | None


NOTHING = Finding("", None)


@dataclass(frozen=True)
class Evidence:
    """The results of one experiment.

    Args:
        results, points: as a `Ledger` has them.
    """

    results: Sequence[Result]
    points: Sequence[Point] = ()

    def values(self, variant: str, measure: str) -> np.ndarray:
        """What the runs of a variant came to; none where there are none."""
        return values_of(self.results, measure).get(variant, np.empty(0))

    def median(self, variant: str, measure: str) -> float:
        """The median over the runs of a variant; NaN without any."""
        values = self.values(variant, measure)
        return float(np.median(values)) if len(values) else float("nan")

    def compared(self, one: str, other: str, measure: str) -> Comparison | None:
        """Two variants; None where one has fewer than two runs."""
        if measure not in self._comparisons:
            self._comparisons[measure] = comparisons(self.results, measure)
        found = self._comparisons[measure]
        return found.get((one, other)) or (found[other, one].swapped if (other, one) in found else None)

    def can_be_told(self, one: str, other: str, measure: str) -> bool:
        """Whether two variants would be told apart, as many runs as there are, if these did not overlap at all."""
        n, m = len(self.values(one, measure)), len(self.values(other, measure))
        return 2 / comb(n + m, n) * len(self._comparisons[measure]) < LEVEL  # the exact rank-sum test, and Holm's worst case

    @cached_property
    def _comparisons(self) -> dict[str, dict[tuple[str, str], Comparison]]:
        return {}

    def runs(self, variant: str) -> list[list[Point]]:
        """The points of each run of a variant, in the order of generations."""
        own = sorted((p for p in self.points if p.variant == variant), key=lambda p: p[:3])
        return [[p for p in own if p.replication == r] for r in sorted({p.replication for p in own})]


Judge = Callable[[Evidence], Finding]


@dataclass(frozen=True)
class Claim:
    """Something that a paper says of its results.

    Args:
        name: short and unique.
        experiment: its name.
        section: of the paper.
        text: what it says.
        published: its numbers; empty where it gives none.
        criterion: when it agrees.
        judge: from the results to the finding.
        why: what is known about a claim that does not agree.
    """

    name: str
    experiment: str
    section: str
    text: str
    published: str
    criterion: str
    judge: Judge
    why: str = ""


class Judged(NamedTuple):
    """A claim and what became of it."""

    claim: Claim
    ours: str
    verdict: Verdict

    @property
    def why(self) -> str:
        """What is known about one that does not agree."""
        return "" if self.verdict is Verdict.AGREES else self.claim.why


def judged(claims: Iterable[Claim], evidence: Mapping[str, Evidence]) -> list[Judged]:
    """Claims and the verdict by the results of each experiment; those of one without results cannot be known."""
    found = []
    for claim in claims:
        own = evidence.get(claim.experiment)
        ours, holds = NOTHING if own is None else claim.judge(own)
        verdict = Verdict.UNKNOWN if holds is None else Verdict.AGREES if holds else Verdict.DIFFERS
        nothing = "too few runs, or too short" if own is not None and own.results else "no results of it"
        found.append(Judged(claim, ours or nothing, verdict))
    return found


def median_near(variant: str, measure: str, published: float) -> Judge:
    """The median is within `FACTOR` of the published one, which may be negative; 0 means 0."""

    def finding(evidence: Evidence) -> Finding:
        ours = evidence.median(variant, measure)
        if np.isnan(ours):
            return NOTHING
        least, most = sorted((published / FACTOR, published * FACTOR))
        near = least <= ours <= most
        return Finding(f"{ours:.3g}", bool(near))

    return finding


def _said(measure: str, one: str, other: str, evidence: Evidence, c: Comparison) -> str:
    a, low, high = c.effect
    medians = f"{evidence.median(one, measure):.3g} and {evidence.median(other, measure):.3g}"
    alone = f" ({c.p:.2g} before it is corrected)" if c.p < LEVEL <= c.corrected else ""
    return f"{one}, {other}: {medians}; p = {c.corrected:.2g}{alone}, A = {a:.2f} ({low:.2f}, {high:.2f})"


def _pairs(
    measure: str, ones: Sequence[str], others: Sequence[str], holds: Callable[[Comparison], bool], *, apart: bool = False
) -> Judge:
    """Of each of some with each of others, what a comparison must say; all must be there.

    `apart`: it must tell them apart; then those do not count of which too few runs are there to be told apart at all.
    """

    def finding(evidence: Evidence) -> Finding:
        found = {(one, other): evidence.compared(one, other, measure) for one in ones for other in others}
        known = {pair: c for pair, c in found.items() if c is not None}
        text = "; ".join(_said(measure, *pair, evidence, c) for pair, c in known.items())
        if apart:
            known = {pair: c for pair, c in known.items() if holds(c) or evidence.can_be_told(*pair, measure)}
        verdicts = [holds(c) for c in known.values()]
        return Finding(text, False if not all(verdicts) else True if len(known) == len(found) else None)

    return finding


def higher(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    """Each of some is told apart from each of others as higher."""
    return _pairs(measure, ones, others, lambda c: c.corrected < LEVEL and c.effect.a > 0.5, apart=True)


def lower(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    """Each of some is told apart from each of others as lower."""
    return _pairs(measure, ones, others, lambda c: c.corrected < LEVEL and c.effect.a < 0.5, apart=True)


def alike(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    """None of some is told apart from any of others."""
    return _pairs(measure, ones, others, lambda c: c.corrected >= LEVEL)


def no_lower(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    """None of some is told apart from any of others as lower."""
    return _pairs(measure, ones, others, lambda c: c.corrected >= LEVEL or c.effect.a > 0.5)


def ratio(measure: str, one: str, others: Sequence[str], least: float, most: float = np.inf) -> Judge:
    """The median of one over those of others, in a range."""

    def finding(evidence: Evidence) -> Finding:
        with np.errstate(divide="ignore"):
            ratios = [float(np.divide(evidence.median(one, measure), evidence.median(other, measure))) for other in others]
        text = ", ".join(f"{r:.3g} times that of {other}" for r, other in zip(ratios, others, strict=True) if not np.isnan(r))
        inside = [least <= ratio <= most for ratio in ratios if not np.isnan(ratio)]
        return Finding(text, False if not all(inside) else True if len(inside) == len(others) else None)

    return finding


def at_least(measure: str, variants: Sequence[str], least: float) -> Judge:
    """The medians of all of these are as high."""

    def finding(evidence: Evidence) -> Finding:
        medians = {name: evidence.median(name, measure) for name in variants}
        text = ", ".join(f"{name} {median:.3g}" for name, median in medians.items() if not np.isnan(median))
        known = [median >= least for median in medians.values() if not np.isnan(median)]
        return Finding(text, False if not all(known) else True if len(known) == len(variants) else None)

    return finding


def below(measure: str, variant: str, most: float) -> Judge:
    """The median is lower."""

    def finding(evidence: Evidence) -> Finding:
        median = evidence.median(variant, measure)
        return NOTHING if np.isnan(median) else Finding(f"{variant} {median:.3g}", bool(median < most))

    return finding


def protocol(variants: Sequence[str], replications: int, generations: int, batch_size: int) -> Judge:
    """Runs of the published budget, as many as there were."""

    def finding(evidence: Evidence) -> Finding:
        own = [r for r in evidence.results if r.variant in variants]
        if not own:
            return NOTHING
        runs = sorted({sum(r.variant == name for r in own) for name in variants})
        budgets = sorted({(r.generations, r.batch_size) for r in own})
        spoken = " or ".join(f"{generations:,} of {size}" for generations, size in budgets)
        return Finding(
            f"{runs[0]}{f' to {runs[-1]}' * (len(runs) > 1)} runs of each, generations: {spoken}",
            runs[0] >= replications and budgets == [(generations, batch_size)],
        )

    return finding


def shrinks(variant: str, updates: Sequence[int]) -> Judge:
    """Smaller at the look after an update than at the one before in most of these, and larger at the end of the run."""

    def finding(evidence: Evidence) -> Finding:
        falls, grows = [], []
        for run in evidence.runs(variant):
            generations, sizes = np.array([p.generation for p in run]), np.array([p.size for p in run])
            for update in updates:
                before, after = sizes[generations <= update], sizes[generations > update]
                if len(before) and len(after):
                    falls.append(after[0] < before[-1])
                    grows.append(after[-1] > before[-1])
        if not falls:
            return NOTHING
        text = f"{variant}: smaller after {np.mean(falls):.0%} of {len(falls)} updates, then larger after {np.mean(grows):.0%}"
        return Finding(text, bool(np.mean(falls) > 0.5 and np.mean(grows) > 0.5))

    return finding


def _settled(run: Sequence[Point]) -> int:
    """The generation from which on a repertoire stays above a share of its final size."""
    below = [i for i, p in enumerate(run) if p.size < SETTLED * run[-1].size]
    return run[below[-1] + 1].generation if below else run[0].generation


def no_slower(ones: Sequence[str], other: str) -> Judge:
    """Not told apart from another as later to stay above `SETTLED` of the final size."""

    def finding(evidence: Evidence) -> Finding:
        from scipy.stats import mannwhitneyu

        found = {name: [_settled(run) for run in evidence.runs(name)] for name in (*ones, other)}
        medians = {name: float(np.median(generations)) for name, generations in found.items() if generations}
        if other not in medians or len(medians) == 1:
            return NOTHING
        pairs = [name for name in ones if len(found[name]) > 1 and len(found[other]) > 1]
        corrected = holm([float(mannwhitneyu(found[name], found[other]).pvalue) for name in pairs])
        late = [p < LEVEL and medians[name] > medians[other] for name, p in zip(pairs, corrected, strict=True)]
        text = ", ".join(f"{name} from generation {median:,.0f} on" for name, median in medians.items())
        text += "".join(f"; {name}: p = {p:.2g}" for name, p in zip(pairs, corrected, strict=True))
        return Finding(text, False if any(late) else True if len(late) == len(ones) else None)

    return finding


def both(one: Finding, other: Finding) -> Finding:
    """Two findings as one, which holds if both do."""
    text = "; ".join(filter(None, (one.ours, other.ours)))
    holds = (one.holds, other.holds)
    return Finding(text, False if False in holds else None if None in holds else True)
