"""The command line, run as a command."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import commands
import numpy as np
import pytest
from matplotlib import image
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.cli import UserError, discover
from auroraqd.cli.show import _errors, report
from auroraqd.experiments import settings
from auroraqd.history import Record
from auroraqd.runs import folders

PLAIN = ["--descriptor", "genotype"]  # which starts in half the time


def command(*arguments, cwd=None, ok=True):
    done = commands.cli(*arguments, cwd=cwd)
    assert (done.returncode == 0) == ok, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "first"
    command("run", "ballistic", "--generations", 30, "--batch-size", 50, "--seed", 4, "--out", folder)
    return folder


def test_installed_command_and_help():
    script = Path(sys.executable).with_name("auroraqd")
    done = subprocess.run([script, "--help"], capture_output=True, text=True, check=True)
    for word in ("run", "show", "repeat", "reproduce"):
        assert word in done.stdout
    assert auroraqd.__version__ in command("--version").stdout


def test_the_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "auroraqd", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"auroraqd {auroraqd.__version__}\n"


def test_help_imports_nothing_heavy():
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "auroraqd", "--help"], capture_output=True, text=True, check=True
    )
    for module in ("numpy", "numba", "sklearn", "matplotlib", "scipy", "jax", "equinox"):
        assert f"| {module}\n" not in done.stderr


def test_run_leaves_what_it_promises(run_folder):
    names = {str(path.relative_to(run_folder)) for path in run_folder.rglob("*") if path.is_file()}
    figures = {f"figures/{name}.{suffix}" for name in ("repertoire", "history", "skills") for suffix in ("png", "svg")}
    checkpoints = {"repertoire.safetensors", "repertoire.previous.safetensors"}
    snapshots = {"snapshots/00000001.safetensors"}
    assert names == {".lock", "config.json", "history.csv"} | checkpoints | snapshots | figures
    assert len(auroraqd.load(run_folder)) > 100
    assert folders.load_history(run_folder)[-1].evaluations == 1500
    assert folders.load_config(run_folder)["seed"] == 4


def test_figures_are_not_blank(run_folder):
    for path in (run_folder / "figures").glob("*.png"):
        pixels = image.imread(path)[..., :3]
        assert min(pixels.shape[:2]) > 300
        assert (pixels < 0.9).any(axis=2).mean() > 0.01
        assert len(np.unique((pixels * 8).astype(int).reshape(-1, 3), axis=0)) > 5
    for path in (run_folder / "figures").glob("*.svg"):
        assert path.read_text().rstrip().endswith("</svg>")


def test_the_same_as_from_python(run_folder):
    from sklearn.decomposition import PCA

    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=4, batch_size=50).run(task, generations=30)
    assert_array_equal(auroraqd.load(run_folder).genotype, aurora.archive.genotype)


def test_show_prints_and_redraws(run_folder):
    picture = run_folder / "figures" / "repertoire.png"
    before = picture.read_bytes()
    picture.unlink()
    done = command("show", run_folder)
    assert f"{len(auroraqd.load(run_folder)):,} individuals" in done.stdout
    shares = auroraqd.load(run_folder).explained()
    takes = [int(np.argmax(shares >= share)) + 1 for share in (0.8, 0.9, 0.95, 0.99)]
    assert "80%: {}, 90%: {}, 95%: {}, 99%: {}".format(*takes) in " ".join(done.stdout.split())
    assert picture.read_bytes() == before


@pytest.mark.parametrize("parts", [False, True])
def test_show_says_which_network_was_chosen(parts, tmp_path, capsys):
    def robot(genotypes):
        return {"one": genotypes, "other": genotypes} if parts else (np.zeros(len(genotypes)), genotypes)

    encoder = auroraqd.AutoEncoder(2, hidden=(4,), repeats=1, min_steps=100)
    descriptor = auroraqd.Streams(one=encoder, other=PCA(2)) if parts else encoder
    auroraqd.save(auroraqd.Aurora(3, descriptor, seed=0).run(robot, generations=1), tmp_path)
    report(tmp_path, figures=False)
    said = capsys.readouterr().out
    assert f"network      {'one ' if parts else ''}MLP(hidden=(4,))" in said


def test_show_says_of_no_network_where_there_is_none(run_folder, capsys):
    report(run_folder, figures=False)
    assert "network" not in capsys.readouterr().out


def test_errors_on_individuals_that_are_new_are_those_since_the_last_update(capsys):
    """What an earlier descriptor erred by says nothing of the one there is."""
    records = [Record(g, 10 * g, 5, 0.1, 0, 0, 0, 0, 0.0, 0.0, 0.05, rmse_new=0.9 if g < 11 else 0.06) for g in range(1, 13)]
    doubling = {"type": "Doubling", "first": 10}
    assert _errors(records, doubling)[1] == ("", "0.0600 of individuals it was not fitted on, the last 2 generations")
    assert "0.7600 of" in _errors(records, None)[1][1]
    assert _errors(records, None)[1][1].endswith("the last 12 generations: the descriptor does not generalise")


def test_show_says_that_pixels_are_many(tmp_path, capsys):
    def camera(genotypes):
        return (200 * (np.arange(256).reshape(16, 16) < 256 * genotypes[:, :1, None])).astype(np.uint8)

    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=0, batch_size=20).run(camera, generations=2)
    report(auroraqd.save(aurora, tmp_path), figures=False)
    assert "more than it takes, for it sees images" in " ".join(capsys.readouterr().out.split())


def test_what_was_found_is_shown_where_figures_cannot_be(run_folder, tmp_path):
    for name in ("config.json", "history.csv", "repertoire.safetensors"):
        (tmp_path / name).write_bytes((run_folder / name).read_bytes())
    (tmp_path / "figures").touch()
    done = command("show", tmp_path, ok=False)
    assert f"{len(auroraqd.load(run_folder)):,} individuals" in done.stdout
    said = f"figures could not be drawn, --no-figures leaves them out: {tmp_path}/figures must be a folder, and is a file"
    assert said in " ".join(done.stderr.split())


def test_repeat_is_the_same_run(tmp_path):
    settings = ["--descriptor", "genotype", "--variation", "gaussian:sigma=0.1,at_least_one=false", "--selection", "uniform"]
    settings += ["--resolution", "fixed:l=0.02", "--schedule", "every:generations=3", "--k", "3", "--competition", "elitist"]
    command("run", "ballistic", "-n", 10, *settings, "--out", tmp_path / "one", "--no-figures")
    command("repeat", tmp_path / "one", "--out", tmp_path / "two", "--no-figures")
    one, two = tmp_path / "one", tmp_path / "two"
    assert (one / "repertoire.safetensors").read_bytes() == (two / "repertoire.safetensors").read_bytes()
    configs = [json.loads((folder / "config.json").read_text()) for folder in (one, two)]
    assert configs[0].pop("provenance")["task"] == configs[1].pop("provenance")["task"]
    assert configs[0] == configs[1]
    assert not (one / "figures").exists()
    assert folders.load_config(one)["resolution"] == {"type": "Fixed", "l": 0.02}


def test_default_folder_and_lines_of_progress(tmp_path):
    done = command("run", "ballistic", "-n", 3, "--descriptor", "hand-coded", "--no-figures", cwd=tmp_path)
    assert "generation 3/3" in done.stdout
    assert len(auroraqd.load(tmp_path / "runs" / "ballistic-hand-coded-0")) > 100


def test_a_run_is_not_overwritten_without_being_told_to(tmp_path):
    out = tmp_path / "one"
    arguments = ["run", "ballistic", *PLAIN, "-n", 2, "--no-figures", "--out", out]
    command(*arguments)
    before = (out / "repertoire.safetensors").read_bytes()
    done = command(*arguments, "--seed", 1, ok=False)
    assert "--overwrite" in done.stderr
    assert (out / "repertoire.safetensors").read_bytes() == before
    command(*arguments, "--seed", 1, "--overwrite")
    assert (out / "repertoire.safetensors").read_bytes() != before


def test_folders_of_others_are_never_touched(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    done = command("run", "ballistic", "-n", 2, "--out", tmp_path, "--overwrite", ok=False)
    assert "no run folder" in done.stderr
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_a_task_that_fails_keeps_what_was_found(tmp_path, monkeypatch):
    """As `auroraqd run` does it, with a task that breaks down in its fifth generation."""
    calls = []

    class Breaking(auroraqd.tasks.Ballistic):
        def __call__(self, genotypes):
            calls.append(len(genotypes))
            if len(calls) == 8:  # three of them are for compilation
                raise OSError("motor stalled")
            return super().__call__(genotypes)

    monkeypatch.setitem(settings.TASKS, "ballistic", Breaking)
    with pytest.raises(UserError, match=r"generation 4 raised OSError: motor stalled.*what was found is in"):
        discover._run(settings.Settings(generations=20), tmp_path / "run", overwrite=False, figures=False)
    assert folders.load_history(tmp_path / "run")[-1].generation == 4


def test_run_with_an_autoencoder(tmp_path):
    """Its training is shown, its weights come back, and the run can be repeated."""
    options = [
        "--descriptor",
        "autoencoder:hidden=16x8,noise=3,repeats=2,max_epochs=3,min_steps=200",
        "-n",
        3,
        "--batch-size",
        60,
    ]
    done = command("run", "ballistic", *options, "--out", tmp_path / "first")
    assert "RMSE" in done.stdout
    command("repeat", tmp_path / "first", "--out", tmp_path / "again", "--no-figures")
    first, again = (tmp_path / name / "repertoire.safetensors" for name in ("first", "again"))
    assert first.read_bytes() == again.read_bytes()
    repertoire = auroraqd.load(tmp_path / "first")
    np.testing.assert_allclose(repertoire.describe(repertoire.observation), repertoire.descriptor, atol=1e-12)
    assert repertoire.reconstruct(repertoire.descriptor).shape == repertoire.observation.shape


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--components", "500"], "PCA could not be fitted on observations of shape"),
        (["--descriptor", "autoencoder", "--components", "101"], "n_components must be at most 100"),
    ],
)
def test_a_descriptor_that_can_never_be_fitted_ends_the_run_with_a_sentence(tmp_path, options, message):
    """By its first fit: more individuals have no more entries."""
    done = commands.cli("run", "ballistic", "-n", 50, "--batch-size", 20, *options, cwd=tmp_path)
    assert done.returncode == 1
    said = " ".join(done.stderr.split())
    assert "Traceback" not in said
    assert message in said[said.index("Error: ") :]
    assert "Warning" not in said


def test_run_air_hockey(tmp_path):
    command("run", "air-hockey", "-n", 10, "--out", tmp_path / "run")
    repertoire = auroraqd.load(tmp_path / "run")
    assert repertoire.genotype.shape[1] == 8
    assert_array_equal(repertoire.ground_truth, repertoire.observation[:, -1])
    grid = ["--descriptor", "hand-coded", "--archive", "grid:cells=15"]
    command("run", "air-hockey", "-n", 10, *grid, "--out", tmp_path / "grid", "--no-figures")
    assert 10 < len(auroraqd.load(tmp_path / "grid")) <= 225


@pytest.mark.parametrize(
    ("options", "dimensions"),
    [
        (["--archive", "grid:cells=10", "--descriptor", "hand-coded"], 2),
        (["--archive", "cvt:cells=50,samples=200", "--descriptor", "observation"], 100),
        (["--archive", "cvt:cells=50,samples=200,low=0", "--descriptor", "genotype"], 2),
        (["--archive", "cvt-prior", "--descriptor", "observation", "--pretrained"], 100),
        (["--descriptor", "pca", "--pretrained", "--no-figures"], 2),
        (["--archive", "dominated:capacity=50", "--emitter", "taxons:population=30"], 2),
        (["--selection", "mixed", "--resolution", "csc:target=500", "--no-figures"], 2),
    ],
)
def test_run_with_other_archives_and_pretrained(tmp_path, monkeypatch, options, dimensions):
    monkeypatch.setenv("AURORAQD_CACHE", str(tmp_path / "cache"))
    command("run", "ballistic", *options, "-n", 5, "--out", tmp_path / "run")
    repertoire = auroraqd.load(tmp_path / "run")
    assert repertoire.descriptor.shape[1] == dimensions
    if "observation" in options:
        assert_array_equal(repertoire.describe(repertoire.observation), repertoire.descriptor)
    config = folders.load_config(tmp_path / "run")
    assert settings.Settings.from_json(config).as_json() == {
        k: v for k, v in config.items() if k not in ("environment", "provenance")
    }


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_it_found(tmp_path, stop):
    out = tmp_path / "run"
    process = subprocess.Popen(
        [*commands.CLI, "run", "ballistic", *PLAIN, "-n", "100000000", "--out", str(out), "--no-figures"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        assert "ballistic" in process.stdout.readline()
        deadline = time.monotonic() + 120
        while not (out / folders.REPERTOIRE).exists() and time.monotonic() < deadline:  # written after the first generation
            time.sleep(0.1)
        process.send_signal(stop)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "Interrupted after" in errors
    assert len(auroraqd.load(out)) > 100
    assert folders.load_history(out)[-1].size == len(auroraqd.load(out))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["run", "juggling"],
            "task must be one of ballistic, air-hockey, air-hockey-camera, maze, hexapod, octopus-arm, or your own, written",
        ),
        (
            ["run", "ballistic", "--descriptor", "magic"],
            "descriptor must be one of pca, autoencoder, hand-coded, genotype, observation, got 'magic'",
        ),
        (["run", "ballistic", "--descriptor", "pca:whiten=true"], "descriptor must be one of"),
        (
            ["run", "ballistic", "--descriptor", "autoencoder:size=2"],
            "descriptor 'autoencoder' has no option 'size'; its options",
        ),
        (["run", "ballistic", "--descriptor", "autoencoder:noise=-1"], "noise must be a finite number, 0 or more, got -1"),
        (["run", "ballistic", "--descriptor", "autoencoder:noise=much"], "noise must be a number, got 'much'"),
        (["run", "ballistic", "--descriptor", "autoencoder:hidden=big"], "hidden must be whole numbers like 64x32, got 'big'"),
        (
            ["run", "ballistic", "--descriptor", "autoencoder:isometry=-1"],
            "isometry must be a finite number, 0 or more, got -1",
        ),
        (["run", "ballistic", "--descriptor", "genotype", "--pretrained"], "pretrained is for descriptors that are learned"),
        (["run", "air-hockey", "--pretrained"], "pretrained is for tasks with a prior data set, and air-hockey has none"),
        (["run", "ballistic", "--archive", "cvt-prior"], "archive 'cvt-prior' needs descriptor 'observation' and pretrained"),
        (
            ["run", "ballistic", *PLAIN, "--archive", "cvt:cells=10,samples=5"],
            "samples must be a whole number, 10 or more, got 5",
        ),
        (["run", "ballistic", *PLAIN, "--archive", "grid:low=2"], "low must be below high"),
        (
            ["run", "ballistic", "--archive", "tree"],
            "archive must be one of unstructured, grid, cvt, cvt-prior, dominated, got 'tree'",
        ),
        (["run", "ballistic", *PLAIN, "--generations", "0"], "generations must be a whole number, 1 or more"),
        (["run", "ballistic", "--generations", "many"], "integer"),
        (["run", "ballistic", *PLAIN, "--epsilon", "2"], "epsilon must be a finite number, 0 or more and below 1"),
        (["run", "ballistic", *PLAIN, "--seed", "-1"], "seed must be a whole number, from 0 to"),
        (["run", "ballistic", *PLAIN, "--k", "999999999999"], "k must be a whole number, from 1 to 1000000"),
        (
            ["run", "ballistic", *PLAIN, "--batch-size", "99999999999999"],
            "batch_size must be a whole number, from 1 to 100000000",
        ),
        (["run", "ballistic", *PLAIN, "--capacity", "99999999999999999999"], "capacity must be a whole number"),
        (["run", "ballistic", *PLAIN, "--variation", "crossover"], "variation must be one of"),
        (["run", "ballistic", *PLAIN, "--variation", "polynomial:rat=0.1"], "has no option 'rat'; its options are: rate, eta"),
        (["run", "ballistic", *PLAIN, "--variation", "polynomial:rate=often"], "rate must be a number, got 'often'"),
        (["run", "ballistic", *PLAIN, "--variation", "polynomial:rate=3"], "rate must be a finite number, a probability"),
        (["run", "ballistic", *PLAIN, "--schedule", "every"], "write every:generations=VALUE"),
        (["show", "nowhere"], "there is no folder nowhere"),
        (["show", "."], "is no run folder"),
        (["repeat", "nowhere", "--out", "x"], "there is no folder nowhere"),
        (["run", "ballistic", "--out", "/dev/null/x"], "the folder /dev/null/x could not be created: Not a directory"),
        (["run", "ballistic", "--out", "x" * 300], f"{'x' * 300}: File name too long"),
        (["reproduce", "ballistic", "--quick", "--out", "/dev/null"], "/dev/null must be a folder, and is a file"),
        (["reproduce", "ballistic", "--quick", "--out", "/dev/null/x"], "the folder /dev/null/x could not be created: Not a"),
    ],
)
def test_mistakes_get_a_sentence_and_no_traceback(tmp_path, arguments, message):
    done = command(*arguments, cwd=tmp_path, ok=False)
    assert message in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert "Errno" not in done.stderr


def test_a_damaged_run_folder(run_folder, tmp_path):
    for name in ("config.json", "history.csv", "repertoire.safetensors"):
        (tmp_path / name).write_bytes((run_folder / name).read_bytes())
    (tmp_path / "repertoire.safetensors").write_bytes(b"\x00" * 100)
    done = command("show", tmp_path, ok=False)
    assert "is damaged" in done.stderr
    (tmp_path / "config.json").write_text('{"task": "ballistic"}')
    done = command("repeat", tmp_path, "--out", tmp_path / "again", ok=False)
    assert "cannot be run again" in done.stderr


def test_a_task_with_a_parameter(tmp_path):
    task = "air-hockey:restitution_threshold=1"
    command("run", task, "-n", 3, "--batch-size", 60, "--no-figures", cwd=tmp_path)
    folder = tmp_path / "runs" / "air-hockey-pca-0"
    repertoire = auroraqd.load(folder)
    evaluated = auroraqd.tasks.AirHockey(restitution_threshold=1.0)(repertoire.genotype)
    np.testing.assert_array_equal(evaluated.observation, repertoire.observation)
    assert (auroraqd.tasks.AirHockey()(repertoire.genotype).observation != repertoire.observation).any()
    command("repeat", folder, "--out", tmp_path / "again", "--no-figures")
    np.testing.assert_array_equal(auroraqd.load(tmp_path / "again").genotype, repertoire.genotype)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (
            "hockey",
            "task must be one of ballistic, air-hockey, air-hockey-camera, maze, hexapod, octopus-arm, or your own, written",
        ),
        ("air-hockey:mass=1", "task 'air-hockey' has no option 'mass'; its options are: restitution_threshold"),
        ("air-hockey:restitution_threshold=-1", "restitution_threshold must be a finite number, 0 or more, got -1"),
        ("air-hockey:energy=true,energy=false", "task 'air-hockey' must have each option once, got 'energy' twice"),
        ("ballistic:wind=1", "task 'ballistic' has no option 'wind'; its options are: none"),
    ],
)
def test_tasks_that_are_not(tmp_path, task, message):
    assert message in " ".join(command("run", task, cwd=tmp_path, ok=False).stderr.split())
    assert not (tmp_path / "runs").exists()


def test_names_of_files_are_no_markup(tmp_path):
    done = command("run", "ballistic", *PLAIN, "-n", 2, "--no-figures", "--out", "q[/x][red]:smile:", cwd=tmp_path)
    assert "q[/x][red]:smile:/repertoire.safetensors" in done.stdout
    assert "task nomod:x: there is no module nomod" in command("run", "nomod:x", cwd=tmp_path, ok=False).stderr


OWN = """
import os, sys
import numpy as np

