"""What the paper claims, as data: each claim with its criterion, judged by code from results alone.

The criteria are one rule each for all claims of a kind, and stand here before any run to come; the results that this repository
holds were known when they were written. A claim that is an order of two variants agrees if the rank-sum test tells them apart
in that order, at 5% after Holm's correction for all pairs of the same measure. A median agrees within a factor of 1.5. Claims
that need runs that are not there cannot be known.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from auroraqd.experiments.replication import Point, Result
from auroraqd.experiments.statistics import Comparison, comparisons, holm, values_of

FACTOR = 1.5  # between a median here and one of the paper
LEVEL = 0.05  # of tests
_SETTLED = 0.9  # of its final size, from when on a repertoire has converged
_REGIONS = 0.95  # of regions, to call it all of them: at the border the reference has single individuals
_UPDATES = (750, 1550, 3150)  # the updates of the paper that are far enough apart to see
FIRST, SECOND = "ballistic", "air-hockey"


class Verdict(Enum):
    """What becomes of a claim."""

    AGREES = "agrees"
    DIFFERS = "differs"
    UNKNOWN = "cannot be known"


class Finding(NamedTuple):
    """What the results say of a claim: in words, and whether it holds; None where they cannot say."""

    ours: str
    holds: bool | None


_NOTHING = Finding("", None)


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
    """Something that the paper says of its results.

    Args:
        name: short and unique.
        task: of the experiment.
        section: of the paper.
        text: what it says.
        published: its numbers; empty where it gives none.
        criterion: when it agrees.
        judge: from the results to the finding.
        why: what is known about a claim that does not agree.
    """

    name: str
    task: str
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


def judge(evidence: Mapping[str, Evidence]) -> list[Judged]:
    """All claims of the paper, judged by the results of each task; those of a task without results cannot be known."""
    found = []
    for claim in CLAIMS:
        ours, holds = claim.judge(evidence[claim.task]) if claim.task in evidence else _NOTHING
        verdict = Verdict.UNKNOWN if holds is None else Verdict.AGREES if holds else Verdict.DIFFERS
        found.append(Judged(claim, ours or "no results of it", verdict))
    return found


def _median(variant: str, measure: str, published: float) -> Judge:
    """Within `FACTOR` of the published one; 0 means 0."""

    def judged(evidence: Evidence) -> Finding:
        ours = evidence.median(variant, measure)
        if np.isnan(ours):
            return _NOTHING
        near = published / FACTOR <= ours <= published * FACTOR
        return Finding(f"{ours:.3g}", bool(near))

    return judged


def _said(measure: str, one: str, other: str, evidence: Evidence, c: Comparison) -> str:
    a, low, high = c.effect
    medians = f"{evidence.median(one, measure):.3g} and {evidence.median(other, measure):.3g}"
    return f"{one}, {other}: {medians}; p = {c.corrected:.2g}, A = {a:.2f} ({low:.2f}, {high:.2f})"


def _pairs(measure: str, ones: Sequence[str], others: Sequence[str], holds: Callable[[Comparison], bool]) -> Judge:
    """Of each of some with each of others, what a comparison must say; all must be there."""

    def judged(evidence: Evidence) -> Finding:
        found = {(one, other): evidence.compared(one, other, measure) for one in ones for other in others}
        known = {pair: c for pair, c in found.items() if c is not None}
        text = "; ".join(_said(measure, *pair, evidence, c) for pair, c in known.items())
        verdicts = [holds(c) for c in known.values()]
        return Finding(text, False if not all(verdicts) else True if len(known) == len(found) else None)

    return judged


def _higher(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    return _pairs(measure, ones, others, lambda c: c.corrected < LEVEL and c.effect.a > 0.5)


def _lower(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    return _pairs(measure, ones, others, lambda c: c.corrected < LEVEL and c.effect.a < 0.5)


def _alike(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    return _pairs(measure, ones, others, lambda c: c.corrected >= LEVEL)


def _no_lower(measure: str, ones: Sequence[str], others: Sequence[str]) -> Judge:
    return _pairs(measure, ones, others, lambda c: c.corrected >= LEVEL or c.effect.a > 0.5)


def _ratio(measure: str, one: str, others: Sequence[str], least: float, most: float = np.inf) -> Judge:
    """The median of one over those of others, in a range."""

    def judged(evidence: Evidence) -> Finding:
        with np.errstate(divide="ignore"):
            ratios = [float(np.divide(evidence.median(one, measure), evidence.median(other, measure))) for other in others]
        text = ", ".join(f"{r:.3g} times that of {other}" for r, other in zip(ratios, others, strict=True) if not np.isnan(r))
        inside = [least <= ratio <= most for ratio in ratios if not np.isnan(ratio)]
        return Finding(text, False if not all(inside) else True if len(inside) == len(others) else None)

    return judged


def _at_least(measure: str, variants: Sequence[str], least: float) -> Judge:
    def judged(evidence: Evidence) -> Finding:
        medians = {name: evidence.median(name, measure) for name in variants}
        text = ", ".join(f"{name} {median:.3g}" for name, median in medians.items() if not np.isnan(median))
        known = [median >= least for median in medians.values() if not np.isnan(median)]
        return Finding(text, False if not all(known) else True if len(known) == len(variants) else None)

    return judged


def _below(measure: str, variant: str, most: float) -> Judge:
    def judged(evidence: Evidence) -> Finding:
        median = evidence.median(variant, measure)
        return _NOTHING if np.isnan(median) else Finding(f"{variant} {median:.3g}", bool(median < most))

    return judged


def _protocol(variants: Sequence[str]) -> Judge:
    """Runs of the paper's budget, as many as it has."""

    def judged(evidence: Evidence) -> Finding:
        own = [r for r in evidence.results if r.variant in variants]
        if not own:
            return _NOTHING
        runs = sorted({sum(r.variant == name for r in own) for name in variants})
        budgets = sorted({(r.generations, r.batch_size) for r in own})
        spoken = " or ".join(f"{generations:,} of {size}" for generations, size in budgets)
        return Finding(
            f"{runs[0]}{f' to {runs[-1]}' * (len(runs) > 1)} runs of each, generations: {spoken}",
            runs[0] >= 20 and budgets == [(5000, 200)],
        )

    return judged


