"""Selection, variation, resolution, schedule."""

import dataclasses

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.distance import pdist
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.control.resolution import Automatic, largest_distance, separations
from auroraqd.emitters.selection import _roulette, in_proportion, novelty
from auroraqd.emitters.variation import _fill, _step


@pytest.fixture
def archive():
    archive = auroraqd.UnstructuredArchive(l=0.01)
    x = np.linspace(0, 1, 20)[:, None]
    archive.add(x, np.zeros(20), x, x)
    return archive


def test_values_not_objects():
    """Strategies are values: equal, hashable, printable."""
    for kind in (
        auroraqd.Uniform,
        auroraqd.Curiosity,
        auroraqd.Polynomial,
        auroraqd.Gaussian,
        auroraqd.VAT,
        auroraqd.Doubling,
        auroraqd.Widening,
        auroraqd.CSC,
    ):
        assert kind() == kind()
        assert hash(kind()) == hash(kind())
        assert eval(repr(kind()), vars(auroraqd) | {kind.__name__: kind}) == kind()
        with pytest.raises(dataclasses.FrozenInstanceError):
            kind().anything = 1


def frequencies(selection, archive, n=200_000):
    rows = selection(archive, n, np.random.default_rng(0))
    assert rows.shape == (n,)
    return np.bincount(rows, minlength=len(archive)) / n


def test_uniform(archive):
    assert_allclose(frequencies(auroraqd.Uniform(), archive), 1 / 20, atol=0.003)


def test_curiosity_is_uniform_while_scores_are_equal(archive):
    assert_allclose(frequencies(auroraqd.Curiosity(), archive), 1 / 20, atol=0.003)


def test_curiosity_is_a_roulette_over_shifted_scores(archive):
    archive.credit(archive.id[[0, 0, 1, 2, 2, 2]], np.array([1, 1, 0, 1, 0, 1]))  # 2, -0.5, 1.5
    weights = np.full(20, 0.5)
    weights[:3] = [2.5, 0, 2.0]
    found = frequencies(auroraqd.Curiosity(), archive)
    assert_allclose(found, weights / weights.sum(), atol=0.003)
    assert found[1] == 0


def test_curiosity_does_not_shift_positive_scores(archive):
    archive.credit(np.tile(archive.id, 2), np.ones(40))
    archive.credit(archive.id[:1], np.ones(1))
    found = frequencies(auroraqd.Curiosity(), archive)
    assert_allclose(found, np.r_[3, np.full(19, 2)] / 41, atol=0.003)


@given(
    st.lists(st.sampled_from([-30.0, -0.5, 0.0, 0.5, 1.0, 7.5, 1000.0]), min_size=1, max_size=700),
    st.lists(st.sampled_from([0.0, 0.5, 1 - 2**-53]) | st.floats(0, 1, exclude_max=True), min_size=1, max_size=20),
)
def test_roulette_agrees_with_its_twin(scores, spins):
    rows = np.empty(len(spins), np.int64)
    expected = naive.roulette(scores, spins)
    assert _roulette(np.array(scores), np.array(spins), rows) == (expected is not None)
    if expected is not None:
        assert_array_equal(rows, expected)


def with_errors(errors):
    archive = auroraqd.UnstructuredArchive(l=0.01)
    x = np.linspace(0, 1, len(errors))[:, None]
    archive.add(x, np.zeros(len(x)), x, x, reconstruction_error=errors)
    return archive


def test_novelty_is_a_roulette():
    archive = auroraqd.UnstructuredArchive(l=0.01, k=1)
    x = np.array([[0.0], [1], [3], [6], [10]])
    archive.add(x, np.zeros(5), x, x)
    assert_allclose(frequencies(auroraqd.Novelty(), archive), np.array([1, 1, 2, 3, 4]) / 11, atol=0.004)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1, 2, 10]), st.booleans())
def test_novelty_in_other_archives_agrees_with_its_twin(seed, n, d, lattice):
    rng = np.random.default_rng(seed)
    archive = auroraqd.DominatedArchive()
    x = np.round(rng.random((n, d)), 1) if lattice else rng.random((n, d))
    archive.add(x, np.zeros(n), x, x)
    assert_allclose(novelty(archive), [naive.novelty(x, p, i, 15) for i, p in enumerate(x)], rtol=1e-12, atol=1e-15)


