"""`auroraqd new-task`: a task of one's own to begin with.

The folder `skeleton` is one that works, called `my_task`: it is copied, and that name replaced.
"""

import ast
import builtins
import importlib.util
import keyword
import re
import shlex
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated

import typer

from auroraqd.cli._names import NAMES
from auroraqd.cli._shared import UserError, console

_PLACEHOLDER = "my_task"
_OF_TOOLS = {"setup", "conftest"}  # modules that setuptools and pytest take for theirs


def new_task(
    name: Annotated[str, typer.Argument(help="Of its module: lower-case letters, digits and underscores.")],
    out: Annotated[Path | None, typer.Option(help="Folder to create. [default: NAME]")] = None,
) -> None:
    """Write a task of your own to begin with: a module that works, its tests, the options of a run, a README.

    Example: auroraqd new-task my_robot
    """
    _check_name(name)
    folder = out or Path(name)
    if folder.exists() or folder.is_symlink():
        raise UserError(f"{folder} exists: choose another folder with --out")
    _check_free(name)
    for path in _written(name, folder):
        console.print(str(path), highlight=False, soft_wrap=True)
    there = shlex.quote(str(folder))
    console.print(f"Next: cd {there} && auroraqd run --config run.toml", highlight=False, soft_wrap=True)


def _templates() -> list[Traversable]:
    folder = resources.files("auroraqd.cli").joinpath("skeleton")
    return sorted((file for file in folder.iterdir() if file.is_file()), key=lambda file: file.name)


def _written(name: str, folder: Path) -> list[Path]:
    """The files, as they are written."""
    from auroraqd._files import folder_at, replacing

    folder_at(folder)
    paths = []
    for template in _templates():
        paths.append(folder / template.name.replace(_PLACEHOLDER, name))
        with replacing(paths[-1]) as file:
            file.write(template.read_bytes().replace(_PLACEHOLDER.encode(), name.encode()))
    return paths


def _words() -> set[str]:
    """What things are called in the modules that are written."""
    found: set[str] = set()
    for template in _templates():
        if template.name.endswith(".py"):
            for node in ast.walk(ast.parse(template.read_bytes())):
                found |= {str(getattr(node, kind, "")) for kind in ("id", "arg", "name", "asname")}
    return found - {_PLACEHOLDER}


def _check_name(name: str) -> None:
    if not re.fullmatch(r"[a-z]([a-z0-9_]*[a-z0-9])?", name) or keyword.iskeyword(name):
        raise UserError(
            f"name must be one for a module, of lower-case letters, digits and underscores like my_robot, got {name!r}"
        )


def _check_free(name: str) -> None:
    """Whoever imports the module must not get another."""
    if name in NAMES["task"]:
        raise UserError(f"name {name} is that of a task of auroraqd: choose another")
    found = importlib.util.find_spec(name)
    if name in _OF_TOOLS or (found is not None and found.origin is not None):
        raise UserError(f"name {name} is that of another module, which would be in the way: choose another")
    if name in _words() or hasattr(builtins, name) or name.startswith("test"):
        raise UserError(f"name {name} would stand for something else in the module or its tests: choose another")
