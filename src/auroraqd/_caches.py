"""Folders for what can be made again: the user's cache, or where nobody can write that, a private one among temporary files."""

import multiprocessing
import os
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import platformdirs


def cache_folder() -> Path | None:
    """Where results are kept: `AURORAQD_CACHE`; or `auroraqd` in the cache folder of the system, or our private folder.

    None where none of them can be written.
    """
    if given := os.environ.get("AURORAQD_CACHE"):
        return Path(given) if can_write(Path(given)) else None
    folder = _own_folder(partial(platformdirs.user_cache_dir, opinion=False), "auroraqd")
    return folder if folder is not None and can_write(folder) else private_folder()


def _own_folder(kind: Callable[..., str], name: str) -> Path | None:
    """A folder of this user, or None where no home is known: some versions of platformdirs raise then, others leave a `~`."""
    try:
        folder = Path(kind(name, appauthor=False))
    except RuntimeError:
        return None
    return folder if folder.is_absolute() else None


@cache
def private_folder() -> Path | None:
    """A folder below the temporary one that nobody else can write, or None: what is read from it may be executed."""
    try:
        parent = Path(_temporary_folder())
        path = parent / f"auroraqd-{os.geteuid() if hasattr(os, 'geteuid') else 'cache'}"
        path.mkdir(mode=0o700, exist_ok=True)
        trusted = sys.platform == "win32" or (_only_ours(path.lstat()) and _keeps_ours(parent.stat()))
    except OSError:
        return None
    return path if trusted and can_write(path) else None


def _temporary_folder() -> str:
    folder = tempfile.gettempdir()
    known = {os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP")} | {"/tmp", "/var/tmp", "/usr/tmp"}
    if folder == os.getcwd() and folder not in known:  # the last that Python tries, and no place for this
        raise FileNotFoundError("there is no temporary folder")
    return folder


def _only_ours(found: os.stat_result) -> bool:
    """Whether it is a folder, no link to one, of this user, that others can neither read nor write."""
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o077


def _keeps_ours(parent: os.stat_result) -> bool:
    """Whether others cannot put something else in the place of a folder of ours."""
    return bool(parent.st_mode & stat.S_ISVTX) or not parent.st_mode & 0o022


def can_write(folder: Path) -> bool:
    """Whether there is or can be such a folder, and files in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()  # modes do not say everything
    except OSError:
        return False
    return True


@cache
def home_is_known() -> bool:
    """Whether this user has a home: one that a container was given by its number has none, and `~` would be a folder here."""
    return bool(os.environ.get("XDG_CACHE_HOME")) or os.path.isabs(os.path.expanduser("~"))


@cache
def say_where_kernels_are() -> None:
    """Warn, once, that kernels are not where they are kept elsewhere. Workers leave it to who started them."""
    if multiprocessing.parent_process() is not None:
        return
    folder = private_folder()
    where = "are compiled anew each time, some 10 s" if folder is None else f"are kept in {folder}"
    warnings.warn(
        f"Neither the folder of auroraqd nor your cache folder can be written: compiled kernels {where}. NUMBA_CACHE_DIR names "
        "another folder",
        stacklevel=2,
    )


def place_for_matplotlib() -> None:
    """Give Matplotlib, which is about to be imported, a folder where its own cannot be written.

    It would make a new one each time, look at all fonts again, and complain about it.
    """
    if "MPLCONFIGDIR" in os.environ or not sys.platform.startswith(("linux", "freebsd")):
        return
    own = [_own_folder(kind, "matplotlib") for kind in (platformdirs.user_config_dir, platformdirs.user_cache_dir)]
    if not all(folder and can_write(folder) for folder in own) and (place := private_folder()):
        os.environ["MPLCONFIGDIR"] = str(place / "matplotlib")
