import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import commands
import naive
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib import image
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import ndtr
from scipy.stats import mannwhitneyu, ranksums

import auroraqd
from auroraqd import _workers
from auroraqd.experiments import replication, settings
from auroraqd.experiments.catalogue import CLAIMS, EXPERIMENTS
from auroraqd.experiments.follow_up import FOLLOW_UP
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.replication import Job, Point, Result, looked_at, replicate
from auroraqd.experiments.runner import execute, plan
from auroraqd.experiments.statistics import Effect, Quartiles, comparisons, holm, rank_sums, summaries
from auroraqd.experiments.variants import AIR_HOCKEY, BALLISTIC, Variant
from auroraqd.report import write_report
from auroraqd.runs import folders

SMALL = BALLISTIC.base(generations=4, batch_size=40)
FEW = ["hand-coded", "pca-incremental", "genotype"]


class Quiet:
    """A listener that remembers."""

    def __init__(self):
        self.results, self.given_up, self.statuses = [], [], []

    def progress(self, status):
        self.statuses.append(status)

    def finished(self, result):
        self.results.append(result)

    def failed_run(self, job, reason):
        self.given_up.append((job.variant, job.replication, reason))


def run_all(ledger, names=FEW, replications=2, base=SMALL, workers=2, listener=None, experiment=BALLISTIC):
    listener = listener or Quiet()
    jobs, known = plan(ledger, experiment, names, replications, base)
    execute(jobs, known, ledger, workers, listener)
    return listener


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("experiment")
    run_all(Ledger(folder))
    return folder


SOME = ["hand-coded", "pca-incremental"]


@pytest.fixture(scope="module")
def air_hockey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("air-hockey")
    run_all(Ledger(folder), SOME, base=AIR_HOCKEY.base(generations=4, batch_size=40), workers=1, experiment=AIR_HOCKEY)
    return folder


def result(variant="pca-incremental", replication=0, klc=1.0, **values):
    numbers = {name: kind(replication + 1) for name, kind in Result.__annotations__.items() if kind in (int, float)}
    return Result(**{**numbers, "variant": variant, "replication": replication, "measures": {"klc": klc}, **values})


def test_the_papers_eight_are_there():
    paper = {name: variant.paper for name, variant in BALLISTIC.variants.items() if variant.paper is not None}
    assert paper == {
        "hand-coded": 0.0,
        "genotype": 0.686,
        "pca-incremental": 0.051,
        "pca-pretrained": 0.053,
        "ae-incremental": 0.097,
        "ae-pretrained": 0.528,
        "cvt-prior": 0.704,
        "cvt": 3.2,
    }
    for name, variant in BALLISTIC.variants.items():
        made = variant.of(BALLISTIC.base(), 7)
        assert (made.seed, made.generations, made.batch_size, made.variation.at_least_one) == (7, 5000, 200, False)
        assert settings.Settings.from_json(json.loads(json.dumps(made.as_json()))) == made
        assert made.pretrained == (name.split("-")[1:2] in (["pretrained"], ["prior"]))


OTHERS = [
    {"emitter": "goals:random=0.5,first=10"},
    {"emitter": "novelty-search:population=20,k=3", "archive": "dominated:capacity=60,k=2"},
    {"emitter": "nslc"},
    {"emitter": "taxons:elite=2,first=1", "descriptor": "pca"},
    {"selection": "novelty", "resolution": "csc:target=500"},
    {"selection": "mixed", "descriptor": "pca"},
]


@pytest.mark.parametrize("texts", OTHERS, ids=lambda texts: "-".join(texts.values()))
def test_algorithms_beside_the_paper_are_settings(texts):
    values = {name: settings.strategy(name, text) if name != "descriptor" else text for name, text in texts.items()}
    made = settings.Settings(**{"descriptor": "hand-coded", "batch_size": 30, "generations": 4, **values})
    again = settings.Settings.from_json(json.loads(json.dumps(made.as_json())))
    assert again == made
    first, second = (each.build()[1].run(each.build_task(), generations=4) for each in (made, again))
    assert_array_equal(first.archive.genotype, second.archive.genotype)
    assert (first.archive.born >= 30).any()


