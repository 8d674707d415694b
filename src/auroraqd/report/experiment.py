"""Tables and figures of an experiment with many runs, in the manner of the paper (Figs. "Ballistic task").

Made from the files of a `Ledger` only.
"""

import textwrap
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from auroraqd import storage
from auroraqd._files import replacing
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.replication import Point
from auroraqd.experiments.statistics import MEASURES, Quartiles, rank_sums, summaries
from auroraqd.experiments.variants import REFERENCE, Variant
from auroraqd.repertoire import Repertoire
from auroraqd.report.figures import STYLE, save_figure, scatter, two_dimensional_colors

SUMMARY_CSV, SUMMARY_MD = "summary.csv", "summary.md"
_CURVES = {"size": "repertoire size", "klc": "KLC", "rmse": "reconstruction RMSE, [-1, 1] scale"}
_FORMATS = {"size": "{:,.0f}", "rmse_metres": "{:.1f}", "seconds": "{:.0f}"}
_TITLES = {
    "size": "stored",
    "klc": "KLC",
    "klc_marginal": "KLC, marginal",
    "rmse": "RMSE",
    "rmse_metres": "RMSE, m",
    "seconds": "seconds",
}


def write_report(ledger: Ledger, variants: Mapping[str, Variant]) -> list[Path]:
    """Write tables and figures beside the results; returns the files."""
    figures = ledger.folder / storage.FIGURES
    figures.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in ((SUMMARY_CSV, summary_csv(ledger, variants)), (SUMMARY_MD, summary_markdown(ledger, variants))):
        written.append(ledger.folder / name)
        with replacing(written[-1]) as file:
            file.write(text.encode())
    written += save_figure(curves_figure(ledger.points, variants), figures, "curves")
    repertoires = _first_repertoires(ledger, variants)
    if repertoires:
        written += save_figure(panel_figure(repertoires), figures, "repertoires")
    return written


def summary_csv(ledger: Ledger, variants: Mapping[str, Variant]) -> str:
    """A line a variant: replications, then median and quartiles of each measure."""
    columns = [f"{measure}_{part}" for measure in MEASURES for part in Quartiles._fields]
    lines = [",".join(["variant", "replications", *columns, "klc_paper"])]
    for row in summaries(ledger.results, variants):
        values = [f"{value:.6g}" for measure in MEASURES for value in row.measures[measure]]
        paper = "" if row.variant.paper is None else f"{row.variant.paper:g}"
        lines.append(",".join([row.variant.name, str(row.replications), *values, paper]))
    return "\n".join(lines) + "\n"


def summary_markdown(ledger: Ledger, variants: Mapping[str, Variant]) -> str:
    """Medians with quartiles beside the paper's medians, and the p-values of the rank-sum tests on the KLC."""
    generations = sorted({result.generations for result in ledger.results})
    lines = [
        f"After {' or '.join(f'{number:,}' for number in generations)} generations of {ledger.results[0].batch_size}; "
        "the paper's medians of the KLC are after 5,000 of 200.",
        "",
        f"| variant | runs | KLC, paper | {' | '.join(_TITLES.values())} |",
        "|---" * (3 + len(_TITLES)) + "|",
    ]
    for row in summaries(ledger.results, variants):
        cells = [_cell(measure, row.measures[measure]) for measure in _TITLES]
        paper = "" if row.variant.paper is None else f"{row.variant.paper:g}"
        lines.append(f"| {row.variant.title} | {row.replications} | {paper} | {' | '.join(cells)} |")
    lines += [
        "",
        "Medians over replications, first and third quartile in brackets. RMSE is on the scale from -1 to 1 of what each run",
    ]
    lines += ["stored, so that of incremental and pre-trained variants compare in metres only.", ""]
    tests = rank_sums(ledger.results, "klc")
    names = [name for name in variants if any(name in pair for pair in tests)]
    if names:
        lines += ["Rank-sum tests on the KLC, two-sided p-values:", ""]
        lines += [f"| | {' | '.join(names[1:])} |", "|---" * len(names) + "|"]
        for i, one in enumerate(names[:-1]):
            values = [tests.get((one, other), tests.get((other, one))) for other in names[1:]]
            cells = ["" if value is None or j < i else f"{value:.2g}" for j, value in enumerate(values)]
            lines.append(f"| {one} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _cell(measure: str, q: Quartiles) -> str:
    if np.isnan(q.median):
        return ""
    form = _FORMATS.get(measure, "{:.4f}")
    return f"{form.format(q.median)} ({form.format(q.first)}, {form.format(q.third)})"


def curves_figure(points: Sequence[Point], variants: Mapping[str, Variant]) -> Figure:
    """Size, KLC and RMSE over generations: the median of the replications as a line, the quartiles as a band."""
    colors = dict(zip(variants, mpl.colormaps["tab10"].colors, strict=False))  # pyright: ignore[reportAttributeAccessIssue]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(15, 4.6), layout="constrained")
        panels = figure.subplots(1, len(_CURVES))
        shown = {}
        for axes, (measure, title) in zip(panels, _CURVES.items(), strict=True):
            for name, variant in variants.items():
                generation, quartiles = _curve([p for p in points if p.variant == name], measure)
                if len(generation):
                    axes.fill_between(generation, quartiles[:, 1], quartiles[:, 2], color=colors[name], alpha=0.25, linewidth=0)
                    (shown[variant.title],) = axes.plot(generation, quartiles[:, 0], color=colors[name], linewidth=1.3)
            axes.set(xlabel="generation", title=title)
            axes.set_xlim(left=0)
            if measure == "klc":
                axes.set_yscale("log")
                axes.set_ylim(bottom=_floor(points))
                axes.set_title("KLC against the final hand-coded repertoire")
            else:
                axes.set_ylim(bottom=0)
        figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=5, frameon=False)
    return figure


