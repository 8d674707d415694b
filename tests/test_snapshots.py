"""Snapshots: what a run keeps of its updates, before and after, and what becomes of it when it goes on."""

import subprocess
import sys
import warnings
from pathlib import Path

import commands
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.callbacks import Callbacks
from auroraqd.runs import snapshots
from auroraqd.runs.snapshots import first_of, load_snapshots

SOON = auroraqd.Every(4)


def task(genotypes):
    """Ends of a stick, and how it lay."""
    return genotypes[:, 0], np.sin(3 * genotypes)[:, None] * [[[1, 0.3], [0.2, 1], [0.5, 0.5]]], genotypes


def begun(seed=0, descriptor=None, **options):
    options = {"batch_size": 40, "schedule": SOON, **options}
    return auroraqd.Aurora(2, PCA(2) if descriptor is None else descriptor, seed=seed, **options)


def generations(folder):
    return [int(path.stem) for path in sorted((folder / "snapshots").glob("*.safetensors"))]


class Copies:
    """A callback that copies what a snapshot is to hold, in each generation."""

    def __init__(self):
        self.of = {}

    def generation(self, aurora):
        archive = aurora.archive
        self.of[aurora.generation] = [rows.copy() for rows in (archive.id, archive.descriptor, archive.ground_truth)]


def archives():
    grid = auroraqd.GridArchive((9, 9), low=-3, high=3)
    return [auroraqd.UnstructuredArchive(), grid, auroraqd.DominatedArchive(60)]


@pytest.mark.parametrize("archive", archives(), ids=lambda archive: type(archive).__name__)
def test_they_hold_what_there_was_before_and_after_each_update(tmp_path, archive):
    copies, aurora = Copies(), begun(archive=archive)
    aurora.run(task, generations=10, callback=[copies, auroraqd.Snapshots(tmp_path)])
    found = load_snapshots(tmp_path, 0, 10)
    assert [(s.generation, s.moment) for s in found] == [(1, "after"), (4, "before"), (5, "after"), (8, "before"), (9, "after")]
    for snapshot in found:
        ids, descriptor, truth = copies.of[snapshot.generation]
        assert snapshot.size == len(ids)
        assert snapshot.evaluations == 40 * snapshot.generation
        assert_array_equal(snapshot.id, ids)
        assert_array_equal(snapshot.descriptor, descriptor.astype(np.float32))
        assert_array_equal(snapshot.ground_truth, truth.astype(np.float32))
    before, after = found[1:3]
    both = np.isin(before.id, after.id)
    assert both.any()
    assert not np.allclose(before.descriptor[both], after.descriptor[np.isin(after.id, before.id)])  # it was updated


def test_runs_in_parts_have_them_too(tmp_path):
    copies, aurora = Copies(), begun()
    callbacks = Callbacks([copies, auroraqd.Snapshots(tmp_path)])
    callbacks.start(aurora)
    done = 0
    while aurora.generation < 10:
        proposal = aurora.ask(10)
        aurora.tell(*task(proposal.genotype), ticket=proposal.ticket)
        if aurora.generation > done:
            done = aurora.generation
            callbacks.generation(aurora)
    before = [s for s in load_snapshots(tmp_path, 0, 10) if s.moment == "before"]
    assert [snapshot.generation for snapshot in before] == [4, 8]
    for snapshot in before:
        assert_array_equal(snapshot.descriptor, copies.of[snapshot.generation][1].astype(np.float32))


def test_the_run_is_the_same_with_and_without(tmp_path):
    with_them = begun().run(task, generations=9, callback=auroraqd.Snapshots(tmp_path))
    without = begun().run(task, generations=9)
    assert_array_equal(with_them.archive.genotype, without.archive.genotype)


def test_a_descriptor_that_is_never_updated_has_them_as_the_repertoire_grows(tmp_path):
    aurora = begun(descriptor="genotype", batch_size=2)
    aurora.run(lambda genotypes: genotypes, generations=160, callback=auroraqd.Snapshots(tmp_path))
    found = load_snapshots(tmp_path, 0, 160)
    assert [(s.generation, s.moment) for s in found] == [(1, ""), (51, ""), (151, "")]
    assert found[0].ground_truth is None


def test_a_run_that_goes_on_keeps_what_was_and_makes_the_rest_again(tmp_path):
    begun().run(task, generations=12, callback=auroraqd.Snapshots(tmp_path))
    whole = [path.read_bytes() for path in sorted((tmp_path / "snapshots").iterdir())]
    aurora = begun().run(task, generations=6)  # as a checkpoint would have it
    auroraqd.save(aurora, tmp_path)
    other = tmp_path / "snapshots" / "notes.txt"
    other.write_text("mine")
    auroraqd.resume(tmp_path).run(task, generations=1, callback=auroraqd.Snapshots(tmp_path))
    assert generations(tmp_path) == [1, 5]
    auroraqd.resume(tmp_path).run(task, until_generation=12, callback=auroraqd.Snapshots(tmp_path))
    assert [path.read_bytes() for path in sorted((tmp_path / "snapshots").glob("*.safetensors"))] == whole
    assert other.read_text() == "mine"


