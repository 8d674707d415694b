"""What is specific to descriptors; how Aurora uses them is tested with Aurora."""

import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.decomposition import PCA

from auroraqd.descriptor import Descriptor, _affine_error


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
