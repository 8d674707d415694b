"""The claims of the paper, and the report that judges them."""

import base64
import re
from pathlib import Path

import numpy as np
import pytest

from auroraqd.experiments import follow_up, paper_claims
from auroraqd.experiments.catalogue import CLAIMS, EXPERIMENTS
from auroraqd.experiments.claims import Evidence, Verdict, judged
from auroraqd.experiments.duration import TimeLeft
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.replication import Job, Point, Result
from auroraqd.experiments.runner import Status
from auroraqd.experiments.variants import AIR_HOCKEY, BALLISTIC
from auroraqd.report import write_paper
from auroraqd.report.documents import markdown
from auroraqd.report.experiment import summary_markdown
from auroraqd.report.paper import paper_document

RESULTS = Path(__file__).parents[1] / "results"
LEDGERS = {task: Ledger(RESULTS / task) for task in EXPERIMENTS}
VERDICT = {
    True: Verdict.AGREES,
    False: Verdict.DIFFERS,
    None: Verdict.UNKNOWN,
}


def runs(variant, values, measure="klc", **others):
    """Results whose measure takes these values."""
    numbers = {name: kind(1) for name, kind in Result.__annotations__.items() if kind in (int, float)}
    numbers |= {"variant": variant, "generations": 5000, "batch_size": 200, **others}
    column = measure in Result._fields
    return [
        Result(**{**numbers, "replication": i, "measures": {} if column else {measure: v}, **({measure: v} if column else {})})
        for i, v in enumerate(values)
    ]


def verdict(name, results=(), points=()):
    claim = next(claim for claim in CLAIMS if claim.name == name)
    (found,) = (one for one in judged(CLAIMS, {claim.experiment: Evidence(results, points)}) if one.claim is claim)
    return found


def around(middle, n=20, spread=0.01):
    return (middle * (1 + spread * np.linspace(-1, 1, n))).tolist()


def test_claims_are_of_variants_measures_and_sections_that_there_are():
    assert len({claim.name for claim in CLAIMS}) == len(CLAIMS)
    for claim in CLAIMS:
        assert claim.experiment in EXPERIMENTS
        assert claim.section
        assert claim.criterion
    medians = {c.name.removeprefix("klc-"): c.published for c in CLAIMS if c.text.startswith("Median KLC")}
    assert medians == {name: f"{v.paper:g}" for name, v in BALLISTIC.variants.items() if v.paper is not None}


def test_without_results_nothing_is_known():
    assert {one.verdict for one in judged(CLAIMS, {})} == {Verdict.UNKNOWN}
    assert {one.verdict for one in judged(CLAIMS, {task: Evidence([]) for task in EXPERIMENTS})} == {Verdict.UNKNOWN}


def three(hand_coded, learned, measure):
    learners = [r for name in ("pca-incremental", "ae-incremental") for r in runs(name, around(learned), measure)]
    return learners + runs("hand-coded", around(hand_coded), measure)


def regions(most, cvt):
    return [r for name in paper_claims.PAPER_1 for r in runs(name, [cvt if name == "cvt" else most], "reached")]


def in_two_and_ten(*sizes):
    names = ("csc-uniform-2", "csc-uniform", "vat-uniform-2", "vat-uniform")
    return [r for name, size in zip(names, sizes, strict=True) for r in runs(name, [size], "size")]


def published(name, n):
    return runs(name, [1.0] * n, "coverage_40", generations=1000, batch_size=128)


