"""Several objects: air hockey with two and three pucks that hit each other, by descriptors learned, hand-coded, and by chance.

    python benchmarks/pucks.py                  # half an hour of one core; into runs/pucks
    python benchmarks/pucks.py --quick          # to see it work: seconds; no conclusions can be drawn
    python benchmarks/pucks.py --out results --page docs/results/pucks.md     # what that page shows, from results

The hand-coded descriptor is where all pucks end. Repertoires are judged by how diverse the ways of the pucks are, of as many
individuals of each, drawn at random. Runs that are done are skipped, so it can be interrupted and called again.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from comparison import filled, grown, page_of
from matplotlib.figure import Figure

import auroraqd
from auroraqd import emitters, metrics
from auroraqd._files import folder_at
from auroraqd._workers import cores
from auroraqd.control.resolution import Size
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.measures import Own
from auroraqd.experiments.statistics import Quartiles
from auroraqd.experiments.variants import Experiment, Variant
from auroraqd.repertoire import diverse
from auroraqd.report.scenes import scene_of
from auroraqd.report.skills import skills_figure
from auroraqd.report.style import save_figure

PUCKS = (2, 3)
STORED = 5_000  # individuals, about
SQUARES = 20  # along each side of the room
SHOWN = 8  # skills in the figure
MOVED = 1e-3  # m, farther than which a puck has moved


def ways(individuals: Any, bins: int = SQUARES, number: int = STORED) -> float:
    """The diversity of the ways of a puck, summed over pucks: of `number` individuals drawn at random."""
    rows = np.sort(np.random.default_rng(0).permutation(len(individuals))[:number])
    seen = individuals.observation
    return sum(metrics.diversity(seen[name][rows], bins) for name in seen.dtype.names)


def moved(individuals: Any) -> float:
    """The share of individuals that move all pucks, in percent."""
    seen = individuals.observation
    moving = [np.ptp(seen[name], axis=1).max(axis=1) > MOVED for name in seen.dtype.names]
    return 100 * float(np.all(moving, axis=0).mean())


def _several(pucks: int) -> Experiment:
    size = {"resolution": Size(STORED)}
    variants = [
        Variant("hand-coded", "hand-coded: where they end", {"descriptor": "hand-coded", **size}),
        Variant("random", "random controllers", {"descriptor": "pca", "emitter": emitters.Goals(random=1.0), **size}),
        *(Variant(f"pca-{d}", f"PCA, {d}", {"descriptor": "pca", "components": d, **size}) for d in (2, 5, 10)),
    ]
    return Experiment(
        name=f"pucks-{pucks}",
        task=f"air-hockey:pucks={pucks}",
        variants={variant.name: variant for variant in variants},
        measures=(Own("moved", "move all, %", moved, form="{:.0f}"), Own("diversity", f"diversity of {STORED:,}", ways)),
        reference=None,
        tested=("diversity",),
        truth="final positions",
    )


EXPERIMENTS = {pucks: _several(pucks) for pucks in PUCKS}


def table(ledgers: Mapping[int, Ledger]) -> str:
    """A line a number of pucks and descriptor: medians, quartiles in brackets."""
    lines = ["| pucks | descriptor | runs | stored | move all, % | diversity | seconds |", "|---|---|---|---|---|---|---|"]
    for pucks, ledger in ledgers.items():
        for name, variant in EXPERIMENTS[pucks].variants.items():
            found = [result for result in ledger.results if result.variant == name]
            if found:
                q = Quartiles.of(np.array([result.value("diversity") for result in found]))
                size, moved, seconds = (np.median([r.value(one) for r in found]) for one in ("size", "moved", "seconds"))
                lines.append(
                    f"| {pucks} | {variant.title} | {len(found)} | {size:,.0f} | {moved:.0f} "
                    f"| {q.median:.0f} ({q.first:.0f}, {q.third:.0f}) | {seconds:.0f} |"
                )
    return "\n".join(lines) + "\n"


def skills(run: Path) -> Figure:
    """Skills of a run that move all pucks, as far from each other as can be."""
    repertoire = auroraqd.load(run)
    seen = repertoire.observation
    moving = np.all([np.ptp(seen[name], axis=1).max(axis=1) > MOVED for name in seen.dtype.names], axis=0)
    rows = np.flatnonzero(moving)
    chosen = rows[diverse(repertoire.descriptor[rows], SHOWN)]
    return skills_figure(repertoire, scene_of({"task": "air-hockey"}, repertoire), chosen)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/pucks"), help="where results are, and more are added")
    parser.add_argument("--seeds", type=int, default=3, help="of each")
    parser.add_argument("--jobs", type=int, default=len(cores()), help="runs at once")
    parser.add_argument("--quick", action="store_true", help="three generations, in one process, into OUT/quick; also the page")
    parser.add_argument("--page", type=Path, help="whose table and figure are replaced by those that come out")
    options = parser.parse_args()
    out = options.out / "quick" if options.quick else options.out
    seeds, generations, jobs = (1, 3, 0) if options.quick else (options.seeds, 1_000, options.jobs)
    ledgers = {
        pucks: grown(
            experiment, folder_at(out) / f"pucks-{pucks}", dict.fromkeys(experiment.variants, seeds), generations, jobs
        )
        for pucks, experiment in EXPERIMENTS.items()
    }
    text, page = table(ledgers), page_of(options, out)
    print(text)
    folder = ledgers[PUCKS[-1]].run_folder("pca-10", 0)
    if folder.is_dir():  # which results do without
        shown = out if page is None else page.parent.parent
        png, svg = save_figure(skills(folder), folder_at(shown / "figures"), "pucks")
        svg.unlink()
        print(png)
    if page is not None:
        page.write_text(filled(page.read_text(), {"pucks": text}))


if __name__ == "__main__":
    main()