def test_earlier_settings_have_no_emitter():
    values = settings.Settings().as_json()
    del values["emitter"]
    assert settings.Settings.from_json(values) == settings.Settings()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("emitter", "nslc:variation=gaussian", "emitter 'nslc' has no option 'variation'"),
        ("emitter", "goals:first=x", "first must be a whole number"),
        ("emitter", "cma", "emitter must be one of genetic, goals"),
        ("selection", "mixed:a=novelty", "selection 'mixed' has no option 'a'"),
        ("archive", "dominated:capacity=0", "capacity must"),
        ("resolution", "csc:target=0", "target must"),
    ],
)
def test_algorithms_that_cannot_be(name, text, message):
    with pytest.raises(ValueError, match=message):
        settings.strategy(name, text)


def test_selection_is_for_the_genetic_emitter():
    with pytest.raises(ValueError, match="selection and variation are for the emitter 'genetic', and Goals"):
        settings.Settings(emitter=settings.strategy("emitter", "goals"), selection=settings.strategy("selection", "novelty"))


def test_pretrained_without_a_split():
    assert BALLISTIC.variants["ae-pretrained"].of(SMALL, 0).parameters()["validation"] == 0
    assert BALLISTIC.variants["ae-pretrained-split"].of(SMALL, 0).parameters()["validation"] == 0.25
    one, other = (BALLISTIC.variants[name].of(SMALL, 0).parameters() for name in ("ae-incremental", "ae-isometric"))
    assert {key for key in one if one[key] != other[key]} == {"isometry"}


def test_looked_at():
    assert sorted(looked_at(5000))[:9] == [1, 2, 5, 10, 20, 35, 50, 100, 200]
    assert max(looked_at(5000)) == 5000
    assert looked_at(3) == {1, 2, 3}  # fewer generations than looks
    assert looked_at(1) == {1}


def test_results_are_measured_against_the_reference_of_the_replication(experiment):
    ledger = Ledger(experiment)
    assert [(r.variant, r.replication) for r in ledger.results] == [
        (name, i) for name in ("genotype", "hand-coded", "pca-incremental") for i in range(2)
    ]
    for row in ledger.results:
        repertoire = auroraqd.load(ledger.run_folder(row.variant, row.replication))
        reference = auroraqd.load(ledger.run_folder("hand-coded", row.replication)).ground_truth
        assert row.size == len(repertoire)
        assert row.seed == row.replication
        assert_allclose(row.measures["klc"], auroraqd.metrics.klc(reference, repertoire.ground_truth), rtol=1e-5)
        marginal = auroraqd.metrics.klc(reference, repertoire.ground_truth, marginal=True)
        assert_allclose(row.measures["klc_marginal"], marginal, rtol=1e-5)
        assert_allclose(row.measures["outside"], auroraqd.metrics.outside(reference, repertoire.ground_truth), rtol=1e-5)
        assert_allclose(row.measures["reached"], auroraqd.metrics.reached(reference, repertoire.ground_truth), rtol=1e-5)
        assert row.measures["klc"] == 0 if row.variant == "hand-coded" else row.measures["klc"] > 0
        if row.variant == "pca-incremental":
            assert_allclose(row.rmse, repertoire.reconstruction_error.mean(), rtol=1e-5)
            error = auroraqd.metrics.reconstruction_error(repertoire.observation, repertoire.reconstruct(repertoire.descriptor))
            assert_allclose(row.rmse_metres, error.mean(), rtol=1e-5)
        else:
            assert np.isnan(row.rmse)
            assert np.isnan(row.rmse_metres)
    last = [p for p in ledger.points if p.generation == 4]
    assert [(p.variant, p.replication, p.size, p.measures["klc"]) for p in last] == [
        (r.variant, r.replication, r.size, r.measures["klc"]) for r in ledger.results
    ]
    assert {p.generation for p in ledger.points} == looked_at(4)


def test_air_hockey_is_measured_without_a_reference(air_hockey):
    ledger = Ledger(air_hockey)
    assert [(r.variant, r.replication) for r in ledger.results] == [(name, i) for name in sorted(SOME) for i in range(2)]
    for row in ledger.results:
        repertoire = auroraqd.load(ledger.run_folder(row.variant, row.replication))
        for name, bins in (("diversity", 10), ("diversity_20", 20)):
            assert row.value(name) == pytest.approx(auroraqd.metrics.diversity(repertoire.observation, bins), rel=1e-5)
        ends = repertoire.observation[:, -1]
        assert row.value("even") == pytest.approx(auroraqd.metrics.effective_cells(ends, 20), rel=1e-5)
        assert row.value("walls") == pytest.approx((np.abs(ends).max(axis=1) > 0.84).mean(), rel=1e-5)
        assert row.value("size") == len(repertoire)
    followed = [p.value("diversity_20") for p in ledger.points if (p.variant, p.replication) == ("pca-incremental", 1)]
    assert len(followed) == len(looked_at(4))
    assert followed[-1] == next(r for r in ledger.results if r.variant == "pca-incremental" and r.replication == 1).value(
        "diversity_20"
    )
    assert all(np.isnan(p.value("klc")) for p in ledger.points)


