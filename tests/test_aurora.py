"""The loop: ask, tell, run."""

import copy
import signal
import threading
import time

import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA, KernelPCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import auroraqd
from auroraqd import Aurora, TaskError

COLUMNS = ("genotype", "fitness", "observation", "descriptor", "curiosity", "id")


def circle(genotypes):
    """A user's own task: a plain function."""
    angle = 2 * np.pi * genotypes[:, 0]
    radius = genotypes[:, 1]
    steps = np.linspace(0, 1, 5)[:, None, None]
    observation = (steps * (radius * np.array([np.cos(angle), np.sin(angle)])).T).transpose(1, 0, 2)
    return -radius, observation


def circle_of_three(genotypes):
    return np.hstack([genotypes, genotypes[:, :1] * genotypes[:, 1:]])


def state(aurora):
    return {name: getattr(aurora.archive, name).copy() for name in COLUMNS}


def assert_same(a, b):
    for name, values in state(a).items():
        assert_array_equal(values, getattr(b.archive, name), err_msg=name)
    assert [r._replace(seconds=0) for r in a.history.records] == [r._replace(seconds=0) for r in b.history.records]
    assert_array_equal(a.ask(), b.ask())


@pytest.fixture
def ballistic():
    return auroraqd.tasks.Ballistic()


def test_five_lines():
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0)
    aurora.run(task, generations=20)
    assert len(aurora.archive) > 1000
    assert aurora.archive.descriptor.shape == (len(aurora.archive), 2)


def test_a_plain_function_and_its_own_shape():
    aurora = Aurora(2, PCA(n_components=1), seed=0, batch_size=50).run(circle, generations=30)
    assert aurora.archive.observation.shape == (len(aurora.archive), 5, 2)
    assert aurora.archive.ground_truth is None
    assert aurora.evaluations == 1500


def test_ask_tell_is_run(ballistic):
    by_run = Aurora(2, PCA(n_components=2), seed=3).run(ballistic, generations=60)
    by_hand = Aurora(2, PCA(n_components=2), seed=3)
    for _ in range(60):
        status = by_hand.tell(*ballistic(by_hand.ask()))
        assert status.shape == (200,)
    assert_same(by_run, by_hand)


@pytest.mark.parametrize("descriptor", [PCA(n_components=2), "hand-coded", "genotype"], ids=str)
def test_a_seed_reproduces_a_run_bit_for_bit(ballistic, descriptor):
    assert_same(*(Aurora(2, descriptor, seed=7).run(ballistic, generations=60) for _ in range(2)))


def test_seeds_differ(ballistic):
    one, two = (Aurora(2, "genotype", seed=seed).run(ballistic, generations=2) for seed in (1, 2))
    assert one.archive.genotype.tolist() != two.archive.genotype.tolist()


def test_an_estimator_without_a_seed_gets_one(ballistic):
    pca = PCA(n_components=2, svd_solver="randomized")
    assert_same(*(Aurora(2, pca, seed=7).run(ballistic, generations=3) for _ in range(2)))
    assert pca.random_state is None  # the user's object is not touched
    assert not hasattr(pca, "components_")


def test_run_goes_on(ballistic):
    at_once = Aurora(2, PCA(n_components=2), seed=0).run(ballistic, generations=60)
    in_parts = Aurora(2, PCA(n_components=2), seed=0)
    for generations in (1, 49, 10):
        in_parts.run(ballistic, generations=generations)
    assert_same(at_once, in_parts)


def test_an_unmutated_copy_never_replaces_its_parent(ballistic):
    """Rounding in batches of different sizes must not make a copy look more novel, also over refits."""
    aurora = Aurora(2, PCA(n_components=2), seed=0, variation=lambda parents, rng: parents.copy())
    aurora.run(ballistic, generations=1)
    stored, first = set(aurora.archive.id.tolist()), aurora.history.last
    aurora.run(ballistic, generations=160)
    last = aurora.history.last
    assert set(aurora.archive.id.tolist()) <= stored
    assert (last.new, last.replaced) == (first.new, first.replaced)
    assert last.rejected > 30_000


def test_updates_follow_the_schedule(ballistic):
    aurora = Aurora(2, PCA(n_components=2), seed=0, schedule=auroraqd.Every(10))
    components = []
    aurora.run(ballistic, generations=31, callback=lambda run: components.append(run.descriptor.source.components_.copy()))
    changed = [g for g in range(1, 31) if not np.array_equal(components[g], components[g - 1])]
    assert changed == [10, 20, 30]


