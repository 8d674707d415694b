"""Hypothesis without deadlines: the first example of a test compiles kernels. Workers of xdist share tests without chunks."""

import pytest
from hypothesis import settings

settings.register_profile("auroraqd", deadline=None, print_blob=True)
settings.load_profile("auroraqd")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Each worker has half of the tests, in order, so that what a module shares is made once; one that is done helps."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getvalue("dist") == "load" else None
