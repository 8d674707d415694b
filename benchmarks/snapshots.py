"""What snapshots cost: the share of a run's time that is spent in the callback, on the ballistic throw and on air hockey.

    python benchmarks/snapshots.py
    python benchmarks/snapshots.py --quick    # to see it work: seconds; no conclusions can be drawn

A run begins with a compilation, which is done before.
"""

import argparse
import tempfile
import time

from sklearn.decomposition import PCA

import auroraqd


class Timed(auroraqd.Snapshots):
    """Snapshots that know how long they took, in s."""

    seconds = 0.0

    def generation(self, aurora):  # noqa: D102
        since = time.perf_counter()
        super().generation(aurora)
        self.seconds += time.perf_counter() - since


def share(task, n_genes, generations, **options):
    """Of the time of a run, and how large the snapshots are, in MB."""
    with tempfile.TemporaryDirectory() as folder:
        timed, aurora = Timed(folder), auroraqd.Aurora(n_genes, PCA(2), seed=0, **options)
        since = time.perf_counter()
        aurora.run(task, generations=generations, callback=timed)
        seconds = time.perf_counter() - since
        size = sum(path.stat().st_size for path in timed._folder.glob("*"))
    return timed.seconds, seconds, len(aurora.archive), size / 1e6


def main(quick=False):
    few, many = (10, 20) if quick else (200, 1600)
    ballistic, hockey = auroraqd.tasks.Ballistic(), auroraqd.tasks.AirHockey()
    auroraqd.Aurora(2, PCA(2), seed=0).run(ballistic, generations=3)
    runs = {
        f"ballistic, {few} generations": (ballistic, 2, few, {}),
        f"ballistic, {many:,} generations": (ballistic, 2, many, {}),
        f"ballistic, {few} generations, updated in each": (ballistic, 2, few, {"schedule": auroraqd.Every(1)}),
        f"air hockey, {few} generations": (hockey, 8, few, {}),
    }
    print("| run | stored | run, s | snapshots, ms | share | MB |")
    print("|---|---|---|---|---|---|")
    for name, (task, n_genes, generations, options) in runs.items():
        spent, seconds, stored, size = share(task, n_genes, generations, **options)
        print(f"| {name} | {stored:,} | {seconds:.1f} | {1e3 * spent:.0f} | {spent / seconds:.1%} | {size:.1f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 and 20 generations")
    main(parser.parse_args().quick)
