"""Where it is installed: in an image whose files its user cannot write, for a user without a home."""

import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.version import Version

import auroraqd
from auroraqd import _caches

SOMEBODY = 54321  # a user that the system does not know, as in a container
READS = "-all,+dac_read_search"  # as in an image that is for all to read; and no other right of root's
AS_SOMEBODY = ["setpriv", f"--reuid={SOMEBODY}", f"--regid={SOMEBODY}", "--clear-groups"]
AS_SOMEBODY += [f"--inh-caps={READS}", f"--ambient-caps={READS}", f"--bounding-set={READS}"]
# Nothing but the first argument can be written, not even temporary files.
FROZEN = """
set -e
for place in /tmp /var/tmp; do mount --bind $place $place; done
mount --bind "$1" "$1"
for place in /tmp /var/tmp; do mount -o remount,bind,ro $place; done
cd "$1"; shift; exec "$@"
"""
RUN = ["-m", "auroraqd", "run", "ballistic", "-n", "1", "--descriptor", "genotype"]
RUN += ["--archive", "dominated:capacity=200"]  # which has few kernels to compile


def works(*line):
    return shutil.which(line[0]) is not None and not subprocess.run([*line, "true"], stderr=subprocess.DEVNULL).returncode


pytestmark = pytest.mark.skipif(not works(*AS_SOMEBODY), reason="only root can become somebody else")


@pytest.fixture
def place():
    """A folder that all can read; not below that of pytest, which is for its user only."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.fixture
def folder(place):
    """Of somebody: the only one where they can write."""
    out = place / "out"
    out.mkdir()
    os.chown(out, SOMEBODY, SOMEBODY)
    return out


def as_somebody(arguments, folder, *confined, **environment):
    kept = {name: os.environ[name] for name in ("PATH", "PYTHONPATH", "OPENBLAS_CORETYPE") if name in os.environ}
    kept["PYTHONPATH"] = os.pathsep.join([str(Path(auroraqd.__file__).parents[1]), kept.get("PYTHONPATH", "")])
    return subprocess.run(
        [*confined, *AS_SOMEBODY, sys.executable, *arguments],
        cwd=folder, env=kept | environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def test_kernels_are_kept_among_temporary_files_where_nothing_else_can_be_written(folder, place):
    temporary = place / "temporary"
    temporary.mkdir()
    temporary.chmod(0o1777)
    first = as_somebody([*RUN, "--out", "first"], folder, TMPDIR=str(temporary))
    again = as_somebody([*RUN, "--out", "again"], folder, TMPDIR=str(temporary))
    private = temporary / f"auroraqd-{SOMEBODY}"
    for done in (first, again):
        assert done.returncode == 0, done.stderr
        assert f"compiled kernels are kept in {private}" in done.stderr
        assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "compiling kernels" in first.stdout
    assert "compiling kernels" not in again.stdout
    assert private.stat().st_mode & 0o777 == 0o700
    assert {path.name for path in folder.iterdir()} == {"first", "again"}
    assert (folder / "first" / "figures" / "repertoire.png").stat().st_size
    assert {path.name for path in private.iterdir()} == {"kernels", "matplotlib"}


@pytest.mark.skipif(
    Version(version("matplotlib")) < Version("3.11"), reason="earlier ones of Matplotlib cannot be imported without a home"
)
@pytest.mark.skipif(not works("unshare", "--mount"), reason="this container cannot mount")
def test_it_runs_without_a_cache_where_not_even_temporary_files_can_be_written(folder):
    code = """
