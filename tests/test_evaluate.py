import logging
import multiprocessing
import os
import pickle
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import commands
import numpy as np
import pytest
import robots
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd import evaluate
from auroraqd.evaluate import executors

GENOTYPES = np.random.default_rng(0).random((60, robots.GENES))
BAD = robots.bad(GENOTYPES)
assert 3 <= BAD.sum() <= 10


def check(evaluation, invalid=None):
    """It is the evaluation of the good task, but for rows that are invalid."""
    expected = robots.good(GENOTYPES)
    valid = np.ones(len(GENOTYPES), bool) if invalid is None else ~invalid
    assert_array_equal(np.isfinite(evaluation[0]), valid)
    for column, wanted in zip(evaluation, expected, strict=True):
        assert_array_equal(column[valid], wanted[valid])


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes. It gives a piece up that has killed two, and not four: each takes seconds to start."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"allowed_failures": 1},
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def whole_again(client):
    """The executor on a cluster, when workers that other tests have ended are there again; their nannies may be gone too."""
    try:
        client.wait_for_workers(2, timeout=15)
    except TimeoutError:
        for workers in (0, 2):
            client.cluster.scale(workers)
            deadline = time.monotonic() + 30
            while len(client.nthreads()) != workers and time.monotonic() < deadline:
                time.sleep(0.05)
    assert len(client.nthreads()) == 2
    return evaluate.dask(client)


EXECUTORS = {
    "one process": lambda client: evaluate.processes(1),
    "two processes": lambda client: evaluate.processes(2),
    "a pool of the standard library": lambda client: partial(ProcessPoolExecutor, 2, multiprocessing.get_context("spawn")),
    "threads": lambda client: partial(ThreadPoolExecutor, 3),
    "dask": lambda client: whole_again(client()),
}
OURS = ("two processes", "dask")


@pytest.fixture(params=EXECUTORS)
def executor(request):
    return EXECUTORS[request.param](lambda: request.getfixturevalue("cluster"))


@pytest.fixture(params=OURS)
def ours(request):
    return EXECUTORS[request.param](lambda: request.getfixturevalue("cluster"))


@pytest.mark.parametrize("options", [{}, {"chunk": 7}, {"workers": 1}])
def test_results_are_in_order(executor, options):
    with evaluate.over(executor, robots.slow, **options) as task:
        for _ in range(2):
            check(task(GENOTYPES))
        assert task.failed == 0
        assert len(task(GENOTYPES[:1]).fitness) == 1


def test_a_run_is_the_same_however_many_workers(ours):
    def found(task):
        return auroraqd.Aurora(robots.GENES, PCA(2), seed=0, batch_size=30).run(task, generations=4).archive

    alone = found(robots.good)
    for factory in (evaluate.processes(1), ours):
        with evaluate.over(factory, robots.good) as task:
            assert_array_equal(found(task).genotype, alone.genotype)
            assert_array_equal(found(task).ground_truth, alone.ground_truth)


def test_who_raises_is_invalid(executor, caplog):
    with evaluate.over(executor, robots.raises) as task:
        check(task(GENOTYPES), BAD)
        assert task.failed == BAD.sum()
    assert not any("set aside" in record.getMessage() for record in caplog.records)
    message = caplog.records[-1].getMessage()
    assert (
        f"raises: {BAD.sum()} of 60 individuals could not be evaluated and are invalid; one of them: genotype [0.9" in message
    )
    assert "ArithmeticError: the solver did not converge" in message


def test_who_exits_is_invalid(executor):
    with evaluate.over(executor, robots.exits) as task:
        check(task(GENOTYPES), BAD)


def test_types_do_not_depend_on_who_comes_first(executor):
    with evaluate.over(executor, robots.mixed_types, chunk=4) as task:
        assert task(GENOTYPES).observation.dtype == np.float64


def test_who_kills_its_worker_is_invalid(ours):
    few = np.concatenate([GENOTYPES[~BAD][:5], GENOTYPES[BAD][:1], GENOTYPES[~BAD][5:10]])
    with evaluate.over(ours, robots.dies, chunk=2, retries=0) as task:
        evaluation = task(few)
    assert np.flatnonzero(np.isnan(evaluation.fitness)).tolist() == [5]
    assert_array_equal(evaluation.observation[6:], robots.good(few)[1][6:])


