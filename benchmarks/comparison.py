"""All algorithms of docs/reference/algorithms.md beside each other: the tables and figures of docs/comparison.md.

    pip install "auroraqd[ribs]"
    python benchmarks/comparison.py              # hours of one core; into runs/comparison
    python benchmarks/comparison.py --quick      # to see it work: seconds; no conclusions can be drawn
    python benchmarks/comparison.py --out results --page docs/comparison.md     # what that page shows, from what is in results

On the ballistic task and on air hockey, each algorithm with the library's defaults, but that those that take a number of
individuals to store take the same; then how the number that `CSC` stores comes to its target; then pyribs' sphere benchmark
(`sphere.py`, which runs alone too). Runs that are done are skipped, so it can be interrupted and called again.

Evaluations a second are measured apart from the repertoires: all algorithms in turn in one process, in its CPU seconds, so
that they compare whatever else the machine does.
"""

import argparse
import itertools
import shutil
import time
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from rich.console import Console
from scipy.stats import spearmanr
from sphere import ITERATIONS, Found, sphere_figure, sphere_runs, sphere_table, write_rows
from threadpoolctl import threadpool_limits

from auroraqd import emitters, metrics
from auroraqd._files import folder_at, read_table
from auroraqd._workers import cores
from auroraqd.control.resolution import CSC, Size
from auroraqd.emitters.ribs import CMA
from auroraqd.emitters.selection import Mixed, Novelty, Surprise, Uniform
from auroraqd.experiments.duration import TimeLeft
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.measures import Coverage, Own
from auroraqd.experiments.progress import ExperimentProgress
from auroraqd.experiments.runner import execute, plan
from auroraqd.experiments.settings import Dominated, Grid, Settings
from auroraqd.experiments.statistics import Quartiles, rank_sums
from auroraqd.experiments.variants import AIR_HOCKEY, BALLISTIC, Experiment, Variant, diversity
from auroraqd.report.style import STYLE, save_figure

STORED = 5_000  # individuals, of those that take a number
TARGETS = (1_000, 5_000, 10_000)  # of CSC
AURORA = "aurora"
PATH = "path"
SPHERE = Path("sphere", "sphere.csv")
SPEED = "speed.csv"  # beside the runs of a task
STRATEGIES = 5  # of CMA-ME, that share a batch


def _paper(name: str, experiment: Experiment, title: str) -> Variant:
    return replace(experiment.variants[name], title=title, paper=None)


def algorithms(experiment: Experiment) -> dict[str, Variant]:
    """The variants of an experiment of the paper, and the algorithms beside it."""
    pca = {"descriptor": "pca"}
    paper = [_paper(name, experiment, title) for name, title in PAPER.items() if name in experiment.variants]
    ours = [Variant(name, title, {**pca, **settings}) for name, (title, settings) in OTHERS.items()]
    isometric = experiment.variants[ISOMETRIC].settings["descriptor"]
    geodesic = Variant("ae-geodesic", "AURORA, auto-encoder, geodesic", {"descriptor": f"{isometric},metric=geodesic"})
    return {variant.name: variant for variant in (*paper, geodesic, *ours)}


