import gc
import logging
import pickle
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from ctypes.util import find_library
from functools import partial

import commands
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from scipy.interpolate import pchip_interpolate
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate, tasks
from auroraqd.report import film
from auroraqd.tasks import Camera, _drawing

gymnasium = pytest.importorskip("gymnasium")
mujoco = pytest.importorskip("mujoco")
swimmer = pytest.importorskip("gymnasium.envs.mujoco.swimmer_v5")

ROBOTS = {"Ant-v5": 25, "HalfCheetah-v5": 19, "Swimmer-v5": 7}
SENSING = {  # how many genes an MLP of 4 hidden neurons has, and whether MuJoCo simulates it
    "HalfCheetah-v5": (4 * 18 + 6 * 5, True),
    "Swimmer-v5": (4 * 9 + 2 * 5, True),
    "CartPole-v1": (4 * 5 + 2 * 5, False),
    "Pendulum-v1": (4 * 4 + 1 * 5, False),
    "MountainCarContinuous-v0": (4 * 3 + 1 * 5, False),
}


def made(env_id):
    """As the tests step it by hand."""
    return gymnasium.make(env_id).unwrapped


def genotypes_of(task, n=3, seed=0):
    return np.random.default_rng(seed).random((n, task.n_genes))


def forwards(episode):
    """Distance, less energy."""
    return episode.qpos[:, -1, 0] - 1e-3 * (episode.control**2).sum(axis=(1, 2))


@pytest.mark.parametrize(("env_id", "n_genes"), ROBOTS.items())
def test_it_does_what_gymnasium_does(env_id, n_genes):
    """Step by step, in the environment itself."""
    task = tasks.Gym(env_id, steps=30, samples=6)
    assert task.n_genes == n_genes
    genotypes = genotypes_of(task)
    episode = task.episode(genotypes)
    assert episode.reward is None  # it was MuJoCo's rollout
    evaluation = task(genotypes)
    env = made(env_id)
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


@pytest.mark.parametrize(("env_id", "n_genes", "simulated"), [(name, *facts) for name, facts in SENSING.items()])
def test_a_closed_loop_does_what_gymnasium_does(env_id, n_genes, simulated):
    """What a policy would have seen, and done, one environment after the other, until it terminates."""
    controller = tasks.MLP(hidden=(4,), weight=3)
    task = tasks.Gym(env_id, controller=controller, steps=40, samples=8, fitness="return")
    assert task.n_genes == n_genes
    genotypes = genotypes_of(task)
    evaluation, episode = task(genotypes), task.episode(genotypes)
    env = made(env_id)
    for row in range(3):
        sensed, _ = env.reset(seed=0)
        if simulated:
            mujoco.mj_resetData(env.model, env.data)
            env.set_state(env.init_qpos, env.init_qvel)
            sensed = env._get_obs()
        policy, total = controller.policy(genotypes[row : row + 1], len(sensed), task._environments.actuators), 0.0
        seen = []
        for step in range(40):
            control = policy(np.asarray(sensed, np.float64)[None])[0]
            discrete = env_id == "CartPole-v1"
            action = control.argmax() if discrete else (control * env.action_space.high).astype(np.float32)
            assert_allclose(action, episode.control[row, step], atol=1e-6)
            sensed, reward, terminated, _, _ = env.step(action)
            total += reward
            seen.append(env.data.qpos[:2].copy() if simulated else sensed.copy())
            if terminated:
                break
        assert episode.length[row] == len(seen)
        seen += [seen[-1]] * (40 - len(seen))
        assert_allclose(evaluation.observation[row], seen[4::5], atol=1e-5)
        assert_allclose(evaluation.fitness[row], total, atol=1e-4)


def test_both_ways_to_simulate_agree():
    rolled = tasks.Gym("HalfCheetah-v5", steps=25, samples=5)
    stepped = tasks.Gym("HalfCheetah-v5", steps=25, samples=5, fitness="return")
    genotypes = genotypes_of(rolled)
    one, other = rolled.episode(genotypes), stepped.episode(genotypes)
    assert one.reward is None
    assert other.reward.shape == (3, 25)
    assert_array_equal(one.control, other.control)
    assert_allclose(one.qpos, other.qpos, atol=1e-9)
    assert_allclose(one.qvel, other.qvel, atol=1e-7)
    assert_array_equal(one.time, other.time)
    assert_allclose(stepped(genotypes).fitness, other.reward.sum(axis=1))


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("limit", ["_MOST_BYTES", "_SIDE_BY_SIDE"])
def test_threads_and_batches_do_not_matter(monkeypatch, limit, noisy):
    controller = tasks.MLP() if limit == "_SIDE_BY_SIDE" else tasks.Sinusoids()
    one = tasks.Gym("Swimmer-v5", controller=controller, steps=20, threads=1, fitness=forwards, noisy=noisy)
    genotypes, seeds = genotypes_of(one, 7), (np.arange(7, dtype=np.uint64),) if noisy else ()
    expected = one(genotypes, *seeds)
    many = tasks.Gym("Swimmer-v5", controller=controller, steps=20, threads=3, fitness=forwards, noisy=noisy)
    monkeypatch.setattr(f"auroraqd.tasks.gym.{limit}", 1)
    for column, wanted in zip(many(genotypes, *seeds), expected, strict=True):
        assert_array_equal(column, wanted)
    assert len(np.unique(expected.fitness)) == 7
    assert_array_equal(many(genotypes[3:5], *(column[3:5] for column in seeds)).observation, expected.observation[3:5])


def test_threads_may_share_a_task():
    task = tasks.Gym("HalfCheetah-v5", controller=tasks.MLP(hidden=(4,)), steps=20)
    genotypes = genotypes_of(task, 8)
    expected = task(genotypes).observation
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(task, [genotypes] * 8):
            assert_array_equal(found.observation, expected)


@pytest.mark.parametrize(
    ("env_id", "controller"),
    [
        ("Swimmer-v5", tasks.Sinusoids()),
        ("Ant-v5", tasks.Splines()),
        ("HalfCheetah-v5", tasks.MLP()),
        ("Pendulum-v1", tasks.MLP()),
    ],
)
def test_noise_is_that_of_the_environment(env_id, controller):
    task = tasks.Gym(env_id, controller=controller, steps=20, noisy=True)
    assert task.seeded
    genotypes = np.tile(genotypes_of(task, 1), (3, 1))
    seeds = np.array([5, 2**63 + 6, 5], np.uint64)  # environments take seeds of 31 bits
    episode, evaluation = task.episode(genotypes, seeds), task(genotypes, seeds)
    assert_array_equal(evaluation.observation[0], evaluation.observation[2])
    assert not np.allclose(evaluation.observation[0], evaluation.observation[1], rtol=0, atol=1e-4)
    env = made(env_id)
    for row, seed in enumerate((5, 6)):
        env.reset(seed=seed)
        for action in episode.control[row]:
            sensed, *_ = env.step(action)
        place = env.data.qpos[:2] if task.model is not None else sensed
        assert_allclose(evaluation.ground_truth[row], place, atol=1e-8)


