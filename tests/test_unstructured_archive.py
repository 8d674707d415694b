"""The compiled archive against its plain-Python twin, and the properties it promises."""

import copy

import naive
import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from auroraqd import UnstructuredArchive
from auroraqd.archives import _neighbours, base


def fill(archive, descriptor, fitness=None, batch=64):
    """Add rows in batches; statuses of all."""
    n = len(descriptor)
    fitness = np.zeros(n) if fitness is None else fitness
    return np.concatenate(
        [
            archive.add(descriptor[i : i + batch], fitness[i : i + batch], np.ones((len(descriptor[i : i + batch]), 1)),
                        descriptor[i : i + batch])
            for i in range(0, n, batch)
        ]
    )  # fmt: skip


def assert_agree(archive, twin):
    assert_array_equal(archive.descriptor, np.array(twin.descriptor).reshape(archive.descriptor.shape))
    assert_array_equal(archive.fitness, twin.fitness)
    assert_array_equal(archive.id, twin.id)


def points(kind, n, d, rng):
    """Descriptors that are random, or nasty in one way."""
    if kind == "uniform":
        return rng.random((n, d))
    if kind == "ties":  # a lattice: equal distances everywhere, and duplicates
        return rng.integers(0, 6, (n, d)) / 5
    if kind == "duplicates":
        return rng.random((max(n // 8, 1), d))[rng.integers(0, max(n // 8, 1), n)]
    if kind == "sorted":
        return np.sort(rng.random((n, d)), axis=0)
    if kind == "outliers":  # spread over sixty orders of magnitude
        return rng.choice([-1, 1], (n, d)) * 10.0 ** rng.uniform(-30, 30, (n, 1)) * rng.random((n, d))
    if kind == "line":
        return rng.random((n, 1)) * np.ones(d)
    if kind == "moving":  # a cloud that drifts, as an exploration does
        return rng.normal(size=(n, d)) * 0.1 + np.linspace(0, 1, n)[:, None]
    raise ValueError(kind)


KINDS = ["uniform", "ties", "duplicates", "sorted", "outliers", "line", "moving"]


@pytest.mark.parametrize("d", [1, 2, 3, 5, 10])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("competition", ["dominance", "elitist"])
def test_agrees_with_its_twin(kind, d, competition):
    rng = np.random.default_rng([KINDS.index(kind), d])
    x = points(kind, 500, d, rng)
    fitness = rng.choice([-2.0, -1.0, 0.0, 0.5, 3.0], len(x))
    l = 0.4 * np.ptp(x[:, 0]) / 500 ** (1 / d) if kind != "ties" else 0.2
    k = int(rng.integers(1, 20))
    archive = UnstructuredArchive(l=l, k=k, competition=competition)
    twin = naive.UnstructuredArchive(l, k, competition=competition)
    assert_array_equal(fill(archive, x, fitness), twin.add(x, fitness))
    assert_agree(archive, twin)

    moved = archive.descriptor * 0.7 + rng.normal(size=archive.descriptor.shape) * l
    archive.redescribe(moved, l=l * 1.3)
    twin.redescribe(moved, l * 1.3)
    assert_agree(archive, twin)


def test_agrees_with_its_twin_when_saturated_with_constant_fitness():
    """Long enough for trees to be built anew and for remembered reaches to go stale."""
    rng = np.random.default_rng(0)
    archive, twin = UnstructuredArchive(l=0.06), naive.UnstructuredArchive(0.06)
    for _ in range(30):
        x = rng.random((200, 2))
        assert_array_equal(fill(archive, x), twin.add(x, np.zeros(len(x))))
    assert_agree(archive, twin)
    assert len(archive) > 150


@pytest.mark.parametrize("d", [1, 2, 3])
def test_agrees_with_its_twin_where_it_becomes_crowded(d):
    """What was remembered of the neighbours of few holds too many of them later."""
    rng = np.random.default_rng(d)
    archive, twin = UnstructuredArchive(l=1e-5, k=4), naive.UnstructuredArchive(1e-5, k=4)
    for size in 0.1 * 2.0 ** -np.arange(10):  # smaller and smaller clouds around the same place
        x = 0.5 + size * rng.normal(size=(50, d))
        competitors = np.concatenate([x, archive.descriptor.reshape(-1, d)]) + 5e-6 * rng.choice(
            [-1, 1], (len(archive) + 50, d)
        )
        for rows in (x, competitors[:100]):
            assert_array_equal(fill(archive, rows), twin.add(rows, np.zeros(len(rows))))
    assert_agree(archive, twin)


@pytest.mark.parametrize("l", [0.0, 1e-300, 1e300])
def test_extreme_thresholds(l):
    rng = np.random.default_rng(1)
    x = np.repeat(rng.random((60, 2)) * rng.choice([1.0, 1e-170, 1e160], (60, 1)), 2, axis=0)
    archive, twin = UnstructuredArchive(l=l), naive.UnstructuredArchive(l)
    assert_array_equal(fill(archive, x), twin.add(x, np.zeros(len(x))))
    assert_agree(archive, twin)


@pytest.mark.parametrize("n", [1, 2, 3, 16])
def test_few_individuals(n):
    """Fewer than k neighbours, and none."""
    x = np.linspace(0, 0.1 * (n - 1), n)[:, None]
    archive, twin = UnstructuredArchive(l=0.05), naive.UnstructuredArchive(0.05)
    for rows in (x, x + 0.04, x - 0.049):
        assert_array_equal(fill(archive, rows), twin.add(rows, np.zeros(n)))
    assert_agree(archive, twin)


individuals = st.integers(1, 4).flatmap(
    lambda d: st.lists(
        st.tuples(
            st.tuples(*[st.sampled_from([0.0, 0.1, 0.15, 0.2, 0.5, 1.0]) | st.floats(0, 1)] * d),
            st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-10, 10),
        ),
        min_size=1,
        max_size=60,
    )
)


@settings(max_examples=150)
@given(individuals, st.floats(0.01, 0.5), st.integers(1, 16), st.sampled_from(["dominance", "elitist"]))
def test_agrees_with_its_twin_on_anything(rows, l, k, competition):
    x, fitness = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    archive, twin = UnstructuredArchive(l=l, k=k, competition=competition), naive.UnstructuredArchive(l, k, 0.1, competition)
    assert_array_equal(fill(archive, x, fitness, batch=7), twin.add(x, fitness))
    assert_agree(archive, twin)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.floats(0, 0.9))
def test_stored_keep_their_distance(seed, d, epsilon):
    """No two closer than (1 - epsilon) l, however often places change hands."""
    rng = np.random.default_rng(seed)
    l = rng.uniform(0.02, 0.4)
    archive = UnstructuredArchive(l=l, epsilon=epsilon, k=3)
    fill(archive, rng.random((300, d)), rng.random(300))
    stored = archive.descriptor
    gaps = [naive.distance(a, b) for i, a in enumerate(stored) for b in stored[:i]]
    assert not gaps or min(gaps) >= (1 - epsilon) * l


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_a_batch_is_its_rows_one_by_one(seed, size):
    rng = np.random.default_rng(seed)
    x, fitness = rng.random((200, 2)), rng.random(200)
    together, apart = UnstructuredArchive(l=0.1), UnstructuredArchive(l=0.1)
    assert_array_equal(fill(together, x, fitness, batch=size), fill(apart, x, fitness, batch=1))
    for name in ("descriptor", "fitness", "id", "curiosity", "genotype"):
        assert_array_equal(getattr(together, name), getattr(apart, name))


@pytest.mark.parametrize("d", [1, 2, 3, 10, 100])
def test_the_index_equals_brute_force(d):
    """Novelty through the tree is the brute-force one, to the last bit, after insertions, removals and builds."""
    rng = np.random.default_rng(d)
    x = rng.normal(size=(1500 if d < 10 else 500, 3)) @ rng.normal(size=(3, d))  # the twin is slow
    archive = UnstructuredArchive(l=0.05 * np.ptp(x[:, 0]) * (1 if d < 10 else 2), k=7)
    fill(archive, x)
    stored = archive.descriptor
    assert_array_equal(archive.novelty(), [naive.novelty(stored, p, i, 7) for i, p in enumerate(stored)])
    rebuilt = _neighbours.build(np.ascontiguousarray(stored))
    found, _ = _neighbours.novelties(rebuilt, stored, 7, np.arange(len(stored)))
    assert_array_equal(found, archive.novelty())


def test_sorted_insertion_does_not_degenerate():
    """A line inserted in order would make the tree a list; it is built anew instead."""
    n = 200_000
    archive = UnstructuredArchive(l=0.5)
    status = fill(archive, np.arange(n, dtype=float)[:, None], batch=n)
    assert (status == 1).all()
    assert archive._tree.meta[2] < 1200  # 12,500 without
    assert_array_equal(fill(archive, np.arange(n, dtype=float)[::-1, None], batch=n), 0)


squares = st.sampled_from([0.0, 1.0, 2.0, 1e300]) | st.floats(0, 1e300)


@given(st.lists(squares, min_size=2, max_size=90), st.integers(1, 30))
def test_mean_without_the_smallest_agrees_with_its_twin(squared, k):
    k = min(k, len(squared) - 1)
    scratch = _neighbours.scratch(30)
    scratch.near[: len(squared)] = squared
    assert _neighbours._mean_without_smallest(scratch.near, len(squared), k, scratch) == naive.mean_without_smallest(squared, k)


@pytest.mark.parametrize("competition", ["dominance", "elitist"])
@pytest.mark.parametrize("scale", [1.0, 1e-140, 1e-150, 1e140, 1e150])
def test_near_copies_agree_with_the_twin(scale, competition):
    """From exact copies over those within the margin of a novelty to those beyond it."""
    rng = np.random.default_rng(2)
    x = rng.random((150, 2)) * scale
    near = x[rng.integers(0, 150, 600)] + scale * rng.choice([-1, 1], (600, 2)) * 10.0 ** rng.uniform(-17, -3, (600, 1))
    near[::7] = x[rng.integers(0, 150, len(near[::7]))]
    rows = np.concatenate([x, near])
    fitness = rng.choice([0.0, 0.0, 0.0, 1.0], len(rows))
    archive = UnstructuredArchive(l=0.05 * scale, k=5, competition=competition)
    twin = naive.UnstructuredArchive(0.05 * scale, k=5, competition=competition)
    assert_array_equal(fill(archive, rows, fitness), twin.add(rows, fitness))
    assert_agree(archive, twin)


@given(st.integers(0, 2**32 - 1))
def test_places_taken_agree_with_their_twin(seed):
    rng = np.random.default_rng(seed)
    size, n = int(rng.integers(0, 6)), int(rng.integers(1, 12))
    occupants = rng.permutation(20)[:size].tolist()
    rows, status, free = [], [], size
    for _ in range(n):
        new = rng.random() < 0.3
        rows.append(free if new else int(rng.integers(-1, free)))
        status.append(base.NEW if new else base.REPLACED if rows[-1] >= 0 else base.REJECTED)
        free += new
    ids, places = np.full(size + n, -7), np.zeros(20 + n, np.int32)
    ids[:size], places[occupants] = occupants, np.arange(1, size + 1)
    row = np.array(rows)
    assert base._sound(np.array(status, np.int8), row, size)
    wrong = row.copy()
    wrong[rng.integers(n)] = free + 1
    assert not base._sound(np.array(status, np.int8), wrong, size)
    fitness, gain, stored = rng.integers(0, 9, n).astype(float), np.full(n, np.nan), np.full(size + n, -7.0)
    known = rng.integers(0, 9, size).astype(float).tolist()
    stored[:size] = known
    after, next_id, staying, removed = base._settled(row, fitness, size, 20, ids, stored, places, gain)
    *wanted, gained = naive.settled(rows, fitness.tolist(), occupants, known, 20)
    assert [staying.tolist(), removed.tolist(), row.tolist()] == wanted
    assert_array_equal(gain, gained)
    assert stored[:after].tolist() == known
    assert (after, next_id) == (len(occupants), 20 + sum(r >= 0 for r in rows))
    assert ids[:after].tolist() == occupants
    assert {id: place - 1 for id, place in enumerate(places) if place} == {id: row for row, id in enumerate(occupants)}


@given(st.lists(st.booleans(), min_size=1, max_size=9))
def test_what_became_of_some_among_others(which):
    some = int(np.sum(which))
    info = base.Info(np.arange(some, dtype=np.int8), 10 + np.arange(some), np.array([7]), np.arange(some) / 4)
    found, taken = info.among(np.array(which)), 0
    for i, one in enumerate(which):
        wanted = (taken, 10 + taken, taken / 4) if one else (base.INVALID, -1, np.nan)
        assert_array_equal((found.status[i], found.row[i], found.gain[i]), wanted)
        taken += one
    assert found.removed.tolist() == [7]


@given(st.integers(0, 2**32 - 1))
def test_credit_agrees_with_its_twin(seed):
    rng = np.random.default_rng(seed)
    archive = UnstructuredArchive(l=0.1)
    fill(archive, rng.random((60, 2)))
    n, size = 40, len(archive)
    status = rng.integers(-1, 3, n)
    ids = np.where(rng.random(n) < 0.7, archive.id[rng.integers(size, size=n)], rng.integers(-1, 70, n))
    expected = naive.credit(archive.curiosity, archive.id, ids, status)
    archive.credit(ids, status)
    assert archive.curiosity.tolist() == expected


@pytest.mark.parametrize("epsilon", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("elitist", [False, True])
def test_replacement_rule_agrees_with_its_twin(epsilon, elitist):
    values = [-3.0, -1.0, -0.95, 0.0, 0.5, 0.95, 1.0, 1.2, 3.0, 1e300]
    novelties = [0.0, 0.5, 0.9, 0.95, 1.0, 1.0 + 1e-10, 1.0 + 1e-8, 1.2, 3.0]
    for f in values:
        for f_nn in values:
            for n in novelties:
                for n_nn in novelties:
                    got = _neighbours.replaces(f, n, f_nn, n_nn, epsilon, elitist)
                    assert got == naive.replaces(f, n, f_nn, n_nn, epsilon, elitist), (f, n, f_nn, n_nn)


def test_constant_zero_fitness_still_replaces():
    """With the rule taken literally 0 > 0 would freeze the archive."""
    archive = UnstructuredArchive(l=1.0, k=1)
    fill(archive, np.array([[0.0], [2.0]]))
    assert_array_equal(fill(archive, np.array([[-0.5]])), [2])
    assert_array_equal(archive.descriptor, [[-0.5], [2.0]])


def test_setting_l_adds_all_again():
    rng = np.random.default_rng(0)
    archive, twin = UnstructuredArchive(l=0.02), naive.UnstructuredArchive(0.02)
    x = rng.random((400, 2))
    fill(archive, x)
    twin.add(x, np.zeros(400))
    before = len(archive)
    archive.l = 0.1
    twin.redescribe(list(twin.descriptor), 0.1)
    assert_agree(archive, twin)
    assert len(archive) < before / 2


def test_capacity_refuses_politely():
    archive = UnstructuredArchive(l=0.5, capacity=3)
    assert not archive.full
    status = fill(archive, np.arange(6.0)[:, None])
    assert archive.full
    assert_array_equal(status, [1, 1, 1, 0, 0, 0])
    assert_array_equal(fill(archive, np.array([[-0.4]])), [2])  # replacement goes on
    assert len(archive) == 3


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"l": -1}, "l must be"),
        ({"l": np.nan}, "l must be"),
        ({"l": True}, "l must be"),
        ({"k": None}, "k must be"),
        ({"k": 10**12}, "k must be"),
        ({"epsilon": "a"}, "epsilon must be"),
        ({"capacity": 2**70}, "capacity must be"),
        ({"k": 0}, "k must be"),
        ({"k": 1.5}, "k must be"),
        ({"epsilon": 1.0}, "epsilon must be"),
        ({"competition": "best"}, "competition must be"),
        ({"capacity": 0}, "capacity must be"),
    ],
)
def test_bad_options(option, message):
    with pytest.raises(ValueError, match=message):
        UnstructuredArchive(**option)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 2, 10]),
    st.integers(1, 6),
    st.sampled_from([0.0, 0.05, 0.3]),
    st.booleans(),
    st.booleans(),
)
def test_novelty_that_is_kept_is_that_which_would_be_measured(seed, d, k, l, lattice, constant):
    """Bit for bit, after additions, replacements, adding all again and copies."""
    rng = np.random.default_rng(seed)
    archive = UnstructuredArchive(l=l, k=k)
    for step in range(8):
        n = int(rng.integers(1, 12 if step else 80))
        x = np.round(rng.random((n, d)), 1) if lattice else rng.random((n, d))
        archive.add(x, np.zeros(n) if constant else rng.random(n), x, x)
        if step % 4 == 3:
            archive.rebuild()
        kept = archive._novel is not None
        stored = archive.descriptor.tolist()
        assert_array_equal(archive.novelty(), [naive.novelty(stored, p, i, k) for i, p in enumerate(stored)])
        fresh = copy.deepcopy(archive)
        assert fresh._novel is None
        assert_array_equal(fresh.novelty(), archive.novelty())
        event(f"kept: {kept}")


def test_novelty_is_not_kept_for_whom_does_not_ask():
    archive, rng = UnstructuredArchive(l=0.001), np.random.default_rng(0)
    x = rng.random((3000, 2))
    archive.add(x, np.zeros(3000), x, x)
    archive.novelty()
    archive.add(x[:1] + 0.01, [0.0], x[:1], x[:1] + 0.01)
    assert archive._novel is not None
    assert 0 < np.count_nonzero(archive._novel.reach < 0) < 60
    archive.novelty()[:] = 0  # a copy
    assert archive.novelty().min() > 0
    for _ in range(20):
        x = rng.random((500, 2))
        archive.add(x, np.zeros(500), x, x)
    assert archive._novel is None
