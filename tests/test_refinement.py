"""Coming closer to goals than any skill does: the model against closed forms, the search on smooth, jumping and noisy tasks."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate
from auroraqd.refinement import Ruler, slopes, step
from auroraqd.tasks import AirHockey, Ballistic


def saved(folder, task, descriptor, n_genes, generations=10):
    return auroraqd.load(auroraqd.save(auroraqd.Aurora(n_genes, descriptor, seed=0).run(task, generations=generations), folder))


@pytest.fixture(scope="module")
def throws(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("throws") / "run", Ballistic(), PCA(2), 2)


@pytest.fixture(scope="module")
def goals():
    return Ballistic()(np.random.default_rng(1).uniform(0.2, 0.8, (20, 2))).ground_truth


def bent(genotypes):
    """Three genes, two outcomes, smooth."""
    x, y, z = genotypes.T
    return np.zeros(len(x)), np.stack([x + 0.3 * y * z, y - 0.2 * np.sin(3 * z)], axis=1)


def test_slopes_of_a_plane_are_its_own():
    rng = np.random.default_rng(0)
    matrix, genotype = rng.normal(size=(4, 2)), rng.normal(size=(30, 4))
    assert_allclose(slopes(genotype, genotype @ matrix), matrix, atol=0.01)  # but for the ridge


def test_close_rows_weigh_more():
    genotype, outcome = np.array([[0.01], [1.0]]), np.array([[0.02], [5.0]])
    by_hand = (0.01 * 0.02 / (1e-4 + 1e-8) + 5 / (1 + 1e-8)) / (1e-4 / (1e-4 + 1e-8) + 1 / (1 + 1e-8) + 1e-2)
    assert_allclose(slopes(genotype, outcome), [[by_hand]])


def test_a_step_is_the_shortest_that_does_it_within_bounds():
    rng, ones = np.random.default_rng(0), np.ones(3)
    slope = np.array([[1.0], [1.0], [0.0]])
    assert_allclose(step(slope, np.array([0.4]), -ones, ones, 1, rng), [0.2, 0.2, 0])
    assert_allclose(step(slope, np.array([0.4]), -ones, np.array([0.05, 1, 1]), 1, rng), [0.05, 0.35, 0])
    assert_allclose(np.linalg.norm(step(slope, np.array([9.0]), -ones, ones, 0.1, rng)), 0.1)
    somewhere = step(0 * slope, np.array([0.4]), -ones, ones, 0.1, rng)
    assert_allclose(np.linalg.norm(somewhere), 0.1)


def test_lengths_are_root_mean_squares_over_what_is_given():
    outcomes = np.array([[[0.0, 0.0], [2.0, 1.0]], [[1.0, 5.0], [4.0, 10.0]]])  # ranges 4 and 10
    ruler, goal = Ruler.of(outcomes), np.array([1.0, np.nan, 1.0, 6.0])
    apart = np.linalg.norm(ruler.apart(outcomes, goal), axis=1)
    assert_allclose(apart, [np.sqrt((0.25 + 0.25 + 1) / 3), np.sqrt((0 + 2.25 + 0.64) / 3)])


def test_goals_between_throws_are_reached(throws, goals):
    found = throws.refine(Ballistic(), goals, trials=5)
    assert (found.error < found.before).all()
    assert np.median(found.before) > 1000 * np.median(found.error)
    truth = Ballistic()(found.genotype).ground_truth
    assert_array_equal(found.outcome, truth)
    half = np.ptp(throws.ground_truth, axis=0) / 2
    assert_allclose(found.error, np.sqrt((((truth - goals) / half) ** 2).mean(axis=1)), atol=1e-15)
    nearest = np.sqrt((((throws.ground_truth[:, None] - goals) / half) ** 2).mean(axis=2))
    assert_array_equal(found.rows, nearest.argmin(axis=0))
    assert_allclose(found.before, nearest.min(axis=0))
    assert_array_equal(found.trials, 5)
    for one, goal in zip(found.genotype, goals, strict=True):  # alone as in company
        assert_array_equal(throws.refine(Ballistic(), goal[None], trials=5).genotype[0], one)


def test_a_puck_comes_closer_though_contacts_jump(tmp_path):
    hockey = saved(tmp_path / "run", AirHockey(), PCA(2), 8, generations=60)
    ends = AirHockey()(np.random.default_rng(1).random((200, 8))).ground_truth
    goals = ends[np.abs(ends - (0.55, 0.5)).max(axis=1) > 1e-9][:30]
    found = hockey.refine(AirHockey(), goals, trials=10)
    assert np.median(found.before) > 3 * np.median(found.error)
    last = np.full((len(goals), 50, 2), np.nan)
    last[:, -1] = goals
    assert_allclose(hockey.refine(AirHockey(), last, "observation").error, found.error, rtol=1, atol=0.02)


@pytest.mark.parametrize("by", ["observation", "descriptor"])
def test_other_columns(throws, by):
    observation = Ballistic()(np.random.default_rng(1).uniform(0.2, 0.8, (10, 2))).observation
    goals = observation if by == "observation" else throws.describe(observation)
    found = throws.refine(Ballistic(), goals, by)
    assert np.median(found.before) > 100 * np.median(found.error)
    again = Ballistic()(found.genotype).observation
    assert_allclose(found.outcome, again if by == "observation" else throws.describe(again))


def test_streams(tmp_path):
    def two(genotypes):
        _, place = bent(genotypes)
        return {"place": place, "height": np.stack([genotypes[:, 2], 100 * place[:, 0]], axis=1)}

    repertoire = saved(tmp_path / "run", two, PCA(2), 3)
    wanted = {"place": [[0.4, 0.5], [0.6, 0.3]], "height": [[0.5, np.nan], [np.nan, np.nan]]}
    found = repertoire.refine(two, wanted, "observation")
    assert_allclose(found.outcome["place"], wanted["place"], atol=1e-3)
    assert_allclose(found.outcome["height"][0, 0], 0.5, atol=1e-3)
    assert_array_equal(found.before[0], repertoire.reach({"place": [0.4, 0.5], "height": [0.5, np.nan]}).distance[0])
    with pytest.raises(ValueError, match="goals must be a mapping of some of height, place to arrays"):
        repertoire.refine(two, [[0.4, 0.5]], "observation")
    with pytest.raises(ValueError, match="goals must have as many rows in each stream, got 1 and 2"):
        repertoire.refine(two, {"place": [[0.4, 0.5]], "height": [[0.5, 0.1]] * 2}, "observation")
    with pytest.raises(ValueError, match="by must be observation or descriptor, for no ground truth is stored"):
        repertoire.refine(two, [[0.4, 0.5]])


def test_few_trials_where_few_are_enough(throws, goals):
    calls = []

    def counted(genotypes):
        calls.append(len(genotypes))
        return Ballistic()(genotypes)

    found = throws.refine(counted, goals, trials=8, enough=0.001)
    assert (found.error <= 0.001).all()
    assert found.trials.max() == len(calls) < 8
    assert sum(calls) == found.trials.sum()
    stored = throws.refine(counted, throws.ground_truth[:2])
    assert_array_equal(stored.trials, 0)
    assert_array_equal(stored.genotype, throws.genotype[stored.rows])


def test_trials_that_fail_and_tasks_that_change_what_they_are_given(throws, goals):
    def broken(genotypes):
        result = Ballistic()(genotypes)
        genotypes *= 0
        half = result.ground_truth[:, 0] > 0
        result.ground_truth[half], result.observation[half] = np.nan, np.inf
        return result

    for by, wanted in (("ground_truth", goals), ("descriptor", throws.descriptor[::10] + 1e-3)):
        found = throws.refine(broken, wanted, by)
        assert np.isfinite(found.error).all()
        assert (found.error <= found.before).all()
        assert found.genotype.min() >= 0


def test_noise_has_a_seed_for_each_trial(throws, goals):
    seen = []

    def windy(genotypes, seeds):
        seen.extend(seeds.tolist())
        result = Ballistic()(genotypes)
        wind = np.array([np.random.default_rng(seed).normal(0, 0.002, 2) for seed in seeds])
        return result._replace(ground_truth=result.ground_truth + wind)

    windy.seeded = True
    found = throws.refine(windy, goals, seed=3)
    assert len(set(seen)) == len(seen) == found.trials.sum()
    true = np.linalg.norm(Ballistic()(found.genotype).ground_truth - goals, axis=1)
    assert np.median(true) < 0.005 < np.median(np.linalg.norm(throws.ground_truth[found.rows] - goals, axis=1))
    assert_array_equal(throws.refine(windy, goals, seed=3).genotype, found.genotype)


def test_workers_do_the_trials(throws, goals):
    with evaluate.over(lambda: ThreadPoolExecutor(1), Ballistic()) as task:
        assert_array_equal(throws.refine(task, goals, trials=3).error, throws.refine(Ballistic(), goals, trials=3).error)


def test_one_skill_is_a_start(tmp_path):
    aurora = auroraqd.Aurora(3, "hand-coded", seed=0, batch_size=1)
    aurora.ask()
    place = bent(np.full((1, 3), 0.5))[1]
    aurora.tell([0.0], place, place)
    repertoire = auroraqd.load(auroraqd.save(aurora, tmp_path / "run"))
    found = repertoire.refine(lambda g: (*bent(g), bent(g)[1]), place + np.array([0.05, -0.05]), trials=20)
    assert found.error[0] < found.before[0] / 3


def test_goals_that_are_none(throws, goals):
    task = Ballistic()
    for arguments, message in (
        ({"goals": goals[0]}, r"goals must have shape \(n, 2\), as those of the repertoire, got \(2,\)"),
        ({"goals": np.empty((0, 2))}, r"goals must have shape \(n, 2\)"),
        ({"goals": [[np.nan, np.nan]]}, "goals must have finite entries, .* but not NaN alone"),
        ({"goals": [[np.inf, 0]]}, "goals must have finite entries"),
        ({"goals": goals, "by": "fitness"}, "by must be one of ground_truth, observation, descriptor"),
        ({"goals": goals, "trials": 0}, "trials must be a whole number"),
        ({"goals": goals, "k": 0}, "k must be a whole number"),
        ({"goals": goals, "enough": -1}, "enough must be a finite number"),
        ({"goals": goals, "by": "observation", "task": lambda g: g}, r"goals must have shape \(n, 50, 2\)"),
        (
            {"goals": throws.observation[:2] + 1, "by": "observation", "task": lambda g: g},
            r"observation must have shape \(n, 50, 2\), as stored, got",
        ),
        (
            {"goals": goals, "task": lambda g: Ballistic()(g)[:2]},
            "by must be observation or descriptor, for the task does not return ground truth",
        ),
        (
            {"goals": goals, "task": lambda g: (*Ballistic()(g)[:2], g[:, :1])},
            r"ground_truth must have shape \(n, 2\), as stor",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            throws.refine(**{"task": task, **arguments})
    with pytest.raises(auroraqd.TaskError, match="with genotypes that are refined raised OSError: no motor"):
        throws.refine(lambda g: (_ for _ in ()).throw(OSError("no motor")), goals)
    assert len(repr(throws.refine(task, goals, trials=1))) < 400
