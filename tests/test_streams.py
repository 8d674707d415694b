"""Observations of several streams: joints, a path and a camera at once."""

import pickle
import warnings

import numpy as np
import pytest
from commands import cli
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.decomposition import PCA, KernelPCA

import auroraqd
from auroraqd import asynchronous, evaluate, report
from auroraqd.descriptors.descriptor import Descriptor
from auroraqd.descriptors.scaling import Scaling, far_outside
from auroraqd.individuals import Columns
from auroraqd.observations import features_of, flat, joined, layout_of, streams_of, unflattened
from auroraqd.tasks import each, from_jax, repeated

STEPS = np.linspace(0, 1, 5)


def robot(genotypes):
    """Three joints for 5 instants, the way of a foot, and what a camera sees in the end."""
    joints = np.sin(genotypes[:, None] + STEPS[:, None])
    path = (STEPS[:, None] * genotypes[:, None, :2]).astype(np.float32)
    pixels = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1) / 3
    seen = np.linalg.norm(pixels - genotypes[:, None, None, :2], axis=-1) < 0.4
    fitness = np.where(genotypes[:, 2] > 0.95, np.nan, 0)
    return fitness, {"path": path, "joints": joints, "camera": (200 * seen).astype(np.uint8)}, genotypes[:, :2]


def made(descriptor=None, **options):
    return auroraqd.Aurora(3, PCA(2) if descriptor is None else descriptor, seed=1, batch_size=20, **options)


def same(one, other):
    assert one.archive.columns.keys() == other.archive.columns.keys()
    for name, column in one.archive.columns.items():
        assert_array_equal(column, other.archive.columns[name])


@st.composite
def observations(draw):
    n = draw(st.integers(1, 5))
    shapes = st.lists(st.integers(1, 3), max_size=3).map(tuple)
    kinds = st.sampled_from([np.float64, np.float32, np.uint8, np.int64, np.bool_])
    streams = draw(st.dictionaries(st.sampled_from(["a", "zz", "m_1"]), st.tuples(shapes, kinds), min_size=1))
    rng = np.random.default_rng(draw(st.integers(0, 9)))
    return {name: rng.integers(0, 2, (n, *shape)).astype(kind) for name, (shape, kind) in streams.items()}


@given(observations())
def test_streams_are_joined_and_taken_apart(streams):
    observation = joined(streams)
    assert list(streams_of(observation)) == sorted(streams)
    for name, stream in streams.items():
        assert_array_equal(observation[name], stream)
        assert observation[name].dtype == stream.dtype
    rows = flat(observation)
    assert rows.shape == (len(observation), features_of(observation))
    assert_array_equal(rows, np.concatenate([streams[name].reshape(len(rows), -1) for name in sorted(streams)], axis=1))
    back = unflattened(rows, layout_of(observation))
    assert layout_of(back) == layout_of(observation)
    for name, stream in streams.items():
        assert_array_equal(back[name], stream)


def test_each_stream_counts_alike_whatever_its_width():
    rng = np.random.default_rng(0)
    streams = {"wide": rng.normal(size=(300, 50, 3)), "narrow": rng.normal(size=(300, 2)), "constant": np.ones((300, 4))}
    observation = joined(streams)
    x = Scaling.of(observation).scaler(160 - 4)(flat(observation))
    naive = [np.mean(Scaling.of(s).scaler(s[0].size)(s) ** 2, axis=1) for s in streams.values()]
    assert_allclose(np.mean(x**2, axis=1), np.mean(naive, axis=0), rtol=1e-12)
    assert (x[:, :4] == 0).all()


def test_weights_say_what_counts():
    rng = np.random.default_rng(0)
    observation = joined({"a": rng.random((50, 6)), "b": rng.random((50, 2))})
    x = Scaling.of(observation, {"b": 3.0}).scaler(8)(flat(observation))
    naive = [np.mean(Scaling.of(s).scaler(s[0].size)(s) ** 2, axis=1) for s in streams_of(observation).values()]
    assert_allclose(np.mean(x**2, axis=1), (naive[0] + 9 * naive[1]) / 10, rtol=1e-12)


