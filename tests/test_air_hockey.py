import itertools
import math

import box2d
import naive
import numpy as np
import pytest
from box2d import START, moved
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

import auroraqd
from auroraqd.tasks import air_hockey

LIMIT = 0.94  # of the middle of the puck: its edge at 0.99


@pytest.fixture(scope="module")
def pushing():
    return box2d.pushing(120, 30)


def test_shapes_and_ground_truth():
    task = auroraqd.tasks.AirHockey()
    genotypes = np.random.default_rng(0).random((2000, task.n_genes))
    fitness, observation, truth = task(genotypes)
    assert task.n_genes == 8
    assert observation.shape == (2000, 50, 2)
    assert_array_equal(fitness, 0)
    assert_array_equal(truth, observation[:, -1])
    assert 0.15 < moved(observation).mean() < 0.25
    assert_array_equal(observation, np.concatenate([task(part).observation for part in np.split(genotypes, 4)]))


def test_energy_agrees_with_servos_stepped_one_by_one():
    genotypes = np.concatenate([np.random.default_rng(0).random((20, 8)), np.full((1, 8), 0.5), np.zeros((1, 8)), np.eye(8)])
    found = air_hockey.energy(genotypes)
    assert_allclose(found, [naive.energy(genotype) for genotype in genotypes.tolist()], rtol=1e-2)  # who steps forward lags
    assert found[20] == 0  # does not move
    quiet, loud = auroraqd.tasks.AirHockey(), auroraqd.tasks.AirHockey(energy=True)
    assert_array_equal(loud(genotypes).fitness, -found)
    assert_array_equal(loud(genotypes).observation, quiet(genotypes).observation)
    assert repr(loud) == "AirHockey(restitution_threshold=0.0, energy=True)"
    with pytest.raises(ValueError, match="energy must be True or False"):
        auroraqd.tasks.AirHockey(energy="yes")


@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_nothing_leaves_the_room(threshold):
    rng = np.random.default_rng(1)
    extreme = rng.integers(0, 3, (40_000, 8)) / 2
    genotypes = np.concatenate([rng.random((60_000, 8)), extreme])
    observation = auroraqd.tasks.AirHockey(restitution_threshold=threshold)(genotypes).observation
    assert np.isfinite(observation).all()
    assert np.abs(observation).max() <= LIMIT + 1e-12


@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_agrees_with_an_engine(pushing, threshold):
    """Which pucks move; where they are half a second after they were touched, and at the end, when chaos has had its say."""
    agreement = box2d.compare(pushing, threshold)
    assert agreement.both >= 0.95 * agreement.either
    assert agreement.both > 100
    assert np.median(agreement.soon) <= 0.02
    assert np.median(agreement.end) <= 0.1


def bounced(velocity, spin, normal, body=(0.0, 0.0), threshold=0.0):
    puck = np.array([0.0, 0.0, *velocity, spin])
    air_hockey.bounce(puck, *normal, *body, threshold)
    return puck[2:]


def test_a_wall_returns_four_fifths_of_the_normal_speed():
    assert_allclose(bounced((-2.0, 0.0), 0.0, (1.0, 0.0)), [1.6, 0, 0])
    assert_allclose(bounced((2.0, 0.0), 0.0, (1.0, 0.0)), [2.0, 0, 0])  # it is leaving
    assert_allclose(bounced((-0.5, 0.0), 0.0, (1.0, 0.0), threshold=1.0), [0, 0, 0], atol=1e-15)
    assert_allclose(bounced((0.0, 0.0), 0.0, (0.0, 1.0), body=(0.0, 0.5)), [0, 0.9, 0])  # struck


