import inspect

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.descriptors.scaling import Scaling
from auroraqd.tasks import Ballistic, Genes


def saved(folder, descriptor):
    task = Ballistic()
    auroraqd.save(auroraqd.Aurora(task.n_genes, descriptor, seed=0).run(task, generations=5), folder)
    return auroraqd.load(folder)


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("learned") / "run", PCA(2))


@pytest.fixture(scope="module")
def coded(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("coded") / "run", "hand-coded")


def test_a_stored_outcome_is_reached(learned, coded):
    for repertoire in (learned, coded):
        for row in (0, len(repertoire) - 1):
            found = repertoire.reach(repertoire.observation[row], k=3)
            assert found.rows[0] == row
            assert found.distance[0] < 1e-9
            assert (np.diff(found.distance) >= 0).all()
            assert_array_equal(found.genotype, repertoire.genotype[found.rows])
            assert_array_equal(found.observation, repertoire.observation[found.rows])
    assert coded.reach(coded.observation[0]).reconstruction is None
    found = learned.reach(learned.observation[0], k=2)
    assert_allclose(found.reconstruction, learned.reconstruct(learned.descriptor[found.rows]))


def test_a_partly_specified_outcome(learned):
    """Only where it lands: the closest end point, whatever the way there, as a plain search has it."""
    wanted = np.full(learned.observation.shape[1:], np.nan)
    wanted[-1] = learned.observation[:, -1].mean(axis=0)
    found = learned.reach(wanted, k=5)
    spans = np.ptp(learned.observation.reshape(-1, 2), axis=0) / 2
    distance = np.sqrt((((learned.observation[:, -1] - wanted[-1]) / spans) ** 2).mean(axis=1))
    assert_array_equal(found.rows, distance.argsort(kind="stable")[:5])
    assert_allclose(found.distance, np.sort(distance)[:5])


def test_outcomes_that_are_none(learned):
    wanted = learned.observation[0].copy()
    for observation, k, message in (
        (wanted[:3], 1, "observation must have shape"),
        (np.full_like(wanted, np.nan), 1, "not NaN alone"),
        (np.full_like(wanted, np.inf), 1, "finite"),
        (wanted, len(learned) + 1, "k must be"),
        (wanted, 0, "k must be"),
        ("there", 1, "observation must be numbers, got 'there'"),
        ([[1, 2], [3]], 1, "observation must be numbers with rows of one shape, got"),
    ):
        with pytest.raises(ValueError, match=message):
            learned.reach(observation, k)
    with pytest.raises(ValueError, match="observation must be numbers, got 'there'"):
        learned.describe("there")
    with pytest.raises(ValueError, match=r"descriptor must have shape \(n, 2\), as those of the repertoire, got \(2,\)"):
        learned.reconstruct([0.0, 0.0])


@pytest.fixture(params=[0, 2], ids=["before it began", "of invalid individuals"])
def empty(request, tmp_path):
    aurora = auroraqd.Aurora(4, "genotype", seed=0, batch_size=20)
    for _ in range(request.param):
        aurora.tell(np.full(len(aurora.ask()), np.nan), np.zeros((20, 3, 2)))
    return auroraqd.load(auroraqd.save(aurora, tmp_path / "empty"))


def test_an_empty_repertoire_says_so(empty, tmp_path):
    pandas = pytest.importorskip("pandas")
    wanted = np.zeros(empty.observation.shape[1:])
    for call in (lambda: empty.reach(wanted), lambda: empty.evaluate(Ballistic()), lambda: empty.evaluate(Ballistic(), [])):
        with pytest.raises(ValueError, match="the repertoire is empty, nothing was stored in its run: there is no skill to "):
            call()
    with pytest.raises(ValueError, match=r"space must have shape \(n, d\), with at least one skill, got \(0, "):
        auroraqd.Adaptation(empty.descriptor, empty.fitness)
    assert empty.sample(3).shape == (0,)
    table = empty.to_pandas(Genes(a=(0, 1), b=(0, 1), c=(0, 1), d=(0, 1)))
    assert list(table)[:5] == ["a", "b", "c", "d", "fitness"]
    assert len(table) == 0
    table.to_csv(tmp_path / "a.csv", index=False)
    table.to_parquet(tmp_path / "a.parquet")
    for read in (pandas.read_csv(tmp_path / "a.csv"), pandas.read_parquet(tmp_path / "a.parquet")):
        assert list(read) == list(table)


def test_what_principal_components_explain(learned, tmp_path):
    observation = learned.observation
    scaled = Scaling.of(observation).scaler(100)(observation)
    of_pca = PCA(svd_solver="full").fit(scaled).explained_variance_ratio_.cumsum()
    explained = learned.explained()
    assert_allclose(explained, of_pca, rtol=1e-9)
    assert explained[-1] == pytest.approx(1)
    few = auroraqd.Aurora(2, "genotype", batch_size=30, seed=0).run(Ballistic(), generations=1)
    few = auroraqd.load(auroraqd.save(few, tmp_path))
    scaled = Scaling.of(few.observation).scaler(100)(few.observation)
    assert_allclose(few.explained()[:5], PCA(5).fit(scaled).explained_variance_ratio_.cumsum(), rtol=1e-6)


def test_of_observations_that_are_all_the_same_one_number_is_enough(tmp_path):
    aurora = auroraqd.Aurora(2, "genotype", seed=0).run(lambda genotypes: np.ones((len(genotypes), 3)), generations=1)
    assert_array_equal(auroraqd.load(auroraqd.save(aurora, tmp_path)).explained(), [1, 1, 1])