@pytest.mark.parametrize(
    ("name", "results", "holds"),
    [
        ("klc-genotype", runs("genotype", around(0.686)), True),
        ("klc-genotype", runs("genotype", around(1.02)), True),
        ("klc-genotype", runs("genotype", around(1.04)), False),
        ("klc-genotype", runs("genotype", around(0.45)), False),
        ("klc-hand-coded", runs("hand-coded", [0.0] * 20), True),
        ("klc-hand-coded", runs("hand-coded", [0.01] * 20), False),
        ("klc-pca-ae", runs("pca-incremental", around(1)) + runs("ae-incremental", around(2)), True),
        ("klc-pca-ae", runs("pca-incremental", around(2)) + runs("ae-incremental", around(1)), False),
        ("klc-pca-ae", runs("pca-incremental", around(1)) + runs("ae-incremental", around(1)), False),
        ("klc-pca-ae", runs("pca-incremental", around(1)) + runs("ae-incremental", [2.0]), None),
        ("klc-pca-overlap", runs("pca-incremental", [1.0]) + runs("pca-pretrained", [1.4]), True),
        ("klc-pca-overlap", runs("pca-incremental", [1.0]) + runs("pca-pretrained", [1.6]), False),
        ("klc-cvt-30", runs("cvt", [31.0]) + runs("pca-incremental", [1.0]) + runs("ae-incremental", [1.0]), True),
        ("klc-cvt-30", runs("cvt", [31.0]) + runs("pca-incremental", [1.0]) + runs("ae-incremental", [2.0]), False),
        ("klc-cvt-30", runs("cvt", [31.0]) + runs("pca-incremental", [1.0]), None),
        ("few-cells", runs("cvt", [14], "size"), True),
        ("few-cells", runs("cvt", [1400], "size"), False),
        ("ae-alike", runs("ae-incremental", around(1), "diversity") + runs("hand-coded", around(1), "diversity"), True),
        ("ae-alike", runs("ae-incremental", around(2), "diversity") + runs("hand-coded", around(1), "diversity"), False),
        ("whole-space", runs("ae-incremental", [96.0], "diversity") + runs("pca-incremental", [95.0], "diversity"), True),
        ("whole-space", runs("ae-incremental", [96.0], "diversity") + runs("pca-incremental", [94.0], "diversity"), False),
        ("cvt-few", runs("cvt", [9], "size") + runs("hand-coded", [100], "size"), True),
        ("cvt-few", runs("cvt", [11], "size") + runs("hand-coded", [100], "size"), False),
        ("walls", runs("hand-coded", [1.0]), None),
        ("walls", three(0.2, 0.3, "walls"), True),
        ("walls", three(0.3, 0.2, "walls"), False),
        ("even", three(300, 250, "even"), True),
        ("even", three(250, 300, "even"), False),
        ("reached", regions(0.95, 0.1), True),
        ("reached", regions(0.94, 0.1), False),
        ("reached", regions(0.95, 0.96), False),
        ("reached", regions(0.95, 0.1)[:-1], None),
        ("sizes", [r for name in follow_up._CONTROLLED for r in runs(name, [9_100], "size")], True),
        ("sizes", [r for name in follow_up._CONTROLLED for r in runs(name, [11_100], "size")], False),
        ("sizes", runs("hand-coded", [9_100], "size"), None),
        ("dimensions", in_two_and_ten(10_000, 9_000, 10_000, 4_000), True),
        ("dimensions", in_two_and_ten(10_000, 9_000, 10_000, 9_000), False),
        ("dimensions", in_two_and_ten(10_000, 5_000, 10_000, 4_000), False),
        ("dimensions", in_two_and_ten(10_000, 9_000, 10_000, 4_000)[1:], None),
        ("fitness-hand-coded", runs("hand-coded", [-130.0], "grid_fitness"), True),
        ("fitness-hand-coded", runs("hand-coded", [-190.0], "grid_fitness"), True),
        ("fitness-hand-coded", runs("hand-coded", [-200.0], "grid_fitness"), False),
        ("fitness-hand-coded", runs("hand-coded", [-80.0], "grid_fitness"), False),
        ("protocol-3", [r for name in EXPERIMENTS["follow-up"].variants for r in published(name, 10)], True),
        ("protocol-3", [r for name in EXPERIMENTS["follow-up"].variants for r in published(name, 9)], False),
        ("protocol-2", [r for name in paper_claims.PAPER_2 for r in runs(name, [1.0] * 20)], True),
        ("protocol-2", [r for name in paper_claims.PAPER_2 for r in runs(name, [1.0] * 20, generations=60)], False),
        ("protocol-2", [r for name in paper_claims.PAPER_2[1:] for r in runs(name, [1.0] * 20)], False),
    ],
)
def test_verdicts_follow_from_results(name, results, holds):
    assert verdict(name, results).verdict is VERDICT[holds]


