"""`auroraqd.testing`: what keeps its promises passes, and each promise that is broken is noticed."""

import copy

import numpy as np
import pytest
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA, FastICA, TruncatedSVD
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import auroraqd
from auroraqd.archives import NEW, REPLACED, Archive, Placement
from auroraqd.emitters import Genetic
from auroraqd.testing import check_archive, check_descriptor, check_emitter, check_task


class Recent(Archive):
    """The latest 150: all are placed at once, and the oldest are evicted."""

    def place(self, batch):
        free = len(self) + np.arange(batch.rows)
        return Placement(np.full(batch.rows, NEW, np.int8), free, np.arange(max(len(self) + batch.rows - 150, 0)))


class Latest(Archive):
    """The latest in each cell, with an index, and a column of its own."""

    own = {"mark": np.int64}

    def __init__(self, cells=7):
        super().__init__()
        self.cells, self.index = cells, {}

    @property
    def settings(self):
        return {"cells": self.cells}

    def cell(self, descriptor):
        return tuple((self.cells * descriptor).astype(int).tolist())

    def reindex(self):
        self.index = {self.cell(descriptor): row for row, descriptor in enumerate(self.descriptor)}

    def place(self, batch):
        status, rows = np.full(batch.rows, REPLACED, np.int8), np.empty(batch.rows, int)
        for i, descriptor in enumerate(batch["descriptor"]):
            free = len(self.index)
            rows[i] = self.index.setdefault(self.cell(descriptor), free)
            status[i] = NEW if rows[i] == free else REPLACED
        return Placement(status, rows)


@pytest.mark.parametrize("make", [Recent, Latest, lambda: Latest(cells=4)])
def test_archives_of_ones_own_pass(make):
    check_archive(make, sequential=True)
    check_archive(make)


THE_ONLY_ONE = Latest()


class Mixed(Latest):
    @property
    def genotype(self):
        return super().genotype[::-1]

    @property
    def columns(self):
        held = super().columns
        return held | {"genotype": held["genotype"][::-1]} if len(self) else held


class Open(Latest):
    @property
    def fitness(self):
        return super().fitness.copy()


class WrongRows(Latest):
    def insert(self, batch, valid):
        info = super().insert(batch, valid)
        return info._replace(row=info.row[::-1])


class IdsAgain(Latest):
    def redescribe(self, descriptor, **options):
        staying = super().redescribe(descriptor, **options)
        self._next_id = len(self)
        return staying


class TakesNaN(Latest):
    def insert(self, batch, valid):
        return super().insert(batch, np.ones(batch.rows, bool))


class Moody(Latest):
    def place(self, batch):
        self.cells = np.random.default_rng().integers(5, 50)
        return super().place(batch)


class Hasty(Latest):
    """The first of a batch in each cell takes it, and not the last."""

    def place(self, batch):
        placement, taken = super().place(batch), set()
        for i, row in enumerate(placement.row):
            if row in taken:
                placement.status[i], placement.row[i] = 0, -1
            taken.add(row)
        return placement


class Forgetful(Latest):
    def redescribe(self, descriptor, **options):
        staying = super().redescribe(descriptor, **options)
        if len(self):
            self._population.raw("curiosity")[:] = 0
        return staying


class Stubborn(Latest):
    def redescribe(self, descriptor, *, least=0, **options):
        return super().redescribe(descriptor, **options)


class Silent(Latest):
    def add(self, *args, **options):
        try:
            return super().add(*args, **options)
        except ValueError:
            return np.zeros(0, np.int8)


class Stale(Latest):
    def reindex(self):
        if len(self) == 0 or len(self.index) < len(self):
            super().reindex()


class Unsettled(Latest):
    @property
    def settings(self):
        return {}


class Entangled(Latest):
    def __deepcopy__(self, memo):
        return copy.copy(self)


class Ungrateful(Latest):
    def credit(self, parent_ids, status):
        pass


class Swapped(Latest):
    def redescribe(self, descriptor, **options):
        staying = super().redescribe(descriptor, **options)
        if len(self):
            self.writable("mark")[:] = self.writable("mark")[::-1].copy()
        return staying


