import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

import auroraqd
from auroraqd.archives import cvt
from auroraqd.archives._nearest import Nearest


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("AURORAQD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def add(archive, descriptor, fitness):
    n = len(descriptor)
    return archive.add(np.arange(n, dtype=float)[:, None], fitness, np.zeros((n, 1)), descriptor)


GRIDS = [((7,), [-1.0], [1.0]), ((3, 4), [0.0, -5.0], [1.0, 5.0]), ((2,) * 10, [0.0] * 10, [1.0] * 10)]


@pytest.mark.parametrize(("shape", "low", "high"), GRIDS)
def test_grid_agrees_with_its_twin(shape, low, high):
    rng = np.random.default_rng(0)
    low, high = np.array(low), np.array(high)
    x = low + (high - low) * (1.4 * rng.random((500, len(shape))) - 0.2)
    nasty = np.stack([low, high, (low + high) / 2, low - 1e30, high + 1e30, low, high])
    x = np.concatenate([x, nasty, low + (high - low) * rng.integers(0, 5, (200, len(shape))) / 4])
    archive = auroraqd.GridArchive(shape, low=low, high=high)
    cells = [naive.grid_cell(shape, low, high, row) for row in x]
    assert_array_equal(archive.cell_of(x), cells)
    assert min(cells) >= 0
    assert max(cells) < archive.n_cells
    fitness = rng.integers(0, 5, len(x)).astype(float)
    status, who = naive.map_elites(cells, fitness.tolist())
    assert_array_equal(add(archive, x, fitness), status)
    assert_array_equal(archive.genotype[:, 0], who)
    assert_array_equal(archive.cell, np.array(cells)[who])


def test_a_huge_grid_costs_only_what_is_filled():
    archive = auroraqd.GridArchive((1000,) * 6)
    assert archive.n_cells == 10**18
    add(archive, np.random.default_rng(0).random((1000, 6)), np.zeros(1000))
    assert len(archive) == 1000
    assert not archive.full


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((30,), {}, "cells must be numbers of cells, one for each dimension"),
        (([],), {}, "cells must be numbers of cells"),
        ((5.0,), {}, "cells must be numbers of cells"),
        (((0, 3),), {}, "cells must be a whole number"),
        (((10**10,) * 2,), {}, "fewer than"),
        (((3, 3),), {"low": 1}, "low must be below high"),
        (((3, 3),), {"low": [0, 0, 0]}, "low and high must be numbers, or 2 each"),
        (((3, 3),), {"high": np.inf}, "both finite"),
    ],
)
def test_bad_grids(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.GridArchive(*arguments, **options)


def clouds():
    rng = np.random.default_rng(1)
    for d, n in ((1, 5), (2, 300), (10, 1000), (100, 5000)):
        yield f"random, d = {d}", rng.normal(size=(n, d)), rng.normal(size=(200, d))
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * 10)).reshape(10, -1).T
    yield "ties", corners, np.concatenate([corners, np.full((5, 10), 0.5), rng.integers(0, 3, (100, 10)) / 2])
    yield "one point", np.array([[3.0, 4.0]]), rng.normal(size=(50, 2))
    near = 1e6 + rng.normal(size=(500, 3))
    yield "far from the origin", near, np.concatenate([near[:100] + 1e-9, near[100:200]])
    yield "close together", 5 + 1e-12 * rng.normal(size=(500, 3)), 5 + 1e-12 * rng.normal(size=(100, 3))
    yield "far away", rng.normal(size=(300, 2)), np.array([[1e30, 1.0], [-1e6, 1e6], [1e200, -1e200], [0.0, 1e12]])
    for scale in (1e-200, 1e-300, 1e160, 1e200):
        yield f"of size {scale}", scale * rng.uniform(-1, 1, (20, 2)), scale * rng.uniform(-1, 1, (20, 2))
    yield "uneven", np.concatenate([rng.normal(size=(200, 2)), 1e9 * rng.normal(size=(3, 2))]), rng.normal(size=(100, 2))


