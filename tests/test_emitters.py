"""Emitters beside the genetic one: goals, and populations."""

import dataclasses
from contextlib import suppress

import naive
import numpy as np
import pytest
from alike import same
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.emitters import NSLC, TAXONS, EmitterError, Genetic, Goals, NoveltySearch
from auroraqd.emitters.goals import goals, nearest_to
from auroraqd.emitters.population import _novelty, crowding, fronts, in_order
from auroraqd.individuals import Columns

TASK = auroraqd.tasks.Ballistic()
EMITTERS = [Goals(), NoveltySearch(20), NSLC(20, k=5), TAXONS(20, elite=3, first=2)]


def run(emitter, generations, descriptor=None, **options):
    descriptor = PCA(2) if descriptor is None else descriptor
    options = {"schedule": auroraqd.Every(3), "seed": 0, "batch_size": 30, **options}
    return auroraqd.Aurora(2, descriptor, emitter=emitter, **options).run(TASK, generations=generations)


def stored(n, d=2, seed=0, archive=None):
    archive = auroraqd.UnstructuredArchive() if archive is None else archive
    rng = np.random.default_rng(seed)
    x = rng.random((n, d))
    archive.add(rng.random((n, 3)), rng.random(n), x, x, born=np.arange(n))
    return archive


@pytest.mark.parametrize("emitter", EMITTERS, ids=lambda emitter: type(emitter).__name__)
@pytest.mark.parametrize("archive", [auroraqd.UnstructuredArchive, lambda: auroraqd.DominatedArchive(60)])
def test_resumed_at_any_moment_it_is_the_same_run(emitter, archive, tmp_path):
    alone, aurora = (run(emitter, 0, archive=archive()) for _ in range(2))
    alone.run(TASK, generations=11)
    for generation in range(11):
        batch = aurora.ask()
        aurora = auroraqd.resume(auroraqd.save(aurora, tmp_path / "asked"))
        aurora.tell(*TASK(batch))
        if generation % 2:
            aurora = auroraqd.resume(auroraqd.save(aurora, tmp_path / "told"))
    for name in ("genotype", "descriptor", "id", "parent"):
        assert_array_equal(getattr(aurora.archive, name), getattr(alone.archive, name))
    assert aurora._emitters.emitters[0] == dataclasses.replace(emitter) == emitter


@pytest.mark.parametrize("emitter", EMITTERS[1:], ids=lambda emitter: type(emitter).__name__)
def test_members_are_described_by_the_descriptor_as_it_is(emitter):
    aurora = run(emitter, 13)
    members = aurora._emitters.emitters[0].members
    assert members.rows == 20
    assert_allclose(members["descriptor"], aurora.describe(members["observation"]), rtol=1e-9, atol=1e-12)
    rows = aurora.archive.rows_of(members["id"])
    assert_array_equal(aurora.archive.born[rows[rows >= 0]], members["born"][rows >= 0])


def test_goals_begin_at_random_and_go_on_near_what_is_stored():
    archive, rng = stored(60), np.random.default_rng(0)
    _, parent = Goals(random=0, first=100).ask(archive, 70, rng)
    assert_array_equal(parent[:40], -1)
    assert (parent[40:] >= 0).all()
    genotype, parent = Goals(first=0).ask(archive, 20_000, rng)
    aims = parent >= 0
    assert_allclose(aims.mean(), 0.8, atol=0.01)
    step = genotype[aims] - archive.genotype[archive.rows_of(parent[aims])]
    assert 0.04 < step.std() < 0.051  # steps end at 0 and 1
    assert (Goals(random=1).ask(archive, 50, rng)[1] == -1).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.sampled_from([1, 2, 10]), st.sampled_from(["random", "flat", "same"]))
def test_goals_lie_where_descriptors_do(seed, n, d, kind):
    rng = np.random.default_rng(seed)
    x = rng.random((n, d)) * {"random": np.ones(d), "flat": np.eye(d)[0], "same": np.zeros(d)}[kind]
    drawn = goals(x, 50, rng)
    assert drawn.shape == (50, d)
    assert np.isfinite(drawn).all()
    if kind == "same" or n <= d:
        assert all(goal in x.tolist() for goal in drawn.tolist())
    for goal, row in zip(drawn, nearest_to(drawn, x), strict=True):
        assert_allclose(naive.distance(goal, x[row]), min(naive.distance(goal, p) for p in x))


