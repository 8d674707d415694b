"""Run by `pytest`. Add what you know about your robot."""

import numpy as np
from my_task import GENES, my_task, simulate
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.testing import check_task


def test_it_keeps_what_tasks_promise():
    check_task(my_task)


def test_a_cart_with_equal_wheels_goes_straight_on():
    ways = simulate(np.array([[1.0, 1.0, 1.0, 1.0], [0.5, 0.5, -0.5, -0.5]]))
    np.testing.assert_allclose(ways[:, -1], [[4.0, 0.0], [0.0, 0.0]], atol=1e-12)


def test_a_cart_that_leaves_the_room_has_failed():
    genotypes = GENES.unscale([[1.0, 1.0, 1.0, 1.0], [0.5, 0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(np.isnan(my_task(genotypes).fitness), [True, False])


def test_skills_are_found():
    aurora = auroraqd.Aurora(my_task.n_genes, PCA(n_components=2), seed=0, batch_size=50)
    aurora.run(my_task, generations=5)
    assert len(aurora.archive) > 50
