import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from auroraqd.tasks import Ballistic, ballistic


def parts(genotype):
    share = 0.1 + 0.8 * np.asarray(genotype)
    angle, force = share[0] * np.pi / 2, share[1] * 200
    return force * np.cos(angle), force * np.sin(angle)


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=20))
def test_agrees_with_its_twin(genotypes):
    _, observation, _ = Ballistic()(np.array(genotypes))
    for genotype, trajectory in zip(genotypes, observation, strict=True):
        assert_array_equal(trajectory, naive.throw(*parts(genotype)))


def test_kernel_agrees_with_its_twin_on_nasty_forces():
    forces = np.array([[0.0, 0.0], [5.0, 9.81], [-3.0, 100.0], [0.0, 1e6], [1e300, 1e300], [1.0, -50.0]])
    out = np.empty((len(forces), 50, 2))
    ballistic._fly(forces[:, 0].copy(), forces[:, 1].copy(), out)
    for force, trajectory in zip(forces, out, strict=True):
        assert_array_equal(trajectory, naive.throw(*force))


@pytest.mark.parametrize("n", [1, 15, 16, 17, 100])
def test_any_number_can_fly_side_by_side(n):
    along, up = np.random.default_rng(n).uniform(0, 200, (2, n))
    trajectories, top = np.empty((n, 50, 2)), ballistic._top(along, up)
    ballistic._fly(along, up, trajectories)
    for i in range(n):
        assert_array_equal(trajectories[i], naive.throw(along[i], up[i]))
        assert_allclose((top[i] + 1) / 2 * 2000, naive.top(along[i], up[i]), rtol=1e-12, atol=1e-9)


def test_shapes_and_validity():
    genotypes = np.array([[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]])
    fitness, observation, truth = Ballistic()(genotypes)
    assert observation.shape == (3, 50, 2)
    assert truth.shape == (3, 2)
    assert_array_equal(np.isnan(fitness), [True, False, False])  # 20 N at 9 degrees cannot lift 1 kg by 2 m/s^2
    assert_array_equal(observation[:, 0], 0)
    assert (observation[..., 1] >= 0).all()


def test_ground_truth_is_the_top_of_the_first_arc():
    """The highest sampled point is above it, by at most g / 8, and less than a second's flight aside."""
    genotypes = np.random.default_rng(0).random((500, 2))
    fitness, observation, truth = Ballistic()(genotypes)
    valid = np.isfinite(fitness)
    top = (truth[valid] + 1) / 2 * 2000
    observation = observation[valid]
    rising = np.diff(observation[..., 1], axis=1) > 0
    peak = np.argmin(rising, axis=1)
    sampled = observation[np.arange(len(observation)), peak]
    above = sampled[:, 1] - top[:, 1]
    assert above.min() >= -1e-9
    assert above.max() <= 9.81 / 8 + 1e-9
    assert (np.abs(sampled[:, 0] - top[:, 0]) <= observation[:, 1, 0] / 2 + 1e-9).all()


def test_a_bounce_keeps_sixty_percent():
    trajectory = Ballistic()(np.array([[0.5, 0.5]]))[1][0]
    speed = np.diff(trajectory[:, 1])
    touch = np.flatnonzero(trajectory[1:, 1] == 0)[0] + 1
    assert_allclose(speed[touch], 0.6 * -(speed[touch - 2] - 9.81), rtol=1e-9)
    assert_allclose(np.diff(trajectory[:, 0]), trajectory[1, 0], rtol=1e-9)  # horizontal speed is kept


@pytest.mark.parametrize(
    "genotypes", [np.zeros(2), np.zeros((3, 3)), np.array([[0.5, 1.1]]), np.array([[np.nan, 0.5]]), "x", None]
)
def test_bad_genotypes(genotypes):
    with pytest.raises(ValueError, match="genotypes must"):
        Ballistic()(genotypes)
