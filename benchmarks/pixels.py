"""Skills from pixels: how much of what a robot can do is found by descriptors learned from images.

    python benchmarks/pixels.py                      # all descriptors but those of the extra "manifold", one seed
    python benchmarks/pixels.py --only geodesic hand-coded --seed 1
    python benchmarks/pixels.py --update             # one update on 10,000 images of 64 x 64 x 3: seconds and memory
    python benchmarks/pixels.py --update --only PCA  # of PCA instead of an auto-encoder
    python benchmarks/pixels.py --quick              # to see it work: seconds; no conclusions can be drawn

The robot is a disc. Three genes are bent into its place, so that most of them leave it near the middle, and all that is seen is
an image of it. Runs are of 80 generations of 100, with `VAT(cells=2000)`. Coverage is the number of 15 x 15 cells of the true
places that are reached, effective cells exp of the entropy of how the repertoire is spread over them.
"""

import argparse
import resource
import time
import warnings
from dataclasses import replace

import numpy as np
from sklearn.decomposition import PCA
from sklearn.manifold import Isomap
from sklearn.pipeline import make_pipeline

import auroraqd
from auroraqd.descriptors.descriptor import Descriptor
from auroraqd.descriptors.networks import Image

GENERATIONS, BATCH, CELLS, BINS = 80, 100, 2_000, 15
SIZE, RADIUS = 32, 2.5  # pixels
SMALL = Image(maps=(4,), hidden=8, steps=30)  # a network to see it work


def places(genotypes):
    """(n, 3) genes in [0, 1] to (n, 2) places in [0, 1]."""
    s = 2 * genotypes - 1
    x, y = s[:, 0] * np.abs(s[:, 1]), s[:, 1] * s[:, 2] ** 3
    return 0.5 + 0.5 * np.stack([np.sin(np.pi / 2 * x), y], axis=1)


def images(place, size=SIZE, radius=RADIUS, colour=(1.0,)):
    """(n, 2) places to (n, size, size, channels) uint8: a disc with a soft edge, always whole, on black."""
    centre = (radius + 1) + (size - 3 - 2 * radius) * place
    y, x = np.mgrid[:size, :size]
    away = np.hypot(x - centre[:, 0, None, None], y - centre[:, 1, None, None])
    bright = 255 * np.clip(radius + 0.5 - away, 0, 1)
    return (bright[..., None] * np.asarray(colour)).astype(np.uint8)


def disc(genotypes):
    """The task."""
    place = places(genotypes)
    return np.zeros(len(place)), images(place), place


class OnFlat:
    """A manifold learner without its inverse, fitted on 1,000 rows at most: Isomap takes all their distances."""

    def __init__(self, estimator):
        self.estimator = estimator

    def fit(self, x):
        """Rows, (n, features)."""
        self.estimator.fit(x[np.random.default_rng(0).permutation(len(x))[:1000]])
        return self

    def transform(self, x):
        """To (n, d)."""
        return self.estimator.transform(x)


def umap():
    from umap import UMAP

    return UMAP(n_components=2, random_state=0)


def tsne():
    from openTSNE.sklearn import TSNE

    return TSNE(n_components=2, random_state=0)


EXTRA = {"UMAP": lambda: OnFlat(umap()), "t-SNE": lambda: OnFlat(tsne())}
DESCRIPTORS = {
    "hand-coded": lambda: "hand-coded",
    "genotype": lambda: "genotype",
    "PCA": lambda: PCA(n_components=2),
    "Isomap": lambda: OnFlat(Isomap(n_neighbors=8, n_components=2)),
    "mlp": lambda: auroraqd.AutoEncoder(2, network="mlp"),
    "pca-mlp": lambda: make_pipeline(PCA(n_components=40), auroraqd.AutoEncoder(2)),
    "euclidean": lambda: auroraqd.AutoEncoder(2, metric="euclidean"),
    "measured": lambda: auroraqd.AutoEncoder(2, metric="measured"),
    "geodesic": lambda: auroraqd.AutoEncoder(2),
}
SAID = {
    "mlp": "AutoEncoder, network='mlp'",
    "pca-mlp": "PCA(40), then AutoEncoder",
    "euclidean": "AutoEncoder, metric='euclidean'",
    "measured": "AutoEncoder, metric='measured' (blurred)",
    "geodesic": "AutoEncoder, the default (image, geodesic)",
}


