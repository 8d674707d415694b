"""The sphere benchmark of pyribs' examples, by pyribs and by auroraqd in one run: `python benchmarks/sphere.py`.

    pip install "auroraqd[ribs]"

As `examples/sphere.py` of pyribs has it: 100 unbounded parameters, 10,000 iterations of 540 solutions, a grid of 100 x 100, and
MAP-Elites with Gaussian steps, with iso+line steps, and CMA-ME with 15 improvement emitters of 36. The first solutions are
drawn around 0. The genes of auroraqd are in [0, 1]; here they span 1,000 units, from -500 to 500, and how far from 0 any
solution came is written down, so that it can be seen that nothing met a bound.

pyribs ranks the solutions of CMA-ME by how much each improves on the elite of its cell; `emitters.Ribs` tells it the fitness
instead. `Team` tells what pyribs would. What that makes of a run is tried in the first 300 iterations, both ways round:
`Ribs` alone, and pyribs itself told the fitness.
"""

import argparse
import csv
import io
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import auroraqd
from auroraqd._files import read_table, replacing
from auroraqd.emitters import Ribs
from auroraqd.metrics import grid_of
from auroraqd.report.style import STYLE

DIMENSIONS, BOUND = 100, 5.12
CELLS, REACH = 100, BOUND * DIMENSIONS / 2  # of the grid, along each side; half its width
BATCH, EMITTERS = 540, 15
SIGMA, LINE = 0.5, 0.2
ITERATIONS, EXPLAINED = 10_000, 300  # of a run; of those that show what the told value does
SPAN = 1_000.0  # units of a parameter that the genes span
LOOKS = (100, 300, 1_000, 3_000)  # iterations, beside the last
CMA, FITNESS = "CMA-ME", "CMA-ME, told the fitness"
KINDS = ("Gaussian", "iso+line", CMA)
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


class Team:
    """Emitters of pyribs as one.

    Args:
        archive: what they read, of auroraqd.
        emitters: of equal batches.
        grid: cells of the measures: then they are told by how much a solution improves on the elite that its cell had when
            they were asked; None: whatever they are told.
    """

    def __init__(self, archive: Any, emitters: list[Any], grid: auroraqd.GridArchive | None = None) -> None:
        self._archive, self._emitters, self._grid = archive, emitters, grid

    def ask(self) -> np.ndarray:
        """The solutions of all, (n, d)."""
        if self._grid is not None:
            stored = self._archive.data()
            self._elite = np.zeros(self._grid.n_cells)  # an empty one counts 0, as in pyribs
            self._elite[self._grid.cell_of(stored["measures"])] = stored["objective"]
        return np.concatenate([emitter.ask() for emitter in self._emitters])

    def tell(self, solution: np.ndarray, objective: np.ndarray, measures: np.ndarray, add_info: dict[str, np.ndarray]) -> None:
        """What became of them, each its own."""
        value = add_info["value"]
        if self._grid is not None:
            value = objective - self._elite[self._grid.cell_of(measures)]
        parts = (np.split(rows, len(self._emitters)) for rows in (solution, objective, measures, add_info["status"], value))
        for emitter, x, f, m, status, v in zip(self._emitters, *parts, strict=True):
            emitter.tell(x, f, m, {"status": status, "value": v})


