"""A hexapod learns to walk, loses a leg, and walks again within a handful of trials.

AURORA sees which feet touch the floor when, and learns from that how gaits differ; the fastest of those that are alike stays.
Then the robot loses a leg in the middle, and `auroraqd.Adaptation` tries its gaits, as in A. Cully, J. Clune, D. Tarapore,
J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015. Needs the extra `robots`.

    python examples/hexapod.py         # 60 generations of 100, two minutes on one core
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import film

TRIALS = 20


def main(generations=60):
    whole = auroraqd.tasks.Hexapod()
    aurora = auroraqd.Aurora(
        whole.n_genes,
        PCA(n_components=6),
        batch_size=100,
        selection=auroraqd.Uniform(),
        variation=auroraqd.IsoLine(0.02, 0.2),  # 36 genes: faster gaits than the default finds
        resolution=auroraqd.Size(1_000),
        schedule=auroraqd.Doubling(10),
        seed=0,
    )
    aurora.run(whole, generations=generations)
    auroraqd.save(aurora, "runs/hexapod")
    repertoire = auroraqd.load("runs/hexapod")
    print(f"{len(repertoire)} individuals, the fastest walks {repertoire.fitness.max():.2f} m/s")

    broken = auroraqd.tasks.Hexapod(damage="middle-leg-gone")
    how = np.hstack([repertoire.descriptor, repertoire.genotype])  # gaits that are close in it are expected to fail alike
    adaptation = auroraqd.Adaptation(how, repertoire.fitness)
    for trial in range(1, min(TRIALS, len(repertoire)) + 1):
        row = adaptation.ask()
        adaptation.tell(row, broken(repertoire.genotype[row : row + 1]).fitness[0])  # NaN if it falls
        if trial in (1, 5, 10, TRIALS):
            print(f"after {trial} trials with a leg less: {adaptation.best}")
    try:
        film(broken, repertoire.genotype[[adaptation.best.row]], "runs/hexapod/a_leg_less.gif", names=["after trials"])
    except ValueError as error:  # no library to draw with
        print(error)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
