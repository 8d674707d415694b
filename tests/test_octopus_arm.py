"""The octopus arm: its soft body, its muscles, what it senses; and soft bodies in films and contacts."""

import pickle
from collections import Counter
from itertools import combinations

import commands
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import auroraqd
from auroraqd.report import film
from auroraqd.tasks import OctopusArm, _octopus_arm_model
from auroraqd.tasks._octopus_arm_model import CORNERS, MUSCLES, PARTS, SLICES, VERTICES, elements
from auroraqd.tasks._sensing import Contacts

mujoco = pytest.importorskip("mujoco", minversion="3.16")

QUICK = {"steps": 20, "samples": 5, "threads": 1}


class Held:
    """A controller that holds each muscle as its gene says."""

    def n_genes(self, actuators):
        return actuators

    def __call__(self, genotypes, actuators, time):
        return np.repeat(2 * genotypes[:, None] - 1, len(time), axis=1)


def pulled(*muscles):
    """Genes that pull some with all force, (1, 16)."""
    genotype = np.zeros((1, MUSCLES))
    genotype[0, list(muscles)] = 1
    return genotype


def volumes(places):
    """Of all tetrahedra, of the places of the vertices, (45, 3)."""
    corners = places[[[VERTICES.index(vertex) for vertex in element] for element in elements()]]
    return np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6


def test_the_tetrahedra_fill_the_bar():
    each = volumes(np.array([vertex.place for vertex in VERTICES]))
    assert (each > 0).all()
    assert each.sum() == pytest.approx(0.6 * 0.06**2)
    faces = Counter(frozenset(face) for element in elements() for face in combinations(element, 3))
    assert set(faces.values()) == {1, 2}  # as wedges are cut alike on both sides, a face is outside, or of two
    outside = 2 * CORNERS + 2 * CORNERS * (SLICES - 1)  # triangles of the ends, and of the skin
    assert list(faces.values()).count(1) == outside


def test_it_weighs_as_the_water_it_is_in():
    task = OctopusArm(**QUICK)
    assert task.model.body_mass.sum() == pytest.approx(1000 * 0.6 * 0.06**2)
    assert task.n_genes == 48
    at_rest = OctopusArm(controller=Held(), **QUICK)(pulled())
    assert_allclose(at_rest.ground_truth, [[0, 0, 0.2]], atol=1e-9)
    assert_allclose(at_rest.observation[0, -1].reshape(4, 3)[:, 2], [0.65, 0.5, 0.35, 0.2], atol=1e-9)


def test_muscles_bend_it_to_their_side():
    task = OctopusArm(controller=Held(), **QUICK)
    for corner, (x, y) in enumerate(_octopus_arm_model._SIDES):
        tip = task(pulled(*range(corner, MUSCLES, CORNERS))).ground_truth[0]
        assert np.sign(tip[:2]).tolist() == [x, y]
        assert np.abs(tip[:2]).min() > 0.03
    shorter = task(np.ones((1, MUSCLES))).ground_truth[0]
    assert_allclose(shorter[:2], 0, atol=1e-3)
    assert 0.22 < shorter[2] < 0.4


def test_it_has_no_side_that_it_prefers():
    task = OctopusArm(controller=Held(), **QUICK)
    tips = np.concatenate([task(pulled(*range(corner, MUSCLES, CORNERS))).ground_truth for corner in range(CORNERS)])
    assert_allclose(np.abs(tips) - np.abs(tips).mean(axis=0), 0, atol=0.004)


def test_foam_is_not_turned_inside_out():
    task = OctopusArm(controller=Held(), steps=60, samples=60, threads=1)
    sides = [pulled(*range(first, MUSCLES, CORNERS), *range(second, MUSCLES, CORNERS)) for first, second in ((0, 1), (1, 3))]
    bent = pulled(*(CORNERS * part + corner for part in range(PARTS) for corner in ((0, 1) if part < 2 else (2, 3))))
    poses = task.episode(np.concatenate([np.ones((1, MUSCLES)), *sides, bent])).qpos
    data, rest = mujoco.MjData(task.model), volumes(np.array([vertex.place for vertex in VERTICES]))
    for pose in poses[:, ::6].reshape(-1, poses.shape[2]):
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(task.model, data)
        assert (volumes(data.flexvert_xpos) > 0.3 * rest).all()


def test_it_does_what_mujoco_does_step_by_step():
    task = OctopusArm(**QUICK)
    genotypes = np.random.default_rng(0).random((2, task.n_genes))
    episode, observation = task.episode(genotypes), task(genotypes).observation
    for row in range(2):
        data = mujoco.MjData(task.model)
        for step in range(20):
            data.ctrl[:] = episode.control[row, step]
            mujoco.mj_step(task.model, data, 10)
            assert_allclose(data.qpos, episode.qpos[row, step], atol=1e-9)
        mujoco.mj_kinematics(task.model, data)
        plates = [data.body(f"plate_{plate}").xpos for plate in range(1, 5)]
        assert_allclose(np.ravel(plates), observation[row, -1], atol=1e-9)


