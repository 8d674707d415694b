"""Tasks that see: air hockey through a camera, and a maze."""

import math
from itertools import pairwise

import commands
import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import tasks
from auroraqd.tasks import _pixels, air_hockey, maze


def genotypes_of(task, n, seed=0):
    return np.random.default_rng(seed).random((n, task.n_genes))


@pytest.mark.parametrize("seed", range(5))
def test_pictures_agree_with_their_twin(seed):
    """Lines and discs, also beyond the edges."""
    rng = np.random.default_rng(seed)
    found = np.zeros((12, 12), np.uint8)
    shapes = []
    for kind in range(4):
        start = tuple(rng.uniform(-4, 16, 2).tolist())
        end = start if kind % 2 else tuple(rng.uniform(-4, 16, 2).tolist())
        radius, value = rng.uniform(0.1, 3), float(rng.integers(1, 256))
        shapes.append((start, end, radius, value))
        if kind % 2:
            _pixels.disc(found, *start, radius, value)
        else:
            _pixels.line(found, *start, *end, radius, value)
    assert_allclose(found.astype(int), naive.picture(12, shapes), atol=1)  # a rounding may fall to either side
    assert found.any()


def test_the_camera_sees_the_puck_where_it_is():
    task = tasks.AirHockeyCamera(size=64, frames=5)
    genotypes = genotypes_of(task, 40)
    fitness, pictures, truth = task(genotypes)
    plain = tasks.AirHockey()(genotypes)
    assert_array_equal(truth, plain.ground_truth)
    assert_array_equal(fitness, 0)
    assert pictures.dtype == np.uint8
    assert pictures.shape == (40, 64, 64, 5)
    pixels = np.arange(64) + 0.5
    weights = pictures.astype(float) / pictures.sum(axis=(1, 2), dtype=float)[:, None, None]
    x = np.einsum("nijk,j->nk", weights, pixels) / 64 * 1.98 - 0.99
    y = 0.99 - np.einsum("nijk,i->nk", weights, pixels) / 64 * 1.98
    way = plain.observation[:, 9::10]
    assert_allclose(np.stack([x, y], axis=2), way, atol=0.01)  # less than a third of a pixel
    assert len(np.unique(pictures[..., -1], axis=0)) > 3
    assert_array_equal(task(genotypes[7:8]).observation[0], pictures[7])


def test_the_arm_is_seen_if_it_is_asked_for():
    genotypes = genotypes_of(tasks.AirHockeyCamera(), 4)
    task = tasks.AirHockeyCamera(size=48, frames=1, arm=True)
    scale = 48 / 1.98
    path = tasks.AirHockey()(genotypes).observation
    for picture, arm, place in zip(
        task(genotypes).observation[..., 0], air_hockey.joints(genotypes)[:, -1], path[:, -1], strict=True
    ):
        at = [((0.99 - y) * scale, (0.99 + x) * scale) for x, y in (*arm, place)]
        shapes = [(a, b, 0.009 * scale, 120) for a, b in pairwise(at[:-1])]
        expected = naive.picture(48, [*shapes, (at[-1], at[-1], 0.05 * scale, 255)])
        assert_allclose(picture.astype(int), expected, atol=1)


def test_the_maze_agrees_with_its_twin():
    task = tasks.Maze(steps=300)
    genotypes = genotypes_of(task, 12)
    fitness, _, truth = task(genotypes)
    paths = task.paths(genotypes, 300)
    assert_array_equal(paths[:, -1], truth)
    stopped = 0
    for genotype, path, f in zip(genotypes, paths, fitness, strict=True):
        places, effort = naive.maze((5 * (2 * genotype - 1)).tolist(), maze.WALLS.tolist(), 300)
        assert_allclose(path, places, atol=1e-6)
        assert_allclose(f, -effort)
        stopped += (np.diff(path, axis=0) == 0).all(axis=1).any()
    assert stopped > 2  # walls were met


