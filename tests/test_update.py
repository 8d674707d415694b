"""No update of the descriptor ends a run, or destroys what was found."""

import copy
import json
import re
import warnings

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import auroraqd
from auroraqd import Aurora
from auroraqd.control.update import Attempts
from auroraqd.runs import folders

COLUMNS = ("genotype", "fitness", "observation", "descriptor", "reconstruction_error", "curiosity", "id")


def plane(genotypes):
    """Three steps in the plane, all of them told by two genes."""
    return np.stack([genotypes[:, :2] * step for step in (1, 2, 3)], axis=1)


class FirstTwo:
    """The two numbers that tell it all; from its second fit on, whatever `then` makes of them."""

    natural_shape = True

    def __init__(self, then=None, good=1):
        self.then, self.good, self.fits = then, good, 0

    def fit(self, x):
        self.fits += 1
        if self.fits > self.good and self.then is None:
            raise RuntimeError("the licence has expired")
        return self

    def transform(self, x):
        z = np.array(x[:, 0], float)
        return z if self.fits <= self.good else self.then(z)


def quartered(z):
    """Four places for all."""
    return np.sign(z + 2 / 3)


def found(aurora):
    return {name: copy.copy(getattr(aurora.archive, name)) for name in COLUMNS}


def assert_still_there(aurora, before):
    rows = aurora.archive.rows_of(before["id"])
    assert (rows >= 0).mean() > 0.7  # some are replaced as time goes on
    assert len(aurora.archive) >= len(rows)
    for name in ("genotype", "descriptor"):
        assert_array_equal(getattr(aurora.archive, name)[rows[rows >= 0]], before[name][rows >= 0])


BAD = {
    "raises": (None, "FirstTwo could not be fitted on .*: the licence has expired"),
    "collapses": (
        np.zeros_like,
        r"the transform of FirstTwo \(on [\d,]+ observations\) maps all [\d,]+ individuals to one point",
    ),
    "flattens": (lambda z: z * [1, 1e-13], "has no spread in dimension 2, in which individuals differed before"),
    "not finite": (lambda z: z * [1, np.nan], "gave a NaN or an infinity for individuals that are stored"),
    "wrong shape": (lambda z: z[:, 0], "must return shape"),
    "crowds": (quartered, "only 4 of [0-9,]+ individuals would survive, fewer than survival=0.25 allows"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_update_is_refused_and_said_and_the_run_goes_on(kind):
    then, message = BAD[kind]
    aurora = Aurora(2, FirstTwo(then), seed=0, batch_size=40, schedule=auroraqd.Every(5)).run(plane, generations=5)
    before = found(aurora)
    assert len(before["id"]) > 100
    pattern = (
        f"no update of the descriptor at generation 5: .*{message}.*the descriptor before it stays, and it is tried again at "
        "generation 6"
    )
    with pytest.warns(UserWarning, match=pattern):
        aurora.run(plane, generations=1)
    assert_still_there(aurora, before)
    assert aurora.history.last.refused == 1
    with pytest.warns(UserWarning, match="tried again"):
        aurora.run(plane, generations=3)
    refused = aurora.history.column("refused")
    assert_array_equal(np.flatnonzero(np.diff(refused)) + 1, [5, 6, 8])  # after 1 and 2 generations
    assert_still_there(aurora, before)


@pytest.mark.parametrize("archive", [None, auroraqd.GridArchive((12, 12)), auroraqd.UnstructuredArchive(competition="elitist")])
def test_every_archive_keeps_what_an_update_would_destroy(archive):
    options = {} if isinstance(archive, auroraqd.GridArchive) else {"resolution": auroraqd.Fixed(0.05)}
    aurora = Aurora(2, FirstTwo(quartered), seed=0, batch_size=40, schedule=auroraqd.Every(5), archive=archive, **options)
    aurora.run(plane, generations=5)
    before = found(aurora)
    with pytest.warns(UserWarning, match="would survive"):
        aurora.run(plane, generations=1)
    assert_still_there(aurora, before)
    assert getattr(aurora.archive, "l", 0.05) == 0.05
    status = aurora.archive.add(**{name: before[name] for name in ("genotype", "fitness", "observation", "descriptor")})
    assert (status == 0).mean() > 0.5  # the index is whole: copies are recognised


def test_survival_can_be_switched_off():
    aurora = Aurora(2, FirstTwo(quartered), seed=0, batch_size=40, schedule=auroraqd.Every(5), survival=0).run(
        plane, generations=6
    )
    assert aurora.history.last.refused == 0
    assert aurora.history.last.size < 60


@pytest.mark.parametrize("survival", [-0.1, 1.1, np.nan, "half"])
def test_survival_is_a_share(survival):
    with pytest.raises(ValueError, match="survival must be a finite number, a share, from 0 to 1"):
        Aurora(2, "genotype", survival=survival)


def test_an_update_that_succeeds_again_is_taken():
    class Recovering(FirstTwo):
        def fit(self, x):
            self.fits += 1
            if self.fits in (2, 3):
                raise RuntimeError("no")
            return self

        def transform(self, x):
            return x[:, 0] * (1 if self.fits == 1 else 2)

    class Shared(Recovering):
        counter = [0]

        def fit(self, x):
            self.counter[0] += 1
            self.fits = self.counter[0] - 1
            return super().fit(x)

        def __deepcopy__(self, memo):
            return Shared()

    Shared.counter[0] = 0
    aurora = Aurora(2, Shared(), seed=0, batch_size=40, schedule=auroraqd.Every(5)).run(plane, generations=5)
    scale = np.abs(aurora.archive.descriptor).max()
    with pytest.warns(UserWarning, match="no update"):
        aurora.run(plane, generations=3)
    assert np.abs(aurora.archive.descriptor).max() <= 1.01 * scale
    aurora.run(plane, generations=1)  # generation 8: 5, 6, then 8
    assert np.abs(aurora.archive.descriptor).max() > 1.5 * scale
    assert aurora._attempts == Attempts()
    assert aurora.history.last.refused == 2


@pytest.mark.filterwarnings("ignore:no update of the descriptor")
def test_a_run_with_refused_updates_is_resumed_bit_for_bit(tmp_path):
    """PCA of an estimator that is saved by skops: what makes it fail is in its parameters."""

    def fresh():
        encoder = make_pipeline(StandardScaler(), PCA(n_components=2))
        return Aurora(2, encoder, seed=0, batch_size=30, schedule=auroraqd.Every(4), survival=1.0)

    whole = fresh().run(plane, generations=30)
    assert whole.history.last.refused > 2
    parts = fresh().run(plane, generations=9)
    auroraqd.save(parts, tmp_path)
    resumed = auroraqd.resume(tmp_path).run(plane, generations=21)
    for name in COLUMNS:
        assert_array_equal(getattr(resumed.archive, name), getattr(whole.archive, name))
    strip = [record._replace(seconds=0) for record in whole.history.records]
    assert repr([record._replace(seconds=0) for record in resumed.history.records]) == repr(strip)
    assert folders.load_history(auroraqd.save(whole, tmp_path / "whole"))[-1].refused == whole.history.last.refused


def test_individuals_wait_for_a_first_fit_over_a_checkpoint(tmp_path):
    def still(genotypes):
        return np.ones((len(genotypes), 3, 2))

    aurora = Aurora(2, PCA(n_components=2), seed=0, batch_size=20)
    with pytest.warns(UserWarning, match="individuals wait"):
        aurora.run(still, generations=4)
    auroraqd.save(aurora, tmp_path)
    assert json.loads((tmp_path / "config.json").read_text())["survival"] == 0.25
    resumed = auroraqd.resume(tmp_path)
    with (
        pytest.warns(UserWarning, match="individuals wait"),
        pytest.raises(auroraqd.DescriptorError, match="tried 10 times before"),
    ):
        resumed.run(still, generations=20)
    assert resumed.generation == 10
    assert len(resumed.archive) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 0.0, "x", None])
