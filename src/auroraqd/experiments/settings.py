"""The settings of one run as a value: from the command line, to JSON, and back to an `Aurora` ready to go."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from auroraqd import emitters
from auroraqd._checks import MOST_SEED, number, whole
from auroraqd.archives.base import Archive
from auroraqd.archives.cvt import CVTArchive, tessellate
from auroraqd.archives.dominated import DominatedArchive
from auroraqd.archives.grid import GridArchive
from auroraqd.archives.unstructured import UnstructuredArchive
from auroraqd.aurora import SURVIVAL, Aurora
from auroraqd.control import resolution, schedule
from auroraqd.descriptors.descriptor import GENOTYPE, HAND_CODED, OBSERVATION
from auroraqd.descriptors.scaling import Scaling
from auroraqd.emitters import ribs, selection, variation
from auroraqd.experiments.options import built, imported, keyword_parameters
from auroraqd.provenance import importable, task_in
from auroraqd.runs.parts import as_json
from auroraqd.tasks import AirHockey, AirHockeyCamera, Ballistic, Hexapod, Maze, OctopusArm, TaskError, evaluated, name_of
from auroraqd.tasks.noise import seeds_of

TASKS = {
    "ballistic": Ballistic,
    "air-hockey": AirHockey,
    "air-hockey-camera": AirHockeyCamera,
    "maze": Maze,
    "hexapod": Hexapod,
    "octopus-arm": OctopusArm,
}
PCA, AUTOENCODER = "pca", "autoencoder"
DESCRIPTORS = (PCA, AUTOENCODER, HAND_CODED, GENOTYPE, OBSERVATION)
_SINCE = {  # settings that earlier versions have not
    "survival": SURVIVAL,
    "robust": True,
    "asynchronous": False,
    "emitter": {"type": "Genetic"},
}
_OF_PYRIBS = ribs.CMA | ribs.IsoLine | ribs.Gaussian
_COMPETITION = ("k", "epsilon", "competition", "capacity", "l")


@dataclass(frozen=True)
class Unstructured:
    """An `UnstructuredArchive`; its parameters are settings of their own."""

    def build(self, settings: "Settings", task: Any) -> Archive:
        """The archive, empty."""
        return UnstructuredArchive(**{name: getattr(settings, name) for name in _COMPETITION})


@dataclass(frozen=True)
class Grid:
    """A `GridArchive` with as many cells along each dimension of the descriptor.

    Args:
        cells: along each dimension.
        low, high: bounds of every dimension.
    """

    cells: int = 30
    low: float = -1.0
    high: float = 1.0

    def __post_init__(self) -> None:
        whole("cells", self.cells)
        number("low", self.low, least=-np.inf, wanted="any")
        number("high", self.high, least=-np.inf, wanted="any")

    def build(self, settings: "Settings", task: Any) -> Archive:
        """The archive, empty."""
        return GridArchive((self.cells,) * _dimensions(settings, task), low=self.low, high=self.high)


@dataclass(frozen=True)
class CVT:
    """A `CVTArchive` with centroids spread evenly in the box of descriptors.

    Args:
        cells: centroids.
        samples: of the box, that they are made of.
        steps: Lloyd steps.
        low, high: bounds of every dimension of the descriptor.
    """

    cells: int = 10_000
    samples: int = 200_000
    steps: int = 5
    low: float = -1.0
    high: float = 1.0

    def __post_init__(self) -> None:
        whole("cells", self.cells)
        whole("samples", self.samples, least=self.cells)
        whole("steps", self.steps)
        number("low", self.low, least=-np.inf, wanted="any")
        number("high", self.high, least=self.low, wanted="at least low")

    def build(self, settings: "Settings", task: Any) -> Archive:
        """The archive, empty. The centroids are the same for every seed of a run, and found again on disk."""
        samples = np.random.default_rng(0).uniform(self.low, self.high, (self.samples, _dimensions(settings, task)))
        return CVTArchive(tessellate(samples, self.cells, steps=self.steps))


@dataclass(frozen=True)
class Dominated:
    """A `DominatedArchive`.

    Args:
        capacity: individuals to store.
        k: neighbours that make up the score.
    """

    capacity: int = 1000
    k: int = 3

    def __post_init__(self) -> None:
        DominatedArchive(self.capacity, self.k)

    def build(self, settings: "Settings", task: Any) -> Archive:
        """The archive, empty."""
        return DominatedArchive(self.capacity, self.k)


@dataclass(frozen=True)
class CVTPrior:
    """A `CVTArchive` whose centroids are the distinct observations of the task's prior data set."""

    def build(self, settings: "Settings", task: Any) -> Archive:
        """The archive, empty."""
        if settings.descriptor != OBSERVATION or not settings.pretrained:
            raise ValueError(
                "archive 'cvt-prior' needs descriptor 'observation' and pretrained (--descriptor observation --pretrained)"
            )
        prior = task.prior()
        return CVTArchive(Scaling.of(prior).scaler(prior[0].size)(prior))


