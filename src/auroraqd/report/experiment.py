"""Tables and figures of an experiment with many runs, in the manner of the paper (Figs. "Ballistic task").

Made from the files of a `Ledger` only.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from auroraqd._checks import instance
from auroraqd._files import folder_at, replacing
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.replication import Point
from auroraqd.experiments.statistics import Comparison, Quartiles, columns, comparisons, summaries
from auroraqd.experiments.variants import Experiment, Variant
from auroraqd.repertoire import Repertoire
from auroraqd.report.diversity import diversity_figure
from auroraqd.report.panels import panel_figure
from auroraqd.report.style import STYLE, save_figure
from auroraqd.runs import folders

SUMMARY_CSV, SUMMARY_MD = "summary.csv", "summary.md"
_TITLES = {"size": "stored", "rmse": "RMSE", "rmse_metres": "RMSE, m", "seconds": "seconds"}
_FORMS = {"size": "{:,.0f}", "rmse": "{:.4f}", "rmse_metres": "{:#.3g}", "seconds": "{:.0f}"}


def write_report(ledger: Ledger, experiment: Experiment) -> list[Path]:
    """Write tables and figures beside the results; returns the files."""
    instance("ledger", ledger, Ledger, "a ledger of an experiment")
    instance("experiment", experiment, Experiment, "an experiment")
    figures = folder_at(ledger.folder / folders.FIGURES)
    written = []
    for name, text in ((SUMMARY_CSV, summary_csv(ledger, experiment)), (SUMMARY_MD, summary_markdown(ledger, experiment))):
        written.append(ledger.folder / name)
        with replacing(written[-1]) as file:
            file.write(text.encode())
    written += save_figure(curves_figure(ledger.points, experiment), figures, "curves")
    repertoires = first_repertoires(ledger, experiment.variants)
    if repertoires:
        written += save_figure(panel_figure(repertoires, experiment), figures, "repertoires")
    trajectories = next((r.observation for r in repertoires.values()), None)
    if trajectories is not None and experiment.scores_diversity:
        written += save_figure(diversity_figure(trajectories), figures, "diversity")
    return written


def summary_csv(ledger: Ledger, experiment: Experiment) -> str:
    """A line a variant: replications, median and quartiles of each column, what the paper reports of the first measure."""
    measures = columns(experiment)
    paper = [f"{experiment.measures[0].name}_paper"] if _in_paper(experiment) else []
    titles = [f"{measure}_{part}" for measure in measures for part in Quartiles._fields]
    lines = [",".join(["variant", "replications", *titles, *paper])]
    for row in summaries(ledger.results, experiment):
        values = [f"{value:.6g}" for measure in measures for value in row.measures[measure]]
        reported = ["" if row.variant.paper is None else f"{row.variant.paper:g}"] * len(paper)
        lines.append(",".join([row.variant.name, str(row.replications), *values, *reported]))
    return "\n".join(lines) + "\n"


def _in_paper(experiment: Experiment) -> bool:
    return any(variant.paper is not None for variant in experiment.variants.values())


def summary_markdown(ledger: Ledger, experiment: Experiment) -> str:
    """Medians with quartiles, beside the paper's medians where it has some, and the p-values of the rank-sum tests."""
    generations = sorted({result.generations for result in ledger.results})
    paper = "; the paper's medians are after 5,000 of 200." if _in_paper(experiment) else "."
    lines = [
        f"After {' or '.join(f'{number:,}' for number in generations)} generations of {ledger.results[0].batch_size}{paper}",
        "",
        *_table(*summary_table(ledger, experiment)),
    ]
    lines += [
        "",
        "Medians over replications, first and third quartile in brackets. RMSE is on the scale from -1 to 1 of what each run",
        "stored: between runs that were scaled differently it compares in metres only.",
    ]
    for measure in experiment.tested:
        lines += _tests(measure, titles_of(experiment)[measure], ledger, experiment)
    return "\n".join(lines) + "\n"


def titles_of(experiment: Experiment) -> dict[str, str]:
    """What the columns of an experiment are called."""
    return {**_TITLES, **{measure.name: measure.title for measure in experiment.measures}}


def summary_table(ledger: Ledger, experiment: Experiment) -> tuple[list[str], list[list[str]]]:
    """Header and rows: medians with quartiles of each variant, beside the paper's medians where it has some."""
    titles, forms = titles_of(experiment), {**_FORMS, **{measure.name: measure.form for measure in experiment.measures}}
    paper = [f"{experiment.measures[0].title}, paper"] if _in_paper(experiment) else []
    rows = []
    for row in summaries(ledger.results, experiment):
        reported = ["" if row.variant.paper is None else f"{row.variant.paper:g}"] * len(paper)
        cells = [_cell(forms[measure], row.measures[measure]) for measure in columns(experiment)]
        rows.append([row.variant.title, str(row.replications), *reported, *cells])
    return ["variant", "runs", *paper, *(titles[measure] for measure in columns(experiment))], rows