@pytest.mark.parametrize("ends", [robots.dies, robots.leaves, robots.hangs])
def test_only_the_worker_of_a_bad_individual_is_replaced(tmp_path, ends):
    """What others do meanwhile goes on, and is done once."""
    few = np.concatenate([GENOTYPES[~BAD][:3], GENOTYPES[BAD][:1], GENOTYPES[~BAD][3:20]])
    timeout = 1 if ends is robots.hangs else None
    with evaluate.over(
        evaluate.processes(2), robots.WritesDown(tmp_path / "done", ends), chunk=1, retries=0, timeout=timeout
    ) as task:
        evaluation = task(few)
    assert np.flatnonzero(np.isnan(evaluation.fitness)).tolist() == [3]
    rows = [line.split() for line in (tmp_path / "done").read_text().splitlines()]
    assert sorted(float(gene) for gene, _ in rows) == sorted(np.delete(few[:, 0], 3).tolist())
    assert len({pid for _, pid in rows}) == 3


class OneBoat(Executor):
    """A worker that a bad individual takes down with all that was sent at the time, as on a cluster that has one left."""

    workers = 2

    def __init__(self):
        self.aboard = []

    def submit(self, function, /, *arguments):
        self.aboard.append((Future(), function, arguments))
        if len(self.aboard) == 1:
            threading.Timer(0.02, self.arrive).start()
        return self.aboard[-1][0]

    def arrive(self):
        aboard, self.aboard = self.aboard, []
        sinks = any(robots.bad(arguments[2][0]).any() for _, _, arguments in aboard)
        for future, function, arguments in aboard:
            future.set_exception(OSError("killed worker")) if sinks else future.set_result(function(*arguments))


def test_who_is_with_one_that_kills_a_worker_is_not_taken_for_it():
    with evaluate.over(OneBoat, robots.good, chunk=8, retries=0) as task:
        check(task(GENOTYPES), BAD)


class GivenUp:
    """A Dask cluster, and a client of it, that has given up one worker; another has failed to start, and a third starts."""

    def __init__(self):
        from distributed import Status

        self.cluster, self.scheduler, self.address = self, self, "tcp://somewhere"
        self.worker_spec = dict.fromkeys(range(3))
        self.workers = {1: SimpleNamespace(status=Status.failed), 2: SimpleNamespace(status=Status.starting)}
        self.asked, self.waited = [], 0

    def nthreads(self):
        return dict.fromkeys(range(len(self.asked)), 1)

    def wait_for_workers(self, number, timeout):
        self.waited += 1
        raise TimeoutError

    def scale(self, number):
        self.asked.append((number, list(self.workers)))


def test_a_cluster_that_gave_up_workers_is_asked_for_them(monkeypatch, caplog):
    """It gives up a worker that is not replaced in time; a run would go on with fewer, or wait for ever."""
    pytest.importorskip("distributed")
    client = GivenUp()
    executor = executors._DaskExecutor(client)
    assert executor.workers == 1
    assert client.asked == [(3, [2])]
    assert "asked for 2 lost workers" in caplog.text
    assert executor.workers == 1  # now and then is enough
    monkeypatch.setattr(executors, "_RESTART", 0.0)
    assert executor.workers == 2
    client.workers = dict.fromkeys(range(3))
    assert executor.workers == 2
    assert client.waited == 0


def test_a_cluster_without_workers_is_asked_again_and_again(monkeypatch):
    pytest.importorskip("distributed")
    client = GivenUp()
    client.nthreads = lambda: {0: 4} if len(client.asked) == 3 else {}
    monkeypatch.setattr(executors, "_RESTART", 0.0)
    assert executors._DaskExecutor(client).workers == 4
    assert client.waited == 2


class Deserted(Executor):
    """A cluster that gives up its workers as soon as there is work, and has others when it is asked for them."""

    def __init__(self):
        self.left = []

    @property
    def workers(self):
        for future, function, arguments in self.left:
            future.set_result(function(*arguments))
        self.left.clear()
        return 1

    def submit(self, function, /, *arguments):
        self.left.append((Future(), function, arguments))
        return self.left[-1][0]