def test_spin_and_friction_of_an_impact():
    """Sliding, friction is 0.8 of the push; otherwise the point of contact comes to rest."""
    sliding = bounced((5.0, -0.1), 0.0, (0.0, 1.0))
    push = 0.1 * 1.8
    assert_allclose(sliding, [5 - 0.8 * push, 0.08, -2 * 0.8 * push / 0.05])
    rolling = bounced((0.3, -1.0), 0.0, (0.0, 1.0))
    assert_allclose(rolling, [0.2, 0.8, -2 * 0.1 / 0.05])
    assert_allclose(rolling[0] + rolling[2] * 0.05, 0, atol=1e-15)
    spinning = bounced((0.0, -1.0), 6.0, (0.0, 1.0))
    assert_allclose(spinning, [-0.1, 0.8, 6 - 2 * 0.1 / 0.05])


finite = st.floats(-10, 10)


@given(arrays(float, 3, elements=finite), st.floats(0, 2 * math.pi), st.tuples(finite, finite), st.sampled_from([0.0, 1.0]))
def test_bounce_agrees_with_its_twin(moving, angle, body, threshold):
    normal = (math.cos(angle), math.sin(angle))
    ours = bounced(moving[:2], moving[2], normal, body, threshold)
    assert_allclose(ours, naive.bounce(*moving.tolist(), normal, body, threshold), atol=1e-9)


def test_separation_agrees_with_its_twin():
    rng = np.random.default_rng(2)
    for _ in range(500):
        start, change = rng.uniform(-np.pi, np.pi, (2, 4))
        arm = np.empty((5, 7))
        share = rng.random()
        air_hockey._pose(start, change, share, arm)
        joints, links = naive.arm((start + change * share).tolist())
        assert_allclose(arm[:, :2], joints, atol=1e-12)
        x, y = rng.uniform(-1, 1, 2)
        gaps = [air_hockey._separation(arm[body], body == 4, x, y) for body in range(5)]
        assert_allclose(
            [g[0] for g in gaps[:4] if g[0] > -0.05], [d for d in naive.gaps(links, (x, y)) if d > -0.05], atol=1e-12
        )
        assert_allclose(gaps[4][0], math.dist(joints[4], (x, y)) - 0.0635)
        assert_allclose(air_hockey._gap(arm, x, y), min(g[0] for g in gaps))
        for _, nx, ny in gaps:
            assert_allclose(nx * nx + ny * ny, 1)


def test_no_point_of_the_arm_moves_further_than_the_bound():
    rng = np.random.default_rng(3)
    for _ in range(200):
        start, change = rng.uniform(-np.pi, np.pi, (2, 4))
        before, after = np.empty((5, 7)), np.empty((5, 7))
        a, b = np.sort(rng.random(2))
        air_hockey._pose(start, change, a, before)
        air_hockey._pose(start, change, b, after)
        reach = air_hockey._bound(change) * (b - a)
        assert np.linalg.norm(after[:, :2] - before[:, :2], axis=1).max() <= reach + 1e-12
        corner = np.array([[air_hockey.LINK], [air_hockey.HALF_WIDTH]])
        for one, other in zip(before[:4], after[:4], strict=True):
            points = [line[:2, None] + np.array([[line[2], -line[3]], [line[3], line[2]]]) @ corner for line in (one, other)]
            assert np.linalg.norm(points[1] - points[0]) <= reach + 1e-12


def test_velocity_of_the_arm_is_the_derivative_of_its_place():
    rng = np.random.default_rng(4)
    start, change = rng.uniform(-np.pi, np.pi, (2, 4))
    arms = [np.empty((5, 7)) for _ in range(3)]
    for arm, share in zip(arms, (0.3 - 1e-6, 0.3, 0.3 + 1e-6), strict=True):
        air_hockey._pose(start, change, share, arm)
    assert_allclose(arms[1][:, 4:6], (arms[2][:, :2] - arms[0][:, :2]) / 2e-6, atol=1e-6)


