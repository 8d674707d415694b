"""Coverage and QD-scores, and the grid beside a run."""

import itertools

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.callbacks import PassiveGrid
from auroraqd.metrics import coverage, effective_cells, qd_score, soft_qd_score

BOX = (3, 4), (-1.0, 0.0), (2.0, 0.5)  # bins, low, high


@st.composite
def repertoires(draw):
    number = st.floats(-3, 3, width=32)
    rows = draw(st.lists(st.tuples(number, number, number), max_size=30))
    values = np.array(rows, np.float64).reshape(len(rows), 3)
    return values[:, :2], values[:, 2]


@given(repertoires(), st.floats(-5, 5))
@settings(max_examples=100)
def test_they_agree_with_their_twins(repertoire, offset):
    points, fitness = repertoire
    assert coverage(points, *BOX) == naive.coverage(points.tolist(), *BOX)
    effective = naive.effective_cells(points.tolist(), *BOX)
    assert_allclose(effective_cells(points, *BOX), effective, rtol=1e-12)
    assert effective <= coverage(points, *BOX) * 12 + 1e-9
    expected = naive.qd_score(points.tolist(), fitness.tolist(), *BOX, offset)
    assert_allclose(qd_score(points, fitness, *BOX, offset=offset), expected, rtol=1e-12, atol=1e-12)


@given(repertoires(), repertoires(), st.randoms())
def test_more_individuals_never_make_them_worse(one, other, random):
    points, fitness = (np.concatenate(pair) for pair in zip(one, other, strict=True))
    assert 0 <= coverage(one[0], *BOX) <= coverage(points, *BOX) <= 1
    scores = [qd_score(*each, *BOX, offset=-3) for each in (one, (points, fitness))]
    assert 0 <= scores[0] <= scores[1] + 1e-9
    order = np.array(random.sample(range(len(points)), len(points)), int)
    assert coverage(points[order], *BOX) == coverage(points, *BOX)
    assert qd_score(points[order], fitness[order], *BOX) == qd_score(points, fitness, *BOX)


def test_by_hand():
    points, fitness = [[0.1, 0.1], [0.2, 0.2], [0.9, 0.1], [7.0, -7.0]], [1.0, 3.0, 5.0, 2.0]
    assert coverage(points, 2, 0, 1) == 0.5
    assert qd_score(points, fitness, 2, 0, 1) == 8  # outside is at the border, where 5 is better than 2
    assert qd_score(points, fitness, 2, 0, 1, offset=-1) == 10
    assert effective_cells(points, 2, 0, 1) == effective_cells(points[1:3], 2, 0, 1) == 2  # as many in each
    assert effective_cells(points[:2], 2, 0, 1) == 1
    assert effective_cells(np.empty((0, 2)), 2) == coverage(np.empty((0, 2)), 2) == qd_score(np.empty((0, 2)), [], 2) == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: coverage([0.0], 2), r"points must have shape \(n, d\)"),
        (lambda: coverage(np.empty((3, 0)), 2), "points must have shape .* with d >= 1"),
        (lambda: coverage([[np.nan]], 2), "points must be finite"),
        (lambda: coverage([[0.0]], (2, 2)), "bins must be a number, or 1, one for each dimension, got 2"),
        (lambda: coverage([[0.0]], 2.5), "bins must be "),
        (lambda: coverage([[0.0]], "2"), "bins must be a whole number, 1 or more, got '2'"),
        (lambda: coverage([[0.0]], 0), "bins must be a whole number, 1 or more, got 0"),
        (lambda: coverage([[0.0]], 2, 1, 1), "low must be below high"),
        (lambda: qd_score([[0.0]], [1, 2], 2), r"fitness must have shape \(1,\), as there are points, got \(2,\)"),
        (lambda: qd_score([[0.0]], [1], 2, offset=np.nan), "offset must be a finite number"),
        (lambda: soft_qd_score([[0.0]], [-1], 1), "fitness must be 0 or more, subtract the least there can be, got -1"),
        (lambda: soft_qd_score([[0.0]], [1], 0), "sigma must be a finite number, above 0, got 0"),
        (lambda: soft_qd_score([0.0], [1], 1), "descriptor must have shape"),
        (lambda: PassiveGrid(2, 1, 0), "low must be below high"),
        (lambda: PassiveGrid(2, (0, 0), (1, 1, 1)), "low and high must be numbers, or 3 each"),
        (lambda: PassiveGrid("x"), "bins must be"),
        (lambda: PassiveGrid(2, of="genotype"), "of must be one of ground_truth, descriptor, got 'genotype'"),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(("n", "d", "sigma"), [(1, 1, 0.3), (12, 1, 0.2), (2, 2, 0.5), (9, 2, 0.4)])
