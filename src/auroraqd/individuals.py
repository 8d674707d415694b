"""Individuals as columns: arrays of one length, in which row i is one individual.

A generation is data: what an emitter proposes, a task measures, an archive stores and the user takes away are all `Columns`.
`KNOWN` is the one list of what an individual may have; a column that is not on it is one of an archive's own.
"""

from __future__ import annotations

from collections.abc import ItemsView, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from auroraqd._checks import instance, mapping, numbers, numeric, rows_of, whole_numbers
from auroraqd.observations import check_same_streams, finite_rows, has_streams, observations, streams_of


class Kind(NamedTuple):
    """What a column must be.

    Attributes:
        axes: of the array; None: any.
        dtype: float64 or int64; None: that of the task.
        always: whether every stored individual has it. Others all individuals of an archive have, or none.
        finite: whether a NaN or an infinity is refused where individuals are stored.
        unknown: what stands where it is not known, in columns that earlier versions did not keep; None: nothing can.
    """

    axes: int | None
    dtype: type | None
    always: bool = True
    finite: bool = True
    unknown: int | None = None


KNOWN: dict[str, Kind] = {
    "genotype": Kind(2, np.float64),
    "fitness": Kind(1, np.float64),
    "observation": Kind(None, None),
    "descriptor": Kind(2, np.float64),
    "curiosity": Kind(1, np.float64),
    "id": Kind(1, np.int64),
    "ground_truth": Kind(None, None, always=False, finite=False),
    "reconstruction_error": Kind(1, np.float64, always=False, finite=False),
    "born": Kind(1, np.int64, unknown=-1),
    "parent": Kind(1, np.int64, unknown=-1),
}


_NONE = np.empty(0, np.int64)


class Columns(Mapping[str, np.ndarray]):
    """Arrays of one length by name. A value: what changes it gives a new one.

    Args:
        arrays: by name, of at least one axis. Their lengths must agree, which is not looked at; see `measured`.

    Attributes:
        rows: their length.
    """

    __slots__ = ("_arrays", "_chosen", "_source", "rows")

    def __init__(self, arrays: Mapping[str, np.ndarray]) -> None:
        self._arrays = dict(arrays)
        self.rows = len(next(iter(self._arrays.values()))) if self._arrays else 0
        self._source: Mapping[str, np.ndarray] = {}  # arrays of which only the chosen rows, (rows,), are meant; see `chosen`
        self._chosen = _NONE

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self._source and name not in self._arrays:
            self._arrays[name] = self._source[name].take(self._chosen, axis=0)
        return self._arrays[name]

    def _all(self) -> dict[str, np.ndarray]:
        for name in self._source:
            self[name]
        return self._arrays

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    # What `Mapping` derives from these takes ten times as long.
    def __contains__(self, name: object) -> bool:
        return name in self._arrays or name in self._source

    def items(self) -> ItemsView[str, np.ndarray]:
        """Names and arrays."""
        return self._all().items()

    def get(self, name: str, default: Any = None) -> Any:
        """The array of this name, or the default."""
        return self[name] if name in self else default

    def __or__(self, others: Mapping[str, np.ndarray]) -> Columns:
        """These, and others beside them or in their place."""
        both = Columns({**self._arrays, **others})
        if self._source:
            both._source, both._chosen, both.rows = self._source, self._chosen, self.rows
        return both

    def __repr__(self) -> str:
        return f"Columns of {self.rows} rows: {', '.join(f'{name} {array.dtype}' for name, array in self.items())}"

    def only(self, *names: str) -> Columns:
        """Those of these names that there are."""
        return Columns({name: self[name] for name in names if name in self})

    def without(self, *names: str) -> Columns:
        """All but those of these names."""
        return Columns({name: array for name, array in self.items() if name not in names})

    def take(self, rows: np.ndarray) -> Columns:
        """The rows of these numbers, (m,) int, or where (n,) bool is true; itself where that is all."""
        chosen = self.chosen(rows)
        chosen._all()
        return chosen

    def chosen(self, rows: np.ndarray) -> Columns:
        """As `take`, but an array is copied when it is asked for: until then, the arrays of these must not change."""
        if rows.dtype == bool:
            if np.count_nonzero(rows) == len(rows):  # a tenth of the time of `all`
                return self
            rows = np.flatnonzero(rows)
        chosen = Columns({})
        chosen.rows, chosen._chosen, chosen._source = len(rows), rows, self._arrays
        if self._source:
            chosen._arrays = {name: array.take(rows, axis=0) for name, array in self._arrays.items()}
            chosen._source, chosen._chosen = self._source, self._chosen.take(rows)
        return chosen

    def joined(self, others: Columns) -> Columns:
        """These rows, and after them those of others, with the same columns."""
        return Columns({name: np.concatenate([array, others[name]]) for name, array in self.items()})

    def copied(self) -> Columns:
        """The same in memory of its own."""
        return Columns({name: array.copy() for name, array in self.items()})


def measured(given: Mapping[str, Any]) -> Columns:
    """Columns of individuals from what a user gives, None for those that are not known.

    Raises:
        ValueError: one is no array of numbers, or of the wrong number of axes; rows do not agree; a genotype is not finite.
    """
    columns: dict[str, np.ndarray] = {}
    for name, values in given.items():
        kind = KNOWN[name]
        if values is None and kind.unknown is not None:
            columns[name] = np.full(len(columns["genotype"]), kind.unknown)
        elif kind.dtype is np.int64:
            columns[name] = whole_numbers(name, values, axes=1)
        elif name == "observation":
            columns[name] = observations(name, values)
        elif values is not None or kind.always:
            columns[name] = (numeric if kind.dtype is None else numbers)(name, values, axes=kind.axes, rows=True)
    n = len(columns["genotype"])
    for name, rows in columns.items():
        if len(rows) != n:
            raise ValueError(f"{name} must have {n} rows, as genotype has, got shape {rows.shape}")
    if not np.isfinite(columns["genotype"]).all():
        raise ValueError("genotype must be finite, got a NaN or an infinity")
    return Columns(columns)