@dataclass(frozen=True)
class Genetic:
    """The genetic emitter; its selection and variation are settings of their own."""


STRATEGIES = {
    "emitter": {
        "genetic": Genetic,
        "goals": emitters.Goals,
        "novelty-search": emitters.NoveltySearch,
        "nslc": emitters.NSLC,
        "taxons": emitters.TAXONS,
        "ribs:cma": ribs.CMA,
        "ribs:iso-line": ribs.IsoLine,
        "ribs:gaussian": ribs.Gaussian,
    },
    "selection": {
        "curiosity": selection.Curiosity,
        "uniform": selection.Uniform,
        "novelty": selection.Novelty,
        "surprise": selection.Surprise,
        "mixed": selection.Mixed,
    },
    "variation": {"polynomial": variation.Polynomial, "gaussian": variation.Gaussian, "iso-line": variation.IsoLine},
    "resolution": {
        "auto": resolution.Automatic,
        "vat": resolution.VAT,
        "size": resolution.Size,
        "fixed": resolution.Fixed,
        "csc": resolution.CSC,
    },
    "schedule": {
        "doubling": schedule.Doubling,
        "widening": schedule.Widening,
        "every": schedule.Every,
        "never": schedule.Never,
    },
    "archive": {
        "unstructured": Unstructured,
        "grid": Grid,
        "cvt": CVT,
        "cvt-prior": CVTPrior,
        "dominated": Dominated,
    },
}