@pytest.mark.parametrize(
    ("env_id", "options"), [("Ant-v5", {"healthy_z_range": (0.45, 1.0)}), ("Humanoid-v5", {}), ("HalfCheetah-v5", {})]
)
def test_threads_that_step_environments_find_the_same(env_id, options):
    """Bit for bit; some robots fall before the others."""
    settings = {"env_id": env_id, "controller": tasks.MLP(hidden=(4,), weight=3), "steps": 30, "options": options}
    one, many = (tasks.Gym(**settings, noisy=True, threads=threads) for threads in (1, 3))
    genotypes, seeds = genotypes_of(one, 7), np.arange(7)
    expected, found = one.episode(genotypes, seeds), many.episode(genotypes, seeds)
    for name, wanted in expected._asdict().items():
        if wanted is not None:
            assert_array_equal(getattr(found, name), wanted, err_msg=name)
    assert found.reward is not None
    if options:
        assert 1 < len(np.unique(expected.length)) < 7


class Who(swimmer.SwimmerEnv):
    """Notes which threads step."""

    who = set()

    def step(self, action):
        Who.who.add(threading.get_ident())
        time.sleep(0.001)  # long enough for others to begin
        return super().step(action)


@pytest.mark.parametrize(("threads", "most"), [(None, 1), (1, 1), (3, 3)])
def test_environments_of_ones_own_get_threads_when_asked(threads, most):
    gymnasium.register("Who-v0", entry_point=Who)
    try:
        task = tasks.Gym("Who-v0", controller=tasks.MLP(), steps=20, threads=threads)
        Who.who.clear()
        task(genotypes_of(task, 6))
    finally:
        del gymnasium.registry["Who-v0"]
    assert len(Who.who) == most
    assert (threading.get_ident() in Who.who) == (most == 1)


def test_who_gets_threads_by_default(monkeypatch):
    """Gymnasium's own of MuJoCo, unless others wrap them."""

    class Wrapped(gymnasium.Wrapper):
        pass

    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr("auroraqd.tasks._episodes.cores", lambda: [0, 1, 2])
    gymnasium.register("Wrapped-v0", entry_point=lambda **options: Wrapped(swimmer.SwimmerEnv(**options)))
    try:
        found = {name: tasks.Gym(name, steps=20)._threads for name in ("Swimmer-v5", "CartPole-v1", "Wrapped-v0")}
    finally:
        del gymnasium.registry["Wrapped-v0"]
    assert found == {"Swimmer-v5": 3, "CartPole-v1": 1, "Wrapped-v0": 1}


@pytest.mark.parametrize("threads", [1, 3])
def test_a_step_that_raises_is_heard_of(threads):
    class Raises(swimmer.SwimmerEnv):
        def step(self, action):
            raise OSError("no motors")

    gymnasium.register("Raises-v0", entry_point=Raises)
    try:
        task = tasks.Gym("Raises-v0", controller=tasks.MLP(), steps=20, threads=threads)
        with pytest.raises(OSError, match="no motors"):
            task(genotypes_of(task, 6))
    finally:
        del gymnasium.registry["Raises-v0"]


def test_an_observation_of_another_size_is_said():
    class Longer(swimmer.SwimmerEnv):
        def step(self, action):
            sensed, *others = super().step(action)
            return np.append(sensed, 0.0), *others

    gymnasium.register("Longer-v0", entry_point=Longer)
    try:
        task = tasks.Gym("Longer-v0", controller=tasks.MLP(), steps=20)
        with pytest.raises(
            ValueError, match=r"observations of Longer-v0 must be 8 numbers, as its observation_space .*, got 9"
        ):
            task(genotypes_of(task))
    finally:
        del gymnasium.registry["Longer-v0"]


def test_without_noise_there_are_no_seeds():
    task = tasks.Gym("CartPole-v1", steps=20)
    assert not task.seeded
    genotypes = np.tile(genotypes_of(task, 1), (2, 1))
    assert_array_equal(*task(genotypes).observation)


def test_an_episode_ends_when_the_environment_says_so():
    """A pole that is always pushed to one side falls; nothing happens after that."""
    task = tasks.Gym("CartPole-v1", controller=tasks.Splines(2), steps=60, samples=60, fitness="return")
    genotypes = np.array([[0, 0, 1, 1], [1, 1, 0, 0]])  # the second action, the first
    episode, evaluation = task.episode(genotypes), task(genotypes)
    assert ((episode.length > 5) & (episode.length < 15)).all()
    assert_array_equal(evaluation.fitness, episode.length)
    for row, (length, pushed) in enumerate(zip(episode.length, (1, 0), strict=True)):
        assert (episode.control[row, :length] == pushed).all()
        assert len(np.unique(evaluation.observation[row, : length - 1], axis=0)) == length - 1
        assert_array_equal(evaluation.observation[row, length:], evaluation.observation[row, [length - 1] * (60 - length)])
        assert not episode.control[row, length:].any()
        assert not episode.reward[row, length:].any()


def test_a_robot_that_falls_ends_its_episode_where_the_environment_steps():
    options = {"healthy_z_range": (0.5, 1.0)}
    task = tasks.Gym("Ant-v5", steps=60, fitness="return", options=options)
    genotypes = genotypes_of(task, 4)
    length = task.episode(genotypes).length
    assert (length < 60).any()
    height = task.episode(genotypes).qpos[np.arange(4), length - 1, 2]
    assert_array_equal((height < 0.5) | (height > 1), length < 60)
    without = tasks.Gym("Ant-v5", steps=60, fitness="return", options={**options, "terminate_when_unhealthy": False})
    assert (without.episode(genotypes).length == 60).all()
    assert (tasks.Gym("Ant-v5", steps=60, options=options).episode(genotypes).length == 60).all()  # MuJoCo's rollout


def test_the_limit_of_the_environment_does_not_count():
    assert tasks.Gym("Pendulum-v1", steps=210).episode(np.full((1, 4), 0.5)).length == [210]  # it has one of 200


