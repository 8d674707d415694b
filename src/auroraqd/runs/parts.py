"""The parts of a run, strategies, emitters and archives, as JSON values, and back.

A part of auroraqd's own is known by the name of its class; one of yours by its full name, "mymodule.MyArchive", and made again
only if that is trusted: to name a class in a file must not be enough to have its module run. It is made with the arguments that
it was made with, as far as the object has them: a dataclass has, and so has what keeps them in attributes of their names.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import numpy as np

from auroraqd._checks import shown
from auroraqd.archives import cvt, dominated, grid, unstructured
from auroraqd.archives.base import Archive
from auroraqd.control import resolution, schedule
from auroraqd.emitters import genetic, goals, population, ribs, selection, variation

_HOMES = {
    "selection": [selection],
    "variation": [variation],
    "resolution": [resolution],
    "schedule": [schedule],
    "emitter": [genetic, goals, population, ribs],
    "archive": [unstructured, grid, cvt, dominated],
}
_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
_LONGEST = 200  # letters of the name of a class
_LOST = "lost"  # in the place of "type", where what is there says no more than what it is called


def as_json(part: Any) -> Any:
    """A part as its type and the arguments it is made with, parts among these likewise; or, where it does not say what these
    are, or they are no JSON values, what it is called.
    """
    if part is None:
        return None
    arguments = {} if isinstance(part, type) else _arguments(part)
    if arguments is None or (not arguments and hasattr(part, "__qualname__")):
        return getattr(part, "__qualname__", _called(type(part)))
    values = {"type": _called(type(part)), **{name: _argument(value) for name, value in arguments.items()}}
    try:
        json.dumps(values)
    except (TypeError, ValueError):
        return _called(type(part))
    return values


def _arguments(part: Any) -> dict[str, Any] | None:
    """What an object is made with: the fields of a dataclass; of others, the parameters of the constructor, if there are
    attributes of these names, as estimators of scikit-learn have them. None: nobody can say.
    """
    if is_dataclass(part):
        names = [f.name for f in fields(part) if f.init]
    else:
        try:
            parameters = inspect.signature(type(part)).parameters
        except (TypeError, ValueError):
            return None
        if any(parameter.kind not in _NAMED for parameter in parameters.values()):
            return None
        names = list(parameters)
    return {name: getattr(part, name) for name in names} if all(hasattr(part, name) for name in names) else None


def _argument(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str | list | tuple | Mapping):
        return value
    found = as_json(value)
    return found if isinstance(found, Mapping) else {_LOST: found}


def archive_as_json(archive: Archive) -> dict[str, Any]:
    """The type and the settings of an archive."""
    return {"type": _called(type(archive)), **archive.settings}


def made(name: str, value: Any, trusted: Sequence[str]) -> Any:
    """A part from what `as_json` made of it.

    Args:
        name: "selection", "variation", "resolution", "schedule" or "emitter".
        value: JSON.
        trusted: full names of the classes, beyond auroraqd's, that may be made.

    Raises:
        ValueError: it is of a class that is neither auroraqd's nor trusted, or cannot be made.
    """
    if value is None and name == "resolution":
        return None
    options = dict(value) if isinstance(value, Mapping) else {"type": value}
    kind = _kind(name, options.pop("type", None), trusted)
    if not isinstance(value, Mapping) or not isinstance(kind, type):
        called = value.get("type") if isinstance(value, Mapping) else None
        trust = f", or trust it, trusted=[{called!r}]" if isinstance(called, str) and len(called) < _LONGEST else ""
        raise ValueError(f"{name} was {shown(value)}, which is not of auroraqd: give it again, resume(..., {name}=...){trust}")
    for part, given in options.items():
        if isinstance(given, Mapping) and _LOST in given:
            raise ValueError(
                f"{name} was {shown(value)}, with {given[_LOST]} as {part}, which is not of auroraqd: give it again, "
                f"resume(..., {name}=...)"
            )
        if part in _HOMES:
            options[part] = made(part, given, trusted)
        elif isinstance(given, Mapping) and "type" in given:  # one of several alike
            options[part] = made(name, given, trusted)
    try:
        return kind(**options)  # pyright: ignore[reportCallIssue] - a type
    except TypeError as error:
        raise ValueError(f"{name} was {shown(value)}: {error}; give it again, resume(..., {name}=...)") from None


def archive_made(value: Mapping[str, Any], constants: Mapping[str, np.ndarray], given: Any, trusted: Sequence[str]) -> Archive:
    """An empty archive from its type, settings and constants, or the one given if it is of the same type.

    Raises:
        ValueError: it is of a class that is neither auroraqd's nor trusted, or another is given.
    """
    settings = dict(value)
    named = settings.pop("type")
    if given is not None:
        if named not in (_called(type(given)), type(given).__name__) or len(given):
            raise ValueError(f"archive must be an empty {named}, as before, got {shown(given)}")
        return given
    kind = _kind("archive", named, trusted)
    if not (isinstance(kind, type) and issubclass(kind, Archive)):
        named = named if isinstance(named, str) and len(named) < _LONGEST else shown(named)
        raise ValueError(
            f"archive was of the type {named}, which is not of auroraqd: give an empty one, resume(..., archive=...), or trust "
            f"it, trusted=[{named!r}]"
        )
    return kind.made(settings, constants)


def _called(kind: type) -> str:
    own = kind.__module__.partition(".")[0] == __name__.partition(".")[0]
    return kind.__name__ if own else f"{kind.__module__}.{kind.__qualname__}"


def _kind(name: str, called: Any, trusted: Sequence[str]) -> Any:
    """The class of this name; None where there is none that may be made."""
    text = str(called)
    for home in _HOMES[name]:
        found = getattr(home, text, None)
        if isinstance(found, type) and found.__module__ == home.__name__:
            return found
    if text not in trusted:
        return None
    module, _, kind = text.rpartition(".")
    try:
        return getattr(import_module(module), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"{name} was of the type {text}, which cannot be imported here: {error}") from None