def test_samples_are_spread(learned):
    rows = learned.sample(10)
    assert len(set(rows.tolist())) == 10
    assert_array_equal(rows, learned.sample(20)[:10])
    with pytest.raises(ValueError, match="n must be"):
        learned.sample(0)


def test_skills_are_evaluated_again(learned):
    rows = learned.sample(4)
    again = learned.evaluate(Ballistic(), rows, times=2)
    assert again.fitness.shape == again.error.shape == (4, 2)
    assert_array_equal(again.error, 0.0)
    assert_array_equal(again.observation[:, 1], learned.observation[rows])

    def shifted(genotypes):
        fitness, observation, _ = Ballistic()(genotypes)
        observation[0] = np.nan
        return fitness, observation + 3.0

    error = learned.evaluate(shifted, rows).error
    assert np.isnan(error[0, 0])
    assert_allclose(error[1:], 3.0)
    assert learned.evaluate(Ballistic()).error.shape == (len(learned), 1)


def test_evaluations_that_are_none(learned):
    with pytest.raises(ValueError, match="as stored"):
        learned.evaluate(lambda g: g, [0])
    for row in (len(learned), -len(learned) - 1):
        with pytest.raises(IndexError, match=f"rows must be of the repertoire, 0 to {len(learned) - 1}, got {row}"):
            learned.evaluate(Ballistic(), [0, row])
    for rows in ([0.5], [], [[1, 2], [3]], "all"):
        with pytest.raises(ValueError, match=r"rows must (be|have) .*, got "):
            learned.evaluate(Ballistic(), rows)
    with pytest.raises(TypeError, match="task must be callable, an instance and not a class, got 'ballistic'"):
        learned.evaluate("ballistic")
    with pytest.raises(auroraqd.TaskError, match="task <lambda> with skills of the repertoire raised OSError: no motor"):
        learned.evaluate(lambda g: (_ for _ in ()).throw(OSError("no motor")), [0])


def test_tables(learned, tmp_path):
    pandas = pytest.importorskip("pandas")
    genes = Genes(angle=(0, 90, "deg"), force=(0, 10, "N"))
    table = learned.to_pandas(genes)
    assert len(table) == len(learned)
    assert_allclose(table["angle"], 90 * learned.genotype[:, 0])
    assert_array_equal(table["observation_49_1"], learned.observation[:, 49, 1])
    few = learned.to_pandas(observation=False)
    assert "genotype_1" in few
    assert not any(name.startswith("observation") for name in few)
    few.to_csv(tmp_path / "a.csv", index=False)
    few.to_parquet(tmp_path / "a.parquet")
    for read in (pandas.read_csv(tmp_path / "a.csv"), pandas.read_parquet(tmp_path / "a.parquet")):
        assert_allclose(read["descriptor_0"], learned.descriptor[:, 0])
    with pytest.raises(ValueError, match="genotypes must have 1 genes"):
        learned.to_pandas(Genes(a=(0, 1)))


def test_tasks_that_change_what_they_are_given_and_use_their_arrays_again(learned):
    buffer = np.zeros((3, *learned.observation.shape[1:]))

    def careless(genotypes):
        buffer[:] = genotypes.sum()
        genotypes *= 0.5
        return genotypes[:, 0], buffer, genotypes

    again = learned.evaluate(careless, [0, 1, 2], times=3)
    assert_array_equal(again.fitness, np.repeat(learned.genotype[:3, :1] / 2, 3, axis=1))
    assert_array_equal(again.observation, learned.genotype[:3].sum())
    assert again.ground_truth.shape == (3, 3, 2)
    calls = iter([1.0, 2.0])

    def unsteady(genotypes):
        buffer[:] = next(calls)
        return buffer

    assert_array_equal(learned.evaluate(unsteady, [0, 1, 2], times=2).observation[0, :, 0, 0], [1, 2])


def test_results_are_printed_in_short(learned):
    for found in (learned.reach(learned.observation[0], k=3), learned.evaluate(Ballistic(), [0, 1])):
        assert len(repr(found)) < 400
        assert "observation: float64 (" in repr(found)


@pytest.mark.parametrize("genes", ["angle", ["angle", "force"], {"angle": (0, 1)}])
def test_genes_of_a_table(learned, genes):
    with pytest.raises(TypeError, match=r"genes must be auroraqd\.tasks\.Genes, or None, got "):
        learned.to_pandas(genes)


def test_genes_called_like_other_columns(learned):
    with pytest.raises(ValueError, match="genes must not be called like other columns of the table: fitness, observation_0_1"):
        learned.to_pandas(Genes(fitness=(0, 1), observation_0_1=(0, 1)))


@pytest.mark.parametrize(
    ("described", "parameter"),
    [
        (auroraqd.Adaptation, "space"),
        (auroraqd.AutoEncoder.fit, "x"),
        (auroraqd.CVTArchive, "centroids"),
        (auroraqd.GridArchive, "low"),
        (auroraqd.Repertoire.reach, "observation"),
        (auroraqd.tasks.Genes.scale, "genotypes"),
        (auroraqd.tessellate, "samples"),
    ],
)
def test_signatures_name_types_of_arrays_and_do_not_spell_them_out(described, parameter):
    assert str(inspect.signature(described).parameters[parameter].annotation).startswith("ArrayLike")