def test_a_finer_step_changes_little():
    coarse = OctopusArm(threads=1)
    fine = OctopusArm(threads=1, options={})
    genotypes = np.random.default_rng(1).random((3, coarse.n_genes))
    ends = coarse(genotypes).ground_truth
    fine.model.opt.timestep /= 4
    for row, control in enumerate(coarse.episode(genotypes).control):
        data = mujoco.MjData(fine.model)
        for step in control:
            data.ctrl[:] = step
            mujoco.mj_step(fine.model, data, 40)
        assert_allclose(data.qpos[:3], ends[row], atol=0.004)


def test_a_policy_senses_how_long_muscles_are():
    class Sees:
        seen: list = []

        def n_genes(self, observations, actuators):
            return 1

        def policy(self, genotypes, observations, actuators):
            def act(sensed):
                self.seen.append(sensed)
                return np.full((len(genotypes), actuators), 1.0)

            return act

    task = OctopusArm(controller=Sees(), fitness="return", **QUICK)
    fitness = task([[0.5]]).fitness
    assert_allclose(Sees.seen[0], [[1.0] * MUSCLES + [0.0] * MUSCLES], atol=1e-9)
    assert (Sees.seen[-1][0, :MUSCLES] < 0.95).all()
    assert fitness.tolist() == [-20.0]


def test_what_is_asked_for():
    task = OctopusArm(observe={"eye": auroraqd.tasks.Camera(16), "arm": "positions"}, fitness=lambda e: e.length, **QUICK)
    found = task(np.full((1, 48), 0.5))
    assert found.observation["eye"].shape == (1, 16, 16, 3)
    assert found.observation["arm"].shape == (1, 5, 12)
    assert found.fitness.tolist() == [20]
    assert found.ground_truth.shape == (1, 3)
    with pytest.raises(TypeError, match="env_id"):
        OctopusArm(env_id="Ant-v5")
    with pytest.raises(ValueError, match="steps must be"):
        OctopusArm(steps=0)


def test_older_versions_are_refused(monkeypatch):
    monkeypatch.setattr(mujoco, "__version__", "3.9.0")
    with pytest.raises(ValueError, match=r"OctopusArm-v0.* needs MuJoCo 3\.16 or later, got 3\.9\.0"):
        OctopusArm(**QUICK)


def test_it_goes_to_workers_and_back():
    task = OctopusArm(**QUICK)
    genotypes = np.random.default_rng(2).random((2, 48))
    assert_array_equal(pickle.loads(pickle.dumps(task))(genotypes).observation, task(genotypes).observation)


def test_the_command_line(tmp_path):
    run = commands.cli("run", "octopus-arm:steps=10,samples=5", "-n", 2, "--batch-size", 10, "--out", "run", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert auroraqd.load(tmp_path / "run").observation.shape[1:] == (5, 12)
    shown = commands.cli("animate", "run", "--skill", 2, "--out", "arms.gif", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert (tmp_path / "arms.gif").stat().st_size > 1000


BALL = """<mujoco>
  <option timestep="0.001" integrator="Euler"/>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <flexcomp name="ball" type="grid" dim="3" count="3 3 3" spacing="0.05 0.05 0.05" pos="0 0 {height}" radius="0.01"
              mass="0.5">
      <contact selfcollide="none"/>
      <elasticity young="1e4" poisson="0.2" damping="0.005"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize(("height", "touching"), [(0.059, 9), (0.5, 0)])
def test_soft_bodies_touch(height, touching):
    model = mujoco.MjModel.from_xml_string(BALL.format(height=height))
    [[found]] = Contacts(model)(np.zeros((1, 1, model.nq)))
    assert found.sum() == touching
    below = [model.body(body).pos[2] < height - 0.04 for body in range(1, model.nbody)]
    assert_array_equal(found & ~np.array(below), False)


def test_soft_bodies_touch_with_their_elements():
    pole = '<geom type="box" size="0.01 0.01 0.05" pos="0.02 0.013 0.1"/>'
    model = mujoco.MjModel.from_xml_string(BALL.format(height=0.2).replace('<geom type="plane" size="2 2 0.1"/>', pole))
    [[found]] = Contacts(model)(np.zeros((1, 1, model.nq)))
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    touched = model.flex_elem.reshape(-1, 4)[data.contact.elem[:, 1]]  # by the pole, that ends below
    assert data.ncon > 0
    assert (data.contact.vert < 0).all()
    assert np.flatnonzero(found).tolist() == sorted({int(body) - 1 for body in model.flex_vertbodyid[touched].ravel()})
    assert 4 <= found.sum() < 27


def test_a_film_shows_all_of_it(tmp_path):
    task = OctopusArm(steps=4, samples=2, threads=1)
    film(task, np.full((2, 48), 0.5), tmp_path / "arms.gif")
    with Image.open(tmp_path / "arms.gif") as moving:
        picture = np.asarray(moving.convert("RGB")).astype(int)
    soft = picture[..., 0] - picture[..., 2] > 40  # of the colour of the foam
    assert soft.mean() > 0.02
    assert not soft[:, [0, -1]].any()
