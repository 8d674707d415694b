from . import evaluate, metrics, report, tasks
from .adaptation import Adaptation
from .archive import Archive
from .aurora import Aurora
from .autoencoder import AutoEncoder
from .cells import GridArchive
from .checkpoints import Checkpoints
from .cvt import CVTArchive, tessellate
from .descriptor import DescriptorError
from .repertoire import Repertoire
from .resolution import VAT, Fixed, Size
from .schedule import Doubling, Every, Never
from .selection import Curiosity, Uniform
from .storage import load, resume, save
from .tasks import Evaluation, TaskError
from .unstructured import UnstructuredArchive
from .variation import Gaussian, IsoLine, Polynomial

__version__: str

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
    "report",
    "resume",
    "save",
    "tasks",
    "tessellate",
]
