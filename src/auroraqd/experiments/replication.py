"""One replication of one variant: a run, followed and measured."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from auroraqd import metrics, storage
from auroraqd.aurora import Aurora
from auroraqd.experiments.settings import Settings


class Result(NamedTuple):
    """What one run came to.

    Attributes:
        variant, replication: which run.
        seed, generations, batch_size: its settings.
        size: individuals stored.
        klc: joint Kullback-Leibler coverage of the reference repertoire; `klc_marginal`: the sum of the marginal ones.
        outside: share of the repertoire outside the box of the reference.
        rmse: mean reconstruction error on the [-1, 1] scale; `rmse_metres`: in the units of the observations. NaN where the
            descriptor cannot reconstruct.
        l: distance threshold at the end; NaN without one.
        new, replaced, rejected, invalid: individuals that were given this status.
        seconds: of the run, training included.
    """

    variant: str
    replication: int
    seed: int
    generations: int
    batch_size: int
    size: int
    klc: float
    klc_marginal: float
    outside: float
    rmse: float
    rmse_metres: float
    l: float
    new: int
    replaced: int
    rejected: int
    invalid: int
    seconds: float


class Point(NamedTuple):
    """A run at one of the generations at which it is looked at; see `Result`."""

    variant: str
    replication: int
    generation: int
    size: int
    klc: float
    rmse: float
    l: float


class Job(NamedTuple):
    """A run to do."""

    variant: str
    replication: int
    settings: Settings
    folder: Path
    reference: Path | None  # the run folder of the reference of this replication; None: the run itself


def looked_at(generations: int) -> frozenset[int]:
    """The generations at which a run is looked at: densely at first, then 50 times in equal steps."""
    steps = [round(step) for step in np.linspace(0, generations, 51)]
    return frozenset(g for g in [1, 2, 5, 10, 20, 35, 50, *steps] if 1 <= g <= generations)


def replicate(job: Job, listener: Callable[[Aurora], Any]) -> tuple[Result, list[Point]]:
    """Do a run, save it, and measure it.

    Args:
        job: which.
        listener: called after each generation.
    """
    since = time.perf_counter()
    task, aurora = job.settings.build()
    snapshots: list[tuple[Any, np.ndarray]] = []
    wanted = looked_at(job.settings.generations)

    def follow(aurora: Aurora) -> None:
        listener(aurora)
        if aurora.generation in wanted and len(aurora.archive):
            assert aurora.archive.ground_truth is not None
            snapshots.append((aurora.history.last, aurora.archive.ground_truth.copy()))

    aurora.run(task, generations=job.settings.generations, callback=follow)
    seconds = time.perf_counter() - since
    storage.save(aurora, job.folder, config=job.settings.as_json())
    final = snapshots[-1][1]
    reference = final if job.reference is None else storage.load(job.reference).ground_truth
    assert reference is not None
    points = [
        Point(job.variant, job.replication, r.generation, r.size, metrics.klc(reference, truth), r.rmse, r.l)
        for r, truth in snapshots
    ]
    last = snapshots[-1][0]
    result = Result(
        variant=job.variant,
        replication=job.replication,
        seed=job.settings.seed,
        generations=last.generation,
        batch_size=job.settings.batch_size,
        size=last.size,
        klc=points[-1].klc,
        klc_marginal=metrics.klc(reference, final, marginal=True),
        outside=metrics.outside(reference, final),
        rmse=last.rmse,
        rmse_metres=_rmse_in_units(aurora),
        l=last.l,
        **{name: getattr(last, name) for name in ("new", "replaced", "rejected", "invalid")},
        seconds=seconds,
    )
    return result, points


def _rmse_in_units(aurora: Aurora) -> float:
    archive = aurora.archive
    if archive.reconstruction_error is None:
        return float("nan")
    return float(metrics.reconstruction_error(archive.observation, aurora.reconstruct(archive.descriptor)).mean())
