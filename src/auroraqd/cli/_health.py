"""What auroraqd stands on, and what is wrong with it: findings of one check after the other, none of which ends the command."""

import logging
import os
import platform
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import auroraqd

if TYPE_CHECKING:
    from packaging.requirements import Requirement

_MODULES = {"scikit-learn": "sklearn"}  # of packages that are not called like theirs
_FOR_DEVELOPERS = {"test", "docs", "develop", "peers"}  # extras
_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "JAX_PLATFORMS", "XLA_FLAGS")
_OF_LIBRARY = {"openblas": "OPENBLAS_NUM_THREADS", "mkl": "MKL_NUM_THREADS", "blis": "BLIS_NUM_THREADS"}
_PATIENCE = 120  # s, for another process
_DRAW = "from auroraqd.tasks._drawing import gl_context as c; made = c(); print(type(made).__module__); made.free()"


class Finding(NamedTuple):
    """What was looked at, what was found, and what is wrong, if something is, with what to do about it."""

    name: str
    found: str
    wrong: str = ""


def findings() -> Iterator[Finding]:
    """All that there is to know, one after the other."""
    given = dict(os.environ)  # before libraries change it
    checks: dict[str, Callable[[], Iterator[Finding]]] = {
        "auroraqd": _versions,
        "packages": _packages,
        "extras": _extras,
        "cores": _cores,
        "BLAS": _blas,
        "Numba": _numba,
        "JAX": _jax,
        "compiled kernels": partial(_kernels, given),
        "centroids": partial(_results, given),
        "Matplotlib's fonts": partial(_fonts, given),
        "drawing robots": _drawing,
        "videos": _videos,
    }
    for name, check in checks.items():
        with _quiet():
            found = _asked(name, check)
        yield from found


def _asked(name: str, check: Callable[[], Iterator[Finding]]) -> list[Finding]:
    found: list[Finding] = []
    try:
        found.extend(check())
    except (Exception, SystemExit) as error:  # whatever broken libraries do
        found.append(Finding(name, "unknown", _in_words(error)))
    return found


def _in_words(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]


@contextmanager
def _quiet() -> Iterator[None]:
    """What libraries warn of and log when they are imported: what matters of it is told by the checks."""
    before = logging.root.manager.disable
    logging.disable()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logging.disable(before)


# What is installed


def _versions() -> Iterator[Finding]:
    home = Path(auroraqd.__file__).parent
    installed = _version("auroraqd")
    wrong = ""
    if installed is None:
        wrong = f"it is read from {home} and not installed, so nobody knows what it needs: pip install it"
    elif installed != auroraqd.__version__:
        wrong = f"{installed} was installed, and what is there now is {auroraqd.__version__}: install it again"
    yield Finding("auroraqd", f"{auroraqd.__version__}, {home}", wrong)
    yield Finding("Python", f"{platform.python_version()}, {sys.executable}")
    yield Finding("system", platform.platform())


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _requirements(extra: str) -> "list[Requirement]":
    """Those of an extra; "": those that there are in any case."""
    from packaging.requirements import Requirement

    try:
        texts = metadata.requires("auroraqd") or []
    except metadata.PackageNotFoundError:
        return []
    found = [Requirement(text) for text in texts]
    always = [each for each in found if each.marker is None or each.marker.evaluate({"extra": ""})]
    if not extra:
        return always
    return [each for each in found if each not in always and each.marker and each.marker.evaluate({"extra": extra})]


def _fits(requirement: "Requirement", version: str | None) -> bool:
    return version is not None and requirement.specifier.contains(version, prereleases=True)


def _packages() -> Iterator[Finding]:
    """What must be there: that it is, in a version that will do, and can be imported."""
    with suppress(ImportError):
        from auroraqd._caches import place_for_matplotlib

        place_for_matplotlib()
    good = []
    for each in _requirements(""):
        version = _version(each.name)
        wanted = f"{each.name}{each.specifier}"
        if not _fits(each, version):
            wrong = f'auroraqd needs {wanted}: pip install "{wanted}"'
            yield Finding(each.name, version or "missing", wrong)
            continue
        try:
            import_module(_MODULES.get(each.name, each.name.replace("-", "_")))
        except (Exception, SystemExit) as error:
            wrong = f'it cannot be imported, {_in_words(error)}: pip install --force-reinstall "{wanted}"'
            yield Finding(each.name, f"{version}", wrong)
        else:
            good.append(f"{each.name} {version}")
    yield Finding("packages", ", ".join(good))


def _extras() -> Iterator[Finding]:
    """What may be there; nothing of it is imported, for some take long."""
    try:
        extras = metadata.metadata("auroraqd").get_all("Provides-Extra") or []
    except metadata.PackageNotFoundError:
        return
    for extra in sorted(set(extras) - _FOR_DEVELOPERS):
        known = {each: _version(each.name) for each in _requirements(extra)}
        lacking = [f"{each.name}{each.specifier}" for each, version in known.items() if not _fits(each, version)]
        there = [f"{each.name} {version}" for each, version in known.items() if version is not None]
        lacks = [f'lacks {" ".join(lacking)}: pip install "auroraqd[{extra}]"'] if lacking else []
        yield Finding(f"extra {extra}", ", ".join([*there, *lacks]))


# What it computes with


