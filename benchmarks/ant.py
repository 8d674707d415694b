"""How much of the floor Ant learns to reach: AURORA, a hand-coded descriptor, and random controllers, on the same budget.

    pip install ".[robots]"
    python benchmarks/ant.py --seeds 5 --out results/ant

Ant-v5 of Gymnasium, moved for five seconds by sinusoids. AURORA sees where the torso is at twenty moments and learns two
numbers from that by PCA; the hand-coded descriptor is where it ends. The area covered is that of the squares, half a metre
wide, in which an individual of the archive ends; of random controllers, all that were evaluated count. Runs that are in the
folder are not done again.
"""

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import ranksums
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import STYLE, save_figure, scatter, two_dimensional_colors

SIDE = 0.5  # m, of a square
BATCH = 50
RANDOM = "random controllers"
VARIANTS = {"AURORA-PCA": PCA(n_components=2), "hand-coded": "hand-coded", RANDOM: "hand-coded"}
COLORS = {"AURORA-PCA": "#2646a0", "hand-coded": "#c0392b", RANDOM: "#7f7f7f"}


class Point(NamedTuple):
    """One generation of one run."""

    variant: str
    seed: int
    evaluations: int
    area: float  # m^2
    size: int  # individuals stored


def ant():
    return auroraqd.tasks.Gym("Ant-v5", steps=100, samples=20, threads=1)


def area(places: np.ndarray) -> float:
    """Square metres covered by places, (n, 2)."""
    return len(np.unique(np.floor(places / SIDE), axis=0)) * SIDE**2


def random_places(task, seed: int, generations: int) -> Iterator[np.ndarray]:
    """Where the random controllers end, generation by generation."""
    rng = np.random.default_rng(seed)
    for _ in range(generations):
        ends = task(rng.random((BATCH, task.n_genes))).ground_truth
        yield ends[np.isfinite(ends).all(axis=1)]


def one_run(variant: str, seed: int, generations: int, folder: Path) -> list[Point]:
    """One run of a variant; where its individuals end is kept in the folder."""
    task, points = ant(), []
    if variant == RANDOM:
        ends = np.empty((0, 2))
        for generation, more in enumerate(random_places(task, seed, generations), start=1):
            ends = np.concatenate([ends, more])
            points.append(Point(variant, seed, generation * BATCH, area(ends), len(ends)))
    else:
        aurora = auroraqd.Aurora(
            task.n_genes,
            VARIANTS[variant],
            seed=seed,
            batch_size=BATCH,
            resolution=auroraqd.VAT(cells=4_000),
            schedule=auroraqd.Doubling(10),
        )

        def after_each(aurora):
            ends = aurora.archive.ground_truth
            points.append(Point(variant, seed, aurora.evaluations, area(ends), len(ends)))

        aurora.run(task, generations=generations, callback=after_each)
        auroraqd.save(aurora, folder / f"{variant}-{seed}")
        ends = aurora.archive.ground_truth
    np.save(folder / f"{variant}-{seed}.npy", ends)
    return points


def read(path: Path) -> list[Point]:
    """The points of a table."""
    with path.open(newline="") as file:
        return [
            Point(p["variant"], int(p["seed"]), int(p["evaluations"]), float(p["area"]), int(p["size"]))
            for p in csv.DictReader(file)
        ]


def write(path: Path, points: list[Point]) -> None:
    """Write a table."""
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(Point._fields)
        table.writerows(points)


def figure_of(points: list[Point], ends: dict[str, np.ndarray]) -> Figure:
    """Area over evaluations, medians and ranges; then where the individuals of the first seed end."""
    reach = max(np.abs(places).max() for places in ends.values())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.0 * (1 + len(ends)), 4.0), layout="constrained")
        first, *others = figure.subplots(1, 1 + len(ends))
        for variant in ends:
            curves = curves_of(points, variant)
            evaluations = sorted({p.evaluations for p in points if p.variant == variant})
            first.fill_between(
                evaluations, curves.min(axis=0), curves.max(axis=0), color=COLORS[variant], alpha=0.2, linewidth=0
            )
            first.plot(evaluations, np.median(curves, axis=0), color=COLORS[variant], label=variant)
        first.set(xlabel="evaluations", title="Area covered by final positions, m²", xlim=(0, None), ylim=(0, None))
        first.legend(frameon=False)
        for axes, (variant, places) in zip(others, ends.items(), strict=True):
            scatter(axes, places, two_dimensional_colors(places))
            axes.set(title=f"{variant}: {len(places):,} end here", xlabel="x, m", ylabel="y, m", aspect="equal")
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    return figure


def curves_of(points: list[Point], variant: str) -> np.ndarray:
    """(seeds, generations), area."""
    seeds = sorted({p.seed for p in points if p.variant == variant})
    return np.array([[p.area for p in points if p.variant == variant and p.seed == seed] for seed in seeds])


def report(points: list[Point]) -> None:
    """Print the areas at the end, and rank-sum tests against AURORA."""
    print("| | area m², median | smallest | largest | individuals | rank-sum p, beside AURORA |\n|---|---|---|---|---|---|")
    ours = curves_of(points, "AURORA-PCA")[:, -1]
    for variant in VARIANTS:
        final = curves_of(points, variant)[:, -1]
        sizes = [p.size for p in points if p.variant == variant and p.evaluations == max(q.evaluations for q in points)]
        p_value = "" if variant == "AURORA-PCA" else f"{ranksums(ours, final).pvalue:.3f}"
        areas = " | ".join(f"{area:.1f}" for area in (np.median(final), final.min(), final.max()))
        print(f"| {variant} | {areas} | {np.median(sizes):,.0f} | {p_value} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--generations", type=int, default=100, help=f"of {BATCH} evaluations")
    parser.add_argument("--out", type=Path, default=Path("results/ant"))
    options = parser.parse_args()
    runs, table = options.out / "runs", options.out / "areas.csv"
    runs.mkdir(parents=True, exist_ok=True)
    points = read(table) if table.exists() else []
    for seed in range(options.seeds):
        for variant in VARIANTS:
            if not any((p.variant, p.seed) == (variant, seed) for p in points):
                points += one_run(variant, seed, options.generations, runs)
                write(table, points)
                print(f"{variant}, seed {seed}: {points[-1].area:.1f} m²", flush=True)
    report(points)
    save_figure(figure_of(points, {variant: np.load(runs / f"{variant}-0.npy") for variant in VARIANTS}), options.out, "ant")


if __name__ == "__main__":
    main()
