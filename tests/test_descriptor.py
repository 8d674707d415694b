"""What is specific to descriptors; how Aurora uses them is tested with Aurora."""

import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.decomposition import PCA

from auroraqd.descriptor import Descriptor, _Affine, _affine_error


@pytest.mark.parametrize(("n", "features", "d"), [(1, 1, 1), (5, 7, 2), (20, 100, 3)])
def test_error_of_an_affine_reconstruction_agrees_with_its_twin(n, features, d):
    rng = np.random.default_rng(n)
    x, z, weight, offset = (rng.normal(size=shape) for shape in ((n, features), (n, d), (d, features), features))
    assert_allclose(_affine_error(x, z, weight, offset), naive.affine_error(x, z, weight, offset), rtol=1e-12)


def test_error_is_that_of_the_reconstruction():
    rng = np.random.default_rng(0)
    observation = rng.normal(size=(40, 6, 2)) * [1, 1000]
    descriptor = Descriptor(PCA(n_components=2)).refitted(observation)
    _, error = descriptor.describe(np.zeros((40, 1)), observation, None)
    scaled, back = (
        descriptor.scaler(o) for o in (observation, descriptor.reconstruct(descriptor.describe_observation(observation)))
    )
    assert_allclose(error, np.sqrt(((scaled - back) ** 2).mean(axis=1)), rtol=1e-9)


def test_large_observations_are_not_folded():
    """A matrix of all entries by all entries would fill the memory."""
    x = np.random.default_rng(0).random((30, 60, 60, 1))
    fitted = Descriptor(PCA(2, svd_solver="full")).refitted(x)
    values, error = fitted.describe(x, x, None)
    scaled = 2 * (x - x.min()) / np.ptp(x) - 1
    pca = PCA(2, svd_solver="full").fit(scaled.reshape(30, -1))
    np.testing.assert_allclose(np.abs(values), np.abs(pca.transform(scaled.reshape(30, -1))), atol=1e-9)
    assert not isinstance(fitted.encode, _Affine)
    assert error.shape == (30,)
