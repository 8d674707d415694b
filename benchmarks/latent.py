"""How large should a latent space be? PCA and auto-encoders of 2 to 20 dimensions: docs/results/latent.md.

    python benchmarks/latent.py                  # hours of one core; into runs/latent
    python benchmarks/latent.py --quick          # to see it work: seconds; no conclusions can be drawn
    python benchmarks/latent.py --out results --page docs/results/latent.md     # what that page shows, from results

On both tasks, with a distance threshold that aims at the same number of individuals whatever the dimensions (`Size`). Runs
that are done are skipped, so it can be interrupted and called again.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from comparison import ALGORITHMS, ISOMETRIC, PATH, filled, grown, page_of, some
from matplotlib.figure import Figure

from auroraqd._files import folder_at
from auroraqd._workers import cores
from auroraqd.control.resolution import Size
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.variants import Experiment, Variant
from auroraqd.report.style import STYLE, save_figure

DIMENSIONS = (2, 3, 5, 10, 20)
WANTED = 5_000  # individuals
DESCRIPTORS = {"pca": "PCA", "ae": "auto-encoder"}
COLORS = {"pca": "#2646a0", "ae": "#c8287a"}


def named(descriptor: str, dimensions: int) -> str:
    """The name of a variant."""
    return f"{descriptor}-{dimensions}"


def latent(experiment: Experiment) -> Experiment:
    """An experiment of the comparison, with these descriptors instead of its algorithms."""
    isometric = experiment.variants[ISOMETRIC].settings["descriptor"]
    reference = [] if experiment.reference is None else [experiment.variants[experiment.reference]]
    ours = [
        Variant(
            named(descriptor, dimensions),
            f"{title}, {dimensions}",
            {
                "descriptor": "pca" if descriptor == "pca" else isometric,
                "components": dimensions,
                "resolution": Size(WANTED),
            },
        )
        for descriptor, title in DESCRIPTORS.items()
        for dimensions in DIMENSIONS
    ]
    measures = tuple(measure for measure in experiment.measures if measure.name != PATH)
    return replace(experiment, variants={variant.name: variant for variant in (*reference, *ours)}, measures=measures)


SOME = ("hand-coded", named("pca", 2), named("pca", 20))  # to see it work
EXPERIMENTS = {task: latent(experiment) for task, experiment in ALGORITHMS.items()}


def table(ledgers: Mapping[str, Ledger]) -> str:
    """A line a task, descriptor and number of dimensions: medians."""
    titles = "| task | descriptor | dimensions | runs | stored | {} | added, % | RMSE | seconds |"
    lines = []
    for task, ledger in ledgers.items():
        measures = EXPERIMENTS[task].measures
        lines += [titles.format(" | ".join(measure.title for measure in measures)), "|---" * (8 + len(measures)) + "|"]
        for name, variant in EXPERIMENTS[task].variants.items():
            found = [result for result in ledger.results if result.variant == name]
            if not found or name == EXPERIMENTS[task].reference:
                continue
            added = [100 * (r.new + r.replaced) / (r.generations * r.batch_size) for r in found]
            values = [measure.form.format(np.median([r.value(measure.name) for r in found])) for measure in measures]
            title, _, dimensions = variant.title.rpartition(", ")
            rmse, seconds, size = (np.median([getattr(r, one) for r in found]) for one in ("rmse", "seconds", "size"))
            lines.append(
                f"| {task} | {title} | {dimensions} | {len(found)} | {size:,.0f} | {' | '.join(values)} "
                f"| {np.median(added):.0f} | {rmse:.4f} | {seconds:.0f} |"
            )
        lines.append("")
    return "\n".join(lines)


def figure_of(ledgers: Mapping[str, Ledger]) -> Figure:
    """What is compared first, and the error of reconstruction, over the number of dimensions; a dot a run."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10, 3.6), layout="constrained")
        tasks = [(task, measure) for task in ledgers for measure in (EXPERIMENTS[task].measures[-1],)]
        panels = [(task, measure.title, measure.name) for task, measure in tasks] + [("ballistic", "RMSE", "rmse")]
        for axes, (task, title, name) in zip(figure.subplots(1, 3), panels, strict=True):
            for descriptor, label in DESCRIPTORS.items():
                runs = {
                    d: [r.value(name) for r in ledgers[task].results if r.variant == named(descriptor, d)] for d in DIMENSIONS
                }
                runs = {d: found for d, found in runs.items() if found}
                color = COLORS[descriptor]
                axes.plot([*runs], [np.median(found) for found in runs.values()], color=color, linewidth=1.2, label=label)
                for d, found in runs.items():
                    axes.plot([d] * len(found), found, "o", color=color, markersize=3, alpha=0.6)
            axes.set_title(f"{task}: {title}", loc="left")
            axes.set(xlabel="dimensions", xscale="log", ylim=(0, None))
            axes.set_xticks(DIMENSIONS, [str(d) for d in DIMENSIONS], minor=False)
            axes.minorticks_off()
        figure.axes[0].legend(frameon=False)
        return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/latent"), help="where results are, and more are added")
    parser.add_argument("--seeds", type=int, default=5, help="of PCA")
    parser.add_argument("--trained", type=int, default=5, help="seeds of auto-encoders")
    parser.add_argument("--jobs", type=int, default=len(cores()), help="runs at once")
    parser.add_argument(
        "--quick", action="store_true", help="some sizes, three generations, in one process, into OUT/quick; also the page"
    )
    parser.add_argument("--page", type=Path, help="whose table and figure are replaced by those that come out")
    options = parser.parse_args()
    out = options.out / "quick" if options.quick else options.out
    seeds, trained, generations = (1, 1, 3) if options.quick else (options.seeds, options.trained, 1_000)
    experiments = some(EXPERIMENTS, SOME) if options.quick else EXPERIMENTS
    ledgers = {
        task: grown(
            experiment,
            out / f"latent-{task}",
            {name: trained if name.startswith("ae-") else seeds for name in experiment.variants},
            generations,
            0 if options.quick else options.jobs,
        )
        for task, experiment in experiments.items()
    }
    text, figure, page = table(ledgers), figure_of(ledgers), page_of(options, out)
    print(text)
    shown = out if page is None else page.parent.parent
    png, svg = save_figure(figure, folder_at(shown / "figures"), "latent")
    print(png)
    if page is not None:
        svg.unlink()
        page.write_text(filled(page.read_text(), {"latent": text}))


if __name__ == "__main__":
    main()
