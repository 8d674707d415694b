"""Loggers: callbacks that write down how a run goes, generation by generation.

Each logs the fields of a `Record` (`auroraqd.history`), and `updated`, 1 where the descriptor has been updated since the line
before. One that fails, because the disk is full or there is no network, does not end the run: it says so once, in a warning.
"""

from __future__ import annotations

import csv
import io
import os
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np

from auroraqd._checks import function, whole
from auroraqd._files import as_path, folder_at, replacing
from auroraqd.history import Record
from auroraqd.provenance import called

_FIELDS = (*Record._fields, "updated")
_MODES = ("offline", "online", "disabled")
_LONGEST = 500  # characters of a setting: MLflow refuses more
_PATIENCE = 30  # s for W&B to answer

Also = Callable[[Any], Mapping[str, float]]


class Logger(ABC):
    """What all loggers do. A new one provides `begin`, `write` and `close`, which may raise.

    Args:
        every: generations between two lines.
        also: from the `Aurora` to further numbers, by name: `lambda aurora: {"coverage": grid.coverage}`.
    """

    def __init__(self, every: int, also: Also | None) -> None:
        if also is not None:
            function("also", also)
        self._every, self._also = whole("every", every), also
        self._begun = self._failed = self._updated = False

    @abstractmethod
    def begin(self, generation: int, settings: dict[str, Any]) -> None:
        """A run of these settings begins, or goes on from this generation."""

    @abstractmethod
    def write(self, values: dict[str, float]) -> None:
        """Log a line: `_FIELDS`, and what `also` gives."""

    @abstractmethod
    def close(self) -> None:
        """The run ends."""

    def start(self, aurora: Any) -> None:
        """The run begins, or goes on."""
        self._updated = False
        self._begun = self._done(aurora, lambda: self.begin(aurora.generation, settings_of(aurora)))

    def update(self, aurora: Any) -> None:
        """The descriptor was updated."""
        self._updated = True

    def generation(self, aurora: Any) -> None:
        """A generation is done."""
        if self._begun and aurora.generation % self._every == 0:
            self._done(aurora, lambda: self.write(self._values(aurora)))
            self._updated = False

    def end(self, aurora: Any) -> None:
        """The run ends."""
        if self._begun:
            self._done(aurora, self.close)
        self._begun = False

    def _values(self, aurora: Any) -> dict[str, float]:
        also = {} if self._also is None else dict(self._also(aurora))
        return {**aurora.history.last._asdict(), "updated": int(self._updated), **also}

    def _done(self, aurora: Any, action: Callable[[], None]) -> bool:
        """Whether it could be done. The first time that something cannot, that is said."""
        try:
            action()
        except Exception as error:  # of a library, a network or a disk: anything
            if not self._failed:
                reason = next(iter(str(error).splitlines()), "") or type(error).__name__
                warnings.warn(
                    f"{type(self).__name__} could not log generation {aurora.generation}, and the run goes on: {reason}",
                    stacklevel=5,
                )
            self._failed = True
            return False
        return True


