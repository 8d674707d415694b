"""Seeded runs take the course they took: see golden_runs.py."""

import json
import warnings

import golden_runs
import numpy as np
import pytest
from numpy.testing import assert_allclose

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


def test_a_run_goes_on_as_the_same_run(tmp_path):
    now = finished("autoencoder")
    assert_same_three_generations(now, auroraqd.resume(auroraqd.save(now, tmp_path / "run")))


def test_the_run_of_an_earlier_version_goes_on():
    """It was trained on rows in another order, so no run of today is the same: it goes on with the descriptor that it had."""
    one, other = (auroraqd.resume(golden_runs.FOLDER, any_environment=True) for _ in range(2))
    before = one.archive.columns.copied()
    assert_same_three_generations(one, other)
    kept = np.isin(one.archive.id, before["id"])
    assert kept.mean() > 0.8
    then = before.take(np.isin(before["id"], one.archive.id))
    assert_allclose(one.descriptor.describe_observation(then["observation"]), then["descriptor"], atol=1e-12)


def assert_same_three_generations(one, other):
    """Of an auto-encoder on air hockey after 40."""
    for aurora in (one, other):
        aurora.run(auroraqd.tasks.AirHockey(), generations=3)
    assert one.generation == other.generation == 43
    assert golden_runs.digest(other) == golden_runs.digest(one)