@pytest.mark.parametrize(("centroids", "x"), [pytest.param(c, x, id=name) for name, c, x in clouds()])
def test_nearest_centroid_agrees_with_its_twin(centroids, x):
    archive = auroraqd.CVTArchive(centroids)
    assert archive.n_cells == len(centroids)
    found = archive.cell_of(x)
    size = np.abs(centroids).max()
    theirs, rows = (centroids / size).tolist(), (x[: 60_000 // len(centroids)] / size).tolist()
    for row, cell in zip(rows, found, strict=False):
        wanted = naive.nearest_centroid(theirs, row)
        # Sums in another order may differ in the last bits.
        one, other = (naive.squared_distance(theirs[c], row) for c in (cell, wanted))
        assert cell == wanted or one == pytest.approx(other, rel=1e-14)


@given(
    arrays(float, st.tuples(st.integers(1, 80), st.just(2)), elements=st.integers(-3, 3).map(float)),
    arrays(float, st.tuples(st.integers(1, 30), st.just(2)), elements=st.integers(-4, 4).map(float)),
)
def test_ties_go_to_the_first_centroid(centroids, x):
    distinct = list(dict.fromkeys(map(tuple, centroids.tolist())))  # repeated rows count once, where they come first
    archive = auroraqd.CVTArchive(centroids)
    assert archive.tessellation.centroids.tolist() == [list(c) for c in distinct]
    assert archive.cell_of(x).tolist() == [naive.nearest_centroid(distinct, row) for row in x]


def test_cells_of_a_batch_do_not_depend_on_the_batch():
    rng = np.random.default_rng(2)
    archive = auroraqd.CVTArchive(rng.uniform(-1, 1, (9000, 100)))
    x = rng.uniform(-1, 1, (2500, 100))
    together = archive.cell_of(x)
    assert_array_equal(together[:40], [archive.cell_of(row[None])[0] for row in x[:40]])


def smooth(rng, n, directions=6, d=100):
    """Points of many dimensions that lie close to a space of few, as trajectories do."""
    waves = np.cos(np.outer(np.arange(directions), np.linspace(0, np.pi, d)))
    return rng.uniform(-1, 1, (n, directions)) @ waves + 0.01 * rng.normal(size=(n, d))


def everyone(centroids, x):
    """The nearest by looking at all, in the arithmetic of the archive; points of ordinary size."""
    size = np.maximum(
        np.abs(x - (centroids.min(axis=0) + centroids.max(axis=0)) / 2).max(axis=1), np.ptp(centroids, axis=0).max() / 4
    )
    scale = np.exp2(-np.frexp(size)[1].astype(float))
    return np.array([((centroids * s - row * s) ** 2).sum(axis=1).argmin() for row, s in zip(x, scale, strict=True)])


def batches():
    """Centroids, and batches of descriptors that are asked for one after the other."""
    rng = np.random.default_rng(4)
    noise, waves = rng.uniform(-1, 1, (3000, 100)), smooth(rng, 3000)
    yield "waves among noise", noise, [smooth(rng, 200) for _ in range(3)]
    yield "waves among waves", waves, [smooth(rng, 200), waves[:200], waves[200:400] + 1e-13]
    yield "noise among noise", noise, [rng.uniform(-1, 1, (200, 100)) for _ in range(2)]
    yield (
        "other directions each time",
        noise,
        [smooth(rng, 50, k) @ np.diag(rng.choice([-1.0, 1.0], 100)) for k in (1, 2, 5, 9)],
    )
    yield "one at a time", noise, list(rng.uniform(-1, 1, (12, 1, 100)))
    yield "copies", waves, [np.repeat(smooth(rng, 10), 20, axis=0)] * 2
    twice = np.concatenate([waves, waves + 1e-15])
    yield "nearly copies of each other", twice, [smooth(rng, 100), waves[:100]]
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 11)).reshape(11, -1).T
    yield "all equally far", corners, [np.zeros((3, 11)), np.eye(11), rng.integers(-2, 3, (60, 11)).astype(float)]
    yield (
        "clusters",
        np.repeat(rng.normal(size=(30, 40)), 60, axis=0) + 1e-6 * rng.normal(size=(1800, 40)),
        [rng.normal(size=(99, 40))],
    )
    yield "one dimension", rng.normal(size=(500, 1)), [rng.normal(size=(300, 1)), np.zeros((2, 1))]
    yield "one centroid", np.ones((1, 100)), [smooth(rng, 20), np.ones((1, 100))]
    yield "at the middle", np.concatenate([waves, -waves]), [np.zeros((5, 100)), 1e-20 * rng.normal(size=(5, 100))]
    yield (
        "far and near",
        waves,
        [np.concatenate([smooth(rng, 20), 1e3 * smooth(rng, 20), 1e9 * smooth(rng, 20), 1e150 * smooth(rng, 9)])],
    )
    yield "huge", 1e150 * waves, [1e150 * smooth(rng, 100)]
    yield "more than are remembered", noise[:70], [smooth(rng, 9000), smooth(rng, 900)]


@pytest.mark.parametrize(("centroids", "asked"), [pytest.param(c, x, id=name) for name, c, x in batches()])
def test_bounds_leave_out_nobody(centroids, asked):
    archive = auroraqd.CVTArchive(centroids)
    for x in asked:
        assert_array_equal(archive.cell_of(x), everyone(archive.tessellation.centroids, x))
        assert_array_equal(archive.cell_of(x[::-1]), archive.cell_of(x)[::-1])


def test_few_directions_serve_descriptors_that_are_alike():
    rng = np.random.default_rng(5)
    nearest = Nearest(rng.uniform(-1, 1, (3000, 100)))
    nearest(smooth(rng, 100))
    few = nearest.directions
    assert few < 30
    nearest(smooth(rng, 100))
    assert nearest.directions == few
    nearest(rng.uniform(-1, 1, (100, 100)))
    assert nearest.directions == 100


def test_elites_of_a_cvt_agree_with_the_twin():
    rng = np.random.default_rng(3)
    archive = auroraqd.CVTArchive(rng.random((40, 3)))
    x, fitness = rng.random((600, 3)), rng.integers(0, 9, 600).astype(float)
    status, who = naive.map_elites(archive.cell_of(x).tolist(), fitness.tolist())
    assert_array_equal(add(archive, x, fitness), status)
    assert_array_equal(archive.genotype[:, 0], who)


