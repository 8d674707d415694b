"""The soft arm of an octopus learns what it can do with sixteen muscles, and to do it with little effort.

AURORA sees where four points of the arm are, and learns from that how two ways to move differ. Of two that are alike, the one
that pulls less stays. Needs the extra `robots`.

    python examples/octopus_arm.py      # 60 generations of 50, two minutes on one core
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import film, write_figures

FOLDER = "runs/octopus-arm"


def ease(episode):
    """Minus the mean square of how much the muscles pull, from 0 to 1."""
    return -(episode.control**2).mean(axis=(1, 2))


def main(generations=60):
    task = auroraqd.tasks.OctopusArm(fitness=ease)
    aurora = auroraqd.Aurora(
        task.n_genes,
        PCA(n_components=3),
        batch_size=50,
        selection=auroraqd.Novelty(),
        variation=auroraqd.IsoLine(0.05, 0.3),  # 48 genes: it goes farther than with the default
        resolution=auroraqd.Size(1_000),
        schedule=auroraqd.Doubling(10),
        seed=0,
    )
    aurora.run(task, generations=generations)
    auroraqd.save(aurora, FOLDER)
    repertoire = auroraqd.load(FOLDER)
    write_figures(FOLDER)
    far = np.linalg.norm(repertoire.ground_truth[:, :2], axis=1)
    print(f"{len(repertoire)} individuals, the tip ends up to {far.max():.2f} m from where it hung")
    rows = repertoire.sample(6)
    try:
        film(task, repertoire.genotype[rows], f"{FOLDER}/figures/arms.gif")
    except ValueError as error:  # no library to draw with
        print(error)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
