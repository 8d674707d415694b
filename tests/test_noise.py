import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from robots import Windy
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate, tasks
from auroraqd.tasks.noise import other_seeds, seeds_of

GENOTYPES = np.random.default_rng(0).random((40, 3))


def one(genotype, seed):
    return -genotype[0], genotype + np.random.default_rng(seed).normal(0, 0.1, 3), genotype


def in_jax(genotype, key):
    import jax

    return genotype + jax.random.normal(key, (3,))


def grown(task, batch_size=30, **options):
    return auroraqd.Aurora(3, PCA(2), seed=4, batch_size=batch_size).run(task, generations=4, **options)


@given(st.integers(0, 2**64), st.integers(0, 10**12), st.integers(1, 20), st.integers(0, 20))
def test_a_seed_is_that_of_its_evaluation(seed, first, n, skipped):
    """However evaluations are cut into batches."""
    seeds = seeds_of(seed, first, n)
    assert seeds.dtype == np.uint64
    assert len(np.unique(seeds)) == n
    assert_array_equal(seeds_of(seed, first + skipped, n)[: max(n - skipped, 0)], seeds[skipped:])
    assert not np.isin(seeds, seeds_of(seed + 1, first, n)).any()


def test_a_run_gives_each_individual_its_seed():
    given_seeds = []

    class Watched(Windy):
        def __call__(self, genotypes, seeds):
            given_seeds.append(seeds)
            return super().__call__(genotypes, seeds)

    grown(Watched())
    assert_array_equal(np.concatenate(given_seeds), seeds_of(4, 0, 120))


def test_ask_and_tell_can_use_them():
    aurora = auroraqd.Aurora(3, PCA(2), seed=4, batch_size=30)
    assert aurora.seeds is None
    for _ in range(4):
        aurora.tell(*Windy()(aurora.ask(), aurora.seeds))
    assert_array_equal(aurora.archive.observation, grown(Windy()).archive.observation)


@pytest.mark.parametrize(
    "task",
    [tasks.each(one, seeded=True), tasks.from_jax(in_jax, seeded=True), tasks.repeated(Windy(), 2), tasks.repeated(Windy(), 1)],
)
@pytest.mark.parametrize(
    ("seeds", "message"),
    [
        ([0.5, 1.5], "must be whole numbers, got float 0.5"),
        (["a", "b"], "must be whole numbers, got str 'a'"),
        ([True, False], "must be whole numbers, got bool True"),
        ([[1, 2], 3], r"must be whole numbers, got list \[1, 2\]"),
        ([1], r"must have shape \(2,\), got shape \(1,\)"),
    ],
)
def test_seeds_that_are_none(task, seeds, message):
    with pytest.raises(ValueError, match=f"seeds.* {message}"):
        task(GENOTYPES[:2], seeds)


def test_a_seeded_function_needs_seeds():
    for task in (tasks.each(one, seeded=True), tasks.from_jax(in_jax, seeded=True)):
        with pytest.raises(ValueError, match=rf"seeds of {task.__name__} must have shape \(2,\), got None"):
            task(GENOTYPES[:2])


@pytest.mark.parametrize("chunk", [1, 7])
def test_results_do_not_depend_on_who_evaluates_what(chunk):
    with evaluate.over(evaluate.processes(2), Windy(), chunk=chunk) as task:
        found = grown(task).archive
    expected = grown(Windy()).archive
    assert_array_equal(found.genotype, expected.genotype)
    assert_array_equal(found.observation, expected.observation)


def test_a_resumed_run_has_the_same_noise(tmp_path):
    aurora = grown(Windy())
    auroraqd.save(aurora, tmp_path)
    again = auroraqd.resume(tmp_path).run(Windy(), generations=3)
    assert_array_equal(again.archive.observation, aurora.run(Windy(), generations=3).archive.observation)


def test_of_one_genotype():
    task = tasks.each(one, n_genes=3, seeded=True)
    assert_array_equal(grown(task).archive.observation, grown(Windy()).archive.observation)


def test_in_jax():
    task = tasks.from_jax(in_jax, seeded=True)
    seeds = seeds_of(0, 0, 40)
    found = task(GENOTYPES, seeds)
    assert_array_equal(task(GENOTYPES[5:9], seeds[5:9]), found[5:9])
    noise = found - GENOTYPES
    assert len(np.unique(noise)) == noise.size
    assert abs(noise.mean()) < 0.4
    assert 0.7 < noise.std() < 1.3
    assert len(grown(task).archive) > 5


