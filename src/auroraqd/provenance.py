"""Where a run comes from: its task with the code it has, the command that made it, and when.

The code of a task is what its functions compile to, with those of its own module that they call and the constants they read;
comments and docstrings do not count. What a task reads elsewhere, files for instance, is not seen.
"""

from __future__ import annotations

import dis
import functools
import hashlib
import operator
import shlex
import sys
import weakref
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

from auroraqd.tasks import Genes

_OWN = "auroraqd."
_SCRIPT = "__main__"
_last: tuple[weakref.ref, dict[str, Any]] | None = None  # loops may call `run` for each generation


def made_by() -> dict[str, Any]:
    """The command of this process, and the time in UTC, as JSON values."""
    return {"command": shlex.join(sys.argv), "date": datetime.now(UTC).isoformat(timespec="seconds")}


def made_again(config: Mapping[str, Any]) -> dict[str, Any]:
    """The command and the time that a run folder names, which stay, and with which it goes on, the last of `resumed`."""
    before, now = config.get("provenance"), made_by()
    if not isinstance(before, Mapping) or not before.keys() >= now.keys():
        return now
    resumed = before.get("resumed")
    return {**{name: before[name] for name in now}, "resumed": [*(resumed if isinstance(resumed, list) else []), now]}


def described(task: Callable) -> dict[str, Any]:
    """A task as JSON values.

    Returns:
        `module` and `name`, by which it can be imported, unless the module is "__main__"; `repr`, if it says more than that;
        `code`, a hash; `versions` of the packages that its module uses; `genes`, name to (low, high, unit), if it has any;
        `layers`, run folders whose skills it executes, if it does.
    """
    global _last
    if _last is not None and _last[0]() is task:
        return _last[1]
    try:
        found = _described(task)
    except Exception:  # objects of others may do anything when they are looked at, and no run must end for that
        found = {"module": None, "name": type(task).__name__, "repr": None, "code": None, "versions": {}, "genes": None}
    try:
        _last = weakref.ref(task), found
    except TypeError:  # an object without room for it
        _last = None
    return found


