"""Other readings of the repertoires of the paper's experiments, which are grown by `auroraqd reproduce`.

    auroraqd reproduce ballistic --replications 5 --out runs/ballistic
    auroraqd reproduce air-hockey --replications 5 --out runs/air-hockey
    python benchmarks/readings.py runs/ballistic runs/air-hockey
    python benchmarks/readings.py runs/ballistic --quick    # to see it work, with one run of each variant

Of throws, what the Kullback-Leibler coverage comes to when its histogram is made in other ways, and what it is between
hand-coded repertoires of different seeds. Of air hockey, how many final positions are near a wall, and what the diversity is
of as many individuals of each repertoire, drawn at random.
"""

import argparse
import itertools
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

import auroraqd
from auroraqd.experiments.ledger import SETTINGS, Ledger
from auroraqd.experiments.variants import AIR_HOCKEY, BALLISTIC, near_a_wall
from auroraqd.metrics import diversity, klc
from auroraqd.tasks import air_hockey

BINS = 30
NEAR = 0.1  # m
DRAWN = 10_000  # individuals


def histograms(reference: np.ndarray, compared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many of each are in the bins of the bounding box of the reference."""
    box = list(zip(reference.min(axis=0), reference.max(axis=0), strict=True))
    return np.histogramdd(reference, BINS, box)[0], np.histogramdd(compared, BINS, box)[0]


def one_added(reference: np.ndarray, compared: np.ndarray) -> float:
    """KLC with one individual more in every bin of the compared."""
    e, a = histograms(reference, compared)
    e, a, covered = e / e.sum(), (a + 1) / (a + 1).sum(), e > 0
    return float(np.sum(e[covered] * np.log(e[covered] / a[covered])))


def empty_left_out(reference: np.ndarray, compared: np.ndarray) -> float:
    """KLC over the bins that neither leaves empty."""
    e, a = histograms(reference, compared)
    e, a, both = e / e.sum(), a / a.sum(), (e > 0) & (a > 0)
    return float(np.sum(e[both] * np.log(e[both] / a[both])))


def marginal(reference: np.ndarray, compared: np.ndarray) -> float:
    """The sum of those of each dimension."""
    return klc(reference, compared, BINS, marginal=True)


READINGS: dict[str, Callable[[np.ndarray, np.ndarray], float]] = {
    "joint, empty bins 1e-8": klc,
    "joint, one added to each bin": one_added,
    "joint, empty bins left out": empty_left_out,
    "marginal, summed": marginal,
}


def repertoires(ledger: Ledger, variant: str, most: int | None) -> dict[int, auroraqd.Repertoire]:
    """By replication, those that are there, of so many at most."""
    folders = {replication: ledger.run_folder(variant, replication) for replication in sorted(ledger.done(variant))[:most]}
    return {replication: auroraqd.load(folder) for replication, folder in folders.items() if folder.is_dir()}


def throws(ledger: Ledger, most: int | None) -> None:
    """Readings of the KLC, medians over replications; and the noise floor."""
    references = {replication: found.ground_truth for replication, found in repertoires(ledger, "hand-coded", most).items()}
    print("### Readings of the KLC, medians\n")
    print(f"| variant | runs | {' | '.join(READINGS)} | paper |\n|---|---|{'---|' * len(READINGS)}---|")
    for name, variant in BALLISTIC.variants.items():
        others = {} if name == "hand-coded" else repertoires(ledger, name, most)
        pairs = [(references[i], found.ground_truth) for i, found in others.items()]
        if pairs:
            cells = [f"{np.median([reading(*pair) for pair in pairs]):.3f}" for reading in READINGS.values()]
            paper = "" if variant.paper is None else f"{variant.paper:g}"
            print(f"| {variant.title} | {len(pairs)} | {' | '.join(cells)} | {paper} |", flush=True)
    floor = [klc(one, other) for one, other in itertools.permutations(references.values(), 2)]
    if floor:
        print(f"\nKLC between {len(references)} hand-coded repertoires of different seeds, the noise floor: median ", end="")
        print(f"{np.median(floor):.4f}, largest {max(floor):.4f}, of {len(floor)} ordered pairs")


def hockey(ledger: Ledger, most: int | None) -> None:
    """Final positions near a wall, and diversity of as many individuals."""
    reach = air_hockey.WALL - air_hockey.PUCK
    even = 1 - (1 - NEAR / reach) ** 2
    print(f"### Final positions within {NEAR} m of where the puck can touch a wall (even would be {even:.0%}); and the")
    print(f"diversity, 20 x 20, of {DRAWN:,} individuals drawn at random: smallest and largest over the runs\n")
    print(f"| variant | runs | near a wall | diversity of {DRAWN:,} |\n|---|---|---|---|")
    for name, variant in AIR_HOCKEY.variants.items():
        found = repertoires(ledger, name, most).values()
        if found:
            near = [near_a_wall(one, NEAR) for one in found]
            drawn = [diversity(sample(one.observation), bins=20) for one in found if len(one) >= DRAWN]
            ends = f"{min(drawn):.0f} to {max(drawn):.0f}" if drawn else ""
            print(f"| {variant.title} | {len(found)} | {min(near):.1%} to {max(near):.1%} | {ends} |", flush=True)


def sample(rows: np.ndarray) -> np.ndarray:
    """Some of them, at random."""
    return rows[np.random.default_rng(0).choice(len(rows), DRAWN, replace=False)]


def task_of(folder: Path) -> str:
    """The task whose experiment is in a folder."""
    return next(iter(json.loads((folder / SETTINGS).read_text()).values()))["task"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="written by `auroraqd reproduce TASK --out FOLDER`")
    parser.add_argument("--quick", action="store_true", help="the first run of each variant")
    options = parser.parse_args()
    for folder in options.folders:
        {"ballistic": throws, "air-hockey": hockey}[task_of(folder)](Ledger(folder), 1 if options.quick else None)


if __name__ == "__main__":
    main()