def spread(place):
    """Coverage, and effective cells."""
    cells = {"bins": BINS, "low": 0, "high": 1}
    return round(auroraqd.metrics.coverage(place, **cells) * BINS**2), auroraqd.metrics.effective_cells(place, **cells)


def runs(names, seed, generations):
    print(f"### Images of a disc: {generations} generations of {BATCH}, seed {seed}\n")
    print(f"| descriptor | stored | coverage of {BINS * BINS} | effective cells | seconds |\n|---|---|---|---|---|")
    for name in names:
        options = {"seed": seed, "batch_size": BATCH, "resolution": auroraqd.VAT(cells=CELLS)}
        since = time.perf_counter()
        aurora = auroraqd.Aurora(3, {**DESCRIPTORS, **EXTRA}[name](), **options).run(disc, generations=generations)
        seconds = time.perf_counter() - since
        coverage, effective = spread(aurora.archive.ground_truth)
        print(f"| {SAID.get(name, name)} | {len(aurora.archive)} | {coverage} | {effective:.0f} | {seconds:.0f} |", flush=True)


class OfPCA:
    """PCA as a run fits it: on scaled observations, which it needs room for."""

    validation_rmse_ = np.nan

    def fit(self, x):
        """Images as they are."""
        self.descriptor = Descriptor(PCA(n_components=2, random_state=0)).refitted(x)

    def transform(self, x):
        """To (n, 2)."""
        return self.descriptor.describe_observation(x)


def update(rows, size, network):
    """One fit, and encoding a batch of 200; of PCA where there is no network."""
    rng = np.random.default_rng(0)
    x = np.concatenate([images(rng.random((500, 2)), size, 5.0, (1.0, 0.5, 0.2)) for _ in range(rows // 500)])
    print(f"### One update on {rows:,} images {x.shape[1:]}\n")
    if network is None:
        return cost(OfPCA(), x)
    with warnings.catch_warnings(action="ignore"):  # one step learns nothing
        auroraqd.AutoEncoder(2, network=replace(network, steps=1), repeats=1, random_state=0).fit(x[:100])
    cost(auroraqd.AutoEncoder(2, network=network, random_state=0), x)


def cost(encoder, x):
    """Print how long a fit takes, and encoding a batch of 200, and what memory beyond what is given."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    since, used = time.perf_counter(), time.process_time()
    encoder.fit(x)
    fitted, used = time.perf_counter() - since, time.process_time() - used
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    encoder.transform(x[:200])
    since = time.perf_counter()
    for _ in range(20):
        encoder.transform(x[:200])
    each = 50 * (time.perf_counter() - since)
    print("| seconds | of CPU | memory beyond what is given, MiB | RMSE held out | encoding 200, ms |\n|---|---|---|---|---|")
    error = "" if np.isnan(encoder.validation_rmse_) else f"{encoder.validation_rmse_:.3f}"
    print(f"| {fitted:.0f} | {used:.0f} | {memory:.0f} | {error} | {each:.0f} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=[*DESCRIPTORS, *EXTRA], help="default: all but UMAP and t-SNE")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--quick", action="store_true", help="two generations, without networks, or 500 small images")
    chosen = parser.parse_args()
    generations, rows, size, network, names = GENERATIONS, 10_000, 64, Image(), [*DESCRIPTORS]
    if chosen.quick:
        generations, rows, size, network, names = 2, 500, 16, SMALL, ["hand-coded", "PCA", "Isomap"]
    if chosen.update:
        update(rows, size, None if chosen.only == ["PCA"] else network)
    else:
        runs(chosen.only or names, chosen.seed, generations)
