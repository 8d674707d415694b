"""What every archive promises. A new archive adds one entry to ARCHIVES."""

import copy
import json
import signal
import threading
import time

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import auroraqd
from auroraqd.archives.base import REPLACED
from auroraqd.individuals import measured
from auroraqd.testing import check_archive

ARCHIVES = {
    "unstructured": lambda **options: auroraqd.UnstructuredArchive(l=0.05, **options),
    "unstructured-elitist": lambda **options: auroraqd.UnstructuredArchive(l=0.05, competition="elitist", **options),
    "grid": lambda: auroraqd.GridArchive((18, 20), low=0, high=1),
    "cvt": lambda: auroraqd.CVTArchive(np.random.default_rng(9).random((350, 2))),
    "dominated": lambda: auroraqd.DominatedArchive(400),
}


@pytest.fixture(params=ARCHIVES)
def make(request):
    return ARCHIVES[request.param]


@pytest.fixture
def archive(make):
    return make()


def individuals(n, seed=0, dtype=np.float64):
    rng = np.random.default_rng(seed)
    return {
        "genotype": rng.random((n, 3)),
        "fitness": rng.random(n),
        "observation": (255 * rng.random((n, 4, 2))).astype(dtype),
        "descriptor": rng.random((n, 2)),
    }


def test_it_passes_the_checks_for_archives_of_ones_own(make):
    check_archive(make, sequential=True)


def test_empty(archive):
    assert len(archive) == 0
    assert archive.fitness.shape == archive.id.shape == archive.curiosity.shape == (0,)
    assert archive.genotype.shape[0] == archive.observation.shape[0] == archive.descriptor.shape[0] == 0
    assert archive.ground_truth is None
    archive.credit(np.array([3]), np.array([1]))
    archive.redescribe(np.empty((0, 2)))
    assert len(archive) == 0


def test_columns_belong_together(archive):
    rows = individuals(500)
    tag = np.arange(500.0)
    status = archive.add(**rows, ground_truth=tag[:, None])
    assert set(status.tolist()) <= {0, 1, 2}
    assert status.dtype == np.int8
    assert status.shape == (500,)
    source = archive.ground_truth[:, 0].astype(int)
    for name, values in rows.items():
        assert_array_equal(getattr(archive, name), values[source])
    assert np.count_nonzero(status == 1) == len(archive)
    assert (status[source] > 0).all()
    assert_array_equal(archive.curiosity, 0)


def test_batch_equals_one_by_one(make):
    rows = individuals(300)
    together, apart = make(), make()
    status = together.add(**rows)
    single = [apart.add(**{name: values[i : i + 1] for name, values in rows.items()})[0] for i in range(300)]
    assert_array_equal(status, single)
    for name in (*rows, "id"):
        assert_array_equal(getattr(together, name), getattr(apart, name))


def test_a_gain_is_over_whose_place_was_taken(archive):
    rows = individuals(600)
    archive.add(**{name: values[:300] for name, values in rows.items()})
    replaced = 0
    for i in range(300, 600):
        before = archive.fitness.copy()
        one = measured({name: values[i : i + 1] for name, values in rows.items()} | {"born": None, "parent": None})
        info = archive.insert(one, True)
        if info.status[0] == REPLACED:
            replaced += 1
            assert info.gain[0] == rows["fitness"][i] - before[info.row[0]]
        else:
            assert np.isnan(info.gain[0])
    assert replaced or isinstance(archive, auroraqd.DominatedArchive)  # in which those who stay are new


def test_redescribe_by_a_column_of_its_own(archive):
    """The hand-coded descriptor is a view of the ground truth, that of the genotype one of the genotype."""
    rows = individuals(300)
    for _ in range(3):  # replacements bring rows out of the order of ids
        archive.add(**{**rows, "fitness": rows["fitness"] + archive.fitness.sum()}, ground_truth=rows["descriptor"])
    if not hasattr(archive, "score"):  # which lets those that go leave no gap
        assert (np.diff(archive.id) < 0).any()
    archive.redescribe(archive.ground_truth)
    assert_array_equal(archive.descriptor, archive.ground_truth)
    archive.redescribe(archive.genotype[:, :2])
    assert_array_equal(archive.descriptor, archive.genotype[:, :2])


