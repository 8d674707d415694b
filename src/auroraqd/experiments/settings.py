"""The settings of one run as a value: from the command line, to JSON, and back to an `Aurora` ready to go."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

from auroraqd import resolution, schedule, selection, variation
from auroraqd._checks import whole
from auroraqd.archive import UnstructuredArchive
from auroraqd.aurora import Aurora
from auroraqd.storage import as_json
from auroraqd.tasks import Ballistic

TASKS = {"ballistic": Ballistic}
DESCRIPTORS = ("pca", "hand-coded", "genotype")
STRATEGIES = {
    "selection": {"curiosity": selection.Curiosity, "uniform": selection.Uniform},
    "variation": {"polynomial": variation.Polynomial, "gaussian": variation.Gaussian, "iso-line": variation.IsoLine},
    "resolution": {"vat": resolution.VAT, "fixed": resolution.Fixed},
    "schedule": {"doubling": schedule.Doubling, "every": schedule.Every, "never": schedule.Never},
}


@dataclass(frozen=True)
class Settings:
    """Everything that a run depends on.

    Args:
        task: a name of `TASKS`.
        descriptor: a name of `DESCRIPTORS`.
        components: dimensions of a learned descriptor.
        generations, batch_size: the budget.
        seed: of all that is random.
        selection, variation, resolution, schedule: strategies.
        l, k, epsilon, competition, capacity: of the archive; l only matters where the resolution never sets it.
    """

    task: str = "ballistic"
    descriptor: str = "pca"
    components: int = 2
    generations: int = 5000
    batch_size: int = 200
    seed: int = 0
    selection: Any = field(default_factory=selection.Curiosity)
    variation: Any = field(default_factory=variation.Polynomial)
    resolution: Any = field(default_factory=resolution.VAT)
    schedule: Any = field(default_factory=schedule.Doubling)
    l: float = 0.0
    k: int = 15
    epsilon: float = 0.1
    competition: Any = "dominance"
    capacity: int | None = None

    def __post_init__(self) -> None:
        if self.task not in TASKS:
            raise ValueError(f"task must be one of {', '.join(TASKS)}, got {self.task!r}")
        if self.descriptor not in DESCRIPTORS:
            raise ValueError(f"descriptor must be one of {', '.join(DESCRIPTORS)}, got {self.descriptor!r}")
        for name in ("components", "generations", "batch_size"):
            whole(name, getattr(self, name))
        whole("seed", self.seed, least=0)

    def build(self) -> tuple[Any, Aurora]:
        """The task, and an Aurora at generation 0.

        Raises:
            ValueError: a setting is out of range.
        """
        task = TASKS[self.task]()
        archive = UnstructuredArchive(
            l=self.l,
            k=self.k,
            epsilon=self.epsilon,
            competition=self.competition,
            capacity=self.capacity,
        )
        aurora = Aurora(
            task.n_genes,
            self._transformer(),
            seed=self.seed,
            batch_size=self.batch_size,
            archive=archive,
            selection=self.selection,
            variation=self.variation,
            resolution=self.resolution,
            schedule=self.schedule,
        )
        return task, aurora

    def _transformer(self) -> Any:
        if self.descriptor != "pca":
            return self.descriptor
        from sklearn.decomposition import PCA

        return PCA(n_components=self.components)

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
        missing = [name for name in names if name not in values]
        if missing:
            raise ValueError(f"the settings have no {', '.join(missing)}")
        given = {name: values[name] for name in names}
        for name, kinds in STRATEGIES.items():
            if not isinstance(given[name], Mapping):
                raise ValueError(f"{name} must be an object with a type, got {given[name]!r}")
            options = dict(given[name])
            kind = options.pop("type", None)
            classes = {c.__name__: c for c in kinds.values()}
            if kind not in classes:
                raise ValueError(f"{name} must be one of {', '.join(classes)}, got {kind!r}")
            given[name] = classes[kind](**options)
        return cls(**given)


def strategy(name: str, text: str) -> Any:
    """A strategy from its text: a name, and options if any, like `polynomial:rate=0.2,eta=5`.

    Args:
        name: "selection", "variation", "resolution" or "schedule".
        text: what the user wrote.

    Raises:
        ValueError: no such strategy or option, or a value out of range.
    """
    kinds = STRATEGIES[name]
    kind, _, options = text.partition(":")
    if kind not in kinds:
        raise ValueError(f"{name} must be one of {', '.join(kinds)}, got {kind!r}")
    types = {f.name: f.type for f in fields(kinds[kind])}
    given = {}
    for option in filter(None, options.split(",")):
        key, _, value = option.partition("=")
        if key not in types:
            wanted = ", ".join(types) or "none"
            raise ValueError(f"{name} {kind!r} has no option {key!r}; its options are: {wanted}")
        given[key] = _value(f"{name} {kind!r}: {key}", types[key], value)
    missing = [f.name for f in fields(kinds[kind]) if f.default is MISSING and f.name not in given]
    if missing:
        raise ValueError(f"{name} {kind!r} needs {missing[0]}: write {kind}:{missing[0]}=VALUE")
    return kinds[kind](**given)


def _value(name: str, kind: Any, text: str) -> Any:
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise ValueError(f"{name} must be true or false, got {text!r}")
        return text.lower() == "true"
    try:
        return kind(text)
    except ValueError:
        raise ValueError(f"{name} must be {'a whole number' if kind is int else 'a number'}, got {text!r}") from None
