"""What a robot finds that only sees: air hockey and a maze through a camera, beside what an expert would measure.

    python benchmarks/seeing.py                  # hours of one core; into runs/seeing
    python benchmarks/seeing.py --quick          # to see it work: seconds; no conclusions can be drawn
    python benchmarks/seeing.py --out results --page docs/results/pixels.md     # what that page shows, from results

Descriptors are learned from pictures alone. What repertoires are judged by is nothing that they have seen: the ways of the
pucks in metres, for which the genotypes are evaluated once more, and where the robots of the maze end. Runs that are done are
skipped, so it can be interrupted and called again.
"""

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from comparison import STORED, filled, grown, page_of, some

from auroraqd import emitters, metrics
from auroraqd._files import folder_at
from auroraqd._workers import cores
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.measures import Own
from auroraqd.experiments.statistics import Quartiles, rank_sums
from auroraqd.experiments.variants import Experiment, Variant
from auroraqd.tasks import AirHockey
from auroraqd.tasks.maze import SIDE

SQUARES = 20  # along each side, of the room and of the maze
CAMERA, MAZE = "air-hockey-camera", "maze"
EXPERT = "hand-coded"
SOME = (EXPERT, "random", "pca")  # descriptors, to see it work
TITLES = {CAMERA: "Air hockey", MAZE: "Maze"}


def ways(individuals: Any, bins: int = SQUARES, number: int | None = None) -> float:
    """The diversity of the pucks' ways of as many individuals, drawn at random; all, where there are fewer, or None."""
    rows = np.random.default_rng(0).permutation(len(individuals))[:number]
    return metrics.diversity(AirHockey()(individuals.genotype[np.sort(rows)]).observation, bins)


def squares(individuals: Any) -> float:
    """In how many squares of the maze individuals end."""
    return metrics.coverage(individuals.ground_truth, SQUARES, 0, SIDE) * SQUARES**2


def effective(individuals: Any) -> float:
    """The same, counted by how they are spread over them: see `auroraqd.metrics.effective_cells`."""
    return metrics.effective_cells(individuals.ground_truth, SQUARES, 0, SIDE)


def _seen(task: str, *measures: Any) -> Experiment:
    """What is compared: descriptors that are learned from pictures, with one that is told what counts, and without any."""
    variants = [
        Variant(EXPERT, "hand-coded descriptor", {"descriptor": "hand-coded"}),
        Variant("random", "random controllers", {"descriptor": "hand-coded", "emitter": emitters.Goals(random=1.0)}),
        Variant("pca", "PCA, 2", {"descriptor": "pca"}),
        Variant("pca-5", "PCA, 5", {"descriptor": "pca", "components": 5}),
        Variant("ae", "`AutoEncoder(2)`", {"descriptor": "autoencoder"}),
    ]
    return Experiment(
        name=task,
        task=task,
        variants={variant.name: variant for variant in variants},
        measures=measures,
        reference=None,
        tested=(measures[-1].name,),
        truth="final position",
    )


EXPERIMENTS = {
    CAMERA: _seen(
        CAMERA,
        Own("diversity", "diversity", ways),
        Own("diversity_drawn", f"of {STORED:,}", partial(ways, number=STORED)),
    ),
    MAZE: _seen(
        MAZE,
        Own("coverage", f"coverage of {SQUARES**2}", squares, form="{:.0f}"),
        Own("effective", "effective squares", effective, form="{:.0f}"),
    ),
}


def table(ledgers: Mapping[str, Ledger]) -> str:
    """A line a task and descriptor: medians (quartiles); p of a rank-sum test of the last measure, beside the expert."""
    lines = []
    for task, ledger in ledgers.items():
        experiment = EXPERIMENTS[task]
        titles = " | ".join(measure.title for measure in experiment.measures)
        lines += [f"| {TITLES[task]} | runs | stored | {titles} | p | seconds |", "|---" * (5 + len(experiment.measures)) + "|"]
        tests = rank_sums(ledger.results, experiment.tested[0])
        for name, variant in experiment.variants.items():
            found = [result for result in ledger.results if result.variant == name]
            if not found:
                continue
            cells = [_cell(measure.form, [r.value(measure.name) for r in found]) for measure in experiment.measures]
            size, seconds = (np.median([getattr(r, one) for r in found]) for one in ("size", "seconds"))
            p = tests.get((EXPERT, name), tests.get((name, EXPERT)))
            lines.append(
                f"| {variant.title} | {len(found)} | {size:,.0f} | {' | '.join(cells)} | {'' if p is None else f'{p:.2g}'} "
                f"| {seconds:.0f} |"
            )
        lines.append("")
    return "\n".join(lines)


def _cell(form: str, values: list[float]) -> str:
    q = Quartiles.of(np.array(values))
    return f"{form.format(q.median)} ({form.format(q.first)}, {form.format(q.third)})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/seeing"), help="where results are, and more are added")
    parser.add_argument("--seeds", type=int, default=5, help="of each")
    parser.add_argument("--jobs", type=int, default=len(cores()), help="runs at once")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="some descriptors, three generations, in one process, into OUT/quick; also the page",
    )
    parser.add_argument("--page", type=Path, help="whose table is replaced by the one that comes out")
    options = parser.parse_args()
    out = options.out / "quick" if options.quick else options.out
    seeds, generations, jobs = (1, 3, 0) if options.quick else (options.seeds, 1_000, options.jobs)
    experiments = some(EXPERIMENTS, SOME) if options.quick else EXPERIMENTS
    ledgers = {
        task: grown(experiment, folder_at(out) / f"seeing-{task}", dict.fromkeys(experiment.variants, seeds), generations, jobs)
        for task, experiment in experiments.items()
    }
    text, page = table(ledgers), page_of(options, out)
    print(text)
    if page is not None:
        page.write_text(filled(page.read_text(), {"seeing": text}))


if __name__ == "__main__":
    main()
