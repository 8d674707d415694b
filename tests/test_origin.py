"""Where individuals come from, and where a repertoire does."""

import copy
import pickle

import golden_runs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.runs import folders
from auroraqd.tasks.noise import seeds_at, seeds_of


def windy(genotypes, seeds):
    wind = np.array([np.random.default_rng(seed).normal(0, 0.05, 3) for seed in seeds])
    fitness = np.where(wind[:, 0] > 0.07, np.nan, -wind[:, 0])
    return fitness, genotypes + wind


windy.seeded = True


def grown(descriptor, generations=8, **options):
    return auroraqd.Aurora(3, descriptor, seed=5, batch_size=20, **options).run(windy, generations=generations)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return auroraqd.save(grown(PCA(2)), tmp_path_factory.mktemp("origin") / "run")


@settings(max_examples=25, deadline=None)
@given(batch_size=st.integers(1, 30), generations=st.integers(1, 8), every=st.integers(1, 5), learned=st.booleans())
def test_all_are_found_again_by_their_number(batch_size, generations, every, learned):
    """Whatever waits for a first fit, is replaced or added again."""
    descriptor = PCA(2) if learned else "genotype"
    options = {"batch_size": batch_size, "schedule": auroraqd.Every(every), "survival": 0.0}
    genotypes, parents = [], {}
    aurora = auroraqd.Aurora(3, descriptor, seed=5, **options)
    for _ in range(generations):
        proposal = aurora.ask(batch_size)
        genotypes.extend(proposal.genotype)
        parents.update(zip(proposal.born.tolist(), proposal.parent.tolist(), strict=True))
        aurora.tell(*windy(proposal.genotype, proposal.seeds), ticket=proposal.ticket)
    archive = aurora.archive
    assert archive.born.dtype == archive.parent.dtype == np.int64
    assert len(set(archive.born.tolist())) == len(archive)
    for born, parent, genotype in zip(archive.born.tolist(), archive.parent.tolist(), archive.genotype, strict=True):
        assert_array_equal(genotype, genotypes[born])
        assert parent == parents[born]
    if len(archive):
        assert_array_equal(windy(archive.genotype, seeds_at(5, archive.born))[1], archive.observation)
        assert (archive.parent < archive.id).all()


def test_seeds_by_number():
    born = np.array([7, 0, 299, 7])
    assert_array_equal(seeds_at(3, born), seeds_of(3, 0, 300)[born])
    assert seeds_at(3, born[:0]).dtype == np.uint64


def test_a_noisy_skill_is_repeated_as_it_was_found(folder):
    repertoire = auroraqd.load(folder)
    again = repertoire.evaluate(windy, seeds="found", times=2)
    assert_array_equal(again.error, 0)
    assert_array_equal(again.fitness[:, 1], repertoire.fitness)
    assert (repertoire.evaluate(windy).error > 0).all()
    assert_array_equal(repertoire.evaluate(windy, [3, 1], seeds="found").observation[:, 0], repertoire.observation[[3, 1]])
    with pytest.raises(ValueError, match="seeds must be one of new, found, got 'mine'"):
        repertoire.evaluate(windy, seeds="mine")


def test_columns_are_in_the_table(folder):
    pytest.importorskip("pandas")
    repertoire = auroraqd.load(folder)
    table = repertoire.to_pandas()
    assert_array_equal(table["born"], repertoire.born)
    assert_array_equal(table["parent"], repertoire.parent)


def test_an_archive_by_hand():
    archive = auroraqd.UnstructuredArchive()
    rows = [np.random.default_rng(0).random(shape) for shape in ((4, 3), (4,), (4, 2), (4, 2))]
    archive.add(*rows)
    assert_array_equal(archive.born, -1)
    archive.add(*(column + 2 for column in rows), born=[7, 8, 9, 10], parent=archive.id[:4])
    assert archive.born.tolist() == [-1] * 4 + [7, 8, 9, 10]
    assert archive.parent.tolist() == [-1] * 4 + [0, 1, 2, 3]
    for wrong, message in (
        ([1.5] * 4, "born must be whole numbers, got "),
        ([1, 2], r"born must have 4 rows, as genotype has, got shape \(2,\)"),
        (3, r"born must have shape \(n,\), got \(\)"),
    ):
        with pytest.raises(ValueError, match=message):
            archive.add(*(column + 4 for column in rows), born=wrong)
    assert len(archive) == 8
    assert auroraqd.UnstructuredArchive().born.dtype == np.int64


def test_a_run_of_an_earlier_version():
    """It kept neither."""
    repertoire = auroraqd.load(golden_runs.FOLDER)
    assert_array_equal(repertoire.born, -1)
    assert_array_equal(repertoire.parent, -1)
    with pytest.raises(ValueError, match=r"seeds must be 'new' for 2 of these 2 skills: which evaluation .* is not known"):
        repertoire.evaluate(windy, [0, 1], seeds="found")
    aurora = auroraqd.resume(golden_runs.FOLDER, any_environment=True)
    before = aurora.evaluations
    aurora.run(auroraqd.tasks.AirHockey(), generations=3)
    assert set(aurora.archive.born.tolist()) <= {-1, *range(before, before + 60)}
    assert aurora.archive.born.max() >= before
    assert aurora.archive.parent.max() >= 0


def test_those_that_wait_keep_their_number(tmp_path):
    aurora = auroraqd.Aurora(3, PCA(2), seed=5, batch_size=2)
    aurora.run(windy, generations=1)
    assert len(aurora.archive) == 0
    aurora = auroraqd.resume(auroraqd.save(aurora, tmp_path)).run(windy, generations=3)
    assert {0, 1} & set(aurora.archive.born.tolist())


def test_a_repertoire_can_be_copied_and_sent(folder):
    repertoire = auroraqd.load(folder)
    repertoire.describe(repertoire.observation)
    for twin in (copy.deepcopy(repertoire), pickle.loads(pickle.dumps(repertoire))):
        assert_array_equal(twin.id, repertoire.id)
        assert_array_equal(twin.describe(twin.observation), repertoire.describe(repertoire.observation))
        assert_array_equal(twin.evaluate(windy, seeds="found").error, 0)
        assert twin.config == repertoire.config
        with pytest.raises(ValueError, match="read-only"):
            twin.genotype[0] = 0


def test_a_repertoire_knows_its_run(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder.parent)
    repertoire = auroraqd.load("run")
    monkeypatch.chdir(tmp_path)
    assert repertoire.config == folders.load_config(folder)
    assert repr(repertoire.history.records) == repr(folders.load_history(folder))
    assert repertoire.history.last.evaluations == 160
    assert_array_equal(repertoire.history.column("generation"), np.arange(1, 9))