@dataclass(frozen=True)
class Settings:
    """Everything that a run depends on.

    Args:
        task: a name of `TASKS`, with its parameters if wanted, written like "air-hockey:restitution_threshold=1"; or a task of
            the user's own, written like "mymodule:my_task", which is imported when it is built.
        descriptor: a name of `DESCRIPTORS`; "autoencoder" with parameters of `AutoEncoder` if wanted, written like
            "autoencoder:network=convolutional,isometry=0,hidden=64x32".
        components: dimensions of a learned descriptor.
        pretrained: whether the descriptor is fitted once, on the prior data set of the task.
        generations, batch_size: the budget.
        seed: of all that is random.
        emitter, selection, variation, resolution, schedule, archive: strategies; selection and variation are of the emitter
            "genetic".
        l, k, epsilon, competition, capacity: of an unstructured archive; l only matters where the resolution never sets it.
        survival, robust: what updates of the descriptor must leave, and what they set aside; see `auroraqd.Aurora`.
        asynchronous: whether workers do not wait for each other; see `auroraqd.asynchronous`.
    """

    task: str = "ballistic"
    descriptor: str = PCA
    components: int = 2
    pretrained: bool = False
    generations: int = 5000
    batch_size: int = 200
    seed: int = 0
    emitter: Any = field(default_factory=Genetic)
    selection: Any = field(default_factory=selection.Curiosity)
    variation: Any = field(default_factory=variation.Polynomial)
    resolution: Any = field(default_factory=resolution.Automatic)
    schedule: Any = field(default_factory=schedule.Doubling)
    archive: Any = field(default_factory=Unstructured)
    l: float = 0.0
    k: int = 15
    epsilon: float = 0.1
    competition: Any = "dominance"
    capacity: int | None = None
    survival: float = SURVIVAL
    robust: bool = True
    asynchronous: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.task, str):
            raise ValueError(f"task must be one of {', '.join(TASKS)}, got {self.task!r}")
        if self._own is None:
            if self.task_kind not in TASKS:
                raise ValueError(
                    f"task must be one of {', '.join(TASKS)}, or your own, written like mymodule:my_task, got {self.task!r}"
                )
            built("task", TASKS, self.task)
        if not isinstance(self.descriptor, str):
            raise ValueError(f"descriptor must be one of {', '.join(DESCRIPTORS)}, got {self.descriptor!r}")
        if not isinstance(self.pretrained, bool):
            raise ValueError(f"pretrained must be true or false, got {self.pretrained!r}")
        kind = self.descriptor_kind
        if kind not in DESCRIPTORS or (kind != AUTOENCODER and kind != self.descriptor):
            raise ValueError(f"descriptor must be one of {', '.join(DESCRIPTORS)}, got {self.descriptor!r}")
        number("survival", self.survival, most=1, wanted="a share, from 0 to 1")
        if not isinstance(self.robust, bool):
            raise ValueError(f"robust must be true or false, got {self.robust!r}")
        if not isinstance(self.asynchronous, bool):
            raise ValueError(f"asynchronous must be true or false, got {self.asynchronous!r}")
        for name in ("components", "generations", "batch_size"):
            whole(name, getattr(self, name))
        whole("seed", self.seed, least=0, most=MOST_SEED)
        if not self.genetic and (self.selection, self.variation) != (selection.Curiosity(), variation.Polynomial()):
            raise ValueError(f"selection and variation are for the emitter 'genetic', and {self.emitter} has its own")
        if self.pretrained and kind in (HAND_CODED, GENOTYPE):
            raise ValueError(f"pretrained is for descriptors that are learned, not for {kind!r}")
        if self.pretrained and self._own is None and not hasattr(TASKS[self.task_kind], "prior"):
            raise ValueError(f"pretrained is for tasks with a prior data set, and {self.task} has none")

    @property
    def task_kind(self) -> str:
        """The task without its parameters or module."""
        return self.task.partition(":")[0] if self._own is None else self._own[1].rpartition(".")[2]

    @property
    def _own(self) -> tuple[str, str] | None:
        """Module and name of a task that is not one of `TASKS`, or None."""
        module, _, name = self.task.partition(":")
        own = module not in TASKS and all(part.isidentifier() for part in (*module.split("."), *name.split(".")))
        return (module, name) if own else None

    @property
    def descriptor_kind(self) -> str:
        """The descriptor without its parameters."""
        return self.descriptor.partition(":")[0]

    @property
    def genetic(self) -> bool:
        """Whether selection and variation make the offspring, and no other emitter."""
        return isinstance(self.emitter, Genetic)

    def build(self, observations: Path | None = None) -> tuple[Any, Aurora]:
        """The task, and an Aurora at generation 0.

        Args:
            observations: a folder for them; see `Aurora`.

        Raises:
            OSError: the folder cannot be written.
            ValueError: a setting is out of range.
        """
        task = self.build_task()
        aurora = Aurora(
            task.n_genes,
            self._transformer(),
            seed=self.seed,
            batch_size=self.batch_size,
            archive=self._archive(task),
            selection=self.selection if self.genetic else None,
            variation=self.variation if self.genetic else None,
            emitter=self._emitter(),
            resolution=self.resolution,
            schedule=self.schedule,
            prior=self._prior(task),
            survival=self.survival,
            robust=self.robust,
            observations=observations,
        )
        return task, aurora

    def _emitter(self) -> Any:
        """None where selection and variation make it. What makes emitters of pyribs is a setting of its own."""
        if isinstance(self.emitter, _OF_PYRIBS):
            return emitters.Ribs(self.emitter)
        return None if self.genetic else self.emitter

    def _archive(self, task: Any) -> Archive:
        """Empty; with cells of whole observations, of a task that has the data for them."""
        try:
            return self.archive.build(self, task)
        except TaskError as error:
            raise ValueError(str(error)) from error

    def build_task(self, n_genes: int | None = None) -> Any:
        """The task alone.

        Args:
            n_genes: of a run that it was in, where that is known: then a task of the user's own need not say it.

        Raises:
            ValueError: a task of the user's own cannot be imported, or does not say how many genes it has.
        """
        return built("task", TASKS, self.task) if self._own is None else imported(*self._own, n_genes)

    def _transformer(self) -> Any:
        if self.descriptor == PCA:
            from sklearn.decomposition import PCA as Estimator

            return Estimator(n_components=self.components)
        if self.descriptor_kind == AUTOENCODER:
            from auroraqd.descriptors.autoencoder import AutoEncoder

            options = self.descriptor.partition(":")[2]
            return AutoEncoder(self.components, **keyword_parameters("descriptor 'autoencoder'", AutoEncoder, options))
        return self.descriptor

    def _prior(self, task: Any) -> np.ndarray | None:
        if self.pretrained:
            return _asked(task, "prior", "pretrained needs a prior data set")
        # The cells of an archive stay where they are, so the scaling of whole observations must too.
        fixed = self.descriptor == OBSERVATION and not isinstance(self.archive, Unstructured | Dominated)
        return _bounds(task) if fixed else None

    def parameters(self) -> dict[str, Any]:
        """The parameters of a learned descriptor that matter, those left to their defaults included, as JSON values."""
        transformer = self._transformer()
        if isinstance(transformer, str):
            return {}
        values = transformer.get_params()
        unused = {"random_state", "verbose"} | ({"hidden"} if values.get("network") == "convolutional" else set())
        return {name: value for name, value in values.items() if name not in unused}

    def as_json(self) -> dict[str, Any]:
        """As JSON values."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: as_json(value) if name in STRATEGIES else value for name, value in values.items()}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Settings":
        """The settings that `as_json` gave. What other keys a config has is passed over.

        Raises:
            ValueError: a setting is missing or unknown.
        """
        names = [f.name for f in fields(cls)]
        values = {**_SINCE, **values}
        missing = [name for name in names if name not in values]
        if missing:
            raise ValueError(f"the settings have no {', '.join(missing)}")
        given = {name: values[name] for name in names}
        for name, kinds in STRATEGIES.items():
            given[name] = _made(name, kinds, given[name])
        return cls(**given)


def is_of_settings(config: Mapping[str, Any]) -> bool:
    """Whether a run folder was made from settings, by a command; others may hold whatever its user keeps there."""
    names = ("task", "descriptor", "components", "generations", "pretrained")
    return all(name in config for name in names) and isinstance(config["task"], str)


def task_of(config: Mapping[str, Any]) -> str | None:
    """The task of a run folder as the `task` of settings, also of one that was saved from Python; None where none is known that
    can be imported.
    """
    if is_of_settings(config):
        return config["task"]
    home, text = importable(config), (task_in(config) or {}).get("repr")
    for name, kind in TASKS.items():
        if home == f"{kind.__module__}:{kind.__qualname__}":
            options = str(text or "").partition("(")[2].rstrip(")").replace(" ", "").replace("'", "")
            return f"{name}:{options}" if options else name
    return home


def _made(name: str, kinds: Mapping[str, Any], value: Any) -> Any:
    """A strategy, and those that it is made of, from what `as_json` made of it."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} must be an object with a type, got {value!r}")
    options = dict(value)
    kind = options.pop("type", None)
    classes = {c.__name__: c for c in kinds.values()}
    if kind not in classes:
        raise ValueError(f"{name} must be one of {', '.join(classes)}, got {kind!r}")
    for key, part in options.items():
        if isinstance(part, Mapping):
            options[key] = _made(key, STRATEGIES.get(key, kinds), part)
    return classes[kind](**options)