def test_surprise_is_a_roulette():
    archive = with_errors([0.0, 1.0, np.nan, 3.0, np.inf, 0.0])
    found = frequencies(auroraqd.Surprise(), archive)
    assert_allclose(found, [0, 0.25, 0, 0.75, 0, 0], atol=0.004)


def test_surprise_needs_reconstruction_errors(archive):
    with pytest.raises(ValueError, match="Surprise needs reconstruction errors"):
        auroraqd.Surprise()(archive, 3, np.random.default_rng(0))


def test_one_coin_a_batch_decides_between_two():
    archive, rng = with_errors(np.array([0.0, 0.0, 0.0, 1.0])), np.random.default_rng(0)
    surprised = [(auroraqd.Mixed(auroraqd.Uniform(), auroraqd.Surprise())(archive, 30, rng) == 3).all() for _ in range(400)]
    assert 0.42 < np.mean(surprised) < 0.58


@given(
    st.lists(st.sampled_from([0.0, 0.5, 3.0, 1e300, 1e-300, np.nan, np.inf]), min_size=1, max_size=50),
    st.integers(0, 2**32 - 1),
)
def test_in_proportion_agrees_with_its_twin(weights, seed):
    rows = in_proportion(np.array(weights), 20, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    if any(0 < weight < np.inf for weight in weights):
        assert rows.tolist() == naive.in_proportion(weights, rng.random(20).tolist())
    else:
        assert_array_equal(rows, rng.integers(len(weights), size=20))


VARIATIONS = [
    auroraqd.Polynomial(),
    auroraqd.Polynomial(rate=1, eta=0),
    auroraqd.Gaussian(sigma=0.5),
    auroraqd.Gaussian(rate=0.2),
    auroraqd.IsoLine(line_sigma=2),
]


@pytest.mark.parametrize("vary", VARIATIONS, ids=repr)
@pytest.mark.parametrize("n_genes", [1, 2, 30])
def test_children_are_legal_and_parents_unharmed(vary, n_genes):
    rng = np.random.default_rng(0)
    shape = (300, n_genes) if getattr(vary, "n_parents", 1) == 1 else (300, vary.n_parents, n_genes)
    parents = rng.choice([0.0, 1.0, 0.5], shape)
    before = parents.copy()
    children = vary(parents, rng)
    assert children.shape == (300, n_genes)
    assert ((children >= 0) & (children <= 1)).all()
    assert_array_equal(parents, before)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.floats(0, 1), st.floats(0, 100))
def test_kernels_of_mutation_agree_with_their_twins(seed, n_genes, rate, eta):
    rng = np.random.default_rng(seed)
    genes, mutated = rng.random((30, n_genes)), rng.random((30, n_genes)) < rate
    spins = rng.choice([0.0, 0.5, np.nextafter(1, 0), rng.random()], 30)
    filled = naive.fill(mutated.tolist(), spins.tolist())
    _fill(mutated, spins)
    assert mutated.tolist() == filled
    spins = np.resize(np.append(spins, rng.random(100)), np.count_nonzero(mutated))
    expected = naive.step(genes.tolist(), mutated.tolist(), spins.tolist(), 1 / (eta + 1))
    _step(genes, mutated, spins, 1 / (eta + 1))
    assert_allclose(genes, expected, rtol=0, atol=1e-12)


def test_polynomial_rates():
    rng = np.random.default_rng(0)
    parents = np.full((50_000, 2), 0.5)
    changed = auroraqd.Polynomial(at_least_one=False)(parents, rng) != parents
    assert_allclose(changed.mean(), 0.1, atol=0.003)
    assert_allclose((~changed.any(axis=1)).mean(), 0.81, atol=0.005)
    changed = auroraqd.Polynomial()(parents, rng) != parents
    assert changed.any(axis=1).all()
    assert_allclose(changed.mean(axis=0), 0.1 + 0.81 / 2, atol=0.01)