def test_columns_are_read_only_and_keep_dtype(archive):
    archive.add(**individuals(20, dtype=np.uint8))
    assert archive.observation.dtype == np.uint8
    for name in ("genotype", "fitness", "observation", "descriptor", "curiosity", "id"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(archive, name)[0] = 0


def test_ids_are_unique_and_never_given_twice(archive):
    seen = {}
    for seed in range(20):
        archive.add(**individuals(100, seed))
        assert len(set(archive.id.tolist())) == len(archive)
        for identity, genotype in zip(archive.id.tolist(), archive.genotype.tolist(), strict=True):
            assert seen.setdefault(identity, genotype) == genotype


@pytest.mark.parametrize("name", ["fitness", "observation", "descriptor"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_invalid_rows_are_not_stored(archive, name, value):
    rows = individuals(10)
    rows[name][3] = value
    status = archive.add(**rows)
    assert_array_equal(np.flatnonzero(status == -1), [3])
    assert np.isfinite(getattr(archive, name)).all()
    assert rows["genotype"][3].tolist() not in archive.genotype.tolist()


def test_only_invalid_rows(archive):
    rows = individuals(4)
    rows["fitness"][:] = np.nan
    assert_array_equal(archive.add(**rows), -1)
    assert len(archive) == 0
    other = individuals(4)
    if hasattr(archive, "n_dimensions"):  # cells have dimensions from the start
        with pytest.raises(ValueError, match="descriptor must have 2 dimensions"):
            archive.add(**{**other, "descriptor": other["descriptor"][:, :1]})
        return
    other["descriptor"] = other["descriptor"][:, :1]  # nothing is stored yet, so nothing is decided
    archive.add(**other)
    assert archive.descriptor.shape[1] == 1


def test_empty_batch(archive):
    assert archive.add(**individuals(0)).shape == (0,)
    archive.add(**individuals(5))
    assert archive.add(**individuals(0)).shape == (0,)


def test_curiosity_goes_to_parents_by_id(archive):
    archive.add(**individuals(50))
    first, second, third = archive.id[:3]
    archive.credit(np.array([first, first, second, third, -1, 10**9]), np.array([1, 2, 0, -1, 1, 1]))
    expected = np.zeros(len(archive))
    expected[:3] = [2, -0.5, -0.5]
    assert_array_equal(archive.curiosity, expected)


def test_a_replaced_parent_is_passed_over(archive):
    """Curiosity must not go to who took its place."""
    rng = np.random.default_rng(0)
    for seed in range(30):
        ids = archive.id.copy()
        archive.add(**individuals(40, seed))
        before = dict(zip(archive.id.tolist(), archive.curiosity.tolist(), strict=True))
        parents = rng.choice(ids, 20) if len(ids) else np.array([], int)
        archive.credit(parents, np.ones(len(parents), int))
        for identity, curiosity in zip(archive.id.tolist(), archive.curiosity.tolist(), strict=True):
            assert curiosity == before[identity] + np.count_nonzero(parents == identity)


def test_redescribe_keeps_ids_and_curiosity(archive):
    for seed in range(5):
        archive.add(**individuals(100, seed))
        archive.credit(archive.id[::3], np.ones(len(archive.id[::3])))
    by_id = {
        i: (g.tolist(), c) for i, g, c in zip(archive.id.tolist(), archive.genotype, archive.curiosity.tolist(), strict=True)
    }
    order = np.argsort(archive.id)
    oldest = archive.id[order[0]]
    before = len(archive)
    archive.redescribe(archive.descriptor * 0.5)
    assert 0 < len(archive) < before + hasattr(archive, "score")  # whose number does not depend on the descriptors
    for identity, genotype, curiosity in zip(archive.id.tolist(), archive.genotype, archive.curiosity.tolist(), strict=True):
        assert by_id[identity] == (genotype.tolist(), curiosity)
    assert archive.id.min() >= oldest
    next_id = max(by_id) + 1
    archive.add(**individuals(100, 77))
    assert archive.id.max() >= next_id
    archive.credit(archive.id, np.ones(len(archive)))  # ids are found in their new rows


def test_redescribe_may_change_the_dimensions(archive):
    archive.add(**individuals(50))
    if hasattr(archive, "n_dimensions"):  # unless there are cells
        before = archive.id.tolist()
        with pytest.raises(ValueError, match="descriptor must have 2 dimensions, as the cells have, got 5"):
            archive.redescribe(np.random.default_rng(0).random((len(archive), 5)))
        assert archive.id.tolist() == before
        return
    archive.redescribe(np.random.default_rng(0).random((len(archive), 5)))
    assert archive.descriptor.shape == (len(archive), 5)
    rows = individuals(10)
    rows["descriptor"] = np.random.default_rng(1).random((10, 5))
    archive.add(**rows)


@pytest.mark.parametrize("bad", [np.zeros((1, 2)), np.zeros(3), np.full((1, 2), np.nan)])
def test_bad_redescribe_changes_nothing(archive, bad):
    archive.add(**individuals(50))
    bad = np.resize(bad, (len(archive), 2)) if np.isnan(bad).all() else bad
    before = archive.descriptor.copy()
    with pytest.raises(ValueError, match="descriptor must"):
        archive.redescribe(bad)
    assert_array_equal(archive.descriptor, before)


def wrong(**changes):
    rows = individuals(4)
    return {**rows, **changes}


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (wrong(fitness=np.zeros(3)), "fitness must have 4 rows"),
        (wrong(fitness=np.zeros((4, 1))), r"fitness must have shape \(n,\), got \(4, 1\)"),
        (wrong(descriptor=np.zeros(4)), "descriptor must have shape"),
        (wrong(descriptor=np.zeros((4, 3))), r"descriptor must have shape \(n, 2\), as before"),
        (wrong(genotype=np.zeros(3)), "genotype must have shape"),
        (wrong(genotype=np.full((4, 3), np.nan)), "genotype must be finite"),
        (wrong(observation=np.zeros((4, 2, 2))), "observation must have shape"),
        (wrong(observation=np.array(["a"] * 4)), "observation must be numbers"),
        (wrong(observation=[[1], [2, 3], [4], [5]]), "observation must be numbers"),
        (wrong(fitness="best"), "fitness must be"),
        (wrong(ground_truth=np.zeros((4, 2))), "ground_truth must not be given"),
    ],
)
def test_bad_rows_change_nothing(archive, rows, message):
    archive.add(**individuals(10))
    before = {name: getattr(archive, name).copy() for name in ("genotype", "id", "descriptor")}
    with pytest.raises(ValueError, match=message):
        archive.add(**rows)
    for name, values in before.items():
        assert_array_equal(getattr(archive, name), values)


def test_settings_are_json_values(archive):
    assert json.loads(json.dumps(archive.settings)) == archive.settings
    assert type(archive).__name__ in repr(archive)


def test_dtype_may_not_change(archive):
    archive.add(**individuals(10, dtype=np.uint8))
    with pytest.raises(ValueError, match="observation must have dtype uint8"):
        archive.add(**individuals(10, 1))


def test_a_copy_goes_its_own_way(archive):
    """Also in the arrays that kernels share between them."""
    archive.add(**individuals(3000))
    twin = copy.deepcopy(archive)
    statuses = [[a.add(**individuals(500, seed)) for seed in range(1, 6)] for a in (archive, twin)]
    assert_array_equal(*statuses)
    for name in ("genotype", "descriptor", "id"):
        assert_array_equal(getattr(archive, name), getattr(twin, name))
    archive.add(**individuals(3000, 9))
    assert len(twin.id) < len(archive.id) or twin.id.max() < archive.id.max()


def test_threads_may_share_an_archive(make):
    archive = make()

    def work(seed):
        for i in range(20):
            archive.add(**individuals(200, 100 * seed + i))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(archive.id.tolist())) == len(archive) > 100
    stored = [archive.genotype.copy(), archive.fitness.copy(), archive.observation.copy(), archive.descriptor.copy()]
    fresh = make()
    fresh.add(*stored)
    assert len(fresh) > 0.5 * len(archive)


