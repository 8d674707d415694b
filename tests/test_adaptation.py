import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import Adaptation


def grid(n=30):
    """Skills on a grid of two dimensions, (n n, 2)."""
    return np.stack(np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)), axis=2).reshape(-1, 2)


def matern(a, b, length):
    """The kernel as the literature writes it, one pair at a time."""
    k = np.empty((len(a), len(b)))
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            r = np.sqrt(5) * np.sqrt(((x - y) ** 2).sum()) / length
            k[i, j] = (1 + r + r * r / 3) * np.exp(-r)
    return k


def test_the_best_promise_is_tried_first():
    promise = np.array([0.3, 0.9, 0.5])
    assert Adaptation(np.eye(3), promise).ask() == 1
    outcomes = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
    assert Adaptation(np.eye(3), outcomes, goal=(2, 2)).ask() == 2


def test_prediction_is_the_posterior_of_the_textbook():
    rng = np.random.default_rng(0)
    space, promise = rng.normal(size=(40, 3)) * (1, 10, 0.1), rng.normal(size=40)
    adaptation = Adaptation(space, promise, length=0.5, scale=2.0, noise=0.1)
    rows, told = [3, 17, 30], np.array([1.0, -2.0, 0.5])
    for row, value in zip(rows, told, strict=True):
        adaptation.tell(row, value)
    x = space / space.std(axis=0) / np.sqrt(3)
    inverse = np.linalg.inv(matern(x[rows], x[rows], 0.5) + 0.01 * np.eye(3))
    across = matern(x, x[rows], 0.5)
    mean, deviation = adaptation.predict()
    assert_allclose(mean, promise + across @ inverse @ (told - promise[rows]), atol=1e-9)
    assert_allclose(deviation, 2 * np.sqrt(1 - np.einsum("ij,jk,ik->i", across, inverse, across)), atol=1e-7)
    bound = mean + 0.85 * deviation
    bound[rows] = -np.inf
    assert adaptation.ask() == bound.argmax()


def test_a_failed_promise_casts_doubt_on_its_neighbours():
    space = grid()
    promise = -np.abs(space - 0.2).sum(axis=1)  # the best are about (0.2, 0.2), where all fails
    adaptation = Adaptation(space, promise, kappa=0.1)
    first = adaptation.ask()
    adaptation.tell(first, -5.0)
    assert np.linalg.norm(space[adaptation.ask()] - space[first]) > 0.1


def test_performance_is_recovered_where_one_half_is_broken():
    space = grid()
    promise = 1 - ((space - (0.25, 0.5)) ** 2).sum(axis=1)
    truth = np.where(space[:, 0] < 0.5, 0.0, promise)
    adaptation = Adaptation(space, promise, kappa=0.1)
    for _ in range(12):
        row = adaptation.ask()
        adaptation.tell(row, truth[row])
    best = adaptation.best
    assert best is not None
    assert truth[best.row] == best.performance > 0.9 * truth.max()
    in_order = np.argsort(-promise, kind="stable")[:12]
    assert truth[in_order].max() == 0


def test_a_shift_of_outcomes_is_learned():
    """Everything ends 0.3 to the right: the skill that was made for the place 0.3 to the left is what is wanted."""
    outcome, goal = grid(), np.array([0.7, 0.5])
    adaptation = Adaptation(outcome, outcome, goal)
    for _ in range(6):
        row = adaptation.ask()
        adaptation.tell(row, outcome[row] + (0.3, 0.0))
    best = adaptation.best
    assert best is not None
    assert best.performance > -0.05
    assert_allclose(outcome[best.row], (0.4, 0.5), atol=0.05)


def test_each_skill_is_tried_once():
    space = grid(4)
    adaptation = Adaptation(space, space[:, 0])
    rows = []
    for _ in range(16):
        rows.append(adaptation.ask())
        assert adaptation.ask() == rows[-1]  # asked twice, answered the same
        adaptation.tell(rows[-1], 0.0)
    assert sorted(rows) == list(range(16))
    assert adaptation.expected == -np.inf
    with pytest.raises(RuntimeError, match="all 16 skills"):
        adaptation.ask()


