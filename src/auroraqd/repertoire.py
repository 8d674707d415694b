"""The repertoire: what the user takes away from a run."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from auroraqd.descriptor import Descriptor

REQUIRED = ("genotype", "fitness", "observation", "descriptor", "curiosity", "id")
OPTIONAL = ("ground_truth", "reconstruction_error")


class Repertoire:
    """A collection of behaviours: the columns of the archive it comes from, an individual a row, read-only.

    Args:
        columns: at least `genotype`, `fitness`, `observation`, `descriptor`, `curiosity` and `id`, of equal length.
        descriptor: gives the descriptor they were found with; called when it is first needed.
    """

    def __init__(self, columns: Mapping[str, np.ndarray], descriptor: Callable[[], Descriptor]):
        missing = [name for name in REQUIRED if name not in columns]
        if missing:
            raise ValueError(f"a repertoire must have the columns {', '.join(REQUIRED)}; there is no {', '.join(missing)}")
        if len({len(column) for column in columns.values()}) > 1:
            raise ValueError(f"the columns of a repertoire must be of one length, got {[len(c) for c in columns.values()]}")
        for name, ndim in (("genotype", 2), ("fitness", 1), ("descriptor", 2), ("curiosity", 1), ("id", 1)):
            if columns[name].ndim != ndim:
                raise ValueError(f"{name} must have {ndim} axes, got shape {columns[name].shape}")
        self._columns = dict(columns)
        for column in self._columns.values():
            column.flags.writeable = False
        self._load_descriptor = descriptor
        self._descriptor: Descriptor | None = None

    def __len__(self) -> int:
        return len(self._columns["id"])

    def __repr__(self) -> str:
        return f"Repertoire of {len(self)} individuals, descriptors of {self.descriptor.shape[1]} dimensions"

    @property
    def genotype(self) -> np.ndarray:
        """(n, n_genes) float64."""
        return self._columns["genotype"]

    @property
    def fitness(self) -> np.ndarray:
        """(n,) float64."""
        return self._columns["fitness"]

    @property
    def observation(self) -> np.ndarray:
        """(n, ...), in the shape and dtype of the task."""
        return self._columns["observation"]

    @property
    def descriptor(self) -> np.ndarray:
        """(n, d) float64."""
        return self._columns["descriptor"]

    @property
    def ground_truth(self) -> np.ndarray | None:
        """(n, ...), or None."""
        return self._columns.get("ground_truth")

    @property
    def reconstruction_error(self) -> np.ndarray | None:
        """(n,) float64, or None."""
        return self._columns.get("reconstruction_error")

    @property
    def curiosity(self) -> np.ndarray:
        """(n,) float64."""
        return self._columns["curiosity"]

    @property
    def id(self) -> np.ndarray:
        """(n,) int64."""
        return self._columns["id"]

    def describe(self, observation: ArrayLike) -> np.ndarray:
        """Descriptors of other observations, (n, ...) to (n, d), by the learned descriptor of the repertoire.

        Raises:
            RuntimeError: the descriptor is not learned.
            ValueError: wrong shape; or the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        return self._loaded().describe_observation(np.asarray(observation))

    def reconstruct(self, descriptor: ArrayLike) -> np.ndarray:
        """Observations, (n, ...) in the units of the task, that the learned descriptor expects at descriptors, (n, d).

        Raises:
            RuntimeError: the descriptor is not learned, or has no `inverse_transform`.
            ValueError: the transformer is of a type that is not trusted, see `auroraqd.load`.
        """
        return self._loaded().reconstruct(np.asarray(descriptor, np.float64))

    def _loaded(self) -> Descriptor:
        if self._descriptor is None:
            self._descriptor = self._load_descriptor()
        return self._descriptor