def test_without_a_reference_only_what_is_asked_for_is_grown(tmp_path):
    jobs, known = plan(Ledger(tmp_path), AIR_HOCKEY, ["cvt", "ae-incremental"], 2, AIR_HOCKEY.base(4, 40))
    assert [(job.variant, job.replication, job.reference) for job in jobs] == [
        (name, i, None) for i in range(2) for name in ("cvt", "ae-incremental")
    ]
    assert set(known) == {"cvt", "ae-incremental"}


def test_results_of_another_experiment_are_not_mixed(experiment):
    with pytest.raises(ValueError, match=r"task 'ballistic' and not 'air-hockey'"):
        plan(Ledger(experiment), AIR_HOCKEY, ["hand-coded"], 1, AIR_HOCKEY.base(4, 40))


@pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=list(EXPERIMENTS))
def test_experiments_hold_together(experiment):
    for name, variant in experiment.variants.items():
        assert variant.name == name
        made = variant.of(experiment.base(), 3)
        assert made.task.partition(":")[0] == experiment.task.partition(":")[0]
        assert (made.generations, made.batch_size) == (experiment.generations, experiment.batch_size)
        assert settings.Settings.from_json(json.loads(json.dumps(made.as_json()))) == made
    names = [measure.name for measure in experiment.measures]
    assert len(set(names)) == len(names)
    assert not set(names) & {*Result._fields, *Point._fields}
    assert set(experiment.tested) <= {*names, *Result._fields}
    assert experiment.reference is None or experiment.reference in experiment.variants


def test_nothing_stored_is_said(tmp_path, monkeypatch):
    def invalid(task, genotypes):
        return np.full(len(genotypes), np.nan), np.zeros((len(genotypes), 50, 2)), np.zeros((len(genotypes), 2))

    monkeypatch.setattr(auroraqd.tasks.AirHockey, "__call__", invalid)
    made = AIR_HOCKEY.variants["hand-coded"].of(AIR_HOCKEY.base(2, 10), 0)
    said = pytest.warns(UserWarning, match="gave no valid individual in 2 generations")
    with said, pytest.raises(ValueError, match="nothing was stored"):
        replicate(Job("hand-coded", 0, made, tmp_path, None, AIR_HOCKEY.measures), listener=lambda aurora: None)


def interrupted(job, beside, generation):
    """Do a run until it is interrupted, and beside it, in another folder, the whole of it, which is returned."""

    def interrupt(aurora):
        if aurora.generation == generation:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replicate(job, interrupt)
    return replicate(job._replace(folder=beside), listener=lambda aurora: None)


@pytest.mark.parametrize("experiment", [AIR_HOCKEY, FOLLOW_UP], ids=lambda experiment: experiment.name)
def test_numbers_that_were_taken_before_an_interruption_are_kept(experiment, tmp_path, monkeypatch):
    monkeypatch.setattr(replication, "_EVERY", 0.0)
    made = experiment.variants["hand-coded"].of(experiment.base(12, 40), 1)
    job = Job("a", 1, made, tmp_path / "b", None, experiment.measures)
    whole, points = interrupted(job, tmp_path / "a", 8)
    done = []
    again, points_again = replicate(job, lambda aurora: done.append(aurora.generation))
    assert done == [9, 10, 11, 12]
    assert repr(again._replace(seconds=0)) == repr(whole._replace(seconds=0))  # NaN is not NaN
    assert repr(points_again) == repr(points)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("runs.csv", lambda text: text + text.splitlines()[1] + "\n", "runs.csv is damaged: it lists genotype 0 2 times"),
        ("runs.csv", lambda text: text.replace("genotype,0,", "genotype,-5,", 1), "it lists a replication -5 of genotype"),
        ("runs.csv", lambda text: "", "runs.csv is damaged: the columns must be variant, replication"),
        ("runs.csv", lambda text: text[: text.rindex(",")], r"runs.csv is damaged: line 7 must have \d+ columns, got \d+"),
        (
            "curves.csv",
            lambda text: text[: text.rindex(",")],
            r"curves.csv is damaged: line \d+ must have \d+ columns, got \d+",
        ),
    ],
)
def test_damaged_tables(name, change, message, experiment, tmp_path):
    shutil.copytree(experiment, tmp_path / "copy", ignore=shutil.ignore_patterns("runs"))
    file = tmp_path / "copy" / name
    file.write_text(change(file.read_text()))
    with pytest.raises(ValueError, match=message):
        Ledger(tmp_path / "copy")