def test_a_transformer_gets_them_scaled_and_beside_each_other():
    aurora = made().run(robot, generations=8)
    archive = aurora.archive
    assert len(archive) > 50
    assert aurora.history.last.invalid > 0
    assert archive.observation["camera"].dtype == np.uint8
    assert archive.observation["path"].shape == (len(archive), 5, 2)
    _, again, _ = robot(archive.genotype)
    for name, stream in again.items():
        assert_array_equal(archive.observation[name], stream)
    descriptor = aurora.descriptor
    x = descriptor.scaling.scaler(16 + 15 + 10)(flat(archive.observation))
    assert_allclose(archive.descriptor, descriptor.transformer.transform(x), atol=1e-9)
    assert_allclose(aurora.describe(again), archive.descriptor, atol=1e-9)
    error = np.sqrt(np.mean((descriptor.transformer.inverse_transform(archive.descriptor) - x) ** 2, axis=1))
    assert_allclose(archive.reconstruction_error, error, atol=1e-9)
    expected = aurora.reconstruct(archive.descriptor[:3])
    scaled = descriptor.transformer.inverse_transform(archive.descriptor[:3])
    assert_allclose(flat(expected), descriptor.scaler.inverse(scaled), atol=1e-9)
    assert expected["joints"].shape == (3, 5, 3)
    assert np.abs(expected["joints"] - archive.observation["joints"][:3]).max() < 0.5


@pytest.mark.parametrize("descriptor", ["hand-coded", "genotype", "observation"])
def test_other_descriptors(descriptor):
    archive = made(descriptor).run(robot, generations=3).archive
    assert archive.descriptor.shape[1] == {"hand-coded": 2, "genotype": 3, "observation": 41}[descriptor]


@pytest.mark.parametrize("generations", [0, 1, 6])
def test_it_is_saved_and_goes_on(tmp_path, generations):
    aurora = made(prior=robot(np.random.default_rng(2).random((30, 3)))[1]).run(robot, generations=generations)
    again = auroraqd.resume(auroraqd.save(aurora, tmp_path))
    assert again.descriptor.layout == aurora.descriptor.layout
    for run in (aurora, again):
        run.run(robot, generations=4)
    same(aurora, again)
    refitted = auroraqd.resume(auroraqd.save(made().run(robot, generations=3), tmp_path / "other"))
    assert_array_equal(refitted.describe(refitted.archive.observation), refitted.archive.descriptor)


def test_individuals_that_wait_are_saved(tmp_path):
    aurora = auroraqd.Aurora(3, PCA(2), batch_size=2)
    for _ in range(3):
        again = auroraqd.resume(auroraqd.save(aurora, tmp_path))
        for run in (aurora, again):
            run.run(robot, generations=1)
        same(aurora, again)
    assert len(aurora.archive)


