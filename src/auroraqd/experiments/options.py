"""What a user wrote on the command line, as objects: a task of their own, things with options like `gaussian:sigma=0.02`."""

import importlib
import inspect
import operator
import os
import sys
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, get_args

from auroraqd._checks import whole


def imported(module: str, name: str, n_genes: int | None = None) -> Any:
    """A task of the user's own, from a module that is installed or in the current folder.

    With `n_genes` known, it need not say how many there are.

    Raises:
        ValueError: it cannot be imported, is no task, or does not say how many genes it has.
    """
    text = f"{module}:{name}"
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        task = operator.attrgetter(name)(importlib.import_module(module))
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise ValueError(f"task {text} cannot be imported: {error}") from None
        raise ValueError(f"task {text}: there is no module {module}, neither installed nor in this folder") from None
    except AttributeError:
        if getattr(sys.modules.get(module), "__file__", None) is None and os.path.isdir(module):  # a folder that is no package
            raise ValueError(f"task {text}: {module} is a folder here, and no module: go there first, cd {module}") from None
        raise ValueError(f"task {text}: the module {module} has no {name}") from None
    except (Exception, SystemExit) as error:
        raise ValueError(f"task {text} cannot be imported: {type(error).__name__}: {error}") from None
    if isinstance(task, type):
        try:
            task = task()
        except (Exception, SystemExit) as error:
            raise ValueError(f"task {text} cannot be made without arguments: {type(error).__name__}: {error}") from None
    if not callable(task):
        raise ValueError(f"task {text} must be a function, or an object that can be called, got {task!r}")
    try:
        known = hasattr(task, "n_genes")
    except Exception as error:
        raise ValueError(f"n_genes of task {text} raised {type(error).__name__}: {error}") from None
    if known:
        whole(f"n_genes of task {text}", getattr(task, "n_genes"))  # noqa: B009 - a function may have it
    elif n_genes is None:
        raise ValueError(f"task {text} must say how many genes it has: write {name}.n_genes = 8 in {module}, for instance")
    return task


def built(name: str, kinds: Mapping[str, Any], text: str) -> Any:
    """A dataclass of several, by its name, which may have colons in it, and options.

    Raises:
        ValueError: no such name or option, or a value of another type.
    """
    kind = max((kind for kind in kinds if f"{text}:".startswith(f"{kind}:")), key=len, default=None)
    if kind is None:
        raise ValueError(f"{name} must be one of {', '.join(kinds)}, got {text!r}")
    options = text.removeprefix(kind).removeprefix(":")
    types = {f.name: _written(f.type) for f in fields(kinds[kind]) if _written(f.type)}
    given = {
        key: _value(f"{name} {kind!r}: {key}", types[key], value)
        for key, value in _options(f"{name} {kind!r}", types, options).items()
    }
    needed = [f.name for f in fields(kinds[kind]) if f.default is MISSING and f.default_factory is MISSING]
    missing = [name for name in needed if name not in given]
    if missing:
        raise ValueError(f"{name} {kind!r} needs {missing[0]}: write {kind}:{missing[0]}=VALUE")
    return kinds[kind](**given)


def _written(kind: Any) -> type | None:
    """The type of what is written of a parameter; None if it cannot be."""
    if isinstance(kind, type):
        return kind
    return str if str in get_args(kind) else None


def keyword_parameters(owner: str, kind: type, options: str) -> dict[str, Any]:
    """Keyword parameters of a class from their text, each of the type of its default; a number where that is None.

    Raises:
        ValueError: no such name or option, or a value of another type.
    """
    defaults = {
        name: parameter.default
        for name, parameter in inspect.signature(kind).parameters.items()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and name not in ("random_state", "verbose")
    }
    types = {name: float if default is None else type(default) for name, default in defaults.items()}
    return {key: _value(f"{owner}: {key}", types[key], value) for key, value in _options(owner, defaults, options).items()}


def _options(owner: str, known: Mapping[str, Any], text: str) -> dict[str, str]:
    """Keys and values of `key=value,key=value`."""
    pairs: dict[str, str] = {}
    for option in filter(None, text.split(",")):
        key, _, value = option.partition("=")
        if key not in known:
            hint = ", written like hidden=64x32" if isinstance(known.get("hidden"), tuple) else ""
            raise ValueError(f"{owner} has no option {key!r}; its options are: {', '.join(known) or 'none'}{hint}")
        if key in pairs:
            raise ValueError(f"{owner} must have each option once, got {key!r} twice")
        pairs[key] = value
    return pairs


def _value(name: str, kind: Any, text: str) -> Any:
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise ValueError(f"{name} must be true or false, got {text!r}")
        return text.lower() == "true"
    try:
        return tuple(int(part) for part in text.split("x")) if kind is tuple else kind(text)
    except ValueError:
        wanted = {int: "a whole number", tuple: "whole numbers like 64x32"}.get(kind, "a number")
        raise ValueError(f"{name} must be {wanted}, got {text!r}") from None
