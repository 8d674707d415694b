"""Figures of the documentation that are not results: `python docs/figures/draw.py [NAME ...]`, of all or of these."""

import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import scatter, trajectories, two_dimensional_colors

HERE = Path(__file__).parent
GREEN, PURPLE, ORANGE, GREY = "#1f7a6f", "#6a4c93", "#c8553d", "#555555"
mpl.rcParams.update({"font.size": 9, "svg.fonttype": "path", "svg.hashsalt": "auroraqd", "figure.dpi": 120})


def _save(figure, name):
    if name.endswith(".svg"):
        figure.savefig(HERE / name, bbox_inches="tight", metadata={"Date": None})
    else:
        figure.savefig(HERE / name, bbox_inches="tight", dpi=110, pil_kwargs={"optimize": True})
    plt.close(figure)


def _box(axes, place, text, color, width=2.1, height=0.78):
    x, y = place
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2), width, height, boxstyle="round,pad=0.04,rounding_size=0.12", fc=color, ec="none"
        )
    )
    axes.text(x, y, text, color="white", ha="center", va="center", linespacing=1.35)


def _arrow(axes, start, end, text="", offset=(0, 0), color=GREY, bend=0.0, style="-|>", align="center"):
    axes.add_patch(
        FancyArrowPatch(
            start, end, arrowstyle=style, mutation_scale=12, color=color, lw=1.4, connectionstyle=f"arc3,rad={bend}"
        )
    )
    middle = (np.array(start) + end) / 2 + offset
    axes.text(*middle, text, color=color, ha=align, va="center", fontsize=8, linespacing=1.3)


def _plain(axes, x, y):
    axes.set(xlim=x, ylim=y, aspect="equal")
    axes.axis("off")


def loop():
    """The loop of AURORA: exploring, every generation; learning, now and then."""
    figure, axes = plt.subplots(figsize=(8.6, 4.3))
    _plain(axes, (-1.4, 11.2), (-3.3, 1.7))
    for place, text, color in (
        ((0, 0.9), "select\nparents", GREEN),
        ((3.2, 0.9), "vary", GREEN),
        ((6.4, 0.9), "task:\nthe robot tries", GREEN),
        ((9.6, 0.9), "describe\nby the descriptor", GREEN),
        ((4.8, -1.1), "archive: who is new,\nor better than its like, stays", PURPLE),
        ((9.6, -2.7), "fit the descriptor\non all observations", ORANGE),
        ((4.8, -2.7), "new l; describe all,\nadd all again", ORANGE),
    ):
        _box(axes, place, text, color, width=3.5 if color == PURPLE else 2.5 if color == ORANGE else 2.1)
    _arrow(axes, (1.1, 0.9), (2.1, 0.9))
    _arrow(axes, (4.3, 0.9), (5.3, 0.9), "genotypes", (0, 0.62))
    _arrow(axes, (7.5, 0.9), (8.5, 0.9), "observations\nand fitness", (0, 0.72))
    _arrow(axes, (9.0, 0.45), (6.6, -0.95), "descriptors,\ntwo numbers each", (0.75, 0.0), align="left")
    _arrow(axes, (3.0, -0.95), (0.0, 0.45), "individuals,\nand their curiosity", (-0.55, -0.25), align="right")
    _arrow(axes, (6.6, -1.3), (9.2, -2.25), "all observations", (1.0, 0.18), ORANGE)
    _arrow(axes, (8.3, -2.7), (6.15, -2.7), color=ORANGE)
    _arrow(axes, (4.8, -2.25), (4.8, -1.55), color=ORANGE)
    axes.text(
        -1.2, -2.7, "green: every generation\norange: at generations\n0, 50, 150, 350, ...", fontsize=8, va="center", color=GREY
    )
    _save(figure, "loop.svg")


def rule():
    """How the archive decides, in the plane of descriptors: three cases."""
    figure, panels = plt.subplots(1, 3, figsize=(8.6, 3.2))
    stored = np.array([[-1.5, -0.4], [0.7, 0.8], [0.25, -1.15], [1.75, -0.25]])
    cases = (
        ("d1 > l: it is added", (-0.35, 0.15), [(-1.5, -0.4)], stored),
        ("d1 < l, d2 far: it competes\nwith its nearest", (0.95, 0.45), [(0.7, 0.8)], stored),
        (
            "d2 < (1 - ε) l: it is rejected,\nit would crowd two",
            (0.85, 0.0),
            [(0.7, 0.8), (1.35, -0.4)],
            np.vstack([stored[:3], [[1.35, -0.4]]]),
        ),
    )
    for axes, (title, new, nearest, others) in zip(panels, cases, strict=True):
        _plain(axes, (-2.3, 2.4), (-2, 1.8))
        axes.add_patch(Circle(new, 1.0, fc="#f3efe8", ec=GREY, ls="--", lw=1))
        axes.plot(*others.T, "o", color=PURPLE, ms=7)
        axes.plot(*new, "*", color=ORANGE, ms=14)
        for index, place in enumerate(nearest, 1):
            axes.plot([new[0], place[0]], [new[1], place[1]], color=GREY, lw=1)
            axes.text(*(0.35 * np.array(new) + 0.65 * np.array(place) + [0.12, 0.1]), f"d{index}", fontsize=8, color=GREY)
        axes.text(new[0], new[1] - 1.13, "l", color=GREY, ha="center", va="top")
        axes.set_title(title, fontsize=9)
    _save(figure, "rule.svg")