def _cores() -> Iterator[Finding]:
    from auroraqd._workers import cores

    limit = _processors()
    quota = f", of which a quota leaves {limit}" if limit < len(cores()) else ""
    yield Finding("cores", f"{len(cores())} of {os.cpu_count()}{quota}")
    given = [f"{name}={os.environ[name]}" for name in _SETTINGS if name in os.environ]
    yield Finding("environment", " ".join(given) or "sets no threads")


def _processors() -> int:
    """How many can be used at once, by affinity and by the quota of a container."""
    import joblib

    return joblib.cpu_count()


def _blas() -> Iterator[Finding]:
    for module in ("numpy", "scipy.linalg", "sklearn.cluster"):  # each may bring its own
        import_module(module)
    from threadpoolctl import threadpool_info

    limit = _processors()
    for library in threadpool_info():
        name, threads = library["internal_api"], library["num_threads"]
        kind = " ".join(str(library[key]) for key in ("version", "architecture", "threading_layer") if library.get(key))
        variable = _OF_LIBRARY.get(name, "OMP_NUM_THREADS")
        many = f"it uses {threads} threads, and there are {limit} cores, which is slow: set {variable}={limit}"
        found = f"{name} {kind}".strip() + f", {_threads(threads)}, {Path(library['filepath']).name}"
        yield Finding({"blas": "BLAS", "openmp": "OpenMP"}.get(library["user_api"], "threads"), found, many * (threads > limit))


def _threads(n: int) -> str:
    return f"{n} thread{'s' * (n != 1)}"


def _numba() -> Iterator[Finding]:
    import numba
    from numba.core import config

    slow = "NUMBA_DISABLE_JIT is set, so nothing is compiled, and all is some hundred times slower: unset it"
    off, layer = bool(vars(config)["DISABLE_JIT"]), vars(config)["THREADING_LAYER"]
    found = f"{_threads(numba.get_num_threads())}, threading layer {layer}; kernels of auroraqd use one"
    yield Finding("Numba", found, slow * off)


def _jax() -> Iterator[Finding]:
    import jax

    try:
        devices = jax.devices()
    except RuntimeError as error:
        wrong = f"it finds nothing to compute with, {_in_words(error)}: JAX_PLATFORMS=cpu makes it use the processor"
        yield Finding("JAX", "no device", wrong)
        return
    yield Finding("JAX", ", ".join(f"{device.platform} {device.device_kind}" for device in devices))


# Where it keeps things


def _kernels(given: dict[str, str]) -> Iterator[Finding]:
    from auroraqd.archives import _neighbours

    kernel: Any = _neighbours.replaces
    if not hasattr(kernel, "stats"):
        yield Finding("compiled kernels", "none, for nothing is compiled")
        return
    place = kernel.stats.cache_path
    yield _kept("compiled kernels", place, "NUMBA_CACHE_DIR", given, "they are compiled anew each time, some 10 s")


def _results(given: dict[str, str]) -> Iterator[Finding]:
    from auroraqd._caches import cache_folder

    yield _kept("centroids", cache_folder(), "AURORAQD_CACHE", given, "those of CVT are computed anew each time")


def _fonts(given: dict[str, str]) -> Iterator[Finding]:
    from auroraqd._caches import can_write, place_for_matplotlib

    named, place = given.get("MPLCONFIGDIR"), None
    if not named or can_write(Path(named)):  # Matplotlib takes a folder that is gone when it ends
        place_for_matplotlib()
        import matplotlib as mpl

        place = mpl.get_cachedir()
    yield _kept("Matplotlib's fonts", place, "MPLCONFIGDIR", given, "it looks for them each time, some seconds")


def _kept(name: str, place: Any, variable: str, given: dict[str, str], lost: str) -> Finding:
    """Where something is kept, which is wrong if it does not last."""
    from auroraqd._caches import private_folder

    named, private = given.get(variable), private_folder()
    elsewhere = f"{variable} must name a folder that can be written" + (f", and {named} cannot" if named else "")
    if place is None:
        return Finding(name, "nowhere", f"{lost}: {elsewhere}")
    path = Path(place)
    if private is not None and path.is_relative_to(private):
        return Finding(name, f"{path}", f"they are among temporary files, and go with them: {elsewhere}")
    if named and not path.is_relative_to(Path(named).absolute()):
        return Finding(name, f"{path}", elsewhere)
    return Finding(name, f"{path}")


# What it draws with


def _drawing() -> Iterator[Finding]:
    """In another process: libraries that draw end it where they do not work."""
    known = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    setting = " ".join(f"{name}={os.environ[name]}" for name in known if os.environ.get(name)) or "no display"
    if find_spec("mujoco") is None:
        yield Finding("drawing robots", "MuJoCo is not there")
        return
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _DRAW], capture_output=True, text=True, timeout=_PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        yield Finding("drawing robots", setting, f"the library hangs, for {_PATIENCE} s: name another, MUJOCO_GL=osmesa")
        return
    if done.returncode == 0:
        yield Finding("drawing robots", f"{done.stdout.strip()}, {setting}")
    elif done.returncode < 0:
        ended = f"the library ended its process by signal {-done.returncode}: name another, MUJOCO_GL=osmesa"
        yield Finding("drawing robots", setting, ended)
    else:
        said = (done.stderr.strip().splitlines() or ["it failed"])[-1]
        yield Finding("drawing robots", setting, said.removeprefix("ValueError: "))


def _videos() -> Iterator[Finding]:
    from auroraqd.report.videos import ffmpeg

    try:
        yield Finding("videos", f"{ffmpeg()}")
    except ValueError:
        yield Finding("videos", "no ffmpeg: .gif only")