@pytest.mark.parametrize("timeout", [None, 100])
def test_a_cluster_that_gives_up_all_workers_is_asked_for_others(monkeypatch, timeout):
    monkeypatch.setattr(evaluate.spread, "_LOOK", 0.01)
    with evaluate.over(Deserted, robots.good, timeout=timeout) as task:
        check(task(GENOTYPES))


def test_workers_that_take_long_to_start_are_waited_for(monkeypatch, caplog):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "_RESTART", 0.2)
    with (
        distributed.LocalCluster(
            n_workers=0, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        cluster.scale(1)
        with evaluate.over(evaluate.dask(client), robots.good) as task:
            check(task(GENOTYPES))
            assert "waiting for workers" in caplog.text
            assert len(cluster.workers) == 1
            assert len(client.nthreads()) == 1


def test_who_hangs_is_invalid_and_does_not_hang_the_run(ours):
    few = np.concatenate([GENOTYPES[~BAD][:9], GENOTYPES[BAD][:1], GENOTYPES[~BAD][9:14]])
    since = time.monotonic()
    with evaluate.over(ours, robots.hangs, timeout=4, retries=0) as task:
        evaluation = task(few)
        assert np.flatnonzero(np.isnan(evaluation.fitness)).tolist() == [9]
        assert np.isfinite(task(few[:9]).fitness).all()
    assert time.monotonic() - since < 100


@pytest.mark.parametrize("death", [False, True])
def test_what_fails_once_is_tried_again(ours, tmp_path, death):
    with evaluate.over(ours, robots.FailsOnce(tmp_path / "mark", death)) as task:
        check(task(GENOTYPES))
        assert task.failed == 0
    assert (tmp_path / "mark").exists()


@pytest.mark.parametrize("chunk", [None, 1])
@pytest.mark.parametrize("kind", [kind for kind in EXECUTORS if kind not in ("one process", "threads")])
def test_a_worker_that_fails_what_others_do(request, tmp_path, caplog, kind, chunk):
    """No individual suffers for it, and it gets no more to do."""
    factory = EXECUTORS[kind](lambda: request.getfixturevalue("cluster"))
    with evaluate.over(factory, robots.OneBadWorker(tmp_path / "mark"), chunk=chunk) as task:
        for _ in range(3):
            check(task(GENOTYPES))
        assert task.failed == 0
    said = [record.getMessage() for record in caplog.records if "is set aside" in record.getMessage()]
    host, pid = (tmp_path / "mark").read_text().split(":")
    assert said == [
        f"OneBadWorker: the worker that is process {pid} of {host} is set aside: what fails on it succeeds elsewhere"
    ]


@pytest.mark.parametrize("kind", OURS)
def test_no_individual_suffers_from_a_worker_that_is_set_aside_later(request, tmp_path, caplog, kind):
    """One that fails there, and elsewhere by chance, is given up, and taken up again."""
    factory = EXECUTORS[kind](lambda: request.getfixturevalue("cluster"))
    with evaluate.over(factory, robots.OneBadWorkerAndABadMoment(tmp_path / "mark"), chunk=1) as task:
        check(task(GENOTYPES))
        assert task.failed == 0
    assert (tmp_path / "moment").exists()
    assert "is set aside: what fails on it succeeds elsewhere" in caplog.text


def test_a_worker_that_cannot_load_what_others_can(tmp_path, caplog):
    factory = partial(ProcessPoolExecutor, 2, multiprocessing.get_context("spawn"))
    with evaluate.over(factory, robots.OnOneWorkerOnly(tmp_path / "mark"), chunk=1) as task:
        check(task(GENOTYPES))
        assert task.failed == 0
    assert "is set aside: the workers cannot load the task OnOneWorkerOnly: ImportError: No module" in caplog.text


def test_exceptions_that_cannot_be_sent(executor, caplog):
    with evaluate.over(executor, robots.raises_unpicklable) as task:
        check(task(GENOTYPES), BAD)
    assert "Unpicklable: no contact" in caplog.records[-1].getMessage()


def test_a_worker_that_joins_a_cluster_loads_the_task_first(cluster):
    """Before it is given work, for whose time limit it could take too long."""
    with evaluate.over(whole_again(cluster), robots.LoadsSlowly(), timeout=4, retries=0) as task:
        check(task(GENOTYPES))
        worker = next(iter(cluster.scheduler_info()["workers"]))
        cluster.run(robots.leave, workers=[worker], wait=False)
        deadline = time.monotonic() + 60
        while worker in cluster.nthreads() and time.monotonic() < deadline:
            time.sleep(0.05)
        whole_again(cluster)
        loaded = cluster.run(robots.loaded)
        assert len(loaded) == 2
        assert worker not in loaded
        assert all(loaded.values())


def test_a_worker_of_a_cluster_that_is_killed_midway(cluster):
    """By somebody else, while it is at work."""
    with evaluate.over(whole_again(cluster), robots.slow, chunk=5) as task:
        calls, killed = [], []

        def callback(aurora):
            calls.append(aurora.generation)
            if len(calls) == 2:
                worker = next(iter(cluster.scheduler_info()["workers"]))
                killed.append(worker)
                cluster.run(robots.leave, workers=[worker], wait=False)

        aurora = auroraqd.Aurora(robots.GENES, PCA(2), seed=0, batch_size=60).run(task, generations=6, callback=callback)
    alone = auroraqd.Aurora(robots.GENES, PCA(2), seed=0, batch_size=60).run(robots.good, generations=6)
    assert_array_equal(aurora.archive.genotype, alone.archive.genotype)
    assert task.failed == 0
    assert killed[0] not in cluster.scheduler_info()["workers"]


def command(*arguments, code=0):
    done = commands.cli(*arguments)
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return " ".join((done.stdout + done.stderr).split())


def test_command_line(cluster, tmp_path):
    address, plain = cluster.scheduler.address, ["--descriptor", "genotype"]
    for name, options in {"alone": [], "jobs": ["--jobs", 2], "cluster": ["--scheduler", address]}.items():
        command("run", "ballistic", *plain, "-n", 4, "--no-figures", "--out", tmp_path / name, *options)
    files = [(tmp_path / name / "repertoire.safetensors").read_bytes() for name in ("alone", "jobs", "cluster")]
    assert files[0] == files[1] == files[2]
    command("resume", tmp_path / "alone", "-n", 6, "--jobs", 1, "--no-figures")
    small = ["--generations", 3, "--replications", 1, "--variants", "genotype"]
    assert "2 runs to do" in command("reproduce", "ballistic", *small, "--out", tmp_path / "all", "--scheduler", address)
    command("reproduce", "ballistic", *small, "--out", tmp_path / "here", "--jobs", 1)
    tables = [(tmp_path / name / "curves.csv").read_text() for name in ("all", "here")]
    assert tables[0] == tables[1]
    assert "give --jobs or --scheduler, not both" in command("run", "ballistic", "--jobs", 1, "--scheduler", address, code=1)
    for what in ("run", "reproduce"):
        said = command(what, "ballistic", "--out", tmp_path / "no", "--scheduler", "nonsense://x", code=1)
        assert "there is no Dask scheduler at 'nonsense://x'" in said
        assert not (tmp_path / "no").exists()


@pytest.mark.parametrize(
    ("robot", "error", "message"),
    [
        (robots.always_raises, RuntimeError, r"all of 32 individuals failed, the last: ArithmeticError: no robot"),
        (robots.wrong_shape, ValueError, r"fitness must have \d+ rows"),
        (robots.mixed_shapes, ValueError, r"rows of one shape, .*, got both \(2,\) and \(3,\)"),
        (
            robots.no_tuple,
            ValueError,
            "it must return a tuple of fitness, observation and optionally ground truth, or .*, got NoneType",
        ),
        (
            robots.NotThere(),
            RuntimeError,
            r"the workers cannot load the task NotThere: ImportError: No module named 'simulator'",
        ),
    ],
)
def test_what_is_hopeless_is_said(ours, robot, error, message):
    with evaluate.over(ours, robot) as task, pytest.raises(error, match=message):
        task(GENOTYPES)


def test_a_task_that_always_hangs():
    with (
        evaluate.over(evaluate.processes(2), robots.always_hangs, timeout=0.1, retries=0) as task,
        pytest.raises(RuntimeError, match="all of 6 individuals failed, the last: it took longer than 0"),
    ):
        task(GENOTYPES)


def test_workers_that_die_at_once():
    with (
        evaluate.over(evaluate.processes(2), robots.always_dies) as task,
        pytest.raises(RuntimeError, match="the workers died before they had evaluated anything, 3 times"),
    ):
        task(GENOTYPES)


def test_errors_name_the_task_and_the_generation():
    aurora = auroraqd.Aurora(robots.GENES, PCA(2), seed=0, batch_size=40)
    with (
        evaluate.over(evaluate.processes(1), robots.always_raises) as task,
        pytest.raises(auroraqd.TaskError, match=r"task always_raises at generation 0 raised RuntimeError: all of 32"),
    ):
        aurora.run(task, generations=1)


def test_failing_individuals_do_not_end_a_run():
    with evaluate.over(partial(ThreadPoolExecutor, 2), robots.raises) as task:
        aurora = auroraqd.Aurora(robots.GENES, PCA(2), seed=0, batch_size=40).run(task, generations=3)
        assert aurora.history.last.invalid == task.failed > 0


def test_observations_without_nan(executor):
    with evaluate.over(executor, robots.pictures, chunk=11) as task:
        evaluation = task(GENOTYPES)
    assert evaluation.observation.dtype == np.uint8
    assert_array_equal(evaluation.observation, robots.pictures(GENOTYPES)[1])
    assert evaluation.ground_truth is None


def test_what_no_module_defines_at_its_top_is_sent_itself():
    """As from a notebook; what a module defines goes by its name."""
    gain = 3.0
    with evaluate.over(evaluate.processes(1), lambda genotypes: gain * robots.good(genotypes)[1]) as task:
        assert_array_equal(task(GENOTYPES).observation, gain * robots.good(GENOTYPES)[1])
    assert evaluate.over(evaluate.processes(1), robots.good)._content == pickle.dumps(robots.good, pickle.HIGHEST_PROTOCOL)


PROGRAM = """import numpy as np
from auroraqd import evaluate
offset = 1.0
def helper(genotypes):
    return genotypes + offset

def made(gain):
    def task(genotypes):
        return np.zeros(len(genotypes)), gain * helper(genotypes)
    return task

if __name__ == "__main__":
    genotypes = np.random.default_rng(0).random((6, 2))
    with evaluate.over(evaluate.processes(2), made(3.0), chunk=1) as spread:
        print("same", np.array_equal(spread(genotypes).observation, made(3.0)(genotypes)[1]))

"""
NOTEBOOK = """import sys, types
cell = sys.modules["__main__"] = types.ModuleType("__main__")
exec(compile(sys.argv[1], "<ipython-input-1>", "exec"), vars(cell))
"""


@pytest.mark.parametrize(
    ("options", "typed"),
    [
        (["program.py"], ""),
        (["-"], PROGRAM),
        (["-i", "-q"], PROGRAM),
        (["-c", PROGRAM], ""),
        (["-c", NOTEBOOK, PROGRAM], ""),
    ],
    ids=["a script", "standard input", "interactive", "a command", "a notebook"],
)
def test_functions_of_what_is_run_travel_to_workers(tmp_path, options, typed):
    """A closure, and what it calls and reads, of a file or of none."""
    (tmp_path / "program.py").write_text(PROGRAM)
    command = [sys.executable, *options]
    done = subprocess.run(command, input=typed, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    assert "same True" in done.stdout, done.stderr


def test_it_says_what_the_task_says():
    task = evaluate.over(evaluate.processes(1), auroraqd.tasks.AirHockey(restitution_threshold=1.0))
    assert (task.n_genes, task.__name__, task.restitution_threshold) == (8, "AirHockey", 1.0)
    with pytest.raises(AttributeError):
        task.prior  # noqa: B018


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((ThreadPoolExecutor(1), robots.good), TypeError, "executor must be a function that makes an executor"),
        ((partial(ThreadPoolExecutor, 1), 5), TypeError, "task must be callable, an instance and not a class, got 5"),
        (
            (partial(ThreadPoolExecutor, 1), partial(robots.good, threading.Lock())),
            ValueError,
            "cannot be sent to workers, nor what it refers to: ",
        ),
    ],
)
def test_bad_arguments(arguments, error, message):
    with pytest.raises(error, match=message):
        evaluate.over(*arguments)


@pytest.mark.parametrize("options", [{"chunk": 0}, {"timeout": -1}, {"retries": -1}, {"workers": 0}])
def test_bad_options(options):
    with pytest.raises(ValueError, match=f"{next(iter(options))} must be"):
        evaluate.over(partial(ThreadPoolExecutor, 1), robots.good, **options)
    with pytest.raises(TypeError, match=r"executor must make a concurrent\.futures executor, got 3"):
        evaluate.over(lambda: 3, robots.good)(GENOTYPES)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["x"], r"genotypes must be numbers of shape \(n, n_genes\), got 'x'"),
        ([np.zeros(3)], r"genotypes must have shape \(n, n_genes\), got \(3,\)"),
        ([GENOTYPES, [0.5]], rf"seeds must have shape \({len(GENOTYPES)},\), got shape \(1,\)"),
        ([GENOTYPES, np.zeros(len(GENOTYPES))], "seeds must be whole numbers, got float 0.0"),
    ],
)
def test_arguments_of_a_spread_task(arguments, message):
    with pytest.raises(ValueError, match=message):
        evaluate.over(partial(ThreadPoolExecutor, 1), robots.good)(*arguments)


