"""Networks for streams: an encoder and a decoder each, one latent space."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.distance import pdist
from scipy.stats import spearmanr

import auroraqd
from auroraqd.descriptors import autoencoder, layers
from auroraqd.descriptors.networks import MLP, Convolutional, Fused, Image, Recurrent
from auroraqd.descriptors.scaling import Scaling
from auroraqd.observations import FlatRows, flat, joined

SHORT = {"repeats": 1, "min_steps": 50, "random_state": 0}


def robot(genotypes):
    """A square on a picture, joints that swing as far as it is to the right, and a contact."""
    place = (2 + 9 * genotypes[:, :2]).astype(int)
    camera = np.zeros((len(genotypes), 16, 16, 3), np.uint8)
    for image, (x, y) in zip(camera, place, strict=True):
        image[y : y + 4, x : x + 4] = (255, 40, 40)
    swing = genotypes[:, :1, None] * np.sin(np.linspace(0, 6, 20))[:, None] * [1.0, -1.0, 0.5]
    return np.zeros(len(genotypes)), {"camera": camera, "contact": genotypes[:, 0] > 0.5, "joints": swing}, genotypes[:, :2]


def seen(n, seed=0):
    genotypes = np.random.default_rng(seed).random((n, 2))
    return genotypes, joined(robot(genotypes)[1])


@pytest.fixture(scope="module")
def fitted():
    return auroraqd.AutoEncoder(2, **{**SHORT, "min_steps": 400}).fit(seen(300)[1])


def test_each_stream_gets_what_suits_it():
    fields = [("a", np.uint8, (32, 32)), ("b", float, (200, 12)), ("c", bool), ("d", float, (20, 3))]
    fused = Fused.of(np.dtype(fields), hidden=(8,))
    assert [type(network) for _, _, network in fused.parts] == [Image, Recurrent, MLP, MLP]
    assert [shape for _, shape, _ in fused.parts] == [(32, 32), (200, 12), (1,), (20, 3)]
    assert repr(fused) == "Fused(a=Image(), b=Recurrent(), c=MLP(hidden=(8,)), d=MLP(hidden=(8,)))"
    assert fused.geodesic
    assert fused.rate == Image.rate
    assert not Fused.of(np.dtype(fields[1:])).geodesic


def test_stacks_beside_each_other_read_their_own_entries():
    rng = np.random.default_rng(0)
    stacks = tuple((layers.Dense.random(size, 2, "tanh", rng),) for size in (3, 1, 4))
    x = rng.normal(size=(5, 8)).astype(np.float32)
    wanted = [stack[0](x[:, a:b]) for stack, (a, b) in zip(stacks, [(0, 3), (3, 4), (4, 8)], strict=True)]
    assert_allclose(layers.Each(stacks, (3, 1, 4))(x), np.hstack(wanted), atol=1e-6)


def test_errors_of_streams_are_balanced():
    _, x = seen(40)
    fused = Fused.of(x.dtype)
    rows, scaler = flat(x), fused.scaling(x).scaler(flat(x).shape[1])
    scaled = scaler(rows)
    variance = autoencoder._variances(FlatRows(x), scaler, fused.groups(rows.shape[1]))
    ends = np.cumsum([16 * 16 * 3, 1, 60])
    streams = np.split(scaled, ends[:-1], axis=1)
    assert_allclose(variance, [stream.var(axis=0).sum() for stream in streams], rtol=1e-6)
    means = np.concatenate([np.tile(stream.mean(axis=0), (40, 1)) for stream in streams], axis=1)
    assert_allclose(np.mean(fused.loss(scaled, means, variance)), fused.error, rtol=0.01)  # nothing explained: 1 of each
    for i in range(3):  # one of three streams explained, whichever it is
        parts = [stream if i == j else np.tile(stream.mean(axis=0), (40, 1)) for j, stream in enumerate(streams)]
        assert_allclose(np.mean(fused.loss(scaled, np.hstack(parts), variance)), fused.error * 2 / 3, rtol=0.01)


def test_a_variance_of_all_is_what_it_was():
    x = np.random.default_rng(0).normal(size=(700, 6))
    found = autoencoder._variances(x, Scaling.of(x).scaler(6), (6,))
    assert found == pytest.approx(Scaling.of(x).scaler(6)(x).var(axis=0).sum())
    assert isinstance(found, float)


def test_pictures_keep_their_black_and_distances_of_streams_count_alike():
    _, x = seen(60)
    fused = Fused.of(x.dtype)
    scaling = fused.scaling(x)
    assert_array_equal(scaling.low[:768], 0)
    assert_array_equal(scaling.high[:768], 255)
    measured = fused.measured(x, scaling)
    widths = [network.measured(rows, network.scaling(rows)).shape[1] for network, rows in fused._rows(x)]
    for part in np.split(measured, np.cumsum(widths)[:-1], axis=1):
        assert part.var(axis=0).sum() == pytest.approx(1, rel=1e-4)


def test_neighbours_are_alike_in_all_that_is_sensed(fitted):
    genotypes, x = seen(200, seed=1)
    assert isinstance(fitted.network_, Fused)
    z = fitted.transform(x)
    assert spearmanr(pdist(z), pdist(genotypes))[0] > 0.65  # a contact is a leap
    assert_array_equal(fitted.transform(x[:1]), z[:1])
    assert_array_equal(fitted.transform({name: x[name] for name in x.dtype.names}), z)
    assert_array_equal(fitted.transform(flat(x)), z)
    again, error = fitted.describe(flat(x))
    assert_array_equal(again, z)
    difference = (fitted.inverse_transform(z) - flat(x)) * fitted.scaling_.scaler(829).factor
    assert_allclose(error, np.sqrt((difference**2).mean(axis=1)), atol=1e-4)


@pytest.mark.parametrize("beta", [0.0, 0.01])
def test_runs_are_saved_and_go_on_bit_for_bit(beta, tmp_path):
    parts = (
        ("camera", (16, 16, 3), Image(maps=(4,), hidden=8)),
        ("contact", (1,), MLP((4,))),
        ("joints", (20, 3), Convolutional()),
    )
    encoder = auroraqd.AutoEncoder(2, network=Fused(parts, width=4, hidden=8, steps=20), beta=beta, **SHORT)
    aurora = auroraqd.Aurora(2, encoder, seed=0, batch_size=30, schedule=auroraqd.Every(2)).run(robot, generations=3)
    repertoire = auroraqd.load(auroraqd.save(aurora, tmp_path))
    assert_array_equal(repertoire.describe(aurora.archive.observation), aurora.archive.descriptor)
    assert repertoire.reconstruct(aurora.archive.descriptor[:3])["camera"].shape == (3, 16, 16, 3)
    again = auroraqd.resume(tmp_path).run(robot, generations=2)
    aurora.run(robot, generations=2)
    assert_array_equal(again.archive.descriptor, aurora.archive.descriptor)


def test_another_network_or_weights_join_the_streams():
    _, x = seen(100)
    options = {**SHORT, "hidden": (16,), "min_steps": 400}
    one = auroraqd.AutoEncoder(2, network="mlp", **options).fit(x)
    assert one.network_ == MLP((16,))
    assert one.transform(x).shape == (100, 2)
    weighted = auroraqd.Streams(auroraqd.AutoEncoder(2, network="mlp", **options), weights={"camera": 0.5}).fit(x)
    assert isinstance(weighted.fitted_[""].network_, MLP)


def test_weights_count_in_the_network(tmp_path):
    """Distances by them, errors by their squares; it is learned, saved, and goes on."""
    fused = Fused.of(seen(2)[1].dtype)
    weighed = fused.weighed({"contact": 0.1})
    assert repr(weighed).endswith("joints=MLP(), weights=(1.0, 0.1, 1.0))")
    _, x = seen(50)
    alike, less = (network.measured(x, network.scaling(x)) for network in (fused, weighed))
    contact = alike.shape[1] - 60 - 1
    assert_allclose(less[:, contact], 0.1 * alike[:, contact], rtol=1e-6)
    assert_array_equal(np.delete(less, contact, axis=1), np.delete(alike, contact, axis=1))
    rows = np.zeros((1, sum(fused.groups(0))))
    wrong = rows.copy()
    wrong[0, 16 * 16 * 3] = 1  # the contact
    errors = [float(network.loss(rows, wrong, np.ones(3))[0]) for network in (fused, weighed)]
    assert_allclose(errors[1] / errors[0], 0.01 * 3 / 2.01, rtol=1e-6)

    descriptor = auroraqd.Streams(auroraqd.AutoEncoder(2, **SHORT), weights={"contact": 0.1})
    aurora = auroraqd.Aurora(2, descriptor, seed=0, batch_size=40, schedule=auroraqd.Every(2)).run(robot, generations=3)
    again = auroraqd.resume(auroraqd.save(aurora, tmp_path))
    for run in (aurora, again):
        run.run(robot, generations=2)
        fitted = run.descriptor.transformer.fitted_[""]
        assert fitted.network_ == weighed
        assert fitted.n_fits_ == 3  # at generations 0, 2, 4: the weights went on
    assert_array_equal(again.archive.descriptor, aurora.archive.descriptor)


def test_one_stream_is_enough():
    """Of a mapping, and by its own."""
    for descriptor in (auroraqd.AutoEncoder(2, **SHORT), auroraqd.Streams(auroraqd.AutoEncoder(2, **SHORT))):
        aurora = auroraqd.Aurora(2, descriptor, seed=0, batch_size=40)
        aurora.run(lambda genotypes: {"joints": np.repeat(genotypes[:, None], 10, axis=1)}, generations=2)
        assert len(aurora.archive) > 20


def test_what_is_fitted_goes_on_unless_something_else_is_wanted():
    options = {"repeats": 1, "max_epochs": 1, "min_steps": 5, "hidden": (4,), "isometry": 0}
    rng = np.random.default_rng(0)
    few = {"a": np.cumsum(rng.random((30, 4)), axis=1), "b": rng.random(30) > 0.5}
    more = {**few, "a": rng.random((30, 5))}
    with warnings.catch_warnings(action="ignore"):  # next to nothing is learned
        streams = auroraqd.Streams(auroraqd.AutoEncoder(2, **options), weights={"b": 0.1}).fit(few).fit(few)
        assert streams.fitted_[""].n_fits_ == 2
        streams.weights["b"] = 10.0
        assert streams.fit(few).fitted_[""].network_.weights == (1.0, 10.0)
        streams.set_params(together__hidden=(6,)).fit(few)
        assert streams.fitted_[""].network_.parts[0][2] == MLP((6,))
        assert streams.fit(more).fitted_[""].network_.parts[0][1] == (5,)
        learned = auroraqd.AutoEncoder(2, **options).fit(few)
        assert auroraqd.Streams(learned, weights={"b": 0.1}).fit(few).fitted_[""].n_fits_ == 2
        assert learned.n_fits_ == 1


def test_parameters_of_what_is_fitted_can_be_set():
    descriptor = auroraqd.Streams(joints=auroraqd.AutoEncoder(2, **SHORT), camera=None, contact=None).fit(seen(20)[1])
    descriptor.set_params(joints__repeats=2).fit(seen(20)[1])
    assert len(descriptor.fitted_["joints"].epochs_) == 2


@pytest.mark.parametrize(
    ("network", "message"),
    [
        (Fused((("a", (4,), Image()),)), "network 'image' is for images"),
        (Fused((("a", (4,), MLP()),)), "network 'Fused' takes the streams a \\(4,\\), got the streams camera"),
        (Fused((("a", (4,), MLP()),), width=0), "width must be a whole number, from 1 to 1000000, got 0"),
        (Fused((("a", (4,), MLP()),), steps=0), "steps must be a whole number, 1 or more, got 0"),
        (Fused(()), "parts must be of one stream at least, got none"),
        (Fused((("a", (4,), MLP()),), weights=(1.0, 2.0)), r"weights must be 1 numbers above 0, .* got \(1.0, 2.0\)"),
        (Fused((("a", (4,), MLP()),), weights=(0.0,)), r"weights must be 1 numbers above 0, .* got \(0.0,\)"),
        ("image", r"from 16 to 128 .*, got \(n, 829\), of the streams camera, contact, joints joined: network 'auto' takes"),
    ],
)
def test_bad_networks(network, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.AutoEncoder(2, network=network, **SHORT).fit(seen(20)[1])


def test_bad_streams():
    with pytest.raises(ValueError, match=r"network 'Fused' takes the streams a \(4,\), got one array"):
        auroraqd.AutoEncoder(2, network=Fused((("a", (4,), MLP()),)), **SHORT).fit(np.zeros((9, 4)))
    _, x = seen(20)
    with pytest.raises(ValueError, match="x must be finite, and of one row at least, got no row"):
        auroraqd.AutoEncoder(2, **SHORT).fit(x[:0])
    x["joints"][3, 2, 1] = np.nan
    with pytest.raises(ValueError, match="x must be finite, and of one row at least, got a NaN or an infinity"):
        auroraqd.AutoEncoder(2, **SHORT).fit(x)
    with pytest.raises(ValueError, match="n_components must be at most 829, the entries of an observation, got 1000"):
        auroraqd.AutoEncoder(1000, **SHORT).fit(seen(20)[1])