def plain(g): return g[:, 0], g, g
def elsewhere(g): os.chdir({elsewhere!r}); return g[:, 0], g
def leaves(g): sys.exit(0)
plain.n_genes = elsewhere.n_genes = leaves.n_genes = int(os.environ.get("GENES", 2))
"""


def test_tasks_of_ones_own_that_have_not_what_is_asked_for_or_do_what_they_must_not(tmp_path, monkeypatch):
    (tmp_path / "other").mkdir()
    (tmp_path / "own.py").write_text(OWN.format(elsewhere=str(tmp_path / "other")))
    (tmp_path / "gone.py").write_text("import sys; sys.exit(0)")
    small = ["-n", 3, "--batch-size", 20, "--no-figures"]
    command("run", "own:plain", "--descriptor", "hand-coded", "--archive", "grid:low=0", *small, "--out", "grid", cwd=tmp_path)
    for options, message in (
        (["--pretrained"], "pretrained needs a prior data set, and task plain has no method prior()"),
        (["--descriptor", "observation", "--archive", "grid"], "task plain has no method bounds()"),
        (["--descriptor", "hand-coded", "--archive", "grid", "own:elsewhere"], "task elsewhere gives none"),
    ):
        name = options.pop() if options[-1].startswith("own:") else "own:plain"
        done = command("run", name, *options, *small, cwd=tmp_path, ok=False)
        assert message in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr
    command("run", "own:elsewhere", *small, "--out", "moved", cwd=tmp_path)
    assert len(auroraqd.load(tmp_path / "moved")) > 5
    assert not any((tmp_path / "other").iterdir())
    assert "called sys.exit(0)" in command("run", "own:leaves", *small, cwd=tmp_path, ok=False).stderr
    assert "cannot be imported: SystemExit" in command("run", "gone:x", *small, cwd=tmp_path, ok=False).stderr
    monkeypatch.setenv("GENES", "3")
    changed = command("resume", "moved", "-n", 5, cwd=tmp_path, ok=False)
    assert "has 3 genes now, and the run in moved has 2" in " ".join(changed.stderr.split())


def test_an_individual_that_takes_too_long_is_invalid(tmp_path):
    (tmp_path / "slow.py").write_text(
        "import time\nimport numpy as np\n"
        "def task(genotypes):\n"
        "    if genotypes[:, 0].max() > 0.9:\n        time.sleep(100)\n"
        "    return np.stack([genotypes, genotypes], axis=1)\n"
        "task.n_genes = 2\n"
    )
    arguments = ["run", "slow:task", *PLAIN, "-n", 1, "--batch-size", 8, "--no-figures", "--out", "run"]
    done = command(*arguments, "--timeout", 1, cwd=tmp_path, ok=False)
    assert "--timeout needs workers" in done.stderr
    done = command(*arguments, "--jobs", 1, "--timeout", 0, cwd=tmp_path, ok=False)
    assert "timeout must be more than 0 seconds, got 0" in done.stderr
    command(*arguments, "--jobs", 1, "--timeout", 1, "--seed", 6, cwd=tmp_path)
    record = folders.load_history(tmp_path / "run")[-1]
    assert (record.evaluations, record.invalid) == (8, 1)
    done = command("resume", "run", "-n", 2, "--timeout", 1, cwd=tmp_path, ok=False)
    assert "--timeout needs workers" in done.stderr