def test_a_failed_trial_teaches_nothing_but_is_not_repeated():
    promise = np.array([0.3, 0.9, 0.5])
    adaptation = Adaptation(np.eye(3), promise)
    adaptation.tell(1, np.nan)
    assert adaptation.best is None
    assert adaptation.ask() == 2
    assert_array_equal(adaptation.predict()[0], promise)


def test_when_to_stop():
    promise = np.array([1.0, 0.9, 0.2])
    adaptation = Adaptation(100 * np.eye(3), promise, length=0.01)
    assert adaptation.expected == 1.0
    adaptation.tell(0, 0.5)
    assert adaptation.best == (0, 0.5)
    assert_allclose(adaptation.expected, 0.9)
    adaptation.tell(1, 0.8)
    assert adaptation.best == (1, 0.8)
    assert adaptation.best.performance >= adaptation.expected == 0.2


def test_scaling_of_space_is_of_no_account():
    rng = np.random.default_rng(1)
    space, promise = rng.normal(size=(50, 2)), rng.normal(size=50)
    rows = []
    for scaled in (space, space * (1000, 0.001) + 5, np.hstack([space, np.ones((50, 0))])):
        adaptation, tried = Adaptation(scaled, promise), []
        for _ in range(10):
            tried.append(adaptation.ask())
            adaptation.tell(tried[-1], -1.0)
        rows.append(tried)
    assert rows[0] == rows[1] == rows[2]


def test_a_constant_column_is_no_harm():
    adaptation = Adaptation(np.ones((3, 1)), np.ones(3))
    adaptation.tell(0, 0.0)
    assert_allclose(adaptation.predict()[0], 0, atol=0.02)  # all are the same skill


def test_each_outcome_is_predicted_as_if_it_were_alone():
    rng = np.random.default_rng(2)
    space, outcome = rng.normal(size=(30, 2)), rng.normal(size=(30, 2)) * (1, 5)
    goal = np.array([0.5, -1.0])
    together = Adaptation(space, outcome, goal)
    alone = [Adaptation(space, outcome[:, column]) for column in range(2)]
    for row in (2, 9, 20):
        told = rng.normal(size=2)
        together.tell(row, told)
        for column in range(2):
            alone[column].tell(row, told[column])
    (x, dx), (y, dy) = (one.predict() for one in alone)
    expected, deviation = together.predict()
    assert_allclose(deviation, np.hypot(dx, dy))
    assert_allclose(expected**2, (x - 0.5) ** 2 + (y + 1) ** 2 + dx**2 + dy**2)


def test_several_promises_are_weighed_as_the_textbook_says():
    rng = np.random.default_rng(0)
    space, promises = rng.normal(size=(40, 3)), rng.normal(size=(4, 40))
    adaptation = Adaptation(space, promises, length=0.5, scale=2.0, noise=0.1)
    assert_allclose(adaptation.posterior, 0.25)
    rows, told = [3, 17, 30], promises[2, [3, 17, 30]] + 0.3
    for row, value in zip(rows, told, strict=True):
        adaptation.tell(row, value)
    x = space / space.std(axis=0) / np.sqrt(3)
    inside = matern(x[rows], x[rows], 0.5) + 0.01 * np.eye(3)
    across = matern(x, x[rows], 0.5)
    likelihood = [multivariate_normal(promise[rows], 4 * inside).pdf(told) for promise in promises]
    expected = np.array(likelihood) / sum(likelihood)
    assert_allclose(adaptation.posterior, expected, atol=1e-9)
    means = np.array([promise + across @ np.linalg.solve(inside, told - promise[rows]) for promise in promises])
    variance = 4 * (1 - np.einsum("ij,ij->i", across, np.linalg.solve(inside, across.T).T))
    mean, deviation = adaptation.predict()
    assert_allclose(mean, expected @ means, atol=1e-9)
    assert_allclose(deviation**2, variance + expected @ (means - expected @ means) ** 2, atol=1e-7)


