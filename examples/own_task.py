"""A task of one's own is a plain function: a pendulum with friction, pushed by two torques.

Fitness is the energy saved; the observation is the angle over time. The repertoire is kept in a run folder, read back, and
asked for the descriptor of a motion that it has not seen.
"""

import sys
import tempfile

import numpy as np
from sklearn.decomposition import PCA

import auroraqd


def pendulum(genotypes):
    """Torques of the first and of the second half in, (n, 2) in [0, 1]; minus the effort and 40 angles out."""
    torque = 8 * genotypes - 4
    angle, speed = np.zeros(len(genotypes)), np.zeros(len(genotypes))
    angles = []
    for step in range(40):
        speed += 0.1 * (torque[:, step // 20] - 9.81 * np.sin(angle) - 0.3 * speed)
        angle = angle + 0.1 * speed
        angles.append(angle)
    return -np.abs(torque).sum(axis=1), np.stack(angles, axis=1)[..., None]


def main(generations=300):
    archive = auroraqd.UnstructuredArchive(competition="elitist")
    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=0, archive=archive)
    aurora.run(pendulum, generations=generations)
    with tempfile.TemporaryDirectory() as folder:
        repertoire = auroraqd.load(auroraqd.save(aurora, folder))
        print(repertoire)
        print("descriptor of standing still:", repertoire.describe(np.zeros((1, 40, 1))))
        print("least effort:", -repertoire.fitness.max(), "most:", -repertoire.fitness.min())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
