import copy
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import naive
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError

import auroraqd
from auroraqd.descriptors import autoencoder, layers, training
from auroraqd.descriptors._convolution import Convolved, Pooled
from auroraqd.descriptors.inference import Plain
from auroraqd.descriptors.networks import MLP, Convolutional
from auroraqd.descriptors.scaling import Scaling
from auroraqd.metrics import reconstruction_error

SHORT = {"hidden": (16,), "max_epochs": 6, "repeats": 2, "min_steps": 0}


def throws(n, seed=0):
    evaluation = auroraqd.tasks.Ballistic()(np.random.default_rng(seed).random((2 * n, 2)))
    return evaluation.observation[np.isfinite(evaluation.fitness)][:n]


def scaled(x):
    low, high = x.min(axis=(0, 1)), x.max(axis=(0, 1))
    return (x - low) / (high - low) * 2 - 1


def network(shape=(9, 3)):
    return Convolutional().build(shape, 2, np.random.default_rng(0))


def test_the_network_of_the_paper_has_as_many_parameters():
    leaves = jax.tree.leaves(network((50, 2)))
    assert sum(leaf.size for leaf in leaves) == 11_809


@pytest.mark.parametrize("shape", [(50, 2), (9, 3), (10, 2), (11, 1), (2, 1), (1, 1), (1, 4)])
def test_convolution_and_pooling_agree_with_their_twins(shape):
    rng = np.random.default_rng(0)
    layer = layers.Convolution.random(shape, 1, 2, rng)
    layer = eqx.tree_at(lambda c: c.bias, layer, np.array([0.3, -0.7], np.float32))
    images = rng.normal(size=(4, *shape))
    wanted = [
        [naive.convolution(image.tolist(), kernel.reshape(layers.KERNEL).tolist(), bias) for image in images]
        for kernel, bias in zip(layer.kernel[0].astype(float), layer.bias.astype(float), strict=True)
    ]
    wanted = np.array(wanted).transpose(1, 2, 0, 3)  # (n, steps, maps, channels)
    wanted = np.where(wanted > 0, wanted, layers.LEAK * wanted)
    largest = [[naive.max_pooling(image[:, m].tolist()) for m in range(2)] for image in wanted]
    x, pool = images.reshape(4, -1), layers.MaxPooling(shape, 2)
    assert_allclose(layer(jnp.asarray(x)), wanted.reshape(4, -1), atol=1e-5)
    assert_allclose(pool(layer(jnp.asarray(x))), np.array(largest).reshape(4, -1), atol=1e-5)
    assert_allclose(Convolved(layer)(x), wanted.reshape(4, -1), atol=1e-14)
    assert_array_equal(Pooled(pool)(wanted.reshape(4, -1)), np.array(largest).reshape(4, -1))
    assert Pooled(pool)(Convolved(layer)(x[:0])).shape == (0, 2 * x.shape[1])


def test_two_maps_to_one_add_up():
    rng = np.random.default_rng(0)
    both = layers.Convolution.random((6, 2), 2, 1, rng)
    both = eqx.tree_at(lambda c: c.bias, both, np.array([0.2], np.float32))
    x = rng.normal(size=(3, 6, 2, 2))
    total = np.array(
        [
            sum(
                np.array(naive.convolution(image[:, m].tolist(), both.kernel[m, 0].reshape(layers.KERNEL).tolist(), 0.1))
                for m in range(2)
            )
            for image in x
        ]
    )
    wanted = np.where(total > 0, total, layers.LEAK * total).reshape(3, -1)
    assert_allclose(both(jnp.asarray(x.reshape(3, -1))), wanted, atol=1e-5)
    assert_allclose(Convolved(both)(x.reshape(3, -1)), wanted, atol=1e-7)  # its weights are of single precision


@pytest.mark.parametrize(("padded", "n"), [(1, 1), (256, 0), (256, 1), (256, 200), (300, 300), (4096, 4000)])
def test_rows_are_shuffled(padded, n):
    order, another = (np.asarray(training._shuffled(jax.random.key(seed), padded, jnp.asarray(n))) for seed in (0, 1))
    assert_array_equal(np.sort(order[:n]), np.arange(n))
    assert_array_equal(order[n:], np.arange(n, padded))
    if n > 100:
        assert abs(np.corrcoef(order[:n], another[:n])[0, 1]) < 0.3
        assert abs(np.corrcoef(order[:n], np.arange(n))[0, 1]) < 0.3