import auroraqd, auroraqd.report
auroraqd.Aurora(2, 'genotype', seed=0).ask()
observation = auroraqd.tasks.Ballistic()([[0.5, 0.5], [0.6, 0.9]]).observation
encoder = auroraqd.AutoEncoder(2, hidden=(4,), max_epochs=1, min_steps=1, repeats=1, random_state=0).fit(observation)
print(encoder.transform(observation).shape)
"""
    done = as_somebody(["-c", code], folder, "unshare", "--mount", "bash", "-c", FROZEN, "bash", str(folder))
    assert done.returncode == 0, done.stderr
    assert done.stdout == "(2, 2)\n"
    assert done.stderr.count("compiled anew each time") == 1
    assert "Traceback" not in done.stderr
    assert "jax" not in done.stderr.lower()
    assert not list(folder.iterdir())


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    tmp_path.chmod(0o1777)
    monkeypatch.setattr(_caches.tempfile, "tempdir", str(tmp_path))
    _caches.private_folder.cache_clear()
    yield tmp_path
    _caches.private_folder.cache_clear()


def test_a_private_folder_is_made_and_found_again(temporary):
    folder = _caches.private_folder()
    assert folder == temporary / f"auroraqd-{os.geteuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    _caches.private_folder.cache_clear()
    assert _caches.private_folder() == folder


@pytest.mark.parametrize("kind", ["of another", "for others to write", "for others to read", "a link", "a file"])
def test_what_others_could_have_put_there_is_not_used(temporary, kind):
    place = temporary / f"auroraqd-{os.geteuid()}"
    if kind == "a link":
        (temporary / "trap").mkdir(mode=0o700)
        place.symlink_to(temporary / "trap")
    elif kind == "a file":
        place.touch()
    else:
        place.mkdir(mode=0o700)
        place.chmod({"for others to write": 0o770, "for others to read": 0o750}.get(kind, 0o700))
        if kind == "of another":
            os.chown(place, SOMEBODY, SOMEBODY)
    assert _caches.private_folder() is None


def test_no_private_folder_where_others_could_replace_it(temporary):
    temporary.chmod(0o777)
    assert _caches.private_folder() is None


def test_results_are_kept_in_the_private_folder_where_the_home_cannot_be_written(temporary, monkeypatch):
    monkeypatch.delenv("AURORAQD_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(temporary / "home"))
    assert _caches.cache_folder() == temporary / "home" / "auroraqd"
    shutil.rmtree(temporary / "home")
    (temporary / "home").touch()
    assert _caches.cache_folder() == _caches.private_folder()
    monkeypatch.setenv("AURORAQD_CACHE", str(temporary / "home" / "named"))
    assert _caches.cache_folder() is None


def test_a_folder_that_the_user_names_wins(folder):
    code = "from auroraqd.emitters import variation; print(variation._step.stats.cache_path)"
    named = str(folder / "named")
    done = as_somebody(["-W", "error", "-c", code], folder, NUMBA_CACHE_DIR=named)
    assert done.stdout.startswith(named), done.stderr


def test_it_is_said_once(temporary):
    _caches.say_where_kernels_are.cache_clear()
    with pytest.warns(UserWarning, match="compiled kernels are kept in .*auroraqd-"):
        _caches.say_where_kernels_are()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _caches.say_where_kernels_are()


def test_all_kernels_find_a_place():
    """Numba's own `njit(cache=True)` raises where there is none."""
    for path in Path(auroraqd.__file__).parent.rglob("*.py"):
        assert path.name == "_compiled.py" or "cache=True" not in path.read_text().replace("cache: bool = True", ""), path


def test_a_doctor_says_so(folder, place):
    temporary = place / "temporary"
    temporary.mkdir()
    temporary.chmod(0o1777)
    done = as_somebody(["-m", "auroraqd", "doctor"], folder, TMPDIR=str(temporary))
    assert done.returncode == 1
    assert not done.stderr
    wrong = done.stdout.partition("What is wrong:")[2]
    for name, variable in (("compiled kernels", "NUMBA_CACHE_DIR"), ("centroids", "AURORAQD_CACHE"), ("fonts", "MPLCONFIGDIR")):
        said = f"{name}: they are among temporary files, and go with them: {variable} must name a folder that can be written"
        assert said in wrong
    assert str(temporary) in done.stdout
