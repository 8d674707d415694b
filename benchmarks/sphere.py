"""The sphere benchmark of pyribs' examples, by pyribs and by auroraqd in one run: `python benchmarks/sphere.py`.

    pip install "auroraqd[ribs]"
    python benchmarks/sphere.py            # half an hour of one core; into results/sphere
    python benchmarks/sphere.py --quick    # to see it work: seconds; no conclusions can be drawn

As `examples/sphere.py` of pyribs has it: 100 unbounded parameters, 10,000 iterations of 540 solutions, a grid of 100 x 100, and
MAP-Elites with Gaussian steps, with iso+line steps, and CMA-ME with 15 improvement emitters of 36. The first solutions are
drawn around 0. The scheduler of pyribs judges a batch by what was stored before it, unless it is told to add one by one, as
auroraqd does; an evolution strategy learns from that judgement, so pyribs runs CMA-ME both ways. The genes of auroraqd are in
[0, 1]; here they span 1,000 units, from -500 to 500, and how far from 0 any solution came is written down, so that it can be
seen that nothing met a bound.
"""

import argparse
import csv
import io
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import auroraqd
from auroraqd._files import read_table, replacing
from auroraqd.emitters import Ribs
from auroraqd.report.style import STYLE

DIMENSIONS, BOUND = 100, 5.12
CELLS, REACH = 100, BOUND * DIMENSIONS / 2  # of the grid, along each side; half its width
BATCH, EMITTERS = 540, 15
SIGMA, LINE = 0.5, 0.2
ITERATIONS = 10_000
SPAN = 1_000.0  # units of a parameter that the genes span
LOOKS = (100, 300, 1_000, 3_000)  # iterations, beside the last
BY_BATCH = "CMA-ME, by the batch"
KINDS = ("Gaussian", "iso+line", "CMA-ME", BY_BATCH)
THEIRS, OURS = "pyribs", "auroraqd"


def sphere(solutions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Objective, (n,), at most 100 at 0.4 of the bound; and measures, (n, 2): sums of halves, bent back outside the bound."""
    best = 0.4 * BOUND
    worst = (BOUND + best) ** 2 * solutions.shape[1]
    objective = 100 * (1 - ((solutions - best) ** 2).sum(axis=1) / worst)
    far = np.abs(solutions) > BOUND
    bent = np.where(far, BOUND / np.where(far, solutions, 1), solutions)
    return objective, bent.reshape(len(solutions), 2, -1).sum(axis=2)


class Found(NamedTuple):
    """A run after some iterations."""

    library: str
    emitter: str
    seed: int
    iteration: int
    coverage: float
    qd_score: float
    farthest: float  # from 0 that any parameter came
    seconds: float  # of one core


def strategy(archive: Any, x0: np.ndarray, sigma: float, seed: Any) -> Any:
    """One of the improvement emitters of CMA-ME."""
    from ribs.emitters import EvolutionStrategyEmitter

    options = {"sigma0": sigma, "ranker": "2imp", "selection_rule": "filter", "restart_rule": "no_improvement"}
    return EvolutionStrategyEmitter(archive, x0=x0, **options, batch_size=BATCH // EMITTERS, seed=seed)


def theirs(kind: str, seed: int) -> Iterator[tuple[float, float, float]]:
    """Coverage, QD-score and the farthest parameter of pyribs after each iteration."""
    from ribs.archives import GridArchive
    from ribs.emitters import GaussianEmitter, IsoLineEmitter
    from ribs.schedulers import Scheduler

    archive = GridArchive(solution_dim=DIMENSIONS, dims=(CELLS, CELLS), ranges=[(-REACH, REACH)] * 2, seed=seed)
    x0 = np.zeros(DIMENSIONS)
    if kind == "Gaussian":
        team = [GaussianEmitter(archive, sigma=SIGMA, x0=x0, batch_size=BATCH, seed=seed)]
    elif kind == "iso+line":
        options = {"iso_sigma": SIGMA, "line_sigma": LINE, "batch_size": BATCH, "seed": seed}
        team = [IsoLineEmitter(archive, x0=x0, **options)]
    else:
        team = [strategy(archive, x0, SIGMA, one) for one in np.random.SeedSequence(seed).spawn(EMITTERS)]
    scheduler = Scheduler(archive, team, add_mode="single" if kind == "CMA-ME" else "batch")
    farthest = 0.0
    while True:
        solutions = scheduler.ask()
        scheduler.tell(*sphere(solutions))
        farthest = max(farthest, float(np.abs(solutions).max()))
        yield float(archive.stats.coverage), float(archive.stats.qd_score), farthest


def ours(kind: str, seed: int) -> Iterator[tuple[float, float, float]]:
    """The same of auroraqd."""
    farthest = 0.0

    def task(genotypes: np.ndarray) -> auroraqd.Evaluation:
        nonlocal farthest
        solutions = SPAN * (genotypes - 0.5)
        farthest = max(farthest, float(np.abs(solutions).max()))
        objective, measures = sphere(solutions)
        return auroraqd.Evaluation(objective, measures, measures)

    def make(archive: Any, n_genes: int, seed: int) -> Any:
        return strategy(archive, np.full(n_genes, 0.5), SIGMA / SPAN, seed)

    options: dict[str, Any] = {"emitter": Ribs(make)}
    if kind in ("Gaussian", "iso+line"):
        gaussian, iso_line = auroraqd.Gaussian(rate=1, sigma=SIGMA / SPAN), auroraqd.IsoLine(SIGMA / SPAN, LINE)
        options = {"selection": auroraqd.Uniform(), "variation": gaussian if kind == "Gaussian" else iso_line}
    archive = auroraqd.GridArchive((CELLS, CELLS), low=-REACH, high=REACH)
    options |= {"archive": archive, "resolution": None, "schedule": auroraqd.Never()}
    aurora = auroraqd.Aurora(DIMENSIONS, "hand-coded", seed=seed, batch_size=BATCH, **options)
    first = np.random.default_rng(seed).normal(0.5, SIGMA / SPAN, (BATCH, DIMENSIONS))
    aurora.tell(*task(aurora.ask(first)))
    while True:
        yield len(archive) / archive.n_cells, float(archive.fitness.sum()), farthest
        aurora.tell(*task(aurora.ask()))


LIBRARIES: dict[str, Callable[[str, int], Iterator[tuple[float, float, float]]]] = {THEIRS: theirs, OURS: ours}


def followed(library: str, kind: str, seed: int, iterations: int) -> list[Found]:
    """A run, looked at now and then and at the end."""
    since, found = time.process_time(), []
    for iteration, values in zip(range(1, iterations + 1), LIBRARIES[library](kind, seed), strict=False):
        if iteration in (*LOOKS, iterations):
            found.append(Found(library, kind, seed, iteration, *values, time.process_time() - since))
    return found


def sphere_runs(path: Path, seeds: int, iterations: int = ITERATIONS) -> list[Found]:
    """All runs; those that are in the file are not done again, and each is added to it."""
    found = {row[:4]: row for row in (read_table(path, Found) if path.is_file() else [])}
    for seed, kind, library in itertools.product(range(seeds), KINDS, LIBRARIES):
        if (library, kind) == (OURS, BY_BATCH):
            continue
        if (library, kind, seed, iterations) not in found:
            with threadpool_limits(1):
                found |= {row[:4]: row for row in followed(library, kind, seed, iterations)}
            print(found[library, kind, seed, iterations], flush=True)
            write_rows(path, Found, sorted(found.values()))
    return list(found.values())


def write_rows(path: Path, kind: type[Any], found: Iterable[Sequence[Any]]) -> None:
    """A table of named tuples of a kind, as `read_table` reads it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(kind._fields)
    table.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in row] for row in found)
    with replacing(path) as file:
        file.write(text.getvalue().encode())