def test_a_puck_placed_onto_the_arm_is_pushed_out():
    """Search for arms that lie where the puck is placed."""
    genotypes = np.random.default_rng(5).random((20_000, 8))
    genotypes[:, 4:] = 0.5 + (1 - math.exp(-1.5)) * (genotypes[:, :4] - 0.5)  # which then stay there
    start, change = air_hockey.movement(genotypes)
    assert_allclose(change, 0, atol=1e-12)
    observation = auroraqd.tasks.AirHockey()(genotypes).observation
    on_it = moved(observation)
    assert 50 < on_it.sum() < 10_000
    arm = np.empty((5, 7))
    for i in np.flatnonzero(on_it)[:300]:
        air_hockey._pose(start[i], change[i], 0.0, arm)
        assert air_hockey._gap(arm, *observation[i, -1]) >= -1e-4
        assert_allclose(observation[i], np.broadcast_to(observation[i, -1], (50, 2)), atol=2e-3)  # and stays there
        assert np.linalg.norm(observation[i, -1] - START) < 0.13


@pytest.mark.parametrize(
    ("genotypes", "message"),
    [
        (np.zeros((3, 7)), r"genotypes must have shape \(n, 8\), got \(3, 7\)"),
        (np.zeros(8), r"genotypes must have shape \(n, 8\)"),
        ("hard", r"genotypes must be numbers of shape \(n, 8\), got 'hard'"),
        ([[1], [1, 2]], r"genotypes must be numbers of shape \(n, 8\), got \[\[1\], \[1, 2\]\]"),
        (np.full((1, 8), 1.1), r"genotypes must be in \[0, 1\]"),
        (np.full((1, 8), np.nan), r"genotypes must be in \[0, 1\]"),
    ],
)
def test_bad_genotypes(genotypes, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.tasks.AirHockey()(genotypes)


def test_bad_threshold():
    with pytest.raises(ValueError, match="restitution_threshold must be a finite number, 0 or more, got -1"):
        auroraqd.tasks.AirHockey(restitution_threshold=-1)
    with pytest.raises(ValueError, match="pucks must be a whole number, from 1 to 3, got 4"):
        auroraqd.tasks.AirHockey(pucks=4)


def ways(genotypes, pucks, threshold=0.0):
    """Those of several pucks, (n, 50, pucks, 2)."""
    observation = auroraqd.tasks.AirHockey(threshold, pucks=pucks)(genotypes).observation
    assert tuple(observation) == air_hockey.NAMES[:pucks]
    return np.stack([*observation.values()], axis=2)


def test_more_pucks():
    task = auroraqd.tasks.AirHockey(pucks=2)
    genotypes = np.random.default_rng(0).random((3000, 8))
    _, observation, truth = task(genotypes)
    assert_array_equal(truth, np.hstack([observation["first"][:, -1], observation["second"][:, -1]]))
    assert task.bounds().shape == (2, 100, 2)
    assert repr(task) == "AirHockey(restitution_threshold=0.0, pucks=2)"
    assert repr(auroraqd.tasks.AirHockey()) == "AirHockey(restitution_threshold=0.0)"
    one, second = auroraqd.tasks.AirHockey()(genotypes).observation, observation["second"]
    untouched = np.abs(second - air_hockey.PLACES[1]).max(axis=(1, 2)) == 0
    near = np.linalg.norm(one - np.array(air_hockey.PLACES[1]), axis=2).min(axis=1) < 0.3
    assert_allclose(observation["first"][untouched & ~near], one[untouched & ~near], atol=1e-6)  # as if it were alone
    hit = ~untouched & ~moved(auroraqd.tasks.AirHockey()(genotypes).observation)
    assert hit.sum() > 100
    three = auroraqd.tasks.AirHockey(pucks=3)(genotypes)
    assert_array_equal(three.ground_truth[:, 4:], three.observation["third"][:, -1])
    alone = (three.observation["third"] == air_hockey.PLACES[2]).all(axis=(1, 2))
    close = np.linalg.norm(observation["first"] - np.array(air_hockey.PLACES[2]), axis=2).min(axis=1) < 0.3
    close |= np.linalg.norm(observation["second"] - np.array(air_hockey.PLACES[2]), axis=2).min(axis=1) < 0.3
    for name in ("first", "second"):  # as if the third were not there
        same = alone & ~close
        assert np.median(np.abs(three.observation[name][same] - observation[name][same]).max(axis=(1, 2))) < 1e-6
    assert len(auroraqd.Aurora(8, "hand-coded", seed=0).run(task, generations=2).archive) > 50


@pytest.mark.parametrize("number", [2, 3])
@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_pucks_neither_overlap_nor_leave(threshold, number):
    rng = np.random.default_rng(1)
    genotypes = np.concatenate([rng.random((20_000, 8)), rng.integers(0, 3, (10_000, 8)) / 2])
    pucks = ways(genotypes, number, threshold)
    assert np.abs(pucks).max() <= LIMIT + 1e-12
    pairs = [pucks[:, :, a] - pucks[:, :, b] for a, b in itertools.combinations(range(number), 2)]
    apart = np.linalg.norm(pairs, axis=3).min(axis=2) - 2 * air_hockey.PUCK
    assert (apart < -1e-3).mean() < 0.01  # between arm and walls there may be no room for two
    assert (apart < -1e-9).mean() < 0.05


@given(arrays(float, (2, 3), elements=finite), st.floats(0, 2 * math.pi), st.sampled_from([0.0, 1.0]))
def test_strike_agrees_with_its_twin(moving, angle, threshold):
    normal = (math.cos(angle), math.sin(angle))
    pucks = np.hstack([np.zeros((2, 2)), moving])
    before = pucks.copy()
    air_hockey.strike(pucks[0], pucks[1], *normal, threshold)
    assert_allclose(pucks[:, 2:].ravel(), naive.strike(*moving, normal, threshold), atol=1e-9)
    assert_allclose(pucks[:, 2:4].sum(axis=0), before[:, 2:4].sum(axis=0), atol=1e-9)


@pytest.mark.parametrize("number", [2, 3])
def test_pucks_meet_when_a_plain_loop_says(number):
    """No arm in the way: it lies where it began, and the pucks are sent against each other and the walls."""
    rng = np.random.default_rng(2)
    start, still = np.array([0.0, 0.0, math.pi, 0.0]), np.zeros(4)  # folded, along the x axis
    hits = 0
    for _ in range(12):
        a, b = np.array([-0.5, 0.6]), np.array([0.4, 0.7]) + rng.uniform(-0.1, 0.1, 2)
        way = b - a + rng.uniform(-0.08, 0.08, 2)
        pucks = np.zeros((number, 6))
        pucks[0, :5], pucks[1, :5] = [*a, *way, rng.normal()], [*b, *-0.3 * way, rng.normal()]
        if number == 3:  # in the way of what comes back
            pucks[2, :2] = a + 0.25 * way
        expected = naive.pucks_alone(pucks[:, :5], 0.9)
        straight, time = pucks[:, 2:4].copy(), 0.0
        while time < 0.9:
            time = air_hockey._advance(start, still, 0.0, time, 0.9, 0.0, np.empty((5, 7)), pucks)
        assert_allclose(pucks[:, :2], [puck[:2] for puck in expected], atol=3e-3)
        hits += (np.abs(pucks[:, 2:4] - straight) > 1e-9).any()
    assert hits > 8


@pytest.mark.parametrize("number", [2, 3])
def test_pucks_agree_with_an_engine(number):
    genotypes = np.random.default_rng(3).random((400 if number == 2 else 2000, 8))
    ours = ways(genotypes, number, 1.0)
    begin = np.array(air_hockey.PLACES[:number])
    hit = (np.abs(ours - begin).max(axis=(1, 3)) > 1e-3).all(axis=1)
    ours = ours[hit][:30]
    movements = (values[hit][:30] for values in air_hockey.movement(genotypes))
    theirs = np.array([box2d.engine(*each, 1.0, pucks=number) for each in zip(*movements, strict=True)])
    first = (np.abs(ours - begin).max(axis=(2, 3)) > 1e-3).argmax(axis=1)
    apart = np.linalg.norm(ours - theirs, axis=3)
    soon = apart[np.arange(len(apart)), np.minimum(first + box2d.SOON, air_hockey.STEPS - 1)]
    assert np.median(soon) <= 0.02
    assert np.median(apart[:, -1]) <= 0.1