def test_after_an_update_all_are_described_anew(ballistic):
    aurora = Aurora(2, PCA(n_components=2), seed=0).run(ballistic, generations=51)
    archive = aurora.archive
    x = archive.observation
    scaling = aurora.descriptor.scaling
    scaled = ((x - scaling.low) / (scaling.high - scaling.low) * 2 - 1).reshape(len(x), -1)
    pca = aurora.descriptor.source
    assert_allclose(archive.descriptor, pca.transform(scaled), atol=1e-9)
    error = np.sqrt(((pca.inverse_transform(pca.transform(scaled)) - scaled) ** 2).mean(axis=1))
    assert_allclose(archive.reconstruction_error, error, atol=1e-9)
    assert_allclose(aurora.history.last.rmse, error.mean(), atol=1e-9)
    assert_allclose(aurora.describe(x[:7]), archive.descriptor[:7], atol=1e-9)


def test_a_whole_generation_by_hand(ballistic):
    """Generation 0: fit on the first batch, l from it, then the addition rule."""
    aurora = Aurora(2, "hand-coded", seed=0)
    genotypes = aurora.ask()
    fitness, observation, truth = ballistic(genotypes)
    status = aurora.tell(fitness, observation, truth)
    valid = np.isfinite(fitness)
    l = naive.largest_distance(truth[valid]) / np.sqrt(60000)
    assert_allclose(aurora.archive.l, l)
    twin = naive.UnstructuredArchive(aurora.archive.l)
    assert_array_equal(status[valid], twin.add(truth[valid], fitness[valid]))
    assert_array_equal(status[~valid], -1)


def test_curiosity_follows_the_offspring(ballistic):
    aurora = Aurora(2, "hand-coded", seed=0).run(ballistic, generations=1)
    parents = {}

    class Remembering:
        def __call__(self, archive, n, rng):
            rows = auroraqd.Uniform()(archive, n, rng)
            parents["id"] = archive.id[rows]
            return rows

    aurora.selection = Remembering()
    before = dict(zip(aurora.archive.id.tolist(), aurora.archive.curiosity.tolist(), strict=True))
    status = aurora.tell(*ballistic(aurora.ask()))
    for identity, curiosity in zip(aurora.archive.id.tolist(), aurora.archive.curiosity.tolist(), strict=True):
        children = status[parents["id"] == identity]
        expected = before.get(identity, 0) + np.where(children > 0, 1, -0.5).sum()
        assert curiosity == expected
    assert (status == -1).any() or (status == 0).any()


def test_iso_line_gets_pairs(ballistic):
    aurora = Aurora(2, "hand-coded", seed=0, variation=auroraqd.IsoLine()).run(ballistic, generations=20)
    assert len(aurora.archive) > 500


def test_budgets(ballistic):
    aurora = Aurora(2, "genotype", seed=0)
    aurora.run(ballistic, evaluations=900)
    assert aurora.evaluations == 1000  # whole generations
    aurora.run(ballistic, generations=10**9, seconds=0.2)
    assert aurora.generation > 5
    done = aurora.generation
    aurora.run(ballistic, generations=0)
    assert aurora.generation == done
    aurora.run(ballistic, generations=10, callback=lambda run: run.generation == done + 4)
    assert aurora.generation == done + 4
    with pytest.raises(ValueError, match="budget"):
        aurora.run(ballistic)
    with pytest.raises(ValueError, match="generations must be a whole number, 0 or more"):
        aurora.run(ballistic, generations=-1)
    with pytest.raises(ValueError, match="generations must be a whole number"):
        aurora.run(ballistic, generations=2.5)
    with pytest.raises(TypeError, match="callback must be"):
        aurora.run(ballistic, generations=1, callback=3)


def test_known_controllers_come_first(ballistic):
    known = np.array([[0.25, 0.75], [0.5, 0.5]])
    seen = []
    aurora = Aurora(2, "hand-coded", seed=0, batch_size=10)
    aurora.run(lambda g: seen.append(g) or ballistic(g), generations=2, initial=known)
    assert_array_equal(seen[0][:2], known)
    assert [len(batch) for batch in seen] == [10, 10]
    aurora.run(lambda g: seen.append(g) or ballistic(g), generations=1, initial=known)
    assert_array_equal(seen[2], known)
    assert aurora.evaluations == 22
    with pytest.raises(ValueError, match=r"initial must be in \[0, 1\]"):
        aurora.run(ballistic, generations=1, initial=known * 2)
    with pytest.raises(ValueError, match="initial must have shape"):
        aurora.run(ballistic, generations=1, initial=known[0])


