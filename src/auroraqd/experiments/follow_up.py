"""The follow-up [1] on air hockey, as an outside check: what its variants came to there, and what they come to here.

Its constants are those of the authors' code: 128 evaluations a generation, 1,000 generations, ten latent dimensions, updates in
generations 1, 21, 51, 91, ..., and fitness, minus the energy of the arm. Container size control (`CSC`) aims at 10,000
individuals. Two things are ours: the network (two dense layers of 32 and 8, as there) is trained in our way, and population
methods store whatever is novel, where there each generation adds five individuals.

Published values are read off the figures of [1], of ten runs each, so the criteria leave room.

[1] L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE TEVC 2022.
"""

from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from math import gamma, pi
from typing import Any

import numpy as np

from auroraqd import emitters, metrics
from auroraqd.control.resolution import CSC, VAT, Fixed
from auroraqd.control.schedule import Widening
from auroraqd.emitters.selection import Curiosity, Mixed, Novelty, Surprise, Uniform
from auroraqd.emitters.variation import Polynomial
from auroraqd.experiments.claims import (
    APART,
    FACTOR,
    NOTHING,
    WITHIN,
    Claim,
    Evidence,
    Finding,
    Judge,
    higher,
    median_near,
    protocol,
)
from auroraqd.experiments.measures import Own
from auroraqd.experiments.settings import Settings
from auroraqd.experiments.variants import Experiment, Variant
from auroraqd.tasks import air_hockey

NAME = "follow-up"
STORED = 10_000  # what CSC aims at
LATENT = 10
GRIDS = (10, 20, 30, 40, 50)
COVERAGE, FITNESS = "coverage_40", "grid_fitness"
NEAR = 0.05  # between coverages: they were read off a figure
_BATCH, _GENERATIONS, _RUNS = 128, 1000, 10
_ENCODER = "autoencoder:network=mlp,hidden=32x8,isometry=0,learning_rate=0.001"
_VARIATION = Polynomial(rate=0.15, eta=10.0, at_least_one=False)
_FIXED = 0.125  # l, in the latent space of an auto-encoder: where `csc-uniform` of seed 0 comes to


def _vat(d: int) -> VAT:
    """Its rule, l = L / (18 * 10,000)^(1 / d), as a number of cells in a ball of diameter L."""
    ball = pi ** (d / 2) / gamma(d / 2 + 1)
    return VAT(cells=18 * STORED * ball / 2**d, robust=False)


def covered(individuals: Any, bins: int) -> float:
    """The share of the squares of the room, 2 x 2 m to the middle of the walls, in which a puck ends."""
    return metrics.coverage(individuals.ground_truth, bins)


def grid_fitness(individuals: Any, bins: int = 40) -> float:
    """The mean, over the squares in which a puck ends, of the fitness of the fittest there; fitness is minus the energy."""
    truth = individuals.ground_truth
    score = metrics.qd_score(truth, -air_hockey.energy(individuals.genotype), bins)
    return score / (metrics.coverage(truth, bins) * bins**2)


def _csc(name: str, title: str, selection: Any, latent: int = LATENT) -> Variant:
    return Variant(name, title, {"descriptor": _ENCODER, "selection": selection, "components": latent})


def _emitting(name: str, title: str, descriptor: str, emitter: Any, **settings: Any) -> Variant:
    """With an emitter that has a selection and variation of its own."""
    own = {"selection": Settings().selection, "variation": Settings().variation}  # their defaults: unused
    return Variant(name, title, {"descriptor": descriptor, "emitter": emitter, **own, **settings})


