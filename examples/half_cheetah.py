"""Gaits of HalfCheetah: forwards, backwards, on its back, told nothing about running.

It senses how far it is, its pitch, and the angles of its six joints, at twenty moments of five seconds; two numbers that say
how two gaits differ are learned from that. Needs `pip install ".[robots]"`, and a minute. Writes the run folder
`runs/cheetah`, with figures; of the ground truth, the distance in metres and the pitch in rad are drawn.
"""

import sys

from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import write_figures


def main(generations=100):
    task = auroraqd.tasks.Gym("HalfCheetah-v5", steps=100, samples=20, positions=(0, 2, 3, 4, 5, 6, 7, 8))
    aurora = auroraqd.Aurora(
        task.n_genes,
        PCA(n_components=2),
        seed=0,
        batch_size=50,
        resolution=auroraqd.VAT(cells=4_000),
        schedule=auroraqd.Doubling(10),
    )
    aurora.run(task, generations=generations)
    auroraqd.save(aurora, "runs/cheetah")
    repertoire = auroraqd.load("runs/cheetah")
    write_figures("runs/cheetah")
    distance, pitch = repertoire.observation[:, -1, 0], repertoire.observation[:, -1, 1]
    print(f"{len(repertoire)} individuals, which end {distance.min():.1f} m to {distance.max():.1f} m from where they began;")
    print(f"{(abs(pitch) > 2).mean():.0%} of them are on their backs, or have rolled over")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