def test_tessellation_is_spread_and_kept_on_disk(cache):
    samples = np.random.default_rng(0).random((3000, 2))
    found = auroraqd.tessellate(samples, 50, steps=20)
    assert found.centroids.shape == (50, 2)
    assert (found.asked, found.samples) == (50, 3000)
    assert 1 <= found.steps <= 20
    assert "50 distinct centroids of 50, from 3000 samples" in str(found)
    nearest = np.sqrt(((samples[:, None] - found.centroids) ** 2).sum(axis=2).min(axis=1))
    scattered = np.sqrt(((samples[:, None] - samples[:50]) ** 2).sum(axis=2).min(axis=1))
    assert nearest.mean() < 0.85 * scattered.mean()
    (file,) = cache.iterdir()
    changed = cvt._read(file)
    assert changed is not None
    cvt._write(file, changed._replace(steps=77))  # to see where the next comes from
    assert auroraqd.tessellate(samples, 50, steps=20).steps == 77
    assert auroraqd.tessellate(samples, 50, steps=19).steps != 77
    assert auroraqd.tessellate(samples, 50, steps=20, cache=False).steps == found.steps
    file.write_bytes(b"damaged")
    assert_array_equal(auroraqd.tessellate(samples, 50, steps=20).centroids, found.centroids)


def test_a_cache_that_cannot_be_written_costs_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("AURORAQD_CACHE", str(tmp_path / "file" / "below"))
    assert len(auroraqd.tessellate(np.random.default_rng(0).random((40, 2)), 5).centroids) == 5


@pytest.mark.parametrize("scale", [1e-30, 1e40, 1e150])
def test_tessellation_of_any_scale(scale):
    samples = np.random.default_rng(0).random((200, 3))
    found = auroraqd.tessellate(scale * samples, 20, cache=False)
    assert len(found.centroids) == 20
    assert_allclose(found.centroids / scale, auroraqd.tessellate(samples, 20, cache=False).centroids, atol=1e-5)


def test_fewer_distinct_samples_than_cells():
    samples = np.repeat(np.random.default_rng(0).random((10, 2)), 5, axis=0)
    found = auroraqd.tessellate(samples, 20)
    assert_array_equal(found.centroids, np.unique(samples, axis=0))
    assert str(found).startswith("10 distinct centroids of 20")
    assert auroraqd.CVTArchive(found).n_cells == 10


@pytest.mark.parametrize(
    ("samples", "cells", "message"),
    [
        (np.zeros((5, 2)), 6, "samples must be at least as many as cells, 6, got 5"),
        (np.zeros(5), 2, r"samples must have shape \(n, d\)"),
        (np.full((5, 2), np.nan), 2, "samples must be finite"),
        (np.zeros((5, 2)), 0, "cells must be a whole number"),
        ("many", 2, "samples must be numbers"),
    ],
)
def test_bad_samples(samples, cells, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.tessellate(samples, cells)


def test_bad_descriptors():
    archive = auroraqd.CVTArchive([[0.0, 0.0], [1.0, 1.0]])
    with pytest.raises(ValueError, match="descriptor must have 2 dimensions, as the cells have, got 3"):
        archive.cell_of(np.zeros((1, 3)))
    with pytest.raises(ValueError, match="descriptor must be finite"):
        archive.cell_of([[np.nan, 0]])
    with pytest.raises(ValueError, match=r"centroids must have shape \(n, d\)"):
        auroraqd.CVTArchive(np.empty((0, 2)))


def test_aurora_on_cells():
    """MAP-Elites with known bounds: the whole observation, scaled by the prior, in a CVT; a hand-coded one on a grid."""
    task = auroraqd.tasks.Ballistic()
    prior = task.prior()
    assert prior.shape == (10_000, 50, 2)
    assert len(np.unique(prior.reshape(10_000, -1), axis=0)) == 9_901
    archive = auroraqd.CVTArchive(auroraqd.Aurora(2, "observation", prior=prior).describe(prior))
    assert archive.n_cells == 9_901
    aurora = auroraqd.Aurora(2, "observation", prior=prior, archive=archive, seed=0).run(task, generations=8)
    assert aurora.archive.descriptor.shape == (len(archive), 100)
    assert np.isnan(aurora.history.last.l)
    assert aurora.history.last.replaced == 0  # fitness is constant
    assert_array_equal(aurora.describe(archive.observation), archive.descriptor)
    grid = auroraqd.GridArchive((20, 20))
    auroraqd.Aurora(2, "hand-coded", archive=grid, seed=0).run(task, generations=20)
    assert 100 < len(grid) <= 400
    assert_array_equal(grid.cell_of(grid.ground_truth), grid.cell)


@pytest.mark.parametrize("bad", ["x", [[1], [1, 2]], None, {}])
def test_places_that_are_no_numbers(bad):
    with pytest.raises(ValueError, match=r"descriptor must be numbers of shape \(n, 2\), got "):
        auroraqd.GridArchive((3, 3)).cell_of(bad)