class Raises(Latest):
    def place(self, batch):
        raise KeyError("cell")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: THE_ONLY_ONE,
            "Latest does not keep the promise that each archive that is made is empty, .*: a second one holds",
        ),
        (Mixed, "Mixed .* row i of all columns is one individual, as it was added: genotype is of other individuals"),
        (Open, "Open .* columns are read-only: fitness can be written"),
        (WrongRows, "WrongRows .* what has become of a batch: in the row that is told for an individual there is another"),
        (IdsAgain, r"IdsAgain .* an id is never given twice: id \d+ was given to two individuals"),
        (TakesNaN, "TakesNaN .* with a NaN or an infinity are invalid, .*: not those, and only those, of which the fitness"),
        (Moody, "Moody .* the same individuals lead to the same archive: "),
        (Hasty, "Hasty .* a batch is placed as if each met .*: individual .* was given status"),
        (Forgetful, "Forgetful .* redescribe gives new descriptors, .*: the curiosity of an individual has changed"),
        (Stubborn, "Stubborn .* redescribe leaves all as it is where fewer would stay than must: column .* differs"),
        (Silent, "Silent .* arguments of a wrong shape are refused by a ValueError, .*: fitness of another length were taken"),
        (Stale, "Stale .* a placement that makes no sense, .* leaves it as it was, by reindex: "),
        (lambda: Unsettled(4), "Unsettled .* its settings, constants, columns and state are all that it is, "),
        (Entangled, "Entangled .* a deep copy is the same, and what happens to one does not touch the other: "),
        (Ungrateful, "Ungrateful .* credit changes the curiosity of the parents that are stored, .*: it became "),
        (
            Swapped,
            "Swapped .* columns of its own .* go where their individuals go: mark is of other .* when it was redescribed",
        ),
        (Raises, "Raises .* each archive that is made is empty, .*: it raised KeyError: 'cell'"),
        (lambda: [], "list .* each archive that is made is empty, .*: got \\[\\], no Archive"),
    ],
)
def test_a_broken_promise_of_an_archive_is_noticed(make, message):
    with pytest.raises(AssertionError, match=message) as seen:
        check_archive(make, sequential=True)
    assert "\n" not in str(seen.value)


class Learns:
    """Remembers how well it does, and begins by itself."""

    starts = True

    def __init__(self, n_genes):
        self.n_genes, self.sigma, self.center = n_genes, 0.1, np.full(n_genes, 0.5)

    def ask(self, archive, n, rng):
        return np.clip(rng.normal(self.center, self.sigma, (n, self.n_genes)), 0, 1), np.full(n, -1)

    def tell(self, archive, batch, info):
        fitness = np.nan_to_num(batch["fitness"], nan=-np.inf)
        if np.isfinite(fitness).any():
            self.center = batch["genotype"][fitness.argmax()]
        self.sigma *= 1.1 if (info.status > 0).mean() > 0.2 else 0.9

    def state(self):
        return {"sigma": self.sigma, "center": self.center}

    def restore(self, state):
        self.sigma, self.center = state["sigma"], state["center"]


@pytest.mark.parametrize("n_genes", [2, 5])
def test_emitters_pass(n_genes):
    check_emitter(Learns(n_genes), n_genes=n_genes)
    check_emitter(Genetic(), n_genes=n_genes)
    check_emitter(Genetic(auroraqd.Uniform(), auroraqd.IsoLine()), n_genes=n_genes)


class TooWide(Learns):
    def ask(self, archive, n, rng):
        return 3 * rng.random((n, self.n_genes)), np.full(n, -1)


class Stranger(Learns):
    def ask(self, archive, n, rng):
        return rng.random((n, self.n_genes)), np.full(n, 10**6)


class NeedsSome(Learns):
    def ask(self, archive, n, rng):
        return archive.genotype[rng.integers(len(archive), size=n)], np.full(n, -1)


class Vandal(Learns):
    def ask(self, archive, n, rng):
        archive.credit(archive.id[:1], np.ones(len(archive.id[:1]), int))
        return super().ask(archive, n, rng)


class OwnChance(Learns):
    def ask(self, archive, n, rng):
        return super().ask(archive, n, np.random.default_rng())


class Poisoned(Learns):
    def tell(self, archive, batch, info):
        if np.isnan(batch["fitness"]).all():
            raise ValueError("nobody is left")


