"""A run a hundred times as long as the paper's: 10^8 evaluations of the ballistic task, at a resolution that stores a million.

    python benchmarks/million.py            # half an hour of one core, 6 GiB; into results/million
    python benchmarks/million.py --quick    # to see it work: 10^5 evaluations

What it costs as the repertoire grows: CPU time an evaluation, memory, writing a checkpoint. And what so many skills are good
for: how far the nearest of them is from what was asked for, here the tops of the arcs of 2,000 random throws. It goes on from
its last checkpoint when it is called again.
"""

import argparse
import resource
import time
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from sklearn.decomposition import PCA
from sphere import write_rows

import auroraqd
from auroraqd._files import folder_at, read_table
from auroraqd.report.style import STYLE, save_figure

EVALUATIONS, BATCH, CELLS = 10**8, 2_000, 5e6
TASK = auroraqd.tasks.Ballistic()
GOALS, METRES = 2_000, 1_000.0  # in a unit of the ground truth
ROWS, RUN = "million.csv", "run"


class Mark(NamedTuple):
    """What a run has come to.

    Attributes:
        evaluations: so far.
        stored: individuals.
        microseconds: of CPU an evaluation, since the mark before; updates of the descriptor included, checkpoints not.
        megabytes: the most memory the process had.
        checkpoint: s, to write one.
        file: MB, of it.
        nearest: m, median distance from a goal to the top of the nearest skill's arc.
    """

    evaluations: int
    stored: int
    microseconds: float
    megabytes: float
    checkpoint: float
    file: float
    nearest: float


def marks(evaluations: int) -> list[int]:
    """Four to a decade, whole generations."""
    steps = 10 ** np.arange(4, np.log10(evaluations) + 0.01, 0.25)
    return sorted({max(1, round(step / BATCH)) for step in steps})


def goals() -> np.ndarray:
    """(2,000, 2) tops of the arcs of random throws that leave the ground."""
    fitness, _, truth = TASK(np.random.default_rng(1).random((3 * GOALS, TASK.n_genes)))
    return truth[np.isfinite(fitness)][:GOALS]


def grown(folder: Path, evaluations: int) -> list[Mark]:
    """The marks, those that were missing measured."""
    wanted, rows = goals(), folder / ROWS
    found = {mark.evaluations: mark for mark in (read_table(rows, Mark) if rows.is_file() else [])}
    todo = [g for g in marks(evaluations) if g * BATCH not in found]
    if not todo:
        return sorted(found.values())
    if found:
        aurora = auroraqd.resume(folder / RUN)
    else:
        aurora = auroraqd.Aurora(TASK.n_genes, PCA(2), seed=0, batch_size=BATCH, resolution=auroraqd.VAT(cells=CELLS))
        aurora.run(TASK, generations=1)
    for generation in todo:
        before, since = aurora.generation, time.process_time()
        aurora.run(TASK, until_generation=generation)
        spent = time.process_time() - since
        since = time.perf_counter()
        auroraqd.save(aurora, folder / RUN, overwrite=True)
        written = time.perf_counter() - since
        mark = Mark(
            generation * BATCH,
            len(aurora.archive),
            1e6 * spent / max(1, (generation - before) * BATCH),
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            written,
            sum(path.stat().st_size for path in (folder / RUN).rglob("*") if path.is_file()) / 1e6,
            METRES * float(np.median(cKDTree(aurora.archive.ground_truth).query(wanted)[0])),
        )
        found[mark.evaluations] = mark
        write_rows(rows, Mark, sorted(found.values()))
        print(mark, flush=True)
    return sorted(found.values())


def table(found: list[Mark]) -> str:
    """A line a mark, two to a decade."""
    lines = [
        "| evaluations | stored | us an evaluation | memory, MB | a checkpoint, s | MB | to the nearest skill, m |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {m.evaluations:,} | {m.stored:,} | {m.microseconds:.1f} | {m.megabytes:,.0f} | {m.checkpoint:.2f} | {m.file:,.0f} "
        f"| {m.nearest:#.3g} |"
        for m in found[::-2][::-1]
    ]
    return "\n".join(lines) + "\n"


def figure(found: list[Mark]) -> Figure:
    """Cost, and the distance to the nearest skill, by the number stored."""
    stored = [mark.stored for mark in found]
    panels = {
        "CPU time an evaluation, us": [mark.microseconds for mark in found],
        "a checkpoint, s": [mark.checkpoint for mark in found],
        "to the nearest skill, m": [mark.nearest for mark in found],
    }
    with mpl.rc_context(STYLE):
        drawn = Figure(figsize=(11, 3.4), layout="constrained")
        for axes, (title, values) in zip(drawn.subplots(1, 3), panels.items(), strict=True):
            axes.loglog(stored, values, "o-", color="#2646a0", markersize=4)
            axes.set(xlabel="stored", title=title)
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
            axes.grid(which="major", linewidth=0.3)
        return drawn


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/million"))
    parser.add_argument("--quick", action="store_true", help="10^5 evaluations, into OUT/quick")
    args = parser.parse_args()
    folder = folder_at(args.out / "quick" if args.quick else args.out)
    found = grown(folder, 10**5 if args.quick else EVALUATIONS)
    print(table(found))
    save_figure(figure(found), folder, "million")


if __name__ == "__main__":
    main()
