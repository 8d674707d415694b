"""Variational auto-encoders: distributions in latent space, and what keeps them from telling nothing."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.spatial.distance import cdist
from scipy.stats import norm

import auroraqd
from auroraqd.descriptors import training
from auroraqd.descriptors.networks import Image, Recurrent

SHORT = {"hidden": (16,), "max_epochs": 1, "repeats": 2, "min_steps": 200, "isometry": 0.0, "random_state": 0}


def plane(n=300, seed=0):
    """Rows, (n, 8), on a plane: two numbers are enough."""
    return np.random.default_rng(seed).uniform(-1, 1, (n, 2)) @ np.random.default_rng(1).normal(size=(2, 8))


@pytest.fixture(scope="module")
def fitted():
    return auroraqd.AutoEncoder(beta=0.05, **SHORT).fit(plane())


def test_the_divergence_is_that_of_the_integral():
    mean, deviation = np.array([[0.3, -2.0], [1.5, 0.7]]), np.array([[0.2, 1.7], [0.9, 0.4]])

    def nats(m, s):
        q = norm(m, s)
        return quad(lambda z: q.pdf(z) * (q.logpdf(z) - norm.logpdf(z)), m - 12 * s, m + 12 * s)[0]

    wanted = np.vectorize(nats)(mean, deviation)
    padded = [np.concatenate([part, np.full((1, 2), 5.0)]) for part in (mean, 2 * np.log(deviation))]
    found = training.divergence(*map(jnp.asarray, padded), jnp.asarray([True, True, False]))
    assert_allclose(found, wanted.mean(axis=0).sum(), rtol=1e-4)


def test_the_first_half_nat_of_a_dimension_is_free():
    nothing = jnp.zeros((3, 2))
    assert training.divergence(nothing, nothing, jnp.ones(3, bool)) == 2 * 0.5
    one = nothing.at[:, 0].set(3.0)  # 4.5 nats
    assert training.divergence(one, nothing, jnp.ones(3, bool)) == pytest.approx(4.5 + 0.5)


def test_latent_positions_are_about_those_of_a_unit_normal(fitted):
    x = plane()
    z = fitted.transform(x)
    assert_allclose(z.mean(axis=0), 0, atol=0.3)
    assert_allclose(z.std(axis=0), 1, atol=0.3)
    assert fitted.training_rmse_ < 0.2
    plain = auroraqd.AutoEncoder(**SHORT).fit(x).transform(x)
    assert abs(plain.std(axis=0) - 1).max() > 0.3  # nothing says how large they are to be


def test_what_is_drawn_from_a_unit_normal_decodes_to_something_like_the_rows(fitted):
    x = plane()
    drawn = fitted.inverse_transform(np.random.default_rng(0).normal(size=(100, 2)))
    assert np.median(cdist(drawn, x).min(axis=1)) < 0.25 * np.median(cdist(x, x))


def test_the_mean_is_the_descriptor(fitted):
    x = plane()
    assert_array_equal(fitted.transform(x), fitted.transform(x))
    assert_allclose(fitted.transform(x[:1]), fitted.transform(x)[:1], atol=1e-12)
    z, error = fitted.describe(x)
    assert_array_equal(z, fitted.transform(x))
    assert np.sqrt((error**2).mean()) == pytest.approx(fitted.training_rmse_)


def test_a_large_beta_does_not_press_the_latent_space_into_a_point(monkeypatch):
    """Without the half nat that is free it does: what is reconstructed is the mean of all rows."""
    x = plane()

    def error(beta):
        encoder = auroraqd.AutoEncoder(beta=beta, **{**SHORT, "hidden": (8,)}).fit(x)
        return encoder.training_rmse_ / encoder.scaling_.scaler(8)(x).std()

    assert error(100.0) < 0.8
    monkeypatch.setattr(training, "_FREE", 0.0)
    assert error(101.0) > 0.95


@pytest.mark.parametrize(
    ("network", "shape"),
    [("mlp", (8,)), (Recurrent(units=4, updates=4, steps=60), (4, 2)), (Image(steps=20), (16, 16, 1))],
    ids=["in memory", "in parts", "images"],
)
def test_runs_are_saved_and_go_on_bit_for_bit(network, shape, tmp_path):
    def robot(genotypes):
        return np.zeros(len(genotypes)), genotypes[:, np.arange(np.prod(shape)) % 2].reshape(-1, *shape)

    encoder = auroraqd.AutoEncoder(beta=0.01, network=network, hidden=(4,), repeats=1, min_steps=60)
    aurora = auroraqd.Aurora(2, encoder, seed=0, batch_size=30, schedule=auroraqd.Every(2)).run(robot, generations=3)
    repertoire = auroraqd.load(auroraqd.save(aurora, tmp_path))
    assert_array_equal(repertoire.describe(aurora.archive.observation), aurora.archive.descriptor)
    again = auroraqd.resume(tmp_path).run(robot, generations=2)
    aurora.run(robot, generations=2)
    assert aurora.descriptor.source.n_fits_ == 3
    assert_array_equal(again.archive.descriptor, aurora.archive.descriptor)


def test_another_beta_goes_on_with_the_weights_but_none_does_not(fitted):
    x = plane()
    encoder = auroraqd.AutoEncoder(beta=0.05, **SHORT).fit(x)
    assert_array_equal(encoder.transform(x), fitted.transform(x))
    assert encoder.set_params(beta=0.1).fit(x).n_fits_ == 2
    assert encoder.set_params(beta=0.0).fit(x).n_fits_ == 1


def test_bad_beta():
    with pytest.raises(ValueError, match="beta must be a finite number, 0 or more, got -1"):
        auroraqd.AutoEncoder(beta=-1).fit(plane())
