"""The ballistic task in five lines: a repertoire of throws, with no descriptor given."""

import sys

from sklearn.decomposition import PCA

import auroraqd


def main(generations=500):
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0)
    aurora.run(task, generations=generations)
    print(aurora.archive)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
