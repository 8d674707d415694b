"""A robot of Gymnasium: gaits and directions of Swimmer, with no descriptor given. Quality is distance less energy.

Needs `pip install ".[robots]"`. The same with "Ant-v5" or "HalfCheetah-v5".
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd


def thrift(episode):
    """How far it came, less the effort."""
    return np.linalg.norm(episode.qpos[:, -1, :2], axis=1) - 1e-3 * (episode.control**2).sum(axis=(1, 2))


def main(generations=200):
    task = auroraqd.tasks.Gym("Swimmer-v5", steps=200, fitness=thrift)
    aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0, batch_size=40)
    aurora.run(task, generations=generations)
    auroraqd.save(aurora, "runs/swimmer")
    repertoire = auroraqd.load("runs/swimmer")
    wanted = np.full(repertoire.observation.shape[1:], np.nan)
    wanted[-1] = (0.5, 0.5)  # metres: be there at the end, whatever the way
    found = repertoire.reach(wanted)
    print(f"{len(repertoire)} individuals; the one that ends closest to {wanted[-1]} ends at {found.observation[0, -1]}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
