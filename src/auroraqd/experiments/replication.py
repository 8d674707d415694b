"""One replication of one variant: a run, followed and measured. One that was interrupted goes on where it was."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from auroraqd import metrics
from auroraqd.aurora import Aurora
from auroraqd.experiments.looks import Looks
from auroraqd.experiments.measures import Measure
from auroraqd.experiments.settings import Settings
from auroraqd.observations import has_streams
from auroraqd.runs import folders
from auroraqd.runs.checkpoints import Checkpoints

_EVERY = 20.0  # s between two checkpoints


class Result(NamedTuple):
    """What one run came to.

    Attributes:
        variant, replication: which run.
        seed, generations, batch_size: its settings.
        size: individuals stored.
        rmse: mean reconstruction error on the [-1, 1] scale; `rmse_metres`: in the units of the observations. NaN where the
            descriptor cannot reconstruct, the latter also of streams, which have units of their own.
        l: distance threshold at the end; NaN without one.
        new, replaced, rejected, invalid: individuals that were given this status.
        seconds: of the run, training included.
        measures: those of the experiment, by name.
    """

    variant: str
    replication: int
    seed: int
    generations: int
    batch_size: int
    size: int
    rmse: float
    rmse_metres: float
    l: float
    new: int
    replaced: int
    rejected: int
    invalid: int
    seconds: float
    measures: dict[str, float]

    def value(self, measure: str) -> float:
        """A number of this run, be it a measure of the experiment or not."""
        return _value(self, measure)


class Point(NamedTuple):
    """A run at one of the generations at which it is looked at; see `Result`."""

    variant: str
    replication: int
    generation: int
    size: int
    rmse: float
    l: float
    measures: dict[str, float]

    def value(self, measure: str) -> float:
        """A number of this moment, be it a measure of the experiment or not; NaN where it is not taken during runs."""
        return _value(self, measure)


def _value(row: Result | Point, measure: str) -> float:
    return float(row.measures.get(measure, getattr(row, measure, float("nan"))))


class Job(NamedTuple):
    """A run to do."""

    variant: str
    replication: int
    settings: Settings
    folder: Path
    reference: Path | None  # the run folder of the reference of this replication; None: the run itself, or there is none
    measures: tuple[Measure, ...]
    experiment: str = ""  # its name

    @property
    def run(self) -> tuple[str, int]:
        """Which run: settings are no key of anything, for emitters have a state."""
        return self.variant, self.replication


def looked_at(generations: int) -> frozenset[int]:
    """The generations at which a run is looked at: densely at first, then 50 times in equal steps."""
    steps = [round(step) for step in np.linspace(0, generations, 51)]
    return frozenset(g for g in [1, 2, 5, 10, 20, 35, 50, *steps] if 1 <= g <= generations)


def replicate(job: Job, listener: Callable[[Aurora], Any]) -> tuple[Result, list[Point]]:
    """Do a run, with checkpoints in its folder, or what is missing of it, and measure it.

    Args:
        job: which.
        listener: called after each generation.
    """
    task, aurora = job.settings.build()
    generations, config = job.settings.generations, job.settings.as_json()
    wanted, kept = looked_at(generations), Looks(job.folder)
    looks: list[tuple[Any, dict[str, Any]]] = []

    def look(aurora: Aurora) -> None:
        if aurora.generation in wanted and len(aurora.archive):
            taken = [m for m in job.measures if m.followed or aurora.generation == generations]
            looks.append((aurora.history.last, {m.name: m.look(aurora.archive) for m in taken}))
            kept.keep(aurora.generation, looks[-1][1])

    def follow(aurora: Aurora) -> None:
        listener(aurora)
        look(aurora)

    if (interrupted := _interrupted(job, kept)) is not None:
        aurora, looks = interrupted
        look(aurora)  # which may be what was interrupted
    with Checkpoints(aurora, job.folder, every=_EVERY, config=config, overwrite=True) as checkpoints:
        aurora.run(task, until_generation=generations, callback=(follow, checkpoints))
    (job.folder / folders.PREVIOUS).unlink(missing_ok=True)  # or it could be taken for the end of the run
    kept.remove()
    if not looks:
        raise ValueError("nothing was stored")
    last, seen = looks[-1]
    if job.reference is not None:
        repertoire = folders.load(job.reference)
        seen = {m.name: m.look(repertoire) for m in job.measures}

    def scores(looked: dict[str, Any]) -> dict[str, float]:
        return {m.name: float(m.score(looked[m.name], seen[m.name])) for m in job.measures if m.name in looked}

    run = job.variant, job.replication
    points = [Point(*run, record.generation, record.size, record.rmse, record.l, scores(looked)) for record, looked in looks]
    result = Result(
        *run,
        seed=job.settings.seed,
        generations=last.generation,
        batch_size=job.settings.batch_size,
        size=last.size,
        rmse=last.rmse,
        rmse_metres=_rmse_in_units(aurora),
        l=last.l,
        **{name: getattr(last, name) for name in ("new", "replaced", "rejected", "invalid")},
        seconds=last.seconds,
        measures=points[-1].measures,
    )
    followed = {m.name for m in job.measures if m.followed}
    return result, [p._replace(measures={name: p.measures[name] for name in p.measures if name in followed}) for p in points]


def _interrupted(job: Job, kept: Looks) -> tuple[Aurora, list[tuple[Any, dict[str, Any]]]] | None:
    """A run that a checkpoint holds and what was seen of it, if it is this one and can go on; else it is begun anew."""
    try:
        if folders.changed(job.folder, job.settings.as_json()):
            return None
        aurora = folders.resume(job.folder)
        records = {record.generation: record for record in aurora.history.records}
        wanted = [g for g in sorted(looked_at(job.settings.generations)) if g < aurora.generation]
        return aurora, [(records[g], kept.kept(g)) for g in wanted]
    except (OSError, ValueError, KeyError):
        return None


def _rmse_in_units(aurora: Aurora) -> float:
    archive = aurora.archive
    if archive.reconstruction_error is None or has_streams(archive.observation):
        return float("nan")
    return float(metrics.reconstruction_error(archive.observation, aurora.reconstruct(archive.descriptor)).mean())
