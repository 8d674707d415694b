"""Emitters of pyribs."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.emitters import Ribs

ribs = pytest.importorskip("ribs.emitters")
TASK = auroraqd.tasks.Ballistic()
N = 20


def middle(archive):
    return archive.sample_elites(1)["solution"][0]


def cma(archive, n_genes, seed, **options):
    options = {"sigma0": 0.1, "batch_size": N, "seed": seed, **options}
    return ribs.EvolutionStrategyEmitter(archive, x0=middle(archive), **options)


def random_direction(archive, n_genes, seed):
    return cma(archive, n_genes, seed, ranker="2rd")


def bounded(archive, n_genes, seed):
    return cma(archive, n_genes, seed, bounds=[(0, 1)] * n_genes, ranker="obj", selection_rule="mu", restart_rule="basic")


def lines(archive, n_genes, seed):
    return ribs.IsoLineEmitter(archive, x0=middle(archive), batch_size=N, seed=seed)


def gaussian(archive, n_genes, seed):
    return ribs.GaussianEmitter(archive, sigma=0.5, x0=middle(archive), batch_size=N, seed=seed)


def aurora_of(make, **options):
    options = {"seed": 0, "batch_size": N, "schedule": auroraqd.Every(4), **options}
    return auroraqd.Aurora(2, PCA(2), emitter=Ribs(make), **options)


@pytest.mark.parametrize("make", [cma, random_direction, bounded, lines, gaussian])
@pytest.mark.parametrize("archive", [auroraqd.UnstructuredArchive, lambda: auroraqd.DominatedArchive(50)])
def test_a_run_grows_and_is_the_same_again(make, archive):
    first, second = (aurora_of(make, archive=archive()).run(TASK, generations=14) for _ in range(2))
    assert_array_equal(first.archive.genotype, second.archive.genotype)
    assert (first.archive.born >= N).any()
    assert ((first.archive.genotype >= 0) & (first.archive.genotype <= 1)).all()


class Watched:
    """What the emitter is told."""

    def __init__(self, archive, n_genes, seed):
        self.archive, self.told, self.rng = archive, [], np.random.default_rng(seed)

    def ask(self):
        return self.rng.normal(0.5, 0.5, (N, 2))

    def tell(self, *columns):
        self.told.append(columns)


def test_what_it_is_told():
    def failing(genotypes):
        _, observation, truth = TASK(genotypes)
        return np.where(np.arange(N) % 5, np.arange(N), np.nan), observation, truth

    aurora = aurora_of(Watched, schedule=auroraqd.Never())
    inside = aurora._emitters.emitters[0]
    aurora.run(failing, generations=1)
    status = aurora.tell(*failing(asked := aurora.ask()))
    ((solution, objective, measures, info),) = inside._emitter.told
    assert_array_equal(solution, asked)
    valid = status >= 0
    assert_array_equal(objective[valid], np.arange(N)[valid])
    assert_array_equal(objective[~valid], objective[valid].min())
    assert np.isfinite(measures).all()
    assert_array_equal(info["status"], [{-1: 0, 0: 0, 1: 2, 2: 1}[value] for value in status.tolist()])
    assert_array_equal(info["value"], objective)
    aurora.tell(np.full(N, np.nan), *TASK(aurora.ask())[1:])
    assert len(inside._emitter.told) == 1  # of a batch without one that is valid nothing is known


def test_a_new_descriptor_makes_it_anew():
    aurora = aurora_of(Watched, schedule=auroraqd.Every(3))
    inside, seen = aurora._emitters.emitters[0], []
    for _ in range(9):
        aurora.tell(*TASK(aurora.ask()))
        seen.append(inside._emitter)
    assert [emitter is None for emitter in seen] == [generation % 3 == 0 for generation in range(9)]


def test_saving_says_that_its_state_is_not_saved(tmp_path):
    aurora = aurora_of(cma).run(TASK, generations=3)
    with pytest.warns(UserWarning, match="the state of an emitter of pyribs cannot be saved"):
        auroraqd.save(aurora, tmp_path / "run")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        auroraqd.save(aurora, tmp_path / "run")  # once is enough
    with pytest.raises(ValueError, match=r"make must be callable.*resume\(\.\.\., emitter="):
        auroraqd.resume(tmp_path / "run")
    again = auroraqd.resume(tmp_path / "run", emitter=Ribs(cma))
    assert again.run(TASK, generations=5).generation == 8


@pytest.mark.filterwarnings("ignore:.* far outside the others")  # it has no seed
def test_the_example_of_the_documentation():
    page = (Path(__file__).parents[1] / "docs" / "algorithms.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    found = {}
    exec(code.replace("generations=500", "generations=5"), found)
    assert found["aurora"].generation == 5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda archive, n_genes, seed: cma(archive, n_genes, seed, batch_size=7), "batch_size=20"),
        (lambda archive, n_genes, seed: object(), "make must give an emitter of pyribs"),
    ],
)
def test_what_make_gives_is_looked_at(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        aurora_of(make).run(TASK, generations=2)
    with pytest.raises(TypeError, match="make must be callable"):
        Ribs("cma")
