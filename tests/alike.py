"""When two runs are the same."""

import numpy as np
from numpy.testing import assert_array_equal


def same(one, other):
    """What was found, how it went but for the times, and what is drawn next."""
    for name, column in one.archive.columns.items():
        assert_array_equal(column, other.archive.columns[name])
    for a, b in zip(one.history.records, other.history.records, strict=True):
        assert_array_equal(np.array(a[:-1], float), np.array(b[:-1], float))
    assert one._rng.bit_generator.state == other._rng.bit_generator.state