POINTS = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=30)


@given(POINTS)
def test_the_order_of_nsga2_agrees_with_its_twin(points):
    objectives = np.array(points, float)
    expected = naive.fronts(points)
    assert fronts(objectives).tolist() == expected
    assert_allclose(crowding(objectives), naive.crowding(points))
    apart = [0.0] * len(points)
    for front in set(expected):
        members = [i for i in range(len(points)) if expected[i] == front]
        for i, value in zip(members, naive.crowding([points[i] for i in members]), strict=True):
            apart[i] = value
    assert in_order(objectives).tolist() == sorted(range(len(points)), key=lambda i: (expected[i], -apart[i], i))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(0, 30), st.sampled_from([1, 2, 10]), st.integers(1, 6))
def test_novelty_among_population_and_archive_counts_each_once(seed, members, others, d, k):
    rng = np.random.default_rng(seed)
    archive = auroraqd.DominatedArchive()
    x, fitness = np.round(rng.random((members + others, d)), 1), np.round(rng.random(members + others), 1)
    held = rng.random(members + others) < 0.7
    held[members:] = True
    if held.any():
        archive.add(x[held], fitness[held], x[held], x[held], born=np.flatnonzero(held))
    else:
        archive.add(x[:1] + 9, fitness[:1], x[:1], x[:1] + 9, born=[99])
        x, fitness = np.vstack([x, x[:1] + 9]), np.append(fitness, fitness[0])
    own = {"descriptor": x[:members], "fitness": fitness[:members], "born": np.arange(members)}
    novelty, outdone = _novelty(Columns(own), archive, k)
    assert_array_equal(novelty, [naive.novelty(x, x[i], i, k) for i in range(members)])
    for i in range(members):
        near = sorted((naive.squared_distance(p, x[i]), j) for j, p in enumerate(x) if j != i)[:k]
        assert outdone[i] == sum(fitness[j] < fitness[i] for _, j in near)


def test_the_most_novel_are_the_next_population():
    aurora = run(NoveltySearch(10, k=3), 8, "hand-coded", schedule=auroraqd.Never())
    emitter = aurora._emitters.emitters[0]
    novelty, _ = _novelty(emitter.members, aurora.archive, 3)
    assert (np.diff(novelty) <= 0).all()
    genotype, parent = emitter.ask(aurora.archive, 2000, np.random.default_rng(0))
    assert genotype.shape == (2000, 2)
    assert set(parent.tolist()) <= set(emitter.members["id"].tolist())


def test_taxons_goes_by_novelty_first_then_by_a_coin():
    emitter = TAXONS(20, first=3)
    aurora = run(emitter, 1)
    inside = aurora._emitters.emitters[0]
    by = []
    for _ in range(40):
        batch = aurora.ask()
        by.append(inside._by_surprise)
        aurora.tell(*TASK(batch))
        members = inside.members
        assert members.rows == 20
        assert_array_equal(members["born"][-5:], members["born"][:5])
        if by[-1]:
            assert (np.diff(members["reconstruction_error"][:15]) <= 0).all()
    assert not any(by[:3])
    assert 8 < sum(by) < 30
    with pytest.raises(ValueError, match="TAXONS needs reconstruction errors"):
        run(emitter, 2, "hand-coded")


def test_invalid_individuals_are_no_members():
    def failing(genotypes):
        fitness, observation, truth = TASK(genotypes)
        return np.where(np.arange(len(fitness)) % 3, np.nan, fitness), observation, truth

    aurora = auroraqd.Aurora(2, PCA(2), emitter=[(NSLC(15), 2), (Goals(), 1)], seed=0, batch_size=30)
    aurora.run(failing, generations=9)
    members = aurora._emitters.emitters[0].members
    assert members.rows == 15
    assert np.isfinite(members["fitness"]).all()


class Faulty:
    """As the genetic emitter, but for what it raises when it is told something."""

    def __init__(self, *methods):
        self.methods, self.genetic = methods, Genetic()

    def ask(self, archive, n, rng):
        return self.genetic.ask(archive, n, rng)

    def tell(self, archive, batch, info):
        if "tell" in self.methods and batch["born"][0] == 120:
            raise KeyError("lost")

    def updated(self, archive, describe):
        if "updated" in self.methods and len(archive):
            raise ZeroDivisionError

    def withdrawn(self, genotype):
        raise OSError("never mind")