def test_a_run_from_the_start_and_one_of_another_seed_replace_them(tmp_path):
    begun().run(task, generations=12, callback=auroraqd.Snapshots(tmp_path))
    aurora = begun(seed=1).run(task, generations=7)
    aurora.run(task, generations=1, callback=auroraqd.Snapshots(tmp_path))
    assert generations(tmp_path) == []
    begun().run(task, generations=6, callback=auroraqd.Snapshots(tmp_path))
    begun().run(task, generations=1, callback=auroraqd.Snapshots(tmp_path))
    assert generations(tmp_path) == [1]
    assert load_snapshots(tmp_path, 1, 100) == []


def test_many_are_thinned_and_the_first_and_the_last_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(snapshots, "_MOST_FILES", 8)
    begun(schedule=auroraqd.Every(1)).run(task, generations=60, callback=auroraqd.Snapshots(tmp_path))
    left = generations(tmp_path)
    assert len(left) == 8
    assert (left[0], left[-1]) == (1, 60)
    assert max(np.diff(left)) <= 20


def test_the_same_skills_as_long_as_they_stay():
    ids = np.arange(10_000)
    chosen = ids[first_of(ids, 500)]
    assert len(chosen) == 500
    later = np.delete(ids, np.arange(0, 10_000, 7))
    assert set(chosen[chosen % 7 > 0]) <= set(later[first_of(later, 500)])
    assert abs(np.mean(chosen) / np.mean(ids) - 1) < 0.1  # the old and the new alike
    np.testing.assert_array_equal(first_of(ids[:3], 500), [0, 1, 2])


def test_snapshots_of_many_dimensions_are_of_fewer_skills(tmp_path):
    def wide(genotypes):
        return np.repeat(genotypes, 400, axis=1)

    aurora = begun(descriptor="observation", batch_size=200, resolution=auroraqd.Fixed(0.0))
    aurora.run(wide, generations=1, callback=auroraqd.Snapshots(tmp_path))
    assert load_snapshots(tmp_path, 0, 9)[0].descriptor.shape == (100, 800)
    aurora = begun(batch_size=200).run(task, generations=1, callback=auroraqd.Snapshots(tmp_path, most=7))
    assert len(load_snapshots(tmp_path, 0, 9)[0].id) == 7


def test_what_is_damaged_is_left_out_and_goes(tmp_path):
    begun().run(task, generations=12, callback=auroraqd.Snapshots(tmp_path))
    files = sorted((tmp_path / "snapshots").iterdir())
    files[0].write_bytes(files[0].read_bytes()[:-9])
    files[1].write_bytes(b"\xff" * 100)
    files[2].write_bytes(b"")
    assert load_snapshots(tmp_path, 0, 12) == []
    begun().run(task, generations=12, callback=auroraqd.Snapshots(tmp_path))
    assert [s.generation for s in load_snapshots(tmp_path, 0, 12)] == [1, 4, 5, 8, 9]
    assert load_snapshots(tmp_path / "nowhere", 0, 12) == []


def test_a_run_goes_on_where_they_cannot_be_written(tmp_path):
    (tmp_path / "snapshots").write_text("in the way")
    with pytest.warns(UserWarning, match="no snapshot of generation 1, and the run goes on: .* must be a folder") as said:
        begun().run(task, generations=6, callback=auroraqd.Snapshots(tmp_path))
    assert len(said) == 1


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
import auroraqd
from test_snapshots import begun, task
replace, left = Path.replace, [3]
def killed(self, target):
    left[0] -= 1
    if left[0] == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return replace(self, target)
Path.replace = killed
begun().run(task, generations=12, callback=auroraqd.Snapshots(sys.argv[1]))
"""


def test_a_run_that_is_killed_leaves_whole_ones(tmp_path):
    done = subprocess.run([sys.executable, "-c", KILLED, tmp_path, str(Path(__file__).parent)], check=False)
    assert done.returncode == -9
    assert [s.generation for s in load_snapshots(tmp_path, 0, 12)] == [1, 4, 5]


def test_the_command_line_keeps_them_unless_told_not_to(tmp_path):
    line = ["run", "ballistic", "-n", 6, "--batch-size", 50, "--schedule", "every:generations=2", "--no-figures"]
    done = commands.cli(*line, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    assert generations(tmp_path / "run") == [1, 3, 5]
    done = commands.cli(*line, "--out", tmp_path / "run", "--overwrite", "--no-snapshots")
    assert done.returncode == 0, done.stderr
    assert generations(tmp_path / "run") == []
    done = commands.cli("resume", tmp_path / "run", "-n", 9, "--no-figures")
    assert done.returncode == 0, done.stderr
    assert generations(tmp_path / "run") == [7, 9]


def test_what_is_wrong_is_said(tmp_path):
    with pytest.raises(ValueError, match="most must be"):
        auroraqd.Snapshots(tmp_path, most=0)
    with pytest.raises(TypeError, match="folder must be a path"):
        auroraqd.Snapshots(3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        begun().run(task, generations=1, callback=auroraqd.Snapshots(tmp_path))
