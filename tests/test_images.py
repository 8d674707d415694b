"""Auto-encoders of images, and distances along the manifold of what is seen."""

import warnings

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist
from scipy.stats import spearmanr

import auroraqd
from auroraqd.descriptors import distances, layers, networks, training
from auroraqd.descriptors.descriptor import Descriptor
from auroraqd.descriptors.networks import MLP, Image, Recurrent
from auroraqd.descriptors.scaling import Scaling
from auroraqd.individuals import Columns

BRIEF = {"repeats": 2, "random_state": 0}
SMALL = Image(maps=(8, 8), hidden=32, steps=120)


def discs(n, size=16, channels=1, seed=0):
    """Places, (n, 2), and images of a disc there, (n, size, size, channels) uint8."""
    place = np.random.default_rng(seed).random((n, 2))
    centre = 2.5 + (size - 6) * place
    y, x = np.mgrid[:size, :size]
    bright = 255 * np.clip(2 - np.hypot(x - centre[:, :1, None], y - centre[:, 1:, None]), 0, 1)
    return place, np.repeat(bright[..., None], channels, axis=3).astype(np.uint8)


@pytest.fixture(scope="module")
def fitted():
    place, x = discs(300)
    return auroraqd.AutoEncoder(network=SMALL, **BRIEF).fit(x), place, x


@pytest.mark.parametrize("shape", [(4, 4, 1), (5, 7, 2), (3, 6, 3)])
@pytest.mark.parametrize("stride", [1, 2, 3])
def test_strided_convolutions_agree_with_their_twin(shape, stride):
    rng = np.random.default_rng(0)
    layer = layers.Strided.random(shape, stride, 2, "linear", rng)
    x = rng.normal(size=(3, *shape)).astype(np.float32)
    wanted = [naive.strided(image.tolist(), layer.weight.tolist(), stride) for image in x]
    assert_allclose(layer(x.reshape(3, -1)), np.reshape(wanted, (3, -1)), rtol=1e-4, atol=1e-5)


def test_kernels_that_do_not_overlap_see_their_block_alone():
    layer = layers.Strided.random((5, 4, 1), 3, 2, "linear", np.random.default_rng(0), overlap=False)
    x = np.zeros((1, 5, 4, 1), np.float32)
    x[0, 4, 2] = 1  # in the second block below, at its second row and third column
    wanted = np.zeros((2, 2, 2))
    wanted[1, 0] = layer.weight[1 * 3 + 2]
    assert_allclose(layer(x.reshape(1, -1)), wanted.reshape(1, -1))


