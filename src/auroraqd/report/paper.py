"""The paper and its follow-up beside what came out: every claim with its verdict, tables and figures, in one report.

Made from the files of the ledgers only; nothing in it is written by hand but what the papers say.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from auroraqd._checks import instance
from auroraqd._files import as_path, folder_at, replacing
from auroraqd.experiments.catalogue import CLAIMS, EXPERIMENTS
from auroraqd.experiments.claims import Evidence, Judged, Verdict, judged
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.statistics import Quartiles, comparisons, values_of
from auroraqd.experiments.variants import Experiment
from auroraqd.report.diversity import diversity_figure
from auroraqd.report.documents import Document, Heading, Picture, Table, Text, markdown, page, write_pdf
from auroraqd.report.experiment import curves_figure, effect_text, first_repertoires, pair_table, summary_table, titles_of
from auroraqd.report.panels import panel_figure
from auroraqd.report.style import STYLE

_TITLES = {
    "ballistic": "First scenario: ballistic task",
    "air-hockey": "Second scenario: air hockey",
    "follow-up": "The follow-up: air hockey with fitness",
}
_VERBS = {Verdict.AGREES: "agree", Verdict.DIFFERS: "differ", Verdict.UNKNOWN: "cannot be known"}
_CLAIM_WIDTHS = (0.18, 0.10, 0.08, 0.16, 0.23, 0.1, 0.15)


def write_paper(ledgers: Mapping[str, Ledger], folder: str | Path) -> list[Path]:
    """Write `paper.md`, `paper.html` and `paper.pdf`: claims, tables and figures of the paper and its follow-up beside ours.

    The page holds its figures; the PDF too. The Markdown has the tables alone.

    Args:
        ledgers: of the experiments, by name: "ballistic", "air-hockey", "follow-up"; claims about one that is missing cannot be
            known.
        folder: where to write them.

    Returns:
        The files.
    """
    ledgers = instance("ledgers", ledgers, Mapping, "a dictionary of ledgers by experiment")
    for name, ledger in ledgers.items():
        if name not in EXPERIMENTS:
            raise ValueError(f"ledgers must be of {', '.join(EXPERIMENTS)}, got {name!r}")
        instance(f"ledgers[{name!r}]", ledger, Ledger, "a ledger of an experiment")
    folder = folder_at(as_path("folder", folder))
    document = paper_document(ledgers)
    files = [folder / f"paper.{suffix}" for suffix in ("md", "html", "pdf")]
    for path, text in zip(files, (markdown(document), page(document)), strict=False):
        with replacing(path) as file:
            file.write(text.encode())
    write_pdf(document, files[-1])
    return files


def paper_document(ledgers: Mapping[str, Ledger]) -> Document:
    """The report as data."""
    found = judged(CLAIMS, {name: Evidence(ledger.results, ledger.points) for name, ledger in ledgers.items()})
    blocks: list[Heading | Text | Table | Picture] = [
        Heading("The paper beside these results", 1),
        Text(
            "A. Cully, Autonomous skill discovery with Quality-Diversity and Unsupervised Descriptors, GECCO 2019; and its "
            "follow-up, L. Grillotti, A. Cully, Unsupervised Behaviour Discovery with Quality-Diversity Optimisation, IEEE "
            "TEVC 2022. Each claim about their results is judged by code, by a criterion that is the same for all claims of a "
            "kind. Results here are medians over replications. A is the probability that a run of the first variant has "
            "the larger value, with its 95% interval (Vargha and Delaney; Newcombe); p is of the two-sided rank-sum test,"
            " after Holm's correction for all pairs of variants in the same measure."
        ),
        Text(f"Of {len(found)} claims: {_tally(found)}."),
    ]
    for name, experiment in EXPERIMENTS.items():
        own = [one for one in found if one.claim.experiment == name]
        blocks += [Heading(_TITLES[name]), Text(f"{len(own)} claims: {_tally(own)}.")]
        others = {(r.generations, r.batch_size) for r in ledgers[name].results} if name in ledgers else set()
        others -= {(experiment.generations, experiment.batch_size)}
        if others:
            budgets = " and ".join(f"{generations:,} generations of {size}" for generations, size in sorted(others))
            blocks.append(Text(f"These runs are of another length than published, {budgets}: no conclusions can be drawn."))
        blocks += [Heading("Claims", 3), _claims(own, explained=not others)]
        if name in ledgers and ledgers[name].results:
            blocks += _results(ledgers[name], experiment)
    return blocks


def _tally(found: Sequence[Judged]) -> str:
    counts = Counter(one.verdict for one in found)
    return ", ".join(f"{counts[verdict]} {verb}" for verdict, verb in _VERBS.items())


def _claims(found: Sequence[Judged], *, explained: bool) -> Table:
    """A line a claim; why it differs is known of runs of the published length."""
    header = ("the paper says", "where", "published", "agrees if", "here", "verdict", "what is known")
    rows = [
        (c.text, c.section, c.published, c.criterion, one.ours, one.verdict.value, one.why if explained else "")
        for one, c in ((one, one.claim) for one in found)
    ]
    return Table(header, rows, _CLAIM_WIDTHS)


def _results(ledger: Ledger, experiment: Experiment) -> list[Heading | Text | Table | Picture]:
    """Tables and figures of an experiment."""
    blocks: list[Heading | Text | Table | Picture] = [
        Heading("Medians, first and third quartile in brackets", 3),
        Table(*summary_table(ledger, experiment)),
    ]
    for measure in experiment.tested:
        found = comparisons(ledger.results, measure)
        if found:
            title = f"{titles_of(experiment)[measure]}: the row beside the column, A with its interval, p of {len(found)} pairs"
            blocks += [Heading(title, 3), Table(*pair_table(found, experiment, effect_text))]
    if any(variant.paper for variant in experiment.variants.values()):
        title = experiment.measures[0].title
        blocks.append(
            Picture(medians_figure(ledger, experiment), f"{title}: the paper's medians, and medians and quartiles here")
        )
    blocks.append(Picture(curves_figure(ledger.points, experiment), "Medians and quartiles over generations"))
    repertoires = first_repertoires(ledger, experiment.variants)
    if repertoires:
        blocks.append(Picture(panel_figure(repertoires, experiment), "Repertoires of the first replication"))
        if experiment.scores_diversity:
            trajectories = next(iter(repertoires.values())).observation
            blocks.append(Picture(diversity_figure(trajectories), "What the diversity score counts"))
    return blocks


def medians_figure(ledger: Ledger, experiment: Experiment) -> Figure:
    """The first measure of each variant: the paper's median, and ours with quartiles."""
    measure = experiment.measures[0]
    shown = {v.title: (v.name, v.paper) for v in experiment.variants.values() if v.paper}
    values = values_of(ledger.results, measure.name)
    median, first, third = np.array([Quartiles.of(values.get(name, np.empty(0))) for name, _ in shown.values()]).T
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 0.9 + 0.4 * len(shown)), layout="constrained")
        axes, places = figure.subplots(), np.arange(len(shown))
        span = [median - first, third - median]
        axes.errorbar(median, places, xerr=span, fmt="o", color="#1f7a6f", ms=6, label="here")
        paper = [paper for _, paper in shown.values()]
        axes.plot(np.array(paper, float), places, "D", color="#c8553d", ms=6, mfc="none", mew=1.5, label="paper")
        axes.set_yticks(places, list(shown))
        axes.invert_yaxis()
        axes.set_xscale("log")
        axes.set_xlabel(measure.title)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        figure.legend(loc="outside upper right", ncols=2, frameon=False)
    return figure
