"""Quality competes: Swimmer learns where it can go, and the cheapest way to go there. Of two swims that are alike, the one that
takes less effort stays.

Needs `pip install ".[robots]"`, and some minutes. The same with "Ant-v5" or "HalfCheetah-v5". Writes the run folder
`runs/swimmer`; its figure `fitness` shows the effort over the learned descriptor space.
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import write_figures


def thrift(episode):
    """The effort spared: minus the mean square of the controls."""
    return -(episode.control**2).mean(axis=(1, 2))


def show(aurora):
    if aurora.generation % 10 == 0:
        effort = -aurora.archive.fitness.mean()
        print(f"generation {aurora.generation}: {len(aurora.archive)} swims, effort {effort:.3f} on average", flush=True)


def main(generations=200):
    task = auroraqd.tasks.Gym("Swimmer-v5", steps=200, fitness=thrift)
    aurora = auroraqd.Aurora(
        task.n_genes,
        PCA(n_components=2),
        seed=0,
        batch_size=40,
        archive=auroraqd.UnstructuredArchive(competition="elitist"),
        resolution=auroraqd.VAT(cells=2_000),
        schedule=auroraqd.Doubling(10),
    )
    aurora.run(task, generations=generations, callback=show)
    auroraqd.save(aurora, "runs/swimmer")
    repertoire = auroraqd.load("runs/swimmer")
    write_figures("runs/swimmer")
    wanted = np.full(repertoire.observation.shape[1:], np.nan)
    wanted[-1] = (0.5, 0.5)  # metres: be there at the end, whatever the way
    found = repertoire.reach(wanted)
    print(f"{len(repertoire)} individuals; the one that ends closest to {wanted[-1]} ends at {found.observation[0, -1]}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