def _dimensions(settings: Settings, task: Any) -> int:
    """Of the descriptor. Only of one whose bounds are known beforehand."""
    if settings.descriptor == OBSERVATION:
        return int(np.prod(_bounds(task).shape[1:]))
    if settings.descriptor == GENOTYPE:
        return task.n_genes
    if settings.descriptor == HAND_CODED:
        truth = evaluated(task, np.full((1, task.n_genes), 0.5), seeds_of(0, 0, 1), "for its ground truth").ground_truth
        if truth is None:
            raise ValueError(f"a hand-coded descriptor reads the ground truth, but task {name_of(task)} gives none")
        return int(truth.reshape(1, -1).shape[1])
    return settings.components


def _bounds(task: Any) -> np.ndarray:
    return _asked(task, "bounds", "cells of whole observations need observations that are their bounds")


def _asked(task: Any, name: str, why: str) -> np.ndarray:
    """What a method of the task returns."""
    if not callable(getattr(task, name, None)):
        raise ValueError(f"{why}, and task {name_of(task)} has no method {name}()")
    return getattr(task, name)()


def strategy(name: str, text: str) -> Any:
    """A strategy from its text: a name, and options if any, like `polynomial:rate=0.2,eta=5`.

    Args:
        name: a key of `STRATEGIES`.
        text: what the user wrote.

    Raises:
        ValueError: no such strategy or option, or a value out of range.
    """
    return built(name, STRATEGIES[name], text)
