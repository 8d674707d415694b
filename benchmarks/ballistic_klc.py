"""Repertoire size and KLC of AURORA-PCA and of the genotype descriptor against the hand-coded one, on the ballistic task.

    python benchmarks/ballistic_klc.py --generations 5000 --seeds 3

The experiment of the paper (Sec. "First scenario") for its variants without auto-encoder and without CVT, with the paper's
variation. The reference of a seed's KLC is the hand-coded repertoire of that seed; the noise floor is the KLC between
hand-coded repertoires of different seeds. Prints a Markdown table.
"""

import argparse
import time
from statistics import median

from sklearn.decomposition import PCA

import auroraqd
from auroraqd.metrics import klc, outside


def grow(descriptor, seed, generations):
    """The archive of one run, and its seconds."""
    task = auroraqd.tasks.Ballistic()
    variation = auroraqd.Polynomial(at_least_one=False)  # as the paper has it
    since = time.perf_counter()
    aurora = auroraqd.Aurora(task.n_genes, descriptor, seed=seed, variation=variation).run(task, generations=generations)
    return aurora, time.perf_counter() - since


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generations", type=int, default=5000)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()

    print(f"{options.generations} generations of 200\n")
    print("| descriptor | seed | stored | KLC | outside the reference's box | RMSE | seconds |")
    print("|---|---|---|---|---|---|---|")
    references, scores = {}, {"hand-coded": [], "pca": [], "genotype": []}
    for seed in range(options.seeds):
        for name, descriptor in (("hand-coded", "hand-coded"), ("pca", PCA(n_components=2)), ("genotype", "genotype")):
            aurora, seconds = grow(descriptor, seed, options.generations)
            truth = aurora.archive.ground_truth.copy()
            if name == "hand-coded":
                references[seed] = truth
            score, beyond = klc(references[seed], truth), outside(references[seed], truth)
            scores[name].append((len(aurora.archive), score))
            rmse = aurora.history.last.rmse
            print(f"| {name} | {seed} | {len(truth):,} | {score:.4f} | {beyond:.2%} | {rmse:.4f} | {seconds:.1f} |", flush=True)
    for name, values in scores.items():
        sizes, klcs = zip(*values, strict=True)
        print(f"| {name} | median | {median(sizes):,.0f} | {median(klcs):.4f} | | | |")
    floor = [klc(references[a], references[b]) for a in references for b in references if a != b]
    if floor:
        print(f"\nKLC between hand-coded repertoires of different seeds: median {median(floor):.4f}, largest {max(floor):.4f}")


if __name__ == "__main__":
    main()