class Callable:
    def __call__(self, archive, n, rng): ...


class Watch:
    """A callback that knows who was evaluated."""

    def __init__(self):
        self.seen = []

    def told(self, aurora, batch, info):
        self.seen += batch["born"].tolist()


@pytest.mark.parametrize(
    ("emitter", "message"),
    [
        (Faulty("tell"), r"^emitter Faulty raised in `tell`, at generation 4: KeyError: 'lost'; what was found is kept$"),
        (Faulty("updated"), "^emitter Faulty raised in `updated`, at generation 3: ZeroDivisionError; what was found is kept$"),
    ],
)
def test_an_emitter_that_raises_costs_nothing(emitter, message, tmp_path):
    """The run is the one of an emitter that does not, whatever is asked next."""
    options = {"schedule": auroraqd.Every(3), "seed": 0, "batch_size": 30}
    watch = Watch()
    good = auroraqd.Aurora(2, PCA(2), emitter=Genetic(), **options).run(TASK, generations=5)
    bad = auroraqd.Aurora(2, PCA(2), emitter=[emitter], **options)
    with pytest.raises(EmitterError, match=message) as raised:
        bad.run(TASK, generations=5, callback=watch)
    assert isinstance(raised.value.__cause__, KeyError | ZeroDivisionError)
    assert watch.seen == list(range(bad.evaluations)), "callbacks are told too"
    assert bad.history.last.generation == bad.generation == int(message.partition("generation ")[2][0]) + 1
    auroraqd.save(bad, tmp_path)
    while bad.generation < 5:
        with suppress(EmitterError):
            bad.run(TASK, until_generation=5)
    same(good, bad)


def test_what_one_emitter_raises_is_kept_from_the_others():
    members = []
    for other in (Faulty("tell", "updated"), Genetic()):
        aurora = run([other, NSLC(20)], 0)
        while aurora.generation < 9:
            with suppress(EmitterError):
                aurora.run(TASK, until_generation=9)
        members.append(aurora._emitters.emitters[1].members)
    for name in members[0]:
        assert_array_equal(members[0][name], members[1][name])


def test_what_is_withdrawn_is_withdrawn_whatever_emitters_say():
    aurora = run(Faulty(), 2)
    proposal = aurora.ask(3)
    with pytest.raises(EmitterError, match="raised in `withdrawn`, at generation 2: OSError: never mind"):
        aurora.withdraw(proposal.ticket)
    assert not aurora.out


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (Genetic(stored), "Genetic(selection=stored, variation=Polynomial(rate=0.1, eta=10.0, at_least_one=True))"),
        (NSLC(5, variation=same), "NSLC(population=5, k=15, variation=same)"),
        (auroraqd.Mixed(Callable(), min), "Mixed(a=Callable, b=min)"),
    ],
)
def test_a_repr_says_what_functions_are_called(part, text):
    assert repr(part) == text


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Goals(random=2), "random must"),
        (lambda: Goals(sigma=0), "sigma must"),
        (lambda: Goals(first=-1), "first must"),
        (lambda: NoveltySearch(0), "population must"),
        (lambda: NSLC(k=0), "k must"),
        (lambda: NSLC(variation=auroraqd.IsoLine()), "variation must be of one parent"),
        (lambda: NSLC(variation="polynomial"), "variation must be callable"),
        (lambda: TAXONS(6, elite=4), "population must be at least twice elite, which is 4, got 6"),
        (lambda: TAXONS(5), "population must be at least twice elite, which is 5, got 5"),
        (lambda: TAXONS(first=-1), "first must"),
    ],
)
def test_bad_parameters(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()


def test_what_others_were_asked_for_is_withdrawn_when_one_fails():
    class First:
        gone = []

        def ask(self, archive, n, rng):
            return rng.random((n, 2)), np.full(n, -1)

        def withdrawn(self, genotype):
            self.gone.append(len(genotype))

    class Failing(First):
        def ask(self, archive, n, rng):
            raise ValueError("no")

    aurora = auroraqd.Aurora(2, "hand-coded", emitter=[First(), Failing()], batch_size=20, seed=0)
    task = auroraqd.tasks.Ballistic()
    aurora.run(task, generations=1)
    with pytest.raises(ValueError, match="no"):
        aurora.ask()
    assert First.gone == [10]
