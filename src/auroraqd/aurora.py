"""AURORA: AUtonomous RObots that Realize their Abilities.

Quality-Diversity search whose behavioural descriptor is learned from the sensory data of what has been found so far [1].

[1] A. Cully, Autonomous skill discovery with Quality-Diversity and Unsupervised Descriptors, GECCO 2019.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import MOST_SEED, finite_rows, flag, function, instance, number, numbers, numeric, shown, whole
from auroraqd._interrupts import uninterrupted
from auroraqd.archive import INVALID, NEW, REJECTED, REPLACED, Archive, UnstructuredArchive, check_like
from auroraqd.batch import Batch, Pending
from auroraqd.descriptor import Descriptor, DescriptorError, Transformer
from auroraqd.history import History, Record
from auroraqd.provenance import changed, described
from auroraqd.resolution import VAT, Automatic
from auroraqd.schedule import Doubling
from auroraqd.selection import Curiosity
from auroraqd.tasks import Evaluation, TaskError, checked, evaluated, name_of
from auroraqd.tasks.noise import seeds_of
from auroraqd.update import FIRST_FITS, Attempts, RefusedUpdate, Sources, Update, updated
from auroraqd.variation import Polynomial

SURVIVAL = 0.25
"""The default share of the stored that must survive an update. Updates of the paper's experiments keep 0.54 to 0.98 of them,
those of auto-encoders the fewest; of fewer than 100 in five dimensions 0.4 were kept."""
_STATUS_NAMES = {REJECTED: "rejected", NEW: "new", REPLACED: "replaced", INVALID: "invalid"}
_MOST = 10**8  # genes, and individuals of a batch
_PATIENCE = 10  # generations without one valid individual before `run` gives up


class Aurora:
    """The loop of AURORA, and the one owner of its state.

    Args:
        n_genes: parameters of a controller; genes are in [0, 1].
        descriptor: any object with scikit-learn's `fit` and `transform`, which is copied; or "hand-coded" (the task's ground
            truth), "genotype", or "observation" (all of it). Of an observation, each channel is scaled to [-1, 1] and all is
            flattened to (n, features), unless the object has an attribute `natural_shape` that is true.
        seed: of all that is random. None: one that is drawn from the system, to be read from the attribute.
        batch_size: individuals a generation.
        archive: empty, or that of another run in this process. Default: `UnstructuredArchive()`.
        selection, variation: how parents are chosen and offspring made.
        resolution: gives l after each update of an unstructured archive; None leaves l alone. By default `VAT()` where the
            descriptor has one or two dimensions, and `Size()` where it has more.
        schedule: at which generations the descriptor is refitted, l redefined, and all are described and added again. A
            descriptor that is not learned is updated likewise, without the refit.
        prior: observations, (n, ...), on which the descriptor is fitted once, now, with its scaling; it is then never refitted.
        survival: the least share of the individuals stored, or of those that the resolution aims at if these are fewer, that
            must survive an update of the descriptor and l; one that leaves fewer is refused, with a warning, and the descriptor
            before it stays (`auroraqd.update`). 0: none is refused for that.
        robust: whether observations far outside all others, one in a hundred at most, are set aside, with a warning, when the
            descriptor and its scaling are fitted (`auroraqd.scaling.far_outside`). False is the rule of the paper.

    Attributes:
        archive: what has been found.
        generation: generations done.
        evaluations: individuals told.
        history: a `Record` for each generation.

    Raises:
        TypeError, ValueError: an argument is of the wrong kind or out of range.
    """

    def __init__(
        self,
        n_genes: int,
        descriptor: str | Transformer,
        *,
        seed: int | None = None,
        batch_size: int = 200,
        archive: Archive | None = None,
        selection: Callable[[Archive, int, np.random.Generator], np.ndarray] = Curiosity(),
        variation: Callable[[np.ndarray, np.random.Generator], np.ndarray] = Polynomial(),
        resolution: Callable[[np.ndarray], float] | None = Automatic(),
        schedule: Callable[[int], bool] = Doubling(),
        prior: ArrayLike | None = None,
        survival: float = SURVIVAL,
        robust: bool = True,
    ) -> None:
        self.n_genes = whole("n_genes", n_genes, most=_MOST)
        self.batch_size = whole("batch_size", batch_size, most=_MOST)
        for name, value in (("selection", selection), ("variation", variation), ("schedule", schedule)):
            function(name, value)
        if resolution is not None:
            function("resolution", resolution)
        if archive is not None:
            instance("archive", archive, Archive, "an archive of auroraqd")
        self.archive = UnstructuredArchive() if archive is None else archive
        self.selection = selection
        self.variation = variation
        self.resolution = _resolution_for(self.archive, resolution)
        self.schedule = schedule
        self.survival = number("survival", survival, most=1, wanted="a share, from 0 to 1")
        self.robust = flag("robust", robust)
        self.generation = 0
        self.evaluations = 0
        self.history = History()
        self.seed = (
            int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else whole("seed", seed, least=0, most=MOST_SEED)
        )
        self._rng = np.random.default_rng(self.seed)
        self._descriptor = Descriptor.checked(descriptor, self._rng)
        self._refits = self._descriptor.learned and prior is None
        if prior is not None:
            if not self._descriptor.learned:
                raise ValueError(f"prior is for descriptors that are learned, not for {shown(descriptor)}")
            self._descriptor = self._descriptor.refitted(
                numeric("prior", prior, " of shape (n, ...)", rows=True, some=True, finite=True)
            )
        self._waiting: Batch | None = None  # individuals told before there were enough for a first fit
        self._update_due = False  # an update was scheduled when there was nothing to update on
        self._attempts = Attempts()  # at updates, since the last that was taken
        self._refused = 0  # updates so far
        self._pending: Pending | None = None
        self._counts = dict.fromkeys(_STATUS_NAMES.values(), 0)
        self._seconds = 0.0
        self._task: dict[str, Any] | None = None  # what it was, as `auroraqd.provenance` describes it
        self._earlier_task: dict[str, Any] | None = None  # of a run that was resumed, until it goes on
        self._made: dict[str, Any] | None = None  # by which commands, and when, as `auroraqd.provenance` has it; when saved

    def __repr__(self) -> str:
        return f"Aurora(generation={self.generation}, evaluations={self.evaluations}, archive={self.archive!r})"

    @property
    def descriptor(self) -> Descriptor:
        """The descriptor as it is now; once it is fitted, `transformer` is what was learned."""
        return self._descriptor

    def describe(self, observation: ArrayLike) -> np.ndarray:
        """Descriptors of observations, (n, ...) to (n, d), by the learned descriptor as it is now.

        Raises:
            RuntimeError: the descriptor is not learned, or not yet.
            ValueError: the observations are no numbers, of another shape than those it was fitted on, or not finite.
        """
        return self._descriptor.describe_observation(observation)

    def reconstruct(self, descriptor: ArrayLike) -> np.ndarray:
        """Observations, (n, ...) in the units of the task, that the learned descriptor expects at descriptors, (n, d).

        Raises:
            RuntimeError: the descriptor is not learned, not yet, or has no `inverse_transform`.
            ValueError: the descriptors are no numbers, or of the wrong shape.
        """
        places = numbers("descriptor", descriptor, " of shape (n, d)", axes=2)
        if len(self.archive) and places.shape[1] != self.archive.descriptor.shape[1]:
            wanted = f"(n, {self.archive.descriptor.shape[1]}), as those in the archive"
            raise ValueError(f"descriptor must have shape {wanted}, got {places.shape}")
        return self._descriptor.reconstruct(places)

    def ask(self, genotypes: ArrayLike | None = None) -> np.ndarray:
        """The next batch to evaluate, (n, n_genes) in [0, 1]: random while nothing is stored, then offspring.

        Args:
            genotypes: (n, n_genes) in [0, 1], to evaluate these, known controllers for instance, and no others.

        Raises:
            RuntimeError: the last batch has not been told.
            ValueError: genotypes has the wrong shape or leaves [0, 1]; or the selection or the variation returned something
                else than it must. Nothing has changed.
        """
        if self._pending is not None:
            raise RuntimeError("ask was called twice: first tell about the batch asked for before, which is in `pending`")
        random = self._rng.bit_generator.state
        with uninterrupted():
            try:
                return self._asked(genotypes)
            except BaseException:  # a strategy that fails has used random numbers, and the run must not take another course
                self._rng.bit_generator.state = random
                raise

    def _asked(self, genotypes: ArrayLike | None) -> np.ndarray:
        since = time.perf_counter()
        if genotypes is not None:
            children = self._checked_genotypes("genotypes", genotypes)
            parent_row = np.full(len(children), -1)
        elif len(self.archive) == 0:
            children = self._rng.random((self.batch_size, self.n_genes))
            parent_row = np.full(self.batch_size, -1)
        else:
            children, parent_row = self._offspring()
        parent_id = np.where(parent_row < 0, -1, self.archive.id[parent_row]) if len(self.archive) else parent_row
        self._pending = Pending(children, parent_id, parent_row, self.archive.rearranged, since)
        return children.copy()

    def tell(self, fitness: ArrayLike, observation: ArrayLike, ground_truth: ArrayLike | None = None) -> np.ndarray:
        """What the batch asked for did, row by row.

        Rows with a NaN or an infinity in fitness or observation are invalid: never stored, their parents debited. That is
        also how to report a crash.

        Args:
            fitness: (n,), larger is better; a constant for pure exploration.
            observation: (n, ...), the sensory data, in any shape.
            ground_truth: (n, ...), if known.

        Returns:
            (n,) int8, the status of each: 0 rejected, 1 new, 2 replaced another, -1 invalid. While there are too few
            individuals for the first fit of the descriptor they wait, and are reported as rejected.

        Raises:
            RuntimeError: nothing was asked for.
            ValueError: wrong shape or number of rows. The batch can be told again; nothing else has changed.
        """
        if self._pending is None:
            raise RuntimeError("tell was called before ask: there is no batch to tell about")
        evaluation = checked(Evaluation(fitness, observation, ground_truth), len(self._pending.genotype))
        self._check_as_before(evaluation)
        was_full = self.archive.full
        status = self._told(self._pending, evaluation)
        if self.archive.full and not was_full:
            warnings.warn(
                f"the archive is full ({len(self.archive)} individuals): from now on, one is stored only in another's place",
                stacklevel=2,
            )
        return status

    @property
    def pending(self) -> np.ndarray | None:
        """The genotypes asked for and not told yet, (n, n_genes), or None."""
        return None if self._pending is None else self._pending.genotype.copy()

    @property
    def seeds(self) -> np.ndarray | None:
        """A seed for each individual of `pending`, (n,) uint64, for a task whose outcome depends on chance; or None."""
        return None if self._pending is None else seeds_of(self.seed, self.evaluations, len(self._pending.genotype))

    def run(
        self,
        task: Callable[..., Any],
        *,
        generations: int | None = None,
        evaluations: int | None = None,
        seconds: float | None = None,
        until_generation: int | None = None,
        initial: ArrayLike | None = None,
        callback: Callable[[Aurora], Any] | Sequence[Callable[[Aurora], Any]] | None = None,
        progress: bool = False,
    ) -> Aurora:
        """Evaluate generations on a task until a budget is used up. Called again, it goes on.

        It can be interrupted (Ctrl-C) at any time: what was found stays, and the next call goes on with the generation that
        was under way.

        Args:
            task: from genotypes (n, n_genes) to an `Evaluation`, or to a tuple of fitness, observation and, if known, ground
                truth, or to observation alone. One whose attribute `seeded` is true is also given `seeds`, (n,) uint64.
            generations, evaluations, seconds: the budgets of this call, at least one of them; the first to be used up
                ends it, at the end of a generation.
            until_generation: a budget too: the generation to reach, counted from the beginning of the run, not of this call. A
                script that resumes its run needs no other.
            initial: (m, n_genes) in [0, 1], known controllers, evaluated first. While nothing is stored, random ones fill
                the batch up.
            callback: called with this object after each generation; the run stops when it returns True. Of several, a sequence,
                all are called, in order.
            progress: whether to show how it goes: a bar on a terminal, a line every ten seconds elsewhere, on standard error.

        Raises:
            TaskError: the task raised, returned something else than promised, or gave nothing but invalid individuals.
            DescriptorError: the descriptor could not be fitted or does not describe.
            TypeError: the task cannot be called.
            ValueError: no budget, or a negative one.

        Warns:
            UserWarning: the run was resumed, and the task, its arguments or its code are others than before.
        """
        function("task", task)
        budget = _Budget(self, generations, evaluations, seconds, until_generation)
        callbacks = _callbacks(callback)
        known = None if initial is None else self._checked_genotypes("initial", initial)
        show_it = flag("progress", progress)
        self._remember(task)
        with _shown(self, budget) if show_it else nullcontext() as show:
            self._run(task, budget, known, callbacks if show is None else [*callbacks, show])
        return self

    def _run(self, task: Callable, budget: _Budget, known: np.ndarray | None, callbacks: list[Callable[[Aurora], Any]]) -> None:
        while not budget.used_up():
            if self._pending is None and known is not None:
                self._ask_known(known)
                known = None
            genotypes = self.ask() if self._pending is None else self._pending.genotype.copy()
            seeds = self.seeds if getattr(task, "seeded", False) else None
            evaluation = evaluated(task, genotypes, seeds, f"at generation {self.generation}")
            try:
                self._check_as_before(evaluation)
            except ValueError as error:
                raise TaskError(f"task {name_of(task)} at generation {self.generation}: {error}") from error
            self.tell(*evaluation)
            self._check_progress(task)
            if any([_is_true(callback(self)) for callback in callbacks]):
                break

    def _remember(self, task: Callable) -> None:
        """Keep which task it is; of a run that was resumed, warn once if it is another than before."""
        now = described(task)
        how = None if self._earlier_task is None else changed(self._earlier_task, now)
        self._task, self._earlier_task = now, None
        if how is not None:
            warnings.warn(f"{how} since the run was saved: what is found from now on may not go with the rest", stacklevel=3)

    def _ask_known(self, known: np.ndarray) -> None:
        """Known controllers as the next batch; in an empty archive, filled up with random ones."""
        missing = max(self.batch_size - len(known), 0) if len(self.archive) == 0 else 0
        with uninterrupted():
            self.ask(np.vstack([known, self._rng.random((missing, self.n_genes))]))

    def _checked_genotypes(self, name: str, genotypes: ArrayLike) -> np.ndarray:
        children = numbers(name, genotypes, f" of shape (n, {self.n_genes})").copy()
        if children.ndim != 2 or children.shape[1] != self.n_genes or len(children) == 0:
            raise ValueError(f"{name} must have shape (n, {self.n_genes}) with n >= 1, got {children.shape}")
        if not ((children >= 0) & (children <= 1)).all():
            raise ValueError(f"{name} must be in [0, 1]")
        return children

    def _check_as_before(self, evaluation: Evaluation) -> None:
        """Raise ValueError when the columns do not match those of the individuals told before."""
        before = self._waiting if self._waiting is not None else self.archive if len(self.archive) else None
        if before is None:
            return
        if (evaluation.ground_truth is None) != (before.ground_truth is None):
            raise ValueError("ground_truth must be given for every generation or for none")
        for name in ("observation", "ground_truth"):
            if getattr(before, name) is not None:
                check_like(name, getattr(evaluation, name), getattr(before, name))

    def _offspring(self) -> tuple[np.ndarray, np.ndarray]:
        n_parents = getattr(self.variation, "n_parents", 1)
        wanted = self.batch_size * n_parents
        rows = np.asarray(self.selection(self.archive, wanted, self._rng))
        if rows.shape != (wanted,) or rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() >= len(self.archive):
            raise ValueError(f"selection must return ({wanted},) rows of the archive, got shape {rows.shape} of {rows.dtype}")
        if n_parents > 1:
            rows = rows.reshape(self.batch_size, n_parents)
        children = np.array(self.variation(self.archive.genotype.take(rows, axis=0), self._rng), np.float64)
        if children.shape != (self.batch_size, self.n_genes) or not (children.min() >= 0 and children.max() <= 1):
            wanted = (self.batch_size, self.n_genes)
            raise ValueError(f"variation must return genotypes of shape {wanted} in [0, 1], got shape {children.shape}")
        return children, rows if n_parents == 1 else rows[:, 0]

    def _told(self, pending: Pending, evaluation: Evaluation) -> np.ndarray:
        """One generation: update if it is time, add, credit, record. Raises before it changes anything."""
        born = np.arange(self.evaluations, self.evaluations + len(pending.genotype))
        batch = Batch(pending.genotype, pending.parent_id, pending.parent_row, born, *evaluation)
        if self._waiting is not None:
            batch = self._waiting.joined(batch)
        readable = self._descriptor.readable(batch.observation, batch.ground_truth)
        valid = finite_rows(batch.fitness) & readable
        scheduled = self._update_due or self.schedule(self.generation)
        first_fit = not self._descriptor.ready
        enough = self._descriptor.rows_to_fit(batch.observation[0].size)
        if first_fit and np.count_nonzero(valid) + len(self.archive) < enough:
            return self._wait(pending, batch, valid, scheduled)
        individuals = batch.only(readable)  # what is invalid by its fitness alone is left to the archive
        update, refusal = None, None
        if scheduled or first_fit or self._attempts.due == self.generation:
            try:
                update = self._updated(batch.only(valid))
            except RefusedUpdate as error:
                refusal = error
        if refusal is not None and first_fit:
            if self._attempts.refused == FIRST_FITS:
                raise DescriptorError(f"{refusal}; it was tried {FIRST_FITS} times before, with fewer individuals") from refusal
            return self._wait(pending, batch, valid, scheduled, refusal)
        described = self._described(individuals, self._descriptor if update is None else update.descriptor)
        # Up to here anything may raise, or be interrupted: fitting takes long. From here on the state changes.
        with uninterrupted():
            if update is not None and (refusal := self._take(update)) is not None:
                described = self._described(individuals, self._descriptor)
            said = self._try_again(refusal, tried=update is not None)
            status = np.full(len(readable), INVALID, np.int8)
            if described is not None:
                status[readable] = self._added(individuals, *described)
            rows = batch.parent_row if self.archive.rearranged == pending.rearranged else None
            self.archive.credit(batch.parent_id, status, rows=rows)
            alone = update is not None and refusal is None and update.l is None and self.resolution is not None
            self._update_due, self._waiting = scheduled and (len(self.archive) == 0 or alone), None
            self._done(pending, status, np.nan if described is None or first_fit else _rmse(described[1]))
        _say(said)
        return status[-len(pending.genotype) :]

    def _wait(
        self, pending: Pending, batch: Batch, valid: np.ndarray, scheduled: bool, refusal: RefusedUpdate | None = None
    ) -> np.ndarray:
        """Keep individuals for a later first fit of the descriptor: there are too few, or it was refused."""
        with uninterrupted():
            said = self._try_again(refusal, tried=False)
            self._update_due, self._waiting = scheduled, batch.only(valid).copied()
            status = np.where(valid, REJECTED, INVALID).astype(np.int8)
            self._done(pending, status[~valid], np.nan)
        _say(said)
        return status[-len(pending.genotype) :]

    def _described(self, individuals: Batch, descriptor: Descriptor) -> tuple[np.ndarray, np.ndarray | None] | None:
        """Descriptors and reconstruction errors; None where there are no individuals."""
        return descriptor.describe(*individuals.sources) if len(individuals.genotype) else None

    def _added(self, individuals: Batch, values: np.ndarray, error: np.ndarray | None) -> np.ndarray:
        return self.archive.add(
            individuals.genotype,
            individuals.fitness,
            individuals.observation,
            values,
            ground_truth=individuals.ground_truth,
            reconstruction_error=error,
            born=individuals.born,
            parent=individuals.parent_id,
        )

    def _done(self, pending: Pending, status: np.ndarray, rmse: float) -> None:
        """Count and record a generation in which individuals were given this status, and whose own had this error."""
        counts = np.bincount(status - INVALID, minlength=len(_STATUS_NAMES)).tolist()  # INVALID is the lowest
        for value, name in _STATUS_NAMES.items():
            self._counts[name] += counts[value - INVALID]
        self._pending = None
        self.generation += 1
        self.evaluations += len(pending.genotype)
        self._seconds += time.perf_counter() - pending.since
        self._record(rmse)

    def _updated(self, individuals: Batch) -> Update | None:
        """What an update would change: on all that is stored, or, while nothing is, on the individuals about to be added; None
        when there are none either.

        Raises:
            RefusedUpdate: it would do harm.
        """
        archive = self.archive
        stored = len(archive) > 0
        if not stored and len(individuals.genotype) == 0:
            return None
        columns: Any = archive if stored else individuals
        sources = Sources(columns.genotype, columns.observation, columns.ground_truth, columns.born)
        enough = len(sources.observation) >= self._descriptor.rows_to_fit(sources.observation[0].size)
        update = updated(
            self._descriptor,
            sources,
            archive.descriptor if stored and self._descriptor.ready else None,
            refit=not self._descriptor.ready or (self._refits and enough),
            robust=self.robust,
            resolution=self.resolution,
        )
        return update if stored else update._replace(values=update.values[:0], error=None)

    def _take(self, update: Update) -> RefusedUpdate | None:
        """Take over a new descriptor: redefine l and add all again; or say why it is not taken."""
        stored = len(self.archive)
        least = math.ceil(self.survival * min(stored, getattr(self.resolution, "individuals", stored)))
        options = {} if update.l is None else {"l": update.l}
        staying = self.archive.redescribe(update.values, reconstruction_error=update.error, least=least, **options)
        if staying < least:
            return RefusedUpdate(
                f"by {update.descriptor} only {staying:,} of {stored:,} individuals would survive, fewer than survival="
                f"{self.survival:g} allows"
            )
        self._descriptor = update.descriptor
        return None

    def _try_again(self, refusal: RefusedUpdate | None, *, tried: bool) -> str | None:
        """Remember that an update was refused, or that it was not; returns what to say of it."""
        if refusal is None:
            self._attempts = Attempts() if tried else self._attempts
            return None
        self._refused += 1
        if self._descriptor.ready:
            self._attempts = self._attempts.after(self.generation)
            then = f"the descriptor before it stays, and it is tried again at generation {self._attempts.due}"
        else:
            self._attempts = Attempts(self._attempts.refused + 1, None)
            then = "individuals wait for the next batch, with which it is tried again"
        return f"no update of the descriptor at generation {self.generation}: {refusal}; {then}"

    def _record(self, rmse: float) -> None:
        error, fitness = self.archive.reconstruction_error, self.archive.fitness
        self.history.append(
            Record(
                generation=self.generation,
                evaluations=self.evaluations,
                size=len(self.archive),
                l=self.archive.l if isinstance(self.archive, UnstructuredArchive) else np.nan,
                **self._counts,
                mean_fitness=_mean(fitness),
                max_fitness=float(fitness.max()) if len(fitness) else np.nan,
                rmse=np.nan if error is None else _mean(error),
                refused=self._refused,
                rmse_new=rmse,
                seconds=self._seconds,
            )
        )

    def _check_progress(self, task: Callable) -> None:
        if self.generation >= _PATIENCE and self._counts["invalid"] == self.evaluations:
            raise TaskError(
                f"task {name_of(task)} gave no valid individual in {self.generation} generations: fitness or observation was "
                f"NaN or infinite for all {self.evaluations} evaluations"
            )


def _mean(values: np.ndarray) -> float:
    with np.errstate(over="ignore"):  # of the largest numbers the mean is infinite
        return float(np.add.reduce(values)) / len(values) if len(values) else np.nan


def _say(warning: str | None) -> None:
    if warning is not None:
        warnings.warn(warning, stacklevel=4)


def _rmse(error: np.ndarray | None) -> float:
    return np.nan if error is None else _mean(error)


class _Budget:
    """How much a call of `run` may use."""

    def __init__(
        self,
        aurora: Aurora,
        generations: int | None,
        evaluations: int | None,
        seconds: float | None,
        until_generation: int | None,
    ):
        if generations is None and evaluations is None and seconds is None and until_generation is None:
            raise ValueError("run needs a budget: generations, evaluations, seconds or until_generation")
        self._aurora = aurora
        self._generations = self._evaluations = self._deadline = np.inf
        if generations is not None:
            self._generations = aurora.generation + whole("generations", generations, least=0)
        if until_generation is not None:
            self._generations = min(self._generations, whole("until_generation", until_generation, least=0))
        if evaluations is not None:
            self._evaluations = aurora.evaluations + whole("evaluations", evaluations, least=0)
        if seconds is not None:
            self._deadline = time.monotonic() + number("seconds", seconds)

    @property
    def last_generation(self) -> int | None:
        """The generation after which it is used up, at the latest; None where only the time says."""
        aurora = self._aurora
        batches = np.ceil(max(self._evaluations - aurora.evaluations, 0) / aurora.batch_size)
        last = min(self._generations, aurora.generation + batches)
        return int(last) if np.isfinite(last) else None

    def used_up(self) -> bool:
        """Whether one of the limits is reached."""
        return (
            self._aurora.generation >= self._generations
            or self._aurora.evaluations >= self._evaluations
            or time.monotonic() >= self._deadline
        )


def _resolution_for(archive: Archive, resolution: Any) -> Any:
    """The resolution, or None for an archive that has no l; there, only defaults, ours and the paper's, may be passed over."""
    if isinstance(archive, UnstructuredArchive):
        return resolution
    if resolution not in (None, Automatic(), VAT(), VAT(robust=False)):
        has_none = f"{type(archive).__name__} has none"
        raise ValueError(f"resolution is for an archive with a distance threshold l, and {has_none}, got {shown(resolution)}")
    return None


def _is_true(value: Any) -> bool:
    """Whether it is True, of Python or of NumPy: what else a callback returns means nothing."""
    return isinstance(value, bool | np.bool_) and bool(value)


def _callbacks(given: Any) -> list[Callable[[Aurora], Any]]:
    """One callback, several or none as a list."""
    if given is None:
        return []
    several = list(given) if isinstance(given, Sequence) else [given]
    for callback in several:
        function("callback", callback)
    return several


def _shown(aurora: Aurora, budget: _Budget) -> Any:
    """A context that shows the progress of a run, and gives a callback."""
    from auroraqd.progress import shown  # Rich takes time to import

    return shown(aurora, budget.last_generation)
