"""What is specific to descriptors; how Aurora uses them is tested with Aurora."""

import threading

import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA, KernelPCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from auroraqd.descriptors._affine import Affine
from auroraqd.descriptors.descriptor import Descriptor, DescriptorError
from auroraqd.individuals import Columns
from auroraqd.observations import joined


@pytest.mark.parametrize(("n", "features", "d"), [(1, 1, 1), (5, 7, 2), (20, 100, 3), (4, 33, 10)])
@pytest.mark.parametrize("dtype", [float, np.float32, np.uint8])
def test_affine_descriptors_agree_with_their_twin(n, features, d, dtype):
    rng = np.random.default_rng(n)
    observation = (100 * rng.random((n, features))).astype(dtype)
    shapes = ((d, features), d, (d, features), features)
    limit = rng.choice([1.0, 20.0, np.inf], features)
    scaling = rng.normal(size=features), rng.normal(size=features), limit
    affine = Affine(*scaling, *(rng.normal(size=shape) for shape in shapes))
    z, error = naive.affine(observation.tolist(), *(part.tolist() for part in affine))
    assert_allclose(affine.describe(observation)[0], z, rtol=1e-9, atol=1e-9)
    assert_allclose(affine.describe(observation)[1], error, rtol=1e-9)


def test_affine_descriptors_of_an_observation_are_the_same_in_any_batch():
    observation = np.random.default_rng(0).normal(size=(1000, 11, 3))
    descriptor = Descriptor(PCA(n_components=2)).refitted(observation)
    together = descriptor.describe(Columns({"observation": observation}))
    observation.flags.writeable = False  # as a column of an archive
    for rows in (slice(0, 1), slice(3, 8), slice(500, 1000)):
        apart = descriptor.describe(Columns({"observation": observation[rows]}))
        for one, all_of in zip(apart, together, strict=True):
            assert_array_equal(one, all_of[rows])


def test_error_is_that_of_the_reconstruction():
    rng = np.random.default_rng(0)
    observation = rng.normal(size=(40, 6, 2)) * [1, 1000]
    descriptor = Descriptor(PCA(n_components=2)).refitted(observation)
    _, error = descriptor.describe(Columns({"observation": observation}))
    scaled, back = (
        descriptor.scaler(o) for o in (observation, descriptor.reconstruct(descriptor.describe_observation(observation)))
    )
    assert_allclose(error, np.sqrt(((scaled - back) ** 2).mean(axis=1)), rtol=1e-9)


def test_large_observations_are_not_folded():
    """A matrix of all entries by all entries would fill the memory."""
    x = np.random.default_rng(0).random((30, 60, 60, 1))
    fitted = Descriptor(PCA(2, svd_solver="full")).refitted(x)
    values, error = fitted.describe(Columns({"observation": x}))
    scaled = 2 * (x - x.min()) / np.ptp(x) - 1
    pca = PCA(2, svd_solver="full").fit(scaled.reshape(30, -1))
    np.testing.assert_allclose(np.abs(values), np.abs(pca.transform(scaled.reshape(30, -1))), atol=1e-9)
    assert fitted.affine is None
    assert error.shape == (30,)


def test_many_components_are_not_folded():
    x = np.random.default_rng(0).random((60, 25, 2))
    assert Descriptor(PCA(32, svd_solver="full")).refitted(x).affine is not None
    assert Descriptor(PCA(33, svd_solver="full")).refitted(x).affine is None


def test_objects_are_checked_for_nans():
    x = np.random.default_rng(0).random((20, 4))
    descriptor = Descriptor(PCA(2)).refitted(x)
    bad = x[:2].astype(object)
    assert_array_equal(descriptor.describe_observation(bad), descriptor.describe_observation(x[:2]))
    bad[0, 0] = float("nan")
    with pytest.raises(ValueError, match="observation must be finite"):
        descriptor.describe_observation(bad)


class Locked:
    """A transformer that cannot be copied once it is fitted."""

    def fit(self, x):
        self.mean, self.lock = x.mean(axis=0), threading.Lock()
        return self

    def transform(self, x):
        return (x - self.mean)[:, :2]


def test_a_transformer_that_cannot_be_copied_is_fitted_once():
    x = np.random.default_rng(0).random((20, 4))
    fitted = Descriptor(Locked()).refitted(x)
    assert fitted.describe_observation(x).shape == (20, 2)
    with pytest.raises(DescriptorError, match="Locked could not be copied to be fitted anew"):
        fitted.refitted(x)


@pytest.mark.parametrize("of_streams", [False, True])
@pytest.mark.parametrize(
    "transformer", [PCA(n_components=2), make_pipeline(StandardScaler(), PCA(n_components=2)), KernelPCA(n_components=2)]
)
def test_many_entries_are_scaled_in_parts_in_float32(transformer, of_streams, monkeypatch):
    """As in float64, but for rounding; what was observed, and the transformer that was given, stay as they were."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(40, 2)) @ rng.normal(size=(2, 30)) + 0.01 * rng.normal(size=(40, 30))
    observation = joined({"a": x[:, :20], "b": x[:, 20:]}) if of_streams else x.reshape(40, 10, 3)
    before = observation.copy()
    wanted = Descriptor(transformer).refitted(observation)
    monkeypatch.setattr("auroraqd.descriptors.descriptor._MOST_IN_FULL", 1000)
    monkeypatch.setattr("auroraqd.descriptors.descriptor._MOST_SCALED", 100)
    found = Descriptor(transformer).refitted(observation)
    z, others = wanted.describe_observation(observation), found.describe_observation(observation)
    assert_allclose(others * np.sign(np.einsum("ij,ij->j", z, others)), z, atol=1e-4 * np.abs(z).max())
    assert np.abs(others - z).max() > 0  # it was done in another way
    assert_array_equal(observation, before)
    of = found.source[-1] if hasattr(found.source, "steps") else found.source
    assert getattr(of, "copy", True)


def test_another_solver_is_not_tried_where_the_first_may_have_written(monkeypatch):
    def fails(self, x, y=None):
        raise np.linalg.LinAlgError("no convergence")

    monkeypatch.setattr(PCA, "fit", fails)
    monkeypatch.setattr("auroraqd.descriptors.descriptor._MOST_IN_FULL", 10)
    with pytest.raises(DescriptorError, match=r"PCA could not be fitted .*: no convergence"):
        Descriptor(PCA(n_components=2)).refitted(np.random.default_rng(0).normal(size=(9, 4)))
