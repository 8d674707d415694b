import shutil
import sys
from itertools import pairwise

import commands
import numpy as np
import pytest
from PIL import Image
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.repertoire import diverse
from auroraqd.report import skills
from auroraqd.report.diversity import diversity_figure
from auroraqd.report.scenes import scene_of
from auroraqd.report.skills import animate, skills_figure
from auroraqd.tasks import air_hockey


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run folder of the air-hockey task."""
    out = tmp_path_factory.mktemp("runs") / "hockey"
    command(["run", "air-hockey", "-n", "4", "--out", str(out), "--no-figures"])
    return out


@pytest.fixture(scope="module")
def repertoire(folder):
    return auroraqd.load(folder)


def command(arguments, code=0):
    done = commands.cli(*arguments)
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return " ".join(done.stdout.split()) if code == 0 else " ".join(done.stderr.split())


def frames(path):
    with Image.open(path) as image:
        found = []
        for i in range(image.n_frames):
            image.seek(i)
            found.append((np.asarray(image.convert("RGB")), image.info["duration"]))
        return found


def test_the_arm_ends_where_its_servos_take_it():
    genotypes = np.random.default_rng(0).random((20, 8))
    found = air_hockey.joints(genotypes)
    assert found.shape == (20, 50, 5, 2)
    assert (found[:, :, 0] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(np.diff(found, axis=2), axis=3), 0.225)
    for genotype, path in zip(genotypes, found, strict=True):  # each joint integrated, as its servo says
        angles = np.zeros(4)
        for phase in (genotype[:4], genotype[4:]):
            target, middle = (2 * phase - 1) * np.pi, angles
            for _ in range(50_000):
                middle = middle + 1e-4 * 0.3 * (target - middle)
            angles = middle
        directions = np.cumsum(angles)
        tip = 0.225 * np.array([np.cos(directions).sum(), np.sin(directions).sum()])
        np.testing.assert_allclose(path[-1, -1], tip, atol=1e-3)


def test_diverse_rows_are_far_from_each_other():
    rng = np.random.default_rng(0)
    corners = np.array([[0.0, 0.0], [0.0, 9.0], [9.0, 0.0], [10.0, 9.0]])
    descriptor = np.repeat(corners, [1, 30, 50, 70], axis=0) + rng.normal(0, 0.1, (151, 2))
    chosen = diverse(descriptor, 4)
    nearest = ((descriptor[chosen, None] - corners) ** 2).sum(axis=2).argmin(axis=1)
    assert sorted(nearest) == [0, 1, 2, 3]
    assert len(set(diverse(descriptor, 30).tolist())) == 30


@pytest.mark.parametrize(
    ("descriptor", "n", "expected"),
    [
        (np.zeros((5, 2)), 3, 1),  # all the same
        (np.zeros((1, 2)), 3, 1),
        (np.array([[0.0], [1.0], [1.0]]), 3, 2),
        (np.arange(20.0).reshape(2, 10), 9, 2),
    ],
)
def test_diverse_stops_at_copies(descriptor, n, expected):
    assert len(diverse(descriptor, n)) == expected


def test_contact_sheet(repertoire):
    rows = diverse(repertoire.descriptor, skills.SHEET)
    figure = skills_figure(repertoire, scene_of({"task": "air-hockey"}, repertoire), rows)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in shown] == [f"skill {row}" for row in rows]
    trail = shown[3].collections[0].get_segments()
    np.testing.assert_array_equal([end for _, end in trail], repertoire.observation[rows[3]])
    np.testing.assert_array_equal(trail[0][0], air_hockey.START)
    arm = shown[3].lines[-1]
    np.testing.assert_allclose(arm.get_xydata(), air_hockey.joints(repertoire.genotype[rows[3:4]])[0, -1])


def test_all_pucks_are_drawn():
    task = auroraqd.tasks.AirHockey(pucks=3)
    found = auroraqd.Aurora(8, "hand-coded", seed=0, batch_size=20).run(task, generations=1).archive
    figure = skills_figure(found, scene_of({"task": "air-hockey:pucks=3"}, found), [1, 0])
    for axes, row in zip(figure.axes, [1, 0], strict=True):
        assert len(axes.collections) == 3
        for trail, name, place in zip(axes.collections, air_hockey.NAMES, air_hockey.PLACES, strict=True):
            ends = np.array(trail.get_segments())
            np.testing.assert_array_equal(ends[:, 1], found.observation[name][row])
            np.testing.assert_array_equal(ends[0, 0], place)
        assert len({tuple(trail.get_color()[-1]) for trail in axes.collections}) == 3


def test_an_animation_shows_every_sample(folder, repertoire):
    moved = int(np.ptp(repertoire.observation, axis=1).sum(axis=1).argmax())
    assert command(["animate", str(folder), "--skill", str(moved)]) == str(folder / "figures" / f"skill-{moved}.gif")
    found = frames(folder / "figures" / f"skill-{moved}.gif")
    assert sum(duration for _, duration in found) == 6000  # ms: five seconds, and the last frame for one more
    assert len(found) > 40  # equal frames are merged
    assert all((one != other).any() for (one, _), (other, _) in pairwise(found))


def test_several_skills_in_one_animation(tmp_path):
    few = ["--descriptor", "genotype", "-n", "1", "--batch-size", "3", "--no-figures"]  # of as many as it shows it takes long
    command(["run", "air-hockey", *few, "--out", str(tmp_path)])
    assert len(auroraqd.load(tmp_path)) == 3
    path = command(["animate", str(tmp_path)])
    assert path.endswith("skills.gif")
    assert len(frames(path)) > 40


def test_mp4(folder, tmp_path):
    command(["animate", str(folder), "--skill", "0", "--out", str(tmp_path / "a.mp4")])
    assert b"ftyp" in (tmp_path / "a.mp4").read_bytes()[:16]
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_an_animation_that_fails_leaves_the_one_before(repertoire, tmp_path):
    path = tmp_path / "a.gif"
    path.write_bytes(b"before")

    def interrupt(done, frames):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animate(repertoire, scene_of({"task": "air-hockey"}, repertoire), [0], path, interrupt)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_mp4_without_ffmpeg_is_said(repertoire, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"an \.mp4 needs ffmpeg"):
        animate(repertoire, scene_of({"task": "air-hockey"}, repertoire), [0], tmp_path / "a.mp4")


def test_other_trajectories_have_scenes_too(tmp_path):
    """Of a task that is not known: the box of what there is, and no arm."""

    def walk(genotypes):
        return np.zeros(len(genotypes)), np.cumsum(genotypes.reshape(len(genotypes), 6, 2) - 0.5, axis=1)

    aurora = auroraqd.Aurora(12, PCA(2), seed=0, batch_size=30).run(walk, generations=2)
    found = auroraqd.load(auroraqd.save(aurora, tmp_path / "walk"))
    scene = scene_of({}, found)
    assert (found.observation > scene.low).all()
    assert (found.observation < scene.high).all()
    assert "skills.png" in command(["show", str(tmp_path / "walk")])
    assert len(frames(command(["animate", str(tmp_path / "walk"), "--skill", "1"]))) == 6


def test_folders_are_made_where_there_are_none(folder, tmp_path):
    path = tmp_path / "no" / "such" / "a.gif"
    assert command(["animate", str(folder), "--skill", "0", "--out", str(path)]) == str(path)
    assert len(frames(path)) > 1


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_places_where_nothing_can_be_written(repertoire, tmp_path, suffix):
    scene = scene_of({"task": "air-hockey"}, repertoire)
    (tmp_path / "file").touch()
    (tmp_path / f"a.{suffix}").mkdir()
    for path, message in (
        (tmp_path / "file" / f"a.{suffix}", "file must be a folder, and is a file"),
        (tmp_path / "file" / "b" / f"a.{suffix}", "the folder .*file/b could not be created: Not a directory"),
        (tmp_path / f"a.{suffix}", f"a.{suffix} must be a file, and is a folder"),
        (tmp_path / f"{'a' * 300}.{suffix}", f"a.{suffix} could not be written: File name too long"),
    ):
        with pytest.raises(OSError, match=message):
            animate(repertoire, scene, [0], path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--skill", "1000000"], "skill must be a row of the repertoire, 0 to"),
        (["--skill", "-1"], "skill must be a row of the repertoire, 0 to"),
        (["--out", "nowhere/a.avi"], "the animation must be a .gif or an .mp4, got 'a.avi'"),
        (["--out", "config.json"], "config.json exists: choose another file with --out"),
    ],
)
def test_mistakes_get_a_sentence(folder, arguments, message):
    arguments = [str(folder / a) if a.endswith(".json") else a for a in arguments]
    assert message in command(["animate", str(folder), *arguments], code=1)


def test_no_trajectories_no_skills(tmp_path):
    aurora = auroraqd.Aurora(2, "genotype", seed=0, batch_size=30).run(lambda g: (g[:, 0], g), generations=2)
    auroraqd.save(aurora, tmp_path)
    assert "skills must be trajectories in the plane, observations or a stream of shape (steps, 2), got (2,)" in command(
        ["animate", str(tmp_path)], code=1
    )
    assert f"there is no folder {tmp_path / 'nowhere'}" in command(["animate", str(tmp_path / "nowhere")], code=1)


def test_an_empty_repertoire_has_no_skills(tmp_path):
    auroraqd.save(auroraqd.Aurora(2, "genotype", seed=0), tmp_path)
    for options in ([], ["--skill", "0"]):
        said = command(["animate", str(tmp_path), *options], code=1)
        assert said == "Error: the repertoire is empty, nothing was stored in its run: there is no skill to show"
    assert "0 individuals" in command(["show", str(tmp_path)])


def test_old_pictures_go_when_a_run_is_replaced(tmp_path):
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=30).run(auroraqd.tasks.Ballistic(), generations=2)
    auroraqd.save(aurora, tmp_path)
    (tmp_path / "figures").mkdir()
    for name in ("skill-3.gif", "skills.png", "history.svg", "mine.png"):
        (tmp_path / "figures" / name).write_text("old")
    auroraqd.save(aurora, tmp_path)
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["mine.png"]


def test_the_picture_of_diversity_counts_as_the_metric_does(repertoire):
    for axes in diversity_figure(repertoire.observation).axes:
        paths = np.stack([line.get_xydata() for line in axes.lines])
        assert len(paths) <= 3
        score = auroraqd.metrics.diversity(paths)
        assert len(axes.patches) == round(100 * score)
        assert axes.get_title() == f"{len(axes.patches)} of 100 squares: adds {score:.2f}"
    one = diversity_figure(repertoire.observation[:1])
    assert [len(axes.lines) for axes in one.axes] == [1, 1]
