"""Skills executed one after the other: against a plain loop, in layers, with seeds and streams; runs that name their layers."""

import pickle

import commands
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate, testing
from auroraqd.runs import folders
from auroraqd.tasks import Evaluation, Hierarchical


class Skills:
    """What a hierarchy needs of a repertoire."""

    def __init__(self, genotype, descriptor, ground_truth=None):
        self.genotype, self.descriptor, self.ground_truth = genotype, descriptor, ground_truth


def walk(genotypes, state):
    """A step in a plane; the state is where it led to, and fitness what it cost."""
    here = (np.zeros((len(genotypes), 2)) if state is None else state) + genotypes[:, :2] - 0.5
    return Evaluation(-genotypes.sum(axis=1), here, here), here


def skills(n=30, genes=3):
    rng = np.random.default_rng(0)
    genotype = rng.random((n, genes))
    return Skills(genotype, 5 * genotype[:, :2] + 1, genotype[:, :1] ** 2)


def plain(known, places, steps, genotypes):
    """What `walk` does, one individual and one step at a time."""
    found = []
    low, high = places.min(axis=0), places.max(axis=0)
    for genotype in genotypes:
        here, fitness, way = np.zeros(2), 0.0, []
        for step in range(steps):
            wanted = low + genotype.reshape(steps, -1)[step] * (high - low)
            row = min(range(len(places)), key=lambda row: ((places[row] - wanted) ** 2).sum())
            here = here + known[row, :2] - 0.5
            fitness -= known[row].sum()
            way.append(here)
        found.append((fitness, np.array(way), here))
    return found


@pytest.mark.parametrize("by", ["descriptor", "ground_truth"])
def test_it_is_a_plain_loop(by):
    known = skills()
    task = Hierarchical(known, walk, steps=4, by=by)
    assert task.n_genes == 4 * getattr(known, by).shape[1]
    genotypes = np.random.default_rng(1).random((20, task.n_genes))
    genotypes[0], genotypes[1] = 0, 1
    found = task(genotypes)
    for row, (fitness, way, end) in enumerate(plain(known.genotype, getattr(known, by), 4, genotypes)):
        assert_allclose(found.fitness[row], fitness)
        assert_allclose(found.observation[row], way)
        assert_allclose(found.ground_truth[row], end)
    testing.check_task(task)


def test_a_layer_on_a_layer():
    known = skills()
    lower = Hierarchical(known, walk, steps=2)
    middle = Skills(np.random.default_rng(2).random((15, lower.n_genes)), np.random.default_rng(3).random((15, 1)))
    upper = Hierarchical(middle, lower, steps=3)
    assert upper.n_genes == 3
    genotypes = np.random.default_rng(4).random((10, 3))
    found, rows = upper(genotypes), upper.rows(genotypes)
    assert found.observation.shape == (10, 3, 2, 2)
    one = Hierarchical(known, walk, steps=6)  # the same skills in one sequence
    all_at_once = one(middle.genotype[rows].reshape(10, -1))
    assert_allclose(found.observation.reshape(10, 6, 2), all_at_once.observation)
    assert_allclose(found.fitness, all_at_once.fitness)
    assert_allclose(found.ground_truth, found.observation[:, -1, -1])
    first, state = upper.carried(genotypes, None)
    assert_allclose(upper.carried(genotypes, state)[0].observation[:, -1, -1], 2 * first.observation[:, -1, -1])


def test_seeds_of_each_step():
    def windy(genotypes, state, seeds):
        assert len(set(seeds.tolist())) == len(seeds)
        wind = np.array([np.random.default_rng(seed).normal(size=2) for seed in seeds])
        return walk(genotypes, state)[0]._replace(observation=wind), None

    windy.seeded = True
    task = Hierarchical(skills(), windy, steps=3)
    found = task(np.full((4, 6), 0.5), np.arange(4))
    assert len(np.unique(found.observation)) == 24
    assert_array_equal(task(np.full((4, 6), 0.5), np.arange(4)).observation, found.observation)
    with pytest.raises(ValueError, match="seeds must be given"):
        task(np.full((4, 6), 0.5))
    aurora = auroraqd.Aurora(task.n_genes, "observation", seed=0, batch_size=10).run(task, generations=2)
    assert aurora.evaluations == 20


def test_streams_and_steps_that_fail_and_arrays_used_again():
    buffer = np.zeros((2, 2))

    def two(genotypes, state):
        buffer[:] += 1
        genotypes[:] = 0
        return {"pen": buffer, "joints": np.full((2, 3), np.nan if state else 1.0)}, state is None

    known = skills()
    before = known.genotype.copy()
    found = Hierarchical(known, two, steps=3)(np.full((2, 6), 0.5))
    assert_array_equal(found.observation["pen"][0], [[1, 1], [2, 2], [3, 3]])
    assert_array_equal(np.isnan(found.observation["joints"][0, :, 0]), [False, True, False])
    assert found.ground_truth is None
    assert_array_equal(known.genotype, before)


