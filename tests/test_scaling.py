import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from auroraqd.scaling import Scaling

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


def test_no_rows():
    scaler = Scaling.of(np.ones((2, 3, 2))).scaler(6)
    assert scaler(np.empty((0, 3, 2))).shape == (0, 6)
