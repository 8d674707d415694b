"""How busy workers are, when evaluations do not last alike: by the generation, and asynchronously.

    python benchmarks/waiting.py --workers 16            # processes
    python benchmarks/waiting.py --workers 16 --dask     # workers of a Dask cluster on this machine
    python benchmarks/waiting.py --quick                 # to see it work: seconds; no conclusions can be drawn

Evaluations sleep, 0.05 s in the median, log-normally with sigma 1, so the workers need no cores of their own. Printed is the
sum of the durations over workers times wall time, from the second generation on, when the workers are there, to the end.
"""

import argparse
import time
from contextlib import ExitStack

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate

MEDIAN, SIGMA = 0.05, 1.0  # s


def duration(seeds: np.ndarray) -> np.ndarray:
    return np.array([MEDIAN * np.random.default_rng(int(seed)).lognormal(0, SIGMA) for seed in seeds])


def robot(genotypes, seeds):
    time.sleep(duration(seeds).sum())
    return auroraqd.tasks.Ballistic()(genotypes)


robot.seeded = True
robot.n_genes = 2


def busy(spread, workers: int, batch_size: int, evaluations: int, asynchronous: bool) -> float:
    """The share of the workers' time that they evaluate."""
    aurora = auroraqd.Aurora(2, PCA(2), seed=0, batch_size=batch_size)
    aurora.run(spread, evaluations=batch_size, asynchronous=asynchronous)
    first, began = aurora.evaluations, time.perf_counter()
    aurora.run(spread, evaluations=evaluations, asynchronous=asynchronous)
    seconds = time.perf_counter() - began
    seeds = auroraqd.tasks.noise.seeds_of(0, first, aurora.evaluations - first)
    return duration(seeds).sum() / seconds / workers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=16)
    parser.add_argument("--evaluations", type=int, default=4000)
    parser.add_argument("--dask", action="store_true", help="workers of a Dask cluster, and not processes")
    parser.add_argument("--quick", action="store_true", help="two workers, 40 evaluations, in batches of 16")
    options, batch_sizes = parser.parse_args(), (16, 64, 256)
    if options.quick:
        options.workers, options.evaluations, batch_sizes = 2, 40, (16,)
    print(f"{'batch':>6} {'by the generation':>18} {'asynchronous':>13}")
    with ExitStack() as cluster:
        workers = evaluate.processes(options.workers)
        if options.dask:
            from distributed import Client, LocalCluster

            kept = cluster.enter_context(LocalCluster(n_workers=options.workers, threads_per_worker=1, dashboard_address=None))
            workers = evaluate.dask(cluster.enter_context(Client(kept)))
        spread = cluster.enter_context(evaluate.over(workers, robot))
        for batch_size in batch_sizes:
            shares = [busy(spread, options.workers, batch_size, options.evaluations, kind) for kind in (False, True)]
            print(f"{batch_size:6} {shares[0]:18.0%} {shares[1]:13.0%}", flush=True)


if __name__ == "__main__":
    main()