def test_an_inverse_transform_that_may_not_be_called():
    """KernelPCA has the method whatever its settings."""
    aurora = Aurora(2, KernelPCA(n_components=2, kernel="rbf"), seed=0, batch_size=30).run(circle, generations=3)
    assert aurora.archive.reconstruction_error is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fit": lambda self, x: 1 / 0}, "Odd could not be fitted on observations of shape .200, 10.: division by zero"),
        ({"transform": lambda self, x: 1 / 0}, "the transform of Odd raised ZeroDivisionError"),
        ({"transform": lambda self, x: x[:, 0]}, r"the transform of Odd must return shape \(200, descriptor dimensions\)"),
        ({"transform": lambda self, x: x[:5, :2]}, "must return shape"),
        ({"transform": lambda self, x: x[:, :2] * np.inf}, "gave a NaN or an infinity"),
    ],
)
def test_a_descriptor_that_misbehaves_is_named(change, message):
    """A first fit is tried again with the next batch, ten times."""
    aurora = Aurora(2, type("Odd", (Summary,), change)(), seed=0, batch_size=200)
    with np.errstate(invalid="ignore"):
        with pytest.warns(UserWarning, match=f"no update of the descriptor at generation 0: .*{message}.*individuals wait"):
            aurora.run(circle, generations=1)
        again = pytest.raises(auroraqd.DescriptorError, match="it was tried 10 times before")
        with pytest.warns(UserWarning, match="individuals wait"), again:
            aurora.run(circle, generations=20)
    assert len(aurora.archive) == 0
    assert aurora.generation == 10
    assert aurora.history.last.refused == 10
    assert aurora.pending is not None


def test_a_drawn_seed_is_remembered(ballistic):
    drawn = Aurora(2, "genotype").run(ballistic, generations=2)
    assert_same(drawn, Aurora(2, "genotype", seed=drawn.seed).run(ballistic, generations=2))


@pytest.mark.parametrize("batch_size", [1, 2, 3])
def test_small_batches_wait_for_the_first_fit(batch_size):
    """A robot that tries one controller at a time: PCA(2) needs three observations."""
    aurora = Aurora(2, PCA(n_components=2), seed=0, batch_size=batch_size).run(circle, generations=2)
    assert len(aurora.archive) == (0 if batch_size == 1 else aurora.history.last.new)
    aurora.run(circle, generations=30)
    last = aurora.history.last
    assert last.new + last.replaced + last.rejected + last.invalid == aurora.evaluations == 32 * batch_size
    assert len(aurora.archive) > 2


def test_prior_data_fit_once(ballistic):
    _, prior, _ = ballistic(np.random.default_rng(0).random((500, 2)))
    aurora = Aurora(2, PCA(n_components=2), seed=0, prior=prior)
    before = aurora.descriptor.source.components_.copy()
    aurora.run(ballistic, generations=51)
    assert_array_equal(aurora.descriptor.source.components_, before)
    assert len({record.l for record in aurora.history.records}) == 2  # l is redefined all the same
    with pytest.raises(ValueError, match="prior"):
        Aurora(2, "genotype", prior=prior)


def test_never_keeps_l(ballistic):
    archive = auroraqd.UnstructuredArchive(l=0.1)
    aurora = Aurora(2, "genotype", seed=0, archive=archive, schedule=auroraqd.Never()).run(ballistic, generations=20)
    assert aurora.archive.l == 0.1


def test_folding_a_pipeline_changes_nothing(ballistic):
    """An affine chain becomes one matrix; its answers stay those of the estimator."""
    observation = ballistic(np.random.default_rng(0).random((300, 2)))[1]
    chain = make_pipeline(StandardScaler(), PCA(n_components=3, whiten=True))
    aurora = Aurora(2, chain, seed=0).run(ballistic, generations=1)
    descriptor = aurora.descriptor
    x = descriptor.scaler(observation)
    assert_allclose(aurora.describe(observation), descriptor.source.transform(x), atol=1e-9)
    assert descriptor.affine is not None
    assert_allclose(descriptor.decode(x[:, :3]), descriptor.source.inverse_transform(x[:, :3]), atol=1e-9)


class Summary:
    """A descriptor of a user's own, without inverse_transform."""

    def fit(self, x):
        self.center = x.mean(axis=0)
        return self

    def transform(self, x):
        return (x - self.center)[:, -2:]