def _shrinks(variant: str) -> Judge:
    """Smaller at the look after an update than at the one before in most updates, and larger at the end of the run."""

    def judged(evidence: Evidence) -> Finding:
        falls, grows = [], []
        for run in evidence.runs(variant):
            generations, sizes = np.array([p.generation for p in run]), np.array([p.size for p in run])
            for update in _UPDATES:
                before, after = sizes[generations <= update], sizes[generations > update]
                if len(before) and len(after):
                    falls.append(after[0] < before[-1])
                    grows.append(after[-1] > before[-1])
        if not falls:
            return _NOTHING
        text = f"{variant}: smaller after {np.mean(falls):.0%} of {len(falls)} updates, then larger after {np.mean(grows):.0%}"
        return Finding(text, bool(np.mean(falls) > 0.5 and np.mean(grows) > 0.5))

    return judged


def _settled(run: Sequence[Point]) -> int:
    """The generation from which on a repertoire stays above a share of its final size."""
    below = [i for i, p in enumerate(run) if p.size < _SETTLED * run[-1].size]
    return run[below[-1] + 1].generation if below else run[0].generation


def _no_slower(ones: Sequence[str], other: str) -> Judge:
    """Not told apart from another as later to stay above `_SETTLED` of the final size."""

    def judged(evidence: Evidence) -> Finding:
        from scipy.stats import mannwhitneyu

        found = {name: [_settled(run) for run in evidence.runs(name)] for name in (*ones, other)}
        medians = {name: float(np.median(generations)) for name, generations in found.items() if generations}
        if other not in medians or len(medians) == 1:
            return _NOTHING
        pairs = [name for name in ones if len(found[name]) > 1 and len(found[other]) > 1]
        corrected = holm([float(mannwhitneyu(found[name], found[other]).pvalue) for name in pairs])
        late = [p < LEVEL and medians[name] > medians[other] for name, p in zip(pairs, corrected, strict=True)]
        text = ", ".join(f"{name} from generation {median:,.0f} on" for name, median in medians.items())
        text += "".join(f"; {name}: p = {p:.2g}" for name, p in zip(pairs, corrected, strict=True))
        return Finding(text, False if any(late) else True if len(late) == len(ones) else None)

    return judged


