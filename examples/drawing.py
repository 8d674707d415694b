"""An arm learns to reach, then to draw strokes of what it reaches, then figures of its strokes: a hierarchy of repertoires.

Each layer executes skills of the one below, and each has a descriptor that is learned from what the pen did, after A. Cully,
Y. Demiris, Hierarchical Behavioral Repertoires with Unsupervised Descriptors, GECCO 2018. Beside it, as many movements are
spent on figures without layers, whose genes are the joint angles of all movements.

    python examples/drawing.py         # a minute; the figure is runs/drawing/drawing.png
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import STYLE
from auroraqd.tasks import Hierarchical

JOINTS, POINTS = 4, 8  # of the arm, whose links are 0.25 m long; of the pen's way in a movement
REST = np.full(JOINTS, 0.4)  # rad
MOVES, STROKES = 3, 3  # movements of a stroke, strokes of a figure
FOLDER = Path("runs/drawing")


def move(genotypes, angles):
    """Move the joints from where they are to other angles, (n, 4) from -2 to 2 rad: where the pen went, and the joints."""
    targets = 4 * genotypes - 2
    start = np.tile(REST, (len(targets), 1)) if angles is None else angles
    share = np.linspace(0, 1, POINTS + 1)[1:, None]
    along = np.cumsum(start[:, None] + share * (targets - start)[:, None], axis=2)
    return 0.25 * np.stack([np.cos(along).sum(axis=2), np.sin(along).sum(axis=2)], axis=2), targets


def reach(genotypes):
    """One movement from rest."""
    return move(genotypes, None)[0]


def flat(genotypes):
    """A figure without layers: all movements, (n, 36)."""
    angles, ways = None, []
    for step in range(MOVES * STROKES):
        way, angles = move(genotypes[:, JOINTS * step : JOINTS * (step + 1)], angles)
        ways.append(way)
    return np.stack(ways, axis=1).reshape(len(genotypes), STROKES, MOVES, POINTS, 2)


def discovered(name, task, n_genes, generations, seed):
    """A repertoire of a task."""
    aurora = auroraqd.Aurora(n_genes, PCA(n_components=2), resolution=auroraqd.Size(2_000), seed=seed)
    auroraqd.save(aurora.run(task, generations=generations), FOLDER / name, overwrite=True)
    return auroraqd.load(FOLDER / name)


def layers(generations, seed):
    """Reaches, strokes, and figures."""
    reaches = discovered("reaches", reach, JOINTS, generations, seed)
    strokes = Hierarchical(reaches, move, steps=MOVES)
    known = discovered("strokes", strokes, strokes.n_genes, generations, seed)
    figures = Hierarchical(known, strokes, steps=STROKES)
    return reaches, known, discovered("figures", figures, figures.n_genes, generations, seed)


def pens(repertoire):
    """The pen's ways, (n, points, 2)."""
    return repertoire.observation.reshape(len(repertoire), -1, 2)


def covered(one, other, dimensions, bins):
    """The shares of a common space, PCA of figures of both, that the figures of each reach."""
    number = min(len(one), len(other))
    both = np.concatenate([pens(one)[:number], pens(other)[:number]]).reshape(2 * number, -1)
    space = PCA(dimensions, random_state=0).fit(both)
    places = [space.transform(pens(repertoire).reshape(len(repertoire), -1)) for repertoire in (one, other)]
    low, high = np.concatenate(places).min(axis=0), np.concatenate(places).max(axis=0)
    return [auroraqd.metrics.coverage(place, bins, low, high) for place in places]


def draw(repertoires, path):
    """Where the pen went: all reaches, and sixteen diverse skills of each of the others."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 3.3), layout="constrained")
        parts = figure.subfigures(1, len(repertoires))
        for part, (name, repertoire) in zip(parts, repertoires.items(), strict=True):
            part.suptitle(f"{name}: {len(repertoire):,}")
            if name == "reaches":
                axes = part.subplots()
                axes.scatter(*pens(repertoire)[:, -1].T, c=repertoire.descriptor[:, 0], s=2, cmap="viridis")
                axes.set(aspect="equal")
                axes.axis("off")
                continue
            for axes, row in zip(part.subplots(4, 4).flat, repertoire.sample(16), strict=False):
                for way, color in zip(np.split(pens(repertoire)[row], STROKES), ("#2646a0", "#c8287a", "#e0a020"), strict=True):
                    axes.plot(*way.T, color=color, linewidth=1.2)
                axes.set(aspect="equal", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), xticks=(), yticks=())
        figure.savefig(path, dpi=130)


def main(generations=300, seeds=1):
    plain = generations * (1 + MOVES + MOVES * STROKES) // (MOVES * STROKES)  # as many movements
    shares = []
    for seed in range(seeds):
        reaches, strokes, figures = layers(generations, seed)
        other = discovered("flat", flat, JOINTS * MOVES * STROKES, plain, seed)
        if seed == 0:
            draw({"reaches": reaches, "strokes": strokes, "figures": figures, "without layers": other}, FOLDER / "drawing.png")
        print(f"seed {seed}: {len(reaches)}, {len(strokes)}, {len(figures)} individuals; without layers {len(other)}")
        shares.append([covered(figures, other, dimensions, bins) for dimensions, bins in ((2, 20), (5, 5))])
    for (layered, without), space in zip(np.mean(shares, axis=0), ("20 x 20 cells in 2", "5^5 cells in 5"), strict=True):
        print(f"{space} dimensions of a common space: {layered:.1%} reached with layers, {without:.1%} without")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
