"""Nothing is lost: a run that was killed, at any moment, goes on as if it had never ended."""

import json
import os
import shutil
import signal
import subprocess
import time
import warnings
from pathlib import Path

import commands
import killed
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import auroraqd
from auroraqd.emitters import Genetic, Goals, NoveltySearch
from auroraqd.runs import checkpoints, folders

TASK = auroraqd.tasks.Ballistic()
PLAIN = ["--descriptor", "genotype"]  # which starts in half the time


def make(descriptor="pca", seed=1, **options):
    return auroraqd.Aurora(2, PCA(2) if descriptor == "pca" else descriptor, seed=seed, batch_size=50, **options)


def run(*arguments):
    done = commands.python(killed.__file__, *arguments)
    assert done.returncode in (0, -signal.SIGKILL), done.stderr
    return done.returncode == 0


def without_times(folder):
    """All files of a run folder that say what was found."""
    history = [line.rpartition(",")[0] for line in (folder / "history.csv").read_text().splitlines()]
    config = json.loads((folder / "config.json").read_text())
    del config["provenance"]  # the command and the time
    return (folder / "repertoire.safetensors").read_bytes(), history, config


MOMENTS = {
    "pca": ["syncing:1", "moving:2", "asked:7", "syncing:8", "after:0.3", "told:20"],
    "autoencoder": ["training:1", "training:3", "syncing:5", "after:1.5"],
    "genotype": ["after:0.02", "moving:5", "asked:30"],
}


@pytest.mark.parametrize("descriptor", MOMENTS)
def test_killed_and_gone_on_with_it_is_the_same_run(descriptor, tmp_path):
    generations = 120 if descriptor != "autoencoder" else 55  # beyond the second update
    assert run(tmp_path / "alone", descriptor, generations, "never")
    kills = 0
    for moment in MOMENTS[descriptor]:
        kills += not run(tmp_path / "killed", descriptor, generations, moment)
    assert kills >= len(MOMENTS[descriptor]) - 2  # some may come too late
    assert run(tmp_path / "killed", descriptor, generations, "never")
    assert without_times(tmp_path / "killed") == without_times(tmp_path / "alone")


@pytest.mark.parametrize(
    "options",
    [
        {"archive": lambda: auroraqd.GridArchive((30, 30), low=0, high=1), "descriptor": "genotype"},
        {"archive": lambda: auroraqd.CVTArchive(np.random.default_rng(0).random((200, 2))), "descriptor": "genotype"},
        {
            "archive": lambda: auroraqd.UnstructuredArchive(competition="elitist", capacity=500, epsilon=0.2),
            "descriptor": "pca",
        },
        {"variation": auroraqd.IsoLine, "selection": auroraqd.Uniform, "descriptor": "hand-coded"},
        {"schedule": lambda: auroraqd.Every(7), "resolution": lambda: auroraqd.Fixed(0.05), "descriptor": "pca"},
        {"descriptor": lambda: PCA(2, svd_solver="randomized")},
        {"descriptor": lambda: make_pipeline(StandardScaler(), PCA(2, svd_solver="full"))},
        {"archive": lambda: auroraqd.DominatedArchive(200), "descriptor": "pca", "selection": auroraqd.Mixed},
        {"selection": auroraqd.Novelty, "resolution": lambda: auroraqd.CSC(2000), "descriptor": "genotype"},
        {"descriptor": "observation", "prior": TASK.bounds, "archive": lambda: auroraqd.CVTArchive(np.eye(100))},
    ],
    ids=lambda options: "-".join([*options, *(value for value in options.values() if isinstance(value, str))]),
)
@pytest.mark.filterwarnings("ignore:the archive is full")
def test_resumed_after_any_generation_it_is_the_same_run(options, tmp_path):
    def begun():
        return make(**{name: value if isinstance(value, str) else value() for name, value in options.items()})

    auroraqd.save(begun().run(TASK, generations=64), tmp_path / "alone")
    aurora = begun()
    for generations in (1, 2, 40, 11, 10):
        aurora.run(TASK, generations=generations)
        aurora = auroraqd.resume(auroraqd.save(aurora, tmp_path / "resumed"))
    auroraqd.save(aurora, tmp_path / "resumed")
    assert without_times(tmp_path / "resumed") == without_times(tmp_path / "alone")
    assert aurora.history.last.seconds > 0