@pytest.mark.parametrize("goal", [None, (0.5, -1.0)])
def test_copies_of_a_promise_are_one(goal):
    rng = np.random.default_rng(1)
    space, promise = rng.normal(size=(30, 2)), rng.normal(size=(30,) if goal is None else (30, 2))
    one, copies = Adaptation(space, promise, goal), Adaptation(space, [promise] * 3, goal)
    for _ in range(5):
        row, told = one.ask(), rng.normal(size=np.shape(promise)[1:])
        assert copies.ask() == row
        for adaptation in (one, copies):
            adaptation.tell(row, told)
        assert_allclose(one.predict(), copies.predict(), atol=1e-9)
    assert_allclose(copies.posterior, 1 / 3)
    assert_array_equal(one.posterior, [1])


def test_the_robot_that_it_is_is_found():
    """Four robots for which another place is good; this one is like the third."""
    space = grid()
    places = np.array([[0.2, 0.2], [0.2, 0.8], [0.8, 0.2], [0.8, 0.8]])
    promises = -np.linalg.norm(space - places[:, None], axis=2)
    adaptation = Adaptation(space, promises, scale=0.1)
    for _ in range(3):
        row = adaptation.ask()
        adaptation.tell(row, -np.linalg.norm(space[row] - (0.78, 0.22)))
    assert adaptation.posterior[2] > 0.95
    assert adaptation.best is not None
    assert adaptation.best.performance > -0.1


def test_a_repertoire_is_adapted():
    task = auroraqd.tasks.Ballistic()
    repertoire = auroraqd.Aurora(2, PCA(2), seed=0).run(task, generations=5).archive
    promise = repertoire.observation[:, -1]
    goal = np.median(promise, axis=0)
    adaptation = Adaptation(repertoire.descriptor, promise, goal)
    for _ in range(5):
        row = adaptation.ask()
        weaker = repertoire.genotype[row : row + 1] * (1.0, 0.9)
        adaptation.tell(row, task(weaker).observation[0, -1])
    best = adaptation.best
    assert best is not None
    assert np.isfinite(best.performance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"space": np.zeros(3)}, "space must have shape"),
        ({"space": np.zeros((0, 2))}, "space must have shape"),
        ({"promise": np.zeros(2)}, r"promise must have shape \(3,\) or \(priors, 3\), got \(2,\)"),
        ({"promise": np.zeros((3, 2))}, r"promise must have shape \(3,\) or \(priors, 3\), got \(3, 2\)"),
        ({"promise": np.zeros((2, 3, 1))}, r"promise must have shape \(3,\) or \(priors, 3\), got \(2, 3, 1\)"),
        ({"promise": 0.0}, r"promise must have shape \(3,\) or \(priors, 3\), got \(\)"),
        ({"promise": np.zeros((0, 3))}, r"promise must have entries, got shape \(0, 3\)"),
        ({"promise": np.zeros((3, 0)), "goal": ()}, r"promise must have entries, got shape \(3, 0\)"),
        (
            {"goal": (0, 0)},
            r"promise must have shape \(3, m\) or \(priors, 3, m\), for there is a goal, got \(3,\)",
        ),
        ({"promise": np.zeros((3, 2)), "goal": (0, 0, 0)}, "goal must be 2 finite numbers"),
        ({"promise": np.zeros((3, 2)), "goal": (0, np.nan)}, "goal must be 2 finite numbers"),
        ({"promise": [0, 1, np.nan]}, "must be finite"),
        ({"kappa": -1}, "kappa must be"),
        ({"length": 0}, "length must be"),
        ({"noise": 0}, "noise must be"),
        ({"scale": 0.0}, "scale must be one positive number"),
        ({"scale": [1.0, 1.0]}, "scale must be one positive number, or 1"),
        ({"scale": np.inf}, "scale must be one positive number"),
        ({"scale": 1e-308}, r"scale must be one positive number, or 1, from 1e-50 to 1e\+50, got 1e-308"),
        ({"scale": "wide"}, "scale must be numbers, got 'wide'"),
        ({"space": [[1], [1, 2]]}, r"space must be numbers of shape \(n, d\), got \[\[1\], \[1, 2\]\]"),
        ({"space": 1e160 * np.eye(3)}, r"space must be finite, and at most 1e\+50 in size, got 1e\+160"),
        ({"promise": [1e308, -1e308, 0]}, r"promise must be finite, and at most 1e\+50 in size, got 1e\+308"),
        ({"promise": ["a", "b", "c"]}, r"promise must be numbers, got \['a', 'b', 'c'\]"),
        ({"promise": np.zeros((3, 2)), "goal": (1e200, 0)}, r"goal must be finite, and at most 1e\+50 in size, got 1e\+200"),
        ({"promise": np.zeros((3, 2)), "goal": "home"}, "goal must be numbers, got 'home'"),
        ({"kappa": 1e308}, r"kappa must be a finite number, from 0 to 1e\+50, got 1e\+308"),
        ({"length": 1e308}, r"length must be a finite number, from 1e-6 to 1e\+50, got 1e\+308"),
        ({"noise": 1e308}, r"noise must be a finite number, from 1e-4, .*, to 1e\+50, got 1e\+308"),
    ],
)
def test_arguments_out_of_range(change, message):
    with pytest.raises(ValueError, match=message):
        Adaptation(**({"space": np.eye(3), "promise": np.zeros(3)} | change))


