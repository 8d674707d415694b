"""`auroraqd new-task`: what it writes works as it is."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import commands
import pytest

import auroraqd

NAME = "sea_otter2"


def command(*arguments, cwd, ok=True):
    done = commands.cli(*arguments, cwd=cwd)
    assert (done.returncode == 0) == ok, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("new")
    done = command("new-task", NAME, cwd=place)
    for name in ("README.md", f"{NAME}.py", "pyproject.toml", "run.toml", f"test_{NAME}.py"):
        assert f"{NAME}/{name}" in done.stdout.splitlines()
    assert f"Next: cd {NAME} && auroraqd run --config run.toml" in done.stdout
    return place / NAME


def test_its_tests_pass(folder):
    here = Path(auroraqd.__file__).parents[1]
    path = os.pathsep.join([str(here), os.environ.get("PYTHONPATH", "")])
    line = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error"]
    done = subprocess.run(line, cwd=folder, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "4 passed" in done.stdout


def test_what_its_readme_says_can_be_done(folder):
    lines = re.findall("auroraqd (?:run|explore) [^`\n]*", (folder / "README.md").read_text())
    assert len(lines) == 3
    for line in lines:
        words = line.split()[1:]
        command(*words, *(["-n", 3, "--no-figures"] if words[0] == "run" else []), cwd=folder)
    assert (folder / "runs" / "first" / "skills.html").stat().st_size
    skills = auroraqd.load(folder / "runs" / "first")
    assert len(skills) > 100
    assert skills.ground_truth is not None
    assert (abs(skills.observation) <= 3).all()
    assert (skills.fitness < 0).all()


def test_all_of_it_has_the_name(folder):
    assert not any("my_task" in path.read_text() for path in folder.iterdir() if path.is_file())
    project = tomllib.loads((folder / "pyproject.toml").read_text())
    assert project["project"]["name"] == project["tool"]["setuptools"]["py-modules"][0] == NAME
    assert f"def {NAME}(genotypes)" in (folder / f"{NAME}.py").read_text()


@pytest.mark.parametrize(
    "name",
    ["", "My_robot", "my-robot", "2legs", "_robot", "robot_", "class", "my robot", "../robot", "robot.py", "röbot", "a\n"],
)
def test_names_that_are_none_for_a_module(tmp_path, name):
    done = command("new-task", "--out", "place", "--", name, cwd=tmp_path, ok=False)
    wanted = "name must be one for a module, of lower-case letters, digits and underscores like my_robot"
    assert f"{wanted}, got {name!r}" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ballistic", "name ballistic is that of a task of auroraqd: choose another"),
        *(
            (name, f"name {name} would stand for something else in the module or its tests")
            for name in ("np", "simulate", "wheels", "len", "check_task", "tests", "test_it")
        ),
        *(
            (name, f"name {name} is that of another module")
            for name in ("numpy", "json", "auroraqd", "sys", "setup", "conftest")
        ),
    ],
)
def test_names_that_would_be_in_the_way(tmp_path, name, message):
    assert message in command("new-task", name, cwd=tmp_path, ok=False).stderr
    assert not list(tmp_path.iterdir())


def test_what_exists_stays(tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    for line in (["robot"], ["other", "--out", "robot"], ["other", "--out", "file"], ["other", "--out", "link"]):
        done = command("new-task", *line, cwd=tmp_path, ok=False)
        assert f"{line[-1]} exists: choose another folder with --out" in done.stderr
    assert not list((tmp_path / "robot").iterdir())
    assert (tmp_path / "file").read_text() == "mine"
    command("new-task", "robot", "--out", "a place/for it", cwd=tmp_path)  # the folder of that name is no module
    assert (tmp_path / "a place" / "for it" / "robot.py").is_file()
    done = command("new-task", "robot", "--out", "file/x", cwd=tmp_path, ok=False)
    assert "the folder file/x could not be created: Not a directory" in done.stderr


def test_from_the_folder_above(tmp_path):
    command("new-task", "snake", cwd=tmp_path)
    told = command("run", "snake:snake", "--out", "run", cwd=tmp_path, ok=False).stderr
    assert "task snake:snake: snake is a folder here, and no module: go there first, cd snake" in told
