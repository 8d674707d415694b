"""Signals that are held back while a state is half changed: none is lost, and no handler is left behind."""

import signal
import threading
from contextlib import nullcontext

import pytest
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import _interrupts
from auroraqd._interrupts import relayed, uninterrupted

INT, TERM = signal.SIGINT, signal.SIGTERM


@pytest.fixture
def handled():
    """What was handled; SIGTERM raises, as in the command line."""
    seen = []

    def ended(number, frame):
        seen.append(number)
        raise SystemExit(number)

    before = {number: signal.getsignal(number) for number in (INT, TERM)}
    signal.signal(INT, lambda number, frame: seen.append(number))
    signal.signal(TERM, ended)
    yield seen
    for number, handler in before.items():
        signal.signal(number, handler)


def both(handled):
    """Each signal once; nothing is handled meanwhile."""
    before = list(handled)
    with uninterrupted():
        with uninterrupted():
            signal.raise_signal(TERM)
            signal.raise_signal(INT)
        assert handled == before


def test_they_are_handled_when_the_block_is_left(handled):
    with pytest.raises(SystemExit):
        both(handled)
    assert sorted(handled) == [INT, TERM]  # both, though the first to be handled may raise


def test_also_when_it_is_left_by_an_error(handled):
    def failing():
        with uninterrupted():
            signal.raise_signal(INT)
            raise ValueError("mine")

    with pytest.raises(ValueError, match="mine"):
        failing()
    assert handled == [INT]


@pytest.mark.parametrize("around", [nullcontext, relayed])
@pytest.mark.parametrize("when", range(14))
def test_one_that_comes_while_handlers_are_restored(around, when, handled, monkeypatch):
    """At any call of the module that changes something."""
    handlers = [signal.getsignal(number) for number in (INT, TERM)]
    real, calls = _interrupts._signal, []

    class Interrupting:
        def __getattr__(self, name):
            if len(calls) == when:
                calls.append("sent")
                signal.raise_signal(TERM)
            calls.append(name)
            return getattr(real, name)

    monkeypatch.setattr(_interrupts, "_signal", Interrupting())
    try:
        with around(), uninterrupted():
            pass
    except SystemExit:
        pass
    monkeypatch.undo()
    assert [signal.getsignal(number) for number in (INT, TERM)] == handlers
    signal.raise_signal(INT)
    assert INT in handled
    assert _interrupts._depth == 0


def test_relayed_signals_are_handled_at_once_but_in_a_block(handled):
    before = signal.getsignal(INT)
    with relayed():
        signal.raise_signal(INT)
        assert handled == [INT]
        for _ in range(2):
            with uninterrupted():
                signal.raise_signal(INT)
                assert len(handled) % 2 == 1
            signal.raise_signal(INT)
        assert handled == [INT] * 5
        with pytest.raises(SystemExit):
            both(handled)
    assert sorted(handled) == [INT] * 6 + [TERM]
    assert signal.getsignal(INT) is before


def test_a_handler_that_is_set_in_a_run_stays_and_is_held_back(handled):
    mine = []

    def set_mine(aurora):
        signal.signal(INT, lambda number, frame: mine.append(aurora.generation))
        with uninterrupted():
            signal.raise_signal(INT)
            assert len(mine) == 0
        return True

    aurora = auroraqd.Aurora(2, "genotype", batch_size=20, seed=0)
    aurora.run(auroraqd.tasks.Ballistic(), generations=2, callback=set_mine)
    signal.raise_signal(INT)
    assert (mine, handled) == ([1, 1], [])


def test_an_interrupt_behind_an_error_is_one():
    class Interrupted(PCA):
        def fit(self, x, y=None):
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt as interrupt:
                raise TypeError("cannot compare") from interrupt

    aurora = auroraqd.Aurora(2, Interrupted(2), batch_size=50, seed=0)
    with pytest.raises(KeyboardInterrupt):
        aurora.run(auroraqd.tasks.Ballistic(), generations=1)
    assert (aurora.evaluations, len(aurora.pending)) == (0, 50)


def test_in_other_threads_there_is_nothing_to_hold_back(handled):
    def work():
        with uninterrupted():
            assert signal.getsignal(INT) is not None

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert handled == []