_RESULTS_1, _RESULTS_2 = "First scenario, results", "Second scenario, results"
_WITHIN = f"the median is within a factor of {FACTOR:g}"
_APART = f"told apart in this order, p < {LEVEL:g} after Holm"
_TOGETHER = f"not told apart, p >= {LEVEL:g} after Holm"
_AURORA_GOOD = ("pca-incremental", "pca-pretrained", "ae-incremental")
_PAPER_1 = ("hand-coded", "genotype", *_AURORA_GOOD, "ae-pretrained", "cvt-prior", "cvt")
_PAPER_2 = ("hand-coded", "pca-incremental", "ae-incremental", "cvt")
_TRAINING = (
    "Its auto-encoder was trained in another way, for up to 125,000 epochs; docs/reproduction.md, 'Gaps and choices' and "
    "'The paper's training beside the default one'."
)
_KLC_READING = (
    "The paper leaves open over which range, joint or marginal, and what an empty bin counts; benchmarks/readings.py: no "
    "reading gives all of its numbers."
)
_SPREAD = (
    "It grows with the length of training on the prior data set, with and without a split: "
    "benchmarks/learned.py --ablations, docs/reproduction.md."
)
_UNTOLD = "The physics of the paper's table were never published; why cannot be told (docs/reproduction.md)."


def _klc(name: str, title: str, published: float, why: str = _KLC_READING) -> Claim:
    return Claim(
        f"klc-{name}",
        FIRST,
        _RESULTS_1,
        f"Median KLC of {title}",
        f"{published:g}",
        _WITHIN if published else "the median is 0",
        _median(name, "klc", published),
        why,
    )


def _worse_klc(name: str, title: str, why: str) -> Claim:
    return Claim(
        f"klc-{name}-higher",
        FIRST,
        _RESULTS_1,
        f"{title} has a higher KLC than AURORA-PCA, both, and AURORA-AE incremental",
        "",
        _APART,
        _higher("klc", (name,), _AURORA_GOOD),
        why,
    )