def test_what_is_told_is_checked():
    adaptation = Adaptation(np.eye(3), np.zeros((3, 2)), goal=(0, 0))
    for row, outcome, message in (
        (3, (0, 0), "row must be"),
        (-1, (0, 0), "row must be"),
        (0, 0.5, "outcome must be 2 numbers, as promised"),
        (0, (0, np.inf), r"finite and at most 1e\+50 in size, or NaN for a trial that failed, got \(0, inf\)"),
        (0, (0, 1e308), r"finite and at most 1e\+50 in size, or NaN for a trial that failed, got \(0, 1e\+308\)"),
        (0, None, "outcome must be 2 numbers, .* got None"),
        (0, ("far", "away"), r"outcome must be 2 numbers, .* got \('far', 'away'\)"),
    ):
        with pytest.raises(ValueError, match=message):
            adaptation.tell(row, outcome)
    assert adaptation.best is None


@pytest.mark.parametrize("size", [1e-300, 1e-51, 1e-49, 1e49])
def test_numbers_of_any_size_that_is_allowed_neither_overflow_nor_vanish(size):
    """Warnings are errors here."""
    promise = size * np.random.default_rng(0).random((5, 2))
    for adaptation in (
        Adaptation(promise, promise, goal=promise[0]),
        Adaptation(promise, promise, goal=promise[0], scale=1e-50),
        Adaptation(promise, [promise, promise[::-1]], goal=promise[0]),
        Adaptation(promise, [promise, promise[::-1]], goal=promise[0], scale=1e-50),
    ):
        for outcome in ((1e50, -1e50), (0, 0), (-1e50, size)):
            adaptation.tell(adaptation.ask(), outcome)
        assert np.isfinite(adaptation.predict()).all()
        assert np.isfinite(adaptation.expected)
        assert adaptation.best is not None


def test_arrays_may_be_used_again():
    promise, told = np.eye(3), np.zeros(3)
    adaptation = Adaptation(np.eye(3), promise, goal=(0, 0, 0))
    promise[:], told[0] = 7.0, 1.0
    adaptation.tell(1, told)
    told[0] = 0.1
    adaptation.tell(2, told)
    assert adaptation.best == (2, -0.1)
    told[0] = 9.0
    assert adaptation.best == (2, -0.1)


def test_a_failure_is_one_nan_or_all():
    promise = np.random.default_rng(0).random((5, 2))
    for failure in (np.nan, [np.nan, np.nan], [np.nan, 1.0]):
        adaptation = Adaptation(promise, promise, goal=[0.5, 0.5])
        row = adaptation.ask()
        adaptation.tell(row, failure)
        assert adaptation.best is None
        assert adaptation.ask() != row


def test_a_constant_promise_leaves_all_to_learn():
    """The standard deviation of equal numbers is not always 0."""
    space = np.random.default_rng(0).random((1000, 2))
    adaptation = Adaptation(space, np.full(1000, 0.1))
    adaptation.tell(0, 0.2)
    assert adaptation.predict()[1].max() > 0.5
