"""The air-hockey task: how fast it is, how fast a run on it is, and how far its physics are from an engine's.

    python benchmarks/hockey.py
    python benchmarks/hockey.py --quick    # to see it work: seconds; no conclusions can be drawn

Needs the extra `test`, for Box2D.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from sklearn.decomposition import PCA

import auroraqd

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import box2d

BATCH = 200
ENGINE = 100  # evaluations in the engine


def evaluations(generations, looks):
    """Microseconds an evaluation, batches of 200."""
    task = auroraqd.tasks.AirHockey()
    rng = np.random.default_rng(0)
    task(rng.random((BATCH, 8)))
    aurora = auroraqd.Aurora(8, PCA(n_components=2), seed=0).run(task, generations=generations)

    def offspring():
        parents = aurora.archive.genotype[auroraqd.Curiosity()(aurora.archive, BATCH, rng)]
        return auroraqd.Polynomial()(parents, rng)

    print(f"### An evaluation of the air-hockey task, batches of 200, microseconds (median of {looks}, and the slowest)\n")
    print("| genotypes | median | slowest |\n|---|---|---|")
    batches = {"uniformly random": lambda: rng.random((BATCH, 8)), "offspring of a repertoire": offspring}
    for name, batch in batches.items():
        times = [1e6 * seconds(task, batch()) / BATCH for _ in range(looks)]
        print(f"| {name} | {np.median(times):.1f} | {max(times):.1f} |", flush=True)
    pushing = box2d.pushing(ENGINE, 0)
    since = time.perf_counter()
    for movement in zip(*box2d.air_hockey.movement(pushing), strict=True):
        box2d.engine(*movement, 0.0)
    theirs = 1e6 * (time.perf_counter() - since) / ENGINE
    ours = 1e6 * np.median([seconds(task, pushing) for _ in range(min(looks, 100))]) / ENGINE
    print(f"| that move the puck | {ours:.1f} | |")
    print(f"| the same, Box2D 3 through Python | {theirs:.0f} | |", flush=True)


def seconds(task, genotypes):
    since = time.perf_counter()
    task(genotypes)
    return time.perf_counter() - since


def paper_size(generations, descriptors):
    """Runs of paper size."""
    task = auroraqd.tasks.AirHockey()
    print(f"\n### A run of paper size on the air-hockey task: {generations} generations of {BATCH}\n")
    print("| descriptor | seconds | stored | diversity, 10 x 10 |\n|---|---|---|---|")
    for name, descriptor in descriptors.items():
        aurora = auroraqd.Aurora(8, descriptor, seed=0, variation=auroraqd.Polynomial(at_least_one=False))
        since = time.perf_counter()
        aurora.run(task, generations=generations)
        took = time.perf_counter() - since
        diversity = auroraqd.metrics.diversity(aurora.archive.observation)
        print(f"| {name} | {took:.1f} | {len(aurora.archive):,} | {diversity:.1f} |", flush=True)


def agreement(pushing, still):
    """Our physics beside an engine's."""
    print(f"\n### Air hockey beside Box2D 3: {pushing + still} genotypes, of which {pushing} move the puck; ", end="")
    print("metres apart, median (90%)\n")
    print("| restitution threshold | move in both | in either | 0.5 s after contact | at the end |\n|---|---|---|---|---|")
    genotypes = box2d.pushing(pushing, still)
    for threshold in (0.0, 1.0):
        found = box2d.compare(genotypes, threshold)
        apart = [f"{np.median(d):.4f} ({np.quantile(d, 0.9):.3f})" for d in (found.soon, found.end)]
        print(f"| {threshold:g} m/s | {found.both} | {found.either} | {apart[0]} | {apart[1]} |", flush=True)


def main(quick=False):
    evaluations(*((20, 20) if quick else (300, 300)))
    pca = {"PCA": PCA(n_components=2)}
    paper_size(*((20, pca) if quick else (5000, {**pca, "AutoEncoder": auroraqd.AutoEncoder(n_components=2)})))
    agreement(*((20, 5) if quick else (240, 60)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a run of 20 generations, 25 genotypes in the engine")
    main(parser.parse_args().quick)
