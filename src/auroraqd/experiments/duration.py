"""How long the runs that are left will take, from those that are done and those under way."""

import time
from collections.abc import Iterable, Sequence
from statistics import fmean, median

from auroraqd.experiments.replication import Job, Result
from auroraqd.experiments.runner import Status

_SOON = 0.02  # of a run, before its pace says something
_Kind = tuple[str, str]  # experiment and variant


class TimeLeft:
    """An estimate: what is left of each run, over the workers, and no less than the longest.

    A run takes as long as others of its variant did; where none is done, as long as the pace of one under way says; where
    there is none either, as long as the others of its experiment, or of all, do on average.

    Args:
        jobs: to do.
        workers: runs at once.
        done: the results there are, by the name of the experiment.
    """

    def __init__(self, jobs: Sequence[Job], workers: int, done: Iterable[tuple[str, Sequence[Result]]] = ()):
        self._waiting = {(job.experiment, *job.run) for job in jobs}
        self._workers = max(1, workers)
        self._known: dict[_Kind, list[float]] = {}
        for experiment, results in done:
            for result in results:
                self._known.setdefault((experiment, result.variant), []).append(result.seconds)
        self._since: dict[tuple[str, str, int], float] = {}
        self._share: dict[tuple[str, str, int], float] = {}

    def progress(self, experiment: str, status: Status) -> None:
        """A run has come this far."""
        run = experiment, status.variant, status.replication
        self._since.setdefault(run, time.monotonic())
        self._share[run] = status.generation / status.generations

    def finished(self, experiment: str, result: Result) -> None:
        """A run is done."""
        self._known.setdefault((experiment, result.variant), []).append(result.seconds)
        self.without(experiment, result.variant, result.replication)

    def without(self, experiment: str, variant: str, replication: int) -> None:
        """A run will not be done, or is."""
        run = experiment, variant, replication
        self._waiting.discard(run)
        self._since.pop(run, None)
        self._share.pop(run, None)

    def seconds(self) -> float | None:
        """The estimate; None while nothing is known."""
        kinds = self._durations()
        if not kinds:
            return None
        now, left = time.monotonic(), []
        for run in self._waiting:
            experiment, variant, _ = run
            same = [value for (of, _), value in kinds.items() if of == experiment]
            whole = kinds.get((experiment, variant), fmean(same or kinds.values()))
            left.append(max(0.0, whole - (now - self._since.get(run, now))))
        return max(sum(left) / self._workers, max(left, default=0.0))

    def _durations(self) -> dict[_Kind, float]:
        """What a run of each variant takes, of those that something is known of."""
        now = time.monotonic()
        paces: dict[_Kind, list[float]] = {}
        for run, share in self._share.items():
            if share >= _SOON:
                paces.setdefault(run[:2], []).append((now - self._since[run]) / share)
        return {kind: median(values) for kind, values in {**paces, **self._known}.items()}


def spoken(seconds: float) -> str:
    """About how long, in words.

    Examples:
        >>> from auroraqd.experiments.duration import spoken
        >>> spoken(40), spoken(400), spoken(40_000)
        ('less than a minute', 'about 7 min', 'about 11 h 7 min')
    """
    minutes = round(seconds / 60)
    if seconds < 60:
        return "less than a minute"
    return f"about {minutes} min" if minutes < 60 else f"about {minutes // 60} h {minutes % 60} min"