def test_numpy_and_jax_agree():
    rng = np.random.default_rng(0)
    for made, features in ((network((50, 2)), 100), (network((9, 3)), 27), (MLP((8, 5)).build((30,), 3, rng), 30)):
        x = rng.uniform(-1, 1, (20, features))
        use = Plain(made, Scaling(-np.ones(1), np.ones(1)).scaler(features))
        on_jax = jax.tree.map(jnp.asarray, made)
        z = use.encode(x)
        assert z.dtype == np.float64
        assert_allclose(z, on_jax.encode(jnp.asarray(x)), atol=1e-4)
        assert_allclose(use.decode(z), on_jax.decode(jnp.asarray(z)), atol=1e-4)


@pytest.mark.parametrize("copies", [1, 5])
def test_distortion_agrees_with_its_twin(copies):
    rng = np.random.default_rng(0)
    x, z = (np.repeat(rng.normal(size=(8, d)), copies, axis=0) for d in (6, 2))
    padded = [np.concatenate([a, np.full((3, a.shape[1]), 7.0)]).astype(np.float32) for a in (x, z)]
    valid = jnp.arange(len(padded[0])) < len(x)
    assert_allclose(training.distortion(*map(jnp.asarray, padded), valid), naive.distortion(x, z), rtol=1e-3)
    gradient = jax.grad(lambda z: training.distortion(jnp.asarray(padded[0]), z, valid))(jnp.asarray(padded[1]))
    assert np.isfinite(gradient).all()
    assert not np.asarray(gradient)[len(x) :].any()


def test_distortion_does_not_depend_on_scale_or_rotation():
    x = np.random.default_rng(0).normal(size=(10, 2)).astype(np.float32)
    turned = 3 * x @ np.array([[0.6, -0.8], [0.8, 0.6]], np.float32)
    valid = jnp.ones(10, bool)
    assert training.distortion(jnp.asarray(x), jnp.asarray(turned), valid) < 1e-5
    assert training.distortion(jnp.asarray(x), jnp.asarray(turned * np.float32([1, 9])), valid) > 0.01


def test_learns_more_than_pca():
    """On throws it was not trained on, in two dimensions."""
    x, held_out = throws(1500), throws(500, 1)
    encoder = auroraqd.AutoEncoder(network="convolutional", random_state=0).fit(x)
    z = encoder.transform(held_out)
    assert z.shape == (500, 2)
    assert z.dtype == np.float64
    error = reconstruction_error(held_out, encoder.inverse_transform(z)).mean()
    flat = x.reshape(len(x), -1)
    pca = PCA(2).fit(flat)
    other = held_out.reshape(500, -1)
    assert error < 0.5 * reconstruction_error(other, pca.inverse_transform(pca.transform(other))).mean()
    assert encoder.validation_rmse_ < 0.04


def test_isometry_keeps_distances():
    x = throws(250)

    def distortion(isometry):
        encoder = auroraqd.AutoEncoder(
            network="convolutional", isometry=isometry, random_state=0, **{**SHORT, "max_epochs": 40}
        )
        z = encoder.fit(x).transform(x)[:100]
        return naive.distortion(scaled(x).reshape(len(x), -1)[:100], z)

    assert distortion(20.0) < 0.5 * distortion(0.0)


@pytest.mark.filterwarnings("ignore:the latent space of AutoEncoder has collapsed")  # of noise there is little to learn
@pytest.mark.parametrize("shape", [(100,), (50, 2), (5, 5, 4), (5, 2, 5, 2)])  # of as many entries: compiled once
def test_any_shape(shape):
    x = np.random.default_rng(0).integers(0, 255, (30, *shape)).astype(np.uint8)
    encoder = auroraqd.AutoEncoder(3, random_state=0, **SHORT).fit(x)
    assert encoder.transform(x).shape == (30, 3)
    assert encoder.inverse_transform(encoder.transform(x)).shape == (30, *shape)
    assert encoder.transform(x[:0]).shape == (0, 3)
    assert encoder.epochs_ == [6, 6]


def test_scalar_observations():
    x = np.linspace(3, 9, 30)
    encoder = auroraqd.AutoEncoder(1, random_state=0).fit(x)
    assert encoder.transform(x).shape == (30, 1)
    assert_allclose(encoder.inverse_transform(encoder.transform(x)), x, atol=0.5)


def test_scaling_is_its_own():
    x = throws(300)
    plain, stretched = (auroraqd.AutoEncoder(random_state=0, **SHORT).fit(v) for v in (scaled(x), x))
    assert_allclose(plain.transform(scaled(x)), stretched.transform(x), atol=1e-5)
    error = reconstruction_error(x, stretched.inverse_transform(stretched.transform(x)))
    assert error.mean() > 10  # metres


