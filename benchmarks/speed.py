"""How fast auroraqd is: a run of paper size, the archive from 1e3 to 1e6 individuals, the command line.

    python benchmarks/speed.py
    python benchmarks/speed.py --quick    # to see it work: half a minute, for kernels are compiled anew

Compiled kernels are warmed up first. The machine's noise is met with medians.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from sklearn.decomposition import PCA

import auroraqd

BATCH = 200


def paper_size(generations):
    """`Aurora.run` at paper size with PCA, twice: seconds, and the peak memory of this process."""
    task = auroraqd.tasks.Ballistic()
    auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=1).run(task, generations=60)
    print(f"### A run of paper size: {generations} generations of {BATCH}, PCA\n")
    print("| variation | seconds | us an evaluation | stored | peak memory, MiB |\n|---|---|---|---|---|")
    for variation in (auroraqd.Polynomial(), auroraqd.Polynomial(at_least_one=False)):
        aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0, variation=variation)
        since = time.perf_counter()
        aurora.run(task, generations=generations)
        seconds = time.perf_counter() - since
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        per_evaluation = 1e6 * seconds / aurora.evaluations
        print(f"| {variation} | {seconds:.2f} | {per_evaluation:.2f} | {len(aurora.archive):,} | {memory:.0f} |", flush=True)


def median_add(archive, batches):
    """Median microseconds a row of `archive.add` over batches, each a dictionary of columns; the archive changes."""
    times = []
    for batch in batches:
        since = time.perf_counter()
        archive.add(**batch)
        times.append((time.perf_counter() - since) / len(batch["fitness"]))
    return 1e6 * np.median(times)


def throws(genotypes):
    """Ballistic throws that are valid, described by their ground truth."""
    fitness, observation, truth = auroraqd.tasks.Ballistic()(genotypes)
    valid = np.isfinite(fitness)
    columns = {
        "genotype": genotypes,
        "fitness": fitness,
        "observation": observation,
        "descriptor": truth,
        "ground_truth": truth,
    }
    return {name: column[valid] for name, column in columns.items()}


def offspring(archive, rng, batches, size=BATCH):
    """Batches of a run: children of parents chosen by curiosity, every one mutated."""
    for _ in range(batches):
        parents = archive.genotype[auroraqd.Curiosity()(archive, size, rng)]
        yield throws(auroraqd.Polynomial()(parents, rng))


def real_offspring(generations, most):
    """`add` of offspring of real throws: in the archive of a real run, and in one that offspring filled to a million (`most`).

    Both archives are near saturation: l is such that they would hold some 3% and 25% more in the end.
    """
    print("\n### `archive.add`, 200 real offspring without copies, d = 2\n")
    print("| stored | us a row (median of 300 batches) |\n|---|---|")
    rng = np.random.default_rng(1)
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(task.n_genes, "hand-coded", seed=0)
    aurora.run(task, generations=generations, callback=lambda run: len(run.archive) >= 15_000)
    archive = auroraqd.UnstructuredArchive(l=0.0008)
    archive.add(**throws(rng.random((min(most, 100_000), 2))))
    while len(archive) < most:
        for batch in offspring(archive, rng, 1, size=20_000):
            archive.add(**batch)
    for filled in (aurora.archive, archive):
        size = len(filled)
        print(f"| {size:,} | {median_add(filled, offspring(filled, rng, 300)):.2f} |", flush=True)


def scaling(most, dimensions=(2, 3, 5, 10)):
    """`add` for archives of uniformly random descriptors; rows near stored ones, so that most of them compete."""
    print("\n### `archive.add`, 200 rows near stored ones, uniformly random descriptors, us a row (median of 20 batches)\n")
    print("| stored | " + " | ".join(f"d = {d}" for d in dimensions) + " |\n|---|" + "---|" * len(dimensions))
    for size in (size for size in (1_000, 10_000, 100_000, 1_000_000) if size <= most):
        cells = []
        for d in dimensions:
            rng = np.random.default_rng(d)
            archive = auroraqd.UnstructuredArchive(l=0.5 * size ** (-1 / d))
            while len(archive) < size:
                archive.add(**described(rng.random((min(size, 20_000), d))))
            cells.append(median_add(archive, (nearby(archive, rng) for _ in range(20))))
        print(f"| {size:,} | " + " | ".join(f"{cell:.2f}" for cell in cells) + " |", flush=True)


def nearby(archive, rng):
    """A batch of individuals about l from stored ones."""
    places = archive.descriptor[rng.integers(len(archive), size=BATCH)]
    return described(places + rng.normal(0, archive.l / np.sqrt(places.shape[1]), places.shape))


def described(descriptor):
    """Individuals with these descriptors and little else."""
    n = len(descriptor)
    return {"genotype": np.zeros((n, 1)), "fitness": np.zeros(n), "observation": np.zeros((n, 1)), "descriptor": descriptor}


def command_line(generations):
    """`auroraqd --help`, and a short run in a fresh copy of the package (kernels not compiled yet) and again."""
    print("\n### The command line, seconds\n")
    print("| command | seconds |\n|---|---|")
    timed("auroraqd --help", ["--help"], {})
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(Path(auroraqd.__file__).parent, f"{folder}/auroraqd", ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("first", "second"):
            arguments = ["run", "ballistic", "--generations", str(generations), "--out", f"{folder}/{name}"]
            timed(f"auroraqd run ballistic --generations {generations}, {name} time", arguments, {"PYTHONPATH": folder})


def timed(name, arguments, environment):
    since = time.perf_counter()
    command = [sys.executable, "-m", "auroraqd", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={**os.environ, **environment})
    print(f"| {name} | {time.perf_counter() - since:.2f} |", flush=True)


def main(quick=False):
    generations, most = (20, 1_000) if quick else (5000, 1_000_000)
    paper_size(generations)
    real_offspring(generations, most)
    scaling(most)
    command_line(generations=20 if quick else 200)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 generations, archives of 1,000")
    main(parser.parse_args().quick)