def test_budgets_are_not_mixed(experiment):
    longer = BALLISTIC.variants["cvt-prior"].of(replace(SMALL, generations=5), 0)
    with pytest.raises(ValueError, match="holds results of genotype after 4 generations of 40 and not 5 generations of 40"):
        Ledger(experiment).check({"cvt-prior": longer})


def test_a_run_is_the_same_alone(experiment, tmp_path):
    """In a worker process or in this one."""
    ledger = Ledger(experiment)
    made = BALLISTIC.variants["pca-incremental"].of(SMALL, 1)
    alone, _ = replicate(
        Job("pca-incremental", 1, made, tmp_path, ledger.run_folder("hand-coded", 1), BALLISTIC.measures),
        listener=lambda aurora: None,
    )
    assert alone.size == next(r.size for r in ledger.results if (r.variant, r.replication) == ("pca-incremental", 1))
    assert_array_equal(auroraqd.load(tmp_path).genotype, auroraqd.load(ledger.run_folder("pca-incremental", 1)).genotype)


def test_streams_have_no_common_unit(tmp_path):
    made = replace(AIR_HOCKEY.variants["pca-incremental"].of(AIR_HOCKEY.base(3, 40), 0), task="air-hockey:pucks=2")
    found, _ = replicate(Job("a", 0, made, tmp_path, None, ()), listener=lambda aurora: None)
    assert 0 < found.rmse < 1
    assert np.isnan(found.rmse_metres)


@pytest.mark.parametrize("damaged", [False, True], ids=["goes on", "begins anew"])
def test_a_run_that_is_interrupted_goes_on_where_it_was(damaged, experiment, tmp_path, monkeypatch):
    monkeypatch.setattr(replication, "_EVERY", 0.0)
    reference, made = Ledger(experiment).run_folder("hand-coded", 1), BALLISTIC.variants["pca-incremental"].of(SMALL, 1)
    made = replace(made, generations=60)  # with an update, and more looks than one
    job = Job("a", 1, made, tmp_path / "b", reference, BALLISTIC.measures)
    whole, points = interrupted(job, tmp_path / "a", 53)
    assert len(list((job.folder / "looks").iterdir())) == sum(g < 53 for g in looked_at(60))
    if damaged:
        (job.folder / "looks" / "2.safetensors").write_bytes(b"")
    done = []
    again, points_again = replicate(job, lambda aurora: done.append(aurora.generation))
    assert done == list(range(1 if damaged else 54, 61))
    assert again._replace(seconds=0) == whole._replace(seconds=0)
    assert points_again == points
    assert not (job.folder / "looks").exists()
    other = job._replace(settings=replace(made, seed=2))  # another run in the folder is none of this one
    replicate(other, lambda aurora: done.append(aurora.generation))
    assert done[-60:] == list(range(1, 61))


def test_what_is_done_is_skipped(experiment):
    ledger = Ledger(experiment)
    assert plan(ledger, BALLISTIC, FEW, 2, SMALL)[0] == []
    jobs, _ = plan(ledger, BALLISTIC, FEW, 3, SMALL)
    assert [(job.variant, job.replication) for job in jobs] == [("hand-coded", 2), ("pca-incremental", 2), ("genotype", 2)]
    assert [job.settings.seed for job in jobs] == [2, 2, 2]


def test_the_reference_is_grown_for_others_and_again_where_it_is_missing(tmp_path):
    ledger = Ledger(tmp_path)
    jobs, known = plan(ledger, BALLISTIC, ["genotype"], 1, SMALL)
    assert [job.variant for job in jobs] == ["hand-coded", "genotype"]
    assert set(known) == {"hand-coded", "genotype"}
    ledger.add(known["hand-coded"], result("hand-coded"), [])  # its numbers came from elsewhere, without the repertoire
    assert [job.variant for job in plan(ledger, BALLISTIC, ["genotype"], 1, SMALL)[0]] == ["hand-coded", "genotype"]
    ledger.add(known["genotype"], result("genotype"), [])
    assert plan(ledger, BALLISTIC, ["genotype"], 1, SMALL)[0] == []


