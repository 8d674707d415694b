import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose

from auroraqd.metrics import diversity, klc, outside, reached, reconstruction_error


def test_agrees_with_its_twin():
    rng = np.random.default_rng(0)
    reference, compared = rng.normal(size=(3000, 2)), rng.normal(size=(2000, 2)) * 1.3 + 0.2
    assert_allclose(klc(reference, compared), naive.klc(reference.tolist(), compared.tolist()))
    assert klc(reference, compared) > 0


def test_values_by_hand():
    """Half of the reference in a bin that holds a quarter of the compared: 0.5 log 2 + 0.5 log (2/3)."""
    reference = np.array([[0.0, 0.0], [1.0, 1.0]])
    compared = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    assert_allclose(klc(reference, compared, bins=2), 0.5 * np.log(2) + 0.5 * np.log(2 / 3))
    assert klc(reference, reference) == 0
    assert_allclose(klc(reference, reference[:1], bins=2), 0.5 * np.log(0.5) + 0.5 * np.log(0.5 / 1e-8))  # an empty bin


def test_outside():
    reference = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert outside(reference, np.array([[0.5, 0.5], [2.0, 0.5], [0.5, -1.0], [1.0, 0.0]])) == 0.5


@pytest.mark.parametrize("d", [1, 2, 10])
def test_reached_agrees_with_its_twin(d):
    rng = np.random.default_rng(d)
    reference, compared = rng.normal(size=(300, d)), rng.normal(size=(200, d)) * 1.3 + 0.2
    assert reached(reference, compared) == naive.reached(reference.tolist(), compared.tolist(), 10)
    assert reached(reference, reference) == reached(reference, np.vstack([compared, reference])) == 1


def test_reached_by_hand():
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    assert reached(corners, [[0.4, 0.4], [0.9, 0.1]], bins=2) == 1 / 3  # the other is where the reference has none
    assert reached(corners, [[0.0, 1.1], [-0.1, 0.0]], bins=2) == 0  # outside
    assert reached([[5.0, 5.0]], [[5.0, 5.0]]) == 1  # no width
    assert reached([[5.0, 5.0]], [[5.0, 6.0]]) == 0
    assert reached([[-1e308], [1e308]], [[0.0], [1e308]], bins=2) == 0.5
    with pytest.raises(ValueError, match="same columns"):
        reached(corners, [[0.0]])


@pytest.mark.parametrize(
    "bad", [np.zeros(3), np.zeros((0, 2)), np.full((3, 2), np.nan), np.zeros((3, 3)), "x", [[1], [1, 2]], {}]
)
def test_bad_arguments(bad):
    with pytest.raises(ValueError, match="must"):
        klc(np.random.default_rng(0).random((5, 2)), bad)


def test_marginal_is_the_sum_over_dimensions():
    rng = np.random.default_rng(0)
    reference, compared = rng.normal(size=(500, 3)), rng.normal(size=(400, 3)) + 0.3
    parts = [naive.klc(reference[:, i : i + 1].tolist(), compared[:, i : i + 1].tolist()) for i in range(3)]
    assert_allclose(klc(reference, compared, marginal=True), sum(parts))
    assert_allclose(klc(reference[:, :1], compared[:, :1]), klc(reference[:, :1], compared[:, :1], marginal=True))


def test_the_joint_one_sees_what_the_marginal_ones_cannot():
    x = np.linspace(0, 1, 100)
    one, other = np.column_stack([x, x]), np.column_stack([x, x[::-1]])
    assert klc(one, other, marginal=True) == 0
    assert klc(one, other) > 1


def test_joint_histograms_have_a_limit():
    points = np.random.default_rng(0).random((10, 8))
    with pytest.raises(ValueError, match="30 bins in each of 8 dimensions is too large: use marginal=True"):
        klc(points, points)
    assert klc(points, points, marginal=True) == 0


def test_reconstruction_error():
    observation = np.zeros((2, 3, 2))
    reconstruction = np.stack([np.full((3, 2), 2.0), [[3, 0], [0, 0], [0, 3]]])
    assert_allclose(reconstruction_error(observation, reconstruction), [2, np.sqrt(3)])
    with pytest.raises(ValueError, match="one shape"):
        reconstruction_error(observation, reconstruction[:1])
    with pytest.raises(ValueError, match="one shape"):
        reconstruction_error(np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("bins", [1, 10, 20])
def test_diversity_agrees_with_its_twin(bins):
    rng = np.random.default_rng(0)
    paths = np.cumsum(rng.normal(0, 0.1, (200, 30, 2)), axis=1)  # some leave the room
    paths[:5] = np.round(paths[:5], 1)  # on the borders of squares
    assert_allclose(diversity(paths, bins), naive.diversity(paths.tolist(), bins))


def test_diversity_by_hand():
    """Two end squares: three of 100 are passed on the way to one, one to the other."""
    paths = [[[-0.95, -0.95], [-0.75, -0.95], [-0.55, -0.95]], [[-0.55, -0.95]] * 3, [[0.95, 0.95]] * 3]
    assert diversity(np.array(paths)) == 0.04
    assert diversity(np.zeros((0, 3, 2))) == 0
    everywhere = np.stack(np.meshgrid(*[np.linspace(-0.9, 0.9, 10)] * 2), axis=2).reshape(1, 100, 2)
    assert diversity(np.concatenate([np.roll(everywhere, k, axis=1) for k in range(100)])) == 100


@pytest.mark.parametrize("bad", [np.zeros((3, 2)), np.zeros((3, 0, 2)), np.zeros((3, 4, 3)), np.full((1, 2, 2), np.nan)])
def test_diversity_of_something_else(bad):
    with pytest.raises(ValueError, match="trajectories must"):
        diversity(bad)
    with pytest.raises(ValueError, match="low must be below high"):
        diversity(np.zeros((1, 2, 2)), low=1, high=1)


@pytest.mark.parametrize("bad", ["x", [[1], [1, 2]], None, {}])
def test_what_is_no_array_of_numbers_is_said(bad):
    for call, name in (
        (lambda: klc(bad, np.zeros((3, 2))), "reference"),
        (lambda: outside(np.zeros((3, 2)), bad), "compared"),
        (lambda: diversity(bad), "trajectories"),
        (lambda: reconstruction_error(np.zeros((3, 2)), bad), "reconstruction"),
    ):
        with pytest.raises(ValueError, match=f"{name} must be numbers.*, got "):
            call()
    with pytest.raises(ValueError, match="low must be a finite number, a wall, got "):
        diversity(np.zeros((1, 2, 2)), low=bad)


def test_observations_without_entries_have_no_error():
    with pytest.raises(ValueError, match="observation and reconstruction must have one shape"):
        reconstruction_error(np.zeros((3, 0)), np.zeros((3, 0)))
