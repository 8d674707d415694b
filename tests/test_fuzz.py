"""Whatever is given to a public call, or lies in a run folder: it works, or there is a sentence; no crash, no foreign error."""

import copy
import io
import json
import subprocess
import sys
import warnings
import zipfile
from datetime import datetime

import numpy as np
import pytest
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import metrics
from auroraqd.runs import _tensors, _transformers, folders

FORM, STATE = "auroraqd repertoire 2", "state.json"
OURS = (ValueError, TypeError, IndexError, RuntimeError, FileNotFoundError)
FOREIGN = ("Traceback", "ufunc", "broadcast", "setting an array", "cannot reshape", "index 0 is out", "could not convert")

NASTY = {
    "none": None,
    "word": "one",
    "digits": ["1", "2"],
    "complex": np.full((3, 2), 1 + 1j),
    "times": np.zeros((3, 2), "datetime64[s]"),
    "dates": [datetime(2020, 1, 1)] * 3,
    "nones": [[None, 1.0]] * 3,
    "objects": np.array([[object(), 1.0]] * 3),
    "masked": np.ma.array(np.zeros((3, 2)), mask=np.eye(3, 2)),
    "masked within": [np.ma.array([0.0, 1.0], mask=[True, False])] * 3,
    "huge": [[10**400, 1]] * 3,
    "very long": 10**5000,
    "large": 2**70,
    "ragged": [[1.0], [1.0, 2.0]],
    "nan": np.full((3, 2), np.nan),
    "infinite": np.full((3, 2), np.inf),
    "ends": np.full((3, 2), 1.7e308) * [[1, -1], [-1, 1], [1, 1]],
    "no columns": np.empty((3, 0)),
    "no rows": np.empty((0, 2)),
    "scalar": 3.0,
    "negative": -1,
    "true": True,
    "bools": np.ones((3, 2), bool),
    "deep": np.zeros((3, 2, 2, 2)),
    "dictionary": {},
    "wide floats": np.zeros((3, 2), np.longdouble),
}
NO_NUMBERS = ("digits", "complex", "times", "dates", "nones", "objects", "masked", "masked within", "huge", "ragged")
GOOD = np.array([[0.1, 0.2], [0.3, 0.9], [0.8, 0.4]])


def archives():
    cvt = auroraqd.CVTArchive(GOOD)
    return auroraqd.UnstructuredArchive(), auroraqd.GridArchive((3, 3)), cvt, auroraqd.DominatedArchive()


def filled(archive):
    archive.add(GOOD, GOOD[:, 0], GOOD, GOOD)
    return archive


def circle(genotypes):
    return np.stack([np.cos(6 * genotypes), np.sin(6 * genotypes)], axis=2)


def grown():
    return auroraqd.Aurora(2, PCA(n_components=2), seed=0, batch_size=20).run(circle, generations=2)


