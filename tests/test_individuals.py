"""Columns of individuals, and rows of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.testing import assert_array_equal

from auroraqd.individuals import Columns
from auroraqd.observations import finite_rows, observations

ROWS = 7


def columns():
    return Columns({"one": np.arange(ROWS), "two": np.arange(2.0 * ROWS).reshape(ROWS, 2)})


@st.composite
def choices(draw):
    """Rows to take from ROWS of them, several times over, as numbers or as what is true."""
    rows, steps = ROWS, []
    for _ in range(draw(st.integers(1, 3))):
        if rows and draw(st.booleans()):
            steps.append(np.array(draw(st.lists(st.integers(0, rows - 1), max_size=9)), int))
            rows = len(steps[-1])
        else:
            steps.append(np.array(draw(st.lists(st.booleans(), min_size=rows, max_size=rows)), bool))
            rows = int(steps[-1].sum())
    return steps


@given(choices(), st.booleans(), st.booleans())
def test_what_is_chosen_is_what_is_taken(steps, looked_at, beside):
    chosen, taken = columns(), {**columns()}
    for step in steps:
        chosen = chosen.chosen(step)
        taken = {name: array[step] for name, array in taken.items()}
        if looked_at:
            assert_array_equal(chosen["two"], taken["two"])
        if beside:
            more = {"three": np.arange(chosen.rows), "one": -np.arange(chosen.rows)}
            chosen, taken = chosen | more, {**taken, **more}
    assert chosen.rows == len(taken["one"])
    assert set(chosen) == set(taken)
    assert len(chosen) == len(taken)
    for name, array in chosen.items():
        assert_array_equal(array, taken[name])
    assert set(chosen.without("one")) == set(taken) - {"one"}
    assert chosen.only("two", "four").rows == chosen.rows
    assert "four" not in chosen
    assert chosen.get("four") is None


def test_what_is_taken_is_of_its_own():
    source = columns()
    taken = source.take(np.array([1, 2]))
    source["one"][:] = -1
    assert_array_equal(taken["one"], [1, 2])


ENTRIES = st.sampled_from([0.0, -0.0, 1.0, -2.5, 1e300, -1e300, 1.8e308, 5e-324, np.nan, np.inf, -np.inf])


@given(
    arrays(np.float64, array_shapes(max_dims=3, min_side=0, max_side=20), elements=ENTRIES),
    st.sampled_from([np.float64, np.float32, np.float16, np.longdouble, int]),
    st.booleans(),
)
def test_finite_rows_agree_with_their_twin(values, dtype, turned):
    with np.errstate(over="ignore", invalid="ignore"):
        rows = values.astype(dtype)
    rows = np.asfortranarray(rows)[::-1] if turned else rows
    rows.flags.writeable = not turned
    before = rows.flags.writeable
    assert finite_rows(rows).tolist() == [bool(np.isfinite(row).all()) for row in rows]
    assert rows.flags.writeable == before


def test_finite_rows_of_streams():
    camera = np.zeros((3, 2, 2), np.uint8)
    joints = np.array([[0.0, 1.0], [np.nan, 1.0], [2.0, 3.0]])
    force = np.array([1.0, 2.0, -np.inf])
    assert finite_rows(observations("observation", {"camera": camera, "joints": joints, "force": force})).tolist() == [
        True,
        False,
        False,
    ]