def test_l_is_never_worthless_by_an_update(value):
    given = iter([0.05, value])
    aurora = Aurora(2, "genotype", seed=0, batch_size=40, schedule=auroraqd.Every(5), resolution=lambda z: next(given, 0.04))
    aurora.run(plane, generations=5)
    with pytest.warns(UserWarning, match="for the distance threshold l, which must be a finite number above 0"):
        aurora.run(plane, generations=1)
    assert aurora.archive.l == 0.05
    aurora.run(plane, generations=1)  # tried again
    assert aurora.archive.l == 0.04


def test_l_of_one_individual_waits_for_a_second():
    aurora = Aurora(2, "genotype", seed=0, batch_size=1).run(plane, generations=1)
    assert aurora.archive.l == 0
    aurora.run(plane, generations=2)  # in the last, two are stored
    assert aurora.archive.l > 0


def blown_up(genotypes):
    """A simulation that has blown up for one of the individuals of generation 3."""
    observation = plane(genotypes)
    blown_up.calls += 1
    if blown_up.calls == 4:
        observation[7, 2, 1] = 1e6
    return observation


def test_one_outlier_does_not_decide_for_all():
    def grown(robust):
        blown_up.calls = 0
        options = {"schedule": auroraqd.Every(10), "batch_size": 100, "robust": robust, "survival": 0}
        resolution = auroraqd.VAT(2000, robust=robust)
        return Aurora(2, PCA(n_components=2), seed=0, resolution=resolution, **options).run(blown_up, generations=20)

    with pytest.warns(UserWarning, match="lies far outside") as warned:
        aurora = grown(True)
    told = [str(warning.message) for warning in warned]
    outlier = aurora.archive.id[(aurora.archive.observation == 1e6).any(axis=(1, 2))]
    assert len(outlier) == 1
    wanted = r"1 of [0-9,]+ observations lies far outside the others, .* up to 1e\+06, .*: evaluation 307"
    assert any(re.search(wanted, text) for text in told), told
    assert len(aurora.archive) > 400
    assert len(grown(False).archive) < 50  # by the rule of the paper