class CSV(Logger):
    """A line a generation in a CSV file, on disk as soon as it is written.

    Of a run that is resumed, lines after the generation that it goes on from are written anew. A run from the start moves an
    earlier log to `PATH.previous`.

    Args:
        path: of the file. A file that is something else is left alone.
        every, also: see `Logger`.

    Examples:
        >>> from pathlib import Path
        >>> import auroraqd
        >>> log = auroraqd.callbacks.CSV("logs/run.csv")
        >>> task = auroraqd.tasks.Ballistic()
        >>> aurora = auroraqd.Aurora(2, "genotype", seed=0).run(task, generations=3, callback=log)
        >>> len(Path("logs/run.csv").read_text().splitlines())  # a header, and a line a generation
        4
    """

    def __init__(self, path: str | os.PathLike, *, every: int = 1, also: Also | None = None) -> None:
        super().__init__(every, also)
        self._path = as_path("path", path).absolute()  # a task may change the current folder
        self._header: list[str] | None = None

    def begin(self, generation: int, settings: dict[str, Any]) -> None:
        """Make the file ready for what comes after this generation."""
        folder_at(self._path.parent)
        self._header = None
        content = self._path.read_bytes() if self._path.exists() else b""
        if not content:
            return
        header, *lines = content.splitlines(keepends=True)
        names = header.decode(errors="replace").rstrip().split(",")
        if tuple(names[: len(_FIELDS)]) != _FIELDS:
            raise ValueError(f"{self._path} holds something else than a log: choose another path")
        if generation == 0 and lines:
            self._path.replace(f"{self._path}.previous")
            return
        kept = [line for line in lines if line.endswith(b"\n") and int(line.partition(b",")[0]) <= generation]
        if len(kept) < len(lines):
            with replacing(self._path) as file:
                file.write(b"".join([header, *kept]))
        self._header = names

    def write(self, values: dict[str, float]) -> None:
        """Add a line, whole or not at all."""
        lines = [values.values()]
        if self._header is None:
            lines.insert(0, values.keys())  # pyright: ignore[reportArgumentType]
        elif list(values) != self._header:
            raise ValueError(f"{self._path} has the columns {', '.join(self._header)}, and not {', '.join(values)}")
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(lines)
        with self._path.open("ab", buffering=0) as file:
            before = os.fstat(file.fileno()).st_size
            try:
                if file.write(line := text.getvalue().encode()) != len(line):
                    raise OSError(f"{self._path} could not be written: the disk is full")
            except OSError:
                file.truncate(before)
                raise
        self._header = list(values)

    def close(self) -> None:
        """Nothing is open."""


class TensorBoard(Logger):
    """Scalars for TensorBoard: `tensorboard --logdir FOLDER`.

    Args:
        folder: of the event files, one a start of the run.
        every, also: see `Logger`.

    Raises:
        ModuleNotFoundError: tensorboardX is not installed.
    """

    def __init__(self, folder: str | os.PathLike, *, every: int = 1, also: Also | None = None) -> None:
        super().__init__(every, also)
        self._folder = as_path("folder", folder).absolute()
        self._library = _library("tensorboardX", "tensorboard")
        self._writer: Any = None

    def begin(self, generation: int, settings: dict[str, Any]) -> None:
        """A new event file. What an earlier one says of later generations counts no longer."""
        folder_at(self._folder)
        suffix = f".{time.time_ns()}"  # two of one second must not be one file
        self._writer = self._library.SummaryWriter(
            str(self._folder), purge_step=generation + 1, flush_secs=10, filename_suffix=suffix
        )
        table = "\n".join(f"| {name} | {value} |" for name, value in settings.items())
        self._writer.add_text("settings", f"| setting | value |\n|---|---|\n{table}", generation)

    def write(self, values: dict[str, float]) -> None:
        """Add scalars."""
        for name, value in _finite(values).items():
            self._writer.add_scalar(name, value, values["generation"])

    def close(self) -> None:
        """Close the file."""
        self._writer.close()


class WeightsAndBiases(Logger):
    """A run of Weights & Biases, over generations.

    Args:
        project: its name.
        mode: "offline", to a local folder, which `wandb sync` sends later; "online"; or "disabled".
        every, also: see `Logger`.
        options: for `wandb.init`: `name`, `group`, `dir`, ...; `id` to go on with an earlier run.

    Attributes:
        id: of the run, once it has begun. It goes on when the run does, in the same process.

    Raises:
        ModuleNotFoundError: wandb is not installed.
        ValueError: there is no such mode.
    """

    def __init__(
        self, project: str, mode: str = "offline", *, every: int = 1, also: Also | None = None, **options: Any
    ) -> None:
        super().__init__(every, also)
        if mode not in _MODES:
            raise ValueError(f"mode must be one of {', '.join(_MODES)}, got {mode!r}")
        self._library = _library("wandb", "wandb")
        self._mode = mode
        self._options = {"project": project, "resume": "allow", "reinit": "create_new", **options}
        self.id: str | None = options.get("id")
        self._run: Any = None

    def begin(self, generation: int, settings: dict[str, Any]) -> None:
        """Begin the run, or go on with it."""
        patience = {"settings": self._library.Settings(init_timeout=_PATIENCE)}
        try:
            self._run = self._library.init(mode=self._mode, config=settings, **(patience | self._options | {"id": self.id}))
        except Exception as error:
            if self._mode != "online":
                raise
            reason = next(iter(str(error).splitlines()), type(error).__name__)
            raise ConnectionError(f"no connection to Weights & Biases, and mode='offline' needs none: {reason}") from error
        self.id = self._run.id
        self._run.define_metric("*", step_metric="generation")

    def write(self, values: dict[str, float]) -> None:
        """Log a line."""
        self._run.log(_finite(values))

    def close(self) -> None:
        """Finish the run."""
        self._run.finish()


