import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate, tasks

pytest.importorskip("gymnasium")
pytest.importorskip("mujoco")

ROBOTS = {"Ant-v5": 25, "HalfCheetah-v5": 19, "Swimmer-v5": 7}


def forwards(episode):
    """Distance, less energy."""
    return episode.qpos[:, -1, 0] - 1e-3 * (episode.control**2).sum(axis=(1, 2))


@pytest.mark.parametrize(("env_id", "n_genes"), ROBOTS.items())
def test_it_does_what_gymnasium_does(env_id, n_genes):
    """Step by step, in the environment itself."""
    import gymnasium

    task = tasks.Gym(env_id, steps=30, samples=6)
    assert task.n_genes == n_genes
    genotypes = np.random.default_rng(0).random((3, n_genes))
    episode = task.episode(genotypes)
    evaluation = task(genotypes)
    env = gymnasium.make(env_id).unwrapped
    for row in range(3):
        env.reset(seed=0)
        env.set_state(env.init_qpos, env.init_qvel)
        for step in range(30):
            env.step(episode.control[row, step])
            assert_allclose(episode.qpos[row, step], env.data.qpos, atol=1e-9)
            assert_allclose(episode.qvel[row, step], env.data.qvel, atol=1e-7)
            if (step + 1) % 5 == 0:
                assert_allclose(evaluation.observation[row, step // 5], env.data.qpos[:2], atol=1e-9)
    assert_array_equal(evaluation.ground_truth, evaluation.observation[:, -1])
    assert_allclose(episode.time[-1], 30 * env.dt)


def test_threads_and_batches_do_not_matter(monkeypatch):
    genotypes = np.random.default_rng(1).random((7, 7))
    one = tasks.Gym("Swimmer-v5", steps=20, threads=1, fitness=forwards)(genotypes)
    many = tasks.Gym("Swimmer-v5", steps=20, threads=3, fitness=forwards)
    monkeypatch.setattr("auroraqd.tasks.gym._MOST_BYTES", 1)
    for column, expected in zip(many(genotypes), one, strict=True):
        assert_array_equal(column, expected)
    assert len(np.unique(one.fitness)) == 7


def test_sinusoids():
    sines = tasks.Sinusoids(slowest=1, fastest=3, offset=0.25)
    time = np.linspace(0, 1, 9)
    genes = np.array([[0.5, 1.0, 0.0, 0.25, 0.5, 1.0, 0.5]])  # amplitudes, phases, offsets, frequency: 2 Hz
    found = sines(genes, 2, time)[0]
    assert_allclose(found[:, 0], 0.5 * np.sin(4 * np.pi * time), atol=1e-12)
    assert_allclose(found[:, 1], np.clip(np.sin(4 * np.pi * time + np.pi / 2) + 0.25, -1, 1), atol=1e-12)


def test_a_run_and_workers():
    task = tasks.Gym("Swimmer-v5", steps=20, fitness=forwards, positions=(0, 1, 2))
    found = auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=20).run(task, generations=3).archive
    assert found.observation.shape[1:] == (20, 3)
    again = pickle.loads(pickle.dumps(task))
    with evaluate.over(evaluate.processes(1), again) as spread:
        other = auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=20).run(spread, generations=3).archive
    assert_array_equal(other.observation, found.observation)
    assert_array_equal(other.fitness, found.fitness)


def test_a_simulation_that_diverges_is_invalid(monkeypatch):
    from mujoco import rollout

    task, honest = tasks.Gym("Swimmer-v5", steps=10, samples=5), rollout.rollout

    def diverging(*arguments):
        states, sensors = honest(*arguments)
        states[1, 20:] = states[1, 19]  # what MuJoCo does then
        return states, sensors

    monkeypatch.setattr(rollout, "rollout", diverging)
    evaluation = task(np.random.default_rng(0).random((3, 7)))
    assert np.isnan(evaluation.observation).any(axis=(1, 2)).tolist() == [False, True, False]


def test_one_that_really_diverges():
    task = tasks.Gym("Swimmer-v5", steps=10, samples=5)
    task._start[1 + task._env.model.nq :] = 1e12  # velocities
    assert np.isnan(task(np.zeros((2, 7))).observation).any(axis=(1, 2)).all()


def wrong(genotypes, actuators, time):
    return np.zeros((1, 1, 1))


wrong.n_genes = lambda actuators: 7


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tasks.Gym("Ant-v99"), "env_id 'Ant-v99' cannot be made"),
        (lambda: tasks.Gym("CartPole-v1"), "env_id 'CartPole-v1' is not an environment of MuJoCo"),
        (lambda: tasks.Gym("Swimmer-v5", positions=(0, 9)), r"positions must be of 0 to 4 for Swimmer-v5, got \[0, 9\]"),
        (lambda: tasks.Gym("Swimmer-v5", steps=10), "samples must be"),
        (lambda: tasks.Gym("Swimmer-v5", options={"nonsense": 1}), "cannot be made"),
        (lambda: tasks.Gym("Swimmer-v5")(np.zeros((2, 3))), r"genotypes of Swimmer-v5 must have shape \(n, 7\), got \(2, 3\)"),
        (lambda: tasks.Gym("Swimmer-v5", controller=wrong)(np.zeros((2, 7))), r"controller must return shape \(2, 200, 2\)"),
        (lambda: tasks.Gym("Swimmer-v5", fitness=lambda e: 0.0)(np.zeros((2, 7))), r"fitness must return shape \(2,\)"),
        (lambda: tasks.Sinusoids(slowest=2, fastest=1), "fastest must be"),
    ],
)
def test_mistakes(call, message):
    with pytest.raises(ValueError, match=message):
        call()