class NoState(Learns):
    state = restore = None

    def __getattribute__(self, name):
        if name in ("state", "restore"):
            raise AttributeError(name)
        return super().__getattribute__(name)


class NoTuple(Learns):
    def ask(self, archive, n, rng):
        return rng.random((n, self.n_genes))


@pytest.mark.parametrize(
    ("emitter", "message"),
    [
        (TooWide, r"TooWide .* ask gives n genotypes in \[0, 1\] .*: genotypes are float64 from 0\.\d+ to "),
        (Stranger, "Stranger .* and n parents that are stored, or -1: .*1000000.* no ids of individuals stored"),
        (NeedsSome, "NeedsSome .* a true attribute starts makes genotypes also while nothing is stored: it raised ValueError"),
        (Vandal, "Vandal .* it does not change the archive: curiosity of the archive has changed"),
        (OwnChance, "OwnChance .* all that is random comes from the generator .*: the genotypes of two with one seed differ"),
        (Poisoned, "Poisoned .* tell takes a batch of which some, or all, are invalid: it raised ValueError: nobody is left"),
        (NoState, "NoState .* carry all that it remembers .*: the genotypes of it and of one restored from its state differ"),
        (NoTuple, "NoTuple .* ask gives n genotypes .*: ask returned .*, and not genotypes and their parents"),
    ],
)
def test_a_broken_promise_of_an_emitter_is_noticed(emitter, message):
    with pytest.raises(AssertionError, match=message):
        check_emitter(emitter(3), n_genes=3)


class Ends:
    """Of one's own, without state."""

    def fit(self, x):
        self.mean = x.mean(axis=0)
        return self

    def transform(self, x):
        return (x - self.mean)[:, :2]


class Reads(Ends):
    natural_shape = True

    def fit(self, x, y):
        assert x.shape[1:] == (6, 2)
        assert y.shape == (len(x),)
        self.mean = y.mean()
        return self

    def transform(self, x):
        return x.mean(axis=1)