def test_before_the_first_fit_and_between_ask_and_tell(tmp_path):
    """Individuals that wait for a first fit, an update that is due, and a batch that was asked for: all come back."""

    def sparse(genotypes):
        fitness, observation, truth = TASK(genotypes)
        return np.where(np.arange(len(fitness)) == 0, fitness, np.nan), observation, truth

    alone, aurora = make(), make()
    alone.run(sparse, generations=9)
    for _ in range(9):
        aurora.ask()
        aurora = auroraqd.resume(auroraqd.save(aurora, tmp_path / "asked"))
        aurora.tell(*sparse(aurora.pending))
        aurora = auroraqd.resume(auroraqd.save(aurora, tmp_path / "told"))
    assert len(alone.archive) == len(aurora.archive) > 5
    assert alone.history.column("size")[0] == 0  # they waited
    assert_array_equal(aurora.archive.genotype, alone.archive.genotype)
    assert_array_equal(aurora.ask(), alone.ask())


def test_a_resumed_run_is_a_run_of_its_own(tmp_path):
    aurora = make().run(TASK, generations=5)
    one, other = (auroraqd.resume(auroraqd.save(aurora, tmp_path)) for _ in range(2))
    one.run(TASK, generations=3)
    assert (aurora.generation, one.generation, other.generation) == (5, 8, 5)
    assert_array_equal(other.run(TASK, generations=3).archive.genotype, one.archive.genotype)
    assert repr(one.history.records[:5]) == repr(aurora.history.records)


class Slow:
    """A schedule of the user's own."""

    def __call__(self, generation):
        return generation == 0


def test_parts_of_ones_own_are_given_again(tmp_path):
    auroraqd.save(make(schedule=Slow()).run(TASK, generations=3), tmp_path)
    with pytest.raises(
        ValueError,
        match=r"schedule was .*Slow.*which is not of auroraqd: give it again, resume\(\.\.\., schedule=\.\.\.\), or trust it, "
        r"trusted=\['test_checkpoints.Slow'\]",
    ):
        auroraqd.resume(tmp_path)
    aurora = auroraqd.resume(tmp_path, schedule=Slow()).run(TASK, generations=60)
    assert_array_equal(aurora.archive.genotype, make(schedule=Slow()).run(TASK, generations=63).archive.genotype)
    with pytest.raises(TypeError, match=r"resume takes a selection, .* not shedule"):
        auroraqd.resume(tmp_path, shedule=Slow())


class Fading:
    """An emitter of the user's own: no dataclass, with arguments, and a memory."""

    def __init__(self, spread: float, *, decay: float = 0.9, inner: object = None):
        self.spread, self.decay, self.inner, self.asked = spread, decay, inner, 0

    def ask(self, archive, n, rng):
        self.asked += 1
        rows = rng.integers(len(archive), size=n)
        step = self.spread * self.decay**self.asked * rng.normal(size=(n, archive.genotype.shape[1]))
        return np.clip(archive.genotype[rows] + step, 0, 1), archive.id[rows]

    def state(self):
        return {"asked": self.asked}

    def restore(self, state):
        self.asked = state["asked"]


class Forgetful(Fading):
    """One that does not say what it was made with."""

    def __init__(self, width: float = 0.1):
        super().__init__(width)


class Anyone:
    """A selection of the user's own."""

    def __call__(self, archive, n, rng):
        return rng.integers(len(archive), size=n)


OWN = [f"test_checkpoints.{kind.__name__}" for kind in (Fading, Forgetful, Anyone)]


@pytest.mark.parametrize(
    "emitter",
    [Fading(np.float32(0.25), decay=0.5), [Fading(0.2, inner=Anyone()), Goals()], [Genetic(Anyone()), Goals()]],
    ids=["arguments", "parts", "selection"],
)
def test_emitters_of_ones_own_are_made_again_if_they_are_trusted(emitter, tmp_path):
    aurora = make(emitter=emitter).run(TASK, generations=3)
    auroraqd.save(aurora, tmp_path)
    with pytest.raises(ValueError, match=r"which is not of auroraqd: .* or trust it, trusted=\['test_checkpoints\."):
        auroraqd.resume(tmp_path)
    again = auroraqd.resume(tmp_path, trusted=OWN)
    assert_array_equal(again.run(TASK, generations=2).archive.genotype, aurora.run(TASK, generations=2).archive.genotype)
    with auroraqd.Checkpoints(again, tmp_path):  # it is known to be the same run
        pass