def _tests(measure: str, title: str, ledger: Ledger, experiment: Experiment) -> list[str]:
    """The p-values between all pairs of variants, and how much they differ, as tables; no lines where there is no pair."""
    found = comparisons(ledger.results, measure)
    if not found:
        return []
    plain = pair_table(found, experiment, lambda c: f"{c.p:.2g}")
    effects = pair_table(found, experiment, effect_text)
    return [
        *("", f"Rank-sum tests on the {title}, two-sided p-values:", "", *_table(*plain)),
        "",
        f"Effect sizes: the probability that a run of the row has the larger {title} than one of the column, with 95%",
        f"intervals, and p-values after Holm's correction for these {len(found)} pairs:",
        *("", *_table(*effects)),
    ]


def effect_text(comparison: Comparison) -> str:
    """An effect size with its interval and its corrected p-value."""
    a, low, high = comparison.effect
    return f"{a:.2f} ({low:.2f}, {high:.2f}), p = {comparison.corrected:.2g}"


def pair_table(
    found: Mapping[tuple[str, str], Comparison], experiment: Experiment, form: Callable[[Comparison], str]
) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table with a cell for each pair of variants, above the diagonal."""
    names = [name for name in experiment.variants if any(name in pair for pair in found)]
    rows = []
    for i, one in enumerate(names[:-1]):
        cells = [form(_between(found, one, other)) if j >= i else "" for j, other in enumerate(names[1:])]
        rows.append([one, *cells])
    return ["", *names[1:]], rows


def _between(found: Mapping[tuple[str, str], Comparison], one: str, other: str) -> Comparison:
    return found[one, other] if (one, other) in found else found[other, one].swapped


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(header)} |", "|---" * len(header) + "|", *(f"| {' | '.join(row)} |" for row in rows)]


def _cell(form: str, q: Quartiles) -> str:
    if np.isnan(q.median):
        return ""
    return f"{form.format(q.median)} ({form.format(q.first)}, {form.format(q.third)})"


def curves_figure(points: Sequence[Point], experiment: Experiment) -> Figure:
    """What was followed over generations: the median of the replications as a line, the quartiles as a band."""
    palette = mpl.colormaps["tab10" if len(experiment.variants) <= 10 else "tab20"]
    colors = {name: palette(i % palette.N) for i, name in enumerate(experiment.variants)}
    followed = [measure for measure in experiment.measures if measure.followed]
    logarithmic = {measure.name for measure in followed if measure.logarithmic}
    titles = {"size": "repertoire size", **{m.name: m.title for m in followed}, "rmse": "reconstruction RMSE, [-1, 1] scale"}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5 * len(titles), 4.6), layout="constrained")
        shown = {}
        for axes, (measure, title) in zip(figure.subplots(1, len(titles)), titles.items(), strict=True):
            for name, variant in experiment.variants.items():
                own = [point for point in points if point.variant == name]
                generation, quartiles = _curve(own, measure, positive=measure in logarithmic)
                if len(generation):
                    axes.fill_between(generation, quartiles[:, 1], quartiles[:, 2], color=colors[name], alpha=0.25, linewidth=0)
                    (shown[variant.title],) = axes.plot(generation, quartiles[:, 0], color=colors[name], linewidth=1.3)
            axes.set(xlabel="generation", title=title)
            axes.set_xlim(left=0)
            if measure in logarithmic:
                axes.set_yscale("log")
                axes.set_ylim(bottom=_floor(points, measure, experiment.reference))
            else:
                axes.set_ylim(bottom=0)
        figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=5, frameon=False)
    return figure


def _floor(points: Sequence[Point], measure: str, reference: str | None) -> float | None:
    """The lower end of a logarithmic axis: the reference, which falls to 0 by construction, is cut off."""
    values = [point.value(measure) for point in points if point.variant != reference]
    return 0.5 * min((value for value in values if value > 0), default=0) or None


def _curve(points: Sequence[Point], measure: str, *, positive: bool) -> tuple[np.ndarray, np.ndarray]:
    """Generations, (n,), and median and quartiles, (n, 3), of what was measured at each."""
    by_generation: dict[int, list[float]] = {}
    for point in points:
        value = point.value(measure)
        if np.isfinite(value) and (value > 0 or not positive):
            by_generation.setdefault(point.generation, []).append(value)
    generations = sorted(by_generation)
    quartiles = [Quartiles.of(np.array(by_generation[g])) for g in generations]
    return np.array(generations), np.array(quartiles).reshape(-1, 3)


def first_repertoires(ledger: Ledger, variants: Mapping[str, Variant]) -> dict[str, Repertoire]:
    """Of each variant, the repertoire of the first replication that has one here, by title."""
    found = {}
    for name, variant in variants.items():
        for replication in sorted(ledger.done(name)):
            with suppress(OSError, ValueError):  # not here, or damaged
                found[variant.title] = folders.load(ledger.run_folder(name, replication))
                break
    return found