def test_results_of_other_settings_are_not_mixed(experiment):
    with pytest.raises(ValueError, match=r"holds results of .* with other settings, generations 4 and not 5: choose another"):
        plan(Ledger(experiment), BALLISTIC, FEW, 2, replace(SMALL, generations=5))
    changed = replace(
        BALLISTIC.variants["genotype"], settings={"descriptor": "genotype", "selection": settings.selection.Uniform()}
    )
    with pytest.raises(ValueError, match=r"holds results of genotype with other settings, selection"):
        plan(
            Ledger(experiment), replace(BALLISTIC, variants={**BALLISTIC.variants, "genotype": changed}), ["genotype"], 2, SMALL
        )


def test_defaults_of_an_estimator_are_settings_too(tmp_path, monkeypatch):
    ledger = Ledger(tmp_path)
    made = BALLISTIC.variants["ae-incremental"].of(SMALL, 0)
    ledger.add(made, result("ae-incremental"), [])
    Ledger(tmp_path).check({"ae-incremental": made})
    monkeypatch.setattr(settings.Settings, "parameters", lambda self: {"patience": 3})
    with pytest.raises(ValueError, match="other settings, parameters"):
        Ledger(tmp_path).check({"ae-incremental": made})


@pytest.mark.parametrize("name", ["runs.csv", "curves.csv", "settings.json"])
@pytest.mark.parametrize("content", ["", "variant,klc\n", "{", "[]", '{"hand-coded": 5}', "variant\nx,y\n"])
def test_damaged_results(experiment, tmp_path, name, content):
    for file in ("runs.csv", "curves.csv", "settings.json"):
        (tmp_path / file).write_bytes((experiment / file).read_bytes())
    (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=rf"{name} is damaged"):
        Ledger(tmp_path)


def test_results_without_their_settings(experiment, tmp_path):
    for file in ("runs.csv", "curves.csv"):
        (tmp_path / file).write_bytes((experiment / file).read_bytes())
    with pytest.raises(
        ValueError, match="must hold the settings of every variant with results, and has none of genotype, hand"
    ):
        Ledger(tmp_path)


def test_a_damaged_reference_is_grown_again(tmp_path):
    ledger = Ledger(tmp_path)
    run_all(ledger, ["hand-coded"], 1)
    file = ledger.run_folder("hand-coded", 0) / "repertoire.safetensors"
    file.write_bytes(file.read_bytes()[:1000])
    write_report(ledger, BALLISTIC)
    run_all(ledger, ["genotype"], 1)
    assert {r.variant for r in Ledger(tmp_path).results} == {"hand-coded", "genotype"}


def test_a_ledger_comes_back(tmp_path):
    ledger = Ledger(tmp_path)
    made = BALLISTIC.variants["genotype"].of(SMALL, 0)
    row = result("genotype", 3, klc=0.25, rmse=float("nan"))
    ledger.add(made, row, [Point("genotype", 3, 1, 10, float("nan"), 0.1, {"klc": 0.5})])
    ledger.add(made, result("genotype", 0), [])
    again = Ledger(tmp_path)
    assert [r.replication for r in again.results] == [0, 3]
    assert repr(again.results[1]) == repr(row)
    assert repr(again.points) == repr([Point("genotype", 3, 1, 10, float("nan"), 0.1, {"klc": 0.5})])
    again.add(made, row._replace(measures={"klc": 0.125}), [])
    assert [r.measures["klc"] for r in Ledger(tmp_path).results] == [1.0, 0.125]
    assert Ledger(tmp_path).points == []


def test_two_at_work_in_one_folder(tmp_path):
    one, other = Ledger(tmp_path), Ledger(tmp_path)
    made = BALLISTIC.variants["genotype"].of(SMALL, 0)
    one.add(made, result("genotype", 0), [])
    other.add(made, result("genotype", 1), [])
    assert [r.replication for r in Ledger(tmp_path).results] == [0, 1]
    with pytest.raises(ValueError, match="other settings"):
        other.add(replace(made, k=3), result("genotype", 2), [])


def test_a_failing_run_is_given_up_and_the_others_go_on(tmp_path):
    ledger = Ledger(tmp_path)
    jobs, known = plan(ledger, BALLISTIC, FEW, 2, SMALL)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "genotype-0").write_text("in the way")
    listener = Quiet()
    execute(jobs, known, ledger, 1, listener)
    assert [given_up[:2] for given_up in listener.given_up] == [("genotype", 0)]
    assert "must be a folder, and is a file" in listener.given_up[0][2]
    assert len(listener.results) == len(Ledger(tmp_path).results) == 5