def test_entries_of_the_environments_observation():
    task = tasks.Gym("Swimmer-v5", steps=20, samples=5, observe=(0, 3, 7))
    genotypes = genotypes_of(task)
    episode = task.episode(genotypes)
    assert_array_equal(task(genotypes).observation, episode.observation[:, 3::4][..., [0, 3, 7]])
    assert_allclose(episode.observation[..., :3], episode.qpos[..., 2:], atol=1e-12)  # what this environment leaves out
    assert tasks.Gym("CartPole-v1", steps=20)(np.zeros((2, 7))).observation.shape == (2, 20, 4)


def break_a_motor(model):
    model.actuator_gear[1] = 0


@pytest.mark.parametrize("controller", [tasks.Sinusoids(), tasks.MLP()])
def test_a_damaged_robot(controller):
    task = tasks.Gym("Swimmer-v5", controller=controller, steps=20, modify=break_a_motor)
    sound = tasks.Gym("Swimmer-v5", controller=controller, steps=20)
    genotypes = genotypes_of(task, 20)  # more than are stepped side by side at first
    evaluation = task(genotypes)
    assert (np.abs(evaluation.observation - sound(genotypes).observation).max(axis=(1, 2)) > 1e-6).all()
    assert_array_equal(pickle.loads(pickle.dumps(task))(genotypes).observation, evaluation.observation)
    episode, env = task.episode(genotypes), made("Swimmer-v5")
    break_a_motor(env.model)
    env.reset(seed=0)
    env.set_state(env.init_qpos, env.init_qvel)
    for action in episode.control[-1]:
        env.step(action)
    assert_allclose(episode.qpos[-1, -1], env.data.qpos, atol=1e-9)


class Weak(swimmer.SwimmerEnv):
    """Its step is not only that of MuJoCo."""

    def step(self, action):
        return super().step(action / 2)


@pytest.fixture
def weak():
    gymnasium.register("Weak-v0", entry_point=Weak)
    yield "Weak-v0"
    del gymnasium.registry["Weak-v0"]


def test_an_environment_that_does_more_than_the_rollout_is_stepped(weak):
    task = tasks.Gym(weak, steps=20)
    genotypes = genotypes_of(task)
    episode = task.episode(genotypes)
    assert episode.reward is not None
    env = made("Swimmer-v5")
    env.reset(seed=0)
    env.set_state(env.init_qpos, env.init_qvel)
    for action in episode.control[0]:
        env.step(action / 2)
    assert_allclose(episode.qpos[0, -1], env.data.qpos, atol=1e-9)


def test_sinusoids():
    sines = tasks.Sinusoids(slowest=1, fastest=3, offset=0.25)
    time = np.linspace(0, 1, 9)
    genes = np.array([[0.5, 1.0, 0.0, 0.25, 0.5, 1.0, 0.5]])  # amplitudes, phases, offsets, frequency: 2 Hz
    found = sines(genes, 2, time)[0]
    assert_allclose(found[:, 0], 0.5 * np.sin(4 * np.pi * time), atol=1e-12)
    assert_allclose(found[:, 1], np.clip(np.sin(4 * np.pi * time + np.pi / 2) + 0.25, -1, 1), atol=1e-12)


def test_splines():
    splines, genes = tasks.Splines(knots=4), np.random.default_rng(0).random((3, 8))
    found = splines(genes, 2, np.arange(31) * 0.05)
    assert found.shape == (3, 31, 2)
    assert np.abs(found).max() <= 1
    for row in range(3):
        for actuator, knots in enumerate(np.split(2 * genes[row] - 1, 2)):
            assert_allclose(found[row, ::10, actuator], knots, atol=1e-12)
            wanted = pchip_interpolate(np.arange(4), knots, np.linspace(0, 3, 31))
            assert_allclose(found[row, :, actuator], wanted, atol=1e-12)
    assert splines(genes, 2, np.zeros(1)).shape == (3, 1, 2)
    broken = np.where(np.arange(8) == 5, [[np.inf], [0.5], [np.nan]], genes)
    assert np.isnan(splines(broken, 2, np.arange(3))).all(axis=(1, 2)).tolist() == [True, False, True]


def test_mlp_by_hand():
    mlp = tasks.MLP(hidden=(2,), weight=2, scale=(1, 4, 10))
    genes = np.random.default_rng(0).random((2, mlp.n_genes(3, 1)))
    sensed = np.array([[1.0, -4.0, 0.0], [1e9, 4.0, -1e9]])
    found = mlp.policy(genes, 3, 1)(sensed)
    inputs = np.array([[0.5, -0.5, 0.0], [1.0, 0.5, -1.0]])
    for row in range(2):
        first, last = np.split(4 * genes[row] - 2, [8])
        first, last = first.reshape(4, 2), last.reshape(3, 1)
        hidden = np.tanh(inputs[row] @ first[:3] + first[3])
        assert_allclose(found[row], np.tanh(hidden @ last[:2] + last[2]), atol=1e-7)
    assert tasks.MLP(hidden=()).n_genes(3, 2) == 8


class Remembers:
    """A closed-loop controller of one's own, that is sent to and fro by its own clock."""

    def n_genes(self, observations, actuators):
        return observations

    def policy(self, genotypes, observations, actuators):
        before = []

        def act(sensed):
            before.append(sensed)
            assert sensed.shape == (len(genotypes), observations)
            assert len(before) < 2 or not np.array_equal(before[-1], before[-2])
            return np.full((len(genotypes), actuators), 1 if len(before) % 2 else -1)

        return act


def test_a_controller_of_ones_own_may_remember():
    task = tasks.Gym("Pendulum-v1", controller=Remembers(), steps=6, samples=6)
    assert task.n_genes == 3
    assert task.episode(np.zeros((2, 3))).control[1, :, 0].tolist() == [2, -2] * 3


@pytest.mark.parametrize(
    "task",
    [
        tasks.Gym("Swimmer-v5", steps=20, fitness=forwards, positions=(0, 1, 2)),
        tasks.Gym("Pendulum-v1", controller=tasks.MLP(hidden=(4,)), steps=20, fitness="return"),
    ],
    ids=["rollout", "stepped"],
)
def test_a_run_and_workers(task):
    found = auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=20).run(task, generations=3).archive
    assert found.observation.shape[1:] == (20, 3)
    again = pickle.loads(pickle.dumps(task))
    with evaluate.over(evaluate.processes(1), again) as spread:
        other = auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=20).run(spread, generations=3).archive
    assert_array_equal(other.observation, found.observation)
    assert_array_equal(other.fitness, found.fitness)


