"""A task that many workers evaluate: pieces of a batch, who takes them, and what becomes of those that fail."""

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import suppress
from typing import Any, NamedTuple

import cloudpickle
import numpy as np

from auroraqd._checks import function, number, numeric, seeds_for, shown, whole
from auroraqd._processes import WorkerDied
from auroraqd._workers import cores
from auroraqd.evaluate._trust import Trust, Worker
from auroraqd.evaluate.executors import START, Answer, work_on
from auroraqd.observations import described, has_streams, joined, layout_of
from auroraqd.tasks import Evaluation, name_of

_SHORTEST, _LONGEST = 0.01, 0.2  # s, that a chunk should take: far more than to send it, far less than a generation
_SHORT = 1.0  # s, an evaluation so short that to wait for the next one would show
_SLOWER = 4.0  # a chunk may take this many times as long as others, and a time limit more
_HOPELESS = 32  # individuals that fail, and none that does not, are not the individuals' fault
_HANGING = 6  # nor are these, if they hang and none ever came back: to wait for more may take hours
_PAUSE = 0.05, 5.0  # s, least and most, that a worker waits when it leaves a piece to others: about what an individual takes
_DECLINED = 20  # times that a piece may be left to others before it is clear that there are none
_STILLBORN = 3  # likewise executors that break before they have evaluated anything, or as many processes of one as it has
_LOOK = 30.0  # s without an answer, after which is seen whether there still are workers
_log = logging.getLogger("auroraqd")


def over(
    executor: Callable[[], Executor],
    task: Callable[[np.ndarray], Any],
    *,
    chunk: int | None = None,
    timeout: float | None = None,
    retries: int = 1,
    workers: int | None = None,
) -> "Spread":
    """A task whose individuals are evaluated by the workers of an executor.

    The result is that of the task, in order, however many workers there are and whichever of them does what, if the rows of
    the task do not depend on each other. A task made of matrix products is one whose last bits may: give it a `chunk`.

    Args:
        executor: makes a `concurrent.futures` executor, when it is called: `processes(8)`, `dask(client)`, or for instance
            `lambda: mpi4py.futures.MPIPoolExecutor()`. Called again when the one before is broken.
        task: from genotypes (n, n_genes) to fitness, observation and, if known, ground truth. What its module defines at the
            top the workers import; a lambda, a closure or a function of a notebook is sent itself, with what it refers to.
        chunk: individuals that are sent at once. None: ever fewer towards the end of a batch, at most 0.2 s of work.
        timeout: seconds that an individual may take. None: no limit. A worker that takes longer is ended, where the executor
            is `processes` or `dask`; of others it is left behind with a new executor.
        retries: how often a chunk that fails is tried again before it is cut in two.
        workers: of the executor, if it does not say itself.

    Raises:
        TypeError, ValueError: an argument is of the wrong kind or out of range.

    Examples:
        >>> from concurrent.futures import ThreadPoolExecutor
        >>> import auroraqd
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, "genotype", seed=0)
        >>> with auroraqd.evaluate.over(lambda: ThreadPoolExecutor(2), task) as spread:  # or processes(8), or dask(client)
        ...     aurora.run(spread, generations=2).evaluations
        400
    """
    if isinstance(executor, Executor) or not callable(executor):
        raise TypeError(
            f"executor must be a function that makes an executor, so that a broken one is replaced, got {shown(executor)}"
        )
    function("task", task)
    try:
        content = cloudpickle.dumps(task)
    except Exception as error:
        raise ValueError(f"task {name_of(task)} cannot be sent to workers, nor what it refers to: {error}") from None
    return Spread(
        executor,
        task,
        content,
        chunk=None if chunk is None else whole("chunk", chunk),
        timeout=None if timeout is None else number("timeout", timeout),
        retries=whole("retries", retries, least=0),
        workers=None if workers is None else whole("workers", workers),
    )


class _Piece(NamedTuple):
    """Individuals that are evaluated together."""

    start: int
    stop: int
    failures: int = 0  # how often they have failed
    failed_on: frozenset[Worker] = frozenset()
    declined: int = 0  # how often a worker left them to others

    @property
    def size(self) -> int:
        return self.stop - self.start

    def halves(self) -> list["_Piece"]:
        """Of which one may have done nothing wrong, so where they failed together says nothing of where they fail."""
        middle = (self.start + self.stop) // 2
        fresh = self._replace(failed_on=frozenset())
        return [fresh._replace(stop=middle), fresh._replace(start=middle)]