def test_deterministic_for_a_seed():
    x = throws(300)

    def fitted(seed):
        return auroraqd.AutoEncoder(random_state=seed, **SHORT).fit(x).transform(x)

    assert_array_equal(fitted(3), fitted(3))
    assert not np.array_equal(fitted(3), fitted(4))


def test_batches_of_any_size_agree():
    """To within what the archive takes for rounding: a copy must not pass for more novel."""
    x = throws(700)
    encoder = auroraqd.AutoEncoder(network="convolutional", random_state=0, **SHORT).fit(x)
    one_by_one = np.concatenate([encoder.transform(row[None]) for row in x[:50]])
    assert_allclose(encoder.transform(x)[:50], one_by_one, rtol=0, atol=1e-12)


def test_warm_start_goes_on():
    x = throws(300)
    warm, cold = (auroraqd.AutoEncoder(warm_start=w, random_state=0, **SHORT).fit(x) for w in (True, False))
    assert_array_equal(warm.transform(x), cold.transform(x))
    first = warm.training_rmse_
    assert warm.fit(x).training_rmse_ < first
    assert_allclose(cold.fit(x).training_rmse_, first)
    warm.fit(x.reshape(300, 25, 4))  # another shape: from the start
    assert warm.n_fits_ == 1


def test_changed_parameters_take_effect_at_the_next_fit():
    x = throws(300)
    encoder = auroraqd.AutoEncoder(random_state=0, **SHORT).fit(x)
    before = encoder.transform(x)
    encoder.set_params(n_components=3, hidden=(4,), network="convolutional")
    assert_array_equal(encoder.transform(x), before)
    assert encoder.fit(x).transform(x).shape == (300, 3)
    assert encoder.n_fits_ == 1  # another network: from the start


def test_early_stopping():
    x = np.random.default_rng(0).normal(size=(80, 40))  # nothing to be learned but noise
    encoder = auroraqd.AutoEncoder(split_above=10, patience=5, max_epochs=300, random_state=0, decay="none").fit(x)
    assert max(encoder.epochs_) < 300
    assert min(encoder.epochs_) >= 10


def test_the_lowest_validation_error_counts():
    x = np.random.default_rng(0).normal(size=(80, 40))
    options = {"split_above": 10, "random_state": 0, "decay": "none", "repeats": 1, "min_steps": 0, "warmup": 0.0}
    long, longer = (auroraqd.AutoEncoder(max_epochs=e, patience=1000, **options).fit(x) for e in (150, 600))
    assert_allclose(longer.transform(x), long.transform(x), atol=1e-4)  # the best came before, and was kept


@pytest.mark.parametrize("batch_size", [1, 64, 256, 5000, None])
def test_rows_are_filled_up_to_few_lengths(batch_size):
    found = {n: training._sizes(n, 100, batch_size) for n in range(1, 20_000, 7)}
    assert all(padded % size == 0 and padded >= n for n, (size, padded) in found.items())
    assert batch_size is None or len(set(found.values())) <= 3
    assert batch_size is None or len({found[n] for n in found if n <= 4096}) == 1
    assert training._sizes(3, 10**6, batch_size)[1] < 10_000  # long rows take memory


def test_rising_is_about_windows():
    def rising(values):
        return bool(training._rising(jnp.asarray(values, jnp.float32), jnp.asarray(len(values))))

    assert rising([1, 1, 1, 2])
    assert not rising([2, 1, 1, 1])
    assert not rising([1, 9, 1, 8])
    ring = jnp.asarray([3.0, 4.0, 1.0, 2.0])  # epochs 4, 5, 2, 3
    assert bool(training._rising(ring, jnp.asarray(6)))
    assert not bool(training._rising(ring, jnp.asarray(3)))  # too early


@pytest.mark.parametrize("first", [True, False])
def test_divergence_keeps_the_last_good_weights(first, monkeypatch):
    x, rates, really = throws(300), [], training.train
    monkeypatch.setattr(training, "train", lambda *given: rates.append(given[3].learning_rate) or really(*given))
    encoder = auroraqd.AutoEncoder(random_state=0, **SHORT)
    if not first:
        encoder.fit(x)
        before = encoder.transform(x)
    encoder.set_params(learning_rate=1e30, clip=0.0, decay="none")
    with pytest.warns(UserWarning, match="training of AutoEncoder diverged in repeat 1, epoch 1: the last good weights stay"):
        encoder.fit(x)
    assert_allclose(rates[-3:], [1e30, 2e29, 4e28])  # it was tried again twice before
    assert np.isfinite(encoder.transform(x)).all()
    if not first:
        assert_array_equal(encoder.transform(x), before)


