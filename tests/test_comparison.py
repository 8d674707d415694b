"""The benchmark behind docs/comparison.md, and whether that page says what its results are."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import comparison
import latent
import numpy as np
import pucks
import pytest
import seeing
import sphere
from numpy.testing import assert_allclose

import auroraqd
from auroraqd.experiments.ledger import Ledger
from auroraqd.experiments.replication import Result
from auroraqd.experiments.settings import Settings

pytest.importorskip("ribs")
HOME = Path(__file__).parent.parent


@pytest.mark.parametrize("task", comparison.ALGORITHMS)
def test_every_algorithm_runs(task):
    experiment = comparison.ALGORITHMS[task]
    for name, variant in experiment.variants.items():
        if "autoencoder" in variant.settings["descriptor"]:  # which takes long, and is run elsewhere
            continue
        made, aurora = variant.of(Settings(task=task), 0).build()
        aurora.run(made, generations=2)
        assert len(aurora.archive), name
        for measure in experiment.measures:
            looked = measure.look(aurora.archive)
            assert np.isfinite(measure.score(looked, looked))


def test_as_many_individuals_are_drawn():
    task = auroraqd.tasks.AirHockey()
    aurora = auroraqd.Aurora(8, "hand-coded", seed=0, batch_size=100).run(task, generations=3)
    drawn = partial(comparison.drawn, aurora.archive, bins=20)
    assert drawn(number=30) < drawn(number=len(aurora.archive))
    assert drawn(number=10**6) == auroraqd.metrics.diversity(aurora.archive.observation, 20)


def result(variant, replication, **values):
    numbers = {name: kind(1) for name, kind in Result.__annotations__.items() if kind in (int, float)}
    return Result(**{**numbers, "variant": variant, "replication": replication, **values})


def test_the_table_is_in_order_and_tests_against_aurora(tmp_path):
    ledger, experiment, fast = Ledger(tmp_path), comparison.ALGORITHMS["air-hockey"], []
    for i, (variant, value) in enumerate({comparison.AURORA: 100.0, "random": 10.0, "surprise": 200.0}.items()):
        for seed in range(5):
            measures = {"diversity_20": value, "diversity_drawn": value + seed}
            ledger.results.append(result(variant, seed, measures=measures))
            fast.append(comparison.Speed(variant, seed, 10, 200, 2.0 + i))
    *_, first, second, third = comparison.algorithms_table(ledger, experiment, fast).splitlines()
    assert first.startswith("| selection by surprise")
    assert second.startswith("| AURORA")
    assert third.endswith("| 0.0079 | 667 | 0.67 |")  # exact, of five beside five that do not overlap


def test_speed_is_measured_once(tmp_path, capsys):
    experiment = comparison.ALGORITHMS["ballistic"]
    experiment = replace(experiment, variants={name: experiment.variants[name] for name in ("aurora", "random")})
    for lines in (4, 0):
        found = comparison.speeds(tmp_path / "speed.csv", experiment, 2, 3)
        assert sorted(row[:4] for row in found) == [(name, i, 3, 200) for name in ("aurora", "random") for i in range(2)]
        assert all(0 < row.seconds < 60 for row in found)
        assert capsys.readouterr().out.count("\n") == lines


def test_when_a_number_arrives_to_stay():
    assert comparison._arrival([(1, 10), (2, 100), (3, 120), (4, 104), (5, 96)], 100) == "4"
    assert comparison._arrival([(1, 10), (2, 90)], 100) == "never"
    assert comparison._arrival([(1, 100)], 100) == "1"


def test_the_sphere_is_theirs():
    solutions = np.array([[2.048] * 4, [0.0, 0.0, 10.24, -5.12]])
    objective, measures = sphere.sphere(solutions)
    assert_allclose(objective, [100, 100 - 100 * (2 * 2.048**2 + 8.192**2 + 7.168**2) / (4 * 7.168**2)])
    assert_allclose(measures, [[4.096, 4.096], [0, 0.5 - 5.12]])


def test_sphere_runs_go_on_where_they_were(tmp_path, capsys):
    path = tmp_path / "sphere.csv"
    found = sphere.sphere_runs(path, 1, iterations=3)
    both = {(library, kind) for library in sphere.LIBRARIES for kind in sphere.KINDS}
    assert {row[:2] for row in found} == both - {(sphere.OURS, sphere.BY_BATCH)}
    assert all(0 < row.coverage < 1 for row in found)
    assert capsys.readouterr().out.count("\n") == 7
    again = sphere.sphere_runs(path, 1, iterations=3)
    assert [row[:4] for row in sorted(again)] == [row[:4] for row in sorted(found)]
    assert capsys.readouterr().out == ""
    table = sphere.sphere_table(again)
    assert "| CMA-ME | 3 | 1 |" in table
    assert len(sphere.sphere_figure(again).axes) == 4


def test_the_page_says_what_the_results_are():
    page, results = HOME / "docs" / "comparison.md", HOME / "results"
    tables, figures = comparison.report(results)
    assert comparison.filled(page.read_text(), tables) == page.read_text()
    assert all((page.parent / "figures" / f"{name}.png").is_file() for name in figures)


def test_the_page_of_latent_sizes_says_what_the_results_are():
    page, results = HOME / "docs" / "results" / "latent.md", HOME / "results"
    found = latent.table({task: Ledger(results / f"latent-{task}") for task in latent.EXPERIMENTS})
    assert comparison.filled(page.read_text(), {"latent": found}) == page.read_text()
    assert (HOME / "docs" / "figures" / "latent.png").is_file()


def test_the_page_of_pixels_says_what_the_results_are():
    page, results = HOME / "docs" / "results" / "pixels.md", HOME / "results"
    found = seeing.table({task: Ledger(results / f"seeing-{task}") for task in seeing.EXPERIMENTS})
    assert comparison.filled(page.read_text(), {"seeing": found}) == page.read_text()


def test_the_page_of_pucks_says_what_the_results_are():
    page, results = HOME / "docs" / "results" / "pucks.md", HOME / "results"
    found = pucks.table({number: Ledger(results / f"pucks-{number}") for number in pucks.EXPERIMENTS})
    assert comparison.filled(page.read_text(), {"pucks": found}) == page.read_text()


@pytest.mark.parametrize("number", pucks.EXPERIMENTS)
def test_several_pucks_are_measured(number, tmp_path):
    experiment = pucks.EXPERIMENTS[number]
    made, aurora = experiment.variants["pca-5"].of(Settings(task=experiment.task), 0).build()
    seen = aurora.run(made, generations=2).archive.observation
    moved, diversity = (measure.look(aurora.archive) for measure in experiment.measures)
    still = [(seen[name] == seen[name][:, :1]).all(axis=(1, 2)) for name in seen.dtype.names]
    assert moved == pytest.approx(100 * (1 - np.any(still, axis=0).mean()), abs=1)
    each = [auroraqd.metrics.diversity(seen[name], pucks.SQUARES) for name in seen.dtype.names]
    assert diversity == pytest.approx(sum(each))  # fewer than 5,000 are stored
    assert len(each) == number


@pytest.mark.parametrize("task", seeing.EXPERIMENTS)
def test_what_was_seen_is_measured_by_what_was_not(task):
    experiment = seeing.EXPERIMENTS[task]
    made, aurora = experiment.variants["pca"].of(Settings(task=task), 0).build()
    aurora.run(made, generations=2)
    values = [measure.score(measure.look(aurora.archive), None) for measure in experiment.measures]
    if task == seeing.CAMERA:
        ways = auroraqd.tasks.AirHockey()(aurora.archive.genotype).observation
        assert values == [auroraqd.metrics.diversity(ways, seeing.SQUARES)] * 2  # fewer than 5,000 are stored
    else:
        ends = {tuple(place) for place in np.floor(aurora.archive.ground_truth / (seeing.SIDE / seeing.SQUARES)).tolist()}
        assert values[0] == len(ends)
        assert 1 <= values[1] <= values[0]


def test_runs_that_are_missing_are_grown(tmp_path, capsys):
    experiment = comparison.CONTROLLED["ballistic"]
    experiment = replace(experiment, variants={"csc-1000": experiment.variants["csc-1000"]})
    for missing in (1, 0):
        ledger = comparison.grown(experiment, tmp_path, {"csc-1000": 1}, 2, 1)
        assert [(result.variant, result.generations) for result in ledger.results] == [("csc-1000", 2)]
        assert capsys.readouterr().err.count("1/1") == missing


@pytest.mark.parametrize("task", comparison.ALGORITHMS)
def test_local_competition_is_nothing_where_all_are_equally_fit(task):
    results = Ledger(HOME / "results" / f"algorithms-{task}").results
    one, other = (next(r for r in results if r.variant == name and r.replication == 0) for name in ("novelty-search", "nslc"))
    assert (one.size, one.measures) == (other.size, other.measures)


def test_a_page_without_a_place_for_a_table():
    with pytest.raises(ValueError, match="page must have a line <!-- csc -->, and has none"):
        comparison.filled("", {"csc": ""})