def test_any_object_with_fit_and_transform():
    aurora = Aurora(2, Summary(), seed=0).run(circle, generations=10)
    assert aurora.archive.reconstruction_error is None
    assert np.isnan(aurora.history.last.rmse)


def test_images_stay_uint8():
    def images(genotypes):
        picture = np.outer(np.arange(8), np.arange(8))[None, :, :, None] * genotypes[:, :1, None, None]
        return np.zeros(len(genotypes)), np.repeat(picture, 3, axis=3).astype(np.uint8)

    aurora = Aurora(2, PCA(n_components=2), seed=0, batch_size=20).run(images, generations=5)
    assert aurora.archive.observation.dtype == np.uint8
    assert aurora.archive.observation.shape[1:] == (8, 8, 3)


def test_of_observations_that_are_all_the_same_nothing_can_be_learned():
    aurora = Aurora(2, PCA(n_components=2), seed=0)
    with pytest.warns(UserWarning, match="all 200 observations are the same, so there is nothing to learn a descriptor from"):
        aurora.run(lambda g: np.ones((len(g), 3)), generations=1)
    aurora.run(circle_of_three, generations=3)
    assert len(aurora.archive) > 100
    assert 1 in (aurora.archive.observation == 1).all(axis=1)  # those that waited are there


def test_invalid_rows_are_counted_and_debited(ballistic):
    def crashing(genotypes):
        fitness, observation, truth = ballistic(genotypes)
        observation[::4] = np.nan
        return fitness, observation, truth

    aurora = Aurora(2, PCA(n_components=2), seed=0).run(crashing, generations=5)
    assert aurora.history.last.invalid >= 250
    assert np.isfinite(aurora.archive.observation).all()
    assert aurora.archive.curiosity.min() < 0


def test_a_task_that_never_works():
    broken = named(lambda g: (np.full(len(g), np.nan), np.ones((len(g), 3))))
    for descriptor in (PCA(n_components=2), "genotype"):
        with pytest.raises(TaskError, match=r"task circle gave no valid individual in 10 generations"):
            Aurora(2, descriptor).run(broken, generations=20)


def test_a_short_run_without_a_valid_individual_says_so_at_its_end():
    broken = named(lambda g: (np.full(len(g), np.nan), np.ones((len(g), 3))))
    aurora = Aurora(2, PCA(n_components=2))
    with pytest.warns(UserWarning, match="^task circle gave no valid individual in 5 generations: .* all 1000 eval") as said:
        aurora.run(broken, generations=5)
    assert len(said) == 1
    aurora.run(broken, generations=0)  # nothing new


def named(function):
    function.__name__ = "circle"
    return function


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (lambda g: np.zeros(len(g)), r"of shape \(5,\): observations of one number each are observation\[:, None\]"),
        (lambda g: {"fitness": np.zeros(len(g)), "observation": g}, "a dictionary is an observation of several streams"),
        (lambda g: None, "got NoneType"),
        (lambda g: (np.zeros(len(g)),), "got tuple of 1"),
        (lambda g: (np.zeros(3), np.zeros((len(g), 2))), r"fitness must have 5 rows, one for each genotype, got shape \(3,\)"),
        (lambda g: (np.zeros((5, 1)), np.zeros((5, 2))), r"fitness must have shape \(5,\), got \(5, 1\)"),
        (lambda g: (np.zeros(5), np.zeros((4, 2))), "observation must have 5 rows"),
        (lambda g: (np.zeros(5), np.zeros((5, 0))), "observation must have entries"),
        (lambda g: (np.zeros(5), [[1], [1, 2], [1], [1], [1]]), "observation must be numbers with rows of one shape, got"),
        (lambda g: (np.zeros(5), np.array(list("abcde"))), "observation must be numbers"),
        (lambda g: (np.zeros(5), np.zeros((5, 2)), 1.0), "ground_truth must have 5 rows"),
        (lambda g: 1 / 0, "raised ZeroDivisionError: division by zero"),
    ],
)
def test_bad_tasks_get_a_clear_error_and_lose_nothing(result, message):
    aurora = Aurora(2, PCA(n_components=2), seed=0, batch_size=5).run(circle, generations=3)
    before = state(aurora)
    with pytest.raises(TaskError, match=message) as error:
        aurora.run(named(result), generations=1)
    assert str(error.value).startswith("task circle at generation 3")
    for name, values in before.items():
        assert_array_equal(values, getattr(aurora.archive, name))
    undisturbed = Aurora(2, PCA(n_components=2), seed=0, batch_size=5).run(circle, generations=6)
    assert_same(aurora.run(circle, generations=3), undisturbed)


