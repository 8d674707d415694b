"""Whatever is given to a public call, or lies in a run folder: it works, or there is a sentence; no crash, no foreign error."""

import copy
import inspect
import io
import json
import subprocess
import sys
import traceback
import warnings
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import cli, evaluate, metrics, report, tasks
from auroraqd.experiments import Settings
from auroraqd.runs import _tensors, _transformers, folders

FORM, STATE = "auroraqd repertoire 2", "state.json"
OURS = (ValueError, TypeError, IndexError, RuntimeError, OSError)
SOURCE = str(Path(auroraqd.__file__).parent)
FEW = settings(derandomize=True, database=None, deadline=None, max_examples=8, suppress_health_check=list(HealthCheck))

NASTY = {
    "none": None,
    "word": "one",
    "digit": "1",
    "digits": ["1", "2"],
    "bytes": b"x\0y",
    "null byte": "a\0b",
    "complex": np.full((3, 2), 1 + 1j),
    "times": np.zeros((3, 2), "datetime64[s]"),
    "dates": [datetime(2020, 1, 1)] * 3,
    "nones": [[None, 1.0]] * 3,
    "object": object(),
    "objects": np.array([[object(), 1.0]] * 3),
    "masked": np.ma.array(np.zeros((3, 2)), mask=np.eye(3, 2)),
    "masked within": [np.ma.array([0.0, 1.0], mask=[True, False])] * 3,
    "huge": [[10**400, 1]] * 3,
    "very long": 10**5000,
    "large": 2**70,
    "minus large": -(2**70),
    "large within": [2**70, 1],
    "ragged": [[1.0], [1.0, 2.0]],
    "not a number": float("nan"),
    "infinity": float("inf"),
    "nan": np.full((3, 2), np.nan),
    "infinite": np.full((3, 2), np.inf),
    "minus zero": -0.0,
    "denormals": np.full((3, 2), 5e-324) * [[1, -1], [0, 1], [2, 3]],
    "ends": np.full((3, 2), 1.7e308) * [[1, -1], [-1, 1], [1, 1]],
    "end": 1.7e308,
    "empty": [],
    "no columns": np.empty((3, 0)),
    "no rows": np.empty((0, 2)),
    "scalar": 3.0,
    "negative": -1,
    "true": True,
    "bools": np.ones((3, 2), bool),
    "deep": np.zeros((3, 2, 2, 2)),
    "dictionary": {},
    "set": {1, 2},
    "wide floats": np.zeros((3, 2), np.longdouble),
    "huge shape": np.broadcast_to(np.float64(0), (2**40, 2)),
    "fields": np.zeros(3, [("a", float)]),
    "void": np.zeros((3, 2), "V4"),
    "no axes": np.array(1),
    "class": int,
    "function": len,
}
NO_NUMBERS = ("digits", "complex", "times", "dates", "nones", "objects", "masked", "masked within", "huge", "ragged")
GOOD = np.array([[0.1, 0.2], [0.3, 0.9], [0.8, 0.4]])
WORDS = st.one_of(st.text(max_size=3), st.binary(max_size=3))
SCALARS = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.complex_numbers(), WORDS, st.dates())
MADE = st.recursive(
    st.one_of(SCALARS, st.sampled_from(sorted({*NASTY} - {"very long"})).map(lambda kind: NASTY[kind])),
    lambda values: st.one_of(
        st.lists(values, max_size=3), st.tuples(values, values), st.dictionaries(st.text(max_size=2), values, max_size=2)
    ),
    max_leaves=4,
)
"""What no table has: nested, of anything."""


def archives():
    cvt = auroraqd.CVTArchive(GOOD)
    return auroraqd.UnstructuredArchive(), auroraqd.GridArchive((3, 3)), cvt, auroraqd.DominatedArchive()


def filled(archive):
    archive.add(GOOD, GOOD[:, 0], GOOD, GOOD)
    return archive


def circle(genotypes):
    return np.stack([np.cos(6 * np.clip(genotypes, 0, 1)), np.sin(6 * np.clip(genotypes, 0, 1))], axis=2)


def carried(genotypes, state):
    return circle(genotypes), state


def one(genotype, *_):
    return genotype


def tiny():
    """One that is soon compiled, for the few shapes that have two entries at least."""
    return auroraqd.AutoEncoder(2, network="mlp", hidden=(2,), isometry=0, repeats=1, max_epochs=1, min_steps=1, random_state=0)


