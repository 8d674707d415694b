import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose

from auroraqd.metrics import klc, outside


def test_agrees_with_its_twin():
    rng = np.random.default_rng(0)
    reference, compared = rng.normal(size=(3000, 2)), rng.normal(size=(2000, 2)) * 1.3 + 0.2
    assert_allclose(klc(reference, compared), naive.klc(reference.tolist(), compared.tolist()))
    assert klc(reference, compared) > 0


def test_values_by_hand():
    """Half of the reference in a bin that holds a quarter of the compared: 0.5 log 2 + 0.5 log (2/3)."""
    reference = np.array([[0.0, 0.0], [1.0, 1.0]])
    compared = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    assert_allclose(klc(reference, compared, bins=2), 0.5 * np.log(2) + 0.5 * np.log(2 / 3))
    assert klc(reference, reference) == 0
    assert_allclose(klc(reference, reference[:1], bins=2), 0.5 * np.log(0.5) + 0.5 * np.log(0.5 / 1e-8))  # an empty bin


def test_outside():
    reference = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert outside(reference, np.array([[0.5, 0.5], [2.0, 0.5], [0.5, -1.0], [1.0, 0.0]])) == 0.5


@pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((0, 2)), np.full((3, 2), np.nan), np.zeros((3, 3))])
def test_bad_arguments(bad):
    with pytest.raises(ValueError, match="must"):
        klc(np.random.default_rng(0).random((5, 2)), bad)