def test_the_soft_score_agrees_with_its_twin(n, d, sigma):
    rng = np.random.default_rng(n)
    points, fitness = rng.random((n, d)), rng.random(n)
    expected = naive.soft_qd_score(points.tolist(), fitness.tolist(), sigma, 0.02 if d == 1 else 0.15)
    apart = fitness.sum() * (2 * np.pi * sigma**2) ** (d / 2)
    for seed in range(3):
        error = soft_qd_score(points, fitness, sigma, samples=40_000, seed=seed) - expected
        assert abs(error) < 4 * apart / (2 * np.sqrt(40_000)) + 1e-3 * expected  # four times what the docstring promises


def test_the_soft_score_in_limits():
    points, fitness = np.random.default_rng(0).random((50, 5)), np.arange(50.0)
    apart = fitness.sum() * (2 * np.pi * 1e-8) ** 2.5
    assert_allclose(soft_qd_score(points, fitness, 1e-4), apart)  # each alone
    together = np.zeros((50, 5))
    assert_allclose(soft_qd_score(together, np.ones(50), 0.1), (2 * np.pi * 0.01) ** 2.5)  # all as one
    assert soft_qd_score(points, fitness, 0.1) == soft_qd_score(points, fitness, 0.1)
    assert_allclose(soft_qd_score(points, 7 * fitness, 0.1), 7 * soft_qd_score(points, fitness, 0.1))
    assert soft_qd_score(points, 0 * fitness, 0.1) == soft_qd_score(np.empty((0, 2)), [], 1) == 0


def task(genotypes):
    """Half a plane is invalid."""
    fitness = np.where(genotypes[:, 0] < 0.2, np.nan, genotypes.sum(axis=1))
    return fitness, np.repeat(genotypes, 3, axis=1), genotypes


def test_a_passive_grid_sees_all_that_is_evaluated():
    seen = []
    grid = PassiveGrid(5, 0, 1, offset=0.2)
    aurora = auroraqd.Aurora(2, PCA(2), archive=auroraqd.UnstructuredArchive(l=1.0), resolution=None, seed=0, batch_size=30)

    def watched(genotypes):
        seen.append(genotypes)
        return task(genotypes)

    aurora.run(watched, generations=6, callback=[grid])
    aurora.run(watched, generations=2, callback=grid)
    points = np.concatenate(seen)
    points = points[points[:, 0] >= 0.2]
    assert len(points) > len(grid.archive) > len(aurora.archive)
    assert grid.scores[-1] == (8, 240, coverage(points, 5, 0, 1), grid.qd_score)
    assert_allclose(grid.qd_score, qd_score(points, points.sum(axis=1), 5, 0, 1, offset=0.2))
    assert [score.generation for score in grid.scores] == list(range(1, 9))
    assert all(one.coverage <= other.coverage for one, other in itertools.pairwise(grid.scores))


def test_a_passive_grid_changes_nothing_and_needs_a_ground_truth():
    def grown(callback):
        return auroraqd.Aurora(2, PCA(2), seed=0, batch_size=30).run(task, generations=4, callback=callback)

    grid = PassiveGrid((4, 4), -3, 3, of="descriptor")
    with_grid, without = grown(grid), grown(None)
    assert np.array_equal(with_grid.archive.genotype, without.archive.genotype)
    assert 0 < grid.coverage <= 1
    with pytest.raises(ValueError, match="the task gives none"):
        auroraqd.Aurora(2, PCA(2), seed=0, batch_size=30).run(
            lambda genotypes: task(genotypes)[:2], generations=1, callback=PassiveGrid(3)
        )


class Watches:
    def __init__(self):
        self.told_of, self.stored = [], 0

    def told(self, aurora, batch, info):
        self.told_of += batch["born"].tolist()
        self.stored += len(info.status[info.status > 0])
        assert np.array_equal(np.isnan(batch["descriptor"]).all(axis=1), info.status == -1)


def test_those_that_wait_are_told_once_they_are_described():
    watch = Watches()
    aurora = auroraqd.Aurora(2, PCA(2), seed=0, batch_size=1, schedule=auroraqd.Never())
    aurora.run(lambda genotypes: (np.ones(1), genotypes[:, :, None]), generations=2, callback=watch)
    assert watch.told_of == []
    aurora.run(lambda genotypes: (np.ones(1), genotypes[:, :, None]), generations=3, callback=watch)
    assert watch.told_of == [0, 1, 2, 3, 4]
    assert watch.stored == aurora.history.last.new + aurora.history.last.replaced


def test_an_interrupt_after_it_was_told_loses_nothing():
    watch = Watches()
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=5)
    tell = aurora._tell_checked

    def interrupted(*arguments):
        tell(*arguments)
        raise KeyboardInterrupt

    aurora._tell_checked = interrupted
    with pytest.raises(KeyboardInterrupt):
        aurora.run(lambda genotypes: (np.ones(5), genotypes, genotypes), generations=2, callback=watch)
    assert watch.told_of == [0, 1, 2, 3, 4]
    del aurora._tell_checked
    assert aurora.latest[0].rows == 5
