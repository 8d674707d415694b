import pickle

import commands
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import tasks

GENES = tasks.Genes(angle=(-3, 3, "rad"), speed=(0, 2, "m/s"))


def one(genotype):
    angle, speed = GENES.scale(genotype)
    return -speed, speed * np.array([np.cos(angle), np.sin(angle)]), np.array([angle])


def alone(genotype):
    return one(genotype)[1]


def batch(genotypes):
    angle, speed = GENES.scale(genotypes).T
    return -speed, speed[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), angle[:, None]


def in_jax(genotype):
    import jax.numpy as jnp

    angle, speed = 6 * genotype[0] - 3, 2 * genotype[1]
    return -speed, speed * jnp.array([jnp.cos(angle), jnp.sin(angle)])


def grown(task):
    return auroraqd.Aurora(2, PCA(2), seed=0, batch_size=30).run(task, generations=5).archive


def test_a_function_of_one_genotype_is_that_of_a_batch():
    expected, found = grown(batch), grown(tasks.each(one))
    for name in ("genotype", "fitness", "observation", "ground_truth"):
        assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("task", [tasks.each(alone), lambda genotypes: batch(genotypes)[1]])
def test_observation_alone(task):
    archive = grown(task)
    assert_array_equal(archive.fitness, 0.0)
    assert_array_equal(archive.observation, batch(archive.genotype)[1])


@pytest.mark.parametrize("n", [1, 2, 16, 17, 33, 200])
def test_jax(n):
    genotypes = np.random.default_rng(n).random((n, 2))
    fitness, observation = tasks.from_jax(in_jax)(genotypes)
    expected = batch(genotypes)
    assert_allclose(fitness, expected[0], atol=1e-5)
    assert_allclose(observation, expected[1], atol=1e-5)


def test_jax_tasks_can_be_sent():
    task = tasks.from_jax(in_jax, n_genes=2)
    task(np.zeros((3, 2)))
    again = pickle.loads(pickle.dumps(task))
    assert again.n_genes == 2
    assert_array_equal(again(np.full((3, 2), 0.2))[1], task(np.full((3, 2), 0.2))[1])
    assert len(grown(task)) > 5


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda g: np.zeros(2 + (g[0] > 0.5)), "observation must have the same shape for each genotype, got .*2.* and .*3"),
        (lambda g: np.zeros(2) if g[0] > 0.5 else (0.0, np.zeros(2)), "a tuple of the same length for each genotype"),
        (lambda g: None, "must return a tuple of fitness, observation"),
    ],
)
def test_functions_that_return_something_else_now_and_then(function, message):
    with pytest.raises(auroraqd.TaskError, match=f"task <lambda> at generation 0.*{message}"):
        grown(tasks.each(function))


WANTED = r"it must return a tuple of fitness, observation and optionally ground truth, or observation alone, \(...\), got "


@pytest.mark.parametrize("make", [tasks.each, tasks.from_jax])
@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda g: g[0], f"{WANTED}one number for a genotype: as observation of one entry it must be an array, of shape"),
        (lambda g: 0.5, f"{WANTED}one number for a genotype"),
        (lambda g: None, f"{WANTED}None"),
        (lambda g: {"x": "y"}, "observation x of a genotype must be numbers, got 'y'"),
        (lambda g: "x", f"{WANTED}str"),
        (lambda g: (g,), f"{WANTED}a tuple of 1"),
        (lambda g: (g[0], g, g, g), f"{WANTED}a tuple of 4"),
        (lambda g: (None, g), "fitness of a genotype must be numbers, got None"),
        (lambda g: (g[0], "x"), "observation of a genotype must be numbers, got 'x'"),
        (lambda g: [g[0], g], "observation of a genotype must be numbers"),
    ],
)
def test_functions_that_return_something_else(make, function, message):
    with pytest.raises(ValueError, match=message):
        make(function)(np.full((3, 2), 0.5))
    with pytest.raises(auroraqd.TaskError, match=f"task <lambda> at generation 0.*{message}"):
        grown(make(function))


@pytest.mark.parametrize("make", [tasks.each, tasks.from_jax])
def test_what_functions_may_return_besides(make):
    """An `Evaluation` without ground truth, and numbers in a list."""
    genotypes = np.random.default_rng(0).random((3, 2), np.float32)
    fitness, observation = make(lambda g: tasks.Evaluation(g[0], g))(genotypes)
    assert_array_equal(fitness, genotypes[:, 0])
    assert_array_equal(observation, genotypes)
    assert_array_equal(make(lambda g: [g[1], g[0]])(genotypes), genotypes[:, ::-1])


@pytest.mark.parametrize(
    "function", [lambda g: g if g[0] > 0.5 else -g, lambda g: np.sin(g), lambda g: np.array([float(g[0])])]
)
def test_what_jax_cannot_trace(function):
    with pytest.raises(ValueError, match=r"it must be a function of jax.numpy, without `if` .*auroraqd.tasks.each instead"):
        tasks.from_jax(function)(np.full((3, 2), 0.5))


@given(arrays(np.float64, (4, 2), elements=st.floats(0, 1)))
def test_genes_scale_and_back(genotypes):
    values = GENES.scale(genotypes)
    assert (values >= GENES.bounds[:, 0]).all()
    assert (values <= GENES.bounds[:, 1]).all()
    assert_allclose(GENES.unscale(values), genotypes, atol=1e-15)