class MLflow(Logger):
    """A run of MLflow: settings as parameters, the rest as metrics, over generations.

    Args:
        experiment: its name; created if there is none.
        tracking_uri: where to, like "http://localhost:5000" or "sqlite:///mlflow.db". None: as MLflow is set up.
        run_id: of an earlier run to go on with.
        every, also: see `Logger`.

    Attributes:
        run_id: of the run, once it has begun. It goes on when the run does, in the same process.

    Raises:
        ModuleNotFoundError: MLflow is not installed.
    """

    def __init__(
        self,
        experiment: str = "auroraqd",
        tracking_uri: str | None = None,
        run_id: str | None = None,
        *,
        every: int = 1,
        also: Also | None = None,
    ) -> None:
        super().__init__(every, also)
        self._library = _library("mlflow", "mlflow")
        self._experiment, self._uri, self.run_id = experiment, tracking_uri, run_id
        self._client: Any = None

    def begin(self, generation: int, settings: dict[str, Any]) -> None:
        """Begin the run, or go on with it."""
        client = self._client = self._library.MlflowClient(tracking_uri=self._uri)
        if self.run_id is not None:
            client.update_run(self.run_id, status="RUNNING")
            return
        found = client.get_experiment_by_name(self._experiment)
        experiment = client.create_experiment(self._experiment) if found is None else found.experiment_id
        self.run_id = client.create_run(experiment).info.run_id
        parameters = [self._library.entities.Param(name, str(value)) for name, value in settings.items()]
        client.log_batch(self.run_id, params=parameters)

    def write(self, values: dict[str, float]) -> None:
        """Log metrics."""
        now, step, metric = int(1000 * time.time()), int(values["generation"]), self._library.entities.Metric
        metrics = [metric(name, float(value), now, step) for name, value in _finite(values).items()]
        self._client.log_batch(self.run_id, metrics=metrics)

    def close(self) -> None:
        """Finish the run."""
        self._client.set_terminated(self.run_id)


def settings_of(aurora: Any) -> dict[str, Any]:
    """The settings of a run in short: numbers and texts by name."""
    plain = {name: getattr(aurora, name) for name in ("n_genes", "batch_size", "seed", "survival", "robust")}
    archive = {f"archive.{name}": value for name, value in aurora.archive.settings.items()}
    parts = {
        "task": "" if aurora._task is None else called(aurora._task),
        "descriptor": aurora.descriptor.source,
        "emitter": aurora._emitters.emitters,
        "resolution": aurora.resolution,
        "schedule": aurora.schedule,
    }
    texts = {name: _called(value) for name, value in {"archive": type(aurora.archive).__name__, **archive, **parts}.items()}
    return plain | texts


def _called(value: Any) -> str:
    """In short, whatever it is; not where it lies in memory."""
    if isinstance(value, tuple):
        return ", ".join(map(_called, value))
    text = value if isinstance(value, str) else repr(value)
    return type(value).__qualname__ if " at 0x" in text else " ".join(text.split())[:_LONGEST]


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if np.isfinite(value)}


def _library(module: str, extra: str) -> Any:
    """A library that is imported when it is needed.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise ModuleNotFoundError(f'{module} is not installed: pip install "auroraqd[{extra}]"', name=module) from None
