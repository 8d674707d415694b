"""What looked right and was not."""

import copy
import io

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from rich.console import Console
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.archives.base import NEW, REPLACED, Placement
from auroraqd.callbacks.progress import RunProgress
from auroraqd.cli.show import _duration
from auroraqd.descriptors.training import Progress as Training
from auroraqd.runs import state


def robot(genotypes):
    return -genotypes[:, 0], np.cumsum(genotypes[:, :, None], axis=1)


def made(descriptor="genotype", **options):
    return auroraqd.Aurora(3, descriptor, seed=0, batch_size=20, **options)


@pytest.mark.parametrize("stop", [True, np.True_])
def test_a_callback_stops_with_numpys_true_too(stop):
    assert made().run(robot, generations=5, callback=lambda aurora: stop).generation == 1
    assert made().run(robot, generations=2, callback=lambda aurora: aurora).generation == 2


def test_attributes_of_ones_own_are_not_in_the_way(tmp_path):
    aurora = made().run(robot, generations=2)
    assert set(vars(aurora)) == state.FIELDS, "a field of Aurora would not be kept"
    aurora.note = "mine"
    again = auroraqd.resume(auroraqd.save(aurora, tmp_path))
    assert not hasattr(again, "note")
    assert_array_equal(again.archive.genotype, aurora.archive.genotype)


@pytest.mark.parametrize("part", ["selection", "variation"])
def test_a_strategy_that_is_refused_has_used_no_random_numbers(part):
    aurora, twin = (made().run(robot, generations=2) for _ in range(2))
    good = getattr(aurora, part)
    for bad, error in (
        (lambda *arguments: arguments[-1].random(3), ValueError),
        (lambda *a: a[-1].random(3) / None, TypeError),
    ):
        setattr(aurora, part, bad)
        with pytest.raises(error):
            aurora.ask()
    setattr(aurora, part, good)
    assert_array_equal(aurora.run(robot, generations=2).archive.genotype, twin.run(robot, generations=2).archive.genotype)


class Latest(auroraqd.Archive):
    """Keeps all until there are `size`; then the newcomer takes the place of the first, and so on. By the docstring alone."""

    def __init__(self, size):
        super().__init__()
        self.l = "large"  # an attribute of its own
        self.size = size

    def place(self, batch):
        placed = self.next + np.arange(batch.rows)
        status = np.where(placed < self.size, NEW, REPLACED)
        self.next += batch.rows
        return Placement(status, placed % self.size)

    def reindex(self):
        self.next = len(self)

    @property
    def full(self):
        return len(self) == self.size

    @property
    def settings(self):
        return {"size": self.size}


@pytest.mark.filterwarnings("ignore:the archive is full")
def test_a_minimal_archive(tmp_path):
    aurora = made(PCA(2), archive=Latest(70), schedule=auroraqd.Every(2)).run(robot, generations=10)
    assert len(aurora.archive) == 70
    last = aurora.history.last
    assert np.isnan(last.l)
    assert (last.new, last.new + last.replaced + last.rejected + last.invalid) == (70, aurora.evaluations)
    assert aurora.latest[1].status.dtype == np.int8  # whatever whole numbers `place` returned
    folder = auroraqd.save(aurora, tmp_path)
    again = auroraqd.resume(folder, archive=Latest(70))
    twin = copy.deepcopy(aurora)
    for run in (aurora, again, twin):
        run.run(robot, generations=3)
        assert_array_equal(run.archive.genotype, aurora.archive.genotype)
    assert_array_equal(auroraqd.load(folder).descriptor.shape, (70, 2))


def test_of_a_full_archive_the_truth_is_said():
    aurora = made(archive=Latest(50))
    with pytest.warns(
        UserWarning, match=r"the archive is full \(50 individuals\): from now on, one is stored only in another's place"
    ):
        aurora.run(robot, generations=3)
    status = aurora.tell(*robot(aurora.ask()))
    assert_array_equal(status, 2)


