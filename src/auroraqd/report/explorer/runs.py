"""What a page holds of a run: plain values and arrays, by which the browser shows and exports its skills."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.neighbors import NearestNeighbors

from auroraqd.aurora import Aurora
from auroraqd.descriptors.descriptor import Descriptor, Transformer
from auroraqd.history import History
from auroraqd.repertoire import Repertoire
from auroraqd.report.explorer.moments import moments
from auroraqd.report.explorer.places import about, called, genes_of, robot_in, truth_names
from auroraqd.report.explorer.sights import by_worth
from auroraqd.report.explorer.spaces import space
from auroraqd.report.explorer.tables import back, single, wholes
from auroraqd.report.explorer.views import BYTES, View, fitting
from auroraqd.runs import folders
from auroraqd.runs.snapshots import Snapshot, load_snapshots
from auroraqd.runs.state import settings_of

_NEIGHBOURS = 15
_LEAST_SHARE = 0.2  # of the bytes of a page, for what is observed, however many films there are


@dataclass(frozen=True)
class Source:
    """A run to show.

    Args:
        repertoire: its skills.
        name: of the run.
        code: Python that loads the skills.
        snapshots: how they were at updates.
        films: of some of them, by their rows; see `auroraqd.report.explorer.films`.
    """

    repertoire: Repertoire
    name: str
    code: str
    snapshots: Sequence[Snapshot] = ()
    films: Mapping[int, dict[str, Any]] = field(default_factory=dict)


def source_of(run: Any) -> Source:
    """The source of a run folder, of a run, or of a repertoire.

    Raises:
        TypeError: it is something else.
        FileNotFoundError, ValueError: see `auroraqd.load`; or a run has found nothing.
    """
    if isinstance(run, Repertoire):
        return Source(run, "repertoire", "repertoire")
    if isinstance(run, Aurora):
        name = f"run of seed {run.seed}"
        check_any(name, len(run.archive))
        columns = {column: rows.copy() for column, rows in run.archive.columns.items()}
        return Source(Repertoire(columns, _Live(run)), name, "aurora.archive")
    if not isinstance(run, str | os.PathLike):
        raise TypeError(f"run must be a run folder, an auroraqd.Aurora or an auroraqd.Repertoire, got {type(run).__name__}")
    path = Path(run)
    repertoire, name = folders.load(path), path.name or str(path.absolute().name)
    return Source(repertoire, name, f"auroraqd.load({os.fspath(path)!r})", _snapshots(path, repertoire))


def _snapshots(path: Path, repertoire: Repertoire) -> list[Snapshot]:
    """Those that are of the run as far as it has come."""
    with suppress(OSError, ValueError):
        last = repertoire.history.last
        if last is not None:
            return load_snapshots(path, repertoire._origin.seed(), last.generation)
    return []


def check_any(name: str, skills: int) -> None:
    """Raise ValueError unless there are skills."""
    if skills == 0:
        raise ValueError(f"{name} is empty, nothing was stored in its run: there is no skill to explore")


@dataclass(frozen=True)
class _Live:
    """The origin of the skills of a run in this process."""

    aurora: Aurora

    def descriptor(self) -> Descriptor:
        return self.aurora.descriptor

    def transformer(self) -> Transformer | None:
        return self.aurora.descriptor.transformer

    def seed(self) -> int:
        return self.aurora.seed

    def config(self) -> dict[str, Any]:
        return {**settings_of(self.aurora), "provenance": {"task": self.aurora._task}}

    def history(self) -> History:
        return self.aurora.history


def content(source: Source, most: int, share: float = 1.0, *, live: bool = False) -> dict[str, Any]:
    """What the page holds of a run, as values that become JSON, and arrays.

    Args:
        source: of the run, with a skill at least.
        most: skills; of more, as many at random are shown.
        share: of the bytes of a page that are for this run.
        live: whether there is a server, which draws films.
    """
    repertoire, config = source.repertoire, _config(source.repertoire)
    views = [View.of(repertoire, stream) for stream in by_worth(repertoire.observation)]
    filmed = 0.75 * sum(
        len(film["image"]) for film in source.films.values()
    )  # what is observed is base64 too, and counted before
    share = max(share - filmed / BYTES, _LEAST_SHARE * share)
    rows = _some(len(repertoire), min(most, max(int(share * BYTES / views[0].bytes_each), 1)), source.films)
    shown = [view for view, fits in zip(views, fitting(views, len(rows), share), strict=True) if fits]
    spaces = _spaces(repertoire, config, rows)
    placed, places = _place(spaces)
    return {
        "name": source.name,
        "about": about(config),
        "code": source.code,
        "total": len(repertoire),
        "first": _middle(repertoire.descriptor[rows]),
        "rows": wholes(rows),
        "id": wholes(repertoire.id[rows]),
        "parent": wholes(repertoire.parent[rows]),
        "born": wholes(repertoire.born[rows]),
        "spaces": spaces,
        "values": _values(repertoire, rows),
        "placed": placed,
        "places": places,
        "moments": moments(source.snapshots, spaces, placed),
        "streams": {view.stream: view.content(repertoire, config, rows) for view in shown},
        "left_out": [view.stream for view in views if view not in shown],
        "films": {str(place): source.films[row] for place, row in enumerate(rows.tolist()) if row in source.films},
        "filmed": _filmed(config, live),
        "facts": _facts(repertoire, config),
    }


def _config(repertoire: Repertoire) -> Mapping[str, Any]:
    """The settings of its run, if they are to be had: skills can be looked at without."""
    with suppress(OSError, ValueError):
        return repertoire.config
    return {}


def _filmed(config: Mapping[str, Any], live: bool) -> str:
    """How films of skills are to be had that are not in the page: "asked" of the server, or "written" into another page; ""
    where there are none.
    """
    return ("asked" if live else "written") if robot_in(config) else ""


def _some(n: int, most: int, always: Collection[int] = ()) -> np.ndarray:
    """Rows of `most` of n, at random, in their order, and these of `always`."""
    return np.union1d(np.random.default_rng(0).permutation(n)[:most], np.array(sorted(always), np.int64))


def _middle(descriptor: np.ndarray) -> int:
    """The skill to begin with: one of the usual."""
    return int(np.argmin(np.abs(descriptor - descriptor.mean(axis=0)).sum(axis=1)))


def _spaces(repertoire: Repertoire, config: Mapping[str, Any], rows: np.ndarray) -> dict[str, Any]:
    """The spaces in which skills are points: names of their columns, and which two are shown first."""
    descriptor, truth, genes = repertoire.descriptor, repertoire.ground_truth, genes_of(config, repertoire.genotype.shape[1])
    spaces = {"descriptor": space("Descriptor space", descriptor, rows, _numbered("descriptor", descriptor))}
    if truth is not None:
        flat = truth.reshape(len(truth), -1).astype(np.float64)
        spaces["truth"] = space("Ground truth", flat, rows, truth_names(config, flat.shape[1]))
    values = repertoire.genotype if genes is None else genes.scale(repertoire.genotype)
    names = _numbered("gene", values) if genes is None else genes.names
    spaces["genes"] = space("Genes", values, rows, names) | {
        "units": [""] * len(names) if genes is None else genes.units,
        "bounds": [[0, 1]] * len(names) if genes is None else genes.bounds.tolist(),
    }
    return spaces


def _numbered(name: str, values: np.ndarray) -> list[str]:
    return [f"{name} {column + 1}" for column in range(values.shape[1])]


def _values(repertoire: Repertoire, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Numbers of skills by name; those that are the same for all are left out."""
    found = {
        "fitness": repertoire.fitness[rows],
        "novelty": _novelty(repertoire.descriptor, rows),
        "curiosity": repertoire.curiosity[rows],
        "born": repertoire.born[rows],
        "reconstruction error": None if repertoire.reconstruction_error is None else repertoire.reconstruction_error[rows],
    }
    kept = {name: values for name, values in found.items() if values is not None and len(values)}
    return {name: single(values) for name, values in kept.items() if np.ptp(values) > 0}


