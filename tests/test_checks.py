"""What arguments must be."""

import numpy as np
import pytest

from auroraqd._checks import number, numbers, numeric, seeds_for, whole

BIG = [1, 2**63 + 5, 2**64 - 1]


@pytest.mark.parametrize(
    ("seeds", "wanted"),
    [
        (BIG, BIG),
        (tuple(BIG), BIG),
        (np.array(BIG, np.uint64), BIG),
        (iter(BIG), BIG),
        ([np.int64(1), 2**70, -3], [1, 2**70, -3]),
        (np.array([1, -2, 3], np.int8), [1, -2, 3]),
    ],
)
def test_seeds_are_whole_numbers_of_any_size(seeds, wanted):
    assert [int(seed) for seed in seeds_for("seeds", seeds, 3)] == wanted


def test_no_seeds():
    assert len(seeds_for("seeds", [], 0)) == 0


@pytest.mark.parametrize(
    ("seeds", "message"),
    [
        ([1, 2], r"seeds must have shape \(3,\), got shape \(2,\)"),
        (None, r"seeds must have shape \(3,\), got None"),
        (7, r"seeds must have shape \(3,\), got 7"),
        ([1, 2.5, 3], "seeds must be whole numbers, got float 2.5"),
        (np.ones(3), "seeds must be whole numbers, got float 1.0"),
        ([1, True, 3], "seeds must be whole numbers, got bool True"),
        ([1, None, 3], "seeds must be whole numbers, got NoneType None"),
        (["a", "b", "c"], "seeds must be whole numbers, got str 'a'"),
    ],
)
def test_other_seeds(seeds, message):
    with pytest.raises(ValueError, match=message):
        seeds_for("seeds", seeds, 3)


def test_numbers_and_those_that_keep_their_dtype():
    assert numbers("x", [1, 2]).dtype == np.float64
    assert numbers("x", np.array([1, 2.5], object)).tolist() == [1, 2.5]
    for dtype in (np.uint8, np.float32, np.int64, bool):
        array = np.ones(3, dtype)
        assert numeric("x", array) is array
        assert numbers("x", array).dtype == np.float64


@pytest.mark.parametrize(
    "values", ["x", None, ["1", "2"], np.array(["1"], object), [1, None], [[1], [2, 3]], [10**400], [1j], {}, b"1"]
)
def test_what_is_no_number(values):
    for check in (numbers, numeric):
        with pytest.raises(ValueError, match=r"x must be numbers of shape \(n,\), got"):
            check("x", values, " of shape (n,)")


def test_single_numbers():
    assert whole("k", np.int32(3)) == 3
    assert number("l", np.float32(0.5)) == 0.5
    for value in (True, 0, 1.5, "1", None):
        with pytest.raises(ValueError, match="k must be a whole number, 1 or more, got"):
            whole("k", value)
    for value in (True, -1, np.nan, np.inf, "1", None):
        with pytest.raises(ValueError, match="l must be a finite number, 0 or more, got"):
            number("l", value)