_BESIDE = {"task": "air-hockey"}  # fitness is nothing to them
_POPULATION = {"population": _BATCH, "variation": _VARIATION}
_VARIANTS = (
    Variant("hand-coded", "hand-coded, CSC, uniform", {"descriptor": "hand-coded"}),
    _emitting("random", "random search", "hand-coded", emitters.Goals(random=1.0)),
    _csc("csc-uniform", "AURORA, CSC, uniform", Uniform()),
    _csc("csc-novelty", "AURORA, CSC, novelty", Novelty()),
    _csc("csc-surprise", "AURORA, CSC, surprise", Surprise()),
    _csc("csc-mixed", "AURORA, CSC, novelty and surprise", Mixed()),
    _csc("csc-curiosity", "AURORA, CSC, curiosity", Curiosity()),
    _csc("csc-uniform-2", "AURORA, CSC, uniform, 2 dimensions", Uniform(), latent=2),
    Variant("vat-uniform", "AURORA, VAT, uniform", {"descriptor": _ENCODER, "resolution": _vat(LATENT)}),
    Variant(
        "vat-uniform-2", "AURORA, VAT, uniform, 2 dimensions", {"descriptor": _ENCODER, "resolution": _vat(2), "components": 2}
    ),
    Variant("fixed-uniform", "AURORA, fixed l, uniform", {"descriptor": _ENCODER, "resolution": Fixed(_FIXED)}),
    _emitting("taxons", "TAXONS", _ENCODER, emitters.TAXONS(**_POPULATION), **_BESIDE),
    _emitting("novelty-search", "novelty search", "hand-coded", emitters.NoveltySearch(**_POPULATION), **_BESIDE),
)

FOLLOW_UP = Experiment(
    name=NAME,
    task="air-hockey:energy=true",
    variants={variant.name: variant for variant in _VARIANTS},
    measures=(
        Own(COVERAGE, "coverage, 40 x 40", partial(covered, bins=40), form="{:.3f}", followed=True),
        Own(FITNESS, "mean fitness, 40 x 40", grid_fitness, form="{:.0f}"),
        *(Own(f"coverage_{bins}", f"{bins} x {bins}", partial(covered, bins=bins), "{:.3f}") for bins in GRIDS if bins != 40),
    ),
    reference=None,
    tested=(COVERAGE, FITNESS),
    truth="final position",
    generations=_GENERATIONS,
    batch_size=_BATCH,
    replications=_RUNS,
    common={
        "components": LATENT,
        "selection": Uniform(),
        "variation": _VARIATION,
        "resolution": CSC(STORED),
        "schedule": Widening(),
        "survival": 0.0,
        "robust": False,
    },
)


def _sizes(variants: tuple[str, ...], share: float) -> Judge:
    """The medians of what is stored are within a share of what CSC aims at."""

    def finding(evidence: Evidence) -> Finding:
        medians = {name: evidence.median(name, "size") for name in variants}
        text = ", ".join(f"{name} {median:,.0f}" for name, median in medians.items() if not np.isnan(median))
        near = [abs(median / STORED - 1) <= share for median in medians.values() if not np.isnan(median)]
        return Finding(text, False if not all(near) else True if len(near) == len(variants) else None)

    return finding


def _of_any_dimension(evidence: Evidence) -> Finding:
    """By CSC as many are stored in two dimensions as in ten, by VAT not."""
    ratios = {
        kind: evidence.median(f"{kind}-uniform", "size") / evidence.median(f"{kind}-uniform-2", "size")
        for kind in ("csc", "vat")
    }
    if np.isnan(list(ratios.values())).any():
        return NOTHING
    alike = {kind: 1 / FACTOR <= ratio <= FACTOR for kind, ratio in ratios.items()}
    text = ", ".join(f"{kind}: {ratio:.3g} times as many in ten as in two" for kind, ratio in ratios.items())
    return Finding(text, alike["csc"] and not alike["vat"])


def _along(variant: str, published: Mapping[int, float]) -> Judge:
    """The median coverage at each of these generations is within `NEAR`."""

    def finding(evidence: Evidence) -> Finding:
        runs = evidence.runs(variant)
        points = [p for run in runs for p in run if np.isfinite(p.value(COVERAGE))]
        seen = {g: [p.value(COVERAGE) for p in points if p.generation == g] for g in published}
        if not all(seen.values()):
            return NOTHING
        medians = {g: float(np.median(values)) for g, values in seen.items()}
        near = [abs(medians[g] - value) <= NEAR for g, value in published.items()]
        return Finding(", ".join(f"{median:.3f}" for median in medians.values()), all(near))

    return finding


