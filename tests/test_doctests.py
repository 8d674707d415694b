"""Public objects have examples in their docstrings, and the examples are true; the API reference lists all of them."""

import doctest
import importlib
import re
from pathlib import Path

import pytest

import auroraqd

API = Path(__file__).parent.parent / "docs" / "reference" / "api"
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


WITHOUT = {  # results, protocols, errors; what needs a service, a cluster or a library to draw with; what a tutorial shows
    *("DescriptorError", "TaskError", "Evaluation", "archives.CellArchive", "archives.Info", "archives.Placement"),
    *("archives.Tessellation", "callbacks.Callbacks", "callbacks.Logger", "callbacks.MLflow", "callbacks.Score"),
    *(
        "callbacks.TensorBoard",
        "callbacks.WeightsAndBiases",
        "emitters.Emitter",
        "emitters.EmitterError",
        "evaluate.Spread",
        "evaluate.dask",
    ),
    *("descriptors.networks.Convolutional", "descriptors.networks.Network", "descriptors.networks.chosen"),
    *(
        "descriptors.networks.is_image",
        "descriptors.networks.is_large_image",
        "metrics.grid_of",
        "report.explore",
        "report.film",
        "report.history_figure",
        "report.repertoire_figure",
    ),
    *(
        "report.write_figures",
        "report.write_paper",
        "report.write_report",
        "tasks.ClosedLoop",
        "tasks.Episode",
        "tasks.OpenLoop",
    ),
}
UNLISTED = {*(f"descriptors.networks.{name}" for name in ("chosen", "is_image", "is_large_image")), "metrics.grid_of"}


def short(name):
    return name.removeprefix("auroraqd.")


def test_all_others_have_examples():
    assert {short(name) for name in documented()} - {short(name) for name in EXAMPLES} <= WITHOUT


def test_the_reference_lists_all():
    listed = set(
        re.findall(r"^\.\. auto(?:class|function|exception):: (\w+)", "".join(p.read_text() for p in API.glob("*.rst")), re.M)
    )
    assert {name.rpartition(".")[2] for name in documented() if short(name) not in UNLISTED} <= listed


@pytest.mark.parametrize("name", EXAMPLES)
def test_example(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    failed, tried = doctest.DocTestRunner(verbose=False).run(EXAMPLES[name], out=said.append)
    assert tried > 0
    assert not failed, "".join(said)