@pytest.mark.parametrize("partly", [False, True])
def test_the_nearest_outcome_is_the_nearest(tmp_path, partly):
    """Where several outcomes have one descriptor, or nearly so."""

    def far_apart(genotypes):  # what matters is in 20 channels, and two components see little of them
        return np.random.default_rng(0).permutation(np.tile(genotypes, 7), axis=1)[:, :20] ** np.arange(1, 21)

    auroraqd.save(made(PCA(2)).run(far_apart, generations=10), tmp_path)
    repertoire = auroraqd.load(tmp_path)
    span = np.ptp(repertoire.observation, axis=0) / 2
    given = np.arange(20) < (5 if partly else 20)
    for wanted in far_apart(np.random.default_rng(1).random((10, 3))):
        distance = np.sqrt((((repertoire.observation - wanted) / span)[:, given] ** 2).mean(axis=1))
        found = repertoire.reach(np.where(given, wanted, np.nan), k=3)
        assert_array_equal(found.rows, distance.argsort(kind="stable")[:3])
        np.testing.assert_allclose(found.distance, np.sort(distance)[:3])


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0.00 us"), (3.2e-6, "3.20 us"), (999.999e-6, "1.00 ms"), (0.04698722, "46.99 ms"), (2.5, "2.50 s"), (75, "75.00 s")],
)
def test_durations_are_readable(seconds, text):
    assert _duration(seconds) == text


def test_a_descriptor_says_what_it_is_in_a_line():
    aurora = made(PCA(2)).run(robot, generations=2)
    assert repr(aurora.descriptor) == "Descriptor(PCA(n_components=2, random_state=1826701615), of observations (n, 3, 1))"
    assert aurora.descriptor.transformer.components_.shape == (2, 3)
    for name in ("genotype", "observation"):
        assert made(name).run(robot, generations=1).descriptor.transformer is None
    assert repr(made().descriptor) == "Descriptor('genotype')"


def test_one_number_each_is_refused_in_a_sentence():
    wanted = r"observation must have shape \(n, \.\.\.\), got \(20,\): of one number each, write observation\[:, None\]"
    aurora = made()
    aurora.ask()
    with pytest.raises(ValueError, match=wanted):
        aurora.tell(np.zeros(20), np.zeros(20))
    with pytest.raises(auroraqd.TaskError, match=wanted):
        aurora.run(lambda genotypes: (genotypes[:, 0], genotypes[:, 1]), generations=1)
    assert len(aurora.run(lambda genotypes: (genotypes[:, 0], genotypes[:, 1:2]), generations=1).archive) > 0


def test_several_callbacks_are_all_called():
    seen = []
    first, second = (lambda aurora: seen.append(("first", aurora.generation))), (lambda aurora: aurora.generation == 2)
    assert made().run(robot, generations=5, callback=[second, first]).generation == 2
    assert seen == [("first", 1), ("first", 2)]
    with pytest.raises(TypeError, match="callback must be callable"):
        made().run(robot, generations=5, callback=[first, 3])


def test_until_a_generation():
    aurora = made().run(robot, generations=3)
    assert aurora.run(robot, until_generation=5).generation == 5
    assert aurora.run(robot, until_generation=5).generation == 5
    assert aurora.run(robot, until_generation=4, generations=10).generation == 5
    assert aurora.run(robot, until_generation=9, generations=2).generation == 7
    with pytest.raises(ValueError, match="until_generation must be a whole number"):
        aurora.run(robot, until_generation=2.5)


def test_progress_is_shown_on_standard_error(capsys):
    made().run(robot, generations=3, progress=True)
    made().run(robot, evaluations=50, progress=True)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert [" ".join(line.split()[:2]) for line in shown.err.splitlines()] == ["generation 3/3", "generation 3/3"]
    made().run(robot, seconds=0.01, progress=True)


def test_a_training_is_shown_with_the_generation_that_it_follows():
    console = Console(file=io.StringIO())
    aurora = made()
    progress = RunProgress(console, 9, aurora.evaluations, aurora.generation)
    with progress:
        aurora.run(robot, generations=3, callback=progress)
        progress._next = 0.0
        progress.training(Training(2, 5, 1, 12, 0.25, True))
    assert console.file.getvalue() == "generation 3/9  training 2/5, error 0.2500\n"


def test_a_class_of_transformers_is_none():
    with pytest.raises(TypeError, match=r"with fit and transform, got .*PCA.*, of which one must be made: PCA\(\.\.\.\)"):
        auroraqd.Aurora(8, PCA)