def test_the_repertoire(tmp_path):
    pytest.importorskip("pandas")
    auroraqd.save(made().run(robot, generations=8), tmp_path)
    repertoire = auroraqd.load(tmp_path)
    path = STEPS[:, None] * np.array([0.3, 0.8])
    reached = repertoire.reach({"path": path}, k=2)
    nearest = np.argsort(np.linalg.norm(repertoire.ground_truth - (0.3, 0.8), axis=1), kind="stable")
    assert reached.rows[0] in nearest[:3]
    assert reached.observation["camera"].shape == (2, 4, 4)
    assert reached.reconstruction["path"].shape == (2, 5, 2)
    both = repertoire.reach({"path": path, "joints": np.full((5, 3), np.nan)})
    assert_array_equal(both.rows, reached.rows[:1])
    assert "observation camera" in repr(reached)
    assert_array_equal(repertoire.evaluate(robot, [1, 4]).error, 0)
    other = repertoire.evaluate(lambda genotypes: robot(genotypes * 0.9), [1, 4])
    half = {name: Scaling.of(s).scaler(s[0].size).half for name, s in streams_of(repertoire.observation).items()}
    for i, row in enumerate((1, 4)):
        found = robot(repertoire.genotype[row : row + 1] * 0.9)[1]
        squares = [
            np.mean(((found[name].astype(float) - stream[row]).ravel() / half[name]) ** 2)
            for name, stream in streams_of(repertoire.observation).items()
        ]
        assert_allclose(other.error[i, 0], np.sqrt(np.mean(squares)))
    table = repertoire.to_pandas()
    assert_array_equal(table["observation_camera_1_2"], repertoire.observation["camera"][:, 1, 2])
    assert {path.stem for path in report.write_figures(tmp_path)} == {"repertoire", "history", "skills"}


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        (np.zeros(3), r"observation must be a mapping of some of camera, joints, path to arrays, got"),
        (np.zeros(2), r"got array\(\[0., 0.\]\). It may be a ground truth: refine comes close to those"),
        ({}, r"observation must be a mapping of some of camera, joints, path to arrays, got none"),
        ({"smell": 1}, r"observation must be a mapping of some of camera, joints, path to arrays, got smell"),
        ({"path": np.zeros(3)}, r"observation path must have shape \(5, 2\), as those of the repertoire, got \(3,\)"),
        ({"path": np.full((5, 2), np.nan)}, "observation must have finite entries, or NaN for what does not matter"),
        ({"path": np.full((5, 2), np.inf)}, "observation path must have finite entries"),
    ],
)
def test_what_cannot_be_reached_is_said(tmp_path_factory, wanted, message):
    repertoire = auroraqd.load(auroraqd.save(made().run(robot, generations=1), tmp_path_factory.mktemp("run")))
    with pytest.raises(ValueError, match=message):
        repertoire.reach(wanted)


def changing(change):
    calls = []

    def task(genotypes):
        calls.append(0)
        fitness, streams, truth = robot(genotypes)
        return fitness, change(streams) if len(calls) > 2 else streams, truth

    return task


def without(streams):
    return {name: stream for name, stream in streams.items() if name != "path"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            without,
            r"the streams camera .*, joints .*, path .*, as before, got the streams camera .*, joints",
        ),
        (lambda streams: streams["joints"], "observation must be the streams .*, as before, got one array"),
        (lambda streams: {**streams, "more": streams["path"]}, "as before, got the streams .*more"),
        (lambda streams: {**streams, "path": streams["path"][:-1]}, "observation must have as many rows in each stream, got"),
        (lambda streams: {**streams, "path": streams["path"][:, :3]}, r"as before, got .*path \(3, 2\)"),
        (lambda streams: {**streams, "path": None}, "observation path must be numbers, got None"),
        (lambda streams: {**streams, "path": streams["path"].astype(complex)}, "observation path must be numbers, got"),
        (lambda streams: {**streams, "a path": streams["path"]}, "observation must have streams with names, .* got 'a path'"),
        (lambda streams: {**streams, 3: streams["path"]}, "observation must have streams with names, .* got 3"),
        (lambda streams: {}, "observation must have a stream at least, got none"),
        (lambda streams: {name: rows[:5] for name, rows in streams.items()}, r"must have 20 rows, .* got shape \(5,\)"),
    ],
)
def test_streams_that_come_and_go_are_refused(change, message):
    aurora = made()
    with pytest.raises(auroraqd.TaskError, match=message) as error:
        aurora.run(changing(change), generations=5)
    assert "\n" not in str(error.value)
    assert aurora.generation == 2
    aurora.run(robot, generations=1)
    assert aurora.generation == 3


def test_the_order_of_streams_is_no_matter():
    def turned(genotypes):
        fitness, streams, truth = robot(genotypes)
        return fitness, dict(sorted(streams.items())), truth

    same(made().run(robot, generations=3), made().run(turned, generations=3))


