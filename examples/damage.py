"""An arm loses a joint, and brings the puck where it should be again within a handful of trials.

AURORA finds what the whole arm can do with the puck, with no descriptor given. Then a joint is stuck at 0 and most skills end
elsewhere. `auroraqd.Adaptation` tries skills on the damaged arm and learns from each trial which promises of the repertoire
hold, as in A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.

    python examples/damage.py         # 1000 generations, ten goals for each of the four joints
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.tasks import air_hockey

TRIALS = 20


def discovered(generations, restitution_threshold=1, folder="runs/damage", seed=1):
    """What the whole arm can do: the task, and a repertoire. Descriptors are learned from the path of the puck."""
    arm = auroraqd.tasks.AirHockey(restitution_threshold=restitution_threshold)
    aurora = auroraqd.Aurora(arm.n_genes, PCA(n_components=2), seed=seed)
    auroraqd.save(aurora.run(arm, generations=generations), folder)
    return arm, auroraqd.load(folder)


def without_joint(genotypes, joint):
    """The same controllers with a joint that is stuck at 0, whatever its two target angles."""
    stuck = genotypes.copy()
    stuck[:, [joint, joint + air_hockey.JOINTS]] = 0.5
    return stuck


def by_chance(arm, joint, rng):
    """Where random controllers leave the puck with the damaged arm; most do not touch it."""
    return arm(without_joint(rng.random((20_000, arm.n_genes)), joint)).observation[:, -1]


def away(places):
    """Those of the places to which the puck has to be moved: goals, for the damaged arm can reach them."""
    return places[np.linalg.norm(places - air_hockey.START, axis=1) > 0.1]


def tried(adaptation, outcomes):
    """The rows of the skills that are tried, given what each would do."""
    rows = []
    for _ in range(TRIALS):
        rows.append(adaptation.ask())
        adaptation.tell(rows[-1], outcomes[rows[-1]])  # here the trial on the robot would be
    return rows


def main(generations=1000, goals=10):
    arm, repertoire = discovered(generations)
    promised = repertoire.observation[:, -1]  # where the puck ends
    how = np.hstack([repertoire.descriptor, repertoire.genotype])  # what the puck does, and by which movement
    rng = np.random.default_rng(0)
    print(f"{len(repertoire)} individuals. Distance to the goal after {TRIALS} trials, median of {goals} goals:")
    for joint in range(air_hockey.JOINTS):
        ends = arm(without_joint(repertoire.genotype, joint)).observation[:, -1]
        in_order, adapted = [], []
        for goal in away(by_chance(arm, joint, rng))[:goals]:
            distance = np.linalg.norm(ends - goal, axis=1)
            best_promises = np.linalg.norm(promised - goal, axis=1).argsort()[:TRIALS]
            in_order.append(distance[best_promises].min())
            adapted.append(distance[tried(auroraqd.Adaptation(how, promised, goal), ends)].min())
        print(f"joint {joint + 1}: best promises in order {np.median(in_order):.3f} m, adaptation {np.median(adapted):.3f} m")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