def test_polynomial_steps_have_their_distribution():
    """delta = (2r)^(1/(eta+1)) - 1 below the median, mirrored above: P(|delta| < s) = 1 - (1 - s)^(eta+1)."""
    steps = auroraqd.Polynomial(rate=1, eta=10)(np.full((200_000, 1), 0.5), np.random.default_rng(0)) - 0.5
    assert_allclose(steps.mean(), 0, atol=0.001)
    for s in (0.02, 0.1, 0.3):
        assert_allclose((np.abs(steps) < s).mean(), 1 - (1 - s) ** 11, atol=0.005)


def test_gaussian_steps():
    steps = auroraqd.Gaussian(sigma=0.02)(np.full((100_000, 2), 0.5), np.random.default_rng(0)) - 0.5
    assert_allclose(steps.std(axis=0), 0.02, rtol=0.02)


def test_iso_line_steps_lie_along_the_line():
    parents = np.tile([[0.5, 0.5], [0.6, 0.5]], (100_000, 1, 1))
    steps = auroraqd.IsoLine(iso_sigma=0.01, line_sigma=0.2)(parents, np.random.default_rng(0)) - 0.5
    assert_allclose(steps.std(axis=0), [np.hypot(0.01, 0.2 * 0.1), 0.01], rtol=0.02)


def test_vat_in_two_dimensions_is_the_reference():
    square = np.array([[0.0, 0.0], [3.0, 4.0], [1.0, 1.0]])
    assert_allclose(auroraqd.VAT()(square), 5 / np.sqrt(60000))


@pytest.mark.parametrize("d", [1, 2, 3, 10])
def test_vat_keeps_the_number_of_cells(d):
    ends = np.zeros((2, d))
    ends[1, 0] = 2.0  # unit ball
    volume = {1: 2, 2: np.pi, 3: 4 / 3 * np.pi, 10: np.pi**5 / 120}[d]
    assert_allclose(volume / auroraqd.VAT()(ends) ** d, 60000 * np.pi / 4)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 10), st.integers(1, 150), st.booleans())
def test_largest_distance_agrees_with_its_twin(seed, d, n, degenerate):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, d))
    if degenerate:  # on a line, with duplicates: no hull
        points = np.round(points[:, :1], 1) * np.ones(d)
    assert_allclose(largest_distance(points), naive.largest_distance(points), rtol=1e-12)


def test_largest_distance_of_many():
    points = np.random.default_rng(0).normal(size=(20_000, 6))
    points[77], points[12_345] = 30, -31
    assert_allclose(largest_distance(points), 61 * np.sqrt(6))
    assert largest_distance(np.ones((500, 2))) == 0


@pytest.mark.filterwarnings("ignore:.*far outside the others")
def test_no_single_descriptor_decides_l():
    x = np.random.default_rng(0).random((1000, 2))
    exact = auroraqd.VAT(robust=False)
    assert auroraqd.VAT()(x) == exact(x)
    outlying = np.vstack([x, [[1e6, -1e6]]])
    assert auroraqd.VAT()(outlying) == exact(x)
    assert auroraqd.Size(200)(outlying) == pytest.approx(auroraqd.Size(200)(x), rel=0.02)
    assert exact(outlying) > 1e5 * exact(x)


def test_what_does_not_count_for_l_is_said():
    x = np.vstack([np.random.default_rng(0).random((99, 2)), [[50, 0]]])
    with pytest.warns(UserWarning, match="1 of 100 descriptors lies far outside the others, up to 50, not counted"):
        auroraqd.VAT()(x)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 10), st.integers(1, 40), st.integers(1, 40), st.booleans())
def test_separations_agree_with_their_twin(seed, d, m, n, degenerate):
    points = np.random.default_rng(seed).normal(size=(m, d))
    if degenerate:  # ties and duplicates
        points = np.round(points)
    assert_allclose(separations(points, n), naive.separations(points.tolist(), n), rtol=1e-12)


@pytest.mark.parametrize("d", [1, 2, 3, 5, 10])
@pytest.mark.parametrize("wanted", [50, 500])
def test_size_is_about_how_many_are_stored(d, wanted):
    """Of many more than are wanted, added in random order."""
    x = np.random.default_rng(d).random((8000, d))
    archive = auroraqd.UnstructuredArchive(l=auroraqd.Size(wanted)(x))
    archive.add(np.zeros((8000, 1)), np.zeros(8000), np.zeros((8000, 1)), x)
    assert 0.75 * wanted < len(archive) < 1.5 * wanted


