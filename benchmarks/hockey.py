"""The air-hockey task: how fast it is, how fast a run on it is, and how far its physics are from an engine's.

Needs the extra `test`, for Box2D.
"""

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


def evaluations():
    """Microseconds an evaluation, batches of 200."""
    task = auroraqd.tasks.AirHockey()
    rng = np.random.default_rng(0)
    task(rng.random((BATCH, 8)))
    aurora = auroraqd.Aurora(8, PCA(n_components=2), seed=0).run(task, generations=300)

    def offspring():
        parents = aurora.archive.genotype[auroraqd.Curiosity()(aurora.archive, BATCH, rng)]
        return auroraqd.Polynomial()(parents, rng)

    print("### An evaluation of the air-hockey task, batches of 200, microseconds (median of 300, and the slowest)\n")
    print("| genotypes | median | slowest |\n|---|---|---|")
    batches = {"uniformly random": lambda: rng.random((BATCH, 8)), "offspring of a repertoire": offspring}
    for name, batch in batches.items():
        times = [1e6 * seconds(task, batch()) / BATCH for _ in range(300)]
        print(f"| {name} | {np.median(times):.1f} | {max(times):.1f} |", flush=True)
    pushing = box2d.pushing(ENGINE, 0)
    since = time.perf_counter()
    for movement in zip(*box2d.air_hockey.movement(pushing), strict=True):
        box2d.engine(*movement, 0.0)
    theirs = 1e6 * (time.perf_counter() - since) / ENGINE
    ours = 1e6 * np.median([seconds(task, pushing) for _ in range(100)]) / ENGINE
    print(f"| that move the puck | {ours:.1f} | |")
    print(f"| the same, Box2D 3 through Python | {theirs:.0f} | |", flush=True)


def seconds(task, genotypes):
    since = time.perf_counter()
    task(genotypes)
    return time.perf_counter() - since


def paper_size(generations=5000):
    """Runs of paper size."""
    task = auroraqd.tasks.AirHockey()
    print(f"\n### A run of paper size on the air-hockey task: {generations} generations of {BATCH}\n")
    print("| descriptor | seconds | stored | diversity, 10 x 10 |\n|---|---|---|---|")
    for name, descriptor in (("PCA", PCA(n_components=2)), ("AutoEncoder", auroraqd.AutoEncoder(n_components=2))):
        aurora = auroraqd.Aurora(8, descriptor, seed=0, variation=auroraqd.Polynomial(at_least_one=False))
        since = time.perf_counter()
        aurora.run(task, generations=generations)
        took = time.perf_counter() - since
        diversity = auroraqd.metrics.diversity(aurora.archive.observation)
        print(f"| {name} | {took:.1f} | {len(aurora.archive):,} | {diversity:.1f} |", flush=True)


def agreement():
    """Our physics beside an engine's."""
    print("\n### Air hockey beside Box2D 3: 300 genotypes, of which 240 move the puck; metres apart, median (90%)\n")
    print("| restitution threshold | move in both | in either | 0.5 s after contact | at the end |\n|---|---|---|---|---|")
    genotypes = box2d.pushing(240, 60)
    for threshold in (0.0, 1.0):
        found = box2d.compare(genotypes, threshold)
        apart = [f"{np.median(d):.4f} ({np.quantile(d, 0.9):.3f})" for d in (found.soon, found.end)]
        print(f"| {threshold:g} m/s | {found.both} | {found.either} | {apart[0]} | {apart[1]} |", flush=True)


def main():
    evaluations()
    paper_size()
    agreement()


if __name__ == "__main__":
    main()
