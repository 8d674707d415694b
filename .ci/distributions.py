"""Check what was built: `git ls-files | python .ci/distributions.py FOLDER`, of a wheel built from the sdist beside it.

The wheel holds every file of the package that git tracks, and nothing else; the sdist all that the project consists of; and
what is installed for this Python is what is in the wheel, to the last byte.
"""

import csv
import io
import sys
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path

NOT_IN_SDIST = (".ci/", ".pre-commit-config.yaml")
OF_INSTALLERS = {"INSTALLER", "REQUESTED", "direct_url.json", "RECORD", "uv_cache.json"}


def check_wheel(names: set[str], tracked: set[str]) -> None:
    """The package as git has it, and what says what it is."""
    package = {name.removeprefix("src/") for name in tracked if name.startswith("src/")}
    about = {name for name in names if name.partition("/")[0].endswith(".dist-info")}
    _same("the wheel", names - about, package)
    wanted = ("METADATA", "RECORD", "WHEEL", "entry_points.txt", "licenses/LICENSE")
    _same("dist-info", {name.partition("/")[2] for name in about}, set(wanted))
    for ending in ("py.typed", ".pyi", "page.js", "page.css", "page.html", "skeleton/my_task.py", "skeleton/run.toml"):
        assert any(name.endswith(ending) for name in names), f"there is no {ending} in the wheel"


def check_sdist(names: set[str], tracked: set[str]) -> None:
    """All that is tracked, but for what is about this repository."""
    inside = {name.partition("/")[2] for name in names}
    wanted = {name for name in tracked if not name.startswith(NOT_IN_SDIST)}
    _same("the sdist", inside, wanted | {"PKG-INFO"})


def check_installed(recorded: dict[str, str]) -> None:
    """The same files, with the same hashes."""
    distribution = metadata.distribution("auroraqd")
    text = distribution.read_text("RECORD") or ""
    there = {name: digest for name, digest, _ in csv.reader(io.StringIO(text)) if digest}
    added = [name for name in there if name.startswith("..") or name.endswith(".pyc") or Path(name).name in OF_INSTALLERS]
    there = {name: digest for name, digest in there.items() if name not in added}
    _same("what is installed", set(there), set(recorded))
    differ = [name for name in recorded if recorded[name] != there[name]]
    assert not differ, f"other bytes are installed than are in the wheel: {', '.join(differ)}"


def _same(what: str, found: set[str], wanted: set[str]) -> None:
    assert found == wanted, f"{what} lacks {sorted(wanted - found)} and has {sorted(found - wanted)} too"


def main(folder: Path, tracked: set[str]) -> None:
    """Check the one wheel and the one sdist there."""
    [wheel], [sdist] = folder.glob("*.whl"), folder.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
        [record] = (name for name in names if name.endswith(".dist-info/RECORD"))
        rows = csv.reader(io.StringIO(file.read(record).decode()))
        recorded = {name: digest for name, digest, _ in rows if digest}
    check_wheel(names, tracked)
    with tarfile.open(sdist) as file:
        check_sdist({member.name for member in file.getmembers() if member.isfile()}, tracked)
    check_installed(recorded)
    print(f"{wheel.name}: {len(names)} files, as git has them and as installed; {sdist.name} builds it")


if __name__ == "__main__":
    main(Path(sys.argv[1]), set(sys.stdin.read().splitlines()))
