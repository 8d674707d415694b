"""Every public object has an example in its docstring, and the examples are true."""

import doctest
import importlib

import pytest

import auroraqd

MODULES = ("archives", "callbacks", "descriptors.networks", "emitters", "evaluate", "metrics", "report", "tasks", "testing")


def documented():
    """Public classes and functions, by the names that users write."""
    found = {f"auroraqd.{name}": getattr(auroraqd, name) for name in auroraqd.__all__}
    for module in MODULES:
        public = importlib.import_module(f"auroraqd.{module}")
        own = [name for name, thing in vars(public).items() if getattr(thing, "__module__", "") == public.__name__]
        for name in getattr(public, "__all__", [name for name in own if not name.startswith("_")]):
            found.setdefault(f"auroraqd.{module}.{name}", getattr(public, name))
    distinct = {id(thing): name for name, thing in reversed(found.items()) if callable(thing)}
    return {name: found[name] for name in sorted(distinct.values())}


EXAMPLES = {
    name: example
    for name, thing in documented().items()
    for example in doctest.DocTestFinder(recurse=False).find(thing, name, globs={})
    if example.examples
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_example(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    failed, tried = doctest.DocTestRunner(verbose=False).run(EXAMPLES[name], out=said.append)
    assert tried > 0
    assert not failed, "".join(said)
