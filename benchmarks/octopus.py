"""How many ways the octopus arm learns to reach and to bend: AURORA, a hand-coded descriptor, and random controllers, beside
each other on the same budget.

    pip install ".[robots]"
    python benchmarks/octopus.py      # three seeds of 3,000 evaluations each: a quarter of an hour of one core
    python benchmarks/octopus.py --quick    # to see it work: seconds; no conclusions can be drawn

`auroraqd.tasks.OctopusArm`, a soft bar in water, bent for two seconds by 16 muscles along curves of 48 genes. AURORA sees where
four points along it are at twenty moments, and learns three numbers from these 240 by PCA; the hand-coded descriptor is where
its tip ends, in three dimensions. Both select by novelty, vary by Iso+LineDD and keep about a thousand individuals. (With
uniform selection and smaller steps, as in benchmarks/hexapod.py, neither is better than chance.) Two measures: the space that
tips end in, in cubes of 4 cm; and in how many shapes the arm ends, by where its middle and its tip are in cubes of 10 cm. Of
random controllers all that were evaluated count. Runs that are in the folder are not done again.
"""

from typing import Any

import numpy as np
from ant import Comparison, Measure, compare, options_of
from sklearn.decomposition import PCA

import auroraqd

SIDE, COARSE = 0.04, 0.1  # m
STEPS = 0.05, 0.3  # of Iso+LineDD
LITRES = 1000  # in a cubic metre


def octopus() -> Comparison:
    """The task, and what is measured."""
    task = auroraqd.tasks.OctopusArm(threads=1)
    measures = {
        "space": Measure("Space that tips end in, l", lambda found: LITRES * SIDE**3 * cubes(found.ground_truth, SIDE)),
        "shapes": Measure("Shapes in the end", lambda found: cubes(shapes(found.observation), COARSE)),
    }
    options = {
        "selection": auroraqd.Novelty(),
        "variation": auroraqd.IsoLine(*STEPS),
        "resolution": auroraqd.Size(1_000),
        "schedule": auroraqd.Doubling(10),
    }
    return Comparison(task, task.n_genes, PCA(n_components=3), options, measures)


def shapes(seen: Any) -> np.ndarray:
    """Where the middle and the tip are in the end, (n, 6), of what is seen, (n, samples, 12)."""
    end = np.asarray(seen)[:, -1].reshape(len(seen), 4, 3)
    return end[:, [1, 3]].reshape(len(seen), -1)


def cubes(places: Any, side: float) -> int:
    """That places, (n, d), are in."""
    return len(np.unique(np.floor(np.asarray(places) / side), axis=0))


def main() -> None:
    options = options_of(str(__doc__), 3, 60, "results/octopus")
    compare(octopus(), options.out / "found.csv", options.seeds, options.generations, options.batch)


if __name__ == "__main__":
    main()