_FIGURE = "Results, figure of coverage and fitness"
_STORING = (
    "There five of each generation are stored, here all that are novel: at 100 generations 500 are there, of 1,600 squares."
)
_CORRECTED = "The correction, for all pairs of the variants here, is ours: ten runs of each may be too few for it."
_COVERED: dict[str, tuple[str, tuple[float, ...], str]] = {
    "random": (
        "random search",
        (0.651, 0.789, 0.862, 0.890),
        "An arm of bodies in an engine covers as little as is published; benchmarks/motors.py, docs/reproduction.md.",
    ),
    "taxons": ("TAXONS", (0.20, 0.36, 0.57, 0.82), _STORING),
    "novelty-search": ("novelty search", (0.27, 0.48, 0.73, 0.89), _STORING),
}
_FITNESS = {
    "hand-coded": ("the hand-coded descriptor", -130.0),
    "csc-uniform": ("AURORA-CSC-uniform", -222.0),
    "csc-novelty": ("AURORA-CSC-novelty", -242.0),
    "csc-surprise": ("AURORA-CSC-surprise", -285.0),
    "taxons": ("TAXONS", -590.0),
    "novelty-search": ("novelty search", -590.0),
}
_CONTROLLED = ("hand-coded", "csc-uniform", "csc-novelty", "csc-surprise", "csc-curiosity")
_ORDER = ("hand-coded", "csc-uniform", "csc-novelty", "csc-surprise")


def _of_coverage(name: str) -> Claim:
    title, values, why = _COVERED[name]
    published: dict[int, float] = dict(zip((100, 200, 400, 1000), values, strict=True))
    return Claim(
        f"coverage-{name}",
        NAME,
        _FIGURE,
        f"Coverage of final positions by {title}, 40 x 40, after 100, 200, 400 and 1,000 generations",
        ", ".join(f"{value:g}" for value in values),
        f"each median is within {NEAR:g}",
        _along(name, published),
        why,
    )


def _of_fitness(name: str) -> Claim:
    title, value = _FITNESS[name]
    return Claim(
        f"fitness-{name}",
        NAME,
        _FIGURE,
        f"Mean fitness of the fittest in each square, 40 x 40, by {title}",
        f"{value:g}",
        WITHIN,
        median_near(name, FITNESS, value),
        _STORING if name in _COVERED else "",
    )


CLAIMS = (
    Claim(
        "protocol-3",
        NAME,
        "Experimental setup",
        "Ten runs of 1,000 generations of 128 evaluations",
        "10 runs, 1,000 of 128",
        "the same, and at least as many runs of each",
        protocol(tuple(FOLLOW_UP.variants), _RUNS, _GENERATIONS, _BATCH),
    ),
    Claim(
        "sizes",
        NAME,
        "Container size control",
        "CSC brings the number stored to its target, whatever is selected by",
        "10,000",
        "each median is within 10% of it",
        _sizes(_CONTROLLED, 0.1),
        why="It goes up between updates and down at each, around the target: the end is before one.",
    ),
    Claim(
        "dimensions",
        NAME,
        "Abstract",
        "CSC does not depend on how many dimensions the latent space has, VAT does",
        "",
        f"the medians of what is stored in ten and in two are within a factor of {FACTOR:g} by CSC, and not by VAT",
        _of_any_dimension,
    ),
    *(_of_coverage(name) for name in _COVERED),
    *(_of_fitness(name) for name in _FITNESS),
    *(
        Claim(
            f"fitness-{better}-{worse}",
            NAME,
            _FIGURE,
            f"Mean fitness by {_FITNESS[better][0]} is higher than by {_FITNESS[worse][0]}",
            f"{_FITNESS[better][1]:g} against {_FITNESS[worse][1]:g}",
            APART,
            higher(FITNESS, (better,), (worse,)),
            _CORRECTED,
        )
        for better, worse in pairwise(_ORDER)
    ),
    Claim(
        "fitness-populations",
        NAME,
        _FIGURE,
        "Mean fitness by TAXONS and novelty search is lower than by AURORA-CSC",
        "about -590 against -222 to -285",
        APART,
        higher(FITNESS, _ORDER[1:], ("taxons", "novelty-search")),
        _CORRECTED,
    ),
)