def test_a_shape_that_changes_midway():
    aurora = Aurora(2, PCA(n_components=2), seed=0, batch_size=5).run(circle, generations=3)
    with pytest.raises(TaskError, match=r"observation must have shape \(n, 5, 2\), as before, got \(5, 4, 2\)"):
        aurora.run(lambda g: (np.zeros(len(g)), np.zeros((len(g), 4, 2))), generations=1)
    with pytest.raises(TaskError, match="ground_truth must be given for every generation or for none"):
        aurora.run(lambda g: (*circle(g), np.zeros((len(g), 2))), generations=1)


def test_call_order_and_told_shapes(ballistic):
    aurora = Aurora(2, PCA(n_components=2), seed=0)
    with pytest.raises(RuntimeError, match="tell was called before ask"):
        aurora.tell(np.zeros(200), np.zeros((200, 50, 2)))
    genotypes = aurora.ask()
    with pytest.raises(RuntimeError, match="ask was called twice"):
        aurora.ask()
    with pytest.raises(ValueError, match="fitness must have 200 rows"):
        aurora.tell(np.zeros(199), np.zeros((200, 50, 2)))
    aurora.tell(*ballistic(genotypes))
    assert_same(aurora, Aurora(2, PCA(n_components=2), seed=0).run(ballistic, generations=1))


def test_hand_coded_needs_a_ground_truth():
    with pytest.raises(auroraqd.DescriptorError, match="the task gives none"):
        Aurora(2, "hand-coded", seed=0).run(circle, generations=1)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"n_genes": 0}, ValueError, "n_genes must be"),
        ({"n_genes": 2.5}, ValueError, "n_genes must be"),
        ({"batch_size": 0}, ValueError, "batch_size must be"),
        (
            {"descriptor": "pca"},
            ValueError,
            "descriptor must be one of hand-coded, genotype, observation, or a transformer, got 'pca'",
        ),
        ({"descriptor": PCA}, TypeError, "descriptor must be"),
        ({"descriptor": 3}, TypeError, "descriptor must be"),
        ({"selection": auroraqd.Uniform}, TypeError, "selection must be callable, an instance"),
        ({"variation": 1}, TypeError, "variation must be"),
        ({"archive": []}, TypeError, "archive must be"),
    ],
)
def test_bad_arguments(arguments, error, message):
    with pytest.raises(error, match=message):
        Aurora(**{"n_genes": 2, "descriptor": "genotype", **arguments})


def test_bad_arguments_of_methods(ballistic):
    aurora = Aurora(2, PCA(n_components=2), seed=0).run(ballistic, generations=2)
    for observation in ("x", 3, [[1, 2], [3]], np.zeros((2, 7)), np.full((1, 50, 2), np.nan)):
        with pytest.raises(ValueError, match="observation must"):
            aurora.describe(observation)
    for descriptor in ("x", [0, 0], None):
        with pytest.raises(ValueError, match="descriptor must"):
            aurora.reconstruct(descriptor)
    with pytest.raises(ValueError, match=r"descriptor must have shape \(n, 2\), as those in the archive, got \(1, 3\)"):
        aurora.reconstruct([[0, 0, 0]])
    with pytest.raises(TypeError, match="task must be callable"):
        aurora.run(3, generations=1)


def test_ctrl_c_loses_nothing(ballistic):
    """Interrupted at any moment, a run goes on as if nothing had happened."""
    undisturbed = Aurora(2, PCA(n_components=2), seed=0).run(ballistic, generations=120)
    aurora = Aurora(2, PCA(n_components=2), seed=0)
    rng = np.random.default_rng(0)
    interrupted = 0
    while aurora.generation < 120:
        longest = 0.02 * 1.05**interrupted  # an update that takes longer would never be done
        timer = threading.Timer(rng.uniform(0.001, longest), signal.raise_signal, [signal.SIGINT])
        try:
            timer.start()
            aurora.run(ballistic, generations=120 - aurora.generation)
            timer.join()
            time.sleep(0.05)  # let a late signal arrive here
        except KeyboardInterrupt:
            interrupted += 1
    assert interrupted > 3
    assert_same(aurora, undisturbed)


def test_a_full_archive_is_told_once(ballistic):
    aurora = Aurora(2, "genotype", seed=0, archive=auroraqd.UnstructuredArchive(capacity=300))
    with pytest.warns(UserWarning, match="the archive is full") as warned:
        aurora.run(ballistic, generations=10)
    assert len(warned) == 1
    assert len(aurora.archive) == 300
    assert aurora.generation == 10


