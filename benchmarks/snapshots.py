"""What snapshots cost: the share of a run's time that is spent in the callback, on the ballistic throw and on air hockey.

A run begins with a compilation, which is done before.
"""

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


def main():
    ballistic, hockey = auroraqd.tasks.Ballistic(), auroraqd.tasks.AirHockey()
    auroraqd.Aurora(2, PCA(2), seed=0).run(ballistic, generations=3)
    runs = {
        "ballistic, 200 generations": (ballistic, 2, 200, {}),
        "ballistic, 1,600 generations": (ballistic, 2, 1600, {}),
        "ballistic, 200 generations, updated in each": (ballistic, 2, 200, {"schedule": auroraqd.Every(1)}),
        "air hockey, 200 generations": (hockey, 8, 200, {}),
    }
    print("| run | stored | run, s | snapshots, ms | share | MB |")
    print("|---|---|---|---|---|---|")
    for name, (task, n_genes, generations, options) in runs.items():
        spent, seconds, stored, size = share(task, n_genes, generations, **options)
        print(f"| {name} | {stored:,} | {seconds:.1f} | {1e3 * spent:.0f} | {spent / seconds:.1%} | {size:.1f} |", flush=True)


if __name__ == "__main__":
    main()
