"""Emitters of pyribs."""

import re
import warnings
from pathlib import Path

import commands
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import asynchronous, evaluate
from auroraqd.archives.base import NEW, REJECTED, REPLACED
from auroraqd.emitters import Ribs
from auroraqd.emitters.ribs import CMA, Gaussian, IsoLine
from auroraqd.experiments.settings import Settings, strategy

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

    made = []

    def __init__(self, archive, n_genes, seed):
        self.archive, self.n_genes, self.rng, self.told, self.asked = archive, n_genes, np.random.default_rng(seed), [], []
        self.made.append(self)

    def ask(self):
        self.asked.append(self.rng.normal(0.5, 0.5, (N, self.n_genes)))
        return self.asked[-1]

    def tell(self, *columns):
        self.told.append(columns)


def test_what_it_is_told():
    def failing(genotypes):
        _, observation, truth = TASK(genotypes)
        return np.where(np.arange(N) % 5, np.arange(N), np.nan), observation, truth

    aurora = aurora_of(Watched, schedule=auroraqd.Never())
    Watched.made.clear()
    aurora.run(failing, generations=1)
    status = aurora.tell(*failing(asked := aurora.ask()))
    (inside,) = Watched.made
    ((solution, objective, measures, info),) = inside.told
    assert_array_equal(solution, asked)
    valid = status >= 0
    assert_array_equal(objective[valid], np.arange(N)[valid])
    assert_array_equal(objective[~valid], objective[valid].min())
    assert np.isfinite(measures).all()
    assert_array_equal(info["status"], [{-1: 0, 0: 0, 1: 2, 2: 1}[value] for value in status.tolist()])
    gain = aurora.latest[1].gain
    assert_array_equal(np.isfinite(gain), status == REPLACED)
    assert_array_equal(info["value"][status == NEW], objective[status == NEW])
    assert_array_equal(info["value"][status == REPLACED], gain[status == REPLACED])
    assert_array_equal(info["value"][status == REJECTED], objective[status == REJECTED] - aurora.archive.fitness.max())
    assert_array_equal(info["value"][~valid], info["value"][valid].min())
    aurora.tell(np.full(N, np.nan), *TASK(aurora.ask())[1:])
    assert len(inside.told) == 1  # of a batch without one that is valid nothing is known


def test_a_new_descriptor_makes_it_anew():
    Watched.made.clear()
    aurora, made = aurora_of(Watched, schedule=auroraqd.Every(3)), []
    for _ in range(9):
        aurora.tell(*TASK(aurora.ask()))
        made.append(len(Watched.made))
    assert made == [0, 1, 1, 1, 2, 2, 2, 3, 3]


def told_at_random(aurora, generations, seed):
    """Asked for in parts and told in another order; a tenth of the proposals is withdrawn."""
    rng, out = np.random.default_rng(seed), []
    while aurora.generation < generations:
        out += [aurora.ask(int(n)) for n in rng.integers(1, 8, size=3)]
        while len(out) > 5:
            proposal = out.pop(int(rng.integers(len(out))))
            if rng.random() < 0.1:
                aurora.withdraw(proposal.ticket)
            else:
                aurora.tell(*TASK(proposal.genotype), ticket=proposal.ticket)
    return aurora


def test_batches_are_told_whole_in_whatever_order_they_are_known():
    Watched.made.clear()
    aurora = told_at_random(aurora_of(Watched, schedule=auroraqd.Never()), 60, 1)
    for emitter in Watched.made:
        assert len(emitter.asked) - len(emitter.told) in (0, 1)
        for asked, (solution, objective, measures, _) in zip(emitter.asked, emitter.told, strict=False):
            assert_array_equal(solution, np.clip(asked, 0, 1))
            assert objective.shape == (N,)
            assert np.isfinite(measures).all()
    told = sum(len(emitter.told) for emitter in Watched.made)
    assert len(Watched.made) < 9, "as many emitters as are needed at once, and no more"
    assert told > 40, "none waits for what was withdrawn"
    assert aurora.evaluations >= 60 * N


@pytest.mark.parametrize("make", [CMA(batch_size=10), IsoLine(batch_size=7), Gaussian(0.05, batch_size=50)], ids=repr)
def test_told_in_parts_it_can_be_done_again(make):
    aurora, again = told_at_random(aurora_of(make), 15, 2), aurora_of(make)
    asynchronous.replay(again, TASK, aurora.events)
    assert_array_equal(aurora.archive.genotype, again.archive.genotype)
    assert (aurora.archive.born >= N).any()


