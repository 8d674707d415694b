"""AURORA: AUtonomous RObots that Realize their Abilities.

Quality-Diversity search whose behavioural descriptor is learned from the sensory data of what has been found so far [1].

[1] A. Cully, Autonomous skill discovery with Quality-Diversity and Unsupervised Descriptors, GECCO 2019.
"""

from __future__ import annotations

import copy
import math
import os
import time
import warnings
import zlib
from array import array
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from auroraqd._checks import (
    MOST_SEED,
    check_genotypes,
    flag,
    function,
    instance,
    number,
    numbers,
    shown,
    whole,
    whole_numbers,
)
from auroraqd._interrupts import uninterrupted
from auroraqd._notebooks import card, facts_of
from auroraqd.archives.base import INVALID, NEW, REJECTED, REPLACED, Archive, Info
from auroraqd.archives.unstructured import UnstructuredArchive
from auroraqd.control.resolution import VAT, Automatic
from auroraqd.control.schedule import Doubling
from auroraqd.control.update import FIRST_FITS, Attempts, RefusedUpdate, Update, updated
from auroraqd.descriptors.descriptor import Descriptor, DescriptorError, Transformer
from auroraqd.emitters.base import Calls, Shared, shared
from auroraqd.emitters.genetic import Genetic
from auroraqd.emitters.proposal import Asked, Event, Proposal
from auroraqd.emitters.selection import Curiosity
from auroraqd.emitters.variation import Polynomial
from auroraqd.history import History, Record
from auroraqd.individuals import Columns, check_like
from auroraqd.observations import features_of, finite_rows, observations
from auroraqd.provenance import changed, described
from auroraqd.tasks import Evaluation, checked

