"""Joints, contacts and a camera at once: how alike those are that a descriptor learned from all of them calls alike.

    pip install ".[robots]"
    python benchmarks/senses.py             # all descriptors, one seed: half an hour of one core
    python benchmarks/senses.py --only autoencoder hand-coded --seed 1
    python benchmarks/senses.py --update    # one update on 5,000 episodes: seconds and memory
    python benchmarks/senses.py --quick     # to see it work: seconds; no conclusions can be drawn

Ant-v5 of Gymnasium, moved for five seconds by sinusoids. It is seen from above half-way and at the end, in 32 x 32 pixels; it
senses the angles of its eight joints and which bodies touch something, at ten moments. Runs are of 60 generations of 50, with
`VAT(cells=2000)`. Covered is the area of the squares, half a metre wide, in which individuals end. How alike neighbours are is
told for each thing that is sensed, and for where an ant ends: the distance between an individual and the one that the
descriptor calls nearest, the mean over all, as a share of that between two drawn at random. 1 is no better than chance.
"""

import argparse
import time
import warnings

import numpy as np
from ant import area_of
from pixels import cost
from scipy.spatial import cKDTree
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import AutoEncoder, Streams

GENERATIONS, BATCH, CELLS, ROWS = 60, 50, 2_000, 5_000
BRIEF = {"min_steps": 10, "max_epochs": 1, "repeats": 1}  # training, to see it work
DESCRIPTORS = {
    "hand-coded": lambda: "hand-coded",
    "pca": lambda: Streams(PCA(n_components=3)),
    "joints": lambda: Streams(joints=AutoEncoder(3), eye=None, feet=None),
    "eye": lambda: Streams(eye=AutoEncoder(3), joints=None, feet=None),
    "autoencoder": lambda: AutoEncoder(3),
    "weighted": lambda: Streams(AutoEncoder(3), weights={"feet": 0.1}),
}
SAID = {
    "hand-coded": "hand-coded: where it ends",
    "pca": "`Streams(PCA(3))`",
    "joints": "`AutoEncoder(3)` of the joints alone",
    "eye": "`AutoEncoder(3)` of the camera alone",
    "autoencoder": "`AutoEncoder(3)` of all",
    "weighted": "`Streams(AutoEncoder(3), weights={'feet': 0.1})`",
}


def ant(steps):
    """The task."""
    from_above = auroraqd.tasks.Camera(32, frames=2, grey=True, elevation=-90, distance=12)
    senses = {"eye": from_above, "joints": range(5, 13), "feet": "contacts"}
    return auroraqd.tasks.Gym("Ant-v5", steps=steps, samples=10, observe=senses)


def alike(archive):
    """Of each thing that is sensed, and of where an individual ends: see above."""
    rng, z = np.random.default_rng(0), archive.descriptor
    nearest = cKDTree(z).query(z, k=2)[1][:, 1]
    anyone = rng.permutation(len(z))
    things = {"place": archive.ground_truth, **{name: archive.observation[name] for name in ("eye", "joints", "feet")}}
    rows = {name: np.asarray(values, float).reshape(len(z), -1) for name, values in things.items()}
    return {name: np.mean(_apart(x, x[nearest])) / np.mean(_apart(x, x[anyone])) for name, x in rows.items()}


def _apart(a, b):
    return np.linalg.norm(a - b, axis=1)


def runs(names, seed, generations, steps):
    task = ant(steps)
    print(f"### Ant: {generations} generations of {BATCH}, seed {seed}\n")
    print(
        "| descriptor | stored | area, m² | place | picture | joints | contacts | seconds |\n|---|---|---|---|---|---|---|---|"
    )
    for name in names:
        since = time.perf_counter()
        options = {"seed": seed, "batch_size": BATCH, "resolution": auroraqd.VAT(cells=CELLS)}
        aurora = auroraqd.Aurora(task.n_genes, DESCRIPTORS[name](), schedule=auroraqd.Doubling(10), **options)
        archive = aurora.run(task, generations=generations).archive
        seconds, area = time.perf_counter() - since, area_of(archive.ground_truth, side=0.5)
        shares = " | ".join(f"{share:.2f}" for share in alike(archive).values())
        print(f"| {SAID[name]} | {len(archive)} | {area:.1f} | {shares} | {seconds:.0f} |", flush=True)


def update(rows, steps, training):
    """One fit, and encoding a batch of 200."""
    task = ant(steps)
    observation = task(np.random.default_rng(0).random((rows, task.n_genes))).observation
    with warnings.catch_warnings(action="ignore"):  # ten steps learn nothing
        AutoEncoder(3, random_state=0, **BRIEF).fit(observation[:100])
    print(f"### One update on {rows:,} episodes, three streams\n")
    with warnings.catch_warnings(action="ignore" if training else None):
        cost(AutoEncoder(3, random_state=0, **training), observation)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=[*DESCRIPTORS], default=[*DESCRIPTORS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--quick", action="store_true", help="two generations, without networks; or 100 episodes")
    chosen = parser.parse_args()
    generations, steps, names = GENERATIONS, 100, chosen.only
    if chosen.quick:
        generations, steps, names = 2, 10, ["hand-coded", "pca"]
    if chosen.update:
        update(*((100, steps, BRIEF) if chosen.quick else (ROWS, steps, {})))
    else:
        runs(names, chosen.seed, generations, steps)