def fling(model):
    """A robot as light as nothing and as strong as anything."""
    model.actuator_gear[:] = 1e14


@pytest.mark.parametrize(("fitness", "threads"), [(None, None), ("return", 1), ("return", 3)])
def test_a_simulation_that_diverges_is_invalid_and_writes_no_file(fitness, threads, tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("auroraqd.tasks._environments._said", set())
    settings = {"steps": 10, "samples": 5, "fitness": fitness, "modify": fling, "threads": threads}
    task = tasks.Gym("Swimmer-v5", controller=tasks.Splines(2), **settings)
    genotypes = np.full((40, 4), 0.5)  # no force
    genotypes[1::2] = 1
    with caplog.at_level(logging.WARNING, "auroraqd"):
        evaluation = task(genotypes)
    invalid = np.isnan(evaluation.observation).any(axis=(1, 2))
    assert invalid.tolist() == [False, True] * 20
    assert list(tmp_path.iterdir()) == []
    said = [record.getMessage() for record in caplog.records if "unstable" in record.getMessage()]
    assert 1 <= len(said) <= 3  # of position, velocity or acceleration
    assert not any("controller" in record.getMessage() for record in caplog.records)
    if fitness == "return":
        assert_array_equal(np.isnan(evaluation.fitness), invalid)


@pytest.mark.parametrize("fitness", [None, "return"])
def test_a_controller_that_returns_a_nan_is_invalid(fitness, monkeypatch, caplog):
    monkeypatch.setattr("auroraqd.tasks._environments._said", set())

    class Broken(tasks.Splines):
        def __call__(self, genotypes, actuators, time):
            controls = super().__call__(genotypes, actuators, time)
            controls[1, 7:] = np.nan
            return controls

    task = tasks.Gym("Swimmer-v5", controller=Broken(), steps=10, samples=10, fitness=fitness)
    with caplog.at_level(logging.WARNING, "auroraqd"):
        evaluation = task(genotypes_of(task))
    assert np.isnan(evaluation.observation).all(axis=2).sum(axis=1).tolist() == [0, 3, 0]
    said = [record.getMessage() for record in caplog.records]
    assert said == [
        "the controller of Swimmer-v5 returned NaN or infinity: individuals for which it does are invalid (said once)"
    ]


def test_a_policy_that_senses_what_is_left_of_an_explosion_is_not_blamed(monkeypatch, caplog):
    monkeypatch.setattr("auroraqd.tasks._environments._said", set())
    task = tasks.Gym("Swimmer-v5", controller=tasks.MLP(), steps=10, samples=5, modify=fling)
    genotypes = np.full((2, task.n_genes), 0.5)  # no force
    genotypes[1] = 1
    with caplog.at_level(logging.WARNING, "auroraqd"):
        assert np.isnan(task(genotypes).fitness).tolist() == [False, True]
    assert not any("controller" in record.getMessage() for record in caplog.records)


@pytest.mark.parametrize("threads", [1, 3])
def test_a_policy_that_returns_a_nan_is_invalid(threads):
    class Broken(tasks.MLP):
        def policy(self, genotypes, observations, actuators):
            act, steps = super().policy(genotypes, observations, actuators), iter(range(10))

            def until_the_seventh(sensed):
                broken = (np.arange(len(sensed)) == 1) & (next(steps) >= 7)
                return np.where(broken[:, None], np.nan, act(sensed))

            return until_the_seventh

    task = tasks.Gym("Swimmer-v5", controller=Broken(), steps=10, samples=10, fitness="return", threads=threads)
    genotypes = genotypes_of(task)
    fitness, observation, _ = task(genotypes)
    assert np.isnan(observation).all(axis=2).sum(axis=1).tolist() == [0, 3, 0]
    assert np.isnan(fitness).tolist() == [False, True, False]
    whole = tasks.Gym("Swimmer-v5", controller=tasks.MLP(), steps=10, samples=10)(genotypes)
    assert_array_equal(observation[[0, 2]], whole.observation[[0, 2]])


LIBRARY = (find_library("EGL") and (find_library("OpenGL") or find_library("GL"))) or find_library("OSMesa")
needs_a_library = pytest.mark.skipif(not LIBRARY, reason="there is neither EGL with OpenGL nor OSMesa")


@needs_a_library
def test_a_film(tmp_path):
    """It stands still: only the robot, and the line that it leaves, change."""
    task = tasks.Gym("Swimmer-v5", steps=8, samples=4)
    done = []
    film(task, genotypes_of(task, 2), tmp_path / "a.gif", names=["one", "other"], listener=lambda *d: done.append(d))
    with Image.open(tmp_path / "a.gif") as image:
        assert image.size == (640, 260)
        assert image.info["duration"] == 40  # ms, a step of control
        frames = []
        for frame in range(8):
            image.seek(frame)
            frames.append(np.asarray(image.convert("RGB"), int)[20:])
    changed = np.abs(frames[-1] - frames[0]).max(axis=2) > 60
    assert 100 < changed[:, :320].sum() < 20_000
    assert 100 < changed[:, 320:].sum() < 20_000
    assert not changed[0].any()
    assert frames[0].std() > 10
    assert done[-1] == (32, 33)  # and a second of the last
    film(task, genotypes_of(task, 1), tmp_path / "a.mp4")
    assert (tmp_path / "a.mp4").stat().st_size > 1000


@needs_a_library
def test_a_film_of_a_noisy_robot_in_a_plane(tmp_path):
    task = tasks.Gym("HalfCheetah-v5", controller=tasks.MLP(hidden=()), steps=4, samples=2, noisy=True)
    film(task, genotypes_of(task, 1), tmp_path / "a.gif", seeds=np.zeros(1, int))
    assert (tmp_path / "a.gif").exists()


@needs_a_library
def test_films_from_the_command_line(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from auroraqd.tasks import Gym\nswimmer = Gym('Swimmer-v5', steps=8, samples=4, positions=(0, 1, 2), noisy=True)\n"
    )

    command = partial(commands.cli, cwd=tmp_path)

    done = command("run", "mine:swimmer", "-n", "3", "--batch-size", "20", "--out", "run")
    assert done.returncode == 0, done.stderr
    done = command("animate", "run", "--skill", "2")
    assert done.returncode == 0, done.stderr
    with Image.open(tmp_path / "run" / "figures" / "skill-2.gif") as image:
        assert image.size == (320, 260)
        assert image.n_frames >= 8
    assert "skill must be a row of the repertoire" in command("animate", "run", "--skill", "99999").stderr
    (tmp_path / "mine.py").unlink()  # then there are trajectories, and these are not in a plane
    assert "skills must be trajectories in the plane" in command("animate", "run").stderr


def test_no_library_to_draw_with_is_said(tmp_path, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(_drawing, "find_library", lambda name: None)
    task = tasks.Gym("Swimmer-v5", steps=4, samples=2)
    with pytest.raises(ValueError, match="there is no library to draw robots with: install EGL or OSMesa"):
        film(task, genotypes_of(task), tmp_path / "a.gif")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="there is no library to draw robots with: install EGL or OSMesa"):
        tasks.Gym("Swimmer-v5", observe="camera")


def filmed(**settings):
    task = tasks.Gym(**{"env_id": "Swimmer-v5", "steps": 4, "samples": 2, **settings})
    film(task, np.ones((2, task.n_genes)), "nowhere.gif", names=["one"])


def bodiless(model):
    """All that there is to see belongs to the ground."""
    model.geom_bodyid[:] = 0


def wrong(genotypes, actuators, time):
    return np.zeros((1, 1, 1))


wrong.n_genes = lambda actuators: 7


def worded(genotypes, actuators, time):
    return "go"


worded.n_genes = wrong.n_genes


class NotOfGenes(tasks.Splines):
    def n_genes(self, actuators):
        return "many"


class Speechless(Remembers):
    def policy(self, genotypes, observations, actuators):
        return None


class WrongPolicy(Remembers):
    def policy(self, genotypes, observations, actuators):
        return lambda sensed: np.zeros(3)


ZEROS = np.zeros((2, 7))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tasks.Gym("Ant-v99"), "env_id 'Ant-v99' cannot be made"),
        (lambda: tasks.Gym("nowhere:Ant-v5"), "env_id 'nowhere:Ant-v5' cannot be made"),
        (lambda: tasks.Gym("CartPole-v1", positions=(0,)), "env_id 'CartPole-v1' is not an environment of MuJoCo: choose"),
        (lambda: tasks.Gym("CartPole-v1", modify=print), "modify changes a model of MuJoCo, and env_id 'CartPole-v1' has none"),
        (lambda: tasks.Gym("CartPole-v1", observe=(4,)), r"observe must be of 0 to 3 for CartPole-v1, got \[4\]"),
        (lambda: tasks.Gym("Swimmer-v5", positions=(0,), observe=(0,)), "positions and observe are two ways"),
        (lambda: tasks.Gym("Swimmer-v5", positions=(0, 9)), r"positions must be of 0 to 4 for Swimmer-v5, got \[0, 9\]"),
        (lambda: tasks.Gym("Swimmer-v5", positions=()), r"positions must be of 0 to 4 for Swimmer-v5, got \[\]"),
        (lambda: tasks.Gym("Swimmer-v5", steps=10), "samples must be"),
        (
            lambda: tasks.Gym("Swimmer-v5", fitness="reward"),
            'fitness must be a function of an Episode, "return" or None, got \'rew',
        ),
        (lambda: tasks.Gym("Swimmer-v5", options={"nonsense": 1}), "cannot be made"),
        (lambda: tasks.Gym("Swimmer-v5", controller=3), "controller must have a method n_genes, and be callable .* got 3"),
        (lambda: tasks.Gym("Swimmer-v5")(np.zeros((2, 3))), r"genotypes of Swimmer-v5 must have shape \(n, 7\), got \(2, 3\)"),
        (lambda: tasks.Gym("Swimmer-v5")(ZEROS[:0]), "there must be at least one genotype"),
        (lambda: tasks.Gym("Swimmer-v5")(ZEROS, np.arange(2)), "seeds are for noisy=True"),
        (lambda: tasks.Gym("Swimmer-v5", noisy=True)(ZEROS), r"seeds of Swimmer-v5, .* must have shape \(2,\), got None"),
        (lambda: tasks.Gym("Swimmer-v5", noisy=True)(ZEROS, np.arange(3)), r"must have shape \(2,\), got shape \(3,\)"),
        (
            lambda: tasks.Gym("Swimmer-v5", noisy=True)(ZEROS, [0.5, 1.0]),
            "seeds of Swimmer-v5, which is noisy, must be whole numbers, got float 0.5",
        ),
        (lambda: tasks.Gym("Swimmer-v5")("fast"), r"genotypes of Swimmer-v5 must be numbers of shape \(n, 7\), got 'fast'"),
        (lambda: tasks.Gym("Swimmer-v5", fitness=lambda e: "x")(ZEROS), "what fitness returns must be numbers, got 'x'$"),
        (
            lambda: tasks.Gym("CartPole-v1", fitness=lambda e: e.qpos[:, -1, 0])(ZEROS),
            "fitness raised TypeError: .*; an episode of CartPole-v1 has no qpos and no qvel here$",
        ),
        (lambda: filmed(modify=bodiless), "task Swimmer-v5 has nothing to film: no body that moves has a geom"),
        (lambda: film(5, ZEROS, "nowhere.gif"), "task int is not of MuJoCo"),
        (lambda: tasks.Gym("Swimmer-v5", controller=wrong)(ZEROS), r"controller must return shape \(2, 200, 2\)"),
        (
            lambda: tasks.Gym("Pendulum-v1", controller=WrongPolicy())(np.zeros((2, 3))),
            r"controller must return shape \(2, 1\), got \(3,\)",
        ),
        (lambda: tasks.Gym("Swimmer-v5", fitness=lambda e: 0.0)(ZEROS), r"fitness must return shape \(2,\)"),
        (lambda: tasks.Sinusoids(slowest=2, fastest=1), "fastest must be"),
        (lambda: tasks.Splines(knots=1), "knots must be a whole number, from 2 to 1000000, got 1"),
        (lambda: tasks.MLP(hidden=(0,)), "hidden must be a whole number"),
        (lambda: tasks.MLP(scale=(1, 0)), "scale must be more than 0"),
        (lambda: tasks.MLP(scale=(1, 1)).policy(np.zeros((1, 100)), 3, 1), "scale must have 3 entries"),
        (
            lambda: tasks.Gym("Swimmer-v5", controller=NotOfGenes()),
            "n_genes of the controller must be a whole number, .* 'many'",
        ),
        (lambda: tasks.Gym("Swimmer-v5", controller=worded)(ZEROS), "controls must be numbers, got 'go'"),
        (
            lambda: tasks.Gym("Pendulum-v1", controller=Speechless())(np.zeros((2, 3))),
            "the policy of the controller must be a function of what is sensed, got None",
        ),
        (lambda: tasks.Gym("Swimmer-v5", options={"frame_skip": 0}), "env_id 'Swimmer-v5' cannot be made: float division"),
        (
            lambda: film(tasks.Gym("Swimmer-v5"), None, "nowhere.gif"),
            r"genotypes must be numbers of shape \(n, n_genes\), got N",
        ),
        (
            lambda: film(tasks.Gym("Swimmer-v5"), ZEROS[:0], "nowhere.gif"),
            r"genotypes must have shape .* one row, got \(0, 7\)",
        ),
        (lambda: film(tasks.Gym("Swimmer-v5"), ZEROS, "nowhere.gif", names="ab"), "names must be 2, .*, got 'ab'"),
        (lambda: film(tasks.Gym("Swimmer-v5"), ZEROS, "nowhere.gif", names=2), "names must be 2, .*, got 2"),
        (lambda: filmed(), "names must be 2, one for each genotype, got 1"),
        (lambda: filmed(env_id="CartPole-v1"), "task CartPole-v1 is not of MuJoCo"),
        (lambda: tasks.Gym("Swimmer-v5", positions=[0.5]), "positions must be whole numbers, got"),
        (lambda: tasks.Gym("Swimmer-v5", positions=3), r"positions must have shape \(n,\)"),
        (lambda: tasks.Gym("Swimmer-v5", modify=5), "modify must be a function"),
        (lambda: tasks.Gym("Swimmer-v5", modify=lambda model: 1 / 0), "modify raised ZeroDivisionError for Swimmer-v5"),
        (lambda: tasks.Gym("Swimmer-v5", controller=tasks.Sinusoids), "controller must have a method n_genes"),
        (lambda: tasks.Gym("Swimmer-v5", fitness=np.zeros(3)), "fitness must be a function of an Episode"),
        (lambda: tasks.MLP(hidden=5), "hidden must be the neurons of each layer"),
        (lambda: tasks.MLP(scale="far"), "scale must be numbers, got 'far'"),
        (lambda: tasks.Gym("Swimmer-v5", options=None), "options must be a dictionary, .*, got None"),
        (lambda: tasks.Gym("Swimmer-v5", noisy="no"), "noisy must be True or False, got 'no'"),
        (
            lambda: tasks.Gym("Swimmer-v5", observe=[[0], [0, 1]]),
            r"observe must be numbers with rows of one shape",
        ),
    ],
)
def test_mistakes(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    "fitness",
    [
        lambda episode: episode.reward.sum(axis=1),
        lambda episode: episode.reward[:, -1],
        lambda episode: np.sum(episode.reward, axis=1),
        lambda episode: np.sum(episode.reward),
        lambda episode: episode.observation[:, -1, 0],
    ],
)
def test_a_fitness_that_reads_what_the_rollout_does_not_know(fitness):
    message = 'no observation and no reward here, for MuJoCo\'s .*: write fitness="return" .*, or options='
    with pytest.raises(ValueError, match=message):
        tasks.Gym("Swimmer-v5", steps=20, fitness=fitness)(ZEROS)


