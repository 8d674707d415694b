"""An arm loses a joint, and brings the puck where it should be again within a handful of trials.

AURORA finds what the whole arm can do with the puck, with no descriptor given. Then a joint is stuck at 0 and most skills end
elsewhere. `auroraqd.Adaptation` tries skills on the damaged arm and learns from each trial which promises of the repertoire
hold, as in A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.

    python examples/damage.py           # 1000 generations, 30 goals for each of the four joints
    python examples/damage.py 1000 0    # with pucks that bounce at any speed, restitution_threshold=0
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report.style import STYLE
from auroraqd.tasks import air_hockey

TRIALS = 20
FOLDER = Path("runs/damage")
COLORS = {
    "random controllers": "#bbbbbb",
    "random skills": "#888888",
    "best promises in order": "#2646a0",
    "adaptation, performance over descriptor": "#e0a020",
    "adaptation, outcome over descriptor and genes": "#c8287a",
}


def without_joint(genotypes, joint):
    """The same controllers with a joint that is stuck at 0, whatever its two target angles."""
    stuck = genotypes.copy()
    stuck[:, [joint, joint + air_hockey.JOINTS]] = 0.5
    return stuck


def tried(adaptation, outcomes):
    """The rows of the skills that are tried, given what each would do."""
    rows = []
    for _ in range(TRIALS):
        rows.append(adaptation.ask())
        adaptation.tell(rows[-1], outcomes[rows[-1]])  # here the trial on the robot would be
    return rows


def main(generations=1000, restitution_threshold=1):
    # The repertoire of the whole robot. Descriptors are learned from the path of the puck.
    arm = auroraqd.tasks.AirHockey(restitution_threshold=restitution_threshold)
    aurora = auroraqd.Aurora(arm.n_genes, PCA(n_components=2), seed=1)
    auroraqd.save(aurora.run(arm, generations=generations), FOLDER)
    repertoire = auroraqd.load(FOLDER)
    promised = repertoire.observation[:, -1]  # where the puck ends
    how = np.hstack([repertoire.descriptor, repertoire.genotype])  # what the puck does, and by which movement

    rng = np.random.default_rng(0)
    errors = {name: [] for name in COLORS} | {"floor": []}
    shown = []
    for joint in range(air_hockey.JOINTS):
        done = arm(without_joint(repertoire.genotype, joint)).observation  # all skills on the damaged robot: for the floor
        ends = done[:, -1]
        reached = arm(without_joint(rng.random((20_000, arm.n_genes)), joint)).observation[:, -1]
        goals = reached[np.linalg.norm(reached - air_hockey.START, axis=1) > 0.1][: max(1, min(30, generations // 5))]
        for goal in goals:  # places that the damaged robot can reach
            distance = np.linalg.norm(ends - goal, axis=1)
            promise = -np.linalg.norm(promised - goal, axis=1)
            in_order = np.argsort(-promise)[:TRIALS]
            plain = tried(auroraqd.Adaptation(repertoire.descriptor, promise), -distance)
            rows = tried(auroraqd.Adaptation(how, promised, goal), ends)
            chance = np.linalg.norm(rng.permutation(reached)[:TRIALS] - goal, axis=1)
            chosen = rng.choice(len(repertoire), TRIALS, replace=False)
            found = [chance, distance[chosen], distance[in_order], distance[plain], distance[rows]]
            for name, error in zip(COLORS, found, strict=True):
                errors[name].append(np.minimum.accumulate(error))
            errors["floor"].append(np.full(TRIALS, distance.min()))
            best = rows[int(distance[rows].argmin())]
            shown.append((distance[best], joint, goal, repertoire.observation[rows[0]], done[rows[0]], done[best], best))
    errors = {name: np.array(values) for name, values in errors.items()}

    print(
        f"{len(repertoire)} individuals, {len(shown)} goals. Distance to the goal in metres, median (quartiles), after 1, 5, 10"
    )
    print("and 20 trials; share of the goals within 0.1 m after 5, 10 and 20")
    for name, error in errors.items():
        quartiles = np.quantile(error[:, [0, 4, 9, 19]], (0.5, 0.25, 0.75), axis=0).T
        cells = [f"{middle:.3f} ({low:.3f}, {high:.3f})" for middle, low, high in quartiles]
        cells += [f"{share:.0%}" for share in (error[:, [4, 9, 19]] < 0.1).mean(axis=0)]
        print(f"{name:50}" + "  ".join(cells))
    third = sorted((case for case in shown if case[1] == 2), key=lambda case: case[0])
    draw(errors, third[len(third) // 2], repertoire)  # the median goal of the third joint


def draw(errors, case, repertoire):
    """Trials against the distance to the goal, and one goal."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 4.8), layout="constrained")
        curves, room = figure.subplots(1, 2, width_ratios=(1.15, 1))
        steps = np.arange(1, TRIALS + 1)
        for name, color in COLORS.items():
            low, middle, high = np.quantile(errors[name], (0.25, 0.5, 0.75), axis=0)
            curves.fill_between(steps, low, high, color=color, alpha=0.15, linewidth=0)
            curves.plot(steps, middle, color=color, label=name, linewidth=1.8)
        floor = f"{1000 * np.median(errors['floor']):.1f} mm: the best of all skills, were all tried"
        curves.text(0.02, 0.03, floor, transform=curves.transAxes)
        curves.set(xlabel="trials on the damaged arm", ylabel="distance to the goal (m)")
        curves.set(yscale="log", ylim=(0.005, 3), xticks=(1, 5, 10, 15, 20))
        curves.yaxis.set_major_formatter("{x:g}")
        curves.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.45, -0.13), ncols=2)

        _, joint, goal, promised, first, found, row = case
        wall = air_hockey.WALL
        room.add_patch(Rectangle((-wall, -wall), 2 * wall, 2 * wall, fill=False, linewidth=1.5))
        pose = air_hockey.joints(without_joint(repertoire.genotype[row : row + 1], joint))[0, -1]
        room.plot(*pose.T, "o-", color="#444444", markersize=3, linewidth=1.5)
        room.plot(*pose[joint], "x", color="#d02020", markersize=10, markeredgewidth=2.5, label=f"joint {joint + 1}, stuck")
        room.add_patch(Circle(goal, air_hockey.PUCK, fill=False, linestyle="--", label="goal"))
        for path, color, style, name in (
            (promised, "#888888", "--", "promised, first trial"),
            (first, "#2646a0", "-", "first trial"),
            (found, "#c8287a", "-", f"found in {TRIALS} trials"),
        ):
            room.plot(*np.vstack([air_hockey.START, path]).T, style, color=color, label=name, linewidth=1.6)
            room.add_patch(Circle(path[-1], air_hockey.PUCK, color=color, alpha=0.4, linewidth=0))
        room.set(aspect="equal", xlim=(-1.02, 1.02), ylim=(-1.02, 1.02))
        room.axis("off")
        room.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
        figure.savefig(FOLDER / "damage.png", dpi=150)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
