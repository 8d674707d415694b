"""The hexapod: its controller, its body, what it senses, and what is wrong with it."""

import pickle
from dataclasses import replace

import commands
import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import tasks
from auroraqd.report import film
from auroraqd.tasks import DAMAGES, Damage, Hexapod, SquareWaves, _hexapod_model, hexapod
from auroraqd.tasks._hexapod_model import LEGS, compiled

mujoco = pytest.importorskip("mujoco")

QUICK = {"seconds": 0.3, "samples": 5, "threads": 1}
LEFT_AND_RIGHT = [5, 4, 3, 2, 1, 0]


def genotypes_of(n, seed=0):
    return np.random.default_rng(seed).random((n, 36))


def tripod():
    """Three legs swing forwards in the air while the others push: its genes, (1, 36)."""
    legs = []
    for leg in range(LEGS):
        lift = 0.5 * (leg % 2)
        legs.append([1.0, (lift + 0.25 + 0.5 * (leg > 2)) % 1, 0.5, 0.5, lift, 0.5])
    return np.array(legs).reshape(1, 36)


def standing():
    return np.zeros((1, 36))


@pytest.mark.parametrize("period", [1.0, 0.7])
def test_waves_agree_with_their_twin(period):
    rng = np.random.default_rng(0)
    genotypes = rng.random((4, 12))
    genotypes[1] = rng.integers(0, 2, 12)  # bounds of all genes
    genotypes[2] = rng.integers(0, 21, 12) / 20  # the levels of the article
    time = 0.015 * np.arange(120)
    controls = SquareWaves(period)(genotypes, 6, time).reshape(4, 120, 2, 3)
    for row, leg in np.ndindex(4, 2):
        genes = genotypes[row, 6 * leg : 6 * leg + 6].tolist()
        for joint in range(2):
            wanted = [naive.square_wave(*genes[3 * joint : 3 * joint + 3], t, period) for t in time.tolist()]
            assert_allclose(controls[row, :, leg, joint], wanted, atol=1e-12)
    assert_array_equal(controls[..., 2], -controls[..., 1])
    assert np.abs(controls).max() <= 1


def test_it_stands():
    task = Hexapod(**QUICK)
    assert task.model.body_subtreemass[0] == pytest.approx(1.031 + 6 * 0.388)  # kg
    fitness, observation, truth = task(standing())
    assert_allclose(fitness, 0, atol=1e-3)
    assert observation.dtype == bool
    assert_array_equal(observation, np.ones((1, 5, 6)))
    assert_array_equal(truth, np.ones((1, 6)))
    forces = task.episode(standing()).sensors[0, -1]
    assert forces[0] == 0  # the torso
    assert forces[1:].sum() == pytest.approx(9.81 * task.model.body_subtreemass[0], rel=0.01)


