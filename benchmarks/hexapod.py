"""A hexapod learns to walk, is damaged, and walks again: what repertoires are worth then, and which trials find it.

    pip install ".[robots]"
    python benchmarks/hexapod.py --out results/hexapod                           # 5 seeds, 6,000 evaluations a run
    python benchmarks/hexapod.py --evaluations 20000 --out results/hexapod-long  # more of the same
    python benchmarks/hexapod.py --quick    # to see it work: seconds; no conclusions can be drawn

After A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015. Two repertoires are
found with the same budget: the hand-coded one of the article, MAP-Elites over the share of time for which each foot touches the
floor, five levels a leg; and that of AURORA, which learns six numbers by PCA from which feet touch the floor when. Fitness is
speed; both select uniformly and vary by Iso+LineDD. Then each damage of `auroraqd.tasks.DAMAGES`, with 20 trials;
a trial that ends in a fall has speed 0. "Damage imagined": promises are the speeds of all gaits on the whole robot and with
each of the other damages, simulated before. Runs and trials that are in the folder are not done again.
"""

import argparse
import csv
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from robots import BATCH as ROBOTS
from robots import microseconds
from scipy.stats import ranksums, wilcoxon
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.experiments.statistics import Quartiles
from auroraqd.report.robots import Studio
from auroraqd.report.style import STYLE, save_figure
from auroraqd.tasks import DAMAGES, Hexapod

TRIALS, LOOKS = 20, (1, 5, 10, 20)
BATCH = 100
AURORA, HAND_CODED = "AURORA", "hand-coded"
RANDOM, IN_ORDER = "random skills", "best promises in order"
ARTICLE, OURS = "adaptation, as in the article", "adaptation, over descriptor and genes"
SEVERAL = "the same, with other damage imagined"
COLORS = {RANDOM: "#999999", IN_ORDER: "#2646a0", ARTICLE: "#e0a020", OURS: "#c8287a", SEVERAL: "#1f7a6f"}

# Of the article: kappa 0.05, noise of variance 0.001, a kernel of variance 1 (m/s)^2 and of length 0.4, which are shares of the
# time. `Adaptation` scales columns to a spread of 1, which here is 0.25 of the time, and takes root mean squares.
ADAPTATION: Any = {"kappa": 0.05, "noise": 0.001**0.5, "scale": 1.0, "length": 0.4 / (0.25 * 6**0.5)}


class Trial(NamedTuple):
    """One trial on a damaged robot."""

    variant: str
    seed: int
    damage: str
    method: str
    trial: int  # 1 is the first
    speed: float  # m/s
    enough: bool  # whether the article would stop after it


def cells() -> auroraqd.GridArchive:
    """Those of the article: shares of 0, 1/4, 1/2, 3/4 and 1 are in the middles of five, for each leg."""
    return auroraqd.GridArchive((5,) * 6, low=-0.125, high=1.125)


def discovered(variant: str, seed: int, evaluations: int, folder: Path) -> auroraqd.Repertoire:
    """The repertoire of a run, which is done if it is not in the folder."""
    place = folder / f"{variant}-{seed}"
    if not place.exists():
        hexapod = Hexapod(threads=1)
        if variant == HAND_CODED:
            options: dict[str, Any] = {"transformer": "hand-coded", "archive": cells()}
        else:
            options = {
                "transformer": PCA(n_components=6),
                "resolution": auroraqd.Size(1_000),
                "schedule": auroraqd.Doubling(10),
            }
        aurora = auroraqd.Aurora(
            hexapod.n_genes,
            options.pop("transformer"),
            seed=seed,
            batch_size=BATCH,
            selection=auroraqd.Uniform(),
            variation=auroraqd.IsoLine(0.02, 0.2),
            **options,
        )
        auroraqd.save(aurora.run(hexapod, evaluations=evaluations), place)
    return auroraqd.load(place)


def speeds(hexapod: Hexapod, genotypes: np.ndarray) -> np.ndarray:
    """Of trials, (n,) m/s; of those that end in a fall 0."""
    return np.nan_to_num(hexapod(genotypes).fitness, nan=0.0)


def imagined(repertoire: auroraqd.Repertoire, damages: Sequence[str], place: Path) -> dict[str, np.ndarray]:
    """The speed of each gait with each damage, (n,), simulated if it is not in the file."""
    if not place.exists():
        found = [speeds(Hexapod(damage=damage, threads=1), repertoire.genotype) for damage in damages]
        np.save(place, np.array(found))
    return dict(zip(damages, np.load(place), strict=True))


