"""An arm loses a joint, and brings the puck where it should be again within a handful of trials.

AURORA finds what the whole arm can do with the puck, with no descriptor given. Then a joint is stuck at 0 and most skills end
elsewhere. `auroraqd.Adaptation` tries skills on the damaged arm and learns from each trial which promises of the repertoire
hold, as in A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.

Who can simulate damage can promise more: what each skill would do with a joint stuck here or there. None of these arms is the
one that it is, but trials tell which it is like.

    python examples/damage.py         # 1000 generations, ten goals for each of the four joints
"""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.tasks import air_hockey

TRIALS = 20
IMAGINED = [(joint, angle) for joint in range(air_hockey.JOINTS) for angle in (-0.6, -0.3, 0.3, 0.6)]  # rad; not 0, as it is
FAILS = 0.3  # m, how far promises of the arm that is the most like it may fail


def discovered(generations, restitution_threshold=1, folder="runs/damage", seed=1):
    """What the whole arm can do: the task, and a repertoire. Descriptors are learned from the path of the puck."""
    arm = auroraqd.tasks.AirHockey(restitution_threshold=restitution_threshold)
    aurora = auroraqd.Aurora(arm.n_genes, PCA(n_components=2), seed=seed)
    auroraqd.save(aurora.run(arm, generations=generations), folder)
    return arm, auroraqd.load(folder)


def without_joint(genotypes, joint, angle=0.0):
    """The same controllers with a joint that is stuck at an angle while the puck is there, whatever its two targets."""
    stuck = genotypes.copy()
    reached = 1 - np.exp(-air_hockey.RATE * air_hockey.PHASE)  # of the way to the first target
    stuck[:, joint] = (angle / reached / np.pi + 1) / 2
    stuck[:, joint + air_hockey.JOINTS] = (angle / np.pi + 1) / 2
    return stuck


def imagined(arm, repertoire):
    """Where each skill leaves the puck on the whole arm, and with a joint stuck: (17, n, 2)."""
    ends = [arm(without_joint(repertoire.genotype, *damage)).observation[:, -1] for damage in IMAGINED]
    return np.stack([repertoire.observation[:, -1], *ends])


def by_chance(arm, joint, rng, number=20_000):
    """Where random controllers leave the puck with the damaged arm; most do not touch it."""
    return arm(without_joint(rng.random((number, arm.n_genes)), joint)).observation[:, -1]


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
    several = imagined(arm, repertoire)
    rng = np.random.default_rng(0)
    print(f"{len(repertoire)} individuals. Distance to the goal after {TRIALS} trials, median of {goals} goals:")
    for joint in range(air_hockey.JOINTS):
        ends = arm(without_joint(repertoire.genotype, joint)).observation[:, -1]
        in_order, adapted, weighed = [], [], []
        for goal in away(by_chance(arm, joint, rng))[:goals]:
            distance = np.linalg.norm(ends - goal, axis=1)
            best_promises = np.linalg.norm(promised - goal, axis=1).argsort()[:TRIALS]
            in_order.append(distance[best_promises].min())
            adapted.append(distance[tried(auroraqd.Adaptation(how, promised, goal), ends)].min())
            weighed.append(distance[tried(auroraqd.Adaptation(how, several, goal, scale=FAILS), ends)].min())
        print(
            f"joint {joint + 1}: best promises in order {np.median(in_order):.3f} m, adaptation {np.median(adapted):.3f} m, "
            f"with damage imagined {np.median(weighed):.3f} m"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