def bent():
    """A latent space that bends distances, and one that keeps them: the same behaviours, evenly spaced in each."""
    rng = np.random.default_rng(0)
    figure, panels = plt.subplots(1, 3, figsize=(8.6, 2.9))
    grid = np.stack(np.meshgrid(*[np.linspace(0.02, 0.98, 16)] * 2), axis=2).reshape(-1, 2)
    bend = lambda z: np.column_stack([z[:, 0] ** 3, z[:, 1] ** 2.2])  # noqa: E731
    for axes, points, title in (
        (panels[0], grid, "an archive spaces individuals\nevenly in descriptor space"),
        (panels[1], bend(grid), "their behaviours, if the\ndescriptor bends distances"),
        (panels[2], grid + rng.normal(0, 0.006, grid.shape), "their behaviours, if it\nkeeps distances"),
    ):
        axes.scatter(*points.T, s=9, c=two_dimensional_colors(grid))
        axes.set(xticks=[], yticks=[], aspect="equal", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
        axes.set_title(title, fontsize=9)
    _save(figure, "distances.svg")


def boat():
    """What the boat of the tutorial can do."""

    def sail(genotypes):
        rudder = (2 * genotypes - 1) * 0.6
        heading = np.cumsum(np.repeat(rudder, 10, axis=1), axis=1) * 0.5
        return np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=2), axis=1)

    aurora = auroraqd.Aurora(6, PCA(n_components=2), seed=0).run(sail, generations=1000)
    archive = aurora.archive
    colors = two_dimensional_colors(archive.descriptor)
    rows = np.random.default_rng(0).choice(len(archive), min(200, len(archive)), replace=False)
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(9, 3.1), layout="constrained")
    scatter(left, archive.descriptor, colors)
    left.set(title=f"descriptor of {len(archive):,} ways", xlabel="learned", ylabel="learned")
    scatter(middle, archive.observation[:, -1], colors)
    middle.set(title="where they end", xlabel="x, m", ylabel="y, m")
    trajectories(right, archive.observation[rows], colors[rows])
    right.set(title="200 of them", xlabel="x, m", ylabel="y, m")
    _save(figure, "boat.png")


def pixels():
    """What is learned from images of a disc."""

    def camera(genotypes):
        push = 2 * genotypes - 1
        place = np.stack([push[:, 0] * np.abs(push[:, 2]), push[:, 1] * np.abs(push[:, 2])], axis=1)
        rows, columns = np.mgrid[:32, :32] / 15.5 - 1
        distance = np.hypot(columns - place[:, :1, None], rows - place[:, 1:, None])
        return np.zeros(len(genotypes)), (255 * (distance < 0.2)).astype(np.uint8)[..., None], place

    encoder = auroraqd.AutoEncoder(n_components=2)
    aurora = auroraqd.Aurora(3, encoder, batch_size=100, resolution=auroraqd.VAT(cells=2000), seed=0)
    archive = aurora.run(camera, generations=80).archive
    print(len(archive), "stored, coverage of 10 x 10:", auroraqd.metrics.coverage(archive.ground_truth, bins=10))
    colors = two_dimensional_colors(archive.ground_truth)
    figure = plt.figure(figsize=(9, 3.1), layout="constrained")
    left, middle, images = figure.subplots(1, 3)
    scatter(left, archive.descriptor, colors)
    left.set(title=f"descriptor of {len(archive)} images", xlabel="learned", ylabel="learned")
    scatter(middle, archive.ground_truth, colors)
    middle.set(title="true places", xlabel="x", ylabel="y")
    rows = np.random.default_rng(1).choice(len(archive), 6, replace=False)
    seen = archive.observation[rows, :, :, 0].reshape(2, 3, 32, 32)
    seen = np.pad(seen, ((0, 0), (0, 0), (1, 1), (1, 1)), constant_values=120)
    images.imshow(seen.transpose(0, 2, 1, 3).reshape(68, 102), cmap="gray", interpolation="nearest")
    images.set(title="six of them", xticks=[], yticks=[])
    _save(figure, "pixels.png")


def ant_camera():
    """Ants, as a task with a camera gives them."""
    camera = auroraqd.tasks.Camera(frames=2, distance=8)
    task = auroraqd.tasks.Gym("Ant-v5", steps=40, samples=4, observe=camera)
    pictures = task(np.random.default_rng(3).random((4, task.n_genes))).observation
    figure, axes = plt.subplots(2, 4, figsize=(6.4, 3.4))
    for column, picture in enumerate(pictures):
        for row, when in enumerate(("half-way", "at the end")):
            axes[row, column].imshow(picture[..., 3 * row : 3 * row + 3], interpolation="nearest")
            axes[row, column].set(xticks=[], yticks=[], ylabel="" if column else when)
    figure.tight_layout(pad=0.4)
    _save(figure, "ant_camera.png")


if __name__ == "__main__":
    known = {function.__name__: function for function in (loop, rule, bent, boat, pixels, ant_camera)}
    for name in sys.argv[1:] or known:
        known[name]()
