from . import archives, callbacks, emitters, evaluate, metrics, report, tasks, testing
from .adaptation import Adaptation
from .archives.base import Archive
from .archives.cvt import CVTArchive, tessellate
from .archives.dominated import DominatedArchive
from .archives.grid import GridArchive
from .archives.unstructured import UnstructuredArchive
from .aurora import Aurora
from .control.resolution import CSC, VAT, Fixed, Size
from .control.schedule import Doubling, Every, Never, Widening
from .descriptors.autoencoder import AutoEncoder
from .descriptors.descriptor import DescriptorError
from .descriptors.streams import Streams
from .emitters.selection import Curiosity, Mixed, Novelty, Surprise, Uniform
from .emitters.variation import Gaussian, IsoLine, Polynomial
from .repertoire import Repertoire
from .runs.checkpoints import Checkpoints
from .runs.folders import load, resume, save
from .runs.snapshots import Snapshots
from .tasks import Evaluation, TaskError

__version__: str

__all__ = [
    "CSC",
    "VAT",
    "Adaptation",
    "Archive",
    "Aurora",
    "AutoEncoder",
    "CVTArchive",
    "Checkpoints",
    "Curiosity",
    "DescriptorError",
    "DominatedArchive",
    "Doubling",
    "Evaluation",
    "Every",
    "Fixed",
    "Gaussian",
    "GridArchive",
    "IsoLine",
    "Mixed",
    "Never",
    "Novelty",
    "Polynomial",
    "Repertoire",
    "Size",
    "Snapshots",
    "Streams",
    "Surprise",
    "TaskError",
    "Uniform",
    "UnstructuredArchive",
    "Widening",
    "archives",
    "callbacks",
    "emitters",
    "evaluate",
    "load",
    "metrics",
    "report",
    "resume",
    "save",
    "tasks",
    "tessellate",
    "testing",
]