def test_a_variant_may_have_an_emitter_with_a_state(tmp_path):
    variant = Variant("novelty", "novelty search", {"descriptor": "pca", "emitter": auroraqd.emitters.NoveltySearch()})
    ledger, listener = Ledger(tmp_path), Quiet()
    jobs, known = plan(
        ledger,
        replace(AIR_HOCKEY, variants={"novelty": variant}),
        ["novelty"],
        2,
        settings.Settings(task="air-hockey", generations=2, batch_size=40),
    )
    with ThreadPoolExecutor(1) as here:
        execute(jobs, known, ledger, 1, listener, here)
    assert listener.given_up == []
    assert [(row.variant, row.replication) for row in ledger.results] == [("novelty", 0), ("novelty", 1)]


def test_without_its_reference_a_run_is_given_up_too(tmp_path):
    ledger = Ledger(tmp_path)
    jobs, known = plan(ledger, BALLISTIC, FEW, 1, SMALL)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "hand-coded-0").write_text("in the way")
    listener = Quiet()
    execute(jobs, known, ledger, 1, listener)
    assert sorted(name for name, _, _ in listener.given_up) == ["genotype", "hand-coded", "pca-incremental"]
    assert ledger.results == []


class Killer(Quiet):
    """Kills workers, the first times it hears of one."""

    def __init__(self, times):
        super().__init__()
        self.times = times

    def progress(self, status):
        super().progress(status)
        if self.times > 0 and status.variant == "pca-incremental":
            self.times -= 1
            for child in multiprocessing.active_children():
                if "Spawn" in type(child).__name__ and "Manager" not in child.name:
                    child.kill()


def test_a_worker_that_dies_is_replaced(tmp_path):
    listener = Killer(1)
    run_all(Ledger(tmp_path), replications=1, base=replace(SMALL, generations=400), workers=1, listener=listener)
    assert listener.times == 0
    assert listener.given_up == []
    assert len(Ledger(tmp_path).results) == 3


def test_a_run_that_kills_its_worker_twice_is_given_up(tmp_path):
    listener = Killer(100)
    run_all(Ledger(tmp_path), replications=1, base=replace(SMALL, generations=400), workers=1, listener=listener)
    assert listener.given_up == [("pca-incremental", 0, "its process died, twice")]
    assert {r.variant for r in Ledger(tmp_path).results} == {"hand-coded", "genotype"}


class Sniper(Quiet):
    """Kills the worker of one run whenever it hears of it."""

    def progress(self, status):
        if (status.variant, status.replication) == ("hand-coded", 0):
            for child in multiprocessing.active_children():
                if child.pid == status.pid:
                    child.kill()


def test_who_ran_beside_it_is_innocent(tmp_path):
    listener = Sniper()
    run_all(Ledger(tmp_path), ["hand-coded"], 3, replace(SMALL, generations=600), 2, listener)
    assert listener.given_up == [("hand-coded", 0, "its process died, twice")]
    assert [r.replication for r in Ledger(tmp_path).results] == [1, 2]