def strategies(archive: Any, x0: np.ndarray, sigma: float, seed: int) -> list[Any]:
    """The improvement emitters of CMA-ME."""
    from ribs.emitters import EvolutionStrategyEmitter

    options = {"sigma0": sigma, "ranker": "2imp", "selection_rule": "filter", "restart_rule": "no_improvement"}
    seeds = np.random.SeedSequence(seed).spawn(EMITTERS)
    return [EvolutionStrategyEmitter(archive, x0=x0, **options, batch_size=BATCH // EMITTERS, seed=s) for s in seeds]


def theirs(kind: str, seed: int) -> Iterator[tuple[float, float, float]]:
    """Coverage, QD-score and the farthest parameter of pyribs after each iteration."""
    from ribs.archives import GridArchive
    from ribs.emitters import GaussianEmitter, IsoLineEmitter

    archive = GridArchive(solution_dim=DIMENSIONS, dims=(CELLS, CELLS), ranges=[(-REACH, REACH)] * 2, seed=seed)
    x0 = np.zeros(DIMENSIONS)
    if kind == "Gaussian":
        team = Team(archive, [GaussianEmitter(archive, sigma=SIGMA, x0=x0, batch_size=BATCH, seed=seed)])
    elif kind == "iso+line":
        options = {"iso_sigma": SIGMA, "line_sigma": LINE, "batch_size": BATCH, "seed": seed}
        team = Team(archive, [IsoLineEmitter(archive, x0=x0, **options)])
    else:
        team = Team(archive, strategies(archive, x0, SIGMA, seed))
    farthest = 0.0
    while True:
        solutions = team.ask()
        objective, measures = sphere(solutions)
        info = archive.add(solutions, objective, measures)
        told = {"status": info["status"], "value": objective if kind == FITNESS else info["value"]}
        team.tell(solutions, objective, measures, told)
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

    def make(archive: Any, n_genes: int, seed: int) -> Team:
        grid = grid_of(CELLS, -REACH, REACH, 2) if kind == CMA else None
        return Team(archive, strategies(archive, np.full(n_genes, 0.5), SIGMA / SPAN, seed), grid)

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


def sphere_runs(path: Path, seeds: int, iterations: int = ITERATIONS, explained: int = EXPLAINED) -> list[Found]:
    """All runs, the short ones first; those that are in the file are not done again, and each is added to it."""
    found = {row[:4]: row for row in (read_table(path, Found) if path.is_file() else [])}
    jobs = [(kind, seed, explained) for seed in range(seeds) for kind in (CMA, FITNESS)]
    jobs += [(kind, seed, iterations) for seed in range(seeds) for kind in KINDS]
    for kind, seed, length in jobs:
        for library in LIBRARIES:
            if (library, kind, seed, length) not in found:
                with threadpool_limits(1):
                    found |= {row[:4]: row for row in followed(library, kind, seed, length)}
                print(found[library, kind, seed, length], flush=True)
                _write(path, sorted(found.values()))
    return list(found.values())


def _write(path: Path, found: Iterable[Found]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(Found._fields)
    table.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in row] for row in found)
    with replacing(path) as file:
        file.write(text.getvalue().encode())


def sphere_table(found: list[Found]) -> str:
    """A line an emitter and number of iterations: medians over seeds, smallest and largest in brackets."""
    last, explained = max(row.iteration for row in found), max(row.iteration for row in found if row.emitter == FITNESS)
    lines = [
        "| emitter | iterations | seeds | coverage, pyribs | auroraqd | QD-score, pyribs | auroraqd | CPU s, pyribs | ours |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, iteration in [*((kind, last) for kind in KINDS), (CMA, explained), (FITNESS, explained)]:
        rows = [[r for r in found if r[:2] == (library, kind) and r.iteration == iteration] for library in LIBRARIES]
        cells = [
            _range(form, [getattr(row, name) for row in of_one])
            for name, form in (("coverage", "{:.3f}"), ("qd_score", "{:,.0f}"), ("seconds", "{:.0f}"))
            for of_one in rows
        ]
        lines.append(f"| {kind} | {iteration:,} | {min(map(len, rows))} | {' | '.join(cells)} |")
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
        for axes, kind in zip(figure.subplots(1, len(KINDS) + 1, sharey=True), (*KINDS, FITNESS), strict=True):
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
    parser.add_argument("--out", type=Path, default=Path("results/sphere"))
    options = parser.parse_args()
    print(sphere_table(sphere_runs(options.out / "sphere.csv", options.seeds)))


if __name__ == "__main__":
    main()