def test_genes_say_what_they_are():
    assert (GENES.names, GENES.units, len(GENES)) == (["angle", "speed"], ["rad", "m/s"], 2)
    assert repr(GENES) == "Genes(angle=(-3, 3, 'rad'), speed=(0, 2, 'm/s'))"
    assert tasks.Genes(a=(0, 1)).units == [""]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tasks.Genes(), "at least one gene"),
        (lambda: tasks.Genes(a=(1, 0)), r"gene a must be .*low of a gene must be below high, got 1 and 0"),
        (lambda: tasks.Genes(a=(0, np.inf)), "gene a must be"),
        (lambda: tasks.Genes(a=3), r"gene a must be \(low, high\) or \(low, high, unit\), got 3$"),
        (lambda: tasks.Genes(a={}), r"gene a must be \(low, high\) or \(low, high, unit\), got {}$"),
        (lambda: tasks.Genes(a=(0,)), r"gene a must be .*, got \(0,\)$"),
        (lambda: tasks.Genes(a=(0, 1, "m", "s")), "gene a must be .*, got .*'m', 's'"),
        (lambda: tasks.Genes(a=(None, 1)), "gene a must be .*low must be a finite number, a bound, got None$"),
        (lambda: tasks.Genes(a=("x", 1)), "gene a must be .*low must be a finite number, a bound, got 'x'$"),
        (lambda: tasks.Genes(a=([1, 2], 1)), r"gene a must be .*low must be a finite number, a bound, got \[1, 2\]$"),
        (lambda: GENES.scale([[0.5]]), r"genotypes must have 2 genes \(angle, speed\), got shape \(1, 1\)"),
        (lambda: GENES.unscale([0, 2.5]), r"speed must be in \[0, 2\], got 2.5"),
        (lambda: GENES.scale("fast"), "genotypes must be numbers, got 'fast'"),
        (lambda: GENES.unscale([None, 1]), r"values must be numbers, got \[None, 1\]"),
        (lambda: tasks.each(one, n_genes=0), "n_genes must be"),
        (lambda: tasks.from_jax(in_jax)(np.empty((0, 2))), r"genotypes must have shape \(n, n_genes\), with entries"),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()
    for make in (tasks.each, tasks.from_jax):
        with pytest.raises(TypeError, match="function must be callable, an instance and not a class, got 3"):
            make(3)


MODULE = """
import numpy as np
from auroraqd.tasks import each


def path(genotypes):
    return np.cumsum(np.stack([np.cos(6 * genotypes), np.sin(6 * genotypes)], axis=2), axis=1)


path.n_genes = 4


def silent(genotypes):
    return genotypes


def failing(genotypes):
    raise OSError("no motor")


failing.n_genes = 2
number = 5
one = each(lambda genotype: genotype, n_genes=3)


class Robot:
    n_genes = 2

    def __call__(self, genotypes):
        return genotypes
"""


def command(folder, *arguments, code=0):
    (folder / "mine.py").write_text(MODULE)
    (folder / "broken.py").write_text("import nothing_like_it\n")
    done = commands.cli(*arguments, cwd=folder)
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return " ".join((done.stdout + done.stderr).split())


def test_command_line(tmp_path):
    assert "runs/path-pca-0" in command(tmp_path, "run", "mine:path", "-n", 4)
    command(tmp_path, "run", "mine:path", "-n", 2, "--out", "cut", "--jobs", 1, "--no-figures")
    command(tmp_path, "resume", "cut", "-n", 4, "--no-figures")
    command(tmp_path, "repeat", "cut", "--out", "again", "--no-figures")
    files = [(tmp_path / name / "repertoire.safetensors").read_bytes() for name in ("runs/path-pca-0", "cut", "again")]
    assert files[0] == files[1] == files[2]
    for name in ("mine:one", "mine:Robot"):
        command(tmp_path, "run", name, "-n", 2, "--out", name[5:], "--no-figures")


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("mine:nothing", "task mine:nothing: the module mine has no nothing"),
        ("yours:path", "task yours:path: there is no module yours, neither installed nor in this folder"),
        ("broken:path", "task broken:path cannot be imported: No module named 'nothing_like_it'"),
        ("mine:number", "task mine:number must be a function, or an object that can be called, got 5"),
        ("mine:silent", "task mine:silent must say how many genes it has: write silent.n_genes = 8 in mine"),
        ("mine:failing", "task failing at generation 0 raised OSError: no motor"),
        (
            "balistic",
            "task must be one of ballistic, air-hockey, air-hockey-camera, maze, hexapod, octopus-arm, or your own, written",
        ),
    ],
)
def test_tasks_that_are_none(tmp_path, task, message):
    assert message in command(tmp_path, "run", task, "-n", 2, code=1)
    assert not (tmp_path / "runs" / "x").exists()


def test_one_array_returned_again_and_again_is_many():
    buffer = np.zeros(2)

    def careless(genotype):
        buffer[:] = genotype
        return genotype[0], buffer, buffer

    genotypes = np.random.default_rng(0).random((20, 2))
    for column in tasks.each(careless)(genotypes)[1:]:
        assert_array_equal(column, genotypes)
    assert_array_equal(tasks.each(lambda genotype: careless(genotype)[1])(genotypes), genotypes)


def test_a_tuple_of_four_is_refused():
    with pytest.raises(ValueError, match=f"{WANTED}a tuple of 4"):
        tasks.each(lambda genotype: (0.0, genotype, genotype, genotype))(np.zeros((2, 2)))
