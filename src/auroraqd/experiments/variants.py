"""The experiments of the paper as data: their compared variants (Secs. "First scenario", "Second scenario"), and ours."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from auroraqd import metrics
from auroraqd.control.resolution import VAT
from auroraqd.emitters.variation import Polynomial
from auroraqd.experiments.measures import Coverage, Measure, Own
from auroraqd.experiments.settings import CVT, CVTPrior, Settings
from auroraqd.tasks import air_hockey

# The network of the paper, trained with Adam for 60 epochs instead of its up to 125,000 of Adagrad; what the training does to
# the coverage is in docs/reproduction.md.
_TRAINING = "network=convolutional,batch_size=256,learning_rate=0.005,min_steps=0"
_PLAIN = f"autoencoder:{_TRAINING},isometry=0"


@dataclass(frozen=True)
class Variant:
    """A way to describe behaviours and to keep them.

    Args:
        name: short, for files and the command line.
        title: as in the paper.
        settings: what differs from `Settings()`.
        paper: the median of the first measure of the experiment that the paper reports; None for what is not in it.
    """

    name: str
    title: str
    settings: dict[str, Any]
    paper: float | None = None

    def of(self, base: Settings, seed: int) -> Settings:
        """The settings of one run."""
        return replace(base, seed=seed, **self.settings)


def _of_the_paper() -> dict[str, Any]:
    """The paper's variation and updates, which set aside and refuse nothing."""
    return {
        "variation": Polynomial(at_least_one=False),
        "resolution": VAT(robust=False),
        "survival": 0.0,
        "robust": False,
    }


@dataclass(frozen=True)
class Experiment:
    """Variants on a task, and what they are judged by.

    Args:
        name: short, for folders and the command line.
        task: as in `auroraqd.experiments.settings.Settings`.
        variants: by name, in the order of tables.
        measures: the one that the paper compares by first.
        reference: the variant whose final repertoire is the reference of the others of the same replication; None: the measures
            need none.
        tested: what variants are compared by in rank-sum tests.
        truth: what the ground truth of the task is.
        generations, batch_size, replications: as they were published.
        common: settings of all variants.
    """

    name: str
    task: str
    variants: Mapping[str, Variant]
    measures: tuple[Measure, ...]
    reference: str | None
    tested: tuple[str, ...]
    truth: str
    generations: int = 5000
    batch_size: int = 200
    replications: int = 20
    common: Mapping[str, Any] = field(default_factory=_of_the_paper)

    @property
    def scores_diversity(self) -> bool:
        """Whether the diversity score is among the measures."""
        return any(measure.name == "diversity" for measure in self.measures)

    def base(self, generations: int | None = None, batch_size: int | None = None) -> Settings:
        """What the variants have in common; None: as it was published."""
        budget = {"generations": generations or self.generations, "batch_size": batch_size or self.batch_size}
        return Settings(task=self.task, **budget, **self.common)

    def quickened(self) -> "Experiment":
        """The same in little time: auto-encoders hardly trained, few centroids. To see it work, not to draw conclusions."""
        return replace(self, variants={name: _quickened(variant) for name, variant in self.variants.items()})


def _quickened(variant: Variant) -> Variant:
    settings = dict(variant.settings)
    if "autoencoder" in settings["descriptor"]:
        settings["descriptor"] = settings["descriptor"].replace(",min_steps=0", "") + ",min_steps=200,repeats=2,max_epochs=4"
    if isinstance(settings.get("archive"), CVT):
        settings["archive"] = CVT(cells=2_000, samples=4_000)
    return replace(variant, settings=settings)


def _named(*variants: Variant) -> dict[str, Variant]:
    return {variant.name: variant for variant in variants}


def diversity(individuals: Any, bins: int) -> float:
    """The diversity of the ways of pucks: see `auroraqd.metrics.diversity`."""
    return metrics.diversity(individuals.observation, bins)


def evenness(individuals: Any, bins: int = 20) -> float:
    """How evenly pucks end in the squares of the room: see `auroraqd.metrics.effective_cells`."""
    return metrics.effective_cells(individuals.ground_truth, bins)


def near_a_wall(individuals: Any, within: float = 0.1) -> float:
    """The share of pucks that end within some metres of where they touch a wall."""
    reach = air_hockey.WALL - air_hockey.PUCK - within
    return float((np.abs(individuals.ground_truth) > reach).any(axis=1).mean())


_HAND_CODED = Variant("hand-coded", "Hand-coded", {"descriptor": "hand-coded"})
_PCA = Variant("pca-incremental", "AURORA-PCA incremental", {"descriptor": "pca"})
_AE = Variant("ae-incremental", "AURORA-AE incremental", {"descriptor": _PLAIN})
_AE_ISOMETRIC = Variant("ae-isometric", "AURORA-AE isometric incremental", {"descriptor": f"autoencoder:{_TRAINING}"})
_CVT = Variant("cvt", "CVT-MAP-Elites without prior", {"descriptor": "observation", "archive": CVT(cells=100_000)})

BALLISTIC = Experiment(
    name="ballistic",
    task="ballistic",
    variants=_named(
        replace(_HAND_CODED, paper=0.0),
        Variant("genotype", "Genotype", {"descriptor": "genotype"}, 0.686),
        replace(_PCA, paper=0.051),
        Variant("pca-pretrained", "AURORA-PCA pre-trained", {"descriptor": "pca", "pretrained": True}, 0.053),
        replace(_AE, paper=0.097),
        Variant(
            "ae-pretrained",
            "AURORA-AE pre-trained",
            {"descriptor": f"{_PLAIN},validation=0", "pretrained": True},
            0.528,
        ),
        Variant(
            "cvt-prior",
            "CVT-MAP-Elites with prior",
            {"descriptor": "observation", "pretrained": True, "archive": CVTPrior()},
            0.704,
        ),
        replace(_CVT, paper=3.2),
        _AE_ISOMETRIC,
        Variant(
            "ae-pretrained-split",
            "AURORA-AE pre-trained, validation split",
            {"descriptor": _PLAIN, "pretrained": True},
        ),
    ),
    measures=(
        Coverage("klc", "KLC", metrics.klc, followed=True, logarithmic=True),
        Coverage("klc_marginal", "KLC, marginal", partial(metrics.klc, marginal=True)),
        Coverage("outside", "outside", metrics.outside),
        Coverage("reached", "regions reached", metrics.reached),
    ),
    reference="hand-coded",
    tested=("klc",),
    truth="top of the arc",
)
"""The paper's eight; then ours, whose auto-encoder keeps distances; then the paper's pre-trained one with the split that it was
trained without."""

AIR_HOCKEY = Experiment(
    name="air-hockey",
    task="air-hockey",
    variants=_named(_HAND_CODED, _PCA, _AE, _CVT, _AE_ISOMETRIC),
    measures=(
        Own("diversity", "diversity, 10 x 10", partial(diversity, bins=10), followed=True),
        Own("diversity_20", "diversity, 20 x 20", partial(diversity, bins=20), followed=True),
        Own("even", "effective squares, 20 x 20", evenness),
        Own("walls", "near a wall", near_a_wall, form="{:.3f}"),
    ),
    reference=None,
    tested=("diversity", "diversity_20", "rmse_metres", "even", "walls"),
    truth="final position",
)
"""The paper's four, of which the hand-coded descriptor is the final position of the puck; then ours."""