def _floor(points: Sequence[Point]) -> float | None:
    """The lower end of the KLC axis: the reference, which falls to 0 by construction, is cut off."""
    values = [p.klc for p in points if p.variant != REFERENCE and p.klc > 0]
    return 0.5 * min(values) if values else None


def _curve(points: Sequence[Point], measure: str) -> tuple[np.ndarray, np.ndarray]:
    """Generations, (n,), and median and quartiles, (n, 3), of what was measured at each."""
    by_generation: dict[int, list[float]] = {}
    for point in points:
        value = float(getattr(point, measure))
        if np.isfinite(value) and not (measure == "klc" and value <= 0):
            by_generation.setdefault(point.generation, []).append(value)
    generations = sorted(by_generation)
    quartiles = [Quartiles.of(np.array(by_generation[g])) for g in generations]
    return np.array(generations), np.array(quartiles).reshape(-1, 3)


def panel_figure(repertoires: Mapping[str, Repertoire]) -> Figure:
    """For each variant, its descriptor space above and ground-truth space below.

    An individual has the colour of its place in ground-truth space; descriptors of more than two dimensions are not shown.

    Args:
        repertoires: by title, each with a ground truth of two columns.
    """
    truths = [repertoire.ground_truth for repertoire in repertoires.values()]
    everywhere = np.concatenate([truth for truth in truths if truth is not None])
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.9 * len(repertoires), 4.4), layout="constrained")
        panels = figure.subplots(2, len(repertoires), squeeze=False)
        for (title, repertoire), (above, below) in zip(repertoires.items(), panels.T, strict=True):
            truth = repertoire.ground_truth
            assert truth is not None
            colors = two_dimensional_colors(truth, everywhere)
            if repertoire.descriptor.shape[1] == 2:
                scatter(above, repertoire.descriptor, colors)
            else:
                above.text(0.5, 0.5, f"{repertoire.descriptor.shape[1]} dimensions", ha="center", va="center")
            scatter(below, truth, colors)
            below.set(xlim=_margin(low[0], high[0]), ylim=_margin(low[1], high[1]))
            above.set_title(_short_lines(title), fontsize=8)
            below.set_xlabel(f"{len(repertoire):,} individuals")
            for axes in (above, below):
                axes.set_xticks([])
                axes.set_yticks([])
        panels[0, 0].set_ylabel("descriptor space")
        panels[1, 0].set_ylabel("ground truth")
    return figure


def _margin(low: float, high: float) -> tuple[float, float]:
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


def _short_lines(title: str) -> str:
    return "\n".join(textwrap.wrap(title, 16))


def _first_repertoires(ledger: Ledger, variants: Mapping[str, Variant]) -> dict[str, Repertoire]:
    """Of each variant, the repertoire of the first replication that has one here, by title."""
    found = {}
    for name, variant in variants.items():
        for replication in sorted(ledger.done(name)):
            with suppress(OSError, ValueError):  # not here, or damaged
                found[variant.title] = storage.load(ledger.run_folder(name, replication))
                break
    return found