@pytest.mark.parametrize("overlap", [True, False])
@pytest.mark.parametrize("shape", [(4, 4, 1), (5, 7, 2), (3, 6, 3)])
@pytest.mark.parametrize("stride", [1, 2, 3])
def test_the_way_back_is_the_transpose(shape, stride, overlap):
    """<conv(x), y> = <x, transposed(y)>, once the blocks are in the other order."""
    rng = np.random.default_rng(0)
    there = layers.Strided.random(shape, stride, 2, "linear", rng, overlap)
    grid, n = (-(-shape[0] // stride), -(-shape[1] // stride), 2), 4 if overlap else 1
    blocks = np.asarray(there.weight).reshape(n, -1, 2)[::-1]  # the last of the 2 x 2 blocks of one is the first of the other
    weight = blocks.transpose(0, 2, 1).reshape(2 * n, -1)
    back = layers.Unstrided(weight, np.zeros(shape[2], np.float32), grid, shape, stride, "linear", overlap)
    x, y = rng.normal(size=(1, np.prod(shape))), rng.normal(size=(1, np.prod(grid)))
    assert_allclose((there(x) * y).sum(), (x * back(y)).sum(), rtol=1e-4)


@pytest.mark.parametrize("size", [(16, 16, 1), (17, 128, 2), (33, 20, 3), (64, 64, 4), (128, 128, 1)])
def test_images_of_any_size_go_through(size):
    network = Image(maps=(4, 4, 4), hidden=8).build(size, 2, np.random.default_rng(0))
    x = np.zeros((2, np.prod(size)), np.float32)
    assert network.encode(x).shape == (2, 2)
    assert network.decode(network.encode(x)).shape == x.shape


@pytest.mark.parametrize(
    ("shape", "dtype", "wanted"),
    [
        ((50, 2), float, MLP((9,))),
        ((100,), np.uint8, MLP((9,))),
        ((16, 16), np.uint8, Image()),
        ((20, 20), float, MLP((9,))),  # a time series of twenty channels
        ((64, 64, 3), float, Image()),
        ((128, 16, 1), np.uint8, Image()),
        ((15, 64, 3), np.uint8, MLP((9,))),
        ((129, 64, 3), np.uint8, MLP((9,))),
        ((4, 64, 64, 3), np.uint8, MLP((9,))),
        ((200, 12), float, Recurrent()),
        ((99, 12), float, MLP((9,))),
        ((200, 4), float, MLP((9,))),
        ((2400,), float, MLP((9,))),
    ],
)
def test_auto_chooses_by_shape_and_dtype(shape, dtype, wanted):
    assert networks.chosen(shape, np.dtype(dtype), (9,)) == wanted


@pytest.mark.parametrize(
    ("shape", "dtype", "large"),
    [
        ((140, 20), np.uint8, True),
        ((20, 140, 3), np.uint8, True),
        ((140, 4), np.uint8, False),
        ((140, 20), float, False),
        ((140, 20, 9), np.uint8, False),
        ((12, 12, 3), np.uint8, False),
        ((128, 128, 3), np.uint8, False),
    ],
)
def test_what_looks_like_an_image_that_is_too_large(shape, dtype, large):
    assert networks.is_large_image(shape, np.dtype(dtype)) == large


def test_images_that_are_too_large_are_said_to_be():
    """Unless dense layers were asked for."""
    options = {"hidden": (2,), "repeats": 1, "max_epochs": 1, "min_steps": 1}
    x = np.zeros((5, 20, 140, 3), np.uint8)
    with pytest.warns(UserWarning, match=r"of shape \(n, 20, 140, 3\) look like images, .* at most 128 pixels a side"):
        auroraqd.AutoEncoder(1, **options).fit({"a": np.zeros((5, 2)), "eye": x})
    auroraqd.AutoEncoder(1, network="mlp", **options).fit(x)


def test_what_was_chosen_is_said(fitted):
    x = np.random.default_rng(0).random((30, 5))
    encoder = auroraqd.AutoEncoder(repeats=1, min_steps=2).fit(x)
    assert repr(encoder).endswith(", which chose MLP(hidden=(128, 64, 32))")
    assert "which chose" not in repr(auroraqd.AutoEncoder())
    assert "which chose" not in repr(fitted[0])  # nothing was left open


def test_neighbours_in_latent_space_are_alike(fitted):
    encoder, place, x = fitted
    assert spearmanr(pdist(place), pdist(encoder.transform(x)))[0] > 0.9


def test_images_are_described_alike_in_any_batch(fitted):
    encoder, _, x = fitted
    together = encoder.transform(x)
    for rows in (slice(0, 1), slice(5, 6), slice(63, 66), slice(100, 250)):
        assert_array_equal(encoder.transform(x[rows]), together[rows])


def test_descriptions_add_up(fitted):
    encoder, _, x = fitted
    z, error = encoder.describe(x)
    assert_array_equal(z, encoder.transform(x))
    wrong = (encoder.inverse_transform(z) - x) / 127.5
    assert_allclose(error, np.sqrt((wrong**2).mean(axis=(1, 2, 3))), rtol=1e-3)
    assert encoder.transform(x[:0]).shape == (0, 2)
    assert encoder.inverse_transform(z[:0]).shape == (0, 16, 16, 1)


def test_whole_numbers_are_scaled_by_255_and_shares_by_1():
    images = np.full((3, 16, 16, 2), 7, np.uint8)
    assert_array_equal(Image().scaling(images).high, [255, 255])
    assert_array_equal(Image().scaling(images / 255).high, [1, 1])
    assert_array_equal(Image().scaling(images / 2).low, [3.5, 3.5])  # out of [0, 1]: by range
    assert_array_equal(Image().scaling(images[..., 0]).low, [0])  # without an axis of channels


def test_a_descriptor_of_images_reads_them_as_they_are(fitted):
    encoder, _, x = fitted
    descriptor = Descriptor(auroraqd.AutoEncoder(network=SMALL, **BRIEF)).refitted(x)
    assert descriptor.raw
    assert_array_equal(descriptor.describe_observation(x), encoder.transform(x))
    values, error = descriptor.describe(Columns({"observation": x}))
    assert_array_equal(values, encoder.transform(x))
    assert_array_equal(error, encoder.describe(x)[1])
    assert_array_equal(descriptor.reconstruct(values), encoder.inverse_transform(values))


def test_a_run_from_pixels_comes_back_from_disk(tmp_path):
    def robot(genotypes):
        centre = 2.5 + 10 * genotypes
        y, x = np.mgrid[:16, :16]
        away = np.hypot(x - centre[:, :1, None], y - centre[:, 1:, None])
        return (255 * np.clip(2 - away, 0, 1)).astype(np.uint8)[..., None]

    encoder = auroraqd.AutoEncoder(network=Image(maps=(4, 4), hidden=16, steps=30), repeats=2)
    aurora = auroraqd.Aurora(2, encoder, seed=0, batch_size=50, schedule=auroraqd.Every(2)).run(robot, generations=5)
    with warnings.catch_warnings(action="error"):
        repertoire = auroraqd.load(auroraqd.save(aurora, tmp_path))
        assert_array_equal(repertoire.describe(aurora.archive.observation), aurora.archive.descriptor)
    assert_array_equal(repertoire.reconstruct(repertoire.descriptor), aurora.reconstruct(aurora.archive.descriptor))
    again = auroraqd.resume(tmp_path).run(robot, generations=2)
    aurora.run(robot, generations=2)
    assert_array_equal(again.archive.descriptor, aurora.archive.descriptor)


@pytest.mark.parametrize(
    "x",
    [
        np.zeros((40, 16, 16, 1), np.uint8),
        np.full((1, 16, 16, 3), 9, np.uint8),
        np.random.default_rng(0).normal(3, 2, (30, 16, 16, 1)),
        np.repeat(discs(3)[1], 10, axis=0),
    ],
    ids=["all black", "one row", "floats outside [0, 1]", "three images again and again"],
)
@pytest.mark.filterwarnings("ignore:the latent space of AutoEncoder has collapsed")  # of noise there is little to learn
def test_images_of_little_use_are_learned_or_it_is_said(x):
    encoder = auroraqd.AutoEncoder(network=Image(maps=(4,), hidden=8, steps=4), **BRIEF).fit(x)
    assert np.isfinite(encoder.transform(x)).all()
    assert encoder.inverse_transform(encoder.transform(x)).shape == x.shape


@pytest.mark.parametrize(
    ("network", "shape", "message"),
    [
        ("image", (9, 9, 1), r"network 'image' is for images, .* from 16 to 128 pixels a side .* got \(n, 9, 9, 1\)"),
        ("image", (16, 16, 17), "of at most 16 channels"),
        (Image(maps=()), (16, 16, 1), "maps must be numbers of maps like"),
        (Image(steps=0), (16, 16, 1), "steps must be a whole number"),
        (Image(hidden=0), (16, 16, 1), "hidden must be a whole number"),
        (Image(error=-1), (16, 16, 1), "error must be a finite number"),
        (MLP((0,)), (16, 16, 1), "hidden must be"),
        (Image, (16, 16, 1), "network must be one of auto, mlp, convolutional, image, recurrent, or a value"),
    ],
)
def test_bad_networks(network, shape, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.AutoEncoder(network=network).fit(np.zeros((5, *shape), np.uint8))


def test_frames_with_a_nan_are_refused():
    x = discs(5)[1] / 255
    x[3, 2, 2] = np.nan
    with pytest.raises(ValueError, match="x must be finite"):
        auroraqd.AutoEncoder().fit(x)


def test_a_training_that_fails_is_tried_again_with_a_smaller_rate(monkeypatch):
    """The first rate fails, and a fifth of it; a twenty-fifth learns."""
    x = np.random.default_rng(0).normal(size=(200, 2)) @ np.random.default_rng(1).normal(size=(2, 8))
    tried, really = [], training.train

    def train(*given):
        tried.append(given[3].learning_rate)
        trained = really(*given)
        # What a rate that is too large really does differs between versions of JAX.
        return trained._replace(diverged=True) if tried[-1] > 1 else trained

    monkeypatch.setattr(training, "train", train)
    options = {"hidden": (4,), "repeats": 1, "min_steps": 100, "clip": 0.0, "decay": "none", "random_state": 0}
    with warnings.catch_warnings(action="error"):
        encoder = auroraqd.AutoEncoder(learning_rate=10.0, **options).fit(x)
    assert_allclose(tried, [10, 2, 0.4])
    assert encoder.training_rmse_ < 0.25  # that of the first is 0.37


def full_gpu(monkeypatch, message):
    """A device whose memory is full after the first piece of a training, beside a processor."""
    steps, tried = training._steps, []

    def limited(*given):
        tried.append(training.jax.config.jax_default_device)
        for progress in steps(*given):
            yield progress
            if tried[-1] is None:
                raise training.jax.errors.JaxRuntimeError(message)
        return (yield from steps(*given))

    monkeypatch.setattr(training, "_steps", limited)
    monkeypatch.setattr(training.jax, "default_backend", lambda: "gpu")
    return tried


def test_what_a_gpu_has_no_memory_for_the_processor_trains(monkeypatch):
    x = np.random.default_rng(0).normal(size=(60, 2)) @ np.random.default_rng(1).normal(size=(2, 8))
    options = {"hidden": (8,), "repeats": 1, "min_steps": 200, "random_state": 0}
    tried = full_gpu(monkeypatch, "RESOURCE_EXHAUSTED: Out of memory while trying to allocate 11811160064 bytes.")
    with pytest.warns(UserWarning, match="the gpu has not enough memory to train AutoEncoder on 60 observations"):
        encoder = auroraqd.AutoEncoder(**options).fit(x)
    assert [None if device is None else device.platform for device in tried] == [None, "cpu"]
    assert np.isfinite(encoder.transform(x)).all()


def test_another_trouble_of_a_gpu_refuses_an_update_and_ends_no_run(monkeypatch):
    task = auroraqd.tasks.Ballistic()
    encoder = auroraqd.AutoEncoder(2, hidden=(4,), repeats=1, min_steps=20)
    aurora = auroraqd.Aurora(2, encoder, seed=0, batch_size=30, schedule=auroraqd.Every(2)).run(task, generations=1)
    stored = len(aurora.archive)
    full_gpu(monkeypatch, "INTERNAL: the device has gone")
    with pytest.warns(UserWarning, match="no update of the descriptor at generation 2"):
        aurora.run(task, generations=2)
    assert len(aurora.archive) >= stored


def test_a_network_of_ones_own():
    """Any frozen dataclass that derives from Network; with its loss."""
    x = np.random.default_rng(0).normal(size=(80, 2)) @ np.random.default_rng(1).normal(size=(2, 8))
    encoder = auroraqd.AutoEncoder(network=Linear(), repeats=2, random_state=0).fit(x)
    assert encoder.training_rmse_ < 0.1
    assert encoder.network_ == Linear()


class Linear(networks.Network):
    def __eq__(self, other):
        return isinstance(other, Linear)

    def __hash__(self):
        return 1

    def build(self, shape, n_components, rng):
        n = int(np.prod(shape))
        one, other = (layers.Dense.random(*sizes, "linear", rng) for sizes in ((n, n_components), (n_components, n)))
        return layers.AutoEncoderNetwork((one,), (other,))


# Distances


def test_blurred_images_differ_by_how_far_things_have_moved():
    place, x = discs(150, size=32)
    scaling = Scaling.pixels(x)
    true = pdist(place)
    assert spearmanr(true, pdist(distances.multiscale(x, scaling)))[0] > 0.85
    assert spearmanr(true, pdist(distances.flat(x, scaling)))[0] < 0.6


def test_paths_are_those_of_the_manifold():
    """On an arc of a circle the way along it counts, not the chord."""
    angle = np.sort(np.random.default_rng(0).uniform(0, 5, 300))
    rows = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    for landmarks in (1000, 40):
        z = distances.along_the_graph(rows, np.random.default_rng(0), landmarks=landmarks)
        assert_allclose(pdist(z), pdist(angle[:, None]), atol=0.1)
    assert spearmanr(pdist(rows), pdist(angle[:, None]))[0] < 0.95


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.integers(1, 4), st.integers(1, 4))
def test_graphs_are_in_one_piece_and_paths_no_shorter_than_lines(seed, n, features, clusters):
    rng = np.random.default_rng(seed)
    rows = (rng.normal(size=(n, features)) + 100 * rng.integers(clusters, size=(n, 1))).astype(np.float32)
    rows = np.unique(rows, axis=0)
    graph = distances.neighbour_graph(rows, 2)
    assert connected_components(graph)[0] == 1
    lengths = distances.paths(graph, np.arange(len(rows)))
    lines = np.linalg.norm(rows[:, None].astype(float) - rows, axis=2)
    assert (lengths >= lines - 1e-3 * (1 + lines)).all()
    assert_allclose(lengths, lengths.T, rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 9])
def test_few_rows_and_copies_have_places(n):
    rows = np.random.default_rng(0).random((n, 3)).astype(np.float32)
    rows = np.concatenate([rows, rows])
    z = distances.along_the_graph(rows, np.random.default_rng(0))
    assert_array_equal(z[:n], z[n:])
    assert np.isfinite(z).all()
    assert_allclose(pdist(z[:n]), pdist(rows[:n]), atol=1e-3)  # so few are all neighbours


def test_how_well_distances_are_told():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(40, 2))
    assert distances.kept(x, 3 * x) == pytest.approx(1)
    assert distances.kept(x, np.zeros((40, 1))) == 0
    z = rng.normal(size=(40, 2))
    assert distances.kept(x, z) == pytest.approx(np.corrcoef(pdist(x), pdist(z))[0, 1] ** 2)
