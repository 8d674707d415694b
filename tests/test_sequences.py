"""Auto-encoders of long time series, and distances between rhythms."""

import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.distance import pdist
from scipy.stats import spearmanr

import auroraqd
from auroraqd.descriptors import distances, layers
from auroraqd.descriptors.networks import Recurrent
from auroraqd.descriptors.scaling import Scaling

SMALL = Recurrent(units=16, updates=6, steps=400)
TIME = np.linspace(0, 4, 60)[:, None]


def gaits(n, seed=0, start=0.0):
    """Parameters, (n, 2), and angles, (n, 60, 3): amplitudes and frequencies."""
    genes = np.random.default_rng(seed).random((n, 2))
    amplitude, frequency = (0.2 + 0.8 * genes[:, :1, None]), 0.5 + 1.5 * genes[:, 1:, None]
    return genes, amplitude * np.sin(2 * np.pi * frequency * TIME + start + 0.4 * np.arange(3))


@pytest.fixture(scope="module")
def fitted():
    genes, x = gaits(300)
    return auroraqd.AutoEncoder(network=SMALL, repeats=2, random_state=0).fit(x), genes, x


def test_gated_units_agree_with_their_twin():
    rng = np.random.default_rng(0)
    layer = layers.Reader.random((7, 2), 3, 4, rng)  # the last of the steps is read three times
    x = rng.normal(size=(2, 7, 2)).astype(np.float32)
    found = np.asarray(layer(x.reshape(2, -1)))
    weights = [
        np.asarray(part).tolist() for part in (layer.cell.weight_ih, layer.cell.weight_hh, layer.cell.bias, layer.cell.bias_n)
    ]
    for row, sequence in zip(found, x, strict=True):
        given = np.concatenate([sequence, sequence[-1:], sequence[-1:]]).reshape(3, 6)
        states = naive.gated(given.tolist(), [0.0] * 4, *weights)
        assert_allclose(row, [*states[-1], *np.mean(states, axis=0)], atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (5, 2), (25, 3), (26, 1), (61, 4)])
def test_sequences_of_any_length_go_through(shape):
    network = Recurrent(units=3).build(shape, 1, np.random.default_rng(0))
    x = np.ones((2, np.prod(shape)), np.float32)
    assert network.encode(x).shape == (2, 1)
    assert network.decode(network.encode(x)).shape == x.shape


def test_neighbours_in_latent_space_are_gaits_alike(fitted):
    encoder, genes, x = fitted
    true = pdist(genes)
    assert spearmanr(true, pdist(encoder.transform(x)))[0] > 0.6
    assert spearmanr(true, pdist(x.reshape(len(x), -1)))[0] < 0.4
    new_genes, new = gaits(100, seed=1)
    assert spearmanr(pdist(new_genes), pdist(encoder.transform(new)))[0] > 0.6


def test_sequences_are_described_alike_in_any_batch(fitted):
    encoder, _, x = fitted
    together = encoder.transform(x)
    for rows in (slice(0, 1), slice(63, 66), slice(100, 250)):
        assert_array_equal(encoder.transform(x[rows]), together[rows])


def test_rhythms_say_nothing_about_when_a_gait_began():
    x, later = gaits(50)[1], gaits(50, start=1.3)[1]
    scaling = Scaling.of(x)

    def far(function):
        one, other = function(x, scaling), function(later, scaling)
        return np.linalg.norm(one - other, axis=1).mean() / np.linalg.norm(one - one[::-1], axis=1).mean()

    assert far(distances.rhythms) < 0.4
    assert far(distances.flat) > 0.6


def test_rhythms_say_where_a_joint_is_and_which_swing_together():
    x = np.zeros((4, 60, 2))
    x[0] = 1.0
    x[1] = -1.0
    x[2] = np.sin(9 * TIME)
    x[3] = np.sin(9 * TIME) * [1, -1]
    found = distances.rhythms(x, Scaling.of(x))
    flat = distances.flat(x, Scaling.of(x))
    assert 0.5 < np.linalg.norm(found[0] - found[1]) / np.linalg.norm(flat[0] - flat[1]) < 2  # in the same unit
    assert np.linalg.norm(found[2] - found[3]) > 0.3 * np.linalg.norm(flat[2] - flat[3])
    assert distances.rhythms(x[:, :1, :1], Scaling.of(x[:, :1, :1])).shape[0] == 4


@pytest.mark.parametrize(
    ("network", "x", "message"),
    [
        ("recurrent", np.zeros((5, 8)), r"network 'recurrent' is for time series, .* got \(n, 8\)"),
        (Recurrent(units=0), np.zeros((5, 8, 2)), "units must be a whole number"),
        (Recurrent(updates=0), np.zeros((5, 8, 2)), "updates must be a whole number"),
        (Recurrent(steps=0), np.zeros((5, 8, 2)), "steps must be a whole number"),
        (Recurrent(error=-1.0), np.zeros((5, 8, 2)), "error must be a finite number"),
    ],
)
def test_bad_sequences_and_networks(network, x, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.AutoEncoder(network=network).fit(x)


def uneven(genotypes):
    """Sequences of different lengths."""
    return [np.tile(row, (3 + int(9 * row[0]), 1)) for row in genotypes]


def test_sequences_of_different_lengths_are_refused_in_a_sentence():
    genotypes = np.random.default_rng(0).random((20, 2))
    with pytest.raises(ValueError, match=r"x must be numbers of shape \(n, ...\), got \[array.*: its rows differ in shape"):
        auroraqd.AutoEncoder().fit(uneven(genotypes))
    aurora = auroraqd.Aurora(2, auroraqd.AutoEncoder(), seed=0, batch_size=20)
    with pytest.raises(auroraqd.TaskError, match="observation must be numbers with rows of one shape"):
        aurora.run(lambda genotypes: (np.zeros(len(genotypes)), uneven(genotypes)), generations=1)
    assert aurora.generation == 0