def test_an_order_with_several_needs_all_of_them():
    good = [r for name in paper_claims.AURORA_GOOD for r in runs(name, around(0.1))]
    assert verdict("klc-genotype-higher", good + runs("genotype", around(1))).verdict is Verdict.AGREES
    one_too_high = good[:40] + runs("ae-incremental", around(2)) + runs("genotype", around(1))
    assert verdict("klc-genotype-higher", one_too_high).verdict is Verdict.DIFFERS
    assert verdict("klc-genotype-higher", good[:40] + runs("genotype", around(1))).verdict is Verdict.UNKNOWN


def curve(variant, sizes, replication=0):
    steps = (100, 700, 800, 1500, 1600, 3100, 3200, 5000)
    return [Point(variant, replication, g, s, 0.1, 0.1, {}) for g, s in zip(steps, sizes, strict=True)]


def test_claims_about_curves():
    falls, grows = (10, 20, 15, 25, 20, 30, 25, 40), (10, 20, 25, 27, 30, 35, 37, 40)
    assert verdict("shrinks", points=curve("pca-incremental", falls)).verdict is Verdict.AGREES
    assert verdict("shrinks", points=curve("pca-incremental", grows)).verdict is Verdict.DIFFERS
    early, late = (38, 39, 39, 39, 39, 40, 40, 40), (10, 20, 25, 27, 30, 32, 35, 40)

    def speed(**curves):
        return verdict(
            "speed", points=[p for name, c in curves.items() for i in range(8) for p in curve(name.replace("_", "-"), c, i)]
        )

    assert speed(pca_incremental=early, ae_incremental=early, hand_coded=late).verdict is Verdict.AGREES
    assert speed(pca_incremental=early, ae_incremental=late, hand_coded=early).verdict is Verdict.DIFFERS
    assert speed(pca_incremental=early, hand_coded=early).verdict is Verdict.UNKNOWN


def test_an_order_of_too_few_runs_cannot_be_known():
    def pairs_of(n, *values):
        return [
            r
            for name, value in zip(("cvt", "hand-coded", "pca-incremental", "ae-incremental"), values, strict=True)
            for r in runs(name, around(value, n), "diversity")
        ]

    assert verdict("better-than-unsupervised", pairs_of(6, 1, 2, 3, 4)).verdict is Verdict.AGREES
    assert verdict("better-than-unsupervised", pairs_of(6, 4, 1, 2, 3)).verdict is Verdict.DIFFERS
    assert verdict("better-than-unsupervised", pairs_of(3, 1, 2, 3, 4)).verdict is Verdict.UNKNOWN
    assert verdict("better-than-unsupervised", pairs_of(3, 4, 1, 2, 3)).verdict is Verdict.UNKNOWN


def test_claims_about_coverage_along_a_run():
    def along(*values):
        steps = zip((100, 200, 400, 1000), values, strict=False)
        return [Point("random", i, g, 10, 0.1, 0.1, {"coverage_40": v}) for g, v in steps for i in range(3)]

    assert verdict("coverage-random", points=along(0.66, 0.80, 0.86, 0.90)).verdict is Verdict.AGREES
    assert verdict("coverage-random", points=along(0.66, 0.85, 0.86, 0.90)).verdict is Verdict.DIFFERS
    assert verdict("coverage-random", points=along(0.66, 0.80, 0.86)).verdict is Verdict.UNKNOWN
    assert verdict("coverage-random", points=along(0.66, 0.80, 0.86, np.nan)).verdict is Verdict.UNKNOWN
    too_few = verdict("coverage-random", runs("random", [0.9], "coverage_40"), along(0.66))
    assert (too_few.verdict, too_few.ours) == (Verdict.UNKNOWN, "too few runs, or too short")


def test_what_is_known_is_said_of_claims_that_do_not_agree():
    assert "training" in verdict("klc-ae-pretrained", runs("ae-pretrained", [0.09])).why
    assert verdict("klc-ae-pretrained", runs("ae-pretrained", [0.5])).why == ""


