"""A hexapod that learns to walk, then to walk a path: a repertoire of gaits, and of walks that are made of them.

AURORA sees where the torso goes in three seconds, and learns from that how gaits differ. Then a walk of fifteen seconds names
five places in what it has learned, and the gait nearest to each is walked, from where the one before has ended. Beside it, as
much time is walked by walks without layers, whose genes are those of five gaits, and by five gaits at random of the repertoire.
After A. Cully, Y. Demiris, Hierarchical Behavioral Repertoires with Unsupervised Descriptors, GECCO 2018. Needs the extra
`robots`.

    python examples/walking.py         # four minutes of one core; the figure is runs/walking/walking.png
    python examples/walking.py 40 3    # three seeds
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import STYLE
from auroraqd.tasks import Evaluation, Hexapod, Hierarchical

HEXAPOD = Hexapod(observe="path", samples=15)
GAITS, SIDE = 5, 0.2  # of a walk; m, of the squares of floor that are counted
FOLDER = Path("runs/walking")
WANTED = {  # where to be after each gait, in m from the start
    "there and back": ((0.3, 0.0), (0.6, 0.0), (0.6, 0.1), (0.3, 0.1), (0.0, 0.1)),
    "to the left": ((0.25, 0.05), (0.4, 0.2), (0.45, 0.4), (0.45, 0.6), (0.45, 0.8)),
    "a slalom": ((0.2, 0.1), (0.4, -0.05), (0.6, 0.1), (0.8, -0.05), (1.0, 0.1)),
    "a circle": ((0.2, 0.1), (0.2, 0.3), (0.0, 0.4), (-0.15, 0.2), (0.0, 0.0)),
}


def gait(genotypes, state):
    """Three seconds, from a state: where it is in the end is the ground truth."""
    (fitness, path, _), state = HEXAPOD.carried(genotypes, state)
    return Evaluation(np.where(np.isfinite(fitness), 0, np.nan), path, path[:, -1]), state


def flat(genotypes):
    """A walk without layers: five gaits, (n, 180)."""
    state, paths = None, []
    for genes in np.split(genotypes, GAITS, axis=1):
        evaluation, state = gait(genes, state)
        paths.append(evaluation.observation)
    return Evaluation(evaluation.fitness, np.stack(paths, axis=1), evaluation.ground_truth)


def discovered(name, task, n_genes, generations, seed):
    """A repertoire of a task."""
    aurora = auroraqd.Aurora(
        n_genes,
        PCA(n_components=2),
        batch_size=50,
        selection=auroraqd.Uniform(),
        variation=auroraqd.IsoLine(0.02, 0.2),
        resolution=auroraqd.Size(1_000),
        schedule=auroraqd.Doubling(10),
        seed=seed,
    )
    auroraqd.save(aurora.run(task, generations=generations), FOLDER / name, overwrite=True)
    return auroraqd.load(FOLDER / name)


def squares(places):
    """Square metres of floor, of squares in which walks end."""
    return len(np.unique(np.floor(places / SIDE), axis=0)) * SIDE**2


def at_random(walk, generations, seed):
    """Walks of gaits at random."""
    evaluation = walk(np.random.default_rng(seed).random((50 * generations, walk.n_genes)))
    valid = np.isfinite(evaluation.fitness)
    return Evaluation(*(column[valid] for column in evaluation))


def draw(kinds, gaits, path):
    """Where walks end; and those of the first kind that come closest to what is wanted."""
    reach = max(np.abs(found.ground_truth).max() for found in kinds.values()) + 0.1
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13, 6.6), layout="constrained")
        above, below = figure.subfigures(2, 1)
        gaits_of, *panels = above.subplots(1, 1 + len(kinds))
        for way in gaits.observation[gaits.sample(min(150, len(gaits)))]:
            gaits_of.plot(*np.vstack([[0, 0], way]).T, color="#2646a0", linewidth=0.4, alpha=0.6)
        gaits_of.set(title=f"{len(gaits):,} gaits of three seconds", aspect="equal", xlabel="x, m", ylabel="y, m")
        for axes, (name, found) in zip(panels, kinds.items(), strict=True):
            axes.scatter(*found.ground_truth.T, s=3, color="#2646a0", linewidths=0)
            axes.set(title=f"{name}: {squares(found.ground_truth):.1f} m²", aspect="equal", xlabel="x, m")
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        for axes, (name, marks) in zip(below.subplots(1, len(WANTED)), WANTED.items(), strict=True):
            way, error = nearest(next(iter(kinds.values())), marks)
            for leg, color in enumerate(("#2646a0", "#7a3fb0", "#c8287a", "#e07040", "#e0a020")):
                axes.plot(*np.vstack([way[leg - 1][-1:] if leg else [[0, 0]], way[leg]]).T, color=color, linewidth=2)
            axes.plot(*np.array(marks).T, "x", color="black", markersize=6)
            axes.set(title=f"{name}: {100 * error:.0f} cm off", aspect="equal", xlabel="x, m")
            axes.margins(0.15)
        figure.savefig(path, dpi=130, bbox_inches="tight")


def nearest(found, marks):
    """The way of the walk that passes closest to marks, one at the end of each gait, and how far it is from them on average."""
    errors = np.linalg.norm(found.observation[:, :, -1] - np.array(marks), axis=2).mean(axis=1)
    return found.observation[errors.argmin()], errors.min()


def main(generations=40, seeds=1):
    floor, off = [], []
    for seed in range(seeds):
        gaits = discovered("gaits", lambda genotypes: gait(genotypes, None)[0], HEXAPOD.n_genes, 2 * generations, seed)
        walk = Hierarchical(gaits, gait, steps=GAITS)
        more = generations + 2 * generations // GAITS  # as many seconds, those of the gaits too
        kinds = {
            "walks of gaits": discovered("walks", walk, walk.n_genes, generations, seed),
            "gaits at random": at_random(walk, generations, seed),
            "without layers": discovered("flat", flat, GAITS * HEXAPOD.n_genes, more, seed),
        }
        if seed == 0:
            draw(kinds, gaits, FOLDER / "walking.png")
        floor.append([squares(found.ground_truth) for found in kinds.values()])
        off.append([100 * np.mean([nearest(found, marks)[1] for marks in WANTED.values()]) for found in kinds.values()])
        print(f"seed {seed}: {len(gaits)} gaits, {len(kinds['walks of gaits'])} individuals of them", flush=True)
    print("\n| | m² of floor, median (range) | cm off what is wanted |\n|---|---|---|")
    for name, area, distance in zip(kinds, np.transpose(floor), np.transpose(off), strict=True):
        print(f"| {name} | {spread(area)} | {spread(distance)} |")


def spread(values):
    """Median and range."""
    return f"{np.median(values):.1f} ({values.min():.1f} to {values.max():.1f})"


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