def test_workers_keep_to_one_thread_and_the_environment_is_restored(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    with _workers.one_thread():
        assert os.environ["OMP_NUM_THREADS"] == os.environ["NUMBA_NUM_THREADS"] == "1"
        assert "multi_thread_eigen=false" in os.environ["XLA_FLAGS"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "XLA_FLAGS" not in os.environ


def test_quartiles_and_summaries():
    assert Quartiles.of(np.array([1.0, 2.0, 3.0, 4.0, np.nan])) == (2.5, 1.75, 3.25)
    assert np.isnan(Quartiles.of(np.array([np.nan]))).all()
    rows = [result("genotype", i, klc=float(i)) for i in range(5)] + [result("cvt", 0, klc=9.0)]
    found = summaries(rows, BALLISTIC)
    assert [(s.variant.name, s.replications, s.measures["klc"].median) for s in found] == [
        ("genotype", 5, 2.0),
        ("cvt", 1, 9.0),
    ]


def test_rank_sums():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=40), rng.normal(size=50) + 0.4
    rows = [result("genotype", i, klc=float(v)) for i, v in enumerate(a)]
    rows += [result("cvt", i, klc=float(v)) for i, v in enumerate(b)]
    tests = rank_sums([*rows, result("hand-coded", 0, klc=0.0)], "klc")
    assert set(tests) == {("genotype", "cvt")}
    assert tests["genotype", "cvt"] == pytest.approx(ranksums(a, b).pvalue, rel=0.05)
    exact = [result("genotype", i, klc=float(i)) for i in range(3)] + [result("cvt", i, klc=9.0 + i) for i in range(3)]
    assert rank_sums(exact, "klc")["genotype", "cvt"] == pytest.approx(0.1)  # 2 of 20 orders


@given(st.lists(st.integers(0, 9), min_size=1, max_size=12), st.lists(st.integers(0, 9), min_size=1, max_size=12))
@example([5, 6], [1, 2]).via("no overlap")
@example([1], [2]).via("one each")
@example([3] * 12, [3] * 5).via("all alike")
def test_effects_agree_with_their_twin(one, other):
    a, low, high = Effect.of(np.array(one, float), np.array(other, float))
    assert a == pytest.approx(naive.superiority(one, other))
    assert a == pytest.approx(mannwhitneyu(one, other).statistic / (len(one) * len(other)))
    assert (low, high) == pytest.approx(naive.superiority_interval(a, len(one), len(other), steps=2000), abs=1e-3)
    assert Effect.of(np.array(other, float), np.array(one, float)) == pytest.approx((1 - a, 1 - high, 1 - low))


def test_intervals_of_effects_hold_what_they_promise():
    """Where both are drawn from normal distributions one standard deviation apart, 0.76 is in about 95% of them."""
    rng = np.random.default_rng(0)
    truth = ndtr(1 / np.sqrt(2))
    drawn = [Effect.of(rng.normal(1, 1, 20), rng.normal(0, 1, 10)) for _ in range(600)]
    assert 0.92 < np.mean([low <= truth <= high for _, low, high in drawn]) < 0.99


@given(st.lists(st.sampled_from([0.0, 1e-9, 0.001, 0.01, 0.012, 0.04, 0.2, 0.9, 1.0]), max_size=12))
def test_holm_agrees_with_its_twin(pvalues):
    assert holm(pvalues) == pytest.approx(naive.holm(pvalues))


def test_comparisons_are_of_all_pairs():
    rows = [result(name, i, klc=float(10 * k + i)) for k, name in enumerate(["genotype", "cvt", "ae"]) for i in range(4)]
    found = comparisons([*rows, result("hand-coded", 0, klc=0.0)], "klc")
    assert {pair: c.p for pair, c in found.items()} == rank_sums(rows, "klc")
    assert [c.corrected for c in found.values()] == pytest.approx([3 * 2 / 70] * 3)
    assert found["genotype", "cvt"].effect.a == 0
    assert found["genotype", "cvt"].swapped.effect.a == 1


def check_pictures(files):
    for path in files:
        if path.suffix == ".png":
            pixels = image.imread(path)[..., :3]
            assert (pixels < 0.9).any(axis=2).mean() > 0.01
            assert len(np.unique((pixels * 8).astype(int).reshape(-1, 3), axis=0)) > 5


def test_report(experiment):
    files = write_report(Ledger(experiment), BALLISTIC)
    assert {f.name for f in files} == {
        *("summary.csv", "summary.md"),
        *(f"{name}.{suffix}" for name in ("curves", "repertoires") for suffix in ("png", "svg")),
    }
    check_pictures(files)
    header, *lines = (experiment / "summary.csv").read_text().splitlines()
    table = {line.split(",")[0]: dict(zip(header.split(","), line.split(","), strict=True)) for line in lines}
    assert list(table) == ["hand-coded", "genotype", "pca-incremental"]
    assert table["genotype"]["klc_paper"] == "0.686"
    klcs = [r.measures["klc"] for r in Ledger(experiment).results if r.variant == "genotype"]
    assert float(table["genotype"]["klc_median"]) == pytest.approx(np.median(klcs), rel=1e-4)
    text = (experiment / "summary.md").read_text()
    assert "| AURORA-PCA incremental | 2 | 0.051 |" in text
    assert "Rank-sum tests on the KLC" in text
    assert "after Holm's correction for these 3 pairs" in text
    assert re.search(r"\| hand-coded \| 0\.00 \(0\.00, 0\.\d\d\), p = ", text)


def test_report_of_air_hockey(air_hockey):
    files = write_report(Ledger(air_hockey), AIR_HOCKEY)
    assert {f.stem for f in files} == {"summary", "curves", "repertoires", "diversity"}
    check_pictures(files)
    text = (air_hockey / "summary.md").read_text()
    assert "paper" not in text  # which gives no numbers
    for title in ("diversity, 10 x 10", "diversity, 20 x 20"):
        assert f"Rank-sum tests on the {title}, two-sided" in text


def test_report_without_repertoires(experiment, tmp_path):
    """Numbers of another machine."""
    for file in ("runs.csv", "curves.csv", "settings.json"):
        (tmp_path / file).write_bytes((experiment / file).read_bytes())
    names = {path.name for path in write_report(Ledger(tmp_path), BALLISTIC)}
    assert names == {"summary.csv", "summary.md", "curves.png", "curves.svg"}


@pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=list(EXPERIMENTS))
def test_quickened_variants_build(experiment, tmp_path, monkeypatch):
    monkeypatch.setenv("AURORAQD_CACHE", str(tmp_path))
    for variant in experiment.quickened().variants.values():
        _, aurora = variant.of(experiment.base(4, 40), 0).build()
        assert aurora.generation == 0