def sphere_table(found: list[Found]) -> str:
    """A line an emitter and number of iterations: medians over seeds, smallest and largest in brackets."""
    last = max(row.iteration for row in found)
    lines = [
        "| emitter | iterations | seeds | coverage, pyribs | auroraqd | QD-score, pyribs | auroraqd | CPU s, pyribs | ours |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, iteration in itertools.product(KINDS, sorted({1_000, last})):
        rows = [[r for r in found if r[:2] == (library, kind) and r.iteration == iteration] for library in LIBRARIES]
        if not any(rows):
            continue
        cells = [
            _range(form, [getattr(row, name) for row in of_one])
            for name, form in (("coverage", "{:.3f}"), ("qd_score", "{:,.0f}"), ("seconds", "{:.0f}"))
            for of_one in rows
        ]
        lines.append(f"| {kind} | {iteration:,} | {max(map(len, rows))} | {' | '.join(cells)} |")
    farthest = max(row.farthest for row in found)
    return "\n".join(lines) + f"\n\nNo parameter came farther from 0 than {farthest:.0f}; genes end at {SPAN / 2:.0f}.\n"


def _range(form: str, values: list[float]) -> str:
    if not values:
        return ""
    middle, least, most = (form.format(v) for v in (np.median(values), min(values), max(values)))
    return f"{middle} ({least}, {most})"


def sphere_figure(found: list[Found]) -> Figure:
    """Coverage and QD-score over iterations; a line a run."""
    styles = {THEIRS: ("#2646a0", "-"), OURS: ("#c8287a", "--")}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 3.6), layout="constrained")
        for axes, kind in zip(figure.subplots(1, len(KINDS), sharey=True), KINDS, strict=True):
            for library, (color, line) in styles.items():
                for seed in sorted({row.seed for row in found}):
                    run = sorted((r.iteration, r.coverage) for r in found if r[:3] == (library, kind, seed))
                    label = library if seed == 0 else None
                    axes.plot(*np.array(run).reshape(-1, 2).T, line, color=color, marker=".", label=label)
            axes.set(title=kind, xlabel="iteration", xscale="log", xlim=(80, 13_000), ylim=(0, 1))
        figure.axes[0].set(ylabel="coverage")
        figure.axes[0].legend(frameon=False)
        return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--iterations", type=int, default=ITERATIONS)
    parser.add_argument("--out", type=Path, default=Path("results/sphere"))
    parser.add_argument("--quick", action="store_true", help="one seed, three iterations, into OUT/quick")
    options = parser.parse_args()
    if options.quick:
        options.seeds, options.iterations, options.out = 1, 3, options.out / "quick"
    print(sphere_table(sphere_runs(options.out / "sphere.csv", options.seeds, options.iterations)))


if __name__ == "__main__":
    main()