def test_it_does_what_mujoco_does_step_by_step():
    task = Hexapod(observe=("contacts", "path", "joints"), **QUICK)
    genotypes = genotypes_of(2)
    episode, evaluation = task.episode(genotypes), task(genotypes)
    model = task.model
    floor, feet = model.geom("floor").id, [model.site(f"foot_{leg}").bodyid[0] for leg in range(LEGS)]
    for row in range(2):
        data = mujoco.MjData(model)
        for _ in range(round(1 / model.opt.timestep)):
            mujoco.mj_step(model, data)
        begun, touching = data.qpos.copy(), []
        for step in range(task.steps):
            data.ctrl[:] = episode.control[row, step]
            for _ in range(2):
                mujoco.mj_step(model, data)
            assert_allclose(episode.qpos[row, step], data.qpos, atol=1e-9)
            assert_allclose(episode.qvel[row, step], data.qvel, atol=1e-7)
            geoms = data.contact.geom[(data.contact.geom == floor).any(axis=1)]
            bodies = set(model.geom_bodyid[geoms].ravel().tolist()) - {0}
            assert_allclose(episode.sensors[row, step], data.sensordata, rtol=1e-6, atol=1e-6)
            touching.append(data.sensordata[1:] > 0)
            assert all(foot in bodies for foot, touches in zip(feet, touching[-1], strict=True) if touches)
            assert bodies <= {*feet}
            if (step + 1) % 4 == 0:
                seen = evaluation.observation[row]
                assert_allclose(seen["path"][step // 4], data.qpos[:2], atol=1e-9)
                assert_allclose(seen["joints"][step // 4], data.qpos[7:], atol=1e-9)
        assert_allclose(evaluation.fitness[row], (data.qpos[0] - begun[0]) / 0.3, atol=1e-9)
        assert_allclose(evaluation.ground_truth[row], np.mean(touching, axis=0))
    assert len(np.unique(evaluation.ground_truth)) > 4


def test_a_tripod_walks_and_its_mirror_image_does_likewise():
    task = Hexapod(observe="path", seconds=2.0, samples=10, threads=1)
    genes = tripod()
    mirrored = genes.reshape(1, 6, 6)[:, LEFT_AND_RIGHT].copy()
    mirrored[..., 1] = (mirrored[..., 1] + 0.5) % 1  # servos at hips turn the other way
    assert task(genes).fitness > 0.15  # m/s
    short = replace(task, seconds=0.45)
    one, other = short(genes), short(mirrored.reshape(1, 36))
    assert_allclose(one.observation * [1, -1], other.observation, atol=1e-3)
    assert_allclose(one.ground_truth[:, LEFT_AND_RIGHT], other.ground_truth, atol=0.04)


def test_a_finer_step_of_the_physics_leads_to_the_same(monkeypatch):
    genotypes = genotypes_of(12)
    speeds = Hexapod(seconds=0.9, threads=1)(genotypes).fitness
    for module in (_hexapod_model, hexapod):
        monkeypatch.setattr(module, "TIMESTEP", 0.0025)
    monkeypatch.setattr(hexapod, "_SKIP", 6)
    finer = Hexapod(seconds=0.9, threads=1)(genotypes).fitness
    assert np.corrcoef(speeds, finer)[0, 1] > 0.97
    assert not np.array_equal(speeds, finer)


def test_threads_and_batches_do_not_matter(monkeypatch):
    genotypes = genotypes_of(6)
    expected = Hexapod(**QUICK)(genotypes)
    monkeypatch.setattr(hexapod, "MOST_BYTES", 1)
    for column, wanted in zip(Hexapod(**{**QUICK, "threads": 3})(genotypes), expected, strict=True):
        assert_array_equal(column, wanted)
    assert_array_equal(pickle.loads(pickle.dumps(Hexapod(**QUICK)))(genotypes[2:4]).ground_truth, expected.ground_truth[2:4])
    assert len(np.unique(expected.fitness)) == 6


def test_those_who_fall_are_invalid():
    """With both rear legs and one in the middle gone it lies on its torso."""
    task = Hexapod(damage=Damage(gone=(0, 1, 5)), observe=("joints", "contacts"), **QUICK)
    fitness, observation, truth = task(standing())
    assert np.isnan(fitness).all()
    assert np.isnan(truth).all()
    assert np.isnan(observation["joints"]).all()
    with pytest.warns(UserWarning, match="task Hexapod gave no valid individual"):
        aurora = auroraqd.Aurora(36, "hand-coded", batch_size=4, seed=0).run(task, generations=1)
    assert len(aurora.archive) == 0


class Diverging:
    """An open-loop controller that returns a NaN for the second half of the episode, of every second robot."""

    def n_genes(self, actuators):
        return 1

    def __call__(self, genotypes, actuators, time):
        controls = np.zeros((len(genotypes), len(time), actuators))
        controls[::2, len(time) // 2 :] = np.nan
        return controls


def test_a_controller_that_returns_nan_is_invalid():
    fitness, _, truth = Hexapod(controller=Diverging(), **QUICK)(np.zeros((4, 1)))
    assert_array_equal(np.isnan(fitness), [True, False, True, False])
    assert_array_equal(np.isnan(truth).all(axis=1), [True, False, True, False])


def test_a_simulation_that_diverges_is_invalid(tmp_path, monkeypatch):
    """Servos far stiffer than the step of the physics allows."""
    monkeypatch.chdir(tmp_path)
    task = Hexapod(**QUICK)
    task.model.actuator_gainprm[:, 0], task.model.actuator_biasprm[:, 1:3] = 1e9, (0, 1e9)
    task.model.actuator_forcerange[:] = (-1e12, 1e12)
    assert np.isnan(task(genotypes_of(2)).fitness).all()
    assert not list(tmp_path.iterdir())  # where MuJoCo would write a log


@pytest.mark.parametrize("name", DAMAGES)
def test_damages(name):
    whole, broken = Hexapod(**QUICK), Hexapod(damage=name, **QUICK)
    genotypes = genotypes_of(4)
    found = broken(genotypes)
    assert broken.n_genes == 36
    assert found.observation.shape == (4, 5, 6)
    assert not np.array_equal(found.fitness, whole(genotypes).fitness)
    assert np.isfinite(broken(standing()).fitness).all()  # it can stand
    assert Hexapod(damage=DAMAGES[name]) != Hexapod()
    assert str(DAMAGES[name]) != "no damage"


def test_what_damages_do():
    task = Hexapod(damage=Damage(gone=(1,), stuck=[4, 4], limp=(0,)), observe=("contacts", "joints"), **QUICK)
    fitness, observation, _ = task(tripod())
    joints = observation["joints"].reshape(5, LEGS, 3)
    assert np.isfinite(fitness).all()
    assert not observation["contacts"][..., 1].any()
    assert_array_equal(joints[:, 1], 0)
    assert np.abs(joints[:, 4]).max() < 0.3 < np.abs(joints[:, 2]).max()
    wrong = compiled(mujoco, Damage(short=(3,), torque=0.5, friction=0.2, slope=30, limp=(0,)))
    whole = compiled(mujoco, Damage())
    assert wrong.body("torso").subtreemass == pytest.approx(whole.body("torso").subtreemass - 0.092)
    assert_allclose(wrong.opt.gravity, [-9.81 / 2, 0, -9.81 * np.sqrt(0.75)])
    assert wrong.geom("floor").friction[0] == 0.2
    assert wrong.actuator("lift_3").forcerange[1] == pytest.approx(1.25)
    assert wrong.actuator("lift_0").gainprm[0] == 0
    assert wrong.site("foot_3").pos[2] == pytest.approx(whole.site("foot_3").pos[2] / 2)


def test_damages_are_values():
    assert Damage(gone=[2, 0, 2]) == Damage(gone=(0, 2))
    assert repr(Hexapod()) == "Hexapod()"
    assert repr(Hexapod(damage="slope", samples=7)) == "Hexapod(damage='slope', samples=7)"
    assert str(Damage()) == "no damage"
    assert str(Damage(gone=(1,), slope=5.0)) == "gone=(1,), slope=5.0"


def test_it_sees():
    task = Hexapod(observe=tasks.Camera(16, frames=2, grey=True, follow=True), **QUICK)
    pictures = task(np.concatenate([standing(), tripod()])).observation
    assert pictures.shape == (2, 16, 16, 2)
    assert (pictures[0] != pictures[1]).any()


def test_runs_and_films_on_the_command_line(tmp_path):
    task = "hexapod:damage=middle-leg-gone,seconds=0.3,samples=4,observe=path"
    done = commands.cli("run", task, "-n", 2, "--batch-size", 12, "--no-figures", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    repertoire = auroraqd.load(tmp_path / "run")
    assert repertoire.observation.shape[1:] == (4, 2)
    page = commands.cli("explore", tmp_path / "run", "--films", 1, "--out", tmp_path / "skills.html")
    assert page.returncode == 0, page.stderr
    assert "image/webp" in (tmp_path / "skills.html").read_text()


def test_a_run_from_python_is_filmed(tmp_path):
    task = Hexapod(damage="slope", observe="path", **{**QUICK, "threads": None})
    aurora = auroraqd.Aurora(task.n_genes, PCA(2), batch_size=8, seed=0).run(task, generations=1)
    auroraqd.save(aurora, tmp_path / "run")
    done = commands.cli("animate", tmp_path / "run", "--skill", 0, "--out", tmp_path / "one.gif")
    assert done.returncode == 0, done.stderr
    film(task, aurora.archive.genotype[:1], tmp_path / "same.gif", names=["skill 0"])
    assert (tmp_path / "one.gif").read_bytes() == (tmp_path / "same.gif").read_bytes()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Hexapod(damage="bent"), "damage must be an auroraqd.tasks.Damage, or one of rear-leg-gone, .*, got 'bent'"),
        (lambda: Hexapod(damage=3), "damage must be an auroraqd.tasks.Damage, or one of .*, got 3"),
        (lambda: Hexapod(observe="smell"), "observe must be one of contacts, path, joints, camera, .* got 'smell'"),
        (lambda: Hexapod(observe=()), "observe must be one of contacts, path, joints, camera, .* got \\(\\)"),
        (lambda: Hexapod(observe=("path", "path")), "observe must name each stream once"),
        (lambda: Hexapod(observe=tasks.Camera(frames=900)), "frames of a camera must be at most 200"),
        (lambda: Hexapod(seconds=0), "seconds must be a finite number, from 0.015 to 1000, got 0"),
        (lambda: Hexapod(samples=300), "samples must be a whole number, from 1 to 200, got 300"),
        (lambda: Hexapod(threads=0), "threads must be a whole number"),
        (lambda: Hexapod(controller=tasks.MLP()), "controller of a hexapod must be open-loop"),
        (lambda: Hexapod()([[0.5]]), r"a hexapod must have genotypes of shape \(1, 36\), got \(1, 1\)"),
        (lambda: Hexapod()(np.zeros((0, 36))), r"a hexapod must have genotypes of shape \(1, 36\), got \(0, 36\)"),
        (lambda: Hexapod()([[1.5] * 36]), r"a hexapod must have genotypes in \[0, 1\], got 1.5"),
        (lambda: SquareWaves(0), "period must be more than 0"),
        (lambda: SquareWaves().n_genes(8), "SquareWaves are for legs of three actuators, and the robot has 8"),
        (lambda: Damage(gone=(6,)), "a leg that is gone must be a whole number, from 0 to 5, got 6"),
        (lambda: Damage(limp=2), r"limp must be legs, like \(0,\), got 2"),
        (
            lambda: Damage(gone=(0, 1, 2), stuck=(3, 4), limp=(5,)),
            "a damage must leave a leg that moves, and of .* all are gone",
        ),
        (lambda: Damage(torque=0), "torque of a damage must be a finite number, a share, from 0.01 to 1, got 0"),
        (lambda: Damage(friction=-1), "friction of a damage must be a finite number, from 0.001 to 10, got -1"),
        (lambda: Damage(slope=90), "slope of a damage must be a finite number, from -60 to 60, got 90"),
    ],
)
def test_mistakes(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_without_the_extra(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(hexapod, "import_module", missing)
    with pytest.raises(ValueError, match="MuJoCo is not installed: pip install"):
        Hexapod()


def test_it_goes_on_from_where_it_was_left():
    half, whole = (Hexapod(observe="path", seconds=seconds, samples=5, threads=1) for seconds in (1.0, 2.0))
    genotypes = np.concatenate([tripod(), standing()])
    first, state = half.carried(genotypes)
    assert_array_equal(first.observation, half(genotypes).observation)
    second, _ = half.carried(genotypes, state)
    at_once = whole(genotypes)
    assert_allclose(second.observation[:, -1], at_once.observation[:, -1], atol=0.02)
    assert_allclose((first.fitness + second.fitness) / 2, at_once.fitness, atol=0.01)
    assert second.fitness[0] > 0.1


def test_who_has_fallen_stays_so():
    task = Hexapod(**QUICK)
    genotypes = np.concatenate([standing(), standing()])
    _, state = task.carried(genotypes)
    state[0] = np.nan
    evaluation, after = task.carried(genotypes, state)
    assert np.isnan(evaluation.fitness).tolist() == [True, False]
    assert np.isnan(after).all(axis=1).tolist() == [True, False]
    for wrong in (state[:1], state[:, 1:], state[0]):
        with pytest.raises(ValueError, match="state must"):
            task.carried(genotypes, wrong)


def test_gaits_follow_each_other():
    task = Hexapod(observe="path", **QUICK)
    aurora = auroraqd.Aurora(36, PCA(n_components=2), batch_size=20, seed=0).run(task, generations=2)
    walk = tasks.Hierarchical(aurora.archive, task, steps=3)
    genotypes = np.random.default_rng(0).random((2, 6))
    evaluation = walk(genotypes)
    assert evaluation.observation.shape == (2, 3, 5, 2)
    jumps = np.linalg.norm(np.diff(evaluation.observation.reshape(2, 15, 2), axis=1), axis=2)
    assert jumps.max() < 0.05  # m, in a fifth of 0.3 s: each goes on where the one before ended
    speeds = (evaluation.observation[:, -1, -1, 0] - task._body.start[0]) / 0.3
    assert_allclose(evaluation.fitness, speeds, atol=1e-9)
