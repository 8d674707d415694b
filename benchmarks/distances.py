"""What distances between observations are worth: straight, blurred, and along paths over the graph of neighbours.

    python benchmarks/distances.py          # some minutes of one core
    python benchmarks/distances.py --quick  # to see it work: seconds; no conclusions can be drawn

Pictures are those of `pixels.py`: a disc, 32 x 32 x 1. A distance is worth its rank correlation with how far the discs are
apart; those of throws and of pucks, with how far apart they have their top, and end. Places are spread evenly, or as those of
random genes, most of which leave the disc near the middle: what a run begins with.
"""

import argparse
import time
from collections.abc import Callable, Mapping

import numpy as np
from pixels import images, places
from scipy.spatial.distance import pdist
from scipy.stats import spearmanr

import auroraqd
from auroraqd.descriptors.distances import along_the_graph, flat, multiscale
from auroraqd.descriptors.scaling import Scaling

ROWS = (50, 100, 300, 1_000, 3_000)
NEIGHBOURS, LANDMARKS = (4, 8, 16, 32), (50, 200, 500)
NOISE = (0, 10, 30)  # deviation, of 255
JUDGED = 1_000  # rows whose distances are looked at, at most


def discs(n: int, bent: bool = False, noise: float = 0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """True places, (n, 2), and pictures."""
    rng = np.random.default_rng(seed)
    place = places(rng.random((n, 3))) if bent else rng.random((n, 2))
    seen = images(place)
    if noise:
        seen = np.clip(seen + rng.normal(0, noise, seen.shape), 0, 255).astype(np.uint8)
    return place, seen


def _paths(rows: np.ndarray, **options: int) -> np.ndarray:
    return along_the_graph(rows, np.random.default_rng(0), **options)


METRICS: Mapping[str, Callable[[np.ndarray, Scaling], np.ndarray]] = {
    "pixels": flat,
    "paths over pixels": lambda x, scaling: _paths(flat(x, scaling)),
    "blurred": multiscale,
    "paths over blurred": lambda x, scaling: _paths(multiscale(x, scaling)),
}


def worth(place: np.ndarray, coordinates: np.ndarray) -> float:
    """Rank correlation of distances with the true ones."""
    return float(spearmanr(pdist(place[:JUDGED]), pdist(coordinates[:JUDGED]))[0])


def by_rows(most: int) -> None:
    """How many pictures a graph needs, from even places, and from those of random genes."""
    print(f"| places | pictures | {' | '.join(METRICS)} |\n|---|---|{'---|' * len(METRICS)}")
    for bent in (False, True):
        for n in (n for n in ROWS if n <= most):
            place, x = discs(n, bent)
            found = [worth(place, metric(x, Scaling.pixels(x))) for metric in METRICS.values()]
            name = "of random genes" if bent else "even"
            print(f"| {name} | {n:,} | {' | '.join(f'{value:.2f}' for value in found)} |", flush=True)


def by_noise(n: int) -> None:
    """What noise of each pixel does."""
    print(f"\n| noise, of 255 | {' | '.join(METRICS)} |\n|---|{'---|' * len(METRICS)}")
    for noise in NOISE:
        place, x = discs(n, noise=noise)
        found = [worth(place, metric(x, Scaling.pixels(x))) for metric in METRICS.values()]
        print(f"| {noise} | {' | '.join(f'{value:.2f}' for value in found)} |", flush=True)


def by_graph(n: int) -> None:
    """Neighbours and landmarks, of paths over blurred pictures."""
    place, x = discs(n)
    blurred = multiscale(x, Scaling.pixels(x))
    print(f"\n| neighbours | {' | '.join(f'{m} landmarks' for m in LANDMARKS)} | seconds |\n|---|{'---|' * len(LANDMARKS)}---|")
    for k in NEIGHBOURS:
        found, seconds = [], []
        for landmarks in LANDMARKS:
            since = time.process_time()
            found.append(worth(place, _paths(blurred, neighbours=k, landmarks=landmarks)))
            seconds.append(time.process_time() - since)
        print(f"| {k} | {' | '.join(f'{value:.3f}' for value in found)} | {seconds[0]:.1f} to {seconds[-1]:.1f} |", flush=True)


def by_task(generations: int, n: int) -> None:
    """Trajectories of the paper's tasks, of repertoires that are spread evenly over the ground truth."""
    print("\n| task | trajectories | straight | paths |\n|---|---|---|---|")
    for task in (auroraqd.tasks.Ballistic(), auroraqd.tasks.AirHockey()):
        archive = auroraqd.Aurora(task.n_genes, "hand-coded", seed=0).run(task, generations=generations).archive
        rows = np.random.default_rng(0).permutation(len(archive))[:n]
        seen, truth = archive.observation[rows], archive.ground_truth[rows]
        straight = flat(seen, Scaling.of(seen))
        found = [worth(truth, coordinates) for coordinates in (straight, _paths(straight))]
        print(f"| {type(task).__name__} | {len(rows):,} | {' | '.join(f'{value:.2f}' for value in found)} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="100 pictures, of 10 generations")
    quick = parser.parse_args().quick
    by_rows(most=100 if quick else 3_000)
    by_noise(100 if quick else 1_000)
    by_graph(100 if quick else 3_000)
    by_task(10 if quick else 300, 100 if quick else 3_000)