def test_a_scheduler_that_is_not_there(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "_CONNECT", 1)
    with pytest.raises(ValueError, match=r"there is no Dask scheduler at .tcp://127\.0\.0\.1:9."):
        evaluate.dask("tcp://127.0.0.1:9")
    with pytest.raises(ValueError, match=r"there is no Dask scheduler at .nonsense://x."):
        evaluate.dask("nonsense://x")
    with pytest.raises(TypeError, match=r"client must be a distributed\.Client, or the address of a scheduler, got None"):
        evaluate.dask(None)


def test_a_pool_of_mpi(tmp_path):
    pytest.importorskip("mpi4py")
    script = Path(__file__).parent / "mpi_run.py"
    mpiexec = shutil.which("mpiexec", path=Path(sys.executable).parent) or "mpiexec"
    done = subprocess.run(
        [mpiexec, "-n", "3", sys.executable, "-m", "mpi4py.futures", script, tmp_path, "2"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with np.load(tmp_path / "found.npz") as found:
        for name, invalid in (("slow", None), ("raises", BAD), ("OneBadWorker", None)):
            check([found[f"{name} {column}"] for column in ("fitness", "observation", "ground_truth")], invalid)
    assert f"process {(tmp_path / 'mark').read_text().split(':')[1]} " in done.stderr
    assert done.stderr.count("set aside") >= 1
    assert "raises: the worker" not in done.stderr


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_an_interrupt_ends_the_workers():
    task = evaluate.over(evaluate.processes(1), robots.hangs)
    bad = GENOTYPES[BAD][:1]
    assert np.isfinite(task(GENOTYPES[~BAD]).fitness).all()
    processes = [pid for process in task._executor._processes.values() for pid in process.pool._processes]
    assert processes

    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluate.spread, "wait", interrupt)
        with pytest.raises(KeyboardInterrupt):
            task(bad)
    deadline = time.monotonic() + 30
    while any(map(alive, processes)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(alive, processes))
    assert np.isfinite(task(GENOTYPES[~BAD]).fitness).all()  # with new ones
    task.close()


@pytest.mark.parametrize("retries", [1, 2])
def test_workers_that_are_gone_are_nowhere_to_send_to(retries):
    """What fails on the only one there is does not wait for those before it."""
    with evaluate.over(evaluate.processes(1), robots.raises, retries=retries) as task:
        task(GENOTYPES[~BAD])
        task.close()
        check(task(GENOTYPES), BAD)


def test_threads_do_not_share_arrays_with_the_caller():
    genotypes = GENOTYPES.copy()
    with evaluate.over(partial(ThreadPoolExecutor, 1), robots.Careless(), chunk=10, workers=1) as task:
        evaluation = task(genotypes)
    assert_array_equal(genotypes, GENOTYPES)
    assert_array_equal(np.isfinite(evaluation.fitness), ~BAD)
    assert_array_equal(evaluation.observation[~BAD], GENOTYPES[~BAD])