def tried(
    hexapod: Hexapod, repertoire: auroraqd.Repertoire, method: str, others: list[np.ndarray], rng
) -> Iterator[tuple[float, bool]]:
    """The speed of each trial; and whether the best until then is 0.9 of all that is expected of others.

    `others` are the speeds of the gaits with other damages.
    """
    rows = min(TRIALS, len(repertoire))
    if method in (RANDOM, IN_ORDER):
        order = rng.permutation(len(repertoire)) if method == RANDOM else (-repertoire.fitness).argsort()
        yield from ((float(speed), False) for speed in speeds(hexapod, repertoire.genotype[order[:rows]]))
        return
    if method == ARTICLE:
        adaptation = auroraqd.Adaptation(repertoire.descriptor, repertoire.fitness, **ADAPTATION)
    else:
        promise = [repertoire.fitness, *others] if method == SEVERAL else repertoire.fitness
        adaptation = auroraqd.Adaptation(np.hstack([repertoire.descriptor, repertoire.genotype]), promise)
    for _ in range(rows):
        row = adaptation.ask()
        speed = float(speeds(hexapod, repertoire.genotype[row : row + 1])[0])
        adaptation.tell(row, speed)
        yield speed, adaptation.best.performance >= 0.9 * adaptation.expected


def trials_of(
    variant: str, seed: int, damage: str, repertoire: auroraqd.Repertoire, promises: dict[str, np.ndarray]
) -> list[Trial]:
    """All methods on one damaged robot."""
    hexapod, rng = Hexapod(damage=damage, threads=1), np.random.default_rng(seed)
    others = [promise for name, promise in promises.items() if name != damage]
    return [
        Trial(variant, seed, damage, method, number, speed, enough)
        for method in COLORS
        for number, (speed, enough) in enumerate(tried(hexapod, repertoire, method, others, rng), start=1)
    ]