def stored(arrays: Mapping[str, np.ndarray]) -> Columns:
    """The columns of individuals that are stored somewhere, those that earlier versions did not keep filled in.

    Raises:
        ValueError: they cannot be.
    """
    arrays = mapping("columns", arrays)
    missing = [name for name, kind in KNOWN.items() if kind.always and kind.unknown is None and name not in arrays]
    if missing:
        raise ValueError(f"columns of stored individuals must have {', '.join(missing)}")
    n = len(arrays["genotype"]) if np.ndim(arrays["genotype"]) else 0
    for name, array in arrays.items():
        instance(name, array, np.ndarray, "an array")
        kind = KNOWN.get(name, Kind(None, None, finite=False))
        for stream in streams_of(array).values():
            if stream.dtype.kind not in "biuf" or stream.dtype.itemsize > 8 or kind.dtype not in (None, array.dtype):
                wanted = "numbers" if kind.dtype is None else np.dtype(kind.dtype)
                raise ValueError(f"{name} must be {wanted}, got {array.dtype}")
        if array.ndim == 0 or kind.axes not in (None, array.ndim) or len(array) != n:
            wanted = "rows" if kind.axes is None else f"{kind.axes} axes"
            raise ValueError(f"{name} must have {wanted}, {n} as genotype has, got shape {array.shape}")
        if kind.finite and not finite_rows(array).all():
            raise ValueError(f"{name} must be finite, got a NaN or an infinity")
    if n:
        check_dimensions(arrays["descriptor"])
    if len(np.unique(arrays["id"])) < n:
        raise ValueError("id must differ between individuals, and some are the same")
    unknown = {name: np.full(n, kind.unknown) for name, kind in KNOWN.items() if kind.unknown is not None}
    found = {**unknown, **arrays}
    return Columns({name: found[name] for name in [*KNOWN, *(set(found) - set(KNOWN))] if name in found})


def check_dimensions(descriptor: np.ndarray) -> None:
    """Raise ValueError where descriptors, (n, d), have no dimension."""
    if descriptor.shape[1] == 0:
        raise ValueError("descriptor must have a dimension at least, got none")


def check_like(name: str, rows: np.ndarray, known: np.ndarray) -> None:
    """Raise ValueError unless rows fit into a column that is there, in shape and without loss in dtype."""
    if has_streams(rows) or has_streams(known):
        check_same_streams(name, rows, known)
        for stream, of in streams_of(rows).items():
            check_like(f"{name} {stream}", of, known[stream])
        return
    if rows.shape[1:] != known.shape[1:]:
        raise ValueError(f"{name} must have shape {rows_of(known.shape[1:])}, as before, got {rows.shape}")
    if rows.dtype != known.dtype and not np.can_cast(rows.dtype, known.dtype, "safe"):
        raise ValueError(f"{name} must have dtype {known.dtype}, as before, got {rows.dtype}")


class Individuals:
    """What can be read of stored individuals: their columns, as attributes, all read-only."""

    @property
    def columns(self) -> Columns:
        """All columns that there are; none while nothing has been stored."""
        raise NotImplementedError

    def __len__(self) -> int:
        return self.columns.rows

    def _column(self, name: str, *row_shape: int) -> np.ndarray:
        found = self._found(name)
        return np.empty((0, *row_shape), KNOWN[name].dtype) if found is None else found

    def _found(self, name: str) -> np.ndarray | None:
        return self.columns.get(name)

    @property
    def genotype(self) -> np.ndarray:
        """(n, n_genes) float64: controller parameters."""
        return self._column("genotype", 0)

    @property
    def fitness(self) -> np.ndarray:
        """(n,) float64: quality, larger is better."""
        return self._column("fitness")

    @property
    def observation(self) -> np.ndarray:
        """(n, ...), in the shape and dtype of the task: sensory data. Of several streams (n,), each by its name, (n, ...)."""
        return self._column("observation", 0)

    @property
    def descriptor(self) -> np.ndarray:
        """(n, d) float64: behavioural descriptor."""
        return self._column("descriptor", 0)

    @property
    def ground_truth(self) -> np.ndarray | None:
        """(n, ...): what the task knows about the behaviour, or None when it does not tell."""
        return self._found("ground_truth")

    @property
    def reconstruction_error(self) -> np.ndarray | None:
        """(n,) float64: root mean square error of the observation reconstructed from its descriptor, or None."""
        return self._found("reconstruction_error")

    @property
    def curiosity(self) -> np.ndarray:
        """(n,) float64: how often offspring was stored (+1) or not (-0.5)."""
        return self._column("curiosity")

    @property
    def id(self) -> np.ndarray:
        """(n,) int64: unique, given in the order of storing; rows are not sorted by it, for some replace others."""
        return self._column("id")

    @property
    def born(self) -> np.ndarray:
        """(n,) int64: the number of its evaluation in its run, the first is 0; -1 where it is not known."""
        return self._column("born")

    @property
    def parent(self) -> np.ndarray:
        """(n,) int64: the id of its parent, which may have been replaced; -1 for none, or where it is not known."""
        return self._column("parent")
