"""The compared variants of the paper as data (Sec. "First scenario", "Compared approaches"), and ours."""

from dataclasses import dataclass, replace
from typing import Any

from auroraqd.experiments.settings import CVT, CVTPrior, Settings
from auroraqd.variation import Polynomial

REFERENCE = "hand-coded"
"""The variant whose final repertoire the others are measured against."""

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
        paper: the median KLC that the paper reports; None for what is not in it.
    """

    name: str
    title: str
    settings: dict[str, Any]
    paper: float | None = None

    def of(self, base: Settings, seed: int) -> Settings:
        """The settings of one run."""
        return replace(base, seed=seed, **self.settings)


BALLISTIC = {
    variant.name: variant
    for variant in (
        Variant(REFERENCE, "Hand-coded", {"descriptor": "hand-coded"}, 0.0),
        Variant("genotype", "Genotype", {"descriptor": "genotype"}, 0.686),
        Variant("pca-incremental", "AURORA-PCA incremental", {"descriptor": "pca"}, 0.051),
        Variant("pca-pretrained", "AURORA-PCA pre-trained", {"descriptor": "pca", "pretrained": True}, 0.053),
        Variant("ae-incremental", "AURORA-AE incremental", {"descriptor": _PLAIN}, 0.097),
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
        Variant("cvt", "CVT-MAP-Elites without prior", {"descriptor": "observation", "archive": CVT(cells=100_000)}, 3.2),
        Variant("ae-isometric", "AURORA-AE isometric incremental", {"descriptor": f"autoencoder:{_TRAINING}"}),
        Variant(
            "ae-pretrained-split",
            "AURORA-AE pre-trained, validation split",
            {"descriptor": _PLAIN, "pretrained": True},
        ),
    )
}
"""By name. The paper's eight; then ours, whose auto-encoder keeps distances; then the paper's pre-trained one with the split
that it was trained without."""


def base(generations: int = 5000, batch_size: int = 200) -> Settings:
    """What the variants have in common: the paper's budget and variation."""
    return Settings(generations=generations, batch_size=batch_size, variation=Polynomial(at_least_one=False))


def quickened(variants: dict[str, Variant]) -> dict[str, Variant]:
    """The same in little time: auto-encoders hardly trained, few centroids. To see it work, not to draw conclusions."""
    changed = {}
    for name, variant in variants.items():
        settings = dict(variant.settings)
        if "autoencoder" in settings["descriptor"]:
            settings["descriptor"] = settings["descriptor"].replace("min_steps=0", "min_steps=200") + ",repeats=2,max_epochs=4"
        if "archive" in settings and isinstance(settings["archive"], CVT):
            settings["archive"] = CVT(cells=2_000, samples=4_000)
        changed[name] = replace(variant, settings=settings)
    return changed