def _novelty(descriptor: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Mean distance to the nearest others."""
    k = min(_NEIGHBOURS, len(descriptor) - 1)
    if k == 0:
        return np.zeros(len(rows))
    with np.errstate(all="ignore"):  # squares of the largest numbers are infinite
        distance, _ = NearestNeighbors(n_neighbors=k + 1).fit(descriptor).kneighbors(descriptor[rows])
    return distance[:, 1:].mean(axis=1)  # the first is itself, or a copy


def _place(spaces: Mapping[str, Any]) -> tuple[str, np.ndarray]:
    """The space whose places give skills their colours, and these places, (n, 2)."""
    truth, descriptor = spaces.get("truth"), spaces["descriptor"]
    if truth is not None and len(truth["names"]) > 1:
        return "ground truth", back(truth["table"])[:, :2]
    places = back(descriptor["table"])[:, :2] if descriptor["main"] is None else descriptor["main"]
    return "descriptor space", np.column_stack([places, places])[:, :2]


def _facts(repertoire: Repertoire, config: Mapping[str, Any]) -> list[list[str]]:
    """What there is to say of the run, names and values."""
    facts = [["task", called(config)], ["descriptor", config.get("descriptor")], ["seed", config.get("seed")]]
    with suppress(OSError, ValueError):
        last = repertoire.history.last
        if last is not None:
            facts += [["generations", f"{last.generation:,}"], ["evaluations", f"{last.evaluations:,}"]]
            facts += [["RMSE", f"{last.rmse:.4f}"]] if last.rmse == last.rmse else []
            facts += [["time", f"{last.seconds:.1f} s"]] if last.seconds == last.seconds else []
    return [[name, str(value)] for name, value in facts if value is not None]