def test_a_fitness_may_read_them_where_the_environment_is_stepped():
    """As the message says."""
    settings = {"env_id": "Swimmer-v5", "steps": 20}
    task = tasks.Gym(**settings, fitness=lambda episode: episode.reward.sum(axis=1), options={"max_episode_steps": 20})
    genotypes = genotypes_of(task)
    assert_allclose(task(genotypes).fitness, tasks.Gym(**settings, fitness="return")(genotypes).fitness)


@pytest.mark.parametrize("env_id", ["Swimmer-v5", "CartPole-v1"])
def test_windows_without_a_display(env_id, monkeypatch):
    """Those of MuJoCo would end the process when they cannot be opened."""
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    options = {"render_mode": "human"}
    with pytest.raises(ValueError, match=f"options of {env_id} must leave render_mode out, .* there is no display"):
        tasks.Gym(env_id, steps=20, options=options)
    assert tasks.Gym(env_id, steps=20, options={"render_mode": "rgb_array"})(ZEROS).fitness.shape == (2,)
    monkeypatch.setenv("DISPLAY", ":0")
    assert tasks.Gym(env_id, steps=20, observe=(0,), options=options).options == options  # where it is, nothing is opened yet


def test_spaces_that_are_no_use():
    class Odd(gymnasium.Env):
        metadata = {"render_modes": []}
        observation_space = gymnasium.spaces.Sequence(gymnasium.spaces.Discrete(2))
        action_space = gymnasium.spaces.Discrete(2)

    class Unbounded(Odd):
        action_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,))

    class Motionless(Odd):
        observation_space = gymnasium.spaces.Box(-1, 1, (2,))
        action_space = gymnasium.spaces.Box(0, 0, (2,))

    for env_id, entry_point, message in (
        ("Motionless-v0", Motionless, "actions of Motionless-v0 must have a range to move in"),
        ("Odd-v0", Odd, "observations of Odd-v0 are not always as many numbers"),
        ("Unbounded-v0", Unbounded, "actions of Unbounded-v0 must be discrete, or numbers with bounds, got Box"),
    ):
        gymnasium.register(env_id, entry_point=entry_point)
        try:
            with pytest.raises(ValueError, match=message):
                tasks.Gym(env_id, controller=tasks.MLP())
        finally:
            del gymnasium.registry[env_id]


