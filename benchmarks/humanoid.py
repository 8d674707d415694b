"""How many ways Humanoid learns to move: AURORA, a hand-coded descriptor, and random controllers, on the same budget.

    pip install ".[robots]"
    python benchmarks/humanoid.py     # three seeds of 3,000 evaluations: half an hour of one busy core
    python benchmarks/humanoid.py --quick    # to see it work: seconds; no conclusions can be drawn

Humanoid-v5 of Gymnasium, 17 joints, moved for a second and a half by sinusoids of 52 genes. AURORA senses how it holds itself,
not where it is: the height and orientation of its torso and the angles of its joints, at twenty moments; it learns six numbers
from these 440 by PCA. The hand-coded descriptor is where it ends. Both select uniformly, vary by Iso+LineDD and keep about a
thousand individuals, as in benchmarks/hexapod.py. Two measures: the area covered by where individuals end, in squares of 25 cm;
and in how many ways they lie in the end, which are the directions of gravity that the torso feels, x, y and z in cells of a
quarter. Of random controllers all that were evaluated count. Runs that are in the folder are not done again.
"""

from typing import Any

import numpy as np
from ant import Comparison, Measure, area_of, compare, options_of
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.tasks import Evaluation, Gym

SIDE, CELL = 0.25, 0.25  # m, and a share of gravity


def humanoid() -> Comparison:
    """The task, and what is measured."""
    gym = Gym("Humanoid-v5", steps=100, samples=20, positions=range(24), threads=1)

    def task(genotypes: np.ndarray) -> Evaluation:
        fitness, poses, last = gym(genotypes)
        return Evaluation(fitness, poses[..., 2:], None if last is None else last[:, :2])

    measures = {
        "area": Measure("Area covered by final positions, m²", lambda found: area_of(found.ground_truth, SIDE)),
        "ways": Measure("Ways to lie in the end", lambda found: ways_to_lie(found.observation)),
    }
    options = {
        "selection": auroraqd.Uniform(),
        "variation": auroraqd.IsoLine(0.02, 0.2),
        "resolution": auroraqd.Size(1_000),
        "schedule": auroraqd.Doubling(10),
    }
    return Comparison(task, gym.n_genes, PCA(n_components=6), options, measures)


def ways_to_lie(poses: Any) -> int:
    """Cells of the direction of gravity that the torso feels in the end, of poses, (n, samples, 22)."""
    w, x, y, z = np.asarray(poses)[:, -1, 1:5].T  # after the height
    down = -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)], axis=1)
    return len(np.unique(np.floor(down / CELL), axis=0))


def main() -> None:
    options = options_of(str(__doc__), 3, 60, "results/humanoid")
    compare(humanoid(), options.out / "found.csv", options.seeds, options.generations, options.batch)


if __name__ == "__main__":
    main()
