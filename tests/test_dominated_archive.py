"""Dominated novelty search: the archive against its twin, and against another implementation where that is installed."""

import copy

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import auroraqd
from auroraqd.archives._ranked import disturb, mean_distance, nearest
from auroraqd.archives.dominated import DominatedArchive


def rows(rng, n, d, kind):
    """Individuals: random, on a lattice with ties and duplicates, of one fitness, or all the same."""
    descriptor, fitness = rng.normal(size=(n, d)), rng.normal(size=n)
    if kind in ("ties", "same"):
        descriptor, fitness = np.round(descriptor), np.round(fitness)
    if kind in ("constant", "same"):
        fitness = np.zeros(n)
    return (np.zeros_like(descriptor) if kind == "same" else descriptor), fitness


def add(archive, descriptor, fitness):
    return archive.add(descriptor, fitness, descriptor, descriptor)


KINDS = st.sampled_from(["random", "ties", "constant", "same"])


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 25), st.integers(1, 5), st.sampled_from([1, 2, 10]), KINDS)
def test_the_archive_agrees_with_its_twin(seed, capacity, k, d, kind):
    rng = np.random.default_rng(seed)
    archive, twin = DominatedArchive(capacity, k), naive.DominatedArchive(capacity, k)
    for n in rng.integers(1, 30, 5):
        descriptor, fitness = rows(rng, n, d, kind)
        assert add(archive, descriptor, fitness).tolist() == twin.add(descriptor.tolist(), fitness.tolist())
        assert archive.id.tolist() == [i for i, _, _ in twin.stored]
        assert archive.descriptor.tolist() == [x for _, x, _ in twin.stored]
        assert_array_equal(archive.score(), naive.dominated_novelty(archive.descriptor, archive.fitness, k))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 150), st.integers(1, 20), st.sampled_from([1, 2, 10]), KINDS)
def test_kernels_agree_with_their_twins(seed, n, k, d, kind):
    rng = np.random.default_rng(seed)
    points, fitness = rows(rng, n, d, kind)
    which = rng.integers(n, size=7)
    squared, found = nearest(points, fitness, which, k)
    for i, row in enumerate(which):
        others = [j for j in range(n) if j != row and fitness[j] >= fitness[row]]
        expected = sorted((naive.squared_distance(points[j], points[row]), j) for j in others)[:k]
        assert found[i].tolist() == [j for _, j in expected] + [-1] * (k - len(expected))
        assert squared[i].tolist() == [value for value, _ in expected] + [np.inf] * (k - len(expected))
    everyone = np.arange(n)
    squared, found = nearest(points, fitness, everyone, k)
    assert_array_equal(mean_distance(squared, found), naive.dominated_novelty(points, fitness, k))
    reach = np.where(rng.random(n) < 0.1, -1, squared[:, -1])
    others, theirs = rows(rng, 5, d, kind)
    expected = [
        -1 if any(naive.squared_distance(x, p) <= r and g >= f for x, g in zip(others, theirs, strict=True)) else r
        for p, f, r in zip(points, fitness, reach, strict=True)
    ]
    disturb(points, fitness, reach, others, theirs)
    assert_array_equal(reach, expected)


@pytest.mark.parametrize("kind", ["random", "ties", "constant"])
@pytest.mark.parametrize("n", [1, 2, 40])
def test_scores_are_those_of_pyribs(kind, n):
    ribs = pytest.importorskip("ribs.archives")
    other = ribs.DNSArchive(solution_dim=2, measure_dim=2, capacity=10, k_neighbors=3)
    descriptor, fitness = rows(np.random.default_rng(n), n, 2, kind)
    archive = DominatedArchive()
    add(archive, descriptor, fitness)
    assert_allclose(archive.score(), other.compute_dns(descriptor, fitness), rtol=1e-12, atol=1e-14)


def test_scores_that_are_kept_are_those_that_would_be_measured():
    """Whatever comes between: a copy, a checkpoint, new descriptors."""
    rng = np.random.default_rng(0)
    archive = DominatedArchive(200)
    for generation in range(40):
        add(archive, *rows(rng, 50, 2, "ties" if generation % 3 else "random"))
        again = DominatedArchive.made(archive.settings, archive.constants)
        again.restore(archive.columns.copied(), archive.state)
        twin = copy.deepcopy(archive)
        batch = rows(np.random.default_rng(generation), 50, 2, "random")
        for other in (again, twin):
            add(other, *batch)
        assert_array_equal(again.id, twin.id)
        assert_array_equal(again.descriptor, twin.descriptor)
        if generation % 7 == 6:
            archive.redescribe(archive.descriptor * 3 + archive.fitness[:, None])


def test_it_never_holds_more_than_its_capacity_and_keeps_the_fittest():
    archive, rng, best = DominatedArchive(30), np.random.default_rng(0), -np.inf
    for _ in range(20):
        descriptor, fitness = rows(rng, 50, 2, "random")
        status = add(archive, descriptor, fitness)
        best = max(best, fitness.max())
        assert len(archive) == 30
        assert archive.fitness.max() == best
        assert set(status.tolist()) <= {0, 1}
        assert (np.diff(archive.id) > 0).all()


@pytest.mark.parametrize(("options", "message"), [({"capacity": 0}, "capacity must"), ({"k": 1.5}, "k must")])
def test_bad_parameters(options, message):
    with pytest.raises(ValueError, match=message):
        DominatedArchive(**options)


def test_a_run_fills_it():
    archive = DominatedArchive(100)
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=50, archive=archive)
    aurora.run(auroraqd.tasks.Ballistic(), generations=5)
    assert len(aurora.archive) == 100
    assert aurora.history.last.new > 100