class Seeing(gymnasium.Env):
    """A point that is moved, what it sees, and which of three rooms it is in; beyond 0.9 its sensor breaks."""

    metadata = {"render_modes": []}
    action_space = gymnasium.spaces.Box(-1, 1, (2,))
    observation_space = gymnasium.spaces.Dict(
        place=gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32),
        camera=gymnasium.spaces.Box(0, 255, (4, 4, 3), np.uint8),
        room=gymnasium.spaces.Discrete(3),
    )

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = np.zeros(2, np.float32)
        return self.sensed(), {}

    def step(self, action):
        self.place = (self.place + 0.1 * action).astype(np.float32)
        return self.sensed(), 0.0, False, False, {}

    def sensed(self):
        camera = np.full((4, 4, 3), 100 + np.clip(100 * self.place[0], -100, 100), np.uint8)
        place = np.where(np.abs(self.place) > 0.9, np.nan, self.place)
        return {"place": place, "camera": camera, "room": int(np.digitize(self.place[0], [-0.3, 0.3]))}


@pytest.fixture
def seeing():
    gymnasium.register("Seeing-v0", entry_point=Seeing)
    yield "Seeing-v0"
    del gymnasium.registry["Seeing-v0"]


def test_an_observation_that_is_a_dict_gives_streams(seeing, tmp_path):
    task = tasks.Gym(seeing, controller=tasks.Splines(2), steps=10, samples=5)
    genotypes = np.array([[0.6, 0.8, 0.5, 0.5], [0.2, 0.2, 0.3, 0.6], [1.0, 1.0, 0.5, 0.5]])
    fitness, observation, truth = task(genotypes)
    assert truth is None
    assert_array_equal(fitness, [0, 0, np.nan])
    shapes = {name: (observation[name].shape, observation[name].dtype) for name in observation.dtype.names}
    assert shapes == {
        "camera": ((3, 5, 4, 4, 3), np.uint8),
        "place": ((3, 5, 2), np.float32),
        "room": ((3, 5, 3), np.float64),
    }
    env = Seeing()
    for row, controls in enumerate(task.episode(genotypes[:2]).control):
        env.reset()
        sensed = [env.step(action)[0] for action in controls][1::2]
        for name in ("place", "camera"):
            assert_array_equal(observation[name][row], [one[name] for one in sensed])
        assert_array_equal(observation["room"][row].argmax(axis=1), [one["room"] for one in sensed])
    aurora = auroraqd.Aurora(4, auroraqd.Streams(place=PCA(2), camera=None, room=None), seed=0, batch_size=20).run(
        task, generations=2
    )
    assert aurora.archive.observation["camera"].shape[1:] == (5, 4, 4, 3)


