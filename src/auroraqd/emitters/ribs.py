"""Emitters of pyribs, evolution strategies among them, in a run of auroraqd."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from auroraqd._checks import numbers, shown
from auroraqd.archives.base import INVALID, NEW, REJECTED, REPLACED, Archive, Info
from auroraqd.individuals import Columns

_THEIRS = {REJECTED: 0, INVALID: 0, REPLACED: 1, NEW: 2}  # what pyribs calls them


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


@dataclass(eq=False)
class Ribs:
    """An emitter of pyribs, https://pyribs.org: `pip install "auroraqd[ribs]"`.

    It is told what became of its solutions: their fitness as objective, their descriptors as measures, and as `add_info` the
    status, and as value the fitness, for by how much one improves on another is not known here. One that is invalid counts as
    rejected, with the least fitness and the mean descriptor of its batch. Their solutions are clipped to [0, 1].

    When the descriptor changes, and when a run is resumed, the emitter is made again: it has measures of the old descriptor,
    and pyribs has no way to save its state. A run that is resumed therefore takes another course than one that was not.

    Args:
        make: `make(archive, n_genes, seed)` gives the emitter, with a `batch_size` as large as the share of a batch that it is
            asked for. The archive has what the emitters of pyribs read, `sample_elites(1)["solution"][0]` for an x0 for
            instance.

    Raises:
        TypeError: it cannot be called.

    Examples:
        >>> import auroraqd
        >>> from ribs.emitters import GaussianEmitter
        >>> def gaussian(archive, n_genes, seed):
        ...     return GaussianEmitter(archive, sigma=0.1, x0=[0.5] * n_genes, batch_size=36, seed=seed)
        >>> aurora = auroraqd.Aurora(2, "genotype", emitter=auroraqd.emitters.Ribs(gaussian), batch_size=36, seed=0)
        >>> aurora.run(auroraqd.tasks.Ballistic(), generations=3).generation
        3
    """

    make: Callable[[Any, int, int], Any]

    def __post_init__(self) -> None:
        if not callable(self.make):
            raise TypeError(f"make must be callable, make(archive, n_genes, seed), got {shown(self.make)}")
        self._emitter: Any = None
        self._asked = np.empty((0, 0))  # solutions that it has not been told about
        self._said = False

    def ask(self, archive: Archive, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See `auroraqd.emitters`. They have no parents.

        Raises:
            ModuleNotFoundError: pyribs is not installed.
            TypeError: what `make` gave is no emitter.
            ValueError: the emitter gives another number of solutions, or something else than solutions.
        """
        if self._emitter is None:
            self._emitter = self._made(archive, int(rng.integers(2**63)))
        found = numbers("solutions of the pyribs emitter", self._emitter.ask(), axes=2, finite=True)
        if found.shape != (n, archive.genotype.shape[1]):
            wanted = n, archive.genotype.shape[1]
            raise ValueError(
                f"make must give an emitter with batch_size={n}, for solutions of shape {wanted}, got {found.shape}"
            )
        self._asked = np.clip(found, 0, 1)
        return self._asked.copy(), np.full(n, -1)

    def tell(self, archive: Archive, batch: Columns, info: Info) -> None:
        """See `auroraqd.emitters`. What is not the batch that was asked for last, whole, is passed over."""
        if self._emitter is None or not np.array_equal(batch["genotype"], self._asked):
            return
        valid = np.flatnonzero(info.status != INVALID)
        self._asked = self._asked[:0]
        if len(valid) == 0:  # nothing is known of where they led
            return
        fitness, descriptor = batch["fitness"].copy(), batch["descriptor"].copy()
        gone = info.status == INVALID
        fitness[gone], descriptor[gone] = fitness[valid].min(), descriptor[valid].mean(axis=0)
        status = np.array([_THEIRS[status] for status in info.status.tolist()])
        self._emitter.tell(batch["genotype"], fitness, descriptor, {"status": status, "value": fitness.copy()})

    def updated(self, archive: Archive, describe: Callable[[Columns], Columns]) -> None:
        """See `auroraqd.emitters`: it is made again, for its measures are of the old descriptor."""
        self._emitter = None

    def state(self) -> dict[str, Any]:
        """Nothing, and a warning, the first time."""
        if not self._said:
            self._said = True
            warnings.warn(
                "the state of an emitter of pyribs cannot be saved: when the run is resumed, the emitter starts anew",
                stacklevel=2,
            )
        return {}

    def _made(self, archive: Archive, seed: int) -> Any:
        try:
            import ribs.emitters  # noqa: F401 # pyright: ignore[reportMissingImports] - optional
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(f'Ribs needs pyribs, pip install "auroraqd[ribs]": {error}') from None
        made = self.make(Elites(archive, seed), archive.genotype.shape[1], seed)
        for name in ("ask", "tell"):
            if not callable(getattr(made, name, None)):
                raise TypeError(f"make must give an emitter of pyribs, with ask() and tell(), got {made!r}")
        return made