@pytest.mark.parametrize(
    ("emitter", "message"),
    [
        (Forgetful(), r"emitter was 'test_checkpoints\.Forgetful', which is not of auroraqd: give it again"),
        (Fading(0.1, inner=np.eye(2)), r"with numpy\.ndarray as inner, which is not of auroraqd: give it again"),
        (Fading(0.1, inner=make), r"with make as inner, which is not of auroraqd: give it again"),
        (Fading(0.1, inner=[object()]), r"emitter was 'test_checkpoints\.Fading', which is not of auroraqd"),
    ],
)
def test_what_does_not_say_how_it_was_made_is_given_again(emitter, message, tmp_path):
    aurora = make(emitter=emitter).run(TASK, generations=3)
    auroraqd.save(aurora, tmp_path)
    with pytest.raises(ValueError, match=message):
        auroraqd.resume(tmp_path, trusted=OWN)
    again = auroraqd.resume(tmp_path, emitter=emitter)
    assert_array_equal(again.run(TASK, generations=2).archive.genotype, aurora.run(TASK, generations=2).archive.genotype)


def test_one_emitter_does_not_take_the_place_of_several_unasked(tmp_path):
    aurora = make(emitter=[(Genetic(), 2), (Goals(), 1)]).run(TASK, generations=2)
    auroraqd.save(aurora, tmp_path)
    for parts in ({"emitter": Goals()}, {"selection": auroraqd.Uniform()}, {"variation": auroraqd.IsoLine()}):
        with pytest.raises(ValueError, match=r"the run has 2 emitters, Genetic, Goals, and .* give a list, emitter=\[\.\.\.\]"):
            auroraqd.resume(tmp_path, **parts)
    assert len(auroraqd.resume(tmp_path)._emitters.emitters) == 2
    assert auroraqd.resume(tmp_path, emitter=[Goals()])._emitters.emitters == (Goals(),)
    more = auroraqd.resume(
        tmp_path, emitter=[Genetic(), Goals(), NoveltySearch()]
    )  # of which the last has a state, and none yet
    assert more.run(TASK, generations=1).generation == 3


class Corner:
    """A transformer of the user's own."""

    def fit(self, x):
        self.low = x.min(axis=0)
        return self

    def transform(self, x):
        return (x - self.low)[:, -2:]


class Unsavable(Corner):
    def __reduce__(self):
        raise TypeError("it holds a camera")

    def __deepcopy__(self, memo):
        return self


def test_a_transformer_of_ones_own(tmp_path):
    aurora = auroraqd.Aurora(2, Corner(), seed=0, batch_size=50)
    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as saved:
        aurora.run(TASK, generations=3, callback=saved)
    with pytest.raises(ValueError, match=r"cannot go on: the descriptor needs types that are not trusted"):
        auroraqd.resume(tmp_path)
    assert auroraqd.resume(tmp_path, trusted=["test_checkpoints.Corner"]).generation == 3


def test_a_descriptor_that_cannot_be_saved_is_refused_at_the_start(tmp_path):
    aurora = auroraqd.Aurora(2, Unsavable(), seed=0)
    with pytest.raises(ValueError, match="descriptor must be one that can be saved, and Unsavable cannot"):
        auroraqd.Checkpoints(aurora, tmp_path / "run").__enter__()
    assert not (tmp_path / "run").exists()