def changed(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """How a task differs from the one before, in words; None if it does not, or if nobody can say."""
    scripts = _SCRIPT in (before.get("module"), now["module"])  # the same file may be imported the next time
    if before.get("name") != now["name"] or (before.get("module") != now["module"] and not scripts):
        return f"the task was {called(before)} and is {called(now)}"
    if before.get("repr") != now["repr"]:
        return f"the task was {before.get('repr')} and is {now['repr']}"
    if None not in (before.get("code"), now["code"]) and before.get("code") != now["code"]:
        return f"the code of task {called(now)} has changed"
    return None


def called(task: Mapping[str, Any]) -> str:
    """A described task in a word: "mymodule:my_task"."""
    return f"{task.get('module')}:{task.get('name')}"


def task_in(config: Mapping[str, Any]) -> dict[str, Any] | None:
    """The described task of a run folder, or None."""
    provenance = config.get("provenance")
    task = provenance.get("task") if isinstance(provenance, Mapping) else None
    return task if isinstance(task, dict) else None


def task_named(config: Mapping[str, Any]) -> str | None:
    """What the task of a run folder is called, or None."""
    found = task_in(config)
    return config.get("task") or (None if found is None else called(found))


def importable(config: Mapping[str, Any]) -> str | None:
    """The task of a run folder as "mymodule:my_task"; None where none is known, or it was defined in a script."""
    task = task_in(config) or {}
    unnamed = task.get("module") in (None, _SCRIPT) or not task.get("name") or "<" in str(task.get("name"))  # of a function
    return None if unnamed else called(task)


def layers_in(task: Mapping[str, Any] | None) -> list[str]:
    """Run folders whose skills a described task executes, the nearest layer first."""
    layers = (task or {}).get("layers")
    return list(map(str, layers)) if isinstance(layers, list) else []


def genes_in(config: Mapping[str, Any]) -> Genes | None:
    """The genes of the task of a run folder, if they are known."""
    genes = (task_in(config) or {}).get("genes")
    return Genes(**{name: tuple(gene) for name, gene in genes.items()}) if isinstance(genes, Mapping) and genes else None


def _described(task: Any) -> dict[str, Any]:
    while type(task).__module__ == "auroraqd.evaluate.spread":  # it is spread over workers
        task = task.task
    genes, inner = getattr(task, "genes", None), _innermost(task)
    layers = getattr(task, "layers", None) if type(task).__module__.startswith(_OWN) else None  # others call networks' so
    module, name = _home(task, inner)
    text = "" if isinstance(task, FunctionType | MethodType) else repr(task)
    return {
        "module": module,
        "name": name,
        "repr": None if not text or " at 0x" in text else text,
        "code": _digest(task, inner),
        "versions": _versions(sys.modules.get(module)),
        "genes": {n: [*b, u] for n, b, u in zip(genes.names, genes.bounds.tolist(), genes.units, strict=True)}
        if isinstance(genes, Genes)
        else None,
        **({} if layers is None else {"layers": layers}),
    }


def _innermost(task: Any) -> Any:
    """What is within `repeated`, `each`, `from_jax`, partial functions and decorators."""
    while True:
        names = ["__wrapped__", "py_func"]
        names += ["task", "function"] if type(task).__module__.startswith(_OWN) else []
        names += ["func"] if isinstance(task, functools.partial) else []
        within = next((vars(task)[name] for name in names if name in getattr(task, "__dict__", {})), None)
        within = task.func if isinstance(task, functools.partial) else within
        if not callable(within):
            return task
        task = within


def _home(task: Any, inner: Any) -> tuple[str, str]:
    """Module and name: of a global variable that is the task, or else of its function or class."""
    kind = inner if hasattr(inner, "__qualname__") else type(inner)
    if inner is task and isinstance(task, FunctionType | MethodType):
        return kind.__module__, kind.__qualname__
    for module in [sys.modules.get(kind.__module__), sys.modules.get(_SCRIPT), *sys.modules.values()]:
        for name, value in list(getattr(module, "__dict__", {}).items()):
            if value is task and not name.startswith("_"):
                home = getattr(module, "__name__", _SCRIPT)
                if home == _SCRIPT and kind.__module__.startswith(_OWN):
                    break  # a variable of a script says less than a class that can be imported
                return home, name
    return kind.__module__, kind.__qualname__


def _digest(task: Any, inner: Any) -> str | None:
    """A hash of the code of a task; None where there is none that can be seen, or it is auroraqd's, which has a version."""
    content, seen = hashlib.blake2b(digest_size=16), set[int]()
    for function in _functions(task, inner):
        _take(function, content, seen)
    return content.hexdigest() if seen else None


def _functions(task: Any, inner: Any) -> Iterator[FunctionType]:
    """Those that a task consists of."""
    for part in (inner, *getattr(task, "__dict__", {}).values()):
        if isinstance(part, MethodType):
            part = part.__func__
        if isinstance(part, FunctionType):
            yield part
    for kind in type(inner).__mro__:
        if kind.__module__ not in ("builtins", "functools", "typing") and not kind.__module__.startswith(_OWN):
            for part in vars(kind).values():
                function = getattr(part, "__func__", getattr(part, "fget", part))
                if isinstance(function, FunctionType):
                    yield function


def _take(function: FunctionType, content: Any, seen: set[int]) -> None:
    if id(function) in seen:
        return
    seen.add(id(function))
    used = _take_code(function.__code__, function.__doc__, content)
    content.update(repr((function.__defaults__, function.__kwdefaults__) if _plain(function.__defaults__) else ()).encode())
    for name in sorted(used):
        value = function.__globals__.get(name)
        value = getattr(value, "__wrapped__", getattr(value, "py_func", value))
        if isinstance(value, FunctionType) and value.__module__ == function.__module__:
            _take(value, content, seen)
        elif _plain(value):
            content.update(f"{name}={value!r}".encode())


def _take_code(code: CodeType, doc: str | None, content: Any) -> set[str]:
    """Hash what a function compiles to; returns the globals that it reads and never writes."""
    content.update(code.co_code)
    content.update(repr((code.co_names, code.co_varnames, code.co_freevars)).encode())
    instructions = list(dis.get_instructions(code))
    used = {i.argval for i in instructions if i.opname == "LOAD_GLOBAL"}
    used -= {i.argval for i in instructions if i.opname == "STORE_GLOBAL"}
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            used |= _take_code(constant, None, content)
        elif constant != doc or doc is None:
            content.update((repr(sorted(map(repr, constant))) if isinstance(constant, frozenset) else repr(constant)).encode())
    return used


def _plain(value: Any) -> bool:
    """Whether it is a constant that is the same in every process."""
    if isinstance(value, tuple):
        return all(map(_plain, value))
    return isinstance(value, bool | int | float | complex | str | bytes)


def _versions(module: ModuleType | None) -> dict[str, str]:
    """Of the packages that the globals of a module come from."""
    versions = {}
    for value in list(vars(module).values()) if module is not None else []:
        name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        package = name.partition(".")[0] if isinstance(name, str) else ""
        version = getattr(sys.modules.get(package), "__version__", None)
        if isinstance(version, str):
            versions[package] = version
    return dict(sorted(versions.items(), key=operator.itemgetter(0)))
