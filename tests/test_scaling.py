import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from auroraqd.descriptors.scaling import Scaling, far_outside, outlying

observations = arrays(float, st.tuples(st.integers(1, 6), st.integers(1, 4), st.integers(1, 3)), elements=st.floats(-1e6, 1e6))


@given(observations)
def test_each_channel_fills_its_range_and_comes_back(observation):
    scaler = Scaling.of(observation).scaler(observation[0].size)
    x = scaler(observation)
    assert x.shape == (len(observation), observation[0].size)
    assert np.abs(x).max() <= 1 + 1e-9
    span = np.ptp(observation.reshape(-1, observation.shape[-1]), axis=0)
    channels = x.reshape(-1, observation.shape[-1])
    for low, high, wide in zip(channels.min(axis=0), channels.max(axis=0), span > 1e-3, strict=True):
        if wide:
            assert_allclose([low, high], [-1, 1], atol=1e-6)
    assert_allclose(scaler.inverse(x).reshape(observation.shape), observation, rtol=1e-9, atol=1e-6)


@given(
    arrays(float, st.tuples(st.integers(1, 6), st.integers(1, 4), st.integers(1, 3)), elements=st.integers(-5, 5).map(float)),
    st.lists(st.sampled_from([-1e300, -1e5, -3.0, 0.0, 9e3, 1e4 + 1, 1e12]), min_size=1, max_size=9),
)
def test_nothing_lies_farther_out_than_the_limit(observation, entries):
    scaler = Scaling.of(observation).scaler(observation[0].size)
    given = np.resize(entries, (2, observation[0].size))
    varied = np.ptp(observation.reshape(-1, observation.shape[-1]), axis=0) > 0
    varied = np.tile(varied, given.shape[1] // observation.shape[-1])
    wanted = (given - scaler.center) / scaler.half
    limited = np.where(varied, np.clip(wanted, -1e4, 1e4), wanted)
    assert_allclose(scaler(given), limited, rtol=1e-9, atol=1e-9)
    assert_allclose((scaler.within(given) - scaler.center) / scaler.half, limited, rtol=1e-6, atol=1e-6)
    unlimited = Scaling.of(observation).unlimited().scaler(observation[0].size)
    assert_allclose(unlimited(given), wanted, rtol=1e-9, atol=1e-9)
    assert unlimited.within(given) is given


def test_no_rows():
    scaler = Scaling.of(np.ones((2, 3, 2))).scaler(6)
    assert scaler(np.empty((0, 3, 2))).shape == (0, 6)


@given(st.integers(0, 2**32 - 1), st.integers(1, 150), st.integers(3, 9), st.integers(0, 3), st.floats(0.1, 1e9))
def test_what_is_far_outside_agrees_with_its_twin(seed, n, entries, outliers, size):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, entries, 2)) * rng.choice([0, 1], size=(n, 1, 1), p=[0.3, 0.7])
    x[rng.integers(n, size=outliers), 2, 1] += size
    assert_array_equal(far_outside(x), naive.far_outside(x.tolist()))


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([0.0, 0.05, 0.3, 0.8]), st.sampled_from([30.0, 1e5]))
def test_what_dwarfs_the_others_agrees_with_its_twin(seed, n, share, size):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4, 1)) * rng.choice([0, 1], size=(n, 1, 1), p=[0.3, 0.7])
    x[rng.random(n) < share, 2] *= size
    low, high = x.min(axis=(1, 2)), x.max(axis=(1, 2))
    middle = np.median((low + high) / 2)
    distance = np.maximum(high - middle, middle - low)
    typical = sorted(distance)[int(0.75 * (n - 1))]
    wanted = [n >= 20 and typical > 0 and one > 10000 * typical for one in distance]
    assert outlying(x)[1].tolist() == wanted
    assert_array_equal(outlying(x)[0], far_outside(x))


def test_one_outlier_is_found_and_no_more():
    x = np.random.default_rng(0).random((12_000, 6, 2))
    assert not far_outside(x).any()
    x[77, 3, 1] = 1e6
    assert_array_equal(np.flatnonzero(far_outside(x)), [77])
    assert not far_outside(x[:, :, :1]).any()


@pytest.mark.parametrize("moved", [1, 3, 20])
def test_a_robot_that_mostly_stays_where_it_is_has_no_outliers(moved):
    x = np.zeros((200, 10, 2))
    x[:moved] = np.random.default_rng(0).normal(size=(moved, 10, 2))
    assert not far_outside(x).any()


@pytest.mark.parametrize("x", [np.zeros((0, 3)), np.zeros((5, 2)), np.full((30, 2), 1.7e308), np.zeros((30, 3), bool)])
def test_of_few_or_equal_observations_none_is_far_outside(x):
    assert not far_outside(x).any()


def test_the_ends_of_float64():
    x = np.random.default_rng(0).random((100, 3))
    x[[4, 9], 1] = 1.7e308, -1.7e308
    assert_array_equal(np.flatnonzero(far_outside(x)), [])  # two of a hundred are no exception
    x[9, 1] = 0
    assert_array_equal(np.flatnonzero(far_outside(x)), [4])
