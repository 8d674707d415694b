"""Hypothesis without deadlines: the first example of a test compiles kernels. Workers of xdist share tests without chunks.

All processes of a session share what JAX compiles: dozens of them train the same few networks.
"""

import os
import signal
import tempfile

import browsing
import pytest
from hypothesis import settings

settings.register_profile("auroraqd", deadline=None, print_blob=True)
settings.load_profile("auroraqd")


def pytest_configure(config):
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell, and then in all processes
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # as it is in workers of xdist
        folder = tempfile.TemporaryDirectory(prefix="jax-")
        config.add_cleanup(folder.cleanup)
        os.environ["JAX_COMPILATION_CACHE_DIR"] = folder.name
        os.environ["JAX_COMPILATION_CACHE_MAX_SIZE"] = str(2**30)  # with any limit JAX locks it
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Each worker has half of the tests, in order, so that what a module shares is made once; one that is done helps."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getvalue("dist") == "load" else None


@pytest.fixture(scope="session")
def browser():
    """A page in a browser, if there is one."""
    with browsing.chromium() as page:
        yield page
