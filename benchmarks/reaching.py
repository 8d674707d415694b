"""How close a repertoire comes to goals between its skills, and how much closer a few trials more bring it.

    python benchmarks/reaching.py     # a minute; the figure is runs/reaching/reaching.png
    python benchmarks/reaching.py --quick     # to see it work: seconds; no conclusions can be drawn

Repertoires of the paper's tasks, AURORA-PCA, 1,000 generations. Goals are outcomes of random genotypes, so each can be reached:
tops of throws, and places where the puck comes to lie after it was touched. Distances are in the unit of the ground truth: of
throws 1 is half its range, 1 m for the puck.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import wilcoxon
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import STYLE
from auroraqd.tasks import air_hockey

FOLDER = Path("runs/reaching")
TASKS = {"ballistic": auroraqd.tasks.Ballistic(), "air hockey": auroraqd.tasks.AirHockey()}
QUICK = {"goals": 5, "generations": 20, "folder": FOLDER / "quick"}
LOOKS = (1, 2, 3, 5, 10, 20)  # trials after which distances are compared
MODEL = "local models"
MUTANTS = "mutants"  # of the best so far: what a search without a model would do
SIGMA = 0.001  # of them, the best of 0.05, 0.02, 0.01, 0.005, 0.0025 and 0.001 on air hockey, for other goals


def repertoire_of(task, generations: int, seed: int, folder: Path):
    """What a run finds."""
    aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=seed).run(task, generations=generations)
    return auroraqd.load(auroraqd.save(aurora, folder / type(task).__name__, overwrite=True))


def goals_of(task, number: int, rng) -> np.ndarray:
    """Outcomes that can be reached, (number, 2)."""
    outcomes = task(rng.random((40 * number, task.n_genes))).ground_truth
    moved = np.linalg.norm(outcomes - air_hockey.START, axis=1) > 1e-9 if isinstance(task, auroraqd.tasks.AirHockey) else ...
    return outcomes[moved][:number]


def by_model(task, repertoire, goals) -> np.ndarray:
    """Distances of what is refined, (goals, 1 + trials): with fewer trials the first ones are the same."""
    found = [repertoire.ground_truth[nearest(repertoire, goals)]]
    found += [repertoire.refine(task, goals, trials=trials).outcome for trials in range(1, LOOKS[-1] + 1)]
    return np.linalg.norm(np.stack(found, axis=1) - goals[:, None], axis=2)


def by_mutants(task, repertoire, goals, rng) -> np.ndarray:
    """Distances of the best so far, likewise."""
    rows = nearest(repertoire, goals)
    tried, genotypes = [repertoire.ground_truth[rows]], repertoire.genotype[rows]
    for _ in range(LOOKS[-1]):
        mutants = np.clip(genotypes + rng.normal(0, SIGMA, genotypes.shape), 0, 1)
        tried.append(task(mutants).ground_truth)
        distances = so_far(tried, goals)
        genotypes = np.where((distances[:, -1] < distances[:, -2])[:, None], mutants, genotypes)
    return so_far(tried, goals)


def nearest(repertoire, goals) -> np.ndarray:
    """Rows of the nearest skills, by the ground truth in its own unit."""
    return np.array([np.linalg.norm(repertoire.ground_truth - goal, axis=1).argmin() for goal in goals])


def so_far(tried: list[np.ndarray], goals: np.ndarray) -> np.ndarray:
    """Distances of the best so far, (goals, 1 + trials)."""
    return np.minimum.accumulate(np.linalg.norm(np.stack(tried, axis=1) - goals[:, None], axis=2), axis=1)


def table(found: dict[str, dict[str, np.ndarray]]) -> None:
    """Medians, and the share of the goals that came three times closer than the nearest skill in ten trials."""
    print(f"| task | trials by | nearest skill | {' | '.join(map(str, LOOKS))} | 3 times closer after 10 |")
    print(f"|---|---|---{'|---' * len(LOOKS)}|---|")
    for name, ways in found.items():
        for way, distances in ways.items():
            cells = [f"{np.median(distances[:, look]):.1e}" for look in (0, *LOOKS)]
            print(f"| {name} | {way} | {' | '.join(cells)} | {(distances[:, 0] >= 3 * distances[:, 10]).mean():.0%} |")


def draw(found: dict[str, dict[str, np.ndarray]], path: Path) -> None:
    """Trials against the distance to the goal."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 3.4), layout="constrained")
        for axes, (name, ways) in zip(figure.subplots(1, 2, sharey=True), found.items(), strict=True):
            for (way, distances), color in zip(ways.items(), ("#c8287a", "#888888"), strict=True):
                low, middle, high = np.quantile(np.maximum(distances, 1e-12), (0.25, 0.5, 0.75), axis=0)
                steps = np.arange(len(middle))
                axes.fill_between(steps, low, high, color=color, alpha=0.15, linewidth=0)
                axes.plot(steps, middle, color=color, label=way, linewidth=1.8)
            axes.set(title=name, xlabel="trials for a goal", yscale="log", ylim=(1e-7, 3e-2), xticks=range(0, LOOKS[-1] + 1, 5))
            axes.legend(frameon=False)
        figure.axes[0].set_ylabel("distance to the goal")
        figure.savefig(path, dpi=150)


def main(goals: int = 200, generations: int = 1000, seed: int = 1, folder: Path = FOLDER) -> None:
    rng, found = np.random.default_rng(0), {}
    for name, task in TASKS.items():
        repertoire, wanted = repertoire_of(task, generations, seed, folder), goals_of(task, goals, rng)
        found[name] = {MODEL: by_model(task, repertoire, wanted), MUTANTS: by_mutants(task, repertoire, wanted, rng)}
        after = [distances[:, 10] for distances in found[name].values()]
        print(
            f"{name}: {len(repertoire):,} skills, {len(wanted)} goals; model beside mutants p = {wilcoxon(*after).pvalue:.1g}"
        )
    print()
    table(found)
    draw(found, folder / "reaching.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--generations", type=int, default=1000, help="of the repertoires")
    parser.add_argument("--seed", type=int, default=1, help="of the repertoires")
    parser.add_argument("--quick", action="store_true", help="5 goals, 20 generations, into runs/reaching/quick")
    options = vars(parser.parse_args())
    main(**options | (QUICK if options.pop("quick") else {}))