def test_streams_of_a_dict_are_chosen(seeing):
    options = {"controller": tasks.MLP(hidden=()), "steps": 4, "samples": 2}
    genotypes = np.full((1, 2 * (2 + 48 + 3 + 1)), 0.5)
    one = tasks.Gym(seeing, observe=["place"], **options)(genotypes)
    assert one.observation.dtype.names == ("place",)
    flat = tasks.Gym(seeing, observe=[0, 1], **options)(genotypes)
    assert_array_equal(flat.observation, one.observation["place"])
    assert flat.ground_truth.shape == (1, 2)
    with pytest.raises(ValueError, match=r"observe sound must be one of place, camera, room, positions, .*, got 'sound'"):
        tasks.Gym(seeing, observe=["sound"], **options)
    with pytest.raises(ValueError, match=r"observe place must be one of positions, .* of CartPole-v1, got 'place'"):
        tasks.Gym("CartPole-v1", observe=["place"], controller=tasks.MLP())


def test_each_stream_once_and_nothing_to_sense(seeing):
    with pytest.raises(ValueError, match=r"observe must name each stream once, got \['place', 'place'\]"):
        tasks.Gym(seeing, observe=["place", "place"])

    class Senseless(Seeing):
        observation_space = gymnasium.spaces.Dict({})

    gymnasium.register("Senseless-v0", entry_point=Senseless)
    try:
        with pytest.raises(ValueError, match="Senseless-v0 senses nothing, for its observation has no entries"):
            tasks.Gym("Senseless-v0")
    finally:
        del gymnasium.registry["Senseless-v0"]


SIGHT = Camera((24, 32), frames=2, distance=3)


def seen(env_id="Swimmer-v5", observe=SIGHT, rows=3, **settings):
    task = tasks.Gym(env_id, steps=20, samples=4, observe=observe, **settings)
    return task(genotypes_of(task, rows))


@needs_a_library
def test_a_camera_sees_where_a_robot_is():
    fitness, pictures, truth = seen()
    assert pictures.dtype == np.uint8
    assert pictures.shape == (3, 24, 32, 6)
    assert_array_equal(truth, seen(observe=None)[1][:, -1])
    assert_array_equal(fitness, 0)
    half = seen(observe=Camera((24, 32), distance=3)).observation  # the last of the frames
    assert_array_equal(half, pictures[..., 3:])
    grey = seen(observe=Camera((24, 32), distance=3, grey=True)).observation
    assert_array_equal(grey[..., 0], (half @ [0.299, 0.587, 0.114]).round())
    assert seen(observe="camera").observation.shape == (3, 64, 64, 3)
    assert len(np.unique(pictures.reshape(3, -1), axis=0)) == 3


@needs_a_library
def test_the_camera_stands_still_or_follows():
    def columns(**settings):
        """In which column of the picture a swimmer is, at three places."""
        task = tasks.Gym("Swimmer-v5", observe=Camera(32, distance=12, elevation=-90, **settings))
        poses = np.zeros((3, 1, task.model.nq))
        poses[:, 0, 0] = -3, 0, 3
        red, green, blue = np.moveaxis(task._senses[""].of(poses).astype(int), 3, 0)
        orange = (red - blue > 40) & (red > green)
        return [np.average(np.arange(32), weights=one.sum(axis=0)) for one in orange]

    left, middle, right = columns()
    assert right - middle == pytest.approx(middle - left, abs=1)
    assert right - left > 12
    followed = columns(follow=True)
    assert max(followed) - min(followed) < 1.5
    assert columns(lookat=(-3, 0, 0))[0] == pytest.approx(middle, abs=1)


@needs_a_library
def test_pictures_are_the_same_bit_for_bit():
    """One by one, at once, again, in another process, and in threads."""
    task = tasks.Gym("Swimmer-v5", steps=20, observe=SIGHT)
    genotypes = genotypes_of(task, 5)
    pictures = task(genotypes).observation
    assert_array_equal(np.concatenate([task(row[None]).observation for row in genotypes]), pictures)
    assert_array_equal(pickle.loads(pickle.dumps(task))(genotypes[::-1]).observation[::-1], pictures)
    with ThreadPoolExecutor(2) as threads:
        for found in threads.map(lambda rows: task(rows).observation, [genotypes] * 4):
            assert_array_equal(found, pictures)
    with evaluate.over(evaluate.processes(1), task) as spread:
        assert_array_equal(spread(genotypes).observation, pictures)


@needs_a_library
def test_a_camera_that_is_gone_takes_nothing_of_others():
    """What libraries of drawing keep has numbers, and these are of a context."""
    first = tasks.Gym("Swimmer-v5", steps=20, observe=SIGHT)
    genotypes = genotypes_of(first, 2)
    pictures = first(genotypes).observation
    second = tasks.Gym("Swimmer-v5", steps=20, observe=SIGHT)
    del first
    gc.collect()
    assert_array_equal(second(genotypes).observation, pictures)