class Spread:
    """What `over` returns: a task. In a `with` block, or by `close`, its workers end.

    Attributes:
        failed: individuals that were made invalid because their evaluation kept failing.
    """

    def __init__(
        self,
        factory: Callable[[], Executor],
        task: Callable,
        content: bytes,
        *,
        chunk: int | None,
        timeout: float | None,
        retries: int,
        workers: int | None,
    ) -> None:
        self.__name__ = name_of(task)
        self.task = task
        self.failed = 0
        self._factory, self._content = factory, content
        self._chunk, self._timeout, self._retries, self._given_workers = chunk, timeout, retries, workers
        self._executor: Executor | None = None
        self._seconds: float | None = None  # that an individual takes
        self._slow_start = START  # of an executor that does not say when its workers are ready
        self._stillborn = 0  # executors that broke before they had evaluated anything
        self._trust = Trust()

    def __getattr__(self, name: str) -> Any:
        """What the task says about itself, `n_genes` for instance."""
        if name.startswith("_") or name == "task":
            raise AttributeError(name)
        return getattr(self.task, name)

    def __enter__(self) -> "Spread":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the workers. Called again, the task starts new ones."""
        self._end_executor()

    def __call__(self, genotypes: np.ndarray, seeds: np.ndarray | None = None) -> Evaluation:
        """The evaluation of genotypes, (n, n_genes), with their seeds, (n,), if the task wants them.

        Raises:
            RuntimeError: nothing can be evaluated: the workers cannot load the task, die at once, or all individuals fail.
            ValueError: the task returned something that is no evaluation, or an argument has another shape.
        """
        genotypes = numeric("genotypes", genotypes, " of shape (n, n_genes)")
        if genotypes.ndim != 2:
            raise ValueError(f"genotypes must have shape (n, n_genes), got {genotypes.shape}")
        seeds = None if seeds is None else seeds_for("seeds", seeds, len(genotypes))
        try:
            batch = _Batch(self, genotypes, seeds)
            while batch.unfinished:
                batch.step()
        except BaseException:  # an interrupt, too: nothing goes on behind the back of who called
            self._end_executor()
            raise
        self.failed += len(batch.invalid)
        return batch.evaluation()

    def stream(self) -> "Stream":
        """Workers that are given individuals one after the other, not by the batch: see `Aurora.run(asynchronous=True)`."""
        return Stream(self)

    @property
    def _workers(self) -> int:
        executor = self._started()
        known = (self._given_workers, *(getattr(executor, name, None) for name in ("workers", "num_workers", "_max_workers")))
        return next((count for count in known if count), len(cores()))

    def _started(self) -> Executor:
        if self._executor is None:
            self._executor = self._factory()
            if not isinstance(self._executor, Executor):
                raise TypeError(f"executor must make a concurrent.futures executor, got {shown(self._executor)}")
            self._prepare()
        return self._executor

    def _prepare(self) -> None:
        """Have all workers ready, as far as the executor can, so that what it takes is not taken for a slow evaluation."""
        if not hasattr(self._executor, "prepare"):
            return
        try:
            self._trust.are(self._executor.prepare(self._content, self.__name__))  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
        except WorkerDied as error:
            raise BrokenExecutor(str(error)) from None
        self._slow_start = 0.0

    def _end_executor(self) -> None:
        """End the workers, also those that hang; the next use starts new ones."""
        executor, self._executor = self._executor, None
        self._trust = Trust()  # of its workers; those of the next are others
        if executor is not None:
            with suppress(Exception):  # of one that is broken
                getattr(executor, "kill", lambda: None)()
                executor.shutdown(wait=False, cancel_futures=True)

    def _took(self, seconds: float) -> None:
        """An individual took so long."""
        self._stillborn = 0
        self._seconds = seconds if self._seconds is None else 0.7 * self._seconds + 0.3 * seconds

    def _size(self, left: int, workers: int) -> int:
        """Individuals for the next chunk, of those left."""
        if self._chunk is not None:
            return min(self._chunk, left)
        if self._seconds is None:  # the first ones say how long it takes
            return 1
        share = math.ceil(left / workers)
        fewest, most = (min(int(seconds / max(self._seconds, 1e-9)), share) for seconds in (_SHORTEST, _LONGEST))
        return max(fewest, min(most, share // 2), 1)

    def _deadline(self, piece: _Piece) -> float:
        if self._timeout is None:
            return math.inf
        expected = self._timeout * (piece.size - 1) if self._seconds is None else _SLOWER * self._seconds * piece.size
        return time.monotonic() + self._timeout + expected + (self._slow_start if self._seconds is None else 0)


class _Batch:
    """The evaluation of one batch by the workers, one step at a time."""

    def __init__(self, spread: Spread, genotypes: np.ndarray, seeds: np.ndarray | None):
        self._spread = spread
        self._genotypes = genotypes
        self._seeds = seeds
        self._size = len(genotypes)
        self._next = 0  # the first row that has not been sent
        self._again: deque[_Piece] = deque()
        self._suspects: deque[_Piece] = deque()  # one of them broke the executor: they are tried one at a time
        self._running: dict[Future, tuple[_Piece, float]] = {}
        self._alone = False
        self._free: Worker | None = None  # who answered just now, and will take what is sent
        self._done: list[tuple[_Piece, Evaluation]] = []
        self._succeeded = False  # any of them
        self._hanging = 0  # chunks that took too long
        self.invalid: dict[int, tuple[_Piece, str]] = {}  # row to what was given up, and why

    @property
    def unfinished(self) -> bool:
        """Whether there is anything left to do."""
        return bool(self._next < self._size or self._again or self._suspects or self._running)

    def step(self) -> None:
        """Send what there are workers for, then wait for one of them."""
        if not self._send():
            return
        least = min(deadline for _, deadline in self._running.values())
        patience = min(max(least - time.monotonic(), 0), _LOOK)
        done = wait(self._running, timeout=patience, return_when=FIRST_COMPLETED).done
        for future in done:
            if future in self._running and not (self._took(future) and self._send()):
                return
        if not done and patience == _LOOK:
            _ = self._spread._workers  # a cluster that has given up all of them is asked for others
        now = time.monotonic()
        late = [future for future, (_, deadline) in self._running.items() if deadline <= now and not future.done()]
        if late:
            self._hung(late)

    def _send(self) -> bool:
        """Give all workers something to do, as far as there is any; False when the executor is broken."""
        spread = self._spread
        try:
            workers = 1 if self._suspects or self._alone else spread._workers
            while len(self._running) < self._most(workers) and (piece := self._following(workers)) is not None:
                try:
                    future = self._submitted(piece)
                except BaseException:
                    (self._suspects if self._alone else self._again).appendleft(piece)
                    raise
                self._running[future] = piece, spread._deadline(piece)
        except BrokenExecutor as error:
            self._broke(error)
            return False
        return True

    def _submitted(self, piece: _Piece) -> Future:
        spread = self._spread
        executor, work = spread._started(), self._work(piece)
        if piece.declined >= _DECLINED or spread._workers == 1:
            spread._trust.met_all()
        elsewhere = spread._trust.elsewhere(piece.failed_on)
        pause = min(max(spread._seconds or 0.0, _PAUSE[0]), _PAUSE[1])
        for _ in range(piece.declined // 2 % spread._workers):  # two that leave to each other what comes back to them, in step
            executor.submit(time.sleep, pause)
        submit = getattr(executor, "submit_elsewhere", lambda _, *arguments: executor.submit(*arguments))
        return submit(elsewhere, work_on, spread._content, spread.__name__, work, elsewhere, pause)

    def _most(self, workers: int) -> int:
        """Pieces that may be with so many workers."""
        return workers

    def _work(self, piece: _Piece) -> tuple[np.ndarray, np.ndarray | None]:
        """Genotypes and seeds. Copies, for threads of this process may do with them what they like."""
        rows = slice(piece.start, piece.stop)
        return self._genotypes[rows].copy(), None if self._seeds is None else self._seeds[rows].copy()

    def _fresh(self, workers: int) -> _Piece | None:
        """Individuals that have not been sent yet, if there are any."""
        left = self._size - self._next
        if left == 0:
            return None
        piece = _Piece(self._next, self._next + self._spread._size(left, workers))
        self._next = piece.stop
        return piece

    def _following(self, workers: int) -> _Piece | None:
        self._alone = bool(self._suspects)
        if self._alone:
            return None if self._running else self._suspects.popleft()
        free, self._free = self._free, None
        for index, piece in enumerate(self._again):
            if free not in piece.failed_on:
                del self._again[index]
                return piece
        if (fresh := self._fresh(workers)) is not None:
            return fresh
        # What is left has failed where a worker is free: others will be.
        return self._again.popleft() if self._again and not self._running else None

    def _took(self, future: Future) -> bool:
        """Take a result; False when the executor is broken, and what was under way with it."""
        spread = self._spread
        try:
            answer: Answer = future.result()
        except BrokenExecutor as error:
            self._broke(error)
            return False
        except WorkerDied as error:
            return self._died(self._running.pop(future)[0], error)
        except (Exception, CancelledError) as error:
            piece, _ = self._running.pop(future)
            if self._alone:
                self._failed(piece, f"{type(error).__name__}: {error}", suspect=True)
            else:  # no exception of a task comes here: a worker is lost, perhaps to another piece that it was sent
                self._suspects.append(piece)
            return True
        piece, _ = self._running.pop(future)
        spread._trust.met(answer.worker)
        self._free = answer.worker
        if answer.evaluation is not None:
            self._done.append((piece, answer.evaluation))
            self._succeeded = True
            spread._took(answer.seconds / piece.size)
            return self._set_aside(spread._trust.succeeded(answer.worker, piece.failed_on))
        if answer.refused is not None:
            if spread._seconds is None or answer.refused.error is not RuntimeError:
                raise answer.refused.error(answer.refused.text)
            self._again.append(piece._replace(failed_on=piece.failed_on | {answer.worker}))
            return self._set_aside(spread._trust.refused(answer.worker), answer.refused.text)
        if answer.error is not None and answer.worker in spread._trust.bad:  # sent before that was known
            self._again.append(piece)
            return True
        if answer.error is not None:
            self._failed(piece, answer.error, on=answer.worker)
            return True
        (self._suspects if self._alone else self._again).append(piece._replace(declined=piece.declined + 1))
        self._free = None
        return True

    def _set_aside(self, bad: Sequence[Worker], reason: str = "what fails on it succeeds elsewhere") -> bool:
        """Let no more be done by workers that fail what others do; False when the executor has been replaced for that."""
        executor = self._spread._executor
        for worker in bad:
            _log.warning("%s: the worker that is %s is set aside: %s", self._spread.__name__, worker, reason)
        for row, (piece, _) in list(self.invalid.items()):  # it may have been the worker's fault
            if piece.failed_on & set(bad):
                del self.invalid[row]
                self._again.append(piece._replace(failures=0, failed_on=piece.failed_on - set(bad)))
        if bad and hasattr(executor, "end"):  # processes: new ones are as good as others
            self._again.extendleft(piece for piece, _ in self._running.values())
            self._running.clear()
            self._spread._end_executor()
            return False
        return True

    def _died(self, piece: _Piece, error: WorkerDied) -> bool:
        """A process has died, and others go on: another takes its place. False when none can start."""
        if error.began:
            self._failed(piece, "its worker died", suspect=self._alone)
            self._check_born(error, self._spread._workers)
        else:
            self._again.appendleft(piece)
        return self._refilled()

    def _refilled(self) -> bool:
        """Have new workers in the place of those that are gone; False when they die, too, and the executor with them."""
        try:
            self._spread._prepare()
        except BrokenExecutor as error:
            self._broke(error)
            return False
        return True

    def _broke(self, error: BaseException) -> None:
        """A worker has died, and taken the executor with it: start another. Whose fault it was shows when they are alone."""
        pieces = [piece for piece, _ in self._running.values()]
        self._running.clear()
        self._spread._end_executor()
        self._check_born(error, 1)
        if self._alone:
            self._alone = False
            for piece in pieces:
                self._failed(piece, "its worker died", suspect=True)
        else:
            self._suspects.extend(pieces)

    def _check_born(self, error: BaseException, at_once: int) -> None:
        """Raise RuntimeError where workers die again and again, and none has ever evaluated anything."""
        spread = self._spread
        if self._succeeded or spread._seconds is not None:
            return
        spread._stillborn += 1
        if spread._stillborn >= _STILLBORN * at_once:
            spread._stillborn = 0
            raise RuntimeError(
                f"the workers died before they had evaluated anything, {_STILLBORN} times ({error}). A script that starts "
                'processes must do so under `if __name__ == "__main__":`'
            ) from error

    def _hung(self, late: Sequence[Future]) -> None:
        """Workers take too long: end them; where one alone cannot be ended, all, and those that did not begin again."""
        executor: Any = self._spread._executor
        for future in late:
            piece, _ = self._running.pop(future)
            self._hanging += 1
            self._failed(piece, f"it took longer than {self._spread._timeout:g} s", suspect=self._alone)
        if hasattr(executor, "end"):
            for future in late:
                executor.end(future)
            self._refilled()
            return
        self._again.extendleft(piece for piece, _ in self._running.values())
        self._running.clear()
        self._spread._end_executor()

    def _failed(self, piece: _Piece, reason: str, *, on: Worker | None = None, suspect: bool = False) -> None:
        """Try again, elsewhere, in two halves if that has been tried, or give an individual up."""
        queue = self._suspects if suspect else self._again
        piece = piece._replace(failed_on=piece.failed_on | ({on} if on else set()), declined=0)
        if piece.failures < self._spread._retries:
            queue.append(piece._replace(failures=piece.failures + 1))
        elif piece.size > 1:
            queue.extend(piece.halves())
        else:
            self.invalid[piece.start] = piece, reason
            self._check_hope(len(self.invalid), reason)

    def _check_hope(self, failed: int, reason: str) -> None:
        """Raise RuntimeError where so many individuals failed, and none did not, that it is not their fault."""
        most = _HANGING if self._hanging and self._spread._seconds is None else _HOPELESS
        if not self._succeeded and failed >= min(most, self._size):
            raise RuntimeError(f"all of {failed} individuals failed, the last: {reason}")

    def evaluation(self) -> Evaluation:
        """Of all, in order; rows of those that failed are invalid."""
        if not self._done:  # an empty batch
            return Evaluation(np.empty(0), np.empty((0, 1)))
        if self.invalid:
            row, (_, reason) = next(iter(self.invalid.items()))
            _log.warning(
                "%s: %d of %d individuals could not be evaluated and are invalid; one of them: %s",
                self._spread.__name__,
                len(self.invalid),
                self._size,
                f"genotype {self._genotypes[row].tolist()}, {reason}",
            )
        return _assembled(self._size, self._done)


def _assembled(n: int, done: Sequence[tuple[_Piece, Evaluation]]) -> Evaluation:
    """The evaluation of n individuals from those of pieces; the rest is invalid."""
    parts = sorted(done, key=lambda one: one[0].start)
    return Evaluation(*(_column(n, [(piece, evaluation[i]) for piece, evaluation in parts]) for i in range(3)))


def _column(n: int, parts: Sequence[tuple[_Piece, Any]]) -> np.ndarray | None:
    """n rows, NaN or zero where there is nothing to put; of a type that does not depend on who came first."""
    shapes = {None if rows is None else rows.shape[1:] for _, rows in parts}
    if len(shapes) > 1:
        raise ValueError(
            "it must return rows of one shape, and ground truth always or never, got both "
            f"{' and '.join(sorted(map(str, shapes)))}"
        )
    if shapes == {None}:
        return None
    layouts = {layout_of(rows) for _, rows in parts}
    if len(layouts) > 1:
        raise ValueError(f"it must return the same streams always, got {' and '.join(sorted(map(described, layouts)))}")
    if has_streams(parts[0][1]):
        names = parts[0][1].dtype.names
        streams = {name: _column(n, [(piece, rows[name]) for piece, rows in parts]) for name in names}
        return joined(streams)  # pyright: ignore[reportArgumentType]
    dtype = np.result_type(*(rows for _, rows in parts))
    column = np.full((n, *parts[0][1].shape[1:]), np.nan if dtype.kind == "f" else 0, dtype)
    for piece, rows in parts:
        column[piece.start : piece.stop] = rows
    return column


class Stream(_Batch):
    """Individuals that come and go one after the other, for as long as it is open: what `Spread.stream` returns.

    A submission is a few individuals that are evaluated together; what fails is tried again as in a batch.
    """

    def __init__(self, spread: Spread):
        super().__init__(spread, np.empty((0, 0)), None)
        self._size = _HOPELESS
        self._waiting: deque[_Piece] = deque()  # not sent yet
        self._open: dict[int, _Submission] = {}  # by their first row
        self._template: Evaluation | None = None  # the shapes and dtypes of what came
        self._lost: list[_Submission] = []  # invalid, all of it, before anything came

    def __enter__(self) -> "Stream":
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        if kind is not None or self._running:  # nothing goes on behind the back of who left
            self._spread._end_executor()

    @property
    def open(self) -> int:
        """Submissions that workers are not done with."""
        return len(self._open)

    @property
    def wanted(self) -> int:
        """Submissions that would keep the workers busy, beyond those that are open.

        Where evaluations are short, a few more than there are workers: one that is done finds the next waiting.
        """
        spread = self._spread
        return max(self._most(spread._workers) - len(self._open), 0)

    @property
    def chunk(self) -> int:
        """Individuals to submit at once: as many as take long enough for it to pay."""
        spread = self._spread
        if spread._chunk is not None:
            return spread._chunk
        return 1 if spread._seconds is None else max(int(_SHORTEST / max(spread._seconds, 1e-9)), 1)

    @property
    def unfinished(self) -> bool:
        """Whether there is anything left to do."""
        return bool(self._open)

    def submit(self, key: int, genotypes: np.ndarray, seeds: np.ndarray | None) -> None:
        """Have individuals evaluated, (n, n_genes), with their seeds, (n,). What they did comes from `finished`, by the key."""
        piece = _Piece(self._next, self._next + len(genotypes))
        self._next = piece.stop
        self._open[piece.start] = _Submission(key, piece, genotypes, seeds, [], [])
        self._waiting.append(piece)

    def finished(self) -> list[tuple[int, Evaluation]]:
        """Wait for a worker; returns what is finished since, with the keys. There must be something open."""
        self.step()
        for piece, evaluation in self._done:
            self._template = self._template or Evaluation(*(None if c is None else c[:0] for c in evaluation))
            self._owner(piece).done.append((piece, evaluation))
        for piece, reason in self.invalid.values():
            self._owner(piece).invalid.append((piece, reason))
        self._done.clear()
        self.invalid.clear()
        ready = [submission for submission in self._open.values() if submission.complete]
        for submission in ready:
            del self._open[submission.piece.start]
        ready = [*self._lost, *ready]
        if self._template is None:
            self._lost = ready
            self._check_lost()
            return []
        self._lost = []
        return [(submission.key, self._evaluation(submission)) for submission in ready]

    def end(self) -> None:
        """Nothing more will be submitted, and nothing is open.

        Raises:
            RuntimeError: all that was submitted has failed.
        """
        self._size = 1  # there will be no others that may do better
        self._check_lost()

    def _check_lost(self) -> None:
        if self._lost:
            self._check_hope(sum(submission.piece.size for submission in self._lost), self._lost[-1].invalid[-1][1])

    def _evaluation(self, submission: "_Submission") -> Evaluation:
        assert self._template is not None
        for _, reason in submission.invalid:
            self._spread.failed += 1
            _log.warning("%s: an individual could not be evaluated and is invalid: %s", self._spread.__name__, reason)
        start = submission.piece.start
        parts = [(_Piece(p.start - start, p.stop - start), evaluation) for p, evaluation in submission.done]
        return _assembled(submission.piece.size, parts or [(_Piece(0, 0), self._template)])

    def _owner(self, piece: _Piece) -> "_Submission":
        return next(s for s in self._open.values() if s.piece.start <= piece.start < s.piece.stop)

    def _work(self, piece: _Piece) -> tuple[np.ndarray, np.ndarray | None]:
        owner = self._owner(piece)
        rows = slice(piece.start - owner.piece.start, piece.stop - owner.piece.start)
        return owner.genotypes[rows].copy(), None if owner.seeds is None else owner.seeds[rows].copy()

    def _most(self, workers: int) -> int:
        spread = self._spread
        short = spread._seconds is not None and spread._seconds < _SHORT and spread._timeout is None
        if not short or workers == 1 or self._suspects:
            return workers
        return 2 * workers  # one waits at each worker, or it would do nothing until the next one comes

    def _fresh(self, workers: int) -> _Piece | None:
        return self._waiting.popleft() if self._waiting else None


class _Submission(NamedTuple):
    """Individuals that were submitted together, and what is known of them."""

    key: int
    piece: _Piece
    genotypes: np.ndarray
    seeds: np.ndarray | None
    done: list[tuple[_Piece, Evaluation]]
    invalid: list[tuple[_Piece, str]]

    @property
    def complete(self) -> bool:
        """Whether all of them are done, or given up."""
        return sum(piece.size for piece, _ in (*self.done, *self.invalid)) == self.piece.size