def test_size_of_few_or_equal_descriptors():
    size = auroraqd.Size(100)
    assert size(np.zeros((1, 3))) == size(np.zeros((500, 3))) == 0
    assert size(np.array([[0.0, 0], [1, 1]])) > 0
    assert size(np.random.default_rng(0).random((7, 2))) > 0
    line = np.random.default_rng(0).random((400, 1)) * np.ones(8)  # one dimension in eight
    assert auroraqd.Size(4000)(line) == pytest.approx(auroraqd.Size(4000)(line[:, :1]) * np.sqrt(8))


def test_cells_in_two_dimensions_and_a_size_in_more():
    x = np.random.default_rng(0).random((300, 3))
    assert Automatic()(x[:, :2]) == auroraqd.VAT()(x[:, :2])
    assert Automatic(individuals=70)(x) == auroraqd.Size(70)(x) != auroraqd.VAT()(x)
    assert Automatic(cells=100)(x[:, :1]) == auroraqd.VAT(100)(x[:, :1])


def test_csc_begins_with_a_box_along_the_axes_of_the_descriptors():
    corners = np.array([[0, 0], [4, 0], [4, 1], [0, 1]]) + 7.0
    turned = corners @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    for box in (corners, turned):
        assert_allclose(auroraqd.CSC(100)(box), 0.5 * np.sqrt(4 / 100))
        assert_allclose(auroraqd.CSC(100)(1e300 * box), 1e300 * 0.5 * np.sqrt(4 / 100))
    assert_allclose(auroraqd.CSC(10)(corners[:, :1]), 0.5 * 4 / 10)
    line = np.linspace(0, 1, 30)[:, None] * np.ones(10)  # one dimension in ten
    assert_allclose(auroraqd.CSC(10)(line), 0.5 * np.sqrt(10) / 10)
    assert auroraqd.CSC()(np.ones((5, 3))) == auroraqd.CSC()(np.ones((1, 3))) == 0


def test_csc_moves_l_after_each_generation():
    """With fewer than the target l falls, so that a rebuild loses none."""
    options = {"seed": 0, "batch_size": 50, "resolution": auroraqd.CSC(5000), "schedule": auroraqd.Never()}
    run = auroraqd.Aurora(2, "hand-coded", **options).run(auroraqd.tasks.Ballistic(), generations=12)
    expected = run.history.records[0].l
    for record in run.history.records[1:]:
        expected = naive.controlled(expected, record.size, 5000)
        assert_allclose(record.l, expected, rtol=1e-12)


def test_csc_lets_go_of_those_that_a_larger_l_has_brought_too_close():
    archive, csc = auroraqd.UnstructuredArchive(l=0.05), auroraqd.CSC(1)
    x = np.random.default_rng(0).random((400, 2))
    archive.add(x, np.zeros(400), x, x)
    archive.adjust(0.1)
    before = len(archive)
    csc.control(archive, 9)
    assert len(archive) == before
    assert_allclose(archive.l, naive.controlled(0.1, before, 1))
    csc.control(archive, 10)
    assert len(archive) < before
    assert pdist(archive.descriptor).min() >= (1 - archive.epsilon) ** 2 * archive.l * (1 - 1e-12)
    assert_allclose(archive.l, naive.controlled(naive.controlled(0.1, before, 1), before, 1))


def test_csc_leaves_one_individual_and_copies_alone():
    archive, csc = auroraqd.UnstructuredArchive(), auroraqd.CSC(100)
    archive.add([[0.5]], [0.0], [[1.0]], [[0.0, 0.0]])
    csc.control(archive, 10)
    assert (archive.l, len(archive)) == (0, 1)
    archive.add([[0.5]], [0.0], [[1.0]], [[1.0, 0.0]])
    csc.control(archive, 11)
    assert_allclose(archive.l, naive.controlled(0.5 / 100, 2, 100))
    huge = auroraqd.CSC(10**9)
    for generation in range(12, 700):
        huge.control(archive, generation)
    assert (archive.l, len(archive)) == (1e-150, 2)


