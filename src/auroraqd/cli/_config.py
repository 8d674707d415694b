"""Options of a command in a TOML file, by their names: `--config` reads them, `--save-config` writes them.

A command's own parameters say what options there are, and its signature of which type they are.
"""

import difflib
import tomllib
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import typer

from auroraqd import __version__
from auroraqd.cli._shared import UserError

_OF_FILES = {"config", "save_config"}
_OF_PLACES = {"out", "overwrite"}  # where a run goes is not what it is
_WANTED = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text in quotes",
    Path: "a path in quotes",
    list: "a list of texts in quotes",
}


def _read(context: typer.Context, path: Path | None) -> Path | None:
    """Make what a file says the defaults of a command: what is said at the command line wins."""
    if path is not None and not context.resilient_parsing:
        context.default_map = {**(context.default_map or {}), **_checked(path, _table(path), context)}
    return path


ConfigOption = Annotated[
    Path | None,
    typer.Option(
        callback=_read, is_eager=True, help="TOML file with options by their names, as generations = 500; those given here win."
    ),
]
SaveConfigOption = Annotated[Path | None, typer.Option(help="TOML file to write the options to, for --config.")]


def _table(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise UserError(f"there is no file {path}")
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is no TOML: {error}") from None


def _checked(path: Path, table: dict[str, Any], context: typer.Context) -> dict[str, Any]:
    """Values by the names of parameters."""
    kinds = _kinds(context)
    for key, value in table.items():
        if key not in kinds:
            near = difflib.get_close_matches(key, kinds, 1)
            hint = f"did you mean {near[0]}?" if near else f"they are those of `{context.command_path} --help`"
            raise UserError(f"{path}: there is no option {key!r}; {hint}")
        if not _fits(kinds[key], value):
            from auroraqd._checks import shown

            raise UserError(f"{path}: {key} must be {_WANTED[kinds[key]]}, got {shown(value)}")
    return {key.replace("-", "_"): value for key, value in table.items()}


def _kinds(context: typer.Context) -> dict[str, type]:
    """The options and arguments that a file may have, and their types."""
    hints = get_type_hints(context.command.callback)
    names = [parameter.name for parameter in context.command.params if parameter.name in hints.keys() - _OF_FILES]
    return {name.replace("_", "-"): _kind(hints[name]) for name in names}


def _kind(hint: Any) -> type:
    """That of a value which is given: `int` of `int | None`, `list` of `list[str]`."""
    choices = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    [kind] = [choice for choice in choices if choice is not NoneType]
    return get_origin(kind) or kind


def _fits(kind: type, value: Any) -> bool:
    if kind is list:
        return isinstance(value, list) and all(isinstance(entry, str) for entry in value)
    taken = {float: (int, float), Path: str}.get(kind, kind)
    return isinstance(value, taken) and (kind is bool or not isinstance(value, bool))


def write_config(context: typer.Context, path: Path | None) -> None:
    """Write the options of a command, those left to their defaults too, but for where it puts its results.

    Raises:
        UserError: there is a file, which holds something else.
        OSError: it cannot be written.
    """
    if path is None:
        return
    import tomli_w

    from auroraqd._files import replacing

    given = {key: context.params.get(key.replace("-", "_")) for key in _kinds(context).keys() - _OF_PLACES}
    options = {key: _plain(given[key]) for key in _kinds(context) if given.get(key) not in (None, [], ())}
    text = f"# Options of `{context.command_path}`, auroraqd {__version__}\n{tomli_w.dumps(options)}".encode()
    if path.is_file() and path.read_bytes() == text:
        return
    if path.exists():
        raise UserError(f"{path} exists: choose another file with --save-config, or remove it first")
    with replacing(path) as file:
        file.write(text)


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [str(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
