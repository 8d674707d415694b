"""Started under `mpiexec -m mpi4py.futures`: tasks over an MPI pool, as a user's script would have them."""

import sys
from pathlib import Path

import numpy as np
import robots
from mpi4py.futures import MPIPoolExecutor

from auroraqd import evaluate

if __name__ == "__main__":
    genotypes = np.random.default_rng(0).random((60, robots.GENES))
    found = {}
    for robot in (robots.slow, robots.raises, robots.OneBadWorker(Path(sys.argv[1]) / "mark")):
        with evaluate.over(MPIPoolExecutor, robot) as task:
            evaluations = [task(genotypes) for _ in range(2)]
            assert task._workers == int(sys.argv[2])
            for name, column in evaluations[1]._asdict().items():
                found[f"{task.__name__} {name}"] = column
    np.savez(Path(sys.argv[1]) / "found.npz", **found)
