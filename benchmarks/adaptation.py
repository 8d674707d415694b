"""What a repertoire is worth on an arm that lost a joint, and which part of the adaptation does it.

    python benchmarks/adaptation.py                              # some minutes; the figure is runs/damage/damage.png
    python benchmarks/adaptation.py --restitution-threshold 0    # with pucks that bounce at any speed
    python benchmarks/adaptation.py --quick                      # to see it work: seconds; no conclusions can be drawn

The robot, its damage and the trials are those of examples/damage.py. Distances are those of the best trial so far. Tests are
Wilcoxon signed-rank tests, two-sided, over the goals.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from scipy.spatial import KDTree
from scipy.stats import wilcoxon

import auroraqd
from auroraqd.report.style import STYLE
from auroraqd.tasks import air_hockey

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
from damage import FAILS, TRIALS, away, by_chance, discovered, imagined, tried, without_joint

FOLDER = Path("runs/damage")
QUICK = {"goals": 1, "generations": 20, "chances": 2_000, "folder": FOLDER / "quick"}
LOOKS = (5, 10, 20)  # trials after which distances are compared
NEAR = 0.1  # m
IN_ORDER = "best promises in order"
PERFORMANCE = "adaptation, performance over descriptor"
OUTCOME = "adaptation, outcome over descriptor and genes"
SEVERAL = "the same, with damage imagined"
BEST = "best of all skills, were all tried"
BOTH = "descriptor and genotype"
COLORS = {
    "random controllers": "#bbbbbb",
    "random skills": "#888888",
    IN_ORDER: "#2646a0",
    PERFORMANCE: "#e0a020",
    OUTCOME: "#c8287a",
    SEVERAL: "#1f7a6f",
}


class Case(NamedTuple):
    """A goal for the arm that lost a joint."""

    joint: int
    goal: np.ndarray  # (2,)
    reached: np.ndarray  # (k, 2), by random controllers of the damaged arm
    paths: np.ndarray  # (n, 50, 2), of the puck, by all skills on the damaged arm

    @property
    def ends(self) -> np.ndarray:
        """Where the skills bring the puck, (n, 2)."""
        return self.paths[:, -1]

    @property
    def distance(self) -> np.ndarray:
        """Of the skills, (n,)."""
        return np.linalg.norm(self.ends - self.goal, axis=1)


def cases(arm, repertoire, goals: int, chances: int, rng) -> Iterator[Case]:
    """So many goals for each joint, of the outcomes of so many random controllers."""
    for joint in range(air_hockey.JOINTS):
        paths = arm(without_joint(repertoire.genotype, joint)).observation
        reached = by_chance(arm, joint, rng, chances)
        for goal in away(reached)[:goals]:
            yield Case(joint, goal, reached, paths)


def in_order(case: Case, promised: np.ndarray) -> np.ndarray:
    """The rows of the skills that promise most."""
    return np.linalg.norm(promised - case.goal, axis=1).argsort()[:TRIALS]


def by_performance(case: Case, space: np.ndarray, promised: np.ndarray) -> list[int]:
    """The rows that are tried when trials say how good they were."""
    return tried(auroraqd.Adaptation(space, -np.linalg.norm(promised - case.goal, axis=1)), -case.distance)


def by_outcome(case: Case, space: np.ndarray, promised: np.ndarray) -> list[int]:
    """The rows that are tried when trials say where the puck went."""
    return tried(auroraqd.Adaptation(space, promised, case.goal), case.ends)


def by_several(case: Case, space: np.ndarray, promises: np.ndarray) -> list[int]:
    """The rows that are tried when there are promises for robots that are damaged in other ways."""
    return tried(auroraqd.Adaptation(space, promises, case.goal, scale=FAILS), case.ends)


def so_far(distances: dict[str, list[np.ndarray]]) -> dict[str, np.ndarray]:
    """Distance of the best trial so far, (goals, trials), from those of each."""
    return {name: np.minimum.accumulate(values, axis=1) for name, values in distances.items()}


def spaces_of(repertoire) -> dict[str, np.ndarray]:
    """What skills may be close in."""
    both = np.hstack([repertoire.descriptor, repertoire.genotype])
    return {"descriptor": repertoire.descriptor, "genotype": repertoire.genotype, BOTH: both}


def compare(arm, repertoire, goals: int, chances: int) -> tuple[list[Case], dict[str, np.ndarray]]:
    """The goals; and distances by what chooses the trials, with those of the best of all skills."""
    promised, spaces, rng = repertoire.observation[:, -1], spaces_of(repertoire), np.random.default_rng(0)
    promises = imagined(arm, repertoire)
    seen, found = [], {name: [] for name in (*COLORS, BEST)}
    for case in cases(arm, repertoire, goals, chances, rng):
        seen.append(case)
        found["random controllers"].append(np.linalg.norm(rng.permutation(case.reached)[:TRIALS] - case.goal, axis=1))
        found["random skills"].append(case.distance[rng.choice(len(repertoire), TRIALS, replace=False)])
        found[IN_ORDER].append(case.distance[in_order(case, promised)])
        found[PERFORMANCE].append(case.distance[by_performance(case, spaces["descriptor"], promised)])
        found[OUTCOME].append(case.distance[by_outcome(case, spaces[BOTH], promised)])
        found[SEVERAL].append(case.distance[by_several(case, spaces[BOTH], promises)])
        found[BEST].append(np.full(TRIALS, case.distance.min()))
    return seen, so_far(found)


def ablate(arm, repertoire, goals: int, chances: int) -> dict[str, np.ndarray]:
    """Distances for each space with each of what trials may tell, on other goals."""
    promised, spaces = repertoire.observation[:, -1], spaces_of(repertoire)
    found = {f"{told}, {space}": [] for told in ("performance", "outcome") for space in spaces} | {IN_ORDER: []}
    for case in cases(arm, repertoire, goals, chances, np.random.default_rng(1)):
        for name, space in spaces.items():
            found[f"performance, {name}"].append(case.distance[by_performance(case, space, promised)])
            found[f"outcome, {name}"].append(case.distance[by_outcome(case, space, promised)])
        found[IN_ORDER].append(case.distance[in_order(case, promised)])
    return so_far(found)


def table(distances: dict[str, np.ndarray]) -> None:
    """Medians, quartiles, and the share of the goals that are near."""
    print(f"| | 1 trial | 5 trials | 10 trials | 20 trials | 5, 10, 20 trials: within {NEAR:g} m |\n|---|---|---|---|---|---|")
    for name in COLORS:
        quartiles = np.quantile(distances[name][:, [0, 4, 9, 19]], (0.5, 0.25, 0.75), axis=0).T
        cells = [f"{middle:.3f} ({low:.3f}, {high:.3f})" for middle, low, high in quartiles]
        near = ", ".join(f"{(distances[name][:, look - 1] < NEAR).mean():.0%}" for look in LOOKS)
        print(f"| {name} | {' | '.join(cells)} | {near} |")
    print(f"| {BEST} | {np.median(distances[BEST]):.4f} | | | | |")


def beside(ours: np.ndarray, theirs: np.ndarray) -> list[str]:
    """The share of the goals for which ours are shorter, and longer; and whether that may be chance."""
    return [f"{(ours < theirs).mean():.0%}", f"{(ours > theirs).mean():.0%}", f"{wilcoxon(ours, theirs).pvalue:.2g}"]


def tests(distances: dict[str, np.ndarray]) -> None:
    """Each adaptation beside promises in order."""
    print(f"\n### Beside {IN_ORDER}\n\n| | trials | shorter | longer | p |\n|---|---|---|---|---|")
    for name in (PERFORMANCE, OUTCOME, SEVERAL):
        for look in LOOKS:
            cells = beside(distances[name][:, look - 1], distances[IN_ORDER][:, look - 1])
            print(f"| {name} | {look} | {' | '.join(cells)} |")


def ablation(distances: dict[str, np.ndarray]) -> None:
    """Medians; for how many goals the last is shorter and longer than by promises in order, and the test."""
    print(
        "| what trials tell, space | 5 trials | 10 trials | 20 trials | shorter | longer | p |\n|---|---|---|---|---|---|---|"
    )
    for name, values in distances.items():
        cells = [f"{np.median(values[:, look - 1]):.3f}" for look in LOOKS]
        cells += beside(values[:, -1], distances[IN_ORDER][:, -1]) if name != IN_ORDER else [""] * 3
        print(f"| {name} | {' | '.join(cells)} |")


def displacements(arm, repertoire) -> None:
    """How differently the damage displaces the outcomes of two skills that are close."""
    print("| joint | nearest in descriptor space | nearest in genotype space | any two |\n|---|---|---|---|")
    spaces = spaces_of(repertoire)
    pairs = nearest(spaces["descriptor"]), nearest(spaces["genotype"]), np.random.default_rng(0).permutation(len(repertoire))
    for joint in range(air_hockey.JOINTS):
        moved = arm(without_joint(repertoire.genotype, joint)).observation[:, -1] - repertoire.observation[:, -1]
        apart = [np.median(np.linalg.norm(moved - moved[rows], axis=1)) for rows in pairs]
        print(f"| {joint + 1} | {' | '.join(f'{metres:.2f}' for metres in apart)} |")


def nearest(space: np.ndarray) -> np.ndarray:
    """The nearest other row of each, columns scaled to a spread of 1 as in `auroraqd.Adaptation`."""
    scaled = space / space.std(axis=0)
    return KDTree(scaled).query(scaled, k=2)[1][:, 1]


def draw(cases: list[Case], distances: dict[str, np.ndarray], repertoire, path: Path) -> None:
    """Trials against the distance to the goal; and one goal.

    Of those of the third joint that the first trial misses, it is the one with the median distance in the end.
    """
    third = [row for row, case in enumerate(cases) if case.joint == 2]
    third = [row for row in third if distances[OUTCOME][row, 0] > NEAR] or third
    shown = cases[sorted(third, key=lambda row: distances[OUTCOME][row, -1])[len(third) // 2]]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 4.8), layout="constrained")
        curves, room = figure.subplots(1, 2, width_ratios=(1.15, 1))
        draw_curves(curves, distances)
        draw_room(room, shown, repertoire)
        figure.savefig(path, dpi=150)


def draw_curves(axes, distances: dict[str, np.ndarray]) -> None:
    """Medians and quartiles."""
    steps = np.arange(1, TRIALS + 1)
    for name, color in COLORS.items():
        low, middle, high = np.quantile(distances[name], (0.25, 0.5, 0.75), axis=0)
        axes.fill_between(steps, low, high, color=color, alpha=0.15, linewidth=0)
        axes.plot(steps, middle, color=color, label=name, linewidth=1.8)
    axes.text(0.02, 0.03, f"{1000 * np.median(distances[BEST]):.1f} mm: the {BEST}", transform=axes.transAxes)
    axes.set(xlabel="trials on the damaged arm", ylabel="distance to the goal (m)")
    axes.set(yscale="log", ylim=(0.005, 3), xticks=(1, 5, 10, 15, 20))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.45, -0.13), ncols=2)


def draw_room(axes, case: Case, repertoire) -> None:
    """What was promised, what happened, and what was found."""
    rows = by_outcome(case, spaces_of(repertoire)[BOTH], repertoire.observation[:, -1])
    best = rows[int(case.distance[rows].argmin())]
    wall = air_hockey.WALL
    axes.add_patch(Rectangle((-wall, -wall), 2 * wall, 2 * wall, fill=False, linewidth=1.5))
    pose = air_hockey.joints(without_joint(repertoire.genotype[best : best + 1], case.joint))[0, -1]
    axes.plot(*pose.T, "o-", color="#444444", markersize=3, linewidth=1.5)
    stuck = f"joint {case.joint + 1}, stuck"
    axes.plot(*pose[case.joint], "x", color="#d02020", markersize=10, markeredgewidth=2.5, label=stuck)
    axes.add_patch(Circle(case.goal, air_hockey.PUCK, fill=False, linestyle="--", label="goal"))
    for path, color, style, name in (
        (repertoire.observation[rows[0]], "#888888", "--", "promised, first trial"),
        (case.paths[rows[0]], "#2646a0", "-", "first trial"),
        (case.paths[best], "#c8287a", "-", f"found in {TRIALS} trials"),
    ):
        axes.plot(*np.vstack([air_hockey.START, path]).T, style, color=color, label=name, linewidth=1.6)
        axes.add_patch(Circle(path[-1], air_hockey.PUCK, color=color, alpha=0.4, linewidth=0))
    axes.set(aspect="equal", xlim=(-1.02, 1.02), ylim=(-1.02, 1.02))
    axes.axis("off")
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)


def main(
    goals: int = 30,
    generations: int = 1000,
    restitution_threshold: float = 1,
    seed: int = 1,
    chances: int = 20_000,
    folder: Path = FOLDER,
) -> None:
    run = folder / f"seed-{seed}-threshold-{restitution_threshold:g}-generations-{generations}"
    arm, repertoire = discovered(generations, restitution_threshold, run, seed)
    number = goals * air_hockey.JOINTS
    print(f"### An arm that lost a joint: {len(repertoire):,} skills, {number} goals, distance in metres, median (quartiles)\n")
    seen, distances = compare(arm, repertoire, goals, chances)
    table(distances)
    tests(distances)
    draw(seen, distances, repertoire, folder / "damage.png")
    print(f"\n### Which change does it: {number} other goals, medians; after {TRIALS} trials beside {IN_ORDER}\n", flush=True)
    ablation(ablate(arm, repertoire, goals, chances))
    print("\n### By how much the displacements of two skills differ, metres, median\n")
    displacements(arm, repertoire)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=30, help="for each joint")
    parser.add_argument("--generations", type=int, default=1000, help="of the repertoire")
    parser.add_argument("--restitution-threshold", type=float, default=1, help="m/s, slower impacts do not bounce")
    parser.add_argument("--seed", type=int, default=1, help="of the repertoire")
    parser.add_argument("--quick", action="store_true", help="1 goal, 20 generations, into runs/damage/quick")
    options = vars(parser.parse_args())
    main(**options | (QUICK if options.pop("quick") else {}))
