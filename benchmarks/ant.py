"""How much of the floor Ant learns to reach: AURORA, a hand-coded descriptor, and random controllers, on the same budget.

    pip install ".[robots]"
    python benchmarks/ant.py --seeds 5 --out results/ant
    python benchmarks/ant.py --quick    # to see it work: seconds; no conclusions can be drawn

Ant-v5 of Gymnasium, moved for five seconds by sinusoids. AURORA sees where the torso is at twenty moments and learns two
numbers from that by PCA; the hand-coded descriptor is where it ends. The area covered is that of the squares, half a metre
wide, in which an individual of the archive ends; of random controllers, all that were evaluated count. Runs that are in the
folder are not done again.
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import ranksums
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import STYLE, save_figure, scatter, two_dimensional_colors

BATCH = 50
AURORA, HAND_CODED, RANDOM = "AURORA-PCA", "hand-coded", "random controllers"
COLORS = {AURORA: "#2646a0", HAND_CODED: "#c0392b", RANDOM: "#7f7f7f"}


class Measure(NamedTuple):
    """A number that says how much was found.

    Attributes:
        title: of its curves.
        of: from an archive, or an evaluation.
    """

    title: str
    of: Callable[[Any], float]


class Comparison(NamedTuple):
    """What is compared on a robot.

    Attributes:
        task: its evaluations; the ground truth is where it ends, (n, 2) or (n, 3), the hand-coded descriptor.
        n_genes: of its controller.
        learned: the descriptor of AURORA.
        options: of both that have an archive.
        measures: by name.
    """

    task: Callable[[np.ndarray], auroraqd.tasks.Evaluation]
    n_genes: int
    learned: Any
    options: dict[str, Any]
    measures: dict[str, Measure]


class Point(NamedTuple):
    """One generation of one run."""

    variant: str
    seed: int
    evaluations: int
    found: dict[str, float]  # by measure, and the size: individuals stored, of random controllers all


def ant() -> Comparison:
    """Ant, five seconds, where its torso is at twenty moments."""
    task = auroraqd.tasks.Gym("Ant-v5", steps=100, samples=20, threads=1)
    area = Measure("Area covered by final positions, m²", lambda found: area_of(found.ground_truth, side=0.5))
    options = {"resolution": auroraqd.VAT(cells=4_000), "schedule": auroraqd.Doubling(10)}
    return Comparison(task, task.n_genes, PCA(n_components=2), options, {"area": area})


def area_of(places: np.ndarray, side: float) -> float:
    """Square metres covered by places, (n, 2), in squares of a side in metres."""
    return len(np.unique(np.floor(places / side), axis=0)) * side**2


def point_of(robot: Comparison, variant: str, seed: int, evaluations: int, found: Any) -> Point:
    """All measures of an archive, or of evaluations."""
    values = {name: float(measure.of(found)) for name, measure in robot.measures.items()}
    return Point(variant, seed, evaluations, {**values, "size": len(found.ground_truth)})


def at_random(robot: Comparison, seed: int, generations: int, batch: int) -> tuple[list[Point], Any]:
    """Random controllers: the points, and the evaluations of all that are valid."""
    rng, points, found = np.random.default_rng(seed), [], None
    for generation in range(1, generations + 1):
        more = robot.task(rng.random((batch, robot.n_genes)))
        valid = np.isfinite(more.fitness)
        more = auroraqd.tasks.Evaluation(*(column[valid] for column in more))
        found = more if found is None else auroraqd.tasks.Evaluation(*map(np.concatenate, zip(found, more, strict=True)))
        points.append(point_of(robot, RANDOM, seed, generation * batch, found))
    return points, found


def one_run(robot: Comparison, variant: str, seed: int, generations: int, batch: int, folder: Path) -> list[Point]:
    """One run of a variant; where its individuals end is kept in the folder."""
    if variant == RANDOM:
        points, found = at_random(robot, seed, generations, batch)
        ends = found.ground_truth
    else:
        points = []
        aurora = auroraqd.Aurora(
            robot.n_genes,
            robot.learned if variant == AURORA else "hand-coded",
            seed=seed,
            batch_size=batch,
            **robot.options,
        )

        def after_each(aurora):
            points.append(point_of(robot, variant, seed, aurora.evaluations, aurora.archive))

        aurora.run(robot.task, generations=generations, callback=after_each)
        auroraqd.save(aurora, folder / f"{variant}-{seed}")
        ends = aurora.archive.ground_truth
    np.save(folder / f"{variant}-{seed}.npy", ends)
    return points


def read(path: Path) -> list[Point]:
    """The points of a table."""
    with path.open(newline="") as file:
        rows = [(row.pop("variant"), int(row.pop("seed")), int(row.pop("evaluations")), row) for row in csv.DictReader(file)]
    return [Point(*run, {name: float(value) for name, value in found.items()}) for *run, found in rows]


def write(path: Path, points: list[Point]) -> None:
    """Write a table."""
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow([*Point._fields[:-1], *points[0].found])
        table.writerows([*run, *found.values()] for *run, found in points)


def figure_of(points: list[Point], ends: dict[str, np.ndarray], measures: dict[str, Measure]) -> Figure:
    """Each measure over evaluations, medians and ranges; then where the individuals of the first seed end."""
    ends = {variant: places[:, :2] for variant, places in ends.items()}  # from above
    reach = max(np.abs(places).max() for places in ends.values())
    apart = len(measures) > 1  # in a row of their own
    columns = len(ends) if apart else len(measures) + len(ends)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.0 * columns, 8.0 if apart else 4.0), layout="constrained")
        panels = list(figure.subplots(1 + apart, columns).flat)
        for name, measure in measures.items():
            axes = panels.pop(0)
            draw_curves(axes, points, list(ends), name)
            axes.set(xlabel="evaluations", title=measure.title, xlim=(0, None), ylim=(0, None))
        axes.legend(frameon=False)
        while len(panels) > len(ends):
            panels.pop(0).set_axis_off()
        for axes, (variant, places) in zip(panels, ends.items(), strict=True):
            scatter(axes, places, two_dimensional_colors(places))
            axes.set(title=f"{variant}: {len(places):,} end here", xlabel="x, m", ylabel="y, m", aspect="equal")
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    return figure


def draw_curves(axes: Any, points: list[Point], variants: list[str], measure: str) -> None:
    """Medians of a measure, and ranges."""
    for variant in variants:
        curves = curves_of(points, variant, measure)
        evaluations = sorted({p.evaluations for p in points if p.variant == variant})
        color = COLORS[variant]
        axes.fill_between(evaluations, curves.min(axis=0), curves.max(axis=0), color=color, alpha=0.2, linewidth=0)
        axes.plot(evaluations, np.median(curves, axis=0), color=color, label=variant)


def curves_of(points: list[Point], variant: str, measure: str) -> np.ndarray:
    """(seeds, generations)."""
    seeds = sorted({p.seed for p in points if p.variant == variant})
    return np.array([[p.found[measure] for p in points if p.variant == variant and p.seed == seed] for seed in seeds])


def report(points: list[Point], measures: dict[str, Measure]) -> None:
    """Print what is found at the end, and rank-sum tests against AURORA."""
    for name, measure in measures.items():
        print(f"\n### {measure.title}\n")
        print(f"| | {name}, median | smallest | largest | individuals | rank-sum p, beside AURORA |\n|---|---|---|---|---|---|")
        ours = curves_of(points, AURORA, name)[:, -1]
        for variant in COLORS:
            final, sizes = curves_of(points, variant, name)[:, -1], curves_of(points, variant, "size")[:, -1]
            p_value = "" if variant == AURORA else f"{ranksums(ours, final).pvalue:.3f}"
            values = " | ".join(f"{value:.1f}" for value in (np.median(final), final.min(), final.max()))
            print(f"| {variant} | {values} | {np.median(sizes):,.0f} | {p_value} |")


def compare(robot: Comparison, table: Path, seeds: int, generations: int, batch: int) -> None:
    """All variants that are not in the table yet, and then what came out, with a figure of the table's name."""
    runs = table.parent / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    points = read(table) if table.exists() else []
    for seed in range(seeds):
        for variant in COLORS:
            if not any((p.variant, p.seed) == (variant, seed) for p in points):
                points += one_run(robot, variant, seed, generations, batch, runs)
                write(table, points)
                print(f"{variant}, seed {seed}: {points[-1].found}", flush=True)
    report(points, robot.measures)
    ends = {variant: np.load(runs / f"{variant}-0.npy") for variant in COLORS}
    save_figure(figure_of(points, ends, robot.measures), table.parent, table.parent.name)


def options_of(description: str, seeds: int, generations: int, out: str) -> argparse.Namespace:
    """Of the command line."""
    parser = argparse.ArgumentParser(description=description.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=seeds)
    parser.add_argument("--generations", type=int, default=generations, help=f"of {BATCH} evaluations")
    parser.add_argument("--out", type=Path, default=Path(out))
    parser.add_argument("--quick", action="store_true", help="one seed, two generations of ten, into OUT/quick")
    options = parser.parse_args()
    options.batch = BATCH
    if options.quick:
        options.seeds, options.generations, options.batch, options.out = 1, 2, 10, options.out / "quick"
    return options


def main() -> None:
    options = options_of(str(__doc__), 5, 100, "results/ant")
    compare(ant(), options.out / "areas.csv", options.seeds, options.generations, options.batch)


if __name__ == "__main__":
    main()
