"""A folder for a robot: what is in it, in a Python where nothing but NumPy can be imported."""

import json
import subprocess
import sys

import commands
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.tasks import Ballistic, Genes

ALONE = """
import sys

class Nothing:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in sys.stdlib_module_names and top not in ("numpy", "skills"):
            raise ImportError(name)

sys.meta_path.insert(0, Nothing())
sys.path.insert(0, ".")
for name in ("auroraqd", "scipy", "sklearn", "numba"):
    try:
        __import__(name)
    except ImportError:
        continue
    raise SystemExit(f"{name} is there")
import json
import numpy as np
import skills
"""


def alone(folder, code):
    """What a script prints, as JSON, in the folder on a robot."""
    line = [sys.executable, "-I", "-W", "error", "-c", ALONE + code]
    done = subprocess.run(line, capture_output=True, text=True, cwd=folder, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


class Throw:
    """A throw whose genes have names."""

    n_genes = 2
    genes = Genes(angle=(0, 90, "deg"), force=(1, 3))

    def __call__(self, genotypes):
        return Ballistic()(genotypes)


def saved(folder, task, descriptor):
    return auroraqd.load(auroraqd.save(auroraqd.Aurora(2, descriptor, seed=0).run(task, generations=4), folder))


@pytest.fixture(scope="module")
def throws(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("throws") / "run", Throw(), PCA(2))


def test_a_robot_with_numpy_alone(throws, tmp_path):
    folder = throws.deploy(tmp_path / "robot")
    found = alone(
        folder,
        """
goal = skills.observation[5] + 0.1
goal[:40] = np.nan
rows, distance = skills.reach(goal, "observation", k=4)
truth = skills.reach([-0.5, -0.3], k=2)
described = skills.describe(skills.observation[:7] * 1.1).tolist()
print(json.dumps([rows.tolist(), distance.tolist(), truth[0].tolist(), described, skills.values(3), skills.units]))
""",
    )
    goal = throws.observation[5] + 0.1
    goal[:40] = np.nan
    reached = throws.reach(goal, k=4)
    assert found[0] == reached.rows.tolist()
    assert_allclose(found[1], reached.distance)
    nearest = ((throws.ground_truth - (-0.5, -0.3)) / np.ptp(throws.ground_truth, axis=0)) ** 2
    assert found[2] == nearest.sum(axis=1).argsort(kind="stable")[:2].tolist()
    assert_allclose(found[3], throws.describe(throws.observation[:7] * 1.1), atol=1e-9)
    assert found[4] == dict(zip(["angle", "force"], Throw.genes.scale(throws.genotype[3]).tolist(), strict=True))
    assert found[5] == ["deg", ""]
    readme = (folder / "README.md").read_text()
    assert readme.startswith(f"# {len(throws):,} skills\n")
    assert "gene `angle` | | 0 to 90 deg |" in readme
    script = (
        readme.split("```python\n")[1].split("```")[0].replace("print(", "print(json.dumps(").replace(")  # what", "))  # what")
    )
    assert set(alone(folder, script)) == {"angle", "force"}


def test_rows_and_their_numbers(throws, tmp_path):
    folder = throws.deploy(tmp_path / "robot", [7, -1, 3])
    with np.load(folder / "skills.npz", allow_pickle=False) as file:
        assert_array_equal(file["row"], [7, len(throws) - 1, 3])
        for name in ("genotype", "fitness", "descriptor", "ground_truth", "observation"):
            assert_array_equal(file[name], getattr(throws, name)[[7, -1, 3]])
            assert file[name].dtype == getattr(throws, name).dtype
        assert_array_equal(file["bounds"], [[0, 90], [1, 3]])
    found = alone(folder, "print(json.dumps([skills.reach(g, k=3)[1].tolist() for g in skills.ground_truth]))")
    assert_allclose(np.array(found)[:, 0], 0)  # on the scale of the whole repertoire, also where few are left


def test_streams_and_no_ground_truth_and_no_names(tmp_path):
    def two(genotypes):
        return {"place": genotypes[:, :2] ** 2, "camera": (255 * genotypes[:, :1, None]).astype(np.uint8)}

    repertoire = saved(tmp_path / "run", two, PCA(2))
    folder = repertoire.deploy(tmp_path / "robot")
    found = alone(
        folder,
        """
observed = {name: rows[:5] for name, rows in skills.observation.items()}
goals = {"place": [0.5, np.nan]}, {"place": [0.5, 0.1], "camera": [[40.0]]}
said = []
for call in (lambda: skills.values(0), lambda: skills.reach([0.5, 0.1]), lambda: skills.reach({"x": 1}),
             lambda: skills.reach({"place": [0.1]}), lambda: skills.reach(goals[0], k=0),
             lambda: skills.reach(goals[0], "fitness"),
             lambda: skills.reach({"place": [np.nan, np.nan]}), lambda: skills.describe(skills.genotype)):
    try:
        call()
    except ValueError as error:
        said.append(str(error))
reached = [[part.tolist() for part in skills.reach(goal, k=3)] for goal in goals]
print(json.dumps([reached, skills.describe(observed).tolist(), said]))
""",
    )
    for (rows, distance), goal in zip(
        found[0], ({"place": [0.5, np.nan]}, {"place": [0.5, 0.1], "camera": [[40.0]]}), strict=True
    ):
        assert rows == repertoire.reach(goal, k=3).rows.tolist()
        assert_allclose(distance, repertoire.reach(goal, k=3).distance)
    assert_allclose(
        found[1],
        repertoire.describe({"place": repertoire.observation["place"][:5], "camera": repertoire.observation["camera"][:5]}),
        atol=1e-9,
    )
    assert len(found[2]) == 8
    assert "the genes have no names" in found[2][0]
    readme = (folder / "README.md").read_text()
    assert 'skills.reach({"camera": ' in readme
    alone(
        folder,
        readme.split("```python\n")[1].split("```")[0].replace("print(", "print(len(").replace(")  # what", "))  # what"),
    )


def test_a_descriptor_that_is_no_matrix(tmp_path):
    repertoire = saved(tmp_path / "run", Ballistic(), "hand-coded")
    folder = repertoire.deploy(tmp_path / "robot", [0])
    said = """
try:
    skills.describe(skills.observation)
except ValueError as error:
    print(json.dumps(str(error)))
"""
    assert "is not a matrix: it takes auroraqd" in alone(folder, said)
    assert "is not a matrix" in (folder / "README.md").read_text()


def test_what_is_there_is_not_replaced_unasked(throws, tmp_path):
    folder = throws.deploy(tmp_path / "robot", [0])
    with pytest.raises(FileExistsError, match="robot exists: choose another folder, or replace its files with overwrite"):
        throws.deploy(folder)
    throws.deploy(folder, [0, 1], overwrite=True)
    with np.load(folder / "skills.npz") as file:
        assert len(file["genotype"]) == 2
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="file must be a folder, and is a file"):
        throws.deploy(tmp_path / "file", overwrite=True)
    with pytest.raises(IndexError, match="rows must be of the repertoire, 0 to "):
        throws.deploy(tmp_path / "other", [len(throws)])
    assert not (tmp_path / "other").exists()


def test_the_command(throws, tmp_path):
    run, empty = throws._origin.folder, tmp_path / "empty"
    empty.mkdir()
    done = commands.cli("deploy", run, "--rows", "3,1", "--out", tmp_path / "robot")
    assert done.returncode == 0, done.stderr
    assert "2 skills" in done.stdout
    for words, message in (
        (
            (run, "--out", tmp_path / "robot"),
            "robot exists: choose another folder with --out, or replace its files with --overwrite",
        ),
        ((tmp_path / "none",), f"there is no folder {tmp_path / 'none'}"),
        (
            (run, "--rows", "1,two"),
            "--rows must be rows of the repertoire with commas between them, like 3,17,250, got '1,two'",
        ),
        ((run, "--rows", "1,100000"), f"--rows must be of the repertoire, 0 to {len(throws) - 1}, got 100000"),
    ):
        done = commands.cli("deploy", *words, cwd=empty)
        assert done.returncode == 1
        assert message in done.stderr
        assert done.stderr.startswith("Error: ")
    assert list(empty.iterdir()) == []