def test_hierarchies_that_are_none():
    known, nothing = skills(), Skills(np.empty((0, 3)), np.empty((0, 2)))

    def other(genotypes):
        return genotypes

    other.n_genes = 5
    for arguments, message in (
        ((nothing, walk, 2), "skills must be one at least, and the repertoire is empty"),
        ((known, other, 2), "skills must have 5 genes, as the task that executes them takes, got 3"),
        ((known, Hierarchical(known, walk, 4), 2), "skills must have 8 genes, as the task that executes them takes, got 3"),
        ((known.genotype, walk, 2), "skills must be a repertoire or an archive with genotypes and descriptor, got "),
        ((Skills(known.genotype, known.descriptor), walk, 2, "ground_truth"), "with genotypes and ground_truth"),
        ((known, walk, 0), "steps must be a whole number"),
        ((known, walk, 2, "fitness"), "by must be one of descriptor, ground_truth"),
    ):
        with pytest.raises(ValueError, match=message):
            Hierarchical(*arguments)
    with pytest.raises(TypeError, match="task must be callable"):
        Hierarchical(known, "walk", 2)
    task = Hierarchical(known, walk, 2)
    for genotypes in (np.full((2, 3), 0.5), np.full((2, 4), 1.5), np.full((2, 4), np.nan)):
        with pytest.raises(ValueError, match="there must be genotypes"):
            task(genotypes)
    for wrong in (lambda g, s: g, lambda g, s: (g, s, s)):
        with pytest.raises(ValueError, match=r"must return a pair, \(evaluation, state\), got"):
            Hierarchical(known, wrong, 2)(np.full((2, 4), 0.5))
    with pytest.raises(ValueError, match=r"of the pair \(evaluation, state\) .* the first: it must return a tuple"):
        Hierarchical(known, lambda g, s: (np.zeros(len(g)), g), 2)(np.full((2, 4), 0.5))


def step(genotypes):
    return walk(genotypes, None)[0]


def saved(folder, task, n_genes, seed=0, generations=3):
    aurora = auroraqd.Aurora(n_genes, PCA(2), seed=seed, batch_size=50)
    return auroraqd.save(aurora.run(task, generations=generations), folder)


def test_runs_name_their_layers_and_go_on(tmp_path):
    saved(tmp_path / "steps", step, 2)
    lower = Hierarchical(auroraqd.load(tmp_path / "steps"), walk, steps=3)
    saved(tmp_path / "walks", lower, lower.n_genes)

    def upper():
        known = auroraqd.load(tmp_path / "walks")
        return Hierarchical(known, Hierarchical(auroraqd.load(tmp_path / "steps"), walk, steps=3), steps=2)

    task = upper()
    assert task.layers == [str(tmp_path / "walks"), str(tmp_path / "steps")]
    folder = saved(tmp_path / "tours", task, task.n_genes)
    assert folders.load_config(folder)["provenance"]["task"]["layers"] == task.layers
    whole = auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=50).run(task, generations=6)
    again = auroraqd.resume(folder).run(upper(), generations=3)  # as another process would: no warning, the same course
    assert_array_equal(again.archive.genotype, whole.archive.genotype)
    for name in ("steps", "walks"):
        with pytest.raises(
            ValueError, match=f"{name} is a layer of the task, which executes skills from there: choose another"
        ):
            auroraqd.save(whole, tmp_path / name, overwrite=True)
    saved(tmp_path / "others", step, 2, seed=1)
    other = Hierarchical(auroraqd.load(tmp_path / "walks"), Hierarchical(auroraqd.load(tmp_path / "others"), walk, 3), 2)
    with pytest.warns(UserWarning, match="the task was Hierarchical"):
        auroraqd.resume(folder).run(other, generations=1)


def test_workers_get_the_skills():
    task = Hierarchical(skills(), walk, steps=2)
    genotypes = np.random.default_rng(0).random((6, 4))
    assert_array_equal(pickle.loads(pickle.dumps(task))(genotypes).observation, task(genotypes).observation)
    assert repr(pickle.loads(pickle.dumps(task))) == repr(task)
    assert " at 0x" not in repr(task)
    assert evaluate.over(evaluate.processes(1), task).n_genes == 4


def test_on_the_command_line(tmp_path):
    saved(tmp_path / "steps", step, 2)
    (tmp_path / "walker.py").write_text(
        "import auroraqd, numpy as np\n\n\ndef walk(genotypes, state):\n"
        "    here = genotypes - 0.5 + (0 if state is None else state)\n    return here, here\n\n\n"
        'walks = auroraqd.tasks.Hierarchical(auroraqd.load("steps"), walk, steps=3)\n'
    )
    words = "--descriptor", "observation", "--no-figures", "--no-snapshots"
    done = commands.cli("run", "walker:walks", *words, "--generations", 2, "--out", "walks", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = commands.cli("resume", "walks", "--generations", 3, "--no-figures", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert auroraqd.load(tmp_path / "walks").history.records[-1].generation == 3
    done = commands.cli("run", "walker:walks", *words, "--out", "steps", "--overwrite", cwd=tmp_path)
    assert done.returncode == 1
    assert "steps is a layer of the task, which executes skills from there: choose another folder" in done.stderr
    assert len(auroraqd.load(tmp_path / "steps"))