def test_the_report_of_the_committed_results_is_up_to_date():
    """`auroraqd reproduce paper --out results` writes it anew."""
    assert (RESULTS / "paper.md").read_text() == markdown(paper_document(LEDGERS))
    for task, experiment in EXPERIMENTS.items():
        assert (RESULTS / task / "summary.md").read_text() == summary_markdown(LEDGERS[task], experiment)


@pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=list(EXPERIMENTS))
def test_runs_can_be_added_to_the_committed_results(experiment):
    """Their settings are those of now, with what earlier versions did not write down."""
    LEDGERS[experiment.name].check({name: variant.of(experiment.base(), 0) for name, variant in experiment.variants.items()})


def test_the_report_holds_all_that_it_shows(tmp_path):
    short = {task: Ledger(RESULTS / task) for task in EXPERIMENTS}
    for ledger in short.values():
        ledger.points = [p for p in ledger.points if p.replication < 1 and p.generation % 500 == 0]
    text, page, pdf = (path.read_bytes() for path in write_paper(short, tmp_path / "new"))
    assert re.findall(rb"(?:src|href)=.(?!data:)", page) == []
    images = re.findall(rb'src="data:image/png;base64,([^"]+)"', page)
    assert len(images) == 1 + len(EXPERIMENTS)  # medians, and curves
    assert all(base64.b64decode(image).startswith(b"\x89PNG") for image in images)
    assert pdf.startswith(b"%PDF")
    for claim in CLAIMS:
        assert claim.text in text.decode()
    assert page.count(b'<td class="agrees">') == text.count(b"| agrees |") > 10
    assert b"<script" not in page


def test_a_report_of_one_experiment(tmp_path):
    text = markdown(paper_document({"ballistic": LEDGERS["ballistic"]}))
    rest = text[text.index("## Second scenario") :]
    assert rest.count("| cannot be known |") == sum(claim.experiment != "ballistic" for claim in CLAIMS)
    with pytest.raises(ValueError, match="ledgers must be of ballistic, air-hockey, follow-up, got 'chess'"):
        write_paper({"chess": LEDGERS["ballistic"]}, tmp_path)


def test_short_runs_are_no_evidence_and_the_report_says_so(tmp_path):
    short = Ledger(tmp_path)
    short.results = runs("hand-coded", [0.0], generations=2) + runs("pca-incremental", [7.0], generations=2)
    text = markdown(paper_document({"ballistic": short}))
    assert "These runs are of another length than published, 2 generations of 200: no conclusions can be drawn." in text
    assert "benchmarks/readings.py" not in text[: text.index("## Second scenario")]


def job(variant, replication, experiment=BALLISTIC, path=Path()):
    made = experiment.variants[variant].of(experiment.base(), replication)
    return Job(variant, replication, made, path, None, (), experiment.name)


def test_time_left(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    jobs = [job("genotype", 0), job("genotype", 1), job("cvt", 0), job("hand-coded", 0, AIR_HOCKEY)]
    left = TimeLeft(jobs, 2)
    assert left.seconds() is None
    left.progress("ballistic", Status("genotype", 0, 0, 100, 5, 1, ""))
    assert left.seconds() is None
    now[0] = 10
    left.progress("ballistic", Status("genotype", 0, 50, 100, 5, 1, ""))  # 20 s a run, and the others like it
    assert left.seconds() == pytest.approx((10 + 20 + 20 + 20) / 2)
    now[0] = 20
    (done,) = runs("genotype", [1.0], seconds=20.0)
    left.finished("ballistic", done)
    left.progress("ballistic", Status("cvt", 0, 0, 100, 5, 1, ""))
    now[0] = 30
    left.progress("ballistic", Status("cvt", 0, 10, 100, 5, 1, ""))  # 100 s a run
    assert left.seconds() == pytest.approx(90)  # no less than the longest
    left.without("ballistic", "cvt", 0)
    assert left.seconds() == pytest.approx(20)
    known = TimeLeft(jobs, 1, [("ballistic", [replace_seconds(done, 7)]), ("air-hockey", [replace_seconds(done, 50)])])
    assert known.seconds() == pytest.approx(7 + 7 + 7 + 50)
    assert TimeLeft([], 2, [("ballistic", [done])]).seconds() == 0


def replace_seconds(result, seconds):
    return result._replace(seconds=float(seconds))
