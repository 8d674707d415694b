"""Workers that do not wait for each other."""

import numpy as np
import pytest
import robots
from alike import same
from commands import cli
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import asynchronous, evaluate
from auroraqd.evaluate.spread import Stream


def made(**options):
    return auroraqd.Aurora(3, PCA(2), seed=4, batch_size=20, schedule=auroraqd.Every(5), **options)


@pytest.fixture(scope="module")
def spread():
    with evaluate.over(evaluate.processes(2), robots.uneven) as task:
        yield task


def test_as_many_are_evaluated_as_are_asked_for(spread):
    seen = []
    aurora = made().run(spread, evaluations=110, asynchronous=True, callback=lambda aurora: seen.append(aurora.evaluations))
    assert aurora.evaluations == 110
    assert aurora.generation == len(seen) == 5
    assert not aurora.out
    aurora.run(spread, generations=2, asynchronous=True)
    assert aurora.generation == 7
    assert aurora.evaluations == 140, "a generation that was begun is finished"
    born = aurora.archive.born
    assert len(set(born.tolist())) == len(born)
    assert (aurora.archive.parent < aurora.archive.id).all()


@pytest.mark.parametrize("workers", [False, True])
def test_it_is_repeated_bit_for_bit_by_the_order_of_arrival(spread, workers):
    aurora = made().run(spread, generations=6, asynchronous=True)
    aurora.run(uneven_batch, generations=2)
    aurora.run(spread, generations=3, asynchronous=True)
    again = made()
    asynchronous.replay(again, spread if workers else uneven_batch, aurora.events)
    same(aurora, again)
    assert_array_equal(again.events, aurora.events)


def uneven_batch(genotypes, seeds):
    """As `robots.uneven`, at once: its rows do not depend on each other."""
    return np.where(genotypes[:, 0] > 0.97, np.nan, -genotypes[:, 1]), np.cumsum(genotypes[:, :, None], axis=1)


uneven_batch.seeded = True


def test_it_is_saved_and_goes_on(spread, tmp_path):
    class Stop(Exception):
        pass

    def crash(aurora):
        if aurora.generation == 4:
            raise Stop

    aurora = made()
    with pytest.raises(Stop):
        aurora.run(spread, generations=9, asynchronous=True, callback=crash)
    assert aurora.out, "what was under way stays asked for"
    again = auroraqd.resume(auroraqd.save(aurora, tmp_path / "run"))
    same(aurora, again)
    assert [p.ticket for p in again.out] == [p.ticket for p in aurora.out]
    again.run(spread, until_generation=9, asynchronous=True)
    assert again.generation == 9
    assert not again.out
    replayed = made()
    asynchronous.replay(replayed, uneven_batch, again.events)
    same(again, replayed)


def test_workers_that_die_cost_their_individual():
    with evaluate.over(evaluate.processes(2), robots.deadly, retries=0) as task:
        aurora = made().run(task, evaluations=40, asynchronous=True)
    assert aurora.evaluations == 40
    assert task.failed == aurora.history.last.invalid > 0
    again = made()

    def robot(genotypes):
        assert not (genotypes[:, 0] > 0.97).any(), "what was lost is not evaluated again"
        return -genotypes[:, 1], np.cumsum(genotypes[:, :, None], axis=1)

    asynchronous.replay(again, robot, aurora.events)
    same(aurora, again)


def test_tickets_are_told_in_any_order_and_withdrawn():
    aurora = made()
    first, second, third = (aurora.ask(n) for n in (7, 8, 9))
    assert "genotype: float64 (7, 3), parent=[-1 -1 -1 -1 -1 -1 -1]" in repr(first)
    assert [len(p.genotype) for p in aurora.out] == [7, 8, 9]
    assert_array_equal(np.concatenate([first.born, second.born, third.born]), np.arange(24))
    aurora.tell(*uneven_batch(third.genotype, None), ticket=third.ticket)
    assert (aurora.evaluations, aurora.generation) == (9, 0)
    aurora.withdraw(second.ticket)
    batch = aurora.ask()  # a generation by itself, meanwhile
    aurora.tell(*uneven_batch(batch, None))
    assert (aurora.evaluations, aurora.generation) == (29, 1)
    status = aurora.tell(*uneven_batch(first.genotype, None), ticket=first.ticket)
    assert status.shape == (7,)
    assert (aurora.evaluations, aurora.generation) == (36, 1)
    assert set(aurora.archive.born.tolist()) <= {*range(7), *range(15, 44)}


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda a, p: a.tell(*uneven_batch(p.genotype, None)), "tell needs the ticket of one of 1 proposals that are out"),
        (lambda a, p: a.tell(*uneven_batch(p.genotype[1:], None), ticket=p.ticket), "fitness must have 5 rows"),
        (lambda a, p: a.tell(*uneven_batch(p.genotype, None), ticket=p.ticket + 1), "was never given"),
        (lambda a, p: a.tell(*uneven_batch(p.genotype, None), ticket="x"), "ticket must be a whole number"),
        (lambda a, p: a.withdraw(auroraqd.Aurora(3, "genotype", seed=5).ask(5).ticket), "is of another"),
        (lambda a, p: a.ask(0), "genotypes must be a whole number"),
    ],
)
def test_bad_tickets_change_nothing(spoil, message):
    aurora, twin = made(), made()
    proposal = aurora.ask(5)
    other = twin.ask(5)
    with pytest.raises((ValueError, RuntimeError), match=message):
        spoil(aurora, proposal)
    for run, asked in ((aurora, proposal), (twin, other)):
        run.tell(*uneven_batch(asked.genotype, None), ticket=asked.ticket)
    with pytest.raises(ValueError, match="is so no longer"):
        aurora.tell(*uneven_batch(proposal.genotype, None), ticket=proposal.ticket)
    assert aurora.evaluations == twin.evaluations == 5
    assert_array_equal(aurora.ask(), twin.ask())