SURVIVAL = 0.25
"""The default share of the stored that must survive an update. Updates of the paper's experiments keep 0.54 to 0.98 of them,
those of auto-encoders the fewest; of fewer than 100 in five dimensions 0.4 were kept."""
_STATUS_NAMES = {REJECTED: "rejected", NEW: "new", REPLACED: "replaced", INVALID: "invalid"}
_MOST = 10**8  # genes, and individuals of a batch
_PATIENCE = 10  # generations without one valid individual before `run` gives up
_NO_ERROR = np.empty(0)
_TICKETS, _RUNS = 32, 2**20  # exact as floats too: bits for those of one run; runs that are told apart, by their seeds


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
        selection, variation: how parents are chosen and offspring made, `Curiosity()` and `Polynomial()` by default: the short
            form of `emitter=Genetic(selection, variation)`.
        emitter: what makes genotypes, which is copied; or several that share each batch alike, or pairs of an emitter and its
            share. See `auroraqd.emitters`.
        resolution: gives l after each update of an unstructured archive; None leaves l alone. By default `VAT()` where the
            descriptor has one or two dimensions, and `Size()` where it has more.
        schedule: at which generations the descriptor is refitted, l redefined, and all are described and added again. A
            descriptor that is not learned is updated likewise, without the refit.
        prior: observations, (n, ...) or streams, on which the descriptor is fitted once, now, with its scaling; it is then
            never refitted.
        survival: the least share of the individuals stored, or of those that the resolution aims at if these are fewer, that
            must survive an update of the descriptor and l; one that leaves fewer is refused, with a warning, and the descriptor
            before it stays (`auroraqd.control.update`). 0: none is refused for that.
        robust: whether observations far outside all others, one in a hundred at most, are set aside, with a warning, when the
            descriptor and its scaling are fitted (`auroraqd.descriptors.scaling.far_outside`). False is the rule of the paper.
        observations: a folder on a disk that is fast, for the observations of the archive while the run goes on, where they are
            too many for memory; see `Archive.keep_observations`. None: in memory.

    Attributes:
        archive: what has been found.
        generation: generations done.
        evaluations: individuals told.
        history: a `Record` for each generation.

    Raises:
        OSError: the folder for observations cannot be written.
        TypeError, ValueError: an argument is of the wrong kind or out of range.

    Examples:
        >>> import auroraqd
        >>> from sklearn.decomposition import PCA
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0)
        >>> aurora.run(task, generations=5).archive.observation.shape
        (734, 50, 2)
        >>> genotypes = aurora.ask()  # the same by hand
        >>> status = aurora.tell(*task(genotypes))
        >>> aurora.generation, aurora.evaluations
        (6, 1200)
    """

    def __init__(
        self,
        n_genes: int,
        descriptor: str | Transformer,
        *,
        seed: int | None = None,
        batch_size: int = 200,
        archive: Archive | None = None,
        selection: Callable[[Archive, int, np.random.Generator], np.ndarray] | None = None,
        variation: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None,
        emitter: Any = None,
        resolution: Callable[[np.ndarray], float] | None = Automatic(),
        schedule: Callable[[int], bool] = Doubling(),
        prior: ArrayLike | None = None,
        survival: float = SURVIVAL,
        robust: bool = True,
        observations: str | os.PathLike | None = None,
    ) -> None:
        self.n_genes = whole("n_genes", n_genes, most=_MOST)
        self.batch_size = whole("batch_size", batch_size, most=_MOST)
        function("schedule", schedule)
        if resolution is not None:
            function("resolution", resolution)
        if archive is not None:
            instance("archive", archive, Archive, "an archive of auroraqd")
        self.archive = UnstructuredArchive() if archive is None else archive
        self._emitters = _emitters(emitter, selection, variation)
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
            self._descriptor = self._descriptor.refitted(_observed("prior", prior), limited=self.robust)
        self._waiting: Columns | None = None  # individuals told before there were enough for a first fit
        self._update_due = False  # an update was scheduled when there was nothing to update on
        self._attempts = Attempts()  # at updates, since the last that was taken
        self._refused = 0  # updates so far
        self._asked: dict[int, Asked] = {}  # by ticket: what is out
        self._current: int | None = None  # the ticket of what `ask()` gave
        self._tickets = 0  # given so far
        self._next_evaluation = 0
        self._part = 0  # individuals of the generation under way that were told in parts
        self._events = array("q")  # pairs, if anything was told in parts; see `events`
        self._counts = dict.fromkeys(_STATUS_NAMES.values(), 0)
        self._seconds = 0.0
        self._until = 0.0  # the time up to which they are counted
        self._latest: tuple[Columns, Columns, np.ndarray, Info] | None = None  # what was told last, in this process
        self._task: dict[str, Any] | None = None  # what it was, as `auroraqd.provenance` describes it
        self._next_task: dict[str, Any] | None = None  # of a run that has begun, until something of it is told
        self._earlier_task: dict[str, Any] | None = None  # of a run that was resumed, until it goes on
        self._made: dict[str, Any] | None = None  # by which commands, and when, as `auroraqd.provenance` has it; when saved
        if observations is not None:
            self.archive.keep_observations(observations)

    def __repr__(self) -> str:
        return f"Aurora(generation={self.generation}, evaluations={self.evaluations}, archive={self.archive!r})"

    def _repr_html_(self) -> str:
        last = self.history.last
        facts = {
            "described by": f"{self.descriptor}".strip("'"),
            "seed": self.seed,
            "generation": f"{self.generation:,}",
            "evaluations": f"{self.evaluations:,}",
            "archive": type(self.archive).__name__,
            "RMSE": None if last is None or last.rmse != last.rmse else f"{last.rmse:.4f}",
        }
        return card("Aurora", {**facts, **facts_of(self.archive)}, "individuals", self.archive)

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

    @overload
    def ask(self, genotypes: int) -> Proposal: ...
    @overload
    def ask(self, genotypes: Sequence | np.ndarray | None = None) -> np.ndarray: ...
    def ask(self, genotypes: int | Sequence | np.ndarray | None = None) -> np.ndarray | Proposal:
        """The next genotypes to evaluate, in [0, 1]: random while nothing is stored, then offspring.

        Args:
            genotypes: nothing, for the next batch, (batch_size, n_genes), which is a generation; or an array, (n, n_genes), to
                evaluate these, known controllers for instance, and no others. Or a number n, any number of times: n individuals
                that are told by their ticket, in any order, or withdrawn. Then as many as `batch_size` are a generation.

        Returns:
            (n, n_genes) float64; for a number, a `Proposal`: `ticket`, `genotype`, `parent` and `seeds`.

        Raises:
            RuntimeError: the last batch has not been told.
            ValueError: genotypes has the wrong shape or leaves [0, 1]; or an emitter, a selection or a variation returned
                something else than it must. Nothing has changed.
        """
        if isinstance(genotypes, int | np.integer) and not isinstance(genotypes, bool):
            return self._ask(whole("genotypes", genotypes, most=2**31 - 1), alone=False)
        if self._current is not None:
            raise RuntimeError("ask was called twice: first tell about the batch asked for before, which is in `pending`")
        return self._ask(
            self.batch_size if genotypes is None else self._checked_genotypes("genotypes", genotypes), alone=True
        ).genotype.copy()

    def _ask(self, wanted: int | np.ndarray, *, alone: bool) -> Proposal:
        since = time.perf_counter()
        random = self._rng.bit_generator.state
        with uninterrupted():
            try:
                made = self._emitted(wanted) if isinstance(wanted, int) else _without_parents(wanted)
            except BaseException:  # a strategy that fails has used random numbers, and the run must not take another course
                self._rng.bit_generator.state = random
                raise
            ticket = self._ticket_base + self._tickets
            proposal = Proposal(ticket, *made, self._next_evaluation, self.seed)
            self._tickets += 1
            self._next_evaluation += len(proposal.genotype)
            self._asked[ticket] = Asked(proposal, alone, since)
            if not alone:
                if not self._events and self.generation:
                    self._happened(Event.ALONE, self.generation)
                self._happened(Event.ASKED, len(proposal.genotype))
            self._current = ticket if alone else self._current
        return proposal

    def _emitted(self, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """n genotypes, the ids of their parents, and which emitter made them."""
        made: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        try:
            for which, count in enumerate(self._emitters.counts(n, self._rng)):
                if count:
                    made.append(self._emitted_by(which, count))
        except BaseException:  # what others were asked for will never be told
            calls = Calls("when another could not be asked")
            for genotype, _, which in made:
                if which[0] >= 0:
                    calls.call(self._emitters.emitters[which[0]], "withdrawn", genotype)
            raise
        if len(made) == 1:
            return made[0]
        genotype, parent, emitter = (np.concatenate(parts) for parts in zip(*made, strict=True))
        return genotype, parent, emitter

    def _emitted_by(self, which: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `_emitted`, by one emitter; at random while nothing is stored, but of one that starts by itself."""
        emitter = self._emitters.emitters[which]
        if len(self.archive) == 0 and not getattr(emitter, "starts", False):
            return _without_parents(self._rng.random((n, self.n_genes)))
        found = emitter.ask(self.archive, n, self._rng)
        # The genetic emitter looks at its own.
        genotype, parent = found if type(emitter) is Genetic else self._checked_offspring(emitter, n, found)
        return genotype, parent, np.full(n, which)

    def _checked_offspring(self, emitter: Any, n: int, found: Any) -> tuple[np.ndarray, np.ndarray]:
        called = f"emitter {type(emitter).__name__} must return"
        if not isinstance(found, tuple) or len(found) != 2:
            raise ValueError(f"{called} a tuple of genotypes and their parents, got {type(found).__name__}")
        genotype, parent = numbers(f"{called} genotypes that", found[0]), whole_numbers(f"{called} parents that", found[1])
        check_genotypes(called, genotype, (n, self.n_genes))
        if parent.shape != (n,) or parent.min() < -1 or parent.max() >= self.archive.state["next_id"]:
            raise ValueError(f"{called} parents as ({n},) ids of individuals of the archive, or -1, got {shown(parent)}")
        return genotype, parent

    def withdraw(self, ticket: int) -> None:
        """Forget a proposal that will never be told: its worker is lost.

        Raises:
            ValueError: there is none with this ticket; see `tell`.
            EmitterError: an emitter raised when it was told so. It is withdrawn.
        """
        asked = self._asked_for(whole("ticket", ticket, least=0))
        calls = Calls(f"at generation {self.generation}")
        with uninterrupted():
            self._forget(asked)
            if not asked.alone:
                self._happened(Event.WITHDRAWN, ticket - self._ticket_base)
            for which, emitter in enumerate(self._emitters.emitters):
                rows = asked.proposal.emitter == which
                if rows.any():
                    calls.call(emitter, "withdrawn", asked.proposal.genotype[rows])
        calls.end()

    def _happened(self, kind: Event, value: int) -> None:
        self._events.extend((kind, value))

    @property
    def events(self) -> np.ndarray:
        """(n, 2) int64: what happened in which order, if anything was asked for by numbers; `auroraqd.asynchronous.replay` does
        it again. Their kinds are those of `auroraqd.emitters.proposal.Event`.
        """
        return np.array(self._events, np.int64).reshape(-1, 2)

    def _forget(self, asked: Asked) -> None:
        ticket = asked.proposal.ticket
        del self._asked[ticket]
        if ticket == self._current:
            self._current = None

    def tell(
        self,
        fitness: ArrayLike,
        observation: ArrayLike,
        ground_truth: ArrayLike | None = None,
        *,
        ticket: int | None = None,
    ) -> np.ndarray:
        """What the individuals asked for did, row by row.

        Rows with a NaN or an infinity in fitness or observation are invalid: never stored, their parents debited. That is
        also how to report a crash.

        Args:
            fitness: (n,), larger is better; a constant for pure exploration.
            observation: (n, ...), the sensory data, in any shape; or a mapping of names to several such arrays.
            ground_truth: (n, ...), if known.
            ticket: of the proposal, if it was asked for by a number.

        Returns:
            (n,) int8, the status of each: 0 rejected, 1 new, 2 replaced another, -1 invalid. While there are too few
            individuals for the first fit of the descriptor they wait, and are reported as rejected.

        Raises:
            RuntimeError: nothing was asked for.
            ValueError: wrong shape or number of rows; or a ticket that was never given, is of another run, or was told or
                withdrawn before. The batch can be told again; nothing else has changed.
            EmitterError: an emitter raised when it was told what became of its genotypes, or that the descriptor has changed.
                The individuals are told.
        """
        asked = self._asked_for(ticket)
        evaluation = checked(Evaluation(fitness, observation, ground_truth), len(asked.proposal.genotype))
        self._check_as_before(evaluation)
        return self._tell_checked(evaluation, asked)

    def _tell_checked(self, evaluation: Evaluation, asked: Asked) -> np.ndarray:
        """As `tell`, of arrays that have been checked."""
        was_full = self.archive.full
        status = self._told(asked, evaluation)
        if self.archive.full and not was_full:
            warnings.warn(
                f"the archive is full ({len(self.archive)} individuals): from now on, one is stored only in another's place",
                stacklevel=3,
            )
        return status

    def _asked_for(self, ticket: int | None) -> Asked:
        if ticket is None and self._current is None:
            if self._asked:
                raise RuntimeError(
                    f"tell needs the ticket of one of {len(self._asked)} proposals that are out: tell(..., ticket=)"
                )
            raise RuntimeError("tell was called before ask: there is no batch to tell about")
        wanted = whole("ticket", self._current if ticket is None else ticket, least=0)
        if wanted in self._asked:
            return self._asked[wanted]
        if wanted >> _TICKETS != self._ticket_base >> _TICKETS:
            raise ValueError(f"ticket must be of this run, and {wanted} is of another")
        known = wanted < self._ticket_base + self._tickets
        raise ValueError(
            f"ticket must be of a proposal that is out, and {wanted} {'is so no longer' if known else 'was never given'}"
        )

    @property
    def _ticket_base(self) -> int:
        return _first_ticket(self.seed)

    @property
    def out(self) -> list[Proposal]:
        """What was asked for by numbers and is neither told nor withdrawn, in the order in which it was asked for."""
        return [asked.proposal for asked in self._asked.values() if not asked.alone]

    @property
    def latest(self) -> tuple[Columns, Info] | None:
        """The individuals told last, as `Columns`, the descriptor of invalid ones NaN, and what became of them.

        None before there are any. Those that wait for the first fit of the descriptor are among them once it is fitted.
        """
        return None if self._latest is None else (_all_of(*self._latest), self._latest[3])

    @property
    def pending(self) -> np.ndarray | None:
        """The genotypes of the batch asked for and not told yet, (n, n_genes), or None."""
        return None if self._current is None else self._asked[self._current].proposal.genotype.copy()

    @property
    def seeds(self) -> np.ndarray | None:
        """A seed for each individual of `pending`, (n,) uint64, for a task whose outcome depends on chance; or None."""
        return None if self._current is None else self._asked[self._current].proposal.seeds

    @property
    def selection(self) -> Any:
        """How parents are chosen, if by a `Genetic` emitter alone; or None."""
        return self._genetic and self._genetic.selection

    @selection.setter
    def selection(self, value: Any) -> None:
        self._emitters = shared(Genetic(value, self.variation))

    @property
    def variation(self) -> Any:
        """How offspring are made, if by a `Genetic` emitter alone; or None."""
        return self._genetic and self._genetic.variation

    @variation.setter
    def variation(self, value: Any) -> None:
        self._emitters = shared(Genetic(self.selection, value))

    @property
    def _genetic(self) -> Genetic | None:
        first, *others = self._emitters.emitters
        return first if isinstance(first, Genetic) and not others else None

    def run(
        self,
        task: Callable[..., Any],
        *,
        generations: int | None = None,
        evaluations: int | None = None,
        seconds: float | None = None,
        until_generation: int | None = None,
        initial: ArrayLike | None = None,
        callback: Any = None,
        progress: bool = False,
        asynchronous: bool = False,
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
            callback: called with this object after each generation; the run stops when it returns True. Or an object with some
                of the methods of `auroraqd.callbacks`. Of several, a sequence, all are called, in order.
            progress: whether to show how it goes: a bar on a terminal, a line every ten seconds elsewhere, on standard error.
            asynchronous: whether a worker that is free gets new offspring at once, instead of waiting for its generation. The
                task must be one of `auroraqd.evaluate.over`. Then `batch_size` individuals told are a generation, and a budget
                of evaluations is kept to the last one; see `auroraqd.asynchronous`.

        Raises:
            TaskError: the task raised, returned something else than promised, or gave nothing but invalid individuals.
            DescriptorError: the descriptor could not be fitted or does not describe.
            EmitterError: an emitter raised when it was told; what was found is kept, and the next call goes on.
            TypeError: the task cannot be called.
            ValueError: no budget, or a negative one.

        Warns:
            UserWarning: the run was resumed, and the task, its arguments or its code are others than before; or, at the end,
                the task has never given a valid individual.
        """
        from auroraqd.running import Budget, run

        function("task", task)
        budget = Budget(self, generations, evaluations, seconds, until_generation)
        known = None if initial is None else self._checked_genotypes("initial", initial)
        if flag("asynchronous", asynchronous) and not callable(getattr(type(task), "stream", None)):
            raise TypeError(f"task must be one over workers, of auroraqd.evaluate.over, to be asynchronous, got {shown(task)}")
        run(self, task, budget, known, callback, flag("progress", progress), asynchronous)
        return self

    def _remember(self, task: Callable) -> str | None:
        """Keep which task it is. Of a run that was resumed, says once if it is another than before, and how."""
        now = described(task)
        how = None if self._earlier_task is None else changed(self._earlier_task, now)
        self._next_task, self._earlier_task = now, None
        if self._task is None:
            self._task = now
        return how

    def _ask_known(self, known: np.ndarray) -> None:
        """Known controllers, (m, n_genes), as the next batch; while nothing is stored, filled up with random ones."""
        missing = max(self.batch_size - len(known), 0) if len(self.archive) == 0 else 0
        with uninterrupted():
            self.ask(np.vstack([known, self._rng.random((missing, self.n_genes))]))

    @property
    def _all_invalid(self) -> bool:
        """Whether there was not one valid individual."""
        return self._counts["invalid"] == self.evaluations

    @property
    def _hopeless(self) -> bool:
        """Whether there was none in many generations."""
        return self.generation >= _PATIENCE and self._all_invalid

    def _checked_genotypes(self, name: str, genotypes: ArrayLike) -> np.ndarray:
        children = numbers(name, genotypes, f" of shape (n, {self.n_genes})").copy()
        if children.ndim != 2 or children.shape[1] != self.n_genes or len(children) == 0:
            raise ValueError(f"{name} must have shape (n, {self.n_genes}) with n >= 1, got {children.shape}")
        outside = children[~((children >= 0) & (children <= 1))]
        if len(outside):
            raise ValueError(f"{name} must be in [0, 1], got {outside[0]:g}")
        return children

    def _check_as_before(self, evaluation: Evaluation) -> None:
        """Raise ValueError when the columns do not match those of the individuals told before."""
        if self._waiting is not None:
            observation, truth = self._waiting["observation"], self._waiting.get("ground_truth")
        elif len(self.archive):
            observation, truth = self.archive.observation, self.archive.ground_truth
        else:
            return
        if (evaluation.ground_truth is None) != (truth is None):
            raise ValueError("ground_truth must be given for every generation or for none")
        check_like("observation", evaluation.observation, observation)
        if truth is not None:
            check_like("ground_truth", evaluation.ground_truth, truth)

    def _told(self, asked: Asked, evaluation: Evaluation) -> np.ndarray:
        """Individuals that were evaluated: update if it is time, add, credit, record. Raises before it changes anything."""
        proposal, n = asked.proposal, len(asked.proposal.genotype)
        batch = _batch_of(proposal, evaluation)
        if self._waiting is not None:
            batch = self._waiting.joined(batch)
        readable = self._descriptor.readable(batch)
        valid = finite_rows(batch["fitness"]) & readable
        begins = asked.alone or self._part == 0  # a generation
        scheduled = self._update_due or (begins and self.schedule(self.generation))
        first_fit = not self._descriptor.ready
        # Told in parts, the first generation is waited for: neither a descriptor nor l is to be made of its first few.
        begun = not asked.alone and self.generation == 0 and self._part + n < self.batch_size
        if begun or (first_fit and self._too_few(batch, valid)):
            return self._wait(asked, batch, valid, scheduled)
        update, refusal = None, None
        if scheduled or first_fit or (begins and self._attempts.due == self.generation):
            try:
                update = self._updated(batch.take(valid))
            except RefusedUpdate as error:
                refusal = error
        if refusal is not None and first_fit:
            if self._attempts.refused == FIRST_FITS:
                raise DescriptorError(f"{refusal}; it was tried {FIRST_FITS} times before, with fewer individuals") from refusal
            return self._wait(asked, batch, valid, scheduled, refusal)
        # What is invalid by its fitness alone is left to the archive: all observations in one piece need no copy.
        legible = batch.chosen(readable)
        sound = valid if legible is batch else valid[readable]
        described = _described(legible, self._descriptor if update is None else update.descriptor)
        # Up to here anything may raise, or be interrupted: fitting takes long. From here on the state changes.
        calls = Calls(f"at generation {self.generation}")
        with uninterrupted():
            if update is not None and (refusal := self._take(update, calls)) is not None:
                described = _described(legible, self._descriptor)
            said = self._try_again(refusal, tried=update is not None)
            status = self._added(batch, described, readable, sound, calls)
            self.archive.credited(batch["parent"], status)
            follows = self.resolution is None or hasattr(self.resolution, "control")  # l is no matter of updates
            alone = update is not None and refusal is None and update.l is None and not follows
            self._update_due, self._waiting = scheduled and (len(self.archive) == 0 or alone), None
            self._recall(asked, status[-n:])
            errors = None if first_fit else described.get("reconstruction_error")
            self._done(asked, status, _NO_ERROR if errors is None else errors[sound])
        _say(said)
        calls.end()
        return status[-n:]

    def _too_few(self, batch: Columns, valid: np.ndarray) -> bool:
        """Whether the descriptor cannot be fitted on what is stored and, (n,) bool, those of a batch that are valid."""
        return int(valid.sum()) + len(self.archive) < self._descriptor.rows_to_fit(features_of(batch["observation"]))

    def _wait(
        self, asked: Asked, batch: Columns, valid: np.ndarray, scheduled: bool, refusal: RefusedUpdate | None = None
    ) -> np.ndarray:
        """Keep individuals for a later first fit of the descriptor: there are too few, or it was refused."""
        with uninterrupted():
            said = self._try_again(refusal, tried=False)
            self._update_due, self._waiting = scheduled, batch.take(valid).copied()
            status = np.where(valid, REJECTED, INVALID).astype(np.int8)
            self._recall(asked, status[-len(asked.proposal.genotype) :])
            self._done(asked, status[~valid], _NO_ERROR)
        _say(said)
        return status[-len(asked.proposal.genotype) :]

    def _added(self, batch: Columns, described: Columns, readable: np.ndarray, sound: np.ndarray, calls: Calls) -> np.ndarray:
        """Add individuals, and tell the emitters what became of all.

        Args:
            batch: n individuals.
            described: the m that are readable, with their descriptors.
            readable: (n,) bool.
            sound: (m,) bool, those to be added.
            calls: of the emitters.
        """
        info = self.archive.insert(described, sound) if described.rows else Info.none(0)
        if described.rows < batch.rows:
            info = info.among(readable)
        self._latest = batch, described, readable, info
        listening = [which for which, emitter in enumerate(self._emitters.emitters) if hasattr(emitter, "tell")]
        told = _all_of(batch, described, readable, info) if listening else batch
        for which in listening:
            rows = batch["emitter"] == which
            if rows.any():
                calls.call(self._emitters.emitters[which], "tell", self.archive, told.take(rows), info.only(rows))
        return info.status

    def _recall(self, asked: Asked, status: np.ndarray) -> None:
        """Keep the order in which individuals were told, and which of them were invalid, which may have been the workers."""
        first = asked.proposal.first
        if not asked.alone:
            for row in np.flatnonzero(status == INVALID).tolist():
                self._happened(Event.INVALID, first + row)
            self._happened(Event.TOLD, asked.proposal.ticket - self._ticket_base)
        elif self._events:
            self._happened(Event.ALONE, 1)

    def _done(self, asked: Asked, status: np.ndarray, error: np.ndarray) -> None:
        """Count individuals that were given this status, and of which these, (m,), are the errors of reconstruction; record the
        generation if it is one.
        """
        told = status.tobytes()  # int8: a byte each
        for value, name in _STATUS_NAMES.items():
            self._counts[name] += told.count(value & 0xFF)
        n, now = len(asked.proposal.genotype), time.perf_counter()
        self._forget(asked)
        self._task, self._next_task = self._next_task or self._task, None
        self.evaluations += n
        self._seconds += now - max(asked.since, self._until)  # those that overlap count once
        self._until = now
        if not asked.alone:
            self._part += n
            if self._part < self.batch_size:
                return
            self._part -= self.batch_size
        self.generation += 1
        if len(self.archive) and hasattr(self.resolution, "control"):
            self.resolution.control(self.archive, self.generation)
        self._record(error)

    def _updated(self, individuals: Columns) -> Update | None:
        """What an update would change: on all that is stored, or, while nothing is, on the individuals about to be added; None
        when there are none either.

        Raises:
            RefusedUpdate: it would do harm.
        """
        archive = self.archive
        stored = len(archive) > 0
        if not stored and individuals.rows == 0:
            return None
        sources = archive.columns if stored else individuals
        enough = sources.rows >= self._descriptor.rows_to_fit(features_of(sources["observation"]))
        refit = not self._descriptor.ready or (self._refits and enough)
        resolution = self.resolution
        if stored and hasattr(resolution, "control"):  # then it was asked for l once, and changes it from there
            l = archive.l if isinstance(archive, UnstructuredArchive) else 0.0
            scales = refit and l > 0 and hasattr(resolution, "rescaled")
            resolution = partial(resolution.rescaled, l, archive.descriptor) if scales else None
        update = updated(
            self._descriptor,
            sources,
            archive.descriptor if stored and self._descriptor.ready else None,
            refit=refit,
            robust=self.robust,
            resolution=resolution,
        )
        return update if stored else update._replace(values=update.values[:0], error=None)

    def _take(self, update: Update, calls: Calls) -> RefusedUpdate | None:
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
        for emitter in self._emitters.emitters:
            calls.call(emitter, "updated", self.archive, partial(_described, descriptor=self._descriptor))
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

    @np.errstate(over="ignore")  # of the largest numbers the mean is infinite
    def _record(self, new_error: np.ndarray) -> None:
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
                rmse_new=_mean(new_error),
                seconds=self._seconds,
            )
        )


@cache
def _first_ticket(seed: int) -> int:
    """Of a run: those of runs with other seeds differ."""
    return (1 + zlib.crc32(str(seed).encode()) % _RUNS) << _TICKETS


def _batch_of(proposal: Proposal, evaluation: Evaluation) -> Columns:
    """Individuals that were evaluated."""
    fitness, observation, truth = evaluation
    columns = {
        "genotype": proposal.genotype,
        "parent": proposal.parent,
        "emitter": proposal.emitter,
        "born": proposal.born,
        "fitness": fitness,
        "observation": observation,
    }
    return Columns(columns if truth is None else {**columns, "ground_truth": truth})


def _mean(values: np.ndarray) -> float:
    return float(np.add.reduce(values)) / len(values) if len(values) else np.nan


def _say(warning: str | None) -> None:
    if warning is not None:
        warnings.warn(warning, stacklevel=4)


def _observed(name: str, values: Any) -> np.ndarray:
    """Observations that a descriptor can be fitted on.

    Raises:
        ValueError: they are not.
    """
    found = observations(name, values)
    if len(found) == 0 or features_of(found) == 0 or not finite_rows(found).all():
        raise ValueError(f"{name} must be finite numbers of shape (n, ...), with entries, got {shown(values)}")
    return found


def _described(individuals: Columns, descriptor: Descriptor) -> Columns:
    """The columns that an archive takes."""
    if individuals.rows == 0:
        return Columns({})
    values, error = descriptor.describe(individuals)
    found = {"descriptor": values} if error is None else {"descriptor": values, "reconstruction_error": error}
    return individuals.without("emitter") | found


def _all_of(batch: Columns, described: Columns, readable: np.ndarray, info: Info) -> Columns:
    """A batch with its descriptors, and errors of reconstructions if there are any, NaN where invalid; what is readable, (n,)
    bool, is described.
    """
    found: dict[str, np.ndarray] = {"descriptor": np.full((batch.rows, 0), np.nan)}
    for name, values in described.only("descriptor", "reconstruction_error").items():
        found[name] = np.full((batch.rows, *values.shape[1:]), np.nan)
        found[name][readable] = values
        found[name][info.status == INVALID] = np.nan
    return batch.without("emitter") | found


def _without_parents(genotype: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    nobody = np.full(len(genotype), -1)
    return genotype, nobody, nobody


def _emitters(emitter: Any, selection: Any, variation: Any) -> Shared:
    """Of the arguments, in their short form or not."""
    if emitter is None:
        return shared(
            Genetic(Curiosity() if selection is None else selection, Polynomial() if variation is None else variation)
        )
    if selection is not None or variation is not None:
        raise ValueError("selection and variation are the short form of emitter: give these, or that")
    return copy.deepcopy(shared(emitter))


def _resolution_for(archive: Archive, resolution: Any) -> Any:
    """The resolution, or None for an archive that has no l; there, only defaults, ours and the paper's, may be passed over."""
    if isinstance(archive, UnstructuredArchive):
        return resolution
    if resolution not in (None, Automatic(), VAT(), VAT(robust=False)):
        has_none = f"{type(archive).__name__} has none"
        raise ValueError(f"resolution is for an archive with a distance threshold l, and {has_none}, got {shown(resolution)}")
    return None
