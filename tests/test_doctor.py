"""`auroraqd doctor`: it says what is there, and what is wrong, whatever is broken."""

import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import commands
import pytest

import auroraqd
from auroraqd import _workers
from auroraqd.cli import _health

PLACES = {"AURORAQD_CACHE": "centroids", "MPLCONFIGDIR": "Matplotlib's fonts", "NUMBA_CACHE_DIR": "compiled kernels"}
SECTIONS = {"packages", "cores", "BLAS", "Numba", "JAX", "drawing robots", *PLACES.values()}


def doctor(**environment):
    """In a new process, for libraries are imported once."""
    path = [environment.pop("PYTHONPATH", ""), str(Path(auroraqd.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    there = {name: value for name, value in os.environ.items() if name not in PLACES}
    there |= {"PYTHONPATH": os.pathsep.join(filter(None, path)), **environment}
    line = [sys.executable, "-m", "auroraqd", "doctor"]
    return subprocess.run(line, env=there, capture_output=True, text=True, timeout=300, check=False)


def wrong(done):
    """What is wrong, by what it is about."""
    assert not done.stderr, done.stderr
    found, _, said = done.stdout.partition("\nWhat is wrong:\n")
    assert (done.returncode == 1) == bool(said), done.stdout
    assert done.returncode in (0, 1)
    assert bool(said) != ("Nothing is wrong." in found)
    return dict(re.match(r"- (.*?): (.*)", line).groups() for line in said.splitlines())


def test_what_is_there_is_told():
    done = commands.cli("doctor")  # where warnings are errors
    lines = dict(re.findall(r"^(\S.*?)  +(.*)$", done.stdout, re.MULTILINE))
    assert set(wrong(done)) <= {"drawing robots"}, done.stdout  # for which a library of the system is needed
    assert lines.keys() >= SECTIONS
    assert lines["auroraqd"] == f"{auroraqd.__version__}, {Path(auroraqd.__file__).parent}"
    assert lines["Python"].endswith(sys.executable)
    for package in ("numpy", "scikit-learn", "jax"):
        assert f"{package} {metadata.version(package)}" in lines["packages"]
    assert f"bokeh {metadata.version('bokeh')}" in lines["extra explore"]
    assert re.fullmatch(rf"{len(_workers.cores())} of {os.cpu_count()}( .*)?", lines["cores"])
    assert re.search(r"openblas|mkl|blis|accelerate", lines["BLAS"])
    assert "cpu" in lines["JAX"]
    assert Path(lines["compiled kernels"]).is_dir()


def test_places_that_cannot_be_written_and_settings_that_harm(tmp_path):
    """A file cannot be a folder, also for root."""
    file = tmp_path / "file"
    file.touch()
    done = doctor(**dict.fromkeys(PLACES, str(file)), JAX_PLATFORMS="abacus", OMP_NUM_THREADS="4321")
    said = wrong(done)
    for variable, name in PLACES.items():
        assert f"{variable} must name a folder that can be written, and {file} cannot" in said[name]
    assert "abacus" in said["JAX"]
    assert "JAX_PLATFORMS=cpu makes it use the processor" in said["JAX"]
    assert "OMP_NUM_THREADS=4321" in done.stdout
    if "libgomp" in done.stdout:
        assert re.search(r"it uses 4321 threads, and there are \d+ cores, which is slow: set OMP_NUM_THREADS=", said["OpenMP"])


def test_libraries_that_are_missing_or_broken(tmp_path):
    broken = {
        "jax": "raise RuntimeError('built for another\\nprocessor')",
        "skops": "import sys; sys.exit(3)",
        "threadpoolctl": "1 / 0",
        "mujoco": "import os; os.abort()",
    }
    for name, code in broken.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(code)
    old = tmp_path / "optax-0.0.1.dist-info"
    old.mkdir()
    (old / "METADATA").write_text("Metadata-Version: 2.1\nName: optax\nVersion: 0.0.1\n")
    bokeh = tmp_path / "bokeh-1.0.dist-info"
    bokeh.mkdir()
    (bokeh / "METADATA").write_text("Metadata-Version: 2.1\nName: bokeh\nVersion: 1.0\n")
    done = doctor(PYTHONPATH=str(tmp_path), MUJOCO_GL="egl", NUMBA_DISABLE_JIT="1")
    said = wrong(done)
    assert "it cannot be imported, RuntimeError: built for another processor: pip install --force-reinstall" in said["jax"]
    assert "RuntimeError: built for another processor" in said["JAX"]
    assert "it cannot be imported, SystemExit: 3" in said["skops"]
    assert "ZeroDivisionError" in said["BLAS"]
    assert re.fullmatch(r'auroraqd needs optax[<>=.,\d]+: pip install "optax[<>=.,\d]+"', said["optax"])
    assert re.search(r'bokeh 1.0, lacks bokeh[<>=.,\d]+: pip install "auroraqd\[explore\]"', done.stdout)
    assert "extra explore" not in said
    assert "signal 6: name another" in said["drawing robots"]
    assert "NUMBA_DISABLE_JIT is set" in said["Numba"]
    assert said.keys().isdisjoint({"numba", "numpy", "compiled kernels", "centroids", "cores"})


def test_a_package_that_is_not_installed(monkeypatch):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    for asked in ("version", "requires", "metadata"):
        monkeypatch.setattr(_health.metadata, asked, missing)
    found = {finding.name: finding for check in (_health._versions, _health._packages, _health._extras) for finding in check()}
    assert "not installed" in found["auroraqd"].wrong
    monkeypatch.setattr(_health.metadata, "version", lambda name: "0.0.7")
    assert "0.0.7 was installed" in next(_health._versions()).wrong


def test_nothing_that_a_check_does_ends_the_command():
    def dies():
        yield _health.Finding("one", "1")
        raise SystemExit(4)

    assert _health._asked("two", dies) == [("one", "1", ""), ("two", "unknown", "SystemExit: 4")]


@pytest.mark.parametrize("reason", ["hangs", "fails"])
def test_drawing_that_does_not_work(monkeypatch, reason):
    def run(*arguments, **options):
        if reason == "hangs":
            raise subprocess.TimeoutExpired("python", 1)
        return subprocess.CompletedProcess([], 1, "", "Traceback\nValueError: there is no library to draw robots with")

    monkeypatch.setattr(_health.subprocess, "run", run)
    [finding] = _health._drawing()
    assert (
        finding.wrong
        == {
            "hangs": "the library hangs, for 120 s: name another, MUJOCO_GL=osmesa",
            "fails": "there is no library to draw robots with",
        }[reason]
    )