def test_functions_of_one_genotype():
    def one(genotype):
        return {name: stream[0] for name, stream in robot(genotype[None])[1].items()}

    genotypes = np.random.default_rng(0).random((6, 3))
    found = each(one)(genotypes)
    for name, stream in robot(genotypes)[1].items():
        assert_array_equal(found[name], stream)
    assert made().run(each(one), generations=2).archive.observation["joints"].shape[1:] == (5, 3)
    with pytest.raises(auroraqd.TaskError, match="observation must have the same streams for each genotype"):
        made().run(each(lambda genotype: {"a" if genotype[0] > 0.5 else "b": genotype}), generations=1)
    mean = repeated(robot, 2)(genotypes).observation
    for name, stream in robot(genotypes)[1].items():
        assert_allclose(mean[name], stream, rtol=1e-6)


def test_jax():
    jax = pytest.importorskip("jax")
    task = from_jax(lambda genotype: (genotype[0], {"a": genotype, "b": jax.numpy.outer(genotype, genotype)}))
    archive = made().run(task, generations=2).archive
    assert archive.observation["b"].shape[1:] == (3, 3)


def test_workers(tmp_path):
    alone = made().run(robot, generations=3)
    with evaluate.over(evaluate.processes(2), robot) as task:
        same(alone, made().run(task, generations=3))
        aurora = made().run(task, generations=3, asynchronous=True)
    again = made()
    asynchronous.replay(again, robot, aurora.events)
    same(again, aurora)


def test_outliers_of_one_stream_are_outside():
    streams = robot(np.random.default_rng(0).random((200, 3)))[1]
    streams["path"][7] = 1e6
    assert_array_equal(np.flatnonzero(far_outside(joined(streams))), [7])


def test_an_archive_takes_them():
    archive = auroraqd.UnstructuredArchive(l=0.01)
    genotypes = np.random.default_rng(0).random((9, 3))
    archive.add(genotypes, np.zeros(9), robot(genotypes)[1], genotypes[:, :2])
    assert archive.observation["camera"].shape == (9, 4, 4)
    with pytest.raises(ValueError, match=r"observation must be the streams .*, as before, got one array"):
        archive.add(genotypes, np.zeros(9), genotypes, genotypes[:, :2])


def test_the_explorer_shows_a_path_before_others(tmp_path):
    pytest.importorskip("bokeh")
    from auroraqd.report.explorer.sights import by_worth

    aurora = made().run(robot, generations=3)
    assert by_worth(aurora.archive.observation)[0] == "path"
    streams = {name: aurora.archive.observation[name] for name in ("joints", "camera")}
    assert by_worth(joined(streams)) == ["camera", "joints"]
    report.explore(aurora, tmp_path / "skills.html")
    assert (tmp_path / "skills.html").stat().st_size > 10_000


def test_a_descriptor_of_others_is_refused():
    descriptor = Descriptor(PCA(1)).refitted(joined(robot(np.random.default_rng(0).random((9, 3)))[1]))
    with pytest.raises(ValueError, match=r"observation must be the streams .*, as those it was fitted on, got one array"):
        descriptor.describe_observation(np.zeros((2, 41)))