def test_a_run_survives_divergence():
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, auroraqd.AutoEncoder(**SHORT), seed=0).run(task, generations=2)
    aurora._descriptor.source.set_params(learning_rate=1e30, clip=0.0, decay="none")
    aurora.schedule = auroraqd.Every(1)
    with pytest.warns(UserWarning, match="diverged"):
        aurora.run(task, generations=2)
    assert aurora.generation == 4
    assert len(aurora.archive) > 100


@pytest.mark.parametrize(
    ("x", "options", "message"),
    [
        (np.full((5, 4), np.nan), {}, "x must be finite"),
        (np.empty((0, 4)), {}, "with entries, got"),
        (np.zeros(4), {}, "n_components must be at most 1, the entries of an observation, got 2"),
        (np.zeros((5, 4)), {"hidden": 5}, r"hidden must be widths of layers like \(128, 64\), got 5"),
        (np.zeros((5, 4)), {"random_state": -1}, "random_state must be a whole number"),
        (np.zeros((5, 4)), {"max_epochs": 2**40}, "max_epochs must be a whole number"),
        ([["a", "b"]], {}, "numbers"),
        ([[1, 2], [3]], {}, "x must be numbers of shape"),
        (np.zeros((5, 4)), {"n_components": 5}, "n_components must be at most 4, the entries of an observation, got 5"),
        (np.zeros((5, 4)), {"n_components": 0}, "n_components must be a whole number"),
        (np.zeros((5, 4)), {"network": "transformer"}, "network must be one of"),
        (np.zeros((5, 8, 8, 3)), {"network": "convolutional"}, "is for time series"),
        (np.zeros((5, 600, 2)), {"network": "convolutional"}, "at most 1000 entries, got 600 steps of 2 channels"),
        (np.zeros((5, 4)), {"optimizer": "sgd"}, "optimizer must be one of adam, adagrad"),
        (np.zeros((5, 4)), {"validation": 1.0}, "validation must be"),
        (np.zeros((5, 4)), {"learning_rate": -1}, "learning_rate must be"),
        (np.zeros((5, 4)), {"hidden": (0,)}, "hidden must be"),
        (np.zeros((5, 4)), {"decay": "linear"}, "decay must be one of"),
    ],
)
def test_bad_arguments(x, options, message):
    with pytest.raises(ValueError, match=message):
        auroraqd.AutoEncoder(**options).fit(x)


def test_bad_rows_after_fitting():
    encoder = auroraqd.AutoEncoder(random_state=0, **SHORT)
    with pytest.raises(NotFittedError, match="call fit first"):
        encoder.transform(np.zeros((1, 6)))
    encoder.fit(np.linspace(-1, 1, 20)[:, None] * np.ones(6))
    with pytest.raises(ValueError, match=r"x must have shape \(n, 6\), as in fit, got \(2, 5\)"):
        encoder.transform(np.zeros((2, 5)))
    with pytest.raises(ValueError, match=r"z must have shape \(n, 2\), got \(1, 3\)"):
        encoder.inverse_transform(np.zeros((1, 3)))
    with pytest.raises(ValueError, match="z must be numbers, got 'x'"):
        encoder.inverse_transform("x")


@pytest.mark.parametrize("x", [np.zeros((20, 6)), np.ones((1, 6)), np.repeat([[1.0, 2, 3, 4, 5, 6]], 9, axis=0)])
def test_degenerate_rows_are_learned(x):
    """Constant columns scale to 0; one row is enough."""
    encoder = auroraqd.AutoEncoder(random_state=0, **SHORT).fit(x)
    assert_allclose(encoder.inverse_transform(encoder.transform(x)), x, atol=0.3)


def test_is_an_estimator():
    encoder = auroraqd.AutoEncoder.paper(3, max_epochs=2)
    twin = clone(encoder)
    assert twin.get_params() == encoder.get_params()
    assert (twin.optimizer, twin.learning_rate, twin.batch_size, twin.network) == ("adagrad", 0.1, None, "convolutional")
    fitted = auroraqd.AutoEncoder(random_state=0, **SHORT).fit(throws(100))
    assert_array_equal(copy.deepcopy(fitted).transform(throws(9)), fitted.transform(throws(9)))


def test_an_error_is_of_rows_held_back_or_called_another():
    """With 500 rows or fewer nothing is held back, and nobody knows the error on others."""
    x = throws(400)
    few, many = (auroraqd.AutoEncoder(random_state=0, split_above=above, **SHORT).fit(x) for above in (500, 100))
    assert np.isnan(few.validation_rmse_)
    assert 0 < many.validation_rmse_ < 2
    for encoder in (few, many):
        wrong = encoder.inverse_transform(encoder.transform(x)) - x
        assert_allclose(encoder.training_rmse_, np.sqrt(((2 * wrong / np.ptp(x, axis=(0, 1))) ** 2).mean()), rtol=1e-4)