def test_an_interrupted_change_is_whole(archive):
    """Ctrl-C while all are added again comes after that, and never in between."""
    interrupted = 0
    for delay in np.linspace(0.0005, 0.01, 25):
        archive.add(**individuals(2000, int(1e6 * delay)))
        timer = threading.Timer(delay, signal.raise_signal, [signal.SIGINT])
        try:
            timer.start()
            archive.redescribe(archive.descriptor * 1.01)
            timer.join()
            time.sleep(0.05)  # a late signal arrives here
        except KeyboardInterrupt:
            interrupted += 1
        size = len(archive)
        assert len(archive.add(**individuals(10))) == 10
        assert size <= len(archive) <= size + 10
        assert len(set(archive.id.tolist())) == len(archive)
    assert interrupted


def test_credit_of_those_that_are_gone_is_harmless(archive):
    archive.add(**individuals(20))
    archive.credit([10**6, -1], [1, 1])
    assert_array_equal(archive.curiosity, 0)
    with pytest.raises(ValueError, match="one shape"):
        archive.credit(archive.id, [1])


@pytest.mark.parametrize(
    ("parents", "status", "message"),
    [
        ([0.5], [1], r"parent_ids must be whole numbers, got \[0.5\]"),
        (["a"], [1], "parent_ids must be numbers"),
        ([[0], [1, 2]], [1, 1], "parent_ids must be numbers with rows of one shape"),
        ([0], ["new"], "status must be numbers"),
        ([0, 1], [1], "must have one shape"),
    ],
)
def test_bad_credit_changes_nothing(archive, parents, status, message):
    archive.add(**individuals(20))
    with pytest.raises(ValueError, match=message):
        archive.credit(parents, status)
    assert not archive.curiosity.any()
    with pytest.raises(ValueError, match="ids must be"):
        archive.rows_of("x")


def test_nothing_is_cast_with_loss(archive):
    archive.add(**individuals(10, dtype=np.int8))
    rows = individuals(10, 1, dtype=np.int64)
    with pytest.raises(ValueError, match="observation must have dtype int8, as before, got int64"):
        archive.add(**rows)
    with pytest.raises(ValueError, match="at most 64 bits"):
        archive.add(**{**rows, "observation": rows["observation"].astype(np.longdouble)})
