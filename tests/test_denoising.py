"""Noise on what an encoder reads in training."""

import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import auroraqd
from auroraqd.descriptors import networks, training
from auroraqd.descriptors.networks import MLP, Fused, Image, Recurrent
from auroraqd.metrics import reconstruction_error

SHORT = {"repeats": 2, "min_steps": 60, "max_epochs": 6, "random_state": 0}


def robot(n, seed):
    """(n, 20, 15): what a robot of many joints senses, of ten parameters, with noise of its own."""
    ways = np.random.default_rng(0).normal(size=(10, 20, 15))
    rng = np.random.default_rng(seed)
    return np.tensordot(np.tanh(rng.normal(size=(n, 10))), ways, 1) + rng.normal(size=(n, 20, 15))


def test_what_two_numbers_cannot_tell_is_not_learned_by_heart():
    x, unseen = robot(150, 1), robot(1000, 2)

    def error(noise):
        encoder = auroraqd.AutoEncoder(2, noise=noise, repeats=2, min_steps=250, random_state=0).fit(x)
        return reconstruction_error(unseen, encoder.inverse_transform(encoder.transform(unseen))).mean()

    mean = reconstruction_error(unseen, np.broadcast_to(x.mean(axis=0), unseen.shape)).mean()
    plain, denoised = error(0), error(None)
    assert plain > 0.99 * mean  # as good as nothing
    assert denoised < 0.98 * mean


def test_by_default_there_is_some_where_the_network_is_chosen():
    x = robot(60, 1)
    chosen, named = (auroraqd.AutoEncoder(2, **options, **SHORT).fit(x) for options in ({}, {"network": "mlp"}))
    assert chosen.network_ == named.network_ == MLP()
    plain = auroraqd.AutoEncoder(2, noise=0, **SHORT).fit(x)
    noisy = auroraqd.AutoEncoder(2, network="mlp", noise=6, **SHORT).fit(x)
    assert_array_equal(named.transform(x), plain.transform(x))
    assert_array_equal(chosen.transform(x), noisy.transform(x))
    assert (chosen.transform(x) != plain.transform(x)).any()


def test_it_is_as_large_as_what_is_unexplained():
    x = np.zeros((4, 6), np.float32)
    data = training.Data(x, variance=np.array([8.0, 3.0]))  # of 2 and 4 entries
    kind = Fused((("a", (2,), MLP()), ("b", (4,), MLP())))
    protocol = auroraqd.AutoEncoder(noise=3.0)._protocol()
    np.testing.assert_allclose(training._noise(data, kind, protocol, 0.1), 0.3 * np.sqrt([4, 4, 0.75, 0.75, 0.75, 0.75]), 1e-6)
    assert_array_equal(training._noise(data, kind, protocol, 7.0), training._noise(data, kind, protocol, 1.0))
    assert training._noise(data, kind, protocol._replace(noise=0.0), 0.1) is None
    few, many = (training._noise(data._replace(x=np.zeros((n, 6), np.float32)), kind, protocol, 0.1) for n in (1000, 4000))
    assert_array_equal(few, training._noise(data, kind, protocol, 0.1))
    np.testing.assert_allclose(many, few / 2, 1e-6)
    assert training._unexplained(0.5, data) == pytest.approx(0.25 * 6 / 11)
    assert training._unexplained(0.5, data._replace(variance=0.0)) == 0


@pytest.mark.parametrize(
    ("network", "beta"),
    [
        (MLP((8,)), 0.01),
        (networks.Convolutional(), 0),
        (Image((4,), 8, steps=20), 0.01),
        (Recurrent(4, steps=20), 0),
    ],
)
def test_with_all_networks(network, beta):
    rng, shape = np.random.default_rng(0), (16, 16, 1) if isinstance(network, Image) else (20, 3)
    x = np.tensordot(rng.uniform(-1, 1, (40, 2)), rng.uniform(0, 2, (2, *shape)), 1)
    encoder = auroraqd.AutoEncoder(2, network=network, noise=1, beta=beta, **SHORT).fit(x)
    less = auroraqd.AutoEncoder(2, network=network, noise=0.5, beta=beta, **SHORT).fit(x)
    assert (encoder.transform(x) != less.transform(x)).any()
    again = auroraqd.AutoEncoder(2, network=network, noise=1, beta=beta, **SHORT).fit(x)
    assert_array_equal(encoder.transform(x), again.transform(x))
    assert np.isfinite(encoder.fit(x).transform(x)).all()


def test_observations_that_are_all_the_same():
    encoder = auroraqd.AutoEncoder(2, noise=6, **SHORT).fit(np.ones((10, 4)))
    assert encoder.training_rmse_ < 1e-2


@pytest.mark.parametrize("noise", [-1, math.nan, math.inf, "much"])
def test_bad_noise(noise):
    with pytest.raises((ValueError, TypeError), match="noise must be a finite number, 0 or more"):
        auroraqd.AutoEncoder(noise=noise).fit(np.zeros((4, 2)))


def test_an_auto_encoder_of_an_earlier_version_has_none():
    encoder = auroraqd.AutoEncoder(2, noise=0, **SHORT).fit(robot(60, 1))
    state = {name: value for name, value in encoder.__getstate__().items() if name != "noise"}
    earlier = auroraqd.AutoEncoder.__new__(auroraqd.AutoEncoder)
    earlier.__setstate__(state)
    assert earlier.noise == 0
    assert_array_equal(earlier.fit(robot(60, 2)).transform(robot(5, 3)), encoder.fit(robot(60, 2)).transform(robot(5, 3)))