@pytest.mark.parametrize(
    "transformer",
    [
        PCA(2),
        TruncatedSVD(2),
        FastICA(2),
        PLSRegression(n_components=2),
        LinearDiscriminantAnalysis(n_components=2),
        make_pipeline(StandardScaler(), PCA(3)),
        Ends(),
        Reads(),
        auroraqd.AutoEncoder(2, hidden=(8,), max_epochs=5, repeats=1),
    ],
    ids=lambda transformer: type(transformer).__name__,
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_descriptors_pass(transformer):
    check_descriptor(transformer)


class GivesNaN(Ends):
    def transform(self, x):
        return x[:, :2] / np.where(np.arange(len(x)) == 3, np.nan, 1)[:, None]


class Overwrites(Ends):
    def transform(self, x):
        x -= self.mean
        return x[:, :2].copy()


class Rolls(Ends):
    def fit(self, x):
        self.mean = x[np.random.default_rng().integers(len(x))]
        return self


class Relative(Ends):
    def transform(self, x):
        return (x - x.mean(axis=0) + (len(x) == 1))[:, :2]


class Common(Ends):
    def fit(self, x):
        Common.mean = x.mean(axis=0)
        return self


class NoWayBack(Ends):
    def inverse_transform(self, z):
        return np.full((len(z), 12), np.nan)


class Clings(Ends):
    def fit(self, x):
        self.mean, self.function = x.mean(axis=0), lambda: 0
        return self


class Fails(Ends):
    def fit(self, x):
        raise RuntimeError("no convergence")


@pytest.mark.parametrize(
    ("transformer", "message"),
    [
        (GivesNaN, "GivesNaN .* gives each finite numbers, one at least: there is a NaN"),
        (Overwrites, "Overwrites .* it does not change what it is given: the observations have changed"),
        (Rolls, "Rolls .* the same observations give the same descriptor, .*: two that were fitted on the same differ"),
        (Relative, "Relative .* is described the same whatever others are in the batch: alone it differs by"),
        (Common, "Common .* fitted on other observations leaves the old one as it was: the old one describes otherwise"),
        (NoWayBack, "NoWayBack .* gives finite observations from descriptors: it gave shape"),
        (Clings, "Clings .* it can be saved and loaded, and describes the same again: it raised "),
        (
            Fails,
            "Fails .* fitted on observations, it gives .*: it raised DescriptorError: Fails could .* no convergence",
        ),
    ],
)
def test_a_broken_promise_of_a_descriptor_is_noticed(transformer, message):
    with pytest.raises(AssertionError, match=message):
        check_descriptor(transformer())


# Tasks


def arm(genotypes):
    return np.cumsum(np.stack([np.cos(genotypes), np.sin(genotypes)], axis=2), axis=1)


def windy(genotypes, seeds):
    return arm(genotypes) + np.array([np.random.default_rng(seed).normal(size=2) for seed in seeds])[:, None]


windy.seeded = True
windy.n_genes = 3


def with_streams(genotypes):
    camera = np.zeros((len(genotypes), 4, 4), np.uint8)
    camera[:, 0, 0] = 255 * genotypes[:, 0]
    fitness = np.where(genotypes[:, 1] < 0.3, np.nan, 0.0)
    return fitness, {"joints": genotypes * 2, "fitness": camera}, np.full((len(genotypes), 1), np.inf)


def test_tasks_pass():
    for task in (auroraqd.tasks.Ballistic(), auroraqd.tasks.AirHockey(), windy, auroraqd.tasks.repeated(windy, 2)):
        check_task(task)
    check_task(arm, n_genes=4)
    check_task(with_streams, n_genes=2)
    check_task(auroraqd.tasks.each(lambda genotype: genotype**2), n_genes=2)


def says_three(genotypes):
    return genotypes**2


says_three.n_genes = 3
says_three.genes = auroraqd.tasks.Genes(left=(0, 1), right=(0, 1))
kept = np.empty((20, 2))


def into_one_buffer(genotypes):
    kept[: len(genotypes)] = genotypes[:, :2]
    return kept[: len(genotypes)]


def in_place(genotypes):
    genotypes *= 2
    return genotypes - 1


def squeezed(genotypes):
    return genotypes[:, 0], np.squeeze(genotypes[:, :2, None] * np.ones(len(genotypes)))


def not_at_zero(genotypes):
    return 1 / genotypes if genotypes.all() else [][0]


BROKEN_TASKS = [
    (says_three, "that n_genes and genes, if it has them, speak of as many genes: 2 and 3"),
    (lambda g: g[:1], "that it returns a row for each genotype.*: it raised TaskError: .*must have 2 rows"),
    (lambda g: (g[:, 0],), "that it returns a row for each genotype.*: it raised TaskError: .*must return a tuple"),
    (lambda g: g.astype(np.float32 if len(g) > 1 else np.float64), "of the same shape and dtype.*float64.*float32"),
    (squeezed, "of the same shape and dtype"),
    (not_at_zero, "that it evaluates the lowest and the highest genotypes"),
    (in_place, "that it does not change the genotypes"),
    (into_one_buffer, "that what it has returned does not change when it is called again"),
    (lambda g: g + np.random.default_rng().random(), "that one genotype does the same each time"),
    (lambda g: g - g.mean(axis=0), "that a genotype does the same whatever others are in the batch.*alone"),
    (lambda g: (g[:, 0] + len(g), g), "the fitness differs alone"),
    (lambda g: 0 * g, "all observations are the same"),
    (lambda g: np.nan * g, "0 of 400 are valid"),
    (lambda g: (np.nan * g[:, 0], g), "0 of 400 are valid"),
]


@pytest.mark.parametrize(("task", "broken"), BROKEN_TASKS)
def test_each_broken_promise_of_a_task_is_noticed(task, broken):
    with pytest.raises(AssertionError, match=broken):
        check_task(task, **({} if task is says_three else {"n_genes": 3}))


def test_a_task_that_is_seldom_valid_keeps_its_promises():
    check_task(lambda g: np.where(g[:, :1] < 0.05, g, np.nan), n_genes=3)


def test_what_is_asked_of_tasks_is_said():
    with pytest.raises(TypeError, match="task must be callable, an instance and not a class"):
        check_task(auroraqd.tasks.Ballistic)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="n_genes must be given for a task that does not say it"):
        check_task(arm)
    with pytest.raises(ValueError, match="n_genes must be a whole number, 1 or more, got 0"):
        check_task(arm, n_genes=0)