@needs_a_library
def test_several_streams_at_once():
    """Positions, what touches the ground, and a camera."""
    observe = {"places": "positions", "speeds": "velocities", "feet": "contacts", "eye": Camera(16), "joints": range(2, 5)}
    settings = {"env_id": "Ant-v5", "positions": (0, 1, 2), "options": {"terminate_when_unhealthy": False}}
    fitness, observation, truth = seen(observe=observe, **settings)
    shapes = {name: (observation[name].shape[1:], observation[name].dtype) for name in observation.dtype.names}
    assert shapes == {
        "eye": ((16, 16, 3), np.uint8),
        "feet": ((4, 13), bool),
        "joints": ((4, 3), np.float64),
        "places": ((4, 3), np.float64),
        "speeds": ((4, 14), np.float64),
    }
    assert_array_equal(truth, observation["places"][:, -1])
    assert np.isfinite(fitness).all()
    assert 0 < observation["feet"].mean() < 1
    by_words = seen(observe=["positions", "contacts"], **settings)
    assert_array_equal(by_words.observation["contacts"], observation["feet"])
    assert_array_equal(by_words.ground_truth, truth)
    task = tasks.Gym("Ant-v5", steps=20, samples=4, observe={"eye": Camera(16), "places": "positions"})
    assert task._rollout is not None
    assert tasks.Gym("Ant-v5", observe="contacts")(genotypes_of(task, 2)).observation.shape == (2, 20, 13)


def test_contacts_are_those_of_the_simulation():
    """Of Gymnasium's own, which is stepped by hand; and high in the air there are none."""
    task = tasks.Gym("Ant-v5", observe="contacts", steps=60, samples=60)
    genotype = genotypes_of(task, 1)
    env, model = made("Ant-v5"), task.model
    env.reset(seed=0)
    env.set_state(env.init_qpos, env.init_qvel)
    expected = np.zeros((60, model.nbody), bool)
    for step, control in enumerate(task.episode(genotype).control[0]):
        env.step(control)
        mujoco.mj_forward(env.model, env.data)
        for contact in env.data.contact:
            if contact.dist < contact.includemargin:
                expected[step, [model.geom_bodyid[contact.geom1], model.geom_bodyid[contact.geom2]]] = True
    found = task(genotype).observation[0]
    assert (found == expected[:, 1:]).mean() > 0.99
    assert 0.01 < found.mean() < 0.5
    pose = np.zeros((1, 1, model.nq))
    pose[0, 0, 2:4] = 10, 1
    assert not task._senses[""].of(pose).any()


@needs_a_library
def test_where_a_simulation_diverges_there_is_no_picture():
    task = tasks.Gym("Swimmer-v5", steps=4, samples=2, observe=Camera(8), controller=Broken())
    fitness, pictures, _ = task(np.array([[0.0], [1.0]]))
    assert_array_equal(np.isnan(fitness), [False, True])
    assert not pictures[1].any()
    assert pictures[0].any()


class Broken:
    """Does nothing, or returns a NaN."""

    def n_genes(self, actuators):
        return 1

    def __call__(self, genotypes, actuators, time):
        return np.where(genotypes[:, :, None] > 0.5, np.nan, np.zeros((1, len(time), actuators)))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tasks.Gym("Swimmer-v5", observe="kamera"), "observe must be one of positions, velocities, contacts, obs"),
        (lambda: tasks.Gym("Swimmer-v5", observe={"a": "kamera"}), "observe a must be one of positions, .*, got 'kamera'"),
        (lambda: tasks.Gym("Swimmer-v5", observe={}), "observe must have a stream at least, got none"),
        (lambda: tasks.Gym("Swimmer-v5", observe={"a b": "camera"}), "streams of Swimmer-v5 must have names .*, got 'a b'"),
        (lambda: tasks.Gym("Swimmer-v5", observe={1: "camera"}), "streams of Swimmer-v5 must have names .*, got 1"),
        (lambda: tasks.Gym("Swimmer-v5", observe={"a": [99]}), r"observe a must be of 0 to 7 for Swimmer-v5, got \[99\]"),
        (lambda: tasks.Gym("Swimmer-v5", observe={"a": 5}), "observe a must be one of .*, got 5"),
        (lambda: tasks.Gym("CartPole-v1", observe="camera"), "observe asks for camera, .* and CartPole-v1 is not an"),
        (lambda: tasks.Gym("CartPole-v1", observe={"a": "contacts"}), "observe a asks for contacts, which is MuJoCo's"),
        (
            lambda: tasks.Gym("Ant-v5", observe=Camera(name="top")),
            "name of a camera .* of Ant-v5 has, got 'top': there are track",
        ),
        (lambda: tasks.Gym("Reacher-v5", observe=Camera(name="top")), "got 'top': it has none with a name"),
        (lambda: tasks.Gym("Ant-v5", steps=3, samples=1, observe=Camera(frames=4)), "frames of a camera must be at most 3"),
        (lambda: Camera(0), "size of a camera must be a whole number, from 1 to 4096, got 0"),
        (lambda: Camera((8, 8, 8)), r"size of a camera must be a whole number, .*, got \(8, 8, 8\)"),
        (lambda: Camera("big"), "size of a camera must be a whole number"),
        (lambda: Camera(distance=0), "distance of a camera must be more than 0"),
        (lambda: Camera(elevation=91), "elevation must be a finite number, from -90 to 90, got 91"),
        (lambda: Camera(lookat=(1, 2)), r"lookat must be x, y and z, got \(1, 2\)"),
        (lambda: Camera(grey=2), "grey must be True or False"),
        (lambda: Camera(name=3), "name of a camera must be one that the model has, got 3"),
    ],
)
def test_what_cannot_be_observed(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ValueError, match=r'not installed: pip install "auroraqd\[robots\]"'):
        tasks.Gym("Swimmer-v5")


def beyond(genotypes, actuators, time):
    return np.full((len(genotypes), len(time), actuators), 5.0)


beyond.n_genes = lambda actuators: 1


def test_controls_stay_in_range():
    task = tasks.Gym("Swimmer-v5", controller=beyond, steps=3, samples=3)
    assert_array_equal(task.episode(np.zeros((1, 1))).control, 1.0)


def test_a_limit_of_the_environment_that_is_asked_for_holds():
    task = tasks.Gym("Swimmer-v5", steps=6, samples=6, options={"max_episode_steps": 3})
    path = task(np.full((1, task.n_genes), 0.8)).observation[0]
    assert (path[2] == path[5]).all()
    assert (path[1] != path[2]).any()
