"""One process that dies or hangs takes nothing of the others with it."""

import os
import time

import pytest

from auroraqd._processes import Processes, WorkerDied


def nothing():
    pass


def whole_life(seconds, code=None):
    """Sleep, then say who, or leave without a word."""
    time.sleep(seconds)
    if code is not None:
        os._exit(code)
    return os.getpid()


@pytest.fixture(scope="module")
def two():
    with Processes(2, nothing) as processes:
        yield processes
        processes.kill()


def pids(processes):
    """Of both, by who sleeps at once."""
    return {future.result() for future in [processes.submit(whole_life, 0.3) for _ in range(2)]}


@pytest.mark.parametrize("code", [3, 0])
def test_only_what_it_did_is_lost(two, code):
    before = pids(two)
    long = two.submit(whole_life, 0.6)
    short = two.submit(whole_life, 0.1, code)
    waiting = two.submit(whole_life, 0), two.submit(whole_life, 0)
    with pytest.raises(WorkerDied, match="its process died") as found:
        short.result()
    assert found.value.began
    assert long.result() in before
    errors = [future.exception() for future in waiting]  # one of them was to be done after it
    assert [error.began for error in errors if error is not None] == [False]
    after = pids(two)
    assert len(before & after) == 1
    assert len(after) == 2


def test_one_is_ended(two):
    before = pids(two)
    hangs, goes_on = two.submit(whole_life, 1000), two.submit(whole_life, 0.5)
    two.end(hangs)
    with pytest.raises(WorkerDied):
        hangs.result()
    started = two.fill(os.getpid)
    assert len(started) == 1
    assert {goes_on.result(), *(future.result() for future in started.values())} == pids(two)
    assert goes_on.result() in before


def test_who_died_while_nobody_looked_is_replaced(two):
    before = pids(two)
    for process in list(two._processes.values()):
        for pid in list(process.pool._processes):
            os.kill(pid, 9)
    time.sleep(0.3)
    assert not pids(two) & before


def test_each_starts_when_it_is_needed():
    with Processes(3, nothing) as processes:
        assert processes.submit(os.getpid).result() == processes.submit(os.getpid).result()
        assert list(processes._processes) == [0]