def here():
    """Workers that are threads of this process."""
    return ThreadPoolExecutor(1)


def grown():
    return auroraqd.Aurora(2, PCA(n_components=2), seed=0, batch_size=20).run(circle, generations=2)


def asked(n=3):
    aurora = auroraqd.Aurora(2, "genotype", batch_size=n)
    aurora.ask()
    return aurora


def told(*arguments):
    return asked().tell(*arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    aurora = grown()
    aurora.ask()
    return auroraqd.save(aurora, tmp_path_factory.mktemp("fuzz") / "run")


def said(call):
    """What the error of a call says, in a line of auroraqd's own; None: it works. Errors that are not ours come through."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=UserWarning)
            call()
    except OURS as error:
        said = error
    else:
        return None
    last, text = traceback.extract_tb(said.__traceback__)[-1], f"{said}"
    assert last.filename.startswith(SOURCE), f"{last}: {text}"
    assert (last.line or "").startswith("raise"), f"{last}: {text}"
    assert 0 < len(text) < 700, text
    assert "\n" not in text, text
    return text


class Call(NamedTuple):
    """A public call: what makes it, arguments with which it works, and those to spoil; by default all that it has."""

    make: object
    good: dict
    spoiled: tuple = ()
    unnamed: tuple = ()  # arguments whose errors name another

    @property
    def names(self):
        if self.spoiled:
            return self.spoiled
        kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
        parameters = inspect.signature(self.make()).parameters.items()
        return tuple(name for name, parameter in parameters if parameter.kind not in kinds)


def of(thing, name):
    return lambda: getattr(copy.deepcopy(thing), name)


def calls(folder):
    """All public calls by name."""
    aurora, repertoire = grown(), auroraqd.load(folder)
    generator = np.random.default_rng(0)
    columns = {"genotype": GOOD, "fitness": GOOD[:, 0], "observation": GOOD, "descriptor": GOOD}
    credits = {"parent_ids": [0, 1, 2], "status": [0, 1, 2]}
    stored = (*columns, "curiosity", "id", "born", "parent")
    options = tuple(inspect.signature(auroraqd.AutoEncoder).parameters)
    streams, trained = {"a": GOOD, "b": GOOD[:, :1]}, tiny().fit(GOOD)
    described = auroraqd.Streams(a=PCA(1), b=None).fit(streams)
    found = {
        "Aurora": Call(lambda: auroraqd.Aurora, {"n_genes": 2, "descriptor": PCA(n_components=1)}, unnamed=("prior",)),
        "Aurora.ask": Call(of(auroraqd.Aurora(2, "genotype"), "ask"), {}),
        "Aurora.tell": Call(lambda: asked().tell, {"fitness": GOOD[:, 0], "observation": GOOD}),
        "Aurora.withdraw": Call(lambda: asked().withdraw, {"ticket": 0}),
        "Aurora.run": Call(
            of(aurora, "run"), {"task": circle, "generations": 1, "callback": lambda _: True}, unnamed=("callback",)
        ),
        "Aurora.describe": Call(of(aurora, "describe"), {"observation": aurora.archive.observation}),
        "Aurora.reconstruct": Call(of(aurora, "reconstruct"), {"descriptor": aurora.archive.descriptor}),
        "Aurora.history.column": Call(of(aurora.history, "column"), {"name": "size"}),
        "AutoEncoder": Call(lambda: lambda **given: auroraqd.AutoEncoder(**given).check_parameters(), {}, options),
        "AutoEncoder.fit": Call(lambda: tiny().fit, {"x": GOOD}, unnamed=("x",)),
        "AutoEncoder.transform": Call(lambda: lambda x: trained.transform(x), {"x": GOOD}),
        "AutoEncoder.inverse_transform": Call(lambda: trained.inverse_transform, {"z": GOOD}),
        "Streams.fit": Call(lambda: auroraqd.Streams(a=PCA(1), b=None).fit, {"x": streams}, unnamed=("x",)),
        "Streams.transform": Call(lambda: described.transform, {"x": streams}),
        "Streams.inverse_transform": Call(lambda: described.inverse_transform, {"z": GOOD[:, :1]}),
        "Streams": Call(lambda: lambda **given: auroraqd.Streams(PCA(1), **given), {}, ("weights",)),
        "Repertoire": Call(
            lambda: lambda columns: auroraqd.Repertoire(columns, object()),
            {"columns": {name: getattr(repertoire, name) for name in stored}},
        ),
        "Repertoire.describe": Call(lambda: repertoire.describe, {"observation": repertoire.observation}),
        "Repertoire.reconstruct": Call(lambda: repertoire.reconstruct, {"descriptor": repertoire.descriptor}),
        "Repertoire.reach": Call(lambda: repertoire.reach, {"observation": repertoire.observation[0]}),
        "Repertoire.sample": Call(lambda: repertoire.sample, {"n": 2}),
        "Repertoire.explained": Call(lambda: repertoire.explained, {}),
        "Repertoire.outlying": Call(lambda: repertoire.outlying, {}),
        "Repertoire.evaluate": Call(lambda: repertoire.evaluate, {"task": circle, "rows": [0, 1]}),
        "Repertoire.refine": Call(
            lambda: repertoire.refine,
            {"task": circle, "goals": repertoire.observation[:2], "by": "observation", "trials": 2},
        ),
        "Repertoire.deploy": Call(lambda: repertoire.deploy, {"folder": "robot", "rows": [0, 1], "overwrite": True}),
        "Repertoire.plot": Call(lambda: repertoire.plot, {}),
        "Repertoire.to_pandas": Call(lambda: repertoire.to_pandas, {}),
        "Adaptation": Call(lambda: auroraqd.Adaptation, {"space": GOOD, "promise": GOOD[:, 0]}),
        "Adaptation, goal": Call(
            lambda: auroraqd.Adaptation, {"space": GOOD, "promise": GOOD, "goal": [0, 0]}, unnamed=("goal",)
        ),
        "Adaptation.tell": Call(of(auroraqd.Adaptation(GOOD, GOOD[:, 0]), "tell"), {"row": 0, "outcome": 1.0}),
        "Adaptation.ask": Call(of(auroraqd.Adaptation(GOOD, GOOD[:, 0]), "ask"), {}),
        "Adaptation.predict": Call(of(auroraqd.Adaptation(GOOD, GOOD[:, 0]), "predict"), {}),
        "Checkpoints": Call(lambda: auroraqd.Checkpoints, {"aurora": aurora, "folder": folder}),
        "Snapshots": Call(lambda: auroraqd.Snapshots, {"folder": "run"}),
        "save": Call(lambda: auroraqd.save, {"aurora": asked(), "folder": "run", "overwrite": True}),
        "load": Call(lambda: auroraqd.load, {"folder": folder}),
        "resume": Call(
            lambda: auroraqd.resume,
            {"folder": folder},
            ("folder", "trusted", "any_environment", "selection", "variation", "resolution", "schedule", "archive", "other"),
        ),
        "tessellate": Call(lambda: auroraqd.tessellate, {"samples": GOOD, "cells": 2, "cache": False}),
        "metrics.klc": Call(lambda: metrics.klc, {"reference": GOOD, "compared": GOOD}),
        "metrics.klc, marginal": Call(lambda: metrics.klc, {"reference": GOOD, "compared": GOOD, "marginal": True}),
        "metrics.outside": Call(lambda: metrics.outside, {"reference": GOOD, "compared": GOOD}),
        "metrics.reached": Call(lambda: metrics.reached, {"reference": GOOD, "compared": GOOD}),
        "metrics.diversity": Call(lambda: metrics.diversity, {"trajectories": GOOD[None]}),
        "metrics.squares": Call(lambda: metrics.squares, {"trajectories": GOOD[None]}),
        "metrics.reconstruction_error": Call(
            lambda: metrics.reconstruction_error, {"observation": GOOD, "reconstruction": GOOD}
        ),
        "evaluate.over": Call(lambda: evaluate.over, {"executor": evaluate.processes(1), "task": circle}),
        "evaluate.over()": Call(lambda: evaluate.over(here, circle), {"genotypes": GOOD}, unnamed=("genotypes",)),
        "evaluate.over(), seeded": Call(
            lambda: evaluate.over(here, tasks.each(one, seeded=True)),
            {"genotypes": GOOD, "seeds": [1, 2, 3]},
            unnamed=("genotypes", "seeds"),
        ),
        "evaluate.processes": Call(lambda: evaluate.processes, {}),
        "evaluate.dask": Call(lambda: evaluate.dask, {"client": None}),
        "tasks.each": Call(lambda: tasks.each, {"function": one}),
        "tasks.each()": Call(lambda: tasks.each(one), {"genotypes": GOOD}),
        "tasks.each(), seeded": Call(lambda: tasks.each(one, seeded=True), {"genotypes": GOOD, "seeds": [1, 2, 3]}),
        "tasks.from_jax": Call(lambda: tasks.from_jax, {"function": one}),
        "tasks.repeated": Call(lambda: tasks.repeated, {"task": circle, "times": 2}),
        "tasks.repeated()": Call(
            lambda: tasks.repeated(lambda g: np.zeros((len(g), 1)), 2), {"genotypes": GOOD}, unnamed=("genotypes",)
        ),
        "tasks.Genes": Call(lambda: tasks.Genes, {"angle": (0, 1)}, ("angle",)),
        "tasks.Genes, low": Call(lambda: lambda low: tasks.Genes(a=(low, 5)), {"low": 0}),
        "tasks.Genes, unit": Call(lambda: lambda unit: tasks.Genes(a=(0, 5, unit)), {"unit": "m"}),
        "tasks.Genes.scale": Call(lambda: tasks.Genes(a=(0, 1), b=(0, 2)).scale, {"genotypes": GOOD}),
        "tasks.Genes.unscale": Call(lambda: tasks.Genes(a=(0, 1), b=(0, 2)).unscale, {"values": GOOD}),
        "tasks.Ballistic()": Call(lambda: tasks.Ballistic(), {"genotypes": GOOD}),
        "tasks.AirHockey": Call(lambda: tasks.AirHockey, {}),
        "tasks.AirHockey()": Call(lambda: tasks.AirHockey(), {"genotypes": np.full((1, 8), 0.5)}),
        "tasks.AirHockeyCamera": Call(lambda: tasks.AirHockeyCamera, {}),
        "tasks.AirHockeyCamera()": Call(lambda: tasks.AirHockeyCamera(), {"genotypes": np.full((1, 8), 0.5)}),
        "tasks.Maze": Call(lambda: tasks.Maze, {}),
        "tasks.Maze()": Call(lambda: tasks.Maze(steps=3), {"genotypes": np.full((1, 42), 0.5)}),
        "tasks.Maze.paths": Call(lambda: tasks.Maze(steps=3).paths, {"genotypes": np.full((1, 42), 0.5), "samples": 2}),
        "tasks.Hierarchical": Call(lambda: tasks.Hierarchical, {"skills": repertoire, "task": carried, "steps": 2}),
        "tasks.Hierarchical()": Call(
            lambda: tasks.Hierarchical(repertoire, carried, 2), {"genotypes": np.full((3, 4), 0.5)}, unnamed=("genotypes",)
        ),
        "tasks.Damage": Call(lambda: tasks.Damage, {}),
        "tasks.Camera": Call(lambda: tasks.Camera, {}),
        "tasks.Sinusoids": Call(lambda: tasks.Sinusoids, {}),
        "tasks.Splines": Call(lambda: tasks.Splines, {}),
        "tasks.SquareWaves": Call(lambda: tasks.SquareWaves, {}),
        "tasks.MLP": Call(lambda: tasks.MLP, {}),
        "VAT": Call(lambda: auroraqd.VAT, {}),
        "VAT()": Call(lambda: auroraqd.VAT(), {"descriptors": GOOD}),
        "Fixed": Call(lambda: auroraqd.Fixed, {"l": 1}),
        "CSC": Call(lambda: auroraqd.CSC, {}),
        "CSC()": Call(lambda: auroraqd.CSC(), {"descriptors": GOOD}),
        "DominatedArchive": Call(lambda: auroraqd.DominatedArchive, {}),
        "Novelty()": Call(lambda: auroraqd.Novelty(), {"archive": aurora.archive, "n": 2, "rng": generator}),
        "Surprise()": Call(lambda: auroraqd.Surprise(), {"archive": aurora.archive, "n": 2, "rng": generator}, ("n", "rng")),
        "Mixed": Call(lambda: auroraqd.Mixed, {}),
        "emitters.Goals": Call(lambda: auroraqd.emitters.Goals, {}),
        "emitters.NSLC": Call(lambda: auroraqd.emitters.NSLC, {}),
        "emitters.TAXONS": Call(lambda: auroraqd.emitters.TAXONS, {}),
        "Size": Call(lambda: auroraqd.Size, {}),
        "Size()": Call(lambda: auroraqd.Size(), {"descriptors": GOOD}),
        "Doubling": Call(lambda: auroraqd.Doubling, {}),
        "Doubling()": Call(lambda: auroraqd.Doubling(), {"generation": 1}),
        "Widening": Call(lambda: auroraqd.Widening, {}),
        "Widening()": Call(lambda: auroraqd.Widening(), {"generation": 1}),
        "Every": Call(lambda: auroraqd.Every, {"generations": 1}),
        "Every()": Call(lambda: auroraqd.Every(1), {"generation": 1}),
        "Never()": Call(lambda: auroraqd.Never(), {"generation": 1}),
        "Curiosity()": Call(lambda: auroraqd.Curiosity(), {"archive": aurora.archive, "n": 2, "rng": generator}),
        "Uniform()": Call(lambda: auroraqd.Uniform(), {"archive": aurora.archive, "n": 2, "rng": generator}),
        "Polynomial": Call(lambda: auroraqd.Polynomial, {}),
        "Polynomial()": Call(lambda: auroraqd.Polynomial(), {"parents": GOOD, "rng": generator}),
        "Gaussian": Call(lambda: auroraqd.Gaussian, {}),
        "Gaussian()": Call(lambda: auroraqd.Gaussian(), {"parents": GOOD, "rng": generator}),
        "IsoLine": Call(lambda: auroraqd.IsoLine, {}),
        "IsoLine()": Call(lambda: auroraqd.IsoLine(), {"parents": np.stack([GOOD, GOOD], axis=1), "rng": generator}),
        "Evaluation": Call(
            lambda: (
                lambda **columns: auroraqd.Aurora(2, "genotype", batch_size=3).run(
                    lambda _: auroraqd.Evaluation(**columns), generations=1
                )
            ),
            {"fitness": GOOD[:, 0], "observation": GOOD},
            ("fitness", "observation", "ground_truth"),
        ),
        "report.write_figures": Call(lambda: report.write_figures, {"folder": None}),
        "report.repertoire_figure": Call(lambda: report.repertoire_figure, {"repertoire": None}),
        "report.history_figure": Call(lambda: report.history_figure, {"records": None}),
        "report.explore": Call(
            lambda: report.explore, {"run": folder, "path": "x.html", "most": 10, "films": 0, "task": None}, unnamed=("run",)
        ),
        "report.film": Call(lambda: report.film, {"genotypes": GOOD, "path": "x.gif"}, ("task",)),
        "report.write_report": Call(lambda: report.write_report, {"experiment": None}, ("ledger",)),
        "report.write_paper": Call(lambda: report.write_paper, {"ledgers": {}, "folder": "paper"}),
        "UnstructuredArchive": Call(lambda: auroraqd.UnstructuredArchive, {}),
        "UnstructuredArchive.adjust": Call(lambda: lambda l: filled(archives()[0]).adjust(l), {"l": 1}),
        "UnstructuredArchive.l": Call(lambda: lambda l: setattr(filled(archives()[0]), "l", l), {"l": 1}),
        "UnstructuredArchive.novelty": Call(lambda: filled(archives()[0]).novelty, {}),
        "GridArchive": Call(lambda: auroraqd.GridArchive, {"cells": (3, 3)}),
        "CVTArchive": Call(lambda: auroraqd.CVTArchive, {"centroids": GOOD}),
    }
    if find_spec("gymnasium"):
        cart = {"env_id": "CartPole-v1", "controller": tasks.MLP(hidden=()), "steps": 2, "samples": 2}
        ten = {"genotypes": np.full((3, 10), 0.5)}
        # Of options that an environment has not, the sentence is Gymnasium's.
        found["tasks.Gym"] = Call(lambda: tasks.Gym, cart, unnamed=("options",))
        found["tasks.Gym()"] = Call(lambda: tasks.Gym(**cart), ten)
        found["tasks.Gym(), noisy"] = Call(lambda: tasks.Gym(**cart, noisy=True), {**ten, "seeds": [1, 2, 3]})
        found["tasks.Hexapod"] = Call(lambda: tasks.Hexapod, {"seconds": 0.03, "samples": 1, "threads": 1})
        found["tasks.Hexapod()"] = Call(lambda: tasks.Hexapod(seconds=0.03, samples=1), {"genotypes": np.full((3, 36), 0.5)})
        found["tasks.Hexapod.carried"] = Call(
            lambda: tasks.Hexapod(seconds=0.03, samples=1).carried, {"genotypes": np.full((3, 36), 0.5)}
        )
        arm = {"steps": 1, "samples": 1, "threads": 1}
        found["tasks.OctopusArm"] = Call(lambda: tasks.OctopusArm, arm, unnamed=("options",))
        found["tasks.OctopusArm()"] = Call(lambda: tasks.OctopusArm(**arm), {"genotypes": np.full((3, 48), 0.5)})
        found["tasks.Gym.episode"] = Call(lambda: tasks.Gym(**cart).episode, ten)
    for empty in archives():
        kind, full = type(empty).__name__, filled(copy.deepcopy(empty))
        found[f"empty {kind}.add"] = Call(of(empty, "add"), columns)
        found[f"{kind}.add"] = Call(of(full, "add"), columns)
        found[f"{kind}.redescribe"] = Call(of(full, "redescribe"), {"descriptor": GOOD})
        found[f"{kind}.credit"] = Call(of(full, "credit"), credits)
        found[f"{kind}.rows_of"] = Call(of(full, "rows_of"), {"ids": [0]})
        before = {"columns": {name: getattr(full, name) for name in stored}, "state": full.state}
        found[f"{kind}.restore"] = Call(of(full, "restore"), before, unnamed=("state",))
        if hasattr(full, "cell_of"):
            found[f"{kind}.cell_of"] = Call(of(full, "cell_of"), {"descriptor": GOOD})
    return found


ELSEWHERE = {  # public names that no call of their own: values, errors, and what stands for something else
    "Archive",
    "DescriptorError",
    "TaskError",
    "__version__",
    "evaluate.Spread",  # what `over` returns
    "tasks.ClosedLoop",
    "tasks.OpenLoop",
    "tasks.Episode",
    "tasks.Evaluation",
    "tasks.TaskError",
    "tasks.DAMAGES",
    "tasks.Gym",  # which is there if the extra is
    "tasks.Hexapod",
    "tasks.OctopusArm",
    "archives",  # what is public in it is public here
    "emitters",
    "callbacks",  # in test_loggers.py and others
    "testing",
    "DominatedArchive.place",
    "DominatedArchive.reindex",
    "DominatedArchive.score",
    "UnstructuredArchive.place",  # what an archive asks itself
    "UnstructuredArchive.reindex",
}


def test_no_public_call_is_missing(folder):
    there = {name.partition(",")[0].removesuffix("()") for name in calls(folder)}
    there |= {name.partition(".")[0] for name in there} | ELSEWHERE
    for owner in (auroraqd, evaluate, tasks, report):
        prefix = "" if owner is auroraqd else f"{owner.__name__.removeprefix('auroraqd.')}."
        assert not {f"{prefix}{name}" for name in owner.__all__} - there
    for kind in (auroraqd.Aurora, auroraqd.Repertoire, auroraqd.Adaptation, *map(type, archives())):
        methods = {name for name, value in vars(kind).items() if callable(value) and not name.startswith("_")}
        assert not {f"{kind.__name__}.{name}" for name in methods} - there, kind


def works_or_says(name, call, argument, bad):
    if name == "Aurora.run" and argument == "callback" and bad is len:
        return  # what a callback raises is the callback's
    if name == "AutoEncoder.fit" and bad is NASTY["deep"]:
        return  # it works, and takes seconds to compile
    text = said(lambda: call.make()(**{**call.good, argument: bad}))
    named = argument.replace("_", " ") in (text or "").replace("_", " ")
    assert text is None or named or argument in call.unnamed, text


def test_public_calls_work_or_say_what_is_wrong(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, call in calls(folder).items():
        for argument in call.names:
            for kind, bad in NASTY.items():
                try:
                    works_or_says(name, call, argument, bad)
                except Exception as error:
                    raise AssertionError(f"{name}, {argument}: {kind}") from error


@FEW
@given(bad=MADE)
def test_public_calls_given_what_no_table_has(folder, tmp_path_factory, bad):
    with chdir(tmp_path_factory.getbasetemp()):
        for name, call in calls(folder).items():
            for argument in call.names:
                works_or_says(name, call, argument, bad)


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
        try:
            said(call)
        except Exception as error:
            raise AssertionError(what) from error


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


BADS = (None, float("nan"), float("inf"), -1, 1.5, "x", True, [], {}, [10**9, 2], 10**30, [[1]], "9" * 5000)


@settings(FEW, max_examples=150)
@given(data=st.data())
def test_every_value_of_the_state(folder, data):
    arrays, kind, values = parts_of(folder)
    path, bad = data.draw(st.sampled_from(list(leaves(values)))), data.draw(st.sampled_from(BADS))
    try:
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
        ("config.json", "9" * 5000, "config.json is damaged"),
        ("config.json", "\x00", "config.json is damaged"),
        ("config.json", "[]", "config.json must hold a JSON object"),
        ("history.csv", "generation", "history.csv is damaged"),
        ("history.csv", "", "history.csv is damaged"),
        ("history.csv", '"' * 200_000, "history.csv is damaged"),
    ],
)
def test_the_other_files(folder, tmp_path, name, text, message):
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        auroraqd.resume(tmp_path) if name == "config.json" else folders.load_history(tmp_path)


@pytest.mark.parametrize("cell", ["", "x", "nan", "1.5", "9" * 5000, "1e400", "\x00", "-1e999", "1;2"])
def test_every_column_of_the_history(folder, tmp_path, cell):
    header, first, *rows = (folder / folders.HISTORY).read_text().splitlines()
    for name in folders.CONFIG, folders.REPERTOIRE:
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    for place in range(len(header.split(","))):
        cells = first.split(",")
        cells[place] = cell
        (tmp_path / folders.HISTORY).write_text("\n".join([header, ",".join(cells), *rows, ""]))
        text = said(lambda: folders.load_history(tmp_path))
        assert text is None or (text.startswith(f"{tmp_path / folders.HISTORY} is damaged: ") and len(text) < 400), text
        said(lambda: auroraqd.resume(tmp_path).run(circle, generations=1))


@settings(FEW, max_examples=40)
@given(data=st.data())
def test_files_with_bytes_that_are_lost_or_changed(folder, tmp_path_factory, data):
    copied = tmp_path_factory.mktemp("bytes")
    for name in (folders.CONFIG, folders.HISTORY, folders.REPERTOIRE):
        (copied / name).write_bytes((folder / name).read_bytes())
    name = data.draw(st.sampled_from([folders.CONFIG, folders.HISTORY, folders.REPERTOIRE]))
    content = bytearray((folder / name).read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        del content[place:]
    else:
        content[place] ^= data.draw(st.integers(1, 255))
    (copied / name).write_bytes(content)
    goes_on_or_says(copied, (name, place))


WITHIN = """
import resource, sys
import auroraqd
from auroraqd.runs import folders
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
for call in (auroraqd.load, auroraqd.resume, folders.load_config, folders.load_history):
    try:
        call(sys.argv[1])
    except ValueError as error:
        print(error)
"""


@pytest.mark.parametrize("name", [folders.REPERTOIRE, folders.CONFIG, folders.HISTORY])
def test_files_that_are_larger_than_memory(folder, tmp_path, name):
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    with (tmp_path / name).open("r+b") as file:
        file.truncate(1 << 40)  # of zeros, that take no room on the disk
    command = [sys.executable, "-c", WITHIN, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout
    assert all(f"{tmp_path / name} is damaged" in line for line in done.stdout.splitlines()), done.stdout


def commanded(capsys, *arguments):
    """The exit code of `auroraqd`, and what it prints on both streams."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["auroraqd", *map(str, arguments)])
        patch.setattr(warnings, "showwarning", warnings.showwarning)  # which the command replaces
        with pytest.raises(SystemExit) as end:
            cli.main()
    out, err = capsys.readouterr()
    return end.value.code, " ".join(out.split()), " ".join(err.split())


def moving(scale, dtype):
    def task(genotypes):
        return np.repeat((2 * genotypes[:, None] - 1) * scale, 4, axis=1).astype(dtype)

    return task


@pytest.mark.parametrize(
    ("scale", "dtype", "lost"),
    [(1, bool, []), (65_504, np.float16, []), (1.7e308, np.float64, ["repertoire", "skills"])],
)
def test_a_figure_that_cannot_be_drawn_costs_no_other(tmp_path, capsys, scale, dtype, lost):
    auroraqd.save(auroraqd.Aurora(2, "genotype", seed=0, batch_size=20).run(moving(scale, dtype), generations=2), tmp_path)
    code, out, err = commanded(capsys, "show", tmp_path)
    assert code == 0, err
    assert "individuals" in out
    for name in ("repertoire", "history", "skills"):
        assert (tmp_path / "figures" / f"{name}.png").is_file() == (name not in lost)
        assert (f"the figure {name} could not be drawn: " in err) == (name in lost)


def test_counts_that_no_run_can_have(folder, tmp_path, capsys):
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    header, *rows = (tmp_path / folders.HISTORY).read_text().splitlines()
    last = rows[-1].split(",")
    last[1] = "9" * 400
    (tmp_path / folders.HISTORY).write_text("\n".join([header, *rows[:-1], ",".join(last), ""]))
    code, _, err = commanded(capsys, "show", tmp_path)
    assert code == 1
    assert "evaluations is too large" in err


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


# A file of bytes has the time in it, and workers must give each test one name.
@pytest.mark.parametrize(("name", "content"), [pytest.param(*case, id=case[0]) for case in sneaky()])
def test_transformers_made_to_do_harm(name, content):
    with pytest.raises(ValueError, match=r"descriptor (is damaged|needs)"):
        _transformers.loaded(content, [])


def test_a_spoiled_transformer_is_damaged():
    good = _transformers.dumped(PCA(n_components=2).fit(GOOD))
    for spoiled in (good[:100], b"", good.replace(b'"PCA"', b'"PCB"'), bytes(200)):
        with pytest.raises(ValueError, match=r"descriptor (is damaged|needs)"):
            _transformers.loaded(spoiled, [])


@pytest.fixture(scope="module")
def from_the_command_line(tmp_path_factory):
    """A run of `auroraqd run`, that can go on."""
    out = tmp_path_factory.mktemp("cli") / "run"
    settings = Settings(generations=3, batch_size=20)
    task, aurora = settings.build()
    return folders.save(aurora.run(task, generations=2), out, config=settings.as_json())


EDITED = {
    "task": "air-hockey",
    "descriptor": "genotype",
    "components": 1,
    "pretrained": True,
    "generations": 2,
    "batch_size": 21,
    "seed": 1,
    "selection": {"type": "Uniform"},
    "variation": {"type": "Polynomial", "rate": 0.2, "eta": 10.0, "at_least_one": True},
    "resolution": {"type": "Fixed", "l": 0.1},
    "schedule": {"type": "Never"},
    "archive": {"type": "Grid", "cells": 30, "low": -1.0, "high": 1.0},
    "l": 0.5,
    "k": 3,
    "epsilon": 0.2,
    "competition": "elitist",
    "capacity": 100,
    "survival": 0.5,
    "robust": False,
    "emitter": {"type": "Goals", "random": 0.2, "sigma": 0.05, "first": 100},
    "asynchronous": True,
    "environment": {"python": "2.7"},
    "provenance": {"task": {"module": "elsewhere", "name": "Ballistic"}},
}


def test_all_keys_of_config_are_edited(from_the_command_line):
    assert set(folders.load_config(from_the_command_line)) == set(EDITED)


@pytest.mark.parametrize("key", list(EDITED))
def test_a_key_of_config_that_was_edited_is_said(from_the_command_line, tmp_path, capsys, key):
    for path in from_the_command_line.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    config = folders.load_config(tmp_path)
    (tmp_path / folders.CONFIG).write_text(json.dumps({**config, key: EDITED[key]}))
    code, out, err = commanded(capsys, "resume", tmp_path, "--no-figures")
    text = f"{out} {err}"
    assert code == (0 if key == "provenance" else 1), text
    assert {"generations": "is at its end", "provenance": "the task was", "environment": "another environment"}.get(
        key, key
    ) in text


@settings(FEW, max_examples=60)
@given(data=st.data())
def test_keys_of_config_with_what_they_must_not_hold(from_the_command_line, tmp_path_factory, data):
    key, bad = data.draw(st.sampled_from(list(EDITED))), data.draw(st.sampled_from(BADS[:-1]))
    copied = tmp_path_factory.mktemp("config")
    config = {**folders.load_config(from_the_command_line), key: bad}
    (copied / folders.CONFIG).write_text(json.dumps(config))
    (copied / folders.HISTORY).write_bytes((from_the_command_line / folders.HISTORY).read_bytes())
    (copied / folders.REPERTOIRE).write_bytes((from_the_command_line / folders.REPERTOIRE).read_bytes())
    said(lambda: Settings.from_json(folders.load_config(copied)))
    said(lambda: auroraqd.resume(copied))
    said(lambda: auroraqd.load(copied).to_pandas())