def test_csc_is_asked_for_l_once_and_an_update_is_not_repeated():
    asked = []

    class Counted(auroraqd.CSC):
        def __call__(self, descriptors):
            asked.append(len(descriptors))
            return super().__call__(descriptors)

    every = auroraqd.Every(4)
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=50, resolution=Counted(500), schedule=every)
    aurora.run(auroraqd.tasks.Ballistic(), generations=3)
    assert len(asked) == 1
    for _ in range(5):
        aurora.run(auroraqd.tasks.Ballistic(), generations=1)
        assert not aurora._update_due
    assert len(asked) == 1


class Stretched(PCA):
    """Each fit gives descriptors ten times as large as the one before."""

    fits = 0

    def fit(self, x, y=None):
        self.fits += 1
        return super().fit(x, y)

    def transform(self, x):
        return 10.0**self.fits * super().transform(x)


def test_csc_goes_with_the_scale_of_the_descriptors():
    def grown(descriptor, **options):
        options = {"seed": 0, "batch_size": 50, "schedule": auroraqd.Every(4), "survival": 0, **options}
        aurora = auroraqd.Aurora(2, descriptor, resolution=auroraqd.CSC(300), **options)
        return aurora.run(auroraqd.tasks.Ballistic(), generations=12)

    plain, stretched = grown(PCA(2)), grown(Stretched(2))
    assert_array_equal(plain.archive.id, stretched.archive.id)
    share = stretched.history.column("l") / plain.history.column("l")
    assert_allclose(share, np.repeat([10.0, 100.0, 1000.0], 4), rtol=1e-9)
    csc, x = auroraqd.CSC(300), np.random.default_rng(0).random((50, 2))
    assert_allclose(csc.rescaled(0.1, x, x * [2, 8]), 0.4, rtol=0.1)  # the box is along the principal axes
    assert csc.rescaled(0.1, x, x[:1]) == csc.rescaled(0.1, x[:1], x) == 0.1, "of one alone there is no box"


def test_fixed():
    assert auroraqd.Fixed(0.3)(np.random.default_rng(0).random((5, 2))) == 0.3


def test_schedules():
    assert [g for g in range(5000) if auroraqd.Doubling()(g)] == [0, 50, 150, 350, 750, 1550, 3150]  # paper
    assert [g for g in range(30) if auroraqd.Doubling(first=2)(g)] == [0, 2, 6, 14]
    widening = np.cumsum([0, *range(20, 1000, 10), *[1000] * 5])  # to the longest gap, and on with it
    assert [g for g in range(widening[-1] + 1) if auroraqd.Widening()(g)] == widening.tolist()
    assert [g for g in range(30) if auroraqd.Widening(5, 0)(g)] == [0, 5, 10, 15, 20, 25]
    assert [g for g in range(30) if auroraqd.Every(10)(g)] == [0, 10, 20]
    assert not any(auroraqd.Never()(g) for g in range(100))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: auroraqd.Polynomial(rate=1.5), "rate must"),
        (lambda: auroraqd.Polynomial(eta=-1), "eta must"),
        (lambda: auroraqd.Gaussian(sigma=0), "sigma must"),
        (lambda: auroraqd.IsoLine(0, 0), "iso_sigma"),
        (lambda: auroraqd.VAT(cells=0), "cells must"),
        (lambda: auroraqd.VAT(robust=1), "robust must be True or False"),
        (lambda: auroraqd.Size(0), "individuals must be a whole number, 1 or more"),
        (lambda: Automatic(individuals=2.5), "individuals must"),
        (lambda: auroraqd.Fixed(l=-1), "l must"),
        (lambda: auroraqd.Mixed("novelty"), "a must be callable"),
        (lambda: auroraqd.CSC(0), "target must be a whole number, 1 or more"),
        (lambda: auroraqd.Doubling(first=0), "first must"),
        (lambda: auroraqd.Widening(first=0), "first must"),
        (lambda: auroraqd.Widening(more=-1), "more must"),
        (lambda: auroraqd.Widening(first=30, most=20), "first must be most or less, got first 30 and most 20"),
        (lambda: auroraqd.Every(1.5), "generations must"),
    ],
)
def test_bad_parameters(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()