def test_l_may_change_between_ask_and_tell(ballistic):
    aurora = Aurora(2, "genotype", seed=0).run(ballistic, generations=30)
    genotypes = aurora.ask()
    aurora.archive.l *= 5
    aurora.tell(*ballistic(genotypes))
    assert aurora.generation == 31
    assert np.count_nonzero(aurora.archive.curiosity) > 0


@pytest.mark.parametrize("transformer", [PCA(n_components=np.int64(3)), make_pipeline(StandardScaler(), PCA(n_components=3))])
def test_components_are_found_where_they_are(transformer):
    with pytest.warns(UserWarning, match=r"has no spread in dimension 3"):  # of a circle of this radius there are two
        aurora = Aurora(2, transformer, seed=0, batch_size=2).run(circle, generations=5)
    assert aurora.archive.descriptor.shape[1] == 3


def test_waiting_individuals_are_kept_apart_from_the_users_arrays():
    buffer = np.empty((1, 4))
    aurora = Aurora(2, PCA(n_components=2), seed=0, batch_size=1)
    for _ in range(5):
        genotypes = aurora.ask()
        buffer[:] = [*genotypes[0], *genotypes[0] ** 2]
        aurora.tell(np.zeros(1), buffer)
    assert_array_equal(aurora.archive.observation[:, :2], aurora.archive.genotype)


def test_a_nan_in_the_ground_truth_is_one_invalid_individual(ballistic):
    def lost(genotypes):
        fitness, observation, truth = ballistic(genotypes)
        truth[3] = np.nan
        return fitness, observation, truth

    aurora = Aurora(2, "hand-coded", seed=0).run(lost, generations=3)
    assert np.isfinite(aurora.archive.ground_truth).all()
    assert len(aurora.archive) > 100


def test_what_was_asked_can_be_asked_for_again(ballistic):
    aurora = Aurora(2, "genotype", seed=0)
    assert aurora.pending is None
    assert_array_equal(aurora.ask(), aurora.pending)


def test_known_controllers_wait_for_a_pending_batch(ballistic):
    seen = []
    aurora = Aurora(2, "genotype", seed=0)
    aurora.ask()
    aurora.run(lambda g: seen.append(g) or ballistic(g), generations=2, initial=[[0.25, 0.5]])
    assert [len(batch) for batch in seen] == [200, 1]


class Outside:
    def ask(self, archive, n, rng):
        return np.full((n, 2), -0.5), np.full(n, -1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"variation": lambda parents, rng: parents[:5]}, r"variation must return genotypes of shape \(200, 2\)"),
        ({"variation": lambda parents, rng: parents * 0 + 2}, r"variation must return genotypes in \[0, 1\], got 2$"),
        ({"variation": lambda parents, rng: parents * np.nan}, r"variation must return genotypes in \[0, 1\], got nan$"),
        ({"emitter": Outside()}, r"emitter Outside must return genotypes in \[0, 1\], got -0\.5$"),
        ({"selection": lambda archive, n, rng: np.zeros(3, int)}, r"selection must return \(200,\) rows"),
        ({"selection": lambda archive, n, rng: np.full(n, len(archive))}, "selection must return"),
        ({"selection": lambda archive, n, rng: np.zeros(n)}, "selection must return"),
    ],
)
def test_strategies_that_misbehave_are_named(ballistic, options, message):
    with pytest.raises(ValueError, match=message):
        Aurora(2, "genotype", seed=0, **options).run(ballistic, generations=2)


def test_many_genes(ballistic):
    """The volume of a ball in 500 dimensions is no double."""
    aurora = Aurora(500, "genotype", seed=0, batch_size=20).run(lambda g: (np.zeros(len(g)), g), generations=2)
    assert aurora.archive.l > 0


def test_a_copy_of_a_run_is_the_same_run(ballistic):
    aurora = Aurora(2, PCA(n_components=2), seed=0).run(ballistic, generations=10)
    other = copy.deepcopy(aurora)
    assert_same(aurora.run(ballistic, generations=50), other.run(ballistic, generations=50))


def test_history_of_a_long_run_is_thinned():
    from auroraqd.history import History, Record

    history = History(limit=100)
    for generation in range(1, 1001):
        history.append(Record(generation, generation * 10, 1, 0.1, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0))
    generations = history.column("generation")
    assert len(history) <= 101
    assert generations[-1] == 1000
    assert len(set(np.diff(generations[:-1]))) == 1