def said(call):
    """What the error of a call says; None: it works. Errors that are not ours come through."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=UserWarning)
            call()
    except OURS as error:
        return f"{error}"
    return None


def calls(bad):
    """A public call with a bad value for each of its arguments, by name."""
    columns = {"genotype": GOOD, "fitness": GOOD[:, 0], "observation": GOOD, "descriptor": GOOD}
    for archive in archives():
        for name in (*columns, "ground_truth", "reconstruction_error"):
            yield name, lambda a=archive, n=name: copy.deepcopy(a).add(**{**columns, n: bad})
        filled(archive)
        yield "descriptor", lambda a=archive: a.redescribe(bad)
        yield "reconstruction_error", lambda a=archive: a.redescribe(a.descriptor, reconstruction_error=bad)
        yield "parent_ids", lambda a=archive: a.credit(bad, [0, 1, 2])
        yield "status", lambda a=archive: a.credit([0, 1, 2], bad)
        yield "rows", lambda a=archive: a.credit([0, 1, 2], [0, 1, 2], rows=bad)
        yield "ids", lambda a=archive: a.rows_of(bad)
    for name in ("l", "k", "epsilon", "competition", "capacity"):
        yield name, lambda n=name: auroraqd.UnstructuredArchive(**{n: bad})
    yield "cells", lambda: auroraqd.GridArchive(bad)
    for name in ("low", "high"):
        yield name, lambda n=name: auroraqd.GridArchive((3, 3), **{n: bad})
    yield "centroids", lambda: auroraqd.CVTArchive(bad)
    yield "samples", lambda: auroraqd.tessellate(bad, 2, cache=False)
    for name in ("cells", "steps", "seed"):
        yield name, lambda n=name: auroraqd.tessellate(GOOD, **{"cells": 2, "cache": False, n: bad})
    for metric in (metrics.klc, metrics.outside, metrics.reconstruction_error):
        yield "", lambda m=metric: m(bad, GOOD)
        yield "", lambda m=metric: m(GOOD, bad)
    yield "bins", lambda: metrics.klc(GOOD, GOOD, bad, marginal=True)
    yield "trajectories", lambda: metrics.diversity(bad)
    for name in ("bins", "low", "high"):
        yield name, lambda n=name: metrics.diversity(GOOD[None], **{n: bad})
    for kind, name in (
        (auroraqd.VAT, "cells"),
        (auroraqd.Fixed, "l"),
        (auroraqd.CSC, "target"),
        (auroraqd.DominatedArchive, "capacity"),
        (auroraqd.DominatedArchive, "k"),
        (auroraqd.emitters.Goals, "random"),
        (auroraqd.emitters.Goals, "sigma"),
        (auroraqd.emitters.Goals, "first"),
        (auroraqd.emitters.NSLC, "population"),
        (auroraqd.emitters.TAXONS, "elite"),
        (auroraqd.Doubling, "first"),
        (auroraqd.Every, "generations"),
        (auroraqd.Polynomial, "rate"),
        (auroraqd.Polynomial, "eta"),
        (auroraqd.Gaussian, "sigma"),
        (auroraqd.IsoLine, "iso_sigma"),
    ):
        yield name, lambda k=kind, n=name: k(**{n: bad})
    for name in ("n_genes", "seed", "batch_size", "selection", "variation", "schedule", "prior", "descriptor"):
        options = {"n_genes": 2, "descriptor": PCA(n_components=2), name: bad}
        if not (name in ("seed", "prior") and bad is None):
            yield name, lambda o=options: auroraqd.Aurora(**o)
    aurora = grown()
    yield "genotypes", lambda: aurora.ask(bad)
    yield "observation", lambda: aurora.describe(bad)
    yield "descriptor", lambda: aurora.reconstruct(bad)
    yield "fitness", lambda: told(bad, GOOD[:, None])
    yield "observation", lambda: told(GOOD[:, 0], bad)
    yield "ground_truth", lambda: told(GOOD[:, 0], GOOD[:, None], bad)
    yield "x", lambda: auroraqd.AutoEncoder(1).fit(bad)


def told(*arguments):
    aurora = auroraqd.Aurora(2, "genotype", batch_size=3)
    aurora.ask()
    return aurora.tell(*arguments)


@pytest.mark.parametrize("kind", [kind for kind in NASTY if kind not in ("infinite", "bools", "deep", "no rows", "true")])
def test_public_calls_work_or_say_what_is_wrong(kind):
    bad = NASTY[kind]
    for name, call in calls(bad):
        text = said(call)
        assert text is None or (
            name.replace("_", " ") in text.replace("_", " ") and not any(word in text for word in FOREIGN)
        ), (name, text)


@pytest.mark.parametrize("kind", NO_NUMBERS)
def test_what_is_no_number_is_never_taken_for_one(kind):
    bad = NASTY[kind]
    for call in (
        lambda: auroraqd.UnstructuredArchive().add(GOOD, GOOD[:, 0], GOOD, bad),
        lambda: auroraqd.UnstructuredArchive().add(bad, GOOD[:, 0], GOOD, GOOD),
        lambda: auroraqd.UnstructuredArchive().add(GOOD, GOOD[:, 0], bad, GOOD),
        lambda: auroraqd.CVTArchive(bad),
        lambda: auroraqd.tessellate(bad, 1, cache=False),
        lambda: metrics.klc(bad, GOOD),
        lambda: auroraqd.Aurora(2, "genotype").ask(bad),
        lambda: told(GOOD[:, 0], bad),
        lambda: auroraqd.Aurora(2, PCA(n_components=1), prior=bad),
        lambda: auroraqd.AutoEncoder(1).fit(bad),
    ):
        with pytest.raises(ValueError, match="must be numbers"):
            call()


def test_descriptors_without_dimensions():
    archive = auroraqd.UnstructuredArchive()
    for _ in range(40):
        with pytest.raises(ValueError, match="descriptor must have a dimension at least"):
            archive.add(GOOD, GOOD[:, 0], GOOD, np.empty((3, 0)))
    assert len(archive) == 0


def test_metrics_of_the_largest_numbers():
    ends = np.array([[-1.7e308], [1.7e308], [0.0]])
    assert metrics.klc(ends, ends) == 0
    small = np.linspace(-1, 1, 30)[:, None] ** 3
    assert metrics.klc(small * 1.7e308, small[::-1] * 1.7e308) == metrics.klc(small, small[::-1])
    with pytest.raises(ValueError, match="bins must be a whole number"):
        metrics.klc(GOOD, GOOD, 2**70, marginal=True)


def test_a_resolution_is_not_dropped():
    for archive in archives()[1:]:
        with pytest.raises(ValueError, match=r"resolution is for an archive with a distance threshold l, and \w+ has none"):
            auroraqd.Aurora(2, "genotype", archive=archive, resolution=auroraqd.Fixed(0.1))
        assert auroraqd.Aurora(2, "genotype", archive=archive).resolution is None


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    aurora = grown()
    aurora.ask()
    return auroraqd.save(aurora, tmp_path_factory.mktemp("fuzz") / "run")


def parts_of(folder):
    arrays, kind = _tensors.read(folder / folders.REPERTOIRE, FORM)
    return arrays, kind, json.loads(arrays[STATE].tobytes())


def with_state(arrays, values):
    return {**arrays, STATE: np.frombuffer(json.dumps(values).encode(), np.uint8)}


def goes_on_or_says(folder, what):
    """Load and resume and run on: each works, or raises a sentence."""

    def every():
        repertoire = auroraqd.load(folder)
        repertoire.sample(3)
        if repertoire.observation.ndim > 1:
            repertoire.describe(repertoire.observation[:2])

    def on():
        auroraqd.resume(folder).run(circle, generations=1)

    for call in (every, on):
        assert said(call) != "", what


def spoiled(array):
    yield "missing", None
    yield "nan", np.full(array.shape, np.nan)
    yield "constant", np.zeros_like(array)
    yield "whole", np.zeros(array.shape, np.int32)
    yield "no columns", np.zeros((len(array), 0), array.dtype)
    yield "cut", array[: len(array) // 2]
    yield "empty", array[:0]
    yield "deep", array[..., None]
    yield "flat", array.ravel()
    yield "number", array.ravel()[0] if array.size else np.zeros(())
    yield "large", np.full(array.shape, 1.7e308)
    yield "true", np.ones(array.shape, bool)
    if array.dtype.kind == "f" and array.size:
        one = array.copy()
        one.flat[0] = np.nan
        yield "one nan", one


def test_every_array_of_a_checkpoint(folder):
    arrays, kind, _ = parts_of(folder)
    try:
        for name, array in arrays.items():
            for how, bad in spoiled(array):
                changed = {key: value for key, value in {**arrays, name: bad}.items() if value is not None}
                _tensors.write(folder / folders.REPERTOIRE, {key: np.asarray(v) for key, v in changed.items()}, FORM, kind)
                goes_on_or_says(folder, (name, how))
    finally:
        _tensors.write(folder / folders.REPERTOIRE, arrays, FORM, kind)


def leaves(values, path=()):
    yield path
    if isinstance(values, dict | list):
        for key in values if isinstance(values, dict) else range(len(values)):
            yield from leaves(values[key], (*path, key))


def replaced(values, path, bad):
    if not path:
        return bad
    changed = dict(values) if isinstance(values, dict) else list(values)
    changed[path[0]] = replaced(values[path[0]], path[1:], bad)
    return changed


def test_every_value_of_the_state(folder):
    arrays, kind, values = parts_of(folder)
    bads = (None, float("nan"), float("inf"), -1, 1.5, "x", True, [], {}, [10**9, 2], 10**30, [[1]])
    try:
        for path in leaves(values):
            for bad in bads:
                _tensors.write(folder / folders.REPERTOIRE, with_state(arrays, replaced(values, path, bad)), FORM, kind)
                goes_on_or_says(folder, (path, bad))
    finally:
        _tensors.write(folder / folders.REPERTOIRE, arrays, FORM, kind)


@pytest.mark.parametrize("kind", ["generation", "shape", "nested", "state", "descriptor", "header"])
def test_a_checkpoint_that_lies_gives_way_to_the_one_before(folder, tmp_path, kind):
    arrays, learned, values = parts_of(folder)
    for name in (folders.CONFIG, folders.HISTORY):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / folders.PREVIOUS).write_bytes((folder / folders.REPERTOIRE).read_bytes())
    lies = {
        "generation": with_state(arrays, {**values, "generation": float("nan")}),
        "shape": with_state(arrays, {**values, "shape": [10**9, 2]}),
        "nested": {**arrays, STATE: np.frombuffer(b"[" * 100_000, np.uint8)},
        "state": {name: array for name, array in arrays.items() if name != STATE},
        "descriptor": {**arrays, "descriptor": np.zeros_like(arrays["descriptor"])},
    }
    if kind == "header":
        header = b'{"a":' * 100_000
        (tmp_path / folders.REPERTOIRE).write_bytes(len(header).to_bytes(8, "little") + header)
    else:
        _tensors.write(tmp_path / folders.REPERTOIRE, lies[kind], FORM, learned)
    with pytest.warns(UserWarning, match="the checkpoint before it is taken"):
        aurora = auroraqd.resume(tmp_path)
    assert aurora.generation == 2
    (tmp_path / folders.PREVIOUS).unlink()
    with pytest.raises(ValueError, match=r"repertoire\.safetensors"):
        auroraqd.resume(tmp_path)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("config.json", '{"environment": null}', "must hold an object as environment, got None"),
        ("config.json", "[" * 100_000, "config.json is damaged"),
        ("history.csv", "generation", "history.csv is damaged"),
    ],
)
def test_the_other_files(folder, tmp_path, name, text, message):
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        auroraqd.resume(tmp_path) if name == "config.json" else folders.load_history(tmp_path)


def shown(folder):
    command = [sys.executable, "-W", "error", "-m", "auroraqd.cli", "show", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def moving(scale, dtype):
    def task(genotypes):
        return np.repeat((2 * genotypes[:, None] - 1) * scale, 4, axis=1).astype(dtype)

    return task


@pytest.mark.parametrize(
    ("scale", "dtype", "lost"),
    [(1, bool, []), (65_504, np.float16, []), (1.7e308, np.float64, ["repertoire", "skills"])],
)
def test_a_figure_that_cannot_be_drawn_costs_no_other(tmp_path, scale, dtype, lost):
    auroraqd.save(auroraqd.Aurora(2, "genotype", seed=0, batch_size=20).run(moving(scale, dtype), generations=2), tmp_path)
    done = shown(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "individuals" in done.stdout
    for name in ("repertoire", "history", "skills"):
        assert (tmp_path / "figures" / f"{name}.png").is_file() == (name not in lost)
        assert (f"the figure {name} could not be drawn: " in done.stderr) == (name in lost)


def test_counts_that_no_run_can_have(folder, tmp_path):
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    header, *rows = (tmp_path / folders.HISTORY).read_text().splitlines()
    last = rows[-1].split(",")
    last[1] = "9" * 400
    (tmp_path / folders.HISTORY).write_text("\n".join([header, *rows[:-1], ",".join(last), ""]))
    done = shown(tmp_path)
    assert done.returncode == 1
    assert "evaluations is too large" in " ".join(done.stderr.split())


def zipped(**members):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        for name, member in members.items():
            file.writestr(name.replace("__", "."), member)
    return content.getvalue()


def sneaky():
    """skops files that were made to do harm, by name."""
    header = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    array = {"__class__": "ndarray", "__module__": "numpy", "__loader__": "NdArrayNode", "type": "numpy", "file": "0.npy"}
    loop = {"__class__": "list", "__module__": "builtins", "__loader__": "ListNode", "content": [], "__id__": 1}
    loop["content"] = [{"__class__": "list", "__module__": "builtins", "__loader__": "CachedNode", "__id__": 1}]
    code = {"__class__": "system", "__module__": "os", "__loader__": "FunctionNode", "content": "system"}
    yield "no schema", zipped(a=b"")
    yield "bomb", zipped(schema__json=b" " * 50_000_000)
    yield "no zip", b"PK\x03\x04" + bytes(100)
    yield "nested", zipped(schema__json=b"[" * 1000)
    for name, schema in (("array", array), ("loop", loop), ("code", code), ("word", "x"), ("null", None)):
        content = {**schema, "protocol": 2, "_skops_version": "0.11"} if isinstance(schema, dict) else schema
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as file:
            file.writestr("schema.json", json.dumps(content))
            file.writestr("0.npy", header.ljust(127) + b"\n")
        yield name, out.getvalue()


@pytest.mark.parametrize(("name", "content"), list(sneaky()))
def test_transformers_made_to_do_harm(name, content):
    with pytest.raises(ValueError, match=r"descriptor (is damaged|needs)"):
        _transformers.loaded(content, [])


def test_a_spoiled_transformer_is_damaged():
    good = _transformers.dumped(PCA(n_components=2).fit(GOOD))
    for spoiled in (good[:100], b"", good.replace(b'"PCA"', b'"PCB"'), bytes(200)):
        with pytest.raises(ValueError, match=r"descriptor (is damaged|needs)"):
            _transformers.loaded(spoiled, [])
