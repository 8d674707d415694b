"""Descriptors that learn from the fitness too."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA, FastICA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.neighbors import NeighborhoodComponentsAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import auroraqd
from auroraqd.descriptors import supervised
from auroraqd.descriptors.descriptor import Descriptor, DescriptorError

SUPERVISED = [
    PLSRegression(n_components=2),
    LinearDiscriminantAnalysis(n_components=2),
    NeighborhoodComponentsAnalysis(n_components=2, max_iter=20),
    make_pipeline(StandardScaler(), PCA(4), LinearDiscriminantAnalysis(n_components=2)),
]
UNSUPERVISED = [PCA(2), FastICA(2), make_pipeline(StandardScaler(), PCA(2)), StandardScaler()]


def named(transformer):
    return "pipeline" if hasattr(transformer, "steps") else type(transformer).__name__


def task(genotypes):
    """Two of the six that are observed have to do with the fitness, and these vary least."""
    fitness = np.where(genotypes[:, 3] < 0.1, np.nan, genotypes[:, 0] + genotypes[:, 1] ** 2)
    rest = np.stack([np.sin(9 * genotypes[:, 2]), np.cos(7 * genotypes[:, 3])], axis=1)
    return fitness, np.hstack([0.1 * genotypes[:, :2], rest, rest**3])


def made(descriptor, **options):
    options = {"batch_size": 40, "schedule": auroraqd.Every(3)} | options
    return auroraqd.Aurora(4, descriptor, seed=0, **options)


@pytest.mark.parametrize("transformer", SUPERVISED, ids=named)
def test_end_to_end_and_after_a_crash(transformer, tmp_path):
    whole = made(transformer).run(task, generations=8)
    assert len(whole.archive) > 20
    assert whole.archive.descriptor.shape[1] == 2
    assert whole.history.last.refused == 0
    auroraqd.save(made(transformer).run(task, generations=5), tmp_path)
    again = auroraqd.resume(tmp_path).run(task, generations=3)
    assert_array_equal(again.archive.genotype, whole.archive.genotype)
    assert_array_equal(again.archive.descriptor, whole.archive.descriptor)
    repertoire = auroraqd.load(tmp_path)
    np.testing.assert_allclose(repertoire.describe(repertoire.observation), repertoire.descriptor)


@pytest.mark.parametrize("transformer", [*SUPERVISED, *UNSUPERVISED], ids=named)
def test_which_are_supervised(transformer):
    assert supervised.is_supervised(transformer) == (transformer in SUPERVISED)


def test_the_fitness_shapes_the_descriptor():
    """What has to do with the fitness is seen by PLS, and not by PCA."""
    rng = np.random.default_rng(0)
    observation = rng.normal(size=(300, 6))
    fitness = observation[:, 5] * 0.1
    observation[:, 5] *= 0.5
    seen = {}
    for transformer in (PCA(1), PLSRegression(n_components=1)):
        values = (
            Descriptor(transformer).refitted(observation[:, :, None], fitness).describe_observation(observation[:, :, None])
        )
        seen[type(transformer)] = abs(np.corrcoef(values[:, 0], fitness)[0, 1])
    assert seen[PCA] < 0.5 < 0.95 < seen[PLSRegression]


class Spy:
    """Of one's own, with a `y`."""

    seen = []

    def fit(self, x, y):
        Spy.seen.append((x.copy(), y.copy()))
        return self

    def transform(self, x):
        return x[:, :2]


class Indifferent(Spy):
    def fit(self, x, y=None):
        assert y is None
        return self


@pytest.mark.filterwarnings("ignore:.* far outside")
@pytest.mark.parametrize("robust", [True, False])
def test_a_transformer_of_ones_own_gets_the_fitness_of_what_it_is_fitted_on(robust):
    """NaN is not among it, nor are observations far outside."""

    def wild(genotypes):
        fitness, observation = task(genotypes)
        if not Spy.seen:
            fitness[3], observation[3] = 7, 1e6
        return fitness, observation

    Spy.seen = []
    aurora = made(Spy(), robust=robust, survival=0, batch_size=150).run(wild, generations=7)
    assert len(Spy.seen) == 3
    for x, y in Spy.seen:
        assert np.isfinite(y).all()
        assert len(x) == len(y)
        assert (7 in y) != robust
    aurora.run(lambda genotypes: (np.full(150, np.nan), task(genotypes)[1]), generations=3)
    assert np.isfinite(Spy.seen[-1][1]).all()


def test_a_y_that_may_be_none_stays_so():
    assert made(Indifferent()).run(task, generations=4).history.last.refused == 0


@pytest.mark.parametrize("transformer", SUPERVISED, ids=named)
def test_a_constant_fitness_is_refused(transformer):
    observation = np.random.default_rng(0).random((30, 6))
    with pytest.raises(DescriptorError, match=r"fitness must have \d different values at least to learn from, got 1 of 30"):
        Descriptor(transformer).refitted(observation, np.ones(30))
    aurora = made(transformer)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(DescriptorError, match="is the same for all"):
            aurora.run(lambda genotypes: (np.ones(40), task(genotypes)[1]), generations=12)


def test_a_prior_has_no_fitness():
    with pytest.raises(DescriptorError, match="it learns from the fitness too, which is not known of a prior"):
        made(LinearDiscriminantAnalysis(), prior=np.random.default_rng(0).random((30, 6)))


@given(st.lists(st.floats(-2, 2, width=16), min_size=2, max_size=60), st.integers(2, 12))
def test_quantiles(fitness, most):
    fitness = np.array(fitness)
    different = len(np.unique(fitness))
    if min(different, len(fitness) // 2) < 2:
        with pytest.raises(ValueError, match="fitness must"):
            supervised.quantiles(fitness, most, 2)
        return
    classes = supervised.quantiles(fitness, most, 2)
    count = min(most, different, len(fitness) // 2)
    assert set(classes.tolist()) == set(range(count))
    order = np.argsort(fitness)
    assert (np.diff(classes[order]) >= 0).all()
    assert (classes[:, None] == classes)[fitness[:, None] == fitness].all()
    if different == len(fitness):
        assert np.ptp(np.bincount(classes)) <= 1


def test_more_components_have_more_classes():
    aurora = made(LinearDiscriminantAnalysis(n_components=5), batch_size=60)
    aurora.run(lambda genotypes: (genotypes.sum(axis=1), np.hstack([genotypes, genotypes**2, genotypes**3])), generations=4)
    assert aurora.archive.descriptor.shape[1] == 5
    rng = np.random.default_rng(0)
    y = supervised.target(LinearDiscriminantAnalysis(n_components=14), rng.random(60))
    assert len(np.unique(y)) == 15
    with pytest.raises(ValueError, match="fitness must be that of 30 individuals at least, for 15 classes, got 20"):
        supervised.target(LinearDiscriminantAnalysis(n_components=14), rng.random(20))