REPRODUCE = ["reproduce", "ballistic"]
PAPER_FILES = ("paper.md", "paper.html", "paper.pdf")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_command_is_interrupted_and_goes_on(tmp_path):
    """Killed, then interrupted, then left alone: no process survives its parent, and no result is lost."""
    arguments = [*REPRODUCE, "--variants", "pca-incremental,genotype", "--replications", "2", "--generations", "300"]
    arguments += ["--out", str(tmp_path / "out"), "--jobs", "1"]

    def done():
        path = tmp_path / "out" / "runs.csv"
        return len(path.read_text().splitlines()) - 1 if path.is_file() else 0

    for end in (signal.SIGKILL, signal.SIGINT):
        before = done()
        process = subprocess.Popen([*commands.CLI, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        deadline = time.monotonic() + 120
        while done() == before and time.monotonic() < deadline:
            time.sleep(0.05)
        children = _children(process.pid)
        assert children
        process.send_signal(end)
        output, _ = process.communicate(timeout=60)
        assert process.returncode == (130 if end == signal.SIGINT else -signal.SIGKILL)
        assert "Traceback" not in output
        assert ("the same command goes on" in output) == (end == signal.SIGINT)
        deadline = time.monotonic() + 30
        while any(map(_alive, children)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not any(map(_alive, children))
    kept = done()
    assert 2 <= kept < 6
    finished = commands.cli(*arguments)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert f"{6 - kept} runs to do, {kept} done before" in finished.stdout
    assert done() == 6
    again = commands.cli(*arguments)
    assert again.returncode == 0, again.stderr
    assert "0 runs to do, 6 done before" in again.stdout
    assert "Rank-sum tests" in again.stdout


def _stat(pid):
    """The fields of a process after its name; none when it has ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ["Z", "0"]


def _children(pid):
    return [int(entry) for entry in os.listdir("/proc") if entry.isdigit() and _stat(entry)[1] == str(pid)]


def _alive(pid):
    return _stat(pid)[0] != "Z"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--variants", "pca,magic"], "variants of ballistic must be of hand-coded, genotype,"),
        (["--replications", "0"], "replications must be 1 or more, got 0"),
        (["--jobs", "0"], "jobs must be 1 or more, got 0"),
        (["--generations", "-1"], "generations must be 1 or more, got -1"),
    ],
)
def test_mistakes_get_a_sentence(tmp_path, arguments, message):
    done = commands.cli(*REPRODUCE, *arguments, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert message in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_command_with_results_of_other_settings(experiment):
    done = commands.cli(*REPRODUCE, "--variants", "genotype", "--generations", 9, "--out", experiment)
    assert done.returncode == 1
    assert "with other settings, generations 4 and not 9" in " ".join(done.stderr.split())
    assert folders.load_config(experiment / "runs" / "genotype-0")["generations"] == 4


def test_the_paper_at_once(tmp_path):
    """All experiments, and one report."""
    small = ["--variants", "hand-coded", "--replications", 1, "--generations", 2, "--jobs", 1, "--out", tmp_path / "out"]
    done = commands.cli("reproduce", "paper", *small)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3/3 hand-coded 0" in done.stdout
    assert [len(Ledger(tmp_path / "out" / name).results) for name in EXPERIMENTS] == [1, 1, 1]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*EXPERIMENTS, *PAPER_FILES}
    assert f"Of {len(CLAIMS)} claims: 1 agree" in done.stdout  # the reference beside itself
    wrong = commands.cli("reproduce", "papers", "--out", tmp_path / "no")
    assert "task must be one of ballistic, air-hockey, follow-up, paper, got 'papers'" in " ".join(wrong.stderr.split())