def test_when_it_is_saved(tmp_path, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(checkpoints.time, "monotonic", lambda: clock[0])
    written = []
    real = folders.write

    def write(aurora, *arguments, **options):
        written.append((clock[0], aurora.generation))
        clock[0] += 0.5  # so long it takes
        return real(aurora, *arguments, **options)

    monkeypatch.setattr(folders, "write", write)

    def callback(aurora):
        clock[0] += 5
        saved(aurora)

    aurora = make("genotype")
    with auroraqd.Checkpoints(aurora, tmp_path, every=10.0) as saved:
        aurora.run(TASK, generations=13, callback=callback)
        assert not saved.saved
    assert saved.saved
    # The first at once; the next when checkpoints have taken 2% of the time; and the end.
    assert [generation for _, generation in written] == [1, 6, 11, 13]
    with auroraqd.Checkpoints(aurora, tmp_path):
        pass
    assert len(written) == 5  # what is there is not known to be the same


def test_the_last_two_are_kept_and_the_one_before_steps_in(tmp_path):
    aurora = make()
    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as saved:
        aurora.run(TASK, generations=4, callback=saved)
    path = tmp_path / "repertoire.safetensors"
    content = path.read_bytes()
    assert auroraqd.resume(tmp_path).generation == 4
    rng = np.random.default_rng(0)
    header = 8 + int.from_bytes(content[:8], "little")
    for position in [
        0,
        3,
        9,
        header - 1,
        *rng.integers(8, header, 15),
        *rng.integers(header, len(content), 15),
        len(content) - 1,
    ]:
        flipped = bytearray(content)
        flipped[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        with pytest.warns(UserWarning, match="the checkpoint before it is taken"):
            assert auroraqd.resume(tmp_path).generation == 3
    for keep in (0, 7, 100, header, len(content) - 1):
        path.write_bytes(content[:keep])
        with pytest.warns(UserWarning, match=r"repertoire\.safetensors is damaged: .*; the checkpoint before it is taken"):
            assert len(auroraqd.load(tmp_path)) > 0
    path.unlink()
    with pytest.warns(UserWarning, match="the checkpoint before it is taken"):
        auroraqd.resume(tmp_path)
    (tmp_path / "repertoire.previous.safetensors").write_bytes(content[:100])
    path.write_bytes(content[:-1])
    with pytest.raises(ValueError, match=r"repertoire\.safetensors is damaged"):
        auroraqd.resume(tmp_path)


def test_a_damaged_checkpoint_never_takes_the_place_of_a_whole_one(tmp_path, monkeypatch):
    aurora = make()
    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as saved:
        aurora.run(TASK, generations=4, callback=saved)
    path = tmp_path / "repertoire.safetensors"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.warns(UserWarning, match="the checkpoint before it is taken"):
        aurora = auroraqd.resume(tmp_path)
    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as saved:
        assert auroraqd.resume(tmp_path).generation == 3  # without a warning
        aurora.run(TASK, generations=1, callback=saved)
        path.write_bytes(b"")
        with pytest.warns(UserWarning, match="the checkpoint before it is taken"):
            assert auroraqd.resume(tmp_path).generation == 3


def test_an_empty_run_in_a_folder(tmp_path):
    """Nothing was found: nothing is left but a lock."""
    with auroraqd.Checkpoints(make(), tmp_path / "run"):
        assert folders.load_config(tmp_path / "run")["seed"] == 1
    assert [path.name for path in (tmp_path / "run").iterdir()] == [".lock"]


def test_another_run_is_not_overwritten(tmp_path):
    auroraqd.save(make().run(TASK, generations=5), tmp_path)
    before = (tmp_path / "repertoire.safetensors").read_bytes()
    for other in (make(seed=2), make("genotype"), make(variation=auroraqd.IsoLine())):
        with pytest.raises(ValueError, match="holds another run: choose another folder, or resume"):
            auroraqd.Checkpoints(other, tmp_path).__enter__()
    with pytest.raises(ValueError, match="holds this run at generation 5, and it is at 0: choose another"):
        auroraqd.Checkpoints(make(), tmp_path).__enter__()
    assert (tmp_path / "repertoire.safetensors").read_bytes() == before
    other = make(seed=2)
    with auroraqd.Checkpoints(other, tmp_path, overwrite=True) as saved:
        assert (tmp_path / "repertoire.safetensors").read_bytes() == before  # while nothing is found
        other.run(TASK, generations=1, callback=saved)
        assert not (tmp_path / "repertoire.previous.safetensors").exists()
    assert auroraqd.resume(tmp_path).seed == 2


def test_saving_replaces_no_other_run(tmp_path):
    """An earlier moment of the same run is replaced, also where the run is made anew, or goes on with other settings."""
    aurora = make()
    for _ in range(3):
        auroraqd.save(aurora.run(TASK, generations=2), tmp_path)
        auroraqd.save(aurora, tmp_path)  # as a cell of a notebook that is run again
    auroraqd.save(make().run(TASK, generations=6), tmp_path)
    auroraqd.save(auroraqd.resume(tmp_path, resolution=auroraqd.Fixed(0.5)).run(TASK, generations=1), tmp_path)
    before = (tmp_path / "repertoire.safetensors").read_bytes()
    other_task = lambda genotypes: TASK(genotypes[:, ::-1])  # noqa: E731
    for other in (make(seed=2).run(TASK, generations=9), make().run(other_task, generations=9), make("genotype", seed=3)):
        with pytest.raises(ValueError, match=r"holds another run: choose another folder, .* replace it with overwrite=True"):
            auroraqd.save(other, tmp_path)
    with pytest.raises(ValueError, match="holds this run at generation 7, and it is at 5"):
        auroraqd.save(make().run(TASK, generations=5), tmp_path)
    assert (tmp_path / "repertoire.safetensors").read_bytes() == before
    auroraqd.save(make(seed=2).run(TASK, generations=1), tmp_path, overwrite=True)
    assert auroraqd.resume(tmp_path).seed == 2
    (tmp_path / "repertoire.safetensors").write_bytes(b"broken")
    with pytest.raises(ValueError, match="damaged"):
        auroraqd.save(make(), tmp_path)
    auroraqd.save(make(), tmp_path, overwrite=True)
    assert auroraqd.resume(tmp_path).generation == 0
    with pytest.raises(ValueError, match="overwrite must be True or False, got 2"):
        auroraqd.save(make(), tmp_path, overwrite=2)


def test_two_at_once_in_a_folder(tmp_path):
    first, second = make(), make()
    with auroraqd.Checkpoints(first, tmp_path):
        with pytest.raises(BlockingIOError, match="is in use: another process has a run there"):
            auroraqd.Checkpoints(second, tmp_path).__enter__()
        done = commands.cli("run", "ballistic", "-n", 2, "--out", tmp_path, "--overwrite")
        assert done.returncode == 1
        assert "is in use: another process has a run there" in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr
    with auroraqd.Checkpoints(second, tmp_path):
        pass


def test_misuse_is_said(tmp_path):
    saved = auroraqd.Checkpoints(make(), tmp_path / "run")
    with pytest.raises(RuntimeError, match="checkpoints are written inside their `with` block"):
        saved()
    with saved, pytest.raises(RuntimeError, match="these checkpoints are open already"):
        saved.__enter__()
    with saved:  # but one after the other
        pass
    with pytest.raises(ValueError, match="every must be a finite number, 0 or more, got nan"):
        auroraqd.Checkpoints(make(), tmp_path, every=float("nan"))
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="file must be a folder, and is a file"):
        auroraqd.Checkpoints(make(), tmp_path / "file").__enter__()
    with pytest.raises(NotADirectoryError, match=r"the folder .*file/x could not be created: Not a directory"):
        auroraqd.Checkpoints(make(), tmp_path / "file" / "x").__enter__()
    (tmp_path / "run" / ".lock").unlink()
    (tmp_path / "run" / ".lock").mkdir()
    with pytest.raises(IsADirectoryError, match=r"nothing can be written into .*run: Is a directory"):
        auroraqd.Checkpoints(make(), tmp_path / "run").__enter__()


def test_an_archive_that_does_not_fit(tmp_path):
    aurora = make().run(TASK, generations=2)
    auroraqd.save(aurora, tmp_path)
    for wrong in (auroraqd.GridArchive((5, 5)), aurora.archive):
        with pytest.raises(ValueError, match="archive must be an empty UnstructuredArchive, as before, got "):
            auroraqd.resume(tmp_path, archive=wrong)
    assert len(auroraqd.resume(tmp_path, archive=auroraqd.UnstructuredArchive(k=3)).archive) == len(aurora.archive)


def test_a_disk_that_is_full_for_a_while(tmp_path, monkeypatch):
    aurora, said, real = make(), [], folders.write

    def full(*arguments, **options):
        raise OSError(28, "no space left on device")

    def callback(aurora):
        monkeypatch.setattr(folders, "write", full if 2 <= aurora.generation <= 3 else real)
        saved(aurora)

    with auroraqd.Checkpoints(aurora, tmp_path, every=0, report=said.append) as saved:
        aurora.run(TASK, generations=5, callback=callback)
    assert said == [f"no checkpoint at generation {g}: [Errno 28] no space left on device" for g in (2, 3)]
    assert auroraqd.resume(tmp_path).generation == 5
    with (
        pytest.raises(OSError, match="no space"),
        auroraqd.Checkpoints(aurora, tmp_path, every=0) as saved,
        pytest.warns(UserWarning, match="no checkpoint at generation"),
    ):
        aurora.run(TASK, generations=1, callback=lambda aurora: (monkeypatch.setattr(folders, "write", full), saved())[1])
    assert auroraqd.resume(tmp_path).generation == 5


@pytest.fixture
def small_disk(tmp_path):
    place = tmp_path / "disk"
    place.mkdir()
    if shutil.which("mount") is None or os.geteuid() != 0:
        pytest.skip("only root can mount a small disk")
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", place], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        pytest.skip(f"no small disk here: {done.stderr}")
    yield place
    subprocess.run(["umount", place], check=True)


def test_a_disk_that_is_full(small_disk):
    aurora, said = make(), []
    with (
        pytest.raises(OSError, match=r"(repertoire\.safetensors|history\.csv) could not be written: No space left"),
        auroraqd.Checkpoints(aurora, small_disk / "run", every=0, report=said.append) as saved,
    ):
        aurora.run(TASK, generations=100, callback=saved)
    assert said
    assert aurora.generation == 100
    found = auroraqd.resume(small_disk / "run")
    assert 0 < found.generation < 100
    assert not list((small_disk / "run").glob("*.tmp"))


def test_another_machine_or_version(tmp_path):
    auroraqd.save(make().run(TASK, generations=2), tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    config["environment"].update(machine="riscv128", numpy="1.0")
    (tmp_path / "config.json").write_text(json.dumps(config))
    with pytest.raises(
        ValueError, match=rf"another environment, numpy 1\.0 and not {np.__version__}, machine riscv128 and not"
    ):
        auroraqd.resume(tmp_path)
    assert auroraqd.resume(tmp_path, any_environment=True).generation == 2


def test_a_history_that_is_damaged_costs_only_times(tmp_path):
    auroraqd.save(make().run(TASK, generations=4), tmp_path)
    (tmp_path / "history.csv").write_text("generation\nx\n")
    with pytest.warns(UserWarning, match="the times of the generations so far are lost"):
        aurora = auroraqd.resume(tmp_path)
    assert aurora.history.column("size").tolist() == make().run(TASK, generations=4).history.column("size").tolist()
    assert aurora.run(TASK, generations=1).history.last.seconds > 0


@pytest.mark.parametrize("damage", [{"settings": None}, {"random": {}}, {"archive": {}}, {"seed": None}, {}])
def test_a_checkpoint_that_lacks_something(tmp_path, damage):
    """Whole, but not what it should be."""
    aurora = make().run(TASK, generations=2)
    auroraqd.save(aurora, tmp_path)
    arrays, kind = folders._tensors.read(tmp_path / "repertoire.safetensors", folders._FORMAT)
    values = json.loads(arrays["state.json"].tobytes())
    values = {**values, **damage} if damage else {}
    values = {name: value for name, value in values.items() if value is not None}
    arrays["state.json"] = np.frombuffer(json.dumps(values).encode(), np.uint8)
    folders._tensors.write(tmp_path / "repertoire.safetensors", arrays, folders._FORMAT, kind)
    with pytest.raises(ValueError, match=r"does not hold what a run needs to go on|cannot go on: "):
        auroraqd.resume(tmp_path)
    assert len(auroraqd.load(tmp_path)) == len(aurora.archive)


def command(*arguments, code=0, cwd=None):
    done = commands.cli(*arguments, cwd=cwd)
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return " ".join((done.stderr if code else done.stdout + done.stderr).split())


def test_command_goes_on_and_further(tmp_path):
    command("run", "ballistic", *PLAIN, "-n", 60, "--no-figures", "--out", tmp_path / "alone")
    out = tmp_path / "extended"
    command("run", "ballistic", *PLAIN, "-n", 20, "--out", out)
    assert "is at its end, at generation 20 with 20 asked for: --generations with a larger number" in command(
        "resume", out, code=1
    )
    assert "60 generations" in command("resume", out, "-n", 60, "--no-figures")
    assert without_times(out) == without_times(tmp_path / "alone")
    assert list((out / "figures").iterdir()) == []  # they showed generation 20


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_command_that_was_ended_goes_on(tmp_path, end):
    arguments = ["run", "ballistic", *PLAIN, "-n", 800, "--batch-size", 100, "--no-figures", "--out", tmp_path / "ended"]
    process = subprocess.Popen([*commands.CLI, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 120
    while not (tmp_path / "ended" / "repertoire.safetensors").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(end)
    process.communicate(timeout=60)
    assert process.returncode == (-signal.SIGKILL if end == signal.SIGKILL else 130)
    assert auroraqd.resume(tmp_path / "ended").generation < 800
    command("resume", tmp_path / "ended", "--no-figures")
    command(*arguments[:-1], tmp_path / "alone")
    assert without_times(tmp_path / "ended") == without_times(tmp_path / "alone")


def test_command_that_was_killed_before_its_first_checkpoint(tmp_path):
    command("run", "ballistic", *PLAIN, "-n", 5, "--no-figures", "--out", tmp_path / "alone")
    (tmp_path / "killed").mkdir()
    shutil.copy(tmp_path / "alone" / "config.json", tmp_path / "killed")
    command("resume", tmp_path / "killed", "--no-figures")
    assert without_times(tmp_path / "killed") == without_times(tmp_path / "alone")


def test_command_goes_on_with_a_run_that_was_saved_from_python(tmp_path):
    out, alone = tmp_path / "run", tmp_path / "alone"
    auroraqd.save(make().run(auroraqd.tasks.Ballistic(), generations=3), out)
    auroraqd.save(make().run(auroraqd.tasks.Ballistic(), generations=6), alone)
    assert "at generation 3, and does not say how many there are to be: give --generations" in command("resume", out, code=1)
    assert "is at its end, at generation 3 with 2 asked for" in command("resume", out, "-n", 2, code=1)
    assert "has 8 genes now, and the run in" in command("resume", out, "-n", 6, "--task", "air-hockey", code=1)
    command("resume", out, "-n", 6, "--no-figures")
    assert without_times(out) == without_times(alone)


def test_command_goes_on_with_a_task_of_a_script(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import sys\n"
        "import auroraqd\n"
        "from sklearn.decomposition import PCA\n"
        "class Own(PCA):\n"
        "    pass\n"
        "def robot(genotypes):\n"
        "    return genotypes[:, :, None] * [1.0, 2.0]\n"
        "robot.n_genes = 3\n"
        "class Arm:\n"
        "    n_genes = 3\n"
        "    def __init__(self, length=1):\n"
        "        self.length = length\n"
        "    def __call__(self, genotypes):\n"
        "        return robot(genotypes) * self.length\n"
        "def run(generations, out):\n"
        "    from mine import Own\n"
        "    auroraqd.save(auroraqd.Aurora(3, Own(2), seed=1, batch_size=20).run(robot, generations=generations), out)\n"
        "if __name__ == '__main__':\n"
        "    run(3, 'scripted')\n"
        "    run(6, 'alone')\n"
        "    import mine\n"
        "    auroraqd.save(auroraqd.Aurora(3, PCA(2), seed=1, batch_size=20).run(mine.Arm(5), generations=3), 'arm')\n"
    )
    commands.python("mine.py", cwd=tmp_path)
    said = command("resume", "scripted", "-n", 6, code=1, cwd=tmp_path)
    assert "its task cannot be imported from anywhere: say where it is, --task mymodule:my_task" in said
    said = command("resume", "arm", "-n", 6, code=1, cwd=tmp_path)
    assert "was made of mine:Arm with arguments that are not known" in said
    named = "resume", "scripted", "-n", 6, "--no-figures", "--task", "mine:robot"
    assert "--trusted" in command(*named, code=1, cwd=tmp_path)
    assert "Warning" not in command(*named, "--trusted", "mine.Own", cwd=tmp_path)  # it is the same code
    assert without_times(tmp_path / "scripted")[:2] == without_times(tmp_path / "alone")[:2]


def test_individuals_told_in_parts_are_saved_at_the_end(tmp_path):
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=100)
    with auroraqd.Checkpoints(aurora, tmp_path, every=1000) as checkpoints:
        for part in range(19):
            proposal = aurora.ask(10)
            aurora.tell(*TASK(proposal.genotype), ticket=proposal.ticket)
            if part == 9:
                checkpoints()
    again = auroraqd.resume(tmp_path)
    assert (again.evaluations, len(again.archive)) == (190, len(aurora.archive))


def test_a_task_is_of_a_run_once_it_is_told(tmp_path):
    def other(genotypes):
        return np.ones((len(genotypes), 7))

    auroraqd.save(make().run(TASK, generations=3), tmp_path)
    before = folders.load_config(tmp_path)["provenance"]["task"]
    aurora = auroraqd.resume(tmp_path)
    with pytest.warns(UserWarning, match="the task was"), pytest.raises(auroraqd.TaskError, match="ground_truth must be given"):
        aurora.run(other, generations=1)
    auroraqd.save(aurora, tmp_path)
    assert folders.load_config(tmp_path)["provenance"]["task"] == before


@pytest.mark.parametrize("state", [None, 5, {"a/b": np.ones(2)}, {"a": np.array(["x"])}, {"a": 1j}, {1: 2}, "raise"])
def test_a_state_that_cannot_be_kept_names_the_emitter(state, tmp_path):
    class Odd:
        def ask(self, archive, n, rng):
            return rng.random((n, 2)), np.full(n, -1)

        def state(self):
            if state == "raise":
                raise ValueError("boo")
            return state

    aurora = make(emitter=Odd()).run(TASK, generations=1)
    wanted = r"emitter Odd (must return a dict|raised in `state`: ValueError: boo)"
    with pytest.raises(auroraqd.emitters.EmitterError, match=wanted):
        auroraqd.save(aurora, tmp_path)
    said = []

    def goes_on():
        with auroraqd.Checkpoints(aurora, tmp_path / "on", every=0, report=said.append) as checkpoints:
            aurora.run(TASK, generations=2, callback=checkpoints)

    with pytest.raises(auroraqd.emitters.EmitterError, match=wanted):
        goes_on()
    assert aurora.generation == 3
    assert len(said) == 2


def test_settings_of_ones_own_may_have_any_name(tmp_path):
    auroraqd.save(make().run(auroraqd.tasks.Ballistic(), generations=3), tmp_path, config={"task": "my boat", "lr": 1})
    command("resume", tmp_path, "-n", 4, "--no-figures")
    assert folders.load_config(tmp_path)["task"] == "my boat"


def test_mistakes_get_a_sentence(tmp_path):
    out = tmp_path / "run"
    assert f"there is no folder {out}" in command("resume", out, code=1)
    out.mkdir()
    assert "is no run folder: there is no config.json in it" in command("resume", out, code=1)
    auroraqd.save(make().run(TASK, generations=3), out)
    assert "so it was saved from Python" in command("repeat", out, "--out", tmp_path / "again", code=1)
    command("run", "ballistic", *PLAIN, "-n", 6, "--no-figures", "--out", tmp_path / "cli")
    config = json.loads((tmp_path / "cli" / "config.json").read_text())
    (tmp_path / "cli" / "config.json").write_text(json.dumps({**config, "seed": 7, "generations": 9}))
    assert "config.json has been changed, seed 7 and not 0: the run cannot go on" in command("resume", tmp_path / "cli", code=1)
    (tmp_path / "cli" / "config.json").write_text(json.dumps({**config, "environment": {"machine": "abacus"}}))
    assert "--any-environment" in command("resume", tmp_path / "cli", "-n", 8, code=1)
    command("resume", tmp_path / "cli", "-n", 8, "--any-environment", "--no-figures")
    said = command("resume", tmp_path / "cli", "-n", 9, "--task", "ballistic", code=1)
    assert "--task and --trusted are for runs that were saved from Python" in said
    path = tmp_path / "cli" / "repertoire.safetensors"
    path.write_bytes(path.read_bytes()[:-5])
    said = command("resume", tmp_path / "cli", "-n", 10, "--no-figures")
    assert "Warning:" in said
    assert "the checkpoint before it is taken" in said


def test_loading_while_it_runs(tmp_path):
    aurora, sizes = make("genotype"), []

    def callback(aurora):
        saved(aurora)
        sizes.append(len(auroraqd.load(tmp_path)) == len(aurora.archive))

    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as saved, warnings.catch_warnings():
        aurora.run(TASK, generations=5, callback=callback)
    assert sizes == [True] * 5
    assert Path(tmp_path / "history.csv").is_file()