def test_command_line(tmp_path):
    (tmp_path / "machine.py").write_text(
        "import numpy as np\n\n\ndef task(genotypes):\n"
        "    return {'place': genotypes[:, :2], 'heat': np.sin(genotypes)[:, :, None] * np.ones(4)}\n\n\ntask.n_genes = 2\n"
    )
    done = cli("run", "machine:task", "-n", 3, "--batch-size", 20, "--out", tmp_path / "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = cli("resume", tmp_path / "run", "-n", 5, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = cli("show", tmp_path / "run")
    assert "observation heat (2, 4), place (2,)" in done.stdout.replace("\n", " ")


def each_stream():
    return auroraqd.Streams(joints=PCA(2), path=PCA(1), camera=None, weights={"path": 3})


def test_each_stream_is_described_by_its_own():
    observation = joined(robot(np.random.default_rng(0).random((60, 3)))[1])
    descriptor = Descriptor(each_stream()).refitted(observation)
    z, error = descriptor.describe(Columns({"observation": observation}))
    back = descriptor.reconstruct(z)
    naive, squares = [], []
    for name, d, weight in (("joints", 2, 1), ("path", 1, 3)):
        scaler = Scaling.of(observation[name]).scaler(observation[name][0].size)
        x = scaler(observation[name])
        pca = PCA(d).fit(x)
        own = pca.transform(x)
        naive.append(weight * own / np.sqrt(own.var(axis=0).sum()))
        squares.append(np.mean((pca.inverse_transform(own) - x) ** 2, axis=1))
        expected = scaler.inverse(pca.inverse_transform(own)).reshape(observation[name].shape)
        assert_allclose(back[name], expected, atol=1e-9)
    assert_allclose(np.abs(z), np.abs(np.hstack(naive)), atol=1e-9)
    assert_allclose(error, np.sqrt(np.mean(squares, axis=0)), atol=1e-9)
    assert (back["camera"] == back["camera"][0]).all()
    assert_allclose(z.var(axis=0).sum(), 1 + 9)


def test_by_itself_it_takes_mappings_too():
    streams = robot(np.random.default_rng(0).random((60, 3)))[1]
    fitted = each_stream().fit(streams)
    assert_array_equal(fitted.transform(streams), fitted.transform(joined(streams)))
    assert fitted.inverse_transform(fitted.transform(streams)).shape == (60, sum(s[0].size for s in streams.values()))
    for call, message in (
        (
            lambda: fitted.transform({"joints": streams["joints"]}),
            "x must be the streams camera .*, as before, got the streams",
        ),
        (lambda: fitted.transform(np.zeros((2, 5))), r"x must have shape \(n, \d+\), got \(2, 5\)"),
        (lambda: fitted.inverse_transform(np.zeros((2, 5))), r"z must have shape \(n, 3\), got \(2, 5\)"),
        (lambda: each_stream().transform(streams), "Streams must be fitted before they describe anything"),
    ):
        with pytest.raises((ValueError, RuntimeError), match=message):
            call()


def test_all_together_with_weights():
    observation = joined(robot(np.random.default_rng(0).random((60, 3)))[1])
    alike = Descriptor(PCA(2)).refitted(observation).describe_observation(observation)
    same_weights = Descriptor(auroraqd.Streams(PCA(2))).refitted(observation)
    assert_allclose(same_weights.describe_observation(observation), alike)
    heavy = Descriptor(auroraqd.Streams(PCA(2), weights={"path": 100})).refitted(observation)
    x = Scaling.of(observation["path"]).scaler(10)(observation["path"])
    path = PCA(2).fit_transform(x) * np.sqrt(41 / 10)
    assert_allclose(np.abs(heavy.describe_observation(observation)), np.abs(path), atol=0.05)


def test_one_for_all_leaves_out_what_it_is_told(tmp_path):
    observation = joined(robot(np.random.default_rng(0).random((60, 3)))[1])
    descriptor = auroraqd.Streams(PCA(2), weights={"path": 2.0}, camera=None)
    aurora = made(descriptor).run(robot, generations=2)
    again = auroraqd.load(auroraqd.save(aurora, tmp_path))
    wanted = auroraqd.Streams(PCA(2), weights={"path": 2.0}).fit(observation[["joints", "path"]])
    found = clone(descriptor).fit(observation)
    blind = observation.copy()
    blind["camera"] = 7
    for rows in (observation, blind):
        assert_allclose(found.transform(rows), wanted.transform(rows[["joints", "path"]]))
    assert_allclose(again.describe(again.observation), aurora.archive.descriptor)
    assert again.reconstruct(again.descriptor).dtype.names == ("camera", "joints", "path")


def test_clones_are_not_fitted():
    for streams in (each_stream(), auroraqd.Streams(PCA(2), weights={"camera": 0.2})):
        fitted = streams.fit(robot(np.random.default_rng(0).random((20, 3)))[1])
        copied = clone(fitted)
        assert repr(copied) == repr(fitted)
        assert not copied.fitted_
        assert not any(hasattr(transformer, "components_") for transformer in copied._transformers.values())


@pytest.mark.parametrize(
    "streams",
    [
        each_stream,
        lambda: auroraqd.Streams(PCA(2), weights={"camera": 0.2}),
        lambda: auroraqd.Streams(joints=KernelPCA(1), path=PCA(1), camera=None),
        lambda: auroraqd.Streams(joints=None, path=None, camera=auroraqd.AutoEncoder(2, max_epochs=3)),
    ],
)
def test_streams_are_learned_saved_and_go_on(tmp_path, streams):
    aurora = made(streams(), schedule=auroraqd.Every(3)).run(robot, generations=4)
    again = auroraqd.resume(auroraqd.save(aurora, tmp_path))
    assert repr(again.descriptor.transformer) == repr(aurora.descriptor.transformer)
    for run in (aurora, again):
        run.run(robot, generations=4)
    same(aurora, again)
    repertoire = auroraqd.load(tmp_path)
    assert_allclose(repertoire.describe(repertoire.observation), repertoire.descriptor, rtol=1e-9, atol=1e-9)
    assert_array_equal(
        pickle.loads(pickle.dumps(aurora.descriptor.transformer)).transform(aurora.archive.observation[:3]),
        aurora.descriptor.transformer.transform(aurora.archive.observation[:3]),
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: auroraqd.Streams(), "Streams must be of one transformer for all, or of one for each"),
        (lambda: auroraqd.Streams(camera=None), "Streams must be of one transformer for all, or of one for each"),
        (lambda: auroraqd.Streams(PCA(2), joints=PCA(2)), "Streams must be of one transformer for all, or of one for each"),
        (lambda: auroraqd.Streams(joints="pca"), "Streams must be of objects with fit and transform, got 'pca' for joints"),
        (lambda: auroraqd.Streams(joints=PCA), "Streams must be of objects with fit and transform, got .*PCA.* for joints"),
        (
            lambda: auroraqd.Streams(joints=PCA(2), weights={"joints": 0}),
            r"weights\['joints'\] must be .*, 1e-06 to 1e\+06, .* got 0",
        ),
        (
            lambda: auroraqd.Streams(PCA(2), weights={"joints": 1e200}),
            r"weights\['joints'\] must be .*, 1e-06 to 1e\+06, got 1e",
        ),
        (lambda: auroraqd.Streams(PCA(2), weights={3: 1.0}), "weights must be of streams, by their names, got 3"),
        (
            lambda: auroraqd.Streams(a=PCA(2), b=None, weights={"b": 2}),
            "streams that are described, got b, which b=None leaves",
        ),
        (
            lambda: auroraqd.Streams(PCA(2)).set_params(c__copy=True),
            "Streams has no parameter 'c__copy'; it has together__copy",
        ),
        (lambda: auroraqd.Streams(PCA(2)).fit({"a": np.zeros((0, 3))}), "x must be finite, of one row at least, got no row"),
        (lambda: auroraqd.Streams(PCA(2)).fit({"a": np.full((3, 3), np.nan)}), "x must be .*, got a NaN or an infinity"),
        (lambda: auroraqd.Streams(joints=PCA(2), weights={"joints": "1"}), r"weights\['joints'\] must be a finite number"),
        (lambda: auroraqd.Streams(PCA(2), weights=3), "weights must be a dictionary"),
    ],
)
def test_wrong_streams(make, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make()


@pytest.mark.parametrize(
    ("streams", "message"),
    [
        (lambda: auroraqd.Streams(joints=PCA(2)), r"must say how to describe camera, path \(None leaves it out\)"),
        (
            lambda: auroraqd.Streams(joints=PCA(1), camera=None, path=None, smell=PCA(2)),
            "streams that are observed, .*, got smell",
        ),
        (lambda: auroraqd.Streams(PCA(2), weights={"smell": 2}), "streams that are observed, camera, joints, path, got smell"),
        (
            lambda: auroraqd.Streams(joints=PCA(2), path=PCA(11), camera=None),
            "path: PCA could not be fitted .* n_components=11",
        ),
    ],
)
def test_streams_that_are_not_those_observed(streams, message):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is tried again
        with pytest.raises(auroraqd.DescriptorError, match=message):
            made(streams()).run(robot, generations=15)
        with pytest.raises(auroraqd.DescriptorError, match=r"streams, .* got observations of one array"):
            made(each_stream()).run(lambda genotypes: genotypes[:, :, None], generations=15)