ISOMETRIC = "ae-isometric"
PAPER = {
    "hand-coded": "hand-coded descriptor",
    "genotype": "genotype as descriptor",
    ISOMETRIC: "AURORA, auto-encoder",
}
OTHERS: dict[str, tuple[str, dict[str, Any]]] = {
    AURORA: ("AURORA, PCA, VAT, curiosity", {}),
    "map-elites": ("MAP-Elites, hand-coded, 100 x 100", {"descriptor": "hand-coded", "archive": Grid(cells=100)}),
    "random": ("random controllers", {"emitter": emitters.Goals(random=1.0)}),
    "uniform": ("uniform selection", {"selection": Uniform()}),
    "novelty": ("selection by novelty", {"selection": Novelty()}),
    "surprise": ("selection by surprise", {"selection": Surprise()}),
    "mixed": ("selection by both", {"selection": Mixed()}),
    "size": ("`Size(5000)`", {"resolution": Size(STORED)}),
    "csc": ("`CSC(5000)`", {"resolution": CSC(STORED)}),
    "dominated": ("dominated novelty, 5,000", {"archive": Dominated(STORED)}),
    "novelty-search": ("novelty search", {"emitter": emitters.NoveltySearch()}),
    "nslc": ("NSLC", {"emitter": emitters.NSLC()}),
    "taxons": ("TAXONS", {"emitter": emitters.TAXONS()}),
    "goals": ("goals, IMGEP-UGL", {"emitter": emitters.Goals()}),
    "cma-me": ("CMA-ME, of pyribs", {"emitter": emitters.Ribs(CMA(batch_size=Settings().batch_size // STRATEGIES))}),
}


def drawn(individuals: Any, bins: int, number: int = STORED) -> float:
    """The diversity of as many of the individuals, drawn at random, all where there are fewer: it compares repertoires of
    different sizes.
    """
    rows = np.random.default_rng(0).permutation(len(individuals))[:number]
    return metrics.diversity(individuals.observation[np.sort(rows)], bins)


def path_length(individuals: Any) -> float:
    """How far pucks go, in metres: the mean over the individuals of the length of their paths."""
    return float(np.linalg.norm(np.diff(individuals.observation, axis=1), axis=2).sum(axis=1).mean())


ALGORITHMS = {
    "ballistic": replace(
        BALLISTIC, variants=algorithms(BALLISTIC), measures=(Coverage("klc", "KLC", metrics.klc),), tested=("klc",)
    ),
    "air-hockey": replace(
        AIR_HOCKEY,
        variants=algorithms(AIR_HOCKEY),
        measures=(
            Own("diversity_20", "diversity", partial(diversity, bins=20)),
            Own("diversity_drawn", f"of {STORED:,}", partial(drawn, bins=20)),
            Own(PATH, "path, m", path_length, form="{:.2f}"),
        ),
        tested=("diversity_20", "diversity_drawn"),
    ),
}
CONTROLLED = {
    task: replace(
        experiment,
        variants={f"csc-{n}": Variant(f"csc-{n}", f"CSC({n})", {"descriptor": "pca", "resolution": CSC(n)}) for n in TARGETS},
        measures=(),
        reference=None,
        tested=(),
    )
    for task, experiment in ALGORITHMS.items()
}


class Budget(NamedTuple):
    """How much of everything."""

    seeds: int = 5
    generations: int = 1_000
    controlled: int = 2_000  # generations of CSC
    controlled_seeds: int = 5
    rounds: int = 3  # in which speed is measured
    sphere_seeds: int = 3
    iterations: int = ITERATIONS


QUICK = Budget(1, 3, 5, 1, 1, 1, 3)
SOME = ("hand-coded", AURORA, "random", "novelty", "goals")  # algorithms, to see it work


def some(experiments: Mapping[Any, Experiment], names: Collection[str]) -> dict[Any, Experiment]:
    """The same of some variants."""
    kept = {key: {n: v for n, v in e.variants.items() if n in names} for key, e in experiments.items()}
    return {key: replace(experiment, variants=kept[key]) for key, experiment in experiments.items()}


class Speed(NamedTuple):
    """What a run took.

    Attributes:
        variant: which.
        turn: in which turn.
        generations, batch_size: of the run.
        seconds: of CPU.
    """

    variant: str
    turn: int
    generations: int
    batch_size: int
    seconds: float


def speeds(path: Path, experiment: Experiment, rounds: int, generations: int) -> list[Speed]:
    """How fast the algorithms are, in turn, each after a short run that compiles; what is in the file is not done again."""
    found = {row[:3]: row for row in (read_table(path, Speed) if path.is_file() else [])}
    for turn, (name, variant) in itertools.product(range(rounds), experiment.variants.items()):
        if (name, turn, generations) in found:
            continue
        settings = variant.of(Settings(task=experiment.task, generations=generations), turn)
        with threadpool_limits(1):
            short, aurora = settings.build()
            aurora.run(short, generations=3)
            task, aurora = settings.build()
            since = time.process_time()
            aurora.run(task, generations=generations)
            row = Speed(name, turn, generations, settings.batch_size, time.process_time() - since)
        print(row, flush=True)
        found[row[:3]] = row
        write_rows(path, Speed, sorted(found.values()))
    return list(found.values())


def grown(experiment: Experiment, folder: Path, seeds: Mapping[str, int], generations: int, jobs: int) -> Ledger:
    """An experiment with as many seeds of each variant, those runs that were missing done.

    With 0 jobs they are done in this process: others take seconds to start.
    """
    cluster = None if jobs else ThreadPoolExecutor(1)
    ledger, base = Ledger(folder), Settings(task=experiment.task, generations=generations)
    for number in sorted(set(seeds.values()), reverse=True):
        names = [name for name in experiment.variants if seeds[name] == number]
        missing, settings = plan(ledger, experiment, names, number, base)
        if missing:
            folder_at(folder)
            left = TimeLeft(missing, jobs or 1, [(experiment.name, ledger.results)])
            with ExperimentProgress(Console(stderr=True), len(missing), left) as progress:
                progress.begin(experiment.name)
                execute(missing, settings, ledger, jobs or 1, progress, cluster)
            if progress.failed:
                raise SystemExit("; ".join(progress.failed))
    return ledger


def algorithms_table(ledger: Ledger, experiment: Experiment, fast: Sequence[Speed]) -> str:
    """A line a variant: what it stored and came to, and how fast; and whether that differs from AURORA's.

    Best first by the measure that is tested last; the p-values are those of rank-sum tests of it.
    """
    *_, last = experiment.tested
    tests = rank_sums(ledger.results, last)
    titles = [measure.title for measure in experiment.measures]
    lines = [
        f"| algorithm | stored | {' | '.join(titles)} | p | evaluations a second | share of AURORA's |",
        "|---|---|" + "---|" * len(titles) + "---|---|---|",
    ]
    rows = [(variant, [r for r in ledger.results if r.variant == name]) for name, variant in experiment.variants.items()]
    rows = [(variant, found) for variant, found in rows if found]
    up = experiment.reference is None  # diversity, of which more is better; not so of the KLC
    rows.sort(key=lambda row: (-1 if up else 1) * _median(row[1], last))
    speed = {
        name: np.median([r.generations * r.batch_size / r.seconds for r in fast if r.variant == name] or [np.nan])
        for name in experiment.variants
    }
    for variant, found in rows:
        cells = [_cell(measure.form, [r.value(measure.name) for r in found]) for measure in experiment.measures]
        p = (
            None
            if variant.name == experiment.reference
            else tests.get((AURORA, variant.name), tests.get((variant.name, AURORA)))
        )
        lines.append(
            f"| {variant.title} | {_median(found, 'size'):,.0f} | {' | '.join(cells)} | {'' if p is None else f'{p:.2g}'} "
            f"| {speed[variant.name]:,.0f} | {speed[variant.name] / speed[AURORA]:.2f} |"
        )
    return "\n".join(lines) + "\n"


def _median(found: Sequence[Any], measure: str) -> float:
    return float(np.median([result.value(measure) for result in found]))


def _cell(form: str, values: Sequence[float]) -> str:
    q = Quartiles.of(np.array(values))
    return f"{form.format(q.median)} ({form.format(q.first)}, {form.format(q.third)})"


def with_paths(ledger: Ledger) -> str:
    """Whether those are diverse whose pucks go far, of the algorithms with PCA: the rank correlation of their medians."""
    pca = [name for name in OTHERS if name != "map-elites"]
    runs = [[result for result in ledger.results if result.variant == name] for name in pca]
    medians = [(_median(found, "path"), _median(found, "diversity_drawn")) for found in runs if found]
    correlation = spearmanr(*zip(*medians, strict=True)).statistic
    return f"Rank correlation of path and diversity of {STORED:,}, {len(medians)} algorithms with PCA: {correlation:.2f}\n"


def algorithms_figure(ledgers: Mapping[str, Ledger]) -> Figure:
    """Each run a dot: the KLC of throws, and the diversity of as many pucks, best above."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 5.2), layout="constrained")
        for axes, (task, ledger) in zip(figure.subplots(1, 2), ledgers.items(), strict=True):
            experiment = ALGORITHMS[task]
            measure = next(m for m in experiment.measures if m.name == experiment.tested[-1])
            up = experiment.reference is None
            values = {
                variant.title.replace("`", ""): [r.value(measure.name) for r in ledger.results if r.variant == name]
                for name, variant in experiment.variants.items()
                if name != experiment.reference
            }
            shown = sorted((np.median(found), title) for title, found in values.items() if found)
            for place, (median, title) in enumerate(shown if up else shown[::-1]):
                color = "#c8287a" if title == ALGORITHMS[task].variants[AURORA].title else "#2646a0"
                axes.plot([median] * 2, [place - 0.3, place + 0.3], color=color, linewidth=1.5)
                axes.plot(values[title], [place] * len(values[title]), "o", color=color, markersize=4, alpha=0.6)
            axes.set_yticks(range(len(shown)), [title for _, title in (shown if up else shown[::-1])])
            axes.grid(axis="y", linewidth=0.3)
            if up:
                axes.set_title(f"air hockey: diversity of {STORED:,}", loc="left")
                axes.set(xlabel="more is better", xlim=(0, None))
            else:
                axes.set_title("ballistic: KLC", loc="left")
                axes.set(xlabel="less is better", xscale="log")
                axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
                axes.xaxis.set_minor_formatter(NullFormatter())
        return figure


def controlled_figure(ledgers: Mapping[str, Ledger]) -> Figure:
    """The number stored, as a share of the target, over generations; a line a run."""
    colors = dict(zip(TARGETS, ("#e0a020", "#c8287a", "#2646a0"), strict=True))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10, 3.6), layout="constrained")
        for axes, (task, ledger) in zip(figure.subplots(1, 2, sharey=True), ledgers.items(), strict=True):
            for target in TARGETS:
                curves = _curves(ledger, f"csc-{target}")
                for i, points in enumerate(curves):
                    generations, sizes = zip(*points, strict=True)
                    label = f"target {target:,}" if i == 0 else None
                    axes.plot(generations, np.array(sizes) / target, color=colors[target], linewidth=1.2, label=label)
            axes.axhline(1, color="black", linewidth=0.6)
            axes.set(title=f"{task}: stored, over the target", xlabel="generation", xlim=(0, None))
        figure.axes[0].set_ylim(bottom=0)
        figure.axes[0].legend(frameon=False)
        return figure


def controlled_table(ledgers: Mapping[str, Ledger]) -> str:
    """A line a task and target: the number stored at some generations, medians."""
    last = max(point.generation for ledger in ledgers.values() for point in ledger.points)
    looks = sorted({point.generation for ledger in ledgers.values() for point in ledger.points})
    shown = sorted({min(looks, key=lambda g: abs(g - share * last)) for share in (0.01, 0.1, 0.2, 0.4, 0.6, 0.8, 1)})
    lines = [
        f"| task | target | {' | '.join(f'{g:,}' for g in shown)} | within 5% from |",
        "|---|---|" + "---|" * (len(shown) + 1),
    ]
    for task, ledger in ledgers.items():
        for target in TARGETS:
            curves = _curves(ledger, f"csc-{target}")
            sizes = [np.median([dict(points)[g] for points in curves]) for g in shown]
            arrivals = dict.fromkeys(_arrival(points, target) for points in curves)
            lines.append(f"| {task} | {target:,} | {' | '.join(f'{size:,.0f}' for size in sizes)} | {', '.join(arrivals)} |")
    return "\n".join(lines) + "\n"


def _curves(ledger: Ledger, variant: str) -> list[list[tuple[int, int]]]:
    """Generations and sizes of each run."""
    points = [point for point in ledger.points if point.variant == variant]
    runs = sorted({point.replication for point in points})
    return [[(point.generation, point.size) for point in points if point.replication == run] for run in runs]


def _arrival(points: Sequence[tuple[int, int]], target: int) -> str:
    """The generation looked at from which on the number stays within 5% of the target; "never"."""
    away = [generation for generation, size in points if abs(size / target - 1) > 0.05]
    after = [generation for generation, _ in points if not away or generation > away[-1]]
    return f"{after[0]:,}" if after else "never"


def grow_all(out: Path, algorithms: Mapping[str, Experiment], budget: Budget, jobs: int) -> None:
    """All that is missing."""
    for task, experiment in algorithms.items():
        seeds = dict.fromkeys(experiment.variants, budget.seeds)
        grown(experiment, out / f"algorithms-{task}", seeds, budget.generations, jobs)
        speeds(out / f"algorithms-{task}" / SPEED, experiment, budget.rounds, budget.generations)
    for task, experiment in CONTROLLED.items():
        seeds = dict.fromkeys(experiment.variants, budget.controlled_seeds)
        grown(experiment, out / f"csc-{task}", seeds, budget.controlled, jobs)
    sphere_runs(out / SPHERE, budget.sphere_seeds, budget.iterations)


def report(out: Path) -> tuple[dict[str, str], dict[str, Figure]]:
    """Tables and figures of what there is, by name."""
    compared = {task: Ledger(out / f"algorithms-{task}") for task in ALGORITHMS}
    controlled = {task: Ledger(out / f"csc-{task}") for task in CONTROLLED}
    found = read_table(out / SPHERE, Found)
    fast = {task: read_table(out / f"algorithms-{task}" / SPEED, Speed) for task in ALGORITHMS}
    tables = {task: algorithms_table(ledger, ALGORITHMS[task], fast[task]) for task, ledger in compared.items()}
    tables |= {"paths": with_paths(compared["air-hockey"])}
    tables |= {"csc": controlled_table(controlled), "sphere": sphere_table(found)}
    figures = {"comparison": algorithms_figure(compared), "csc": controlled_figure(controlled), "sphere": sphere_figure(found)}
    return tables, figures


def filled(page: str, tables: Mapping[str, str]) -> str:
    """A page with the tables between the lines that name them, `<!-- sphere -->`, and the next `<!-- end -->`."""
    for name, table in tables.items():
        before, mark, rest = page.partition(f"<!-- {name} -->\n")
        if not mark:
            raise ValueError(f"page must have a line <!-- {name} -->, and has none")
        page = before + mark + table + "<!-- end -->" + rest.partition("<!-- end -->")[2]
    return page


def page_of(options: argparse.Namespace, out: Path) -> Path | None:
    """What is to be filled: the page; with --quick a copy below the quick results, so the page keeps its numbers."""
    if options.page is None or not options.quick:
        return options.page
    return Path(shutil.copy(options.page, folder_at(out / options.page.parent.name)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/comparison"), help="where results are, and more are added")
    parser.add_argument("--seeds", type=int, default=Budget().seeds, help="of each algorithm")
    parser.add_argument("--jobs", type=int, default=len(cores()), help="runs at once, of all but the sphere")
    parser.add_argument(
        "--quick", action="store_true", help="some algorithms, three generations, in one process, into OUT/quick; also the page"
    )
    parser.add_argument("--page", type=Path, help="whose tables and figures are replaced by those that come out")
    options = parser.parse_args()
    if options.quick:
        out = options.out / "quick"
        grow_all(out, some(ALGORITHMS, SOME), QUICK, jobs=0)
    else:
        out = options.out
        grow_all(out, ALGORITHMS, Budget(options.seeds), options.jobs)
    tables, figures = report(out)
    for name, table in tables.items():
        print(f"### {name}\n\n{table}")
    page = page_of(options, out)
    shown = out if page is None else page.parent
    for name, figure in figures.items():
        png, svg = save_figure(figure, folder_at(shown / "figures"), name)
        print(png)
        if page is not None:  # which shows the other
            svg.unlink()
    if page is not None:
        page.write_text(filled(page.read_text(), tables))


if __name__ == "__main__":
    main()