def test_workers_that_do_not_wait():
    with evaluate.over(evaluate.processes(2), TASK) as task:
        aurora = aurora_of(CMA(batch_size=8)).run(task, generations=10, asynchronous=True)
    again = aurora_of(CMA(batch_size=8))
    asynchronous.replay(again, TASK, aurora.events)
    assert_array_equal(aurora.archive.genotype, again.archive.genotype)


@pytest.mark.parametrize(
    ("text", "make"),
    [
        ("ribs:cma", CMA()),
        ("ribs:cma:sigma=0.2,ranker=2rd", CMA(0.2, ranker="2rd")),
        ("ribs:iso-line:line_sigma=0.3", IsoLine(line_sigma=0.3)),
        ("ribs:gaussian:batch_size=20", Gaussian(batch_size=20)),
    ],
)
def test_as_a_setting(text, make):
    settings = Settings(emitter=strategy("emitter", text), batch_size=30)
    assert settings.emitter == make
    assert Settings.from_json(settings.as_json()) == settings
    task, aurora = settings.build()
    assert (aurora.run(task, generations=3).archive.born >= 30).any()


def test_from_the_command_line_it_goes_on(tmp_path):
    line = ["run", "ballistic", "-n", 3, "--emitter", "ribs:cma", "--no-figures", "--out", tmp_path / "run"]
    done = commands.cli(*line, warned=True)
    assert done.returncode == 0, done.stderr
    assert "Warning: the state of an emitter of pyribs cannot be saved" in " ".join(done.stderr.split())
    done = commands.cli("resume", tmp_path / "run", "-n", 5, "--no-figures", warned=True)
    assert done.returncode == 0, done.stderr
    assert len(auroraqd.load(tmp_path / "run").history.records) == 5


def test_its_repr_says_what_makes_it():
    assert repr(Ribs(cma)) == "Ribs(make=cma)"
    assert repr(Ribs(Gaussian())) == "Ribs(make=Gaussian(sigma=0.1, batch_size=36))"


def test_without_pyribs_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr("auroraqd.emitters.ribs.find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r'^pyribs is not installed: pip install "auroraqd\[ribs\]"$'):
        Settings(emitter=CMA()).build()


def test_saving_says_that_its_state_is_not_saved(tmp_path):
    aurora = aurora_of(cma).run(TASK, generations=3)
    with pytest.warns(UserWarning, match="the state of an emitter of pyribs cannot be saved"):
        auroraqd.save(aurora, tmp_path / "run")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        auroraqd.save(aurora, tmp_path / "run")  # once is enough
    with pytest.raises(
        ValueError, match=r"with cma as make, which is not of auroraqd: give it again, resume\(\.\.\., emitter="
    ):
        auroraqd.resume(tmp_path / "run")
    again = auroraqd.resume(tmp_path / "run", emitter=Ribs(cma))
    assert again.run(TASK, generations=5).generation == 8


@pytest.mark.filterwarnings("ignore:.* far outside the others")  # it has no seed
def test_the_example_of_the_documentation():
    page = (Path(__file__).parents[1] / "docs" / "reference" / "algorithms.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    found = {}
    exec(code.replace("generations=500", "generations=5"), found)
    assert found["aurora"].generation == 5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda archive, n_genes, seed: Watched(archive, 3, seed), r"solutions of shape \(n, 2\), got \(20, 3\)"),
        (lambda archive, n_genes, seed: object(), "make must give an emitter of pyribs"),
    ],
)
def test_what_make_gives_is_looked_at(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        aurora_of(make).run(TASK, generations=2)
    with pytest.raises(TypeError, match="make must be callable"):
        Ribs("cma")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CMA(sigma=0), "sigma must"),
        (lambda: CMA(batch_size=1), "batch_size must"),
        (lambda: CMA(ranker="best"), "ranker must be one of 2imp"),
        (lambda: CMA(es="ga"), "es must be one of cma_es"),
        (lambda: IsoLine(line_sigma=-1), "line_sigma must"),
        (lambda: Gaussian(0.1, 0), "batch_size must"),
    ],
)
def test_bad_parameters(make, message):
    with pytest.raises(ValueError, match=message):
        make()
