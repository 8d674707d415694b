"""Emitters of pyribs, evolution strategies among them, in a run of auroraqd."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import in_words, number, numbers, one_of, shown, whole
from auroraqd.archives.base import INVALID, NEW, REJECTED, REPLACED, Archive, Info
from auroraqd.individuals import Columns

_THEIRS = {REJECTED: 0, INVALID: 0, REPLACED: 1, NEW: 2}  # what pyribs calls them
_RANKERS = ("2imp", "imp", "2rd", "rd", "2obj", "obj")
_STRATEGIES = ("cma_es", "sep_cma_es")


class Elites:
    """An archive as emitters of pyribs read it.

    Args:
        archive: with individuals.
        seed: of `sample_elites`.
    """

    objective_dim = ()
    field_list = ("solution", "objective", "measures")
    dtypes = dict.fromkeys(field_list, np.dtype(np.float64))

    def __init__(self, archive: Archive, seed: int) -> None:
        self._archive = archive
        self._rng = np.random.default_rng(seed)

    def __len__(self) -> int:
        return len(self._archive)

    @property
    def empty(self) -> bool:
        """Whether nothing is stored."""
        return len(self) == 0

    @property
    def solution_dim(self) -> int:
        """Genes."""
        return self._archive.genotype.shape[1]

    @property
    def measure_dim(self) -> int:
        """Dimensions of the descriptor."""
        return self._archive.descriptor.shape[1]

    @property
    def lower_bounds(self) -> np.ndarray:
        """(d,) least of the descriptors that are stored, in each dimension."""
        return self._archive.descriptor.min(axis=0)

    @property
    def upper_bounds(self) -> np.ndarray:
        """(d,) largest of them."""
        return self._archive.descriptor.max(axis=0)

    def data(self, *_: Any, **__: Any) -> dict[str, np.ndarray]:
        """All that is stored, by the names of pyribs."""
        return self._rows(np.arange(len(self)))

    def sample_elites(self, n: int) -> dict[str, np.ndarray]:
        """n individuals, each as likely as another."""
        return self._rows(self._rng.integers(len(self), size=n))

    def _rows(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        archive = self._archive
        return {"solution": archive.genotype[rows], "objective": archive.fitness[rows], "measures": archive.descriptor[rows]}


@dataclass(frozen=True)
class CMA:
    """Makes an `EvolutionStrategyEmitter`, as in CMA-ME [1]: it starts at an individual that is stored, and at another when
    none of its batch is stored.

    [1] M. C. Fontaine, J. Togelius, S. Nikolaidis, A. K. Hoover, Covariance Matrix Adaptation for the Rapid Illumination of
    Behavior Space, GECCO 2020.

    Args:
        sigma: first standard deviation of a step; genes span [0, 1].
        batch_size: solutions after which it adapts.
        ranker: what it adapts to: "2imp" (what is new, then what replaced another, then the rest; among these by fitness),
            "2rd" (likewise, then by a random direction of the descriptor), "2obj" (what is stored, then the rest, by fitness);
            "imp", "rd", "obj": without the first.
        es: the evolution strategy: "cma_es", or for many genes "sep_cma_es".

    Raises:
        ValueError: one is out of range.
    """

    sigma: float = 0.1
    batch_size: int = 36
    ranker: str = "2imp"
    es: str = "cma_es"

    def __post_init__(self) -> None:
        _check_step(self.sigma, self.batch_size)
        one_of("ranker", self.ranker, _RANKERS)
        one_of("es", self.es, _STRATEGIES)

    def __call__(self, archive: Any, n_genes: int, seed: int) -> Any:
        """See `Ribs`."""
        from ribs.emitters import EvolutionStrategyEmitter  # pyright: ignore[reportMissingImports] - optional

        options = {"ranker": self.ranker, "es": self.es, "batch_size": self.batch_size, "seed": seed}
        return EvolutionStrategyEmitter(archive, x0=_one_of(archive), sigma0=self.sigma, **options)


@dataclass(frozen=True)
class IsoLine:
    """Makes an `IsoLineEmitter`: steps along the line between two individuals that are stored.

    Args:
        sigma: standard deviation of a step in any direction; genes span [0, 1].
        line_sigma: of one along the line, as a share of the distance.
        batch_size: solutions at once.

    Raises:
        ValueError: one is out of range.
    """

    sigma: float = 0.01
    line_sigma: float = 0.2
    batch_size: int = 36

    def __post_init__(self) -> None:
        _check_step(self.sigma, self.batch_size)
        number("line_sigma", self.line_sigma)

    def __call__(self, archive: Any, n_genes: int, seed: int) -> Any:
        """See `Ribs`."""
        from ribs.emitters import IsoLineEmitter  # pyright: ignore[reportMissingImports] - optional

        options = {"iso_sigma": self.sigma, "line_sigma": self.line_sigma, "batch_size": self.batch_size, "seed": seed}
        return IsoLineEmitter(archive, x0=_one_of(archive), **options)


@dataclass(frozen=True)
class Gaussian:
    """Makes a `GaussianEmitter`: Gaussian steps from individuals that are stored.

    Args:
        sigma: standard deviation of a step; genes span [0, 1].
        batch_size: solutions at once.

    Raises:
        ValueError: one is out of range.
    """

    sigma: float = 0.1
    batch_size: int = 36

    def __post_init__(self) -> None:
        _check_step(self.sigma, self.batch_size)

    def __call__(self, archive: Any, n_genes: int, seed: int) -> Any:
        """See `Ribs`."""
        from ribs.emitters import GaussianEmitter  # pyright: ignore[reportMissingImports] - optional

        return GaussianEmitter(archive, sigma=self.sigma, x0=_one_of(archive), batch_size=self.batch_size, seed=seed)


def _check_step(sigma: float, batch_size: int) -> None:
    number("sigma", sigma, least=1e-300, wanted="above 0")
    whole("batch_size", batch_size, least=2, most=10**8)


def _one_of(archive: Elites) -> np.ndarray:
    return archive.sample_elites(1)["solution"][0]


class _Result(NamedTuple):
    """What became of a solution."""

    fitness: float
    descriptor: np.ndarray
    status: int
    value: float


class _Batch:
    """The solutions, (n, n_genes), that an emitter of pyribs waits to be told about, and what is known of them, by row."""

    def __init__(self, emitter: Any, solutions: np.ndarray) -> None:
        self.emitter, self.solutions = emitter, solutions
        self.results: dict[int, _Result | None] = {}

    def tell(self) -> None:
        """Tell the emitter; unless nothing is known of where they led."""
        valid = [result for result in self.results.values() if result is not None and result.status != INVALID]
        if not valid:
            return
        least = min(result.fitness for result in valid), min(result.value for result in valid)
        lost = _Result(least[0], np.mean([result.descriptor for result in valid], axis=0), INVALID, least[1])
        results = [self.results[row] for row in range(len(self.solutions))]
        columns = zip(*[lost if result is None or result.status == INVALID else result for result in results], strict=True)
        objective, descriptor, status, value = columns
        told = {"status": np.array([_THEIRS[one] for one in status]), "value": np.array(value)}
        self.emitter.tell(self.solutions, np.array(objective), np.array(descriptor), told)


class _Place(NamedTuple):
    """Where a solution, (n_genes,), stands in its batch."""

    batch: _Batch
    row: int
    solution: np.ndarray


@dataclass(eq=False)
class Ribs:
    """Emitters of pyribs, https://pyribs.org: `pip install "auroraqd[ribs]"`.

    Solutions are asked for and told in any number and order. An emitter of pyribs is told its batch when all of it is known;
    what is asked for before comes from the next emitter, which is made when it is needed first. So there are several where a
    generation is larger than a batch of pyribs, as in CMA-ME, and where workers do not wait for each other.

    They are told what became of their solutions: their fitness as objective, their descriptors as measures, and as `add_info`
    the status, and a value: the fitness of one that is new; of one that took another's place, how much fitter it is; of one
    that is rejected, how much less fit it is than the fittest of all, for pyribs' value, how much less than the one that kept
    it out, is not known here. One that is invalid, or was withdrawn, counts as rejected, with the least of its batch, and the
    mean descriptor. Their solutions are clipped to [0, 1].

    When the descriptor changes, and when a run is resumed, the emitters are made again: they have measures of the old
    descriptor, and pyribs has no way to save its state. A run that is resumed therefore takes another course than one that was
    not.

    Args:
        make: `make(archive, n_genes, seed)` gives an emitter; `CMA()`, `IsoLine()` and `Gaussian()` do so. The archive has what
            the emitters of pyribs read, `sample_elites(1)["solution"][0]` for an x0 for instance.

    Raises:
        TypeError: it cannot be called.
        ValueError: pyribs is not installed.

    Examples:
        >>> import auroraqd
        >>> from auroraqd.emitters.ribs import CMA
        >>> emitter = auroraqd.emitters.Ribs(CMA(sigma=0.05))
        >>> aurora = auroraqd.Aurora(2, "genotype", emitter=emitter, seed=0)
        >>> aurora.run(auroraqd.tasks.Ballistic(), generations=3).generation
        3
    """

    make: Callable[[Any, int, int], Any]

    __repr__ = in_words

    def __post_init__(self) -> None:
        if not callable(self.make):
            raise TypeError(f"make must be callable, make(archive, n_genes, seed), got {shown(self.make)}")
        if find_spec("ribs") is None:
            raise ValueError('pyribs is not installed: pip install "auroraqd[ribs]"')
        self._said = False
        self._start()

    def _start(self) -> None:
        self._idle: list[Any] = []  # emitters of pyribs that have been told all that they asked
        self._queue: list[_Place] = []  # solutions that nobody has asked for yet
        self._out: dict[bytes, list[_Place]] = {}  # those that were asked for, by their genotypes

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See `auroraqd.emitters`. They have no parents.

        Raises:
            TypeError: what `make` gave is no emitter.
            ValueError: the emitter gives something else than solutions.
        """
        while len(self._queue) < n:
            self._queue += self._batch(archive, rng)
        given, self._queue = self._queue[:n], self._queue[n:]
        for place in given:
            self._out.setdefault(place.solution.tobytes(), []).append(place)
        return np.stack([place.solution for place in given]), np.full(n, -1)

    def tell(self, archive: Archive, batch: Columns, info: Info) -> None:
        """See `auroraqd.emitters`. What was asked for before the descriptor changed is passed over."""
        fitness = batch["fitness"]
        value = np.where(info.status == NEW, fitness, np.where(info.status == REPLACED, info.gain, np.nan))
        best = max(archive.fitness.max(initial=-np.inf), fitness.max(initial=-np.inf, where=np.isfinite(fitness)))
        value = np.where(info.status == REJECTED, fitness - best, value)
        columns = fitness.tolist(), batch["descriptor"], info.status.tolist(), value.tolist()
        self._known(batch["genotype"], [_Result(*row) for row in zip(*columns, strict=True)])

    def withdrawn(self, genotype: np.ndarray) -> None:
        """See `auroraqd.emitters`."""
        self._known(genotype, [None] * len(genotype))

    def updated(self, archive: Archive, describe: Callable[[Columns], Columns]) -> None:
        """See `auroraqd.emitters`: they are made again, for their measures are of the old descriptor."""
        self._start()

    def state(self) -> dict[str, Any]:
        """Nothing, and a warning, the first time."""
        if not self._said:
            self._said = True
            warnings.warn(
                "the state of an emitter of pyribs cannot be saved: when the run is resumed, the emitter starts anew",
                stacklevel=2,
            )
        return {}

    def _batch(self, archive: Archive, rng: np.random.Generator) -> list[_Place]:
        """What one emitter asks next."""
        emitter = self._idle[0] if self._idle else self._made(archive, int(rng.integers(2**63)))
        found = numbers("solutions of the pyribs emitter", emitter.ask(), axes=2, finite=True)
        n, n_genes = len(found), archive.genotype.shape[1]
        if found.shape != (n, n_genes) or n == 0:
            raise ValueError(f"make must give an emitter of solutions of shape (n, {n_genes}), got {found.shape}")
        self._idle = self._idle[1:]
        batch = _Batch(emitter, np.clip(found, 0, 1))
        return [_Place(batch, row, solution) for row, solution in enumerate(batch.solutions)]

    def _known(self, genotype: np.ndarray, results: list[_Result | None]) -> None:
        """What became of solutions, (n, n_genes); None: it will never be known. Emitters whose batch is complete are told."""
        complete = []
        for row, result in zip(genotype, results, strict=True):
            places = self._out.get(key := row.tobytes(), [])
            if places:
                place = places.pop(0)
                place.batch.results[place.row] = result
                if len(place.batch.results) == len(place.batch.solutions):
                    complete.append(place.batch)
            if not places:
                self._out.pop(key, None)
        self._idle += [batch.emitter for batch in complete]
        for batch in complete:
            batch.tell()

    def _made(self, archive: Archive, seed: int) -> Any:
        made = self.make(Elites(archive, seed), archive.genotype.shape[1], seed)
        for name in ("ask", "tell"):
            if not callable(getattr(made, name, None)):
                raise TypeError(f"make must give an emitter of pyribs, with ask() and tell(), got {made!r}")
        return made