_BALLISTIC = (
    Claim(
        "protocol",
        FIRST,
        "Experimental validation",
        "All approaches run for 5,000 generations of 200 evaluations, 20 times",
        "20 runs, 5,000 of 200",
        "the same, and at least as many runs of each",
        _protocol(_PAPER_1),
        "Fewer runs of the slow variants; auroraqd reproduce paper adds them.",
    ),
    _klc("hand-coded", "the hand-coded descriptor, the reference", 0.0),
    _klc("pca-incremental", "AURORA-PCA incremental", 0.051),
    _klc("pca-pretrained", "AURORA-PCA pre-trained", 0.053),
    _klc("ae-incremental", "AURORA-AE incremental", 0.097),
    _klc("genotype", "Genotype", 0.686),
    _klc("ae-pretrained", "AURORA-AE pre-trained", 0.528, _SPREAD),
    _klc("cvt-prior", "CVT-MAP-Elites with prior", 0.704),
    _klc(
        "cvt",
        "CVT-MAP-Elites without prior",
        3.2,
        f"So few cells are reached that it says what an empty bin counts. {_KLC_READING}",
    ),
    Claim(
        "klc-pca-overlap",
        FIRST,
        _RESULTS_1,
        "The two AURORA-PCA variants overlap",
        "0.051, 0.053",
        f"their medians are within a factor of {FACTOR:g} of each other",
        _ratio("klc", "pca-incremental", ("pca-pretrained",), 1 / FACTOR, FACTOR),
    ),
    _worse_klc("genotype", "Genotype", ""),
    _worse_klc("ae-pretrained", "AURORA-AE pre-trained", _SPREAD),
    _worse_klc("cvt-prior", "CVT-MAP-Elites with prior", ""),
    Claim(
        "klc-cvt-30",
        FIRST,
        _RESULTS_1,
        "CVT-MAP-Elites without prior is more than 30 times worse than AURORA-PCA and AURORA-AE incremental",
        "> 30 times",
        "the ratios of the medians are above 30",
        _ratio("klc", "cvt", ("pca-incremental", "ae-incremental"), 30),
    ),
    Claim(
        "klc-pca-ae",
        FIRST,
        _RESULTS_1,
        "AURORA-PCA covers slightly better than AURORA-AE incremental",
        "0.051 against 0.097",
        _APART,
        _lower("klc", ("pca-incremental",), ("ae-incremental",)),
    ),
    Claim(
        "reached",
        FIRST,
        _RESULTS_1,
        "All approaches but CVT-MAP-Elites without prior reach all regions of ground-truth space",
        "a figure",
        f"by the median {_REGIONS:.0%} or more of the regions, of 10 x 10, that the hand-coded descriptor reaches; "
        "CVT-MAP-Elites without prior fewer",
        lambda evidence: _both(
            _at_least("reached", [name for name in _PAPER_1 if name != "cvt"], _REGIONS)(evidence),
            _below("reached", "cvt", _REGIONS)(evidence),
        ),
    ),
    Claim(
        "few-cells",
        FIRST,
        _RESULTS_1,
        "CVT-MAP-Elites without prior fills only a few of its 100,000 cells",
        "a figure",
        "fewer than 1% of them, by the median",
        lambda evidence: (
            Finding(f"{evidence.median('cvt', 'size'):,.0f}", evidence.median("cvt", "size") < 1000)
            if len(evidence.values("cvt", "size"))
            else _NOTHING
        ),
    ),
    Claim(
        "rmse",
        FIRST,
        _RESULTS_1,
        "AURORA-PCA reconstructs slightly better than AURORA-AE",
        "a figure",
        f"RMSE in metres, of incremental and of pre-trained: {_APART}",
        lambda evidence: _both(
            _lower("rmse_metres", ("pca-incremental",), ("ae-incremental",))(evidence),
            _lower("rmse_metres", ("pca-pretrained",), ("ae-pretrained",))(evidence),
        ),
        f"Here the auto-encoder errs several times less, after either training. {_TRAINING}",
    ),
    Claim(
        "shrinks",
        FIRST,
        "AURORA",
        "An update of the descriptor often makes the repertoire smaller, and it quickly grows back",
        "a figure",
        "smaller after most of the updates at 750, 1,550 and 3,150, and larger at the end",
        _shrinks("pca-incremental"),
    ),
    Claim(
        "speed",
        FIRST,
        "Discussion",
        "AURORA converges no slower than approaches with a fixed descriptor",
        "",
        f"the generation from which on {_SETTLED:.0%} of the final size are kept is not told apart as later than hand-coded, "
        f"p < {LEVEL:g} after Holm",
        _no_slower(("pca-incremental", "ae-incremental"), "hand-coded"),
        "The paper does not say by what it compares; here it is the size of the repertoire.",
    ),
)

