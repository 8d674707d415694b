"""Descriptors as bytes and back."""

import copy
import sys

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.decomposition import PCA, FastICA, IncrementalPCA, TruncatedSVD
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from auroraqd.runs import _transformers

X = np.random.default_rng(0).normal(size=(60, 7))

PLAIN = [
    PCA(2),
    PCA(0.9, whiten=True),
    PCA(3, svd_solver="randomized", random_state=5),
    IncrementalPCA(2),
    TruncatedSVD(2, random_state=np.int64(3)),
]
OTHERS = [make_pipeline(StandardScaler(), PCA(2)), FastICA(2, random_state=0), PCA(2, random_state=np.random.RandomState(0))]


def named(transformer):
    return repr(transformer).partition(" at 0x")[0]  # both workers of pytest must call it the same


@pytest.mark.parametrize("transformer", [*PLAIN, *OTHERS], ids=named)
def test_they_come_back_as_they_were(transformer):
    for estimator in (clone(transformer), copy.deepcopy(clone(transformer).fit(X))):
        content = _transformers.dumped(estimator)
        back = _transformers.loaded(content, ["numpy.random.mtrand.RandomState", "numpy.random.mtrand.__randomstate_ctor"])
        assert type(back) is type(estimator)
        assert named(back) == named(estimator)
        assert _transformers.dumped(back) == content
    assert_array_equal(back.transform(X), estimator.transform(X))


@pytest.mark.parametrize("transformer", PLAIN, ids=named)
def test_plain_ones_are_the_same_in_memory(transformer):
    fitted = copy.deepcopy(clone(transformer).fit(np.asfortranarray(X)))
    back = vars(_transformers.loaded(_transformers.dumped(fitted), []))
    assert set(back) == set(vars(fitted))
    for name, value in vars(fitted).items():
        assert type(back[name]) is type(value)
        assert_array_equal(back[name], value)
        if isinstance(value, np.ndarray):
            assert back[name].dtype == value.dtype
            assert back[name].flags.fnc == value.flags.fnc


def test_plain_ones_need_no_skops(monkeypatch):
    monkeypatch.setitem(sys.modules, "skops", None)
    fitted = PCA(2).fit(X)
    _transformers.check(fitted)
    assert_array_equal(_transformers.loaded(_transformers.dumped(fitted), []).transform(X), fitted.transform(X))


class PCAOfMine(PCA):
    pass


PCAOfMine.__name__ = "PCA"


def test_what_only_looks_plain_is_not():
    assert _transformers.dumped(PCAOfMine(2)).startswith(b"PK")
    named = PCA(2).fit(X)
    named.feature_names_in_ = np.array(list("abcdefg"), object)
    assert _transformers.dumped(named).startswith(b"PK")


def test_a_type_that_is_not_known():
    content = _transformers.dumped(PCA(2)).replace(b'"PCA"', b'"SVC"')
    with pytest.raises(ValueError, match="not known here: SVC"):
        _transformers.loaded(content, [])
