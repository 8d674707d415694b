"""Python, started as a command, without the seconds that its imports take: forked from a process that has done them.

Each process of pytest has one such server, `python commands.py`, which imports what nearly all commands need, and then does
nothing but fork: each command is a process of its own, with its own arguments, folder, environment and end. What is about the
start itself, or is to get signals, is started by `subprocess`; so is everything where processes cannot be forked safely.
"""

import atexit
import gc
import json
import multiprocessing.process
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import warnings
from functools import cache
from importlib import import_module
from pathlib import Path

_WARNINGS = os.environ.get("AURORAQD_TESTS_WARNINGS", "error")  # "ignore": what old versions of dependencies warn of
CLI = [sys.executable, "-W", _WARNINGS, "-m", "auroraqd"]  # for `subprocess`
_SECONDS = 300  # that a command may take
_FORKS = sys.platform == "linux"


def python(*line: object, cwd: object = None, warned: bool = False) -> subprocess.CompletedProcess:
    """Run `python -W error *line`, a file or `-m` and a module with its arguments; what it prints, and how it ends.

    With `warned`, warnings are no errors.
    """
    words, folder = list(map(str, line)), os.fspath(cwd or Path.cwd())  # pyright: ignore[reportArgumentType, reportCallIssue]
    if not _FORKS:
        full = [sys.executable, *([] if warned else ["-W", _WARNINGS]), *words]
        return subprocess.run(full, capture_output=True, text=True, cwd=folder, timeout=_SECONDS, check=False)
    with tempfile.TemporaryDirectory() as place:
        files = [f"{place}/out", f"{place}/err"]
        asked = {"line": words, "folder": folder, "environment": dict(os.environ), "files": files, "warned": warned}
        server = _server()
        assert server.stdin is not None
        assert server.stdout is not None
        print(json.dumps(asked), file=server.stdin, flush=True)
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess(words, code, *(Path(file).read_text() for file in files))


def cli(*arguments: object, cwd: object = None, warned: bool = False) -> subprocess.CompletedProcess:
    """Run `auroraqd *arguments`, where warnings are errors."""
    return python("-m", "auroraqd", *arguments, cwd=cwd, warned=warned)


@cache
def _server() -> subprocess.Popen:
    """That of this process; it ends when nobody can ask it any more."""
    line = [sys.executable, "-W", _WARNINGS, __file__]
    server = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(server.communicate)
    return server


def _serve() -> None:
    for asked in sys.stdin:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the threads of a BLAS, which knows of forks
            child = os.fork()
        if not child:
            _become(**json.loads(asked))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _become(line: list[str], folder: str, environment: dict[str, str], files: list[str], warned: bool) -> None:
    """In a new process: be `python *line`, to the end."""
    signal.alarm(_SECONDS)
    for number, file in enumerate((os.devnull, *files)):
        os.dup2(os.open(file, os.O_RDWR | os.O_CREAT), number)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    multiprocessing.process.ORIGINAL_DIR = folder  # from which processes that it starts find its file
    if warned:
        warnings.resetwarnings()
    if line[0] == "-m":
        sys.path[0], sys.argv = folder, line[1:]
        runpy.run_module(line[1], run_name="__main__", alter_sys=True)
    else:
        sys.path[0], sys.argv = str(Path(line[0]).absolute().parent), line
        runpy.run_path(line[0], run_name="__main__")
    sys.exit()


def _warm() -> None:
    """Import, and load the kernels of, what nearly all commands need."""
    for name in ("cli", "descriptors.training", "evaluate", "experiments", "report"):
        import_module(f"auroraqd.{name}")
    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=0, batch_size=20).run(auroraqd.tasks.Ballistic(), generations=2)
    with tempfile.TemporaryDirectory() as folder:
        auroraqd.load(auroraqd.save(aurora, folder))
    gc.collect()
    gc.freeze()  # or each command, when it ends, looks at all that was imported, and copies it: a second


if __name__ == "__main__":
    from sklearn.decomposition import PCA

    import auroraqd

    _warm()
    _serve()