def test_repetitions_are_averaged():
    seeds = seeds_of(0, 0, 40)
    task = tasks.repeated(Windy(), 400)
    fitness, observation, truth = task(GENOTYPES, seeds)
    assert_allclose(fitness, -GENOTYPES[:, 0])
    assert_allclose(truth, GENOTYPES)
    error = observation - GENOTYPES
    assert 0.8 * 0.1 / 20 < error.std() < 1.2 * 0.1 / 20
    assert_array_equal(task(GENOTYPES[7:8], seeds[7:8]).observation[0], observation[7])
    assert_allclose(tasks.repeated(Windy(), 1)(GENOTYPES, seeds).fitness, fitness)


def test_repetitions_of_a_task_with_chance_of_its_own():
    rng = np.random.default_rng(0)

    def unsteady(genotypes):
        return genotypes + rng.normal(0, 1, genotypes.shape)

    unsteady.n_genes = 3
    task = tasks.repeated(unsteady, 100)
    assert (task.n_genes, task.__name__) == (3, "unsteady")
    assert 0.08 < (grown(task).archive.observation - grown(task).archive.genotype).std() < 0.12


def test_repetitions_of_pictures_are_no_integers():
    task = tasks.repeated(lambda genotypes: (255 * genotypes).astype(np.uint8), 3)
    assert_array_equal(task(GENOTYPES).observation, (255 * GENOTYPES).astype(np.uint8).astype(float))


def test_invalid_once_is_invalid():
    def sometimes(genotypes, seeds):
        return np.where(seeds % np.uint64(7) == 0, np.nan, 0.0), genotypes

    sometimes.seeded = True
    fitness = tasks.repeated(sometimes, 5)(GENOTYPES, seeds_of(0, 0, 40)).fitness
    assert 0 < np.isnan(fitness).sum() < 40


def test_repetitions_may_be_spread_or_within_workers():
    seeds = seeds_of(0, 0, 40)
    expected = tasks.repeated(Windy(), 3)(GENOTYPES, seeds)
    with evaluate.over(evaluate.processes(1), Windy()) as inner:
        assert_array_equal(tasks.repeated(inner, 3)(GENOTYPES, seeds).observation, expected.observation)
    with evaluate.over(evaluate.processes(1), tasks.repeated(Windy(), 3)) as outer:
        assert_array_equal(outer(GENOTYPES, seeds).observation, expected.observation)


def test_how_repeatable_skills_are(tmp_path):
    auroraqd.save(grown(Windy()), tmp_path)
    repertoire = auroraqd.load(tmp_path)
    again = repertoire.evaluate(Windy(), rows=np.arange(10), times=50)
    assert again.observation.shape == (10, 50, 3)
    assert 0.08 < np.std(again.observation, axis=1).mean() < 0.12
    assert len(np.unique(again.error)) == 500
    assert_array_equal(repertoire.evaluate(Windy(), rows=np.arange(10), times=50).error, again.error)
    assert not np.isin(repertoire.evaluate(Windy(), rows=np.arange(10), times=50, seed=1).error, again.error).any()


def test_mistakes():
    with pytest.raises(TypeError, match="task must be callable, an instance and not a class, got 3"):
        tasks.repeated(3, 2)
    with pytest.raises(ValueError, match="times must be"):
        tasks.repeated(Windy(), 0)

    def unaware(genotypes):
        return genotypes

    unaware.seeded = True
    with pytest.raises(auroraqd.TaskError, match="task unaware at generation 0 raised TypeError"):
        grown(unaware)


def test_skills_are_not_evaluated_with_the_seeds_of_their_run(tmp_path):
    """They would seem to be repeatable."""
    auroraqd.save(auroraqd.Aurora(3, PCA(2), seed=0, batch_size=30).run(Windy(), generations=2), tmp_path)
    assert (auroraqd.load(tmp_path).evaluate(Windy()).error > 0).all()
    assert not np.isin(other_seeds(0, 1000), seeds_of(0, 0, 1000)).any()


def test_seeds_that_are_missing_are_said():
    with pytest.raises(ValueError, match="it is seeded, and needs a seed for each genotype"):
        tasks.repeated(Windy(), 2)(GENOTYPES)

    def forgetful(genotypes, seeds):
        return genotypes

    with pytest.raises(auroraqd.TaskError, match=r"a task that takes them must say so, my_task\.seeded = True"):
        grown(forgetful)
