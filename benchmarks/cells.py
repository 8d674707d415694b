"""How fast descriptors are assigned to the cells of CVT-MAP-Elites, as the paper's variants have them.

    python benchmarks/cells.py      # ten minutes the first time, in which 100,000 centroids are found; then one
    python benchmarks/cells.py --quick    # to see it work: seconds; no conclusions can be drawn

Each batch of 200 offspring of a run is assigned twice: as `CVTArchive` does it, and by the product of all with all in single
precision, exact differences deciding among the cells that it leaves, as was done before. The answers are compared. Milliseconds
are of the processor, on one core, and medians over generations 20 to 60 of each run.
"""

import argparse
import time

import numpy as np

from auroraqd.experiments.variants import AIR_HOCKEY, BALLISTIC

GROUP = 64


class AllWithAll:
    """Nearest centroids by one matrix product; of centroids and descriptors of ordinary size."""

    def __init__(self, centroids):
        pad = -len(centroids) % GROUP
        squares = np.append((centroids**2).sum(axis=1), np.full(pad, np.inf))
        points = np.concatenate([centroids, np.zeros((pad, centroids.shape[1]))])
        self.centroids = centroids
        self.screen = np.ascontiguousarray(np.column_stack([points, squares]).T, np.float32)
        self.reach = np.sqrt(squares[: len(centroids)].max())

    def __call__(self, x):
        """(n, d) to (n,)."""
        asked = np.column_stack([-2 * x, np.ones(len(x))]).astype(np.float32)
        lowest = np.empty((len(x), self.screen.shape[1] // GROUP), np.float32)
        for start in range(0, self.screen.shape[1], 4096):
            scores = asked @ self.screen[:, start : start + 4096]
            lowest[:, start // GROUP : (start + scores.shape[1]) // GROUP] = scores.reshape(len(x), -1, GROUP).min(axis=2)
        length = np.sqrt((x**2).sum(axis=1))
        slack = 2 * (x.shape[1] + 4) * np.finfo(np.float32).eps * (self.reach**2 + 2 * self.reach * length)
        found = np.empty(len(x), np.int64)
        for i, row in enumerate(x):
            groups = np.flatnonzero(lowest[i] <= lowest[i].min() + slack[i])
            cells = (groups[:, None] * GROUP + np.arange(GROUP)).ravel()
            cells = cells[cells < len(self.centroids)]
            found[i] = cells[((self.centroids[cells] - row) ** 2).sum(axis=1).argmin()]
        return found


def compared(experiment, name, generations):
    """Milliseconds a batch of both, of one run."""
    task, aurora = experiment.variants[name].of(experiment.base(generations=generations), 0).build()
    archive, times = aurora.archive, []
    before, now = AllWithAll(archive.tessellation.centroids), archive._cells

    def both(descriptor):
        since = time.process_time()
        cells = now(descriptor)
        between = time.process_time()
        assert (cells == before(descriptor)).all()
        times.append((between - since, time.process_time() - between))
        return cells

    archive._cells = both
    aurora.run(task, generations=generations)
    return archive.n_cells, 1e3 * np.median(times[generations // 3 :], axis=0)


def main(quick=False):
    generations = 6 if quick else 60
    print("### 200 offspring to the cells of a CVT archive in 100 dimensions, milliseconds of one core (medians)\n")
    print("| variant | cells | all with all, as before | now |\n|---|---|---|---|")
    for experiment, name in ((BALLISTIC, "cvt"), (AIR_HOCKEY, "cvt"), (BALLISTIC, "cvt-prior")):
        cells, (after, before) = compared(experiment.quickened() if quick else experiment, name, generations)
        print(f"| {experiment.task}, {name} | {cells:,} | {before:.1f} | {after:.1f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2,000 centroids, 6 generations")
    main(parser.parse_args().quick)
