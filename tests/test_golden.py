"""Seeded runs take the course they took: see golden_runs.py."""

import json
import warnings

import golden_runs
import pytest

import auroraqd

KEPT = json.loads(golden_runs.DIGESTS.read_text())


def finished(name):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "the archive is full")
        return golden_runs.RUNS[name]()


@pytest.mark.parametrize("name", golden_runs.RUNS)
def test_a_seeded_run_takes_the_course_it_took(name):
    aurora = finished(name)
    known = KEPT["digests"].get(golden_runs.environment())
    if known is not None:
        assert golden_runs.digest(aurora) == known[name]
    assert len(aurora.archive) == pytest.approx(KEPT["sizes"][name], rel=0.03)


def test_the_run_folder_of_an_earlier_version_is_read():
    assert golden_runs.columns_digest(auroraqd.load(golden_runs.FOLDER)) == KEPT["folder"]


def test_the_run_of_an_earlier_version_goes_on_as_the_same_run():
    now, then = finished("autoencoder"), auroraqd.resume(golden_runs.FOLDER, any_environment=True)
    task = auroraqd.tasks.AirHockey()
    for aurora in (now, then):
        aurora.run(task, generations=3)
    assert then.generation == now.generation == 43
    if golden_runs.environment() in KEPT["digests"]:
        assert golden_runs.digest(then) == golden_runs.digest(now)
    assert len(then.archive) == pytest.approx(len(now.archive), rel=0.03)