def test_many_that_blow_up_are_said():
    def task(genotypes):
        observation = plane(genotypes)
        observation[genotypes[:, 0] > 0.9] *= 1e6
        return observation

    wanted = (
        r"of 200 observations have entries up to .*e\+06, ten thousand times as far out as three quarters .*NaN for them: eval"
    )
    with pytest.warns(UserWarning, match=wanted):
        Aurora(2, PCA(n_components=2), seed=0).run(task, generations=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # by the rule of the paper nobody looks
        Aurora(2, PCA(n_components=2), seed=0, robust=False, resolution=auroraqd.VAT(robust=False)).run(task, generations=1)


@pytest.mark.filterwarnings("ignore:.* far outside the others", "ignore:no update of the descriptor")
@pytest.mark.parametrize("resumed", [False, True])
def test_simulations_that_blow_up_do_not_breed(tmp_path, resumed):
    def task(genotypes):
        observation = plane(genotypes)
        bad = genotypes[:, 0] > 0.97
        observation[bad] *= 1e6 * (1 + genotypes[bad, 1, None, None])
        return observation

    def grown(robust):
        def run(aurora, generations):
            return aurora.run(task, generations=generations, initial=first if generations == 1 else None)

        first = 0.9 * np.random.default_rng(0).random((100, 2))
        options = {"schedule": auroraqd.Every(20), "batch_size": 100, "robust": robust, "survival": 0}
        aurora = run(Aurora(2, PCA(n_components=2), seed=0, resolution=auroraqd.VAT(1000, robust=robust), **options), 1)
        if resumed:
            auroraqd.save(aurora, tmp_path / str(robust))
            aurora = auroraqd.resume(tmp_path / str(robust))
        archive = run(aurora, 60).archive
        return len(archive), np.count_nonzero(archive.genotype[:, 0] > 0.97)

    stored, bad = grown(True)
    assert stored > 300
    assert bad < 30
    stored, bad = grown(False)
    assert stored - bad < 10  # what was found is lost


@pytest.mark.filterwarnings("ignore:.*descriptors lies far outside")
def test_the_first_batch_may_hold_an_outlier():
    calls = []

    def task(genotypes):
        observation = plane(genotypes)
        if not calls:
            observation[17] *= 1e5
        calls.append(len(genotypes))
        return observation

    with pytest.warns(UserWarning, match=r"1 of 200 observations lies far outside the others, .*: evaluation 17"):
        aurora = Aurora(2, PCA(n_components=2), seed=1, resolution=auroraqd.VAT(500)).run(task, generations=30)
    assert len(aurora.archive) > 200


class Halting:
    """Fails to transform, or has a broken inverse."""

    def fit(self, x):
        return self

    def transform(self, x):
        return x[:, :2]

    def inverse_transform(self, z):
        raise ValueError("singular matrix")


def test_an_inverse_that_does_not_work_is_said():
    with pytest.warns(UserWarning, match="the inverse_transform of Halting does not work, .*: ValueError: singular matrix"):
        aurora = Aurora(2, Halting(), seed=0).run(plane, generations=2)
    assert aurora.archive.reconstruction_error is None


def test_errors_of_new_individuals_are_recorded():
    aurora = Aurora(2, PCA(n_components=1), seed=0, batch_size=50).run(plane, generations=10)
    errors = aurora.history.column("rmse_new")
    assert np.isnan(errors[0])  # the descriptor was fitted on them
    assert (errors[1:] > 0).all()
    assert aurora.history.last.rmse == pytest.approx(aurora.archive.reconstruction_error.mean())


def test_all_seeds_of_air_hockey_start():
    """LAPACK's divide and conquer gives up on some of these: four of five observations are the same."""
    for threshold in (0.0, 1.0):
        task = auroraqd.tasks.AirHockey(restitution_threshold=threshold)
        for seed in range(40):
            aurora = Aurora(8, PCA(n_components=2), seed=seed).run(task, generations=1)
            assert len(aurora.archive) > 10
            assert aurora.descriptor.source.svd_solver == "auto"
            assert aurora.history.last.refused == 0


def test_a_solver_that_does_not_converge_is_replaced(monkeypatch):
    fit = PCA.fit

    def failing(self, x, y=None):
        if self.svd_solver != "covariance_eigh":
            raise np.linalg.LinAlgError("SVD did not converge")
        return fit(self, x, y)

    monkeypatch.setattr(PCA, "fit", failing)
    for encoder in (PCA(n_components=2), make_pipeline(StandardScaler(), PCA(n_components=2))):
        with pytest.warns(
            UserWarning, match="PCA could not be fitted by scikit-learn's default solver .*; by 'covariance_eigh' it was"
        ):
            aurora = Aurora(2, encoder, seed=0).run(plane, generations=2)
        assert len(aurora.archive) > 100
    with pytest.warns(UserWarning, match="no update .* SVD did not converge"):  # it was asked for
        Aurora(2, PCA(n_components=2, svd_solver="full"), seed=0).run(plane, generations=1)