_AIR_HOCKEY = (
    replace(_BALLISTIC[0], name="protocol-2", task=SECOND, judge=_protocol(_PAPER_2)),
    Claim(
        "whole-space",
        SECOND,
        _RESULTS_2,
        "AURORA-PCA and AURORA-AE cover the whole reachable space",
        "a figure",
        "a median diversity of 95 or more, for which pucks must end in 95 of the 100 squares",
        _at_least("diversity", ("pca-incremental", "ae-incremental"), 95),
    ),
    Claim(
        "cvt-few",
        SECOND,
        _RESULTS_2,
        "CVT-MAP-Elites without prior does not find many controllers",
        "a figure",
        "fewer than a tenth of those of the hand-coded descriptor, by the medians",
        _ratio("size", "cvt", ("hand-coded",), 0, 0.1),
    ),
    Claim(
        "even",
        SECOND,
        _RESULTS_2,
        "Final positions are more uniform with the hand-coded descriptor than with AURORA",
        "a figure",
        f"effective squares of 20 x 20, exp of the entropy of how many end in each: {_APART}",
        _lower("even", ("pca-incremental", "ae-incremental"), ("hand-coded",)),
    ),
    Claim(
        "walls",
        SECOND,
        _RESULTS_2,
        "AURORA has more solutions near the walls",
        "a figure",
        f"the share within 0.1 m of where the puck touches a wall: {_APART}",
        _higher("walls", ("pca-incremental", "ae-incremental"), ("hand-coded",)),
    ),
    Claim(
        "cvt-worst",
        SECOND,
        _RESULTS_2,
        "CVT-MAP-Elites has the worst diversity",
        "a figure",
        _APART,
        _lower("diversity", ("cvt",), ("hand-coded", "pca-incremental", "ae-incremental")),
    ),
    Claim(
        "ae-alike",
        SECOND,
        _RESULTS_2,
        "AURORA-AE and the hand-coded descriptor are alike in diversity",
        "p = 0.561",
        _TOGETHER,
        _alike("diversity", ("ae-incremental",), ("hand-coded",)),
        _UNTOLD,
    ),
    Claim(
        "pca-hand-coded",
        SECOND,
        _RESULTS_2,
        "AURORA-PCA is slightly more diverse than the hand-coded descriptor",
        "p < 0.038",
        _APART,
        _higher("diversity", ("pca-incremental",), ("hand-coded",)),
        _UNTOLD,
    ),
    Claim(
        "pca-ae",
        SECOND,
        _RESULTS_2,
        "AURORA-PCA is slightly more diverse than AURORA-AE",
        "p < 0.038",
        _APART,
        _higher("diversity", ("pca-incremental",), ("ae-incremental",)),
        f"{_UNTOLD} {_TRAINING}",
    ),
    Claim(
        "hockey-rmse",
        SECOND,
        _RESULTS_2,
        "AURORA-AE reconstructs better than AURORA-PCA",
        "a figure",
        f"RMSE in metres: {_APART}",
        _lower("rmse_metres", ("ae-incremental",), ("pca-incremental",)),
    ),
    Claim(
        "as-diverse",
        SECOND,
        "Introduction; Discussion",
        "AURORA is at least as diverse as the hand-coded descriptor",
        "",
        f"none told apart as lower, p < {LEVEL:g} after Holm",
        _no_lower("diversity", ("pca-incremental", "ae-incremental"), ("hand-coded",)),
    ),
    Claim(
        "better-than-unsupervised",
        SECOND,
        "Abstract; Introduction",
        "AURORA is significantly more diverse than existing unsupervised methods",
        "",
        _APART,
        _higher("diversity", ("pca-incremental", "ae-incremental"), ("cvt",)),
    ),
    replace(_BALLISTIC[-2], name="shrinks-2", task=SECOND),
    replace(_BALLISTIC[-1], name="speed-2", task=SECOND),
)

CLAIMS = (*_BALLISTIC, *_AIR_HOCKEY)


def _both(one: Finding, other: Finding) -> Finding:
    text = "; ".join(filter(None, (one.ours, other.ours)))
    holds = (one.holds, other.holds)
    return Finding(text, False if False in holds else None if None in holds else True)