def images_of_a_disc(n, size=24):
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:size, :size] / size
    centre = rng.random((n, 2, 1, 1))
    return (255 * (np.hypot(x - centre[:, 0], y - centre[:, 1]) < 0.08)).astype(np.uint8)[..., None]


def test_a_latent_space_that_has_collapsed_is_said():
    x = images_of_a_disc(60)
    with pytest.warns(UserWarning, match="the latent space of AutoEncoder has collapsed: .* hardly better than their mean"):
        auroraqd.AutoEncoder(network="mlp", random_state=0, learning_rate=1e-6, **SHORT).fit(x)


def test_the_papers_protocol_trains():
    x = throws(400)
    encoder = auroraqd.AutoEncoder.paper(max_epochs=60, repeats=2, random_state=0, split_above=0).fit(x)
    assert encoder.epochs_ == [60, 60]
    assert encoder.validation_rmse_ < 0.5 * scaled(x).std()


def test_progress_is_reported(capsys):
    seen = []
    with autoencoder.listening(seen.append):
        auroraqd.AutoEncoder(random_state=0, **SHORT).fit(throws(100))
    assert seen[-1][:4] == (2, 2, 6, 6)
    assert 0 < seen[-1].error < 2
    auroraqd.AutoEncoder(random_state=0, verbose=True, **SHORT).fit(throws(100))
    auroraqd.AutoEncoder(random_state=0, verbose=True, split_above=50, **SHORT).fit(throws(100))
    told = capsys.readouterr().out
    assert "repeat 2/2, epoch 6/6, training RMSE 0." in told
    assert "repeat 2/2, epoch 6/6, validation RMSE 0." in told
    assert len(seen) < 100  # not after each epoch


def test_ctrl_c_during_training_leaves_a_run_whole():
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, auroraqd.AutoEncoder(**SHORT), seed=0, schedule=auroraqd.Every(3)).run(task, generations=3)
    ids = aurora.archive.id.tolist()

    def interrupt(progress):
        raise KeyboardInterrupt

    with autoencoder.listening(interrupt), pytest.raises(KeyboardInterrupt):
        aurora.run(task, generations=1)
    assert aurora.generation == 3
    assert aurora.archive.id.tolist() == ids
    aurora.run(task, generations=2)
    whole = auroraqd.Aurora(2, auroraqd.AutoEncoder(**SHORT), seed=0, schedule=auroraqd.Every(3)).run(task, generations=5)
    assert_array_equal(aurora.archive.descriptor, whole.archive.descriptor)


def test_runs_with_aurora_and_comes_back_from_disk(tmp_path):
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, auroraqd.AutoEncoder(**SHORT), seed=0, schedule=auroraqd.Every(2))
    aurora.run(task, generations=5)
    archive = aurora.archive
    assert aurora.descriptor.source.n_fits_ == 3  # the weights are kept over refits
    assert archive.reconstruction_error is not None
    assert_allclose(
        reconstruction_error(archive.observation, aurora.reconstruct(archive.descriptor)).mean(),
        archive.reconstruction_error.mean() * 1000,
        rtol=0.95,  # metres are not scaled
    )
    with warnings.catch_warnings(action="error"):
        repertoire = auroraqd.load(auroraqd.save(aurora, tmp_path))
        assert_allclose(repertoire.describe(archive.observation), archive.descriptor, atol=1e-12)
    assert_array_equal(repertoire.reconstruct(archive.descriptor), aurora.reconstruct(archive.descriptor))
    again = auroraqd.Aurora(2, auroraqd.AutoEncoder(**SHORT), seed=0, schedule=auroraqd.Every(2)).run(task, generations=5)
    assert_array_equal(again.archive.descriptor, archive.descriptor)


def test_images_given_to_the_network_for_trajectories():
    aurora = auroraqd.Aurora(2, auroraqd.AutoEncoder(network="convolutional"), seed=0)
    ended = pytest.raises(auroraqd.DescriptorError, match=r"network 'convolutional' is for time series.*\(n, steps, channels\)")
    with ended:  # by its first fit: others will be no time series either
        aurora.run(lambda g: (g[:, 0], np.repeat(g[:, :1], 192, axis=1).reshape(-1, 8, 8, 3)), generations=20)
    assert aurora.generation == 0
    assert aurora.pending is not None