def test_no_robot_passes_a_wall():
    task = tasks.Maze()
    paths = task.paths(genotypes_of(task, 100), 2000)
    starts, ends = maze.WALLS[:, :2], maze.WALLS[:, 2:]
    along = ends - starts
    share = np.clip(np.einsum("nswi,wi->nsw", paths[:, :, None] - starts, along) / (along**2).sum(axis=1), 0, 1)
    gaps = np.linalg.norm(paths[:, :, None] - starts - share[..., None] * along, axis=3)
    assert gaps.min() > maze.RADIUS
    assert np.linalg.norm(np.diff(paths, axis=1), axis=2).max() <= 5 + 1e-9
    assert np.linalg.norm(paths[:, -1] - [60, 450], axis=1).max() > 200


def test_lasers_and_bumpers_by_hand():
    assert maze.sight(maze.WALLS, 60.0, 450.0, math.pi) == pytest.approx(60)
    assert maze.sight(maze.WALLS, 60.0, 400.0, -math.pi / 2) == pytest.approx(100)
    assert maze.sight(maze.WALLS, 60.0, 350.0, -math.pi / 4) == pytest.approx(50 * math.sqrt(2))
    assert maze.sight(maze.WALLS, 120.0, 500.0, 0.0) == pytest.approx(80)
    gap, bearing = maze.nearest(maze.WALLS, 30.0, 450.0)
    assert gap == pytest.approx(30)
    assert math.cos(bearing) == pytest.approx(-1)


def test_the_maze_is_seen_from_above():
    task = tasks.Maze(size=40, steps=100)
    genotypes = genotypes_of(task, 5)
    _, pictures, places = task(genotypes)
    assert pictures.dtype == np.uint8
    assert pictures.shape == (5, 40, 40, 1)
    scale = 40 / 600
    walls = [(((600 - y) * scale, x * scale), ((600 - v) * scale, u * scale), 5 * scale, 90) for x, y, u, v in maze.WALLS]
    for picture, (x, y) in zip(pictures[..., 0], places, strict=True):
        robot = ((600 - y) * scale, x * scale)
        assert_allclose(picture.astype(int), naive.picture(40, [*walls, (robot, robot, 10 * scale, 255)]), atol=1)


@pytest.mark.parametrize("task", [tasks.AirHockeyCamera(size=16), tasks.Maze(size=16, steps=200)])
def test_runs_are_the_same_bit_for_bit(task):
    one, other = (auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=50).run(task, generations=5) for _ in range(2))
    assert_array_equal(one.archive.observation, other.archive.observation)
    assert_array_equal(one.archive.descriptor, other.archive.descriptor)
    assert len(one.archive) > 10
    assert one.archive.observation.dtype == np.uint8


@pytest.mark.parametrize("task", ["air-hockey-camera:size=16,frames=2", "maze:size=16,steps=100"])
def test_on_the_command_line(task, tmp_path):
    done = commands.cli("run", task, "-n", 3, "--batch-size", 40, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    repertoire = auroraqd.load(tmp_path / "run")
    assert repertoire.observation.shape[1:3] == (16, 16)
    again = commands.cli("repeat", tmp_path / "run", "--out", tmp_path / "again", "--no-figures")
    assert again.returncode == 0, again.stderr
    assert_array_equal(auroraqd.load(tmp_path / "again").observation, repertoire.observation)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tasks.AirHockeyCamera(size=0), "size must be a whole number, from 1 to 1024, got 0"),
        (lambda: tasks.AirHockeyCamera(frames=51), "frames must be a whole number, from 1 to 50, got 51"),
        (lambda: tasks.AirHockeyCamera(arm="yes"), "arm must be True or False, got 'yes'"),
        (lambda: tasks.AirHockeyCamera(-1), "restitution_threshold must be a finite number"),
        (lambda: tasks.AirHockeyCamera()([[0.5]]), r"genotypes must have shape \(n, 8\), got \(1, 1\)"),
        (lambda: tasks.Maze(size=2.5), "size must be a whole number"),
        (lambda: tasks.Maze(steps=0), "steps must be a whole number, from 1 to 1000000, got 0"),
        (lambda: tasks.Maze()([[0.5]]), r"genotypes must have shape \(n, 42\), got \(1, 1\)"),
        (lambda: tasks.Maze()([[1.5] * 42]), r"genotypes must be in \[0, 1\]"),
        (lambda: tasks.Maze(steps=3).paths([[0.5] * 42], 4), "samples must be a whole number, from 1 to 3, got 4"),
    ],
)
def test_mistakes(call, message):
    with pytest.raises(ValueError, match=message):
        call()