@pytest.mark.parametrize("descriptor", [PCA(2), "genotype"])
def test_the_first_generation_is_waited_for(descriptor):
    """Neither a descriptor nor l is made of a few."""
    aurora = auroraqd.Aurora(3, descriptor, seed=4, batch_size=20)
    for told in range(1, 26):
        proposal = aurora.ask(1)
        aurora.tell(*uneven_batch(proposal.genotype, None), ticket=proposal.ticket)
        assert (len(aurora.archive) > 0) == (told >= 20)
        assert aurora.descriptor.ready == (told >= 20 or descriptor == "genotype")
    whole = auroraqd.Aurora(3, descriptor, seed=4, batch_size=20)
    whole.tell(*uneven_batch(whole.ask(), None))
    assert aurora.archive.l == whole.archive.l


def test_it_needs_workers():
    with pytest.raises(TypeError, match=r"task must be one over workers, of auroraqd\.evaluate\.over"):
        made().run(uneven_batch, generations=1, asynchronous=True)
    with (
        evaluate.over(evaluate.processes(1), robots.uneven) as task,
        pytest.raises(TypeError, match="task must be one over workers"),
    ):  # what is within would be evaluated once, not twice
        made().run(auroraqd.tasks.repeated(task, 2), generations=1, asynchronous=True)


def test_a_task_that_is_wrong_is_named():
    with (
        evaluate.over(evaluate.processes(1), robots.wrong) as task,
        pytest.raises(auroraqd.TaskError, match=r"task wrong at generation 0: observation must have shape"),
    ):
        made().run(task, generations=1, asynchronous=True)


@pytest.mark.parametrize(("evaluations", "failed"), [(7, "7"), (1000, "3[2-9]")])
def test_a_task_that_always_fails_ends_the_run(evaluations, failed):
    with (
        evaluate.over(evaluate.processes(2), robots.hopeless, retries=0) as task,
        pytest.raises(auroraqd.TaskError, match=f"all of {failed} individuals failed, the last: OSError: no such robot"),
    ):
        made().run(task, evaluations=evaluations, asynchronous=True)


def refusing(archive, n, rng):
    raise ValueError("not today")


def test_an_emitter_that_fails_is_not_said_of_the_task(spread):
    aurora = made(selection=refusing)
    with pytest.raises(ValueError, match="not today"):
        aurora.run(spread, evaluations=5000, asynchronous=True)  # more than may be asked for before the first are told
    assert aurora.evaluations >= 20, "what was found before stays"


def test_each_worker_has_the_next_waiting_where_evaluations_are_short(spread):
    spread._seconds = 0.002
    with Stream(spread) as stream:
        assert stream.wanted == 4
        spread._seconds = 5.0
        assert stream.wanted == 2
    spread._seconds = None


def test_command_line(tmp_path):
    line = ["run", "ballistic", "-n", 4, "--batch-size", 40, "--jobs", 2, "--asynchronous", "--no-figures"]
    done = cli(*line, "--out", tmp_path / "one")
    assert done.returncode == 0, done.stderr
    done = cli("resume", tmp_path / "one", "-n", 6, "--jobs", 2, "--no-figures")
    assert done.returncode == 0, done.stderr
    done = cli("repeat", tmp_path / "one", "--out", tmp_path / "two", "--no-figures")
    assert done.returncode == 0, done.stderr
    one, two = (auroraqd.load(tmp_path / name) for name in ("one", "two"))
    for name, column in one.columns.items():
        assert_array_equal(column, two.columns[name])
    done = cli("resume", tmp_path / "one", "-n", 8, "--no-figures")
    assert done.returncode == 1
    assert "an asynchronous run needs workers: give --jobs or --scheduler too" in " ".join(done.stderr.split())