def read(path: Path) -> list[Trial]:
    """The trials of a table."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    return [
        Trial(variant, int(seed), damage, method, int(trial), float(speed), enough == "True")
        for variant, seed, damage, method, trial, speed, enough in rows
    ]


def write(path: Path, trials: list[Trial]) -> None:
    """Write a table."""
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(Trial._fields)
        table.writerows(trials)


class Results:
    """Speeds that were found, by what chose the trials.

    Args:
        trials: of all.
        best: before the damage, by variant and seed, m/s.
    """

    def __init__(self, trials: list[Trial], best: dict[tuple[str, int], float]):
        self.best, self._speeds, self._enough = best, {}, {}
        self.damages = list(dict.fromkeys(trial.damage for trial in trials))
        for trial in trials:
            key = trial.variant, trial.method, trial.damage, trial.seed
            self._speeds.setdefault(key, []).append(trial.speed)
            self._enough.setdefault(key, []).append(trial.enough)

    def found(self, variant: str, method: str, damage: str | None = None, *, share: bool = True) -> np.ndarray:
        """The best speed so far, (cases, trials), as a share of the best before the damage, or in m/s. Cases are damages, if
        none is said, times seeds.
        """
        keys = [key for key in self._speeds if key[:2] == (variant, method) and damage in (None, key[2])]
        return np.array(
            [np.maximum.accumulate(self._speeds[key]) / (self.best[variant, key[3]] if share else 1) for key in keys]
        )

    def stopped(self, variant: str, method: str) -> np.ndarray:
        """After how many trials the article would stop, (cases,); 20 where never."""
        keys = [key for key in self._speeds if key[:2] == (variant, method)]
        return np.array([np.argmax([*self._enough[key][:-1], True]) + 1 for key in keys])


def in_words(values: np.ndarray, digits: int = 2) -> str:
    """Median and quartiles."""
    middle, low, high = Quartiles.of(values)
    return f"{middle:.{digits}f} ({low:.{digits}f}, {high:.{digits}f})"


def report_repertoires(repertoires: dict[tuple[str, int], auroraqd.Repertoire]) -> None:
    """What each run found: medians and quartiles over seeds, and rank-sum tests."""
    measures: dict[str, Callable[[auroraqd.Repertoire], float]] = {
        "individuals": len,
        "cells of the hand-coded grid": lambda found: len(np.unique(cells().cell_of(found.ground_truth))),
        "best speed, m/s": lambda found: float(found.fitness.max()),
    }
    print(f"| | {AURORA} | {HAND_CODED} | rank-sum p |\n|---|---|---|---|")
    for name, measure in measures.items():
        both = [np.array([measure(r) for (v, _), r in repertoires.items() if v == variant]) for variant in (AURORA, HAND_CODED)]
        digits = 3 if "speed" in name else 0
        print(f"| {name} | {' | '.join(in_words(b, digits) for b in both)} | {ranksums(*both).pvalue:.2g} |")


def report_trials(results: Results) -> None:
    """Shares recovered, speeds, when the article would stop, and tests beside promises in order, over all damages and seeds."""
    for variant in (AURORA, HAND_CODED):
        print(f"\n### Trials, {variant}: share of the best speed before the damage\n")
        titles = [*(f"{n} trials" for n in LOOKS), f"{LOOKS[-1]} trials, m/s", "p after 5, 20 trials", "stops after"]
        print(f"| | {' | '.join(titles)} |")
        print("|---" * (len(LOOKS) + 4) + "|")
        for method in COLORS:
            shares = results.found(variant, method)
            texts = [in_words(shares[:, min(n, shares.shape[1]) - 1]) for n in LOOKS]
            texts.append(in_words(results.found(variant, method, share=False)[:, -1], 3))
            texts.append(tests(shares, results.found(variant, IN_ORDER)) if method != IN_ORDER else "")
            texts.append(in_words(results.stopped(variant, method), 0) if method in (ARTICLE, OURS, SEVERAL) else "")
            print(f"| {method} | {' | '.join(texts)} |")
    print(f"\n### {TRIALS} trials: median speed recovered, m/s, of {AURORA} and {HAND_CODED}\n")
    print(f"| | {' | '.join(COLORS)} |\n{'|---' * (len(COLORS) + 1)}|")
    for damage in results.damages:
        texts = [
            ", ".join(f"{np.median(results.found(v, method, damage, share=False)[:, -1]):.3f}" for v in (AURORA, HAND_CODED))
            for method in COLORS
        ]
        print(f"| {damage} | {' | '.join(texts)} |")
    for method in COLORS:
        ours, theirs = (results.found(v, method, share=False)[:, -1] for v in (AURORA, HAND_CODED))
        p = ranksums(ours, theirs).pvalue
        print(f"\n{method}: {AURORA} beside {HAND_CODED}, speed after {TRIALS} trials, rank-sum p {p:.2g}")


def tests(ours: np.ndarray, theirs: np.ndarray) -> str:
    """Signed-rank tests after 5 and after all trials, damage by damage and seed by seed; with who is ahead."""
    texts = []
    for at in (min(5, ours.shape[1]) - 1, -1):
        a, b = ours[:, at], theirs[:, at]
        p = wilcoxon(a, b).pvalue if (a != b).any() else 1.0
        texts.append(f"{p:.2g} ({(a > b).mean():.0%} better, {(a < b).mean():.0%} worse)")
    return "; ".join(texts)


def figure_of(results: Results) -> Figure:
    """Speed recovered, damage by damage, and over trials, for both repertoires."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 7), layout="constrained")
        rows = figure.subplots(2, 2, width_ratios=(2.6, 1), sharey="row")
        for (wide, narrow), variant in zip(rows, (AURORA, HAND_CODED), strict=True):
            for number, (method, color) in enumerate(COLORS.items()):
                draw_damages(wide, results, variant, method, (number - 2) * 0.17)
                middle = np.median(results.found(variant, method), axis=0)
                narrow.plot(np.arange(len(middle)) + 1, middle, color=color, linewidth=1.8, label=method)
            wide.set(title=f"{variant}: speed after {TRIALS} trials, as a share of the best before", ylim=(0, None))
            wide.set_xticks(
                range(len(results.damages)), [fill(name.replace("-", " "), 9) for name in results.damages], fontsize=8
            )
            for line in range(1, len(results.damages)):
                wide.axvline(line - 0.5, color="#eeeeee", linewidth=0.8, zorder=0)
            wide.set_xlim(-0.5, len(results.damages) - 0.5)
            narrow.set(title="median of all damages", xlabel="trials", xticks=(1, 5, 10, 15, 20))
        figure.legend(*rows[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return figure


def draw_damages(axes, results: Results, variant: str, method: str, aside: float) -> None:
    """Seeds as points, quartiles as a bar, the median as a line across it."""
    for place, damage in enumerate(results.damages):
        values = results.found(variant, method, damage)[:, -1]
        middle, low, high = Quartiles.of(values)
        x = place + aside
        axes.bar(x, high - low, 0.15, bottom=low, color=COLORS[method], alpha=0.35, linewidth=0)
        axes.plot(np.full(len(values), x), values, "o", color=COLORS[method], markersize=2.2)
        axes.plot([x - 0.075, x + 0.075], [middle, middle], color=COLORS[method], linewidth=2)


def frames_of(repertoire: auroraqd.Repertoire, damage: str, path: Path, frames: int = 6) -> None:
    """A sheet of frames: the fastest skill before the damage, the same after it, and what the trials found."""
    whole, broken = Hexapod(threads=1), Hexapod(damage=damage, threads=1)
    fastest = int(repertoire.fitness.argmax())
    adaptation = auroraqd.Adaptation(np.hstack([repertoire.descriptor, repertoire.genotype]), repertoire.fitness)
    for _ in range(min(TRIALS, len(repertoire))):
        row = adaptation.ask()
        adaptation.tell(row, speeds(broken, repertoire.genotype[row : row + 1])[0])
    found = adaptation.best.row
    rows = (whole, fastest, "whole"), (broken, fastest, f"{damage}, the same gait"), (broken, found, "after trials")
    shown = np.linspace(0, whole.steps - 1, frames).round().astype(int)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2 * frames, 5.2), layout="constrained")
        for panels, (hexapod, row, name) in zip(figure.subplots(3, frames), rows, strict=True):
            genotype = repertoire.genotype[row : row + 1]
            studio = Studio(hexapod.model, hexapod.episode(genotype).qpos[:, shown], (400, 300))
            for frame, axes in enumerate(panels):
                axes.imshow(studio.picture(0, frame))
                axes.set_axis_off()
            studio.close()
            panels[0].set_title(f"{name}: {speeds(hexapod, genotype)[0]:.2f} m/s", loc="left")
    save_figure(figure, path, "frames")


