"""Ant learns in which directions it can go, and how, told neither about directions nor about legs.

It senses where its torso is at twenty moments of five seconds; two numbers that say how two walks differ are learned from
that. Needs `pip install ".[robots]"`, and some minutes. Writes the run folder `runs/ant`, with figures, and a video where
MuJoCo can draw.
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import film, write_figures


def show(aurora):
    if aurora.generation % 10 == 0:
        farthest = np.linalg.norm(aurora.archive.ground_truth, axis=1).max()
        print(f"generation {aurora.generation}: {len(aurora.archive)} walks, the farthest of {farthest:.1f} m", flush=True)


def main(generations=100):
    task = auroraqd.tasks.Gym("Ant-v5", controller=auroraqd.tasks.Sinusoids(), steps=100, samples=20)
    aurora = auroraqd.Aurora(
        task.n_genes,
        PCA(n_components=2),
        seed=0,
        batch_size=50,
        resolution=auroraqd.VAT(cells=4_000),  # coarser than the default: there are some thousand evaluations
        schedule=auroraqd.Doubling(10),
    )
    aurora.run(task, generations=generations, callback=show)
    auroraqd.save(aurora, "runs/ant")
    repertoire = auroraqd.load("runs/ant")
    files = write_figures("runs/ant")
    rows = repertoire.sample(max(1, min(6, generations // 5)))
    try:
        film(task, repertoire.genotype[rows], "runs/ant/figures/walks.gif", names=[f"skill {row}" for row in rows])
    except ValueError as error:  # no library to draw with
        print(error)
    print(f"{len(repertoire)} individuals; figures in {files[0].parent}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
