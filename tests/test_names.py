"""The public names."""

import subprocess
import sys

import pytest

import auroraqd


@pytest.mark.parametrize("name", auroraqd.__all__)
def test_every_public_name_is_there(name):
    assert getattr(auroraqd, name) is not None
    assert name in dir(auroraqd)


def test_the_version_is_seen():
    assert "__version__" in dir(auroraqd)
    assert set(auroraqd.__all__) <= set(dir(auroraqd))


def test_modules_are_attributes_and_other_names_are_not():
    assert {"evaluate", "metrics", "report", "tasks"} <= set(auroraqd.__all__)
    with pytest.raises(AttributeError, match="auroraq"):
        auroraqd.Auroraq  # noqa: B018


def test_nothing_heavy_is_imported_before_it_is_used():
    code = "import auroraqd, sys; print([name for name in ('numpy', 'numba', 'jax', 'matplotlib') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
