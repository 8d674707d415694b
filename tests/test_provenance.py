"""What a run folder says about the task, and what is said when the task has changed."""

import functools
import importlib
import json
import sys
import warnings

import commands
import numpy as np
import pytest

import auroraqd
from auroraqd import evaluate, provenance
from auroraqd.runs.folders import load_config
from auroraqd.tasks import Genes, each, repeated

MODULE = """
import numpy as np
import auroraqd
SPEED = 2.0
def helper(x):
    "How far."
    return x * 1.0
def robot(genotypes):
    return helper(genotypes) * SPEED  # as fast as that
robot.n_genes = 2
robot.genes = auroraqd.tasks.Genes(angle=(0, 3, "rad"), speed=(0, 2))
class Robot:
    n_genes = 2
    def __call__(self, genotypes):
        return helper(genotypes)
made = Robot()
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Writes a module of the user's, and imports it anew."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def write(*changes):
        text = MODULE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "my_robots.py").write_text(text)
        sys.modules.pop("my_robots", None)
        importlib.invalidate_caches()
        return importlib.import_module("my_robots")

    yield write
    sys.modules.pop("my_robots", None)


def grown(task):
    return auroraqd.Aurora(2, "genotype", seed=0, batch_size=10).run(task, generations=2)


@pytest.mark.parametrize("name", ["robot", "made"])
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("x * 1.0", "x * 1.5"), True),
        (("as fast as that", "a comment"), False),
        (("How far.", "A docstring."), False),
        (("SPEED = 2.0", "SPEED = 3.0"), None),
    ],
)
def test_a_task_whose_code_has_changed_is_told_once(written, tmp_path, name, change, says):
    folder = auroraqd.save(grown(getattr(written(), name)), tmp_path / "run")
    says = name == "robot" if says is None else says  # the other does not read it
    aurora, task = auroraqd.resume(folder), getattr(written(change), name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        aurora.run(task, generations=1)
        aurora.run(task, generations=1)
    assert [str(w.message).partition(" since")[0] for w in caught] == [f"the code of task my_robots:{name} has changed"] * says


def test_what_is_kept(written, tmp_path):
    folder = auroraqd.save(grown(written().robot), tmp_path / "run")
    task = load_config(folder)["provenance"]["task"]
    assert (task["module"], task["name"], task["repr"]) == ("my_robots", "robot", None)
    assert task["versions"]["numpy"] == np.__version__
    assert provenance.importable(load_config(folder)) == "my_robots:robot"
    assert load_config(folder)["provenance"]["date"].endswith("+00:00")
    pytest.importorskip("pandas")
    repertoire = auroraqd.load(folder)
    table = repertoire.to_pandas()
    assert list(table)[:2] == ["angle", "speed"]
    np.testing.assert_allclose(table["angle"], 3 * repertoire.genotype[:, 0])
    assert provenance.genes_in(repertoire.config).units == ["rad", ""]
    assert list(repertoire.to_pandas(Genes(a=(0, 1), b=(0, 1))))[:2] == ["a", "b"]


def test_another_task_is_told(tmp_path, written):
    module = written()
    folder = auroraqd.save(grown(module.robot), tmp_path / "run")
    with pytest.warns(UserWarning, match="the task was my_robots:robot and is my_robots:made since the run was saved"):
        auroraqd.resume(folder).run(module.made, generations=1)
    auroraqd.resume(folder).run(evaluate.over(evaluate.processes(1), module.robot), generations=0)  # it is the same


def test_what_is_within(written):
    module = written()
    inner = provenance.described(module.robot)["code"]
    for task in (functools.partial(module.robot), repeated(module.robot, 2), each(module.robot)):
        found = provenance.described(task)
        assert (found["module"], found["name"], found["code"]) == ("my_robots", "robot", inner)

    class Odd:
        def __call__(self, genotypes):
            return genotypes

        def __getattribute__(self, name):
            raise RuntimeError("do not look")

    assert provenance.described(Odd())["code"] is None


def test_damaged_provenance_is_none():
    for config in ({}, {"provenance": 3}, {"provenance": {"task": []}}, {"provenance": {"task": {"genes": 3}}}):
        assert provenance.importable(config) is None
        assert provenance.genes_in(config) is None


def test_the_command_line(written, tmp_path):
    written()
    options = ["my_robots:robot", "--descriptor", "genotype", "-n", "3", "--out", "run", "--no-figures"]

    def command(*arguments):
        done = commands.cli(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done

    command("run", *options)
    kept = json.loads((tmp_path / "run" / "config.json").read_text())["provenance"]
    assert "my_robots:robot --descriptor genotype" in kept["command"]
    written(("x * 1.0", "x * 1.5"))
    done = command("resume", "run", "-n", "4", "--no-figures")
    assert "Warning: the code of task my_robots:robot has changed since the run was saved" in " ".join(done.stderr.split())
    auroraqd.save(grown(written().robot), tmp_path / "python")
    assert "my_robots:robot" in command("show", "python", "--no-figures").stdout


def test_the_first_command_stays_and_later_ones_are_kept(tmp_path, monkeypatch):
    def provenance():
        return auroraqd.load(tmp_path).config["provenance"]

    monkeypatch.setattr(sys, "argv", ["first"])
    aurora = auroraqd.Aurora(2, "genotype", seed=0, batch_size=5).run(auroraqd.tasks.Ballistic(), generations=1)
    auroraqd.save(aurora, tmp_path)
    first = provenance()
    for command in ("second", "third"):
        monkeypatch.setattr(sys, "argv", [command])
        aurora = auroraqd.resume(tmp_path)
        for _ in range(2):
            auroraqd.save(aurora.run(auroraqd.tasks.Ballistic(), generations=1), tmp_path)
    assert (first["command"], "resumed" in first) == ("first", False)
    assert {name: provenance()[name] for name in ("command", "date")} == {name: first[name] for name in ("command", "date")}
    assert [one["command"] for one in provenance()["resumed"]] == ["second", "third"]
