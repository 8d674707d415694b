"""auroraqd: a robot finds out by itself what it can do.

Quality-Diversity search with behavioural descriptors learned from sensory data (AURORA; Cully, GECCO 2019). Start with
`Aurora`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

# Public name to the module that has it. Loaded when first used: the command line must answer before NumPy, Numba and
# scikit-learn are imported.
_HOME = {
    "Adaptation": "adaptation",
    "Archive": "archive",
    "Aurora": "aurora",
    "AutoEncoder": "autoencoder",
    "CVTArchive": "cvt",
    "Checkpoints": "checkpoints",
    "Curiosity": "selection",
    "DescriptorError": "descriptor",
    "Doubling": "schedule",
    "Evaluation": "tasks",
    "Every": "schedule",
    "Fixed": "resolution",
    "Gaussian": "variation",
    "GridArchive": "cells",
    "IsoLine": "variation",
    "Never": "schedule",
    "Polynomial": "variation",
    "Repertoire": "repertoire",
    "Size": "resolution",
    "TaskError": "tasks",
    "Uniform": "selection",
    "UnstructuredArchive": "archive",
    "VAT": "resolution",
    "load": "storage",
    "resume": "storage",
    "save": "storage",
    "tessellate": "cvt",
}
_MODULES = ("evaluate", "metrics", "tasks")

__all__ = [
    "VAT",
    "Adaptation",
    "Archive",
    "Aurora",
    "AutoEncoder",
    "CVTArchive",
    "Checkpoints",
    "Curiosity",
    "DescriptorError",
    "Doubling",
    "Evaluation",
    "Every",
    "Fixed",
    "Gaussian",
    "GridArchive",
    "IsoLine",
    "Never",
    "Polynomial",
    "Repertoire",
    "Size",
    "TaskError",
    "Uniform",
    "UnstructuredArchive",
    "evaluate",
    "load",
    "metrics",
    "resume",
    "save",
    "tasks",
    "tessellate",
]

if TYPE_CHECKING:
    from auroraqd import evaluate, metrics, tasks
    from auroraqd.adaptation import Adaptation
    from auroraqd.archive import Archive, UnstructuredArchive
    from auroraqd.aurora import Aurora
    from auroraqd.autoencoder import AutoEncoder
    from auroraqd.cells import GridArchive
    from auroraqd.checkpoints import Checkpoints
    from auroraqd.cvt import CVTArchive, tessellate
    from auroraqd.descriptor import DescriptorError
    from auroraqd.repertoire import Repertoire
    from auroraqd.resolution import VAT, Fixed, Size
    from auroraqd.schedule import Doubling, Every, Never
    from auroraqd.selection import Curiosity, Uniform
    from auroraqd.storage import load, resume, save
    from auroraqd.tasks import Evaluation, TaskError
    from auroraqd.variation import Gaussian, IsoLine, Polynomial


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"auroraqd.{name}")
    if name in _HOME:
        value = getattr(import_module(f"auroraqd.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'auroraqd' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