def report_physics(repeats: int, batch: int) -> None:
    """How long a step of physics takes, beside Ant's, in this process on one thread."""
    ant = auroraqd.tasks.Gym("Ant-v5", steps=100, samples=20, threads=1, options={"terminate_when_unhealthy": False})
    for name, task in (("hexapod", Hexapod(seconds=1.5, threads=1)), ("Ant-v5", ant)):
        took = microseconds(task, repeats, batch)
        physics = took / round(task.interval / task.model.opt.timestep)
        second = took / task.interval / 1000
        print(f"{name}: a step of physics {physics:.1f} us, of control {took:.1f} us, a simulated second {second:.2f} ms")


def tripod() -> np.ndarray:
    """Genes of a gait that is written by hand, (1, 36): three legs swing forwards in the air while the others push."""
    legs = [[1.0, (0.35 + 0.5 * (leg % 2 + leg // 3)) % 1, 0.6, 0.2, 0.5 * (leg % 2), 0.6] for leg in range(6)]
    return np.reshape(legs, (1, 36))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--evaluations", type=int, default=6000, help="of each run")
    parser.add_argument("--out", type=Path, default=Path("results/hexapod"))
    parser.add_argument(
        "--quick", action="store_true", help="one seed of 10 evaluations, one damage and one imagined, into OUT/quick"
    )
    options, damages, known, repeats, batch, frames = parser.parse_args(), [*DAMAGES], [*DAMAGES], 5, ROBOTS, 6
    if options.quick:
        options.seeds, options.evaluations, options.out = 1, 10, options.out / "quick"
        damages, known, repeats, batch, frames = damages[:1], known[:2], 1, 2, 2
    runs, table = options.out / "runs", options.out / "trials.csv"
    runs.mkdir(parents=True, exist_ok=True)
    report_physics(repeats, batch)
    print(f"a tripod that is written by hand: {speeds(Hexapod(threads=1), tripod())[0]:.3f} m/s", flush=True)
    trials, repertoires = read(table) if table.exists() else [], {}
    for seed in range(options.seeds):
        for variant in (AURORA, HAND_CODED):
            repertoires[variant, seed] = repertoire = discovered(variant, seed, options.evaluations, runs)
            promises = imagined(repertoire, known, runs / f"{variant}-{seed}-damaged.npy")
            for damage in damages:
                if not any(trial[:3] == (variant, seed, damage) for trial in trials):
                    trials += trials_of(variant, seed, damage, repertoire, promises)
            write(table, trials)
            print(f"{variant}, seed {seed}: {len(repertoire)} individuals, {repertoire.fitness.max():.3f} m/s", flush=True)
    print(f"\n### Repertoires of {options.evaluations:,} evaluations, {options.seeds} seeds: medians and quartiles\n")
    report_repertoires(repertoires)
    results = Results(trials, {key: float(repertoire.fitness.max()) for key, repertoire in repertoires.items()})
    report_trials(results)
    save_figure(figure_of(results), options.out, "hexapod")
    frames_of(repertoires[AURORA, 0], "middle-leg-gone", options.out, frames)


if __name__ == "__main__":
    main()
