"""Archives: where a Quality-Diversity algorithm keeps what it found, and by which rule.

`base` is what every archive promises, and what one of your own derives from; `unstructured` is the archive of the paper; `grid`
and `cvt` have cells; `dominated` holds a number of individuals.
"""

from auroraqd.archives.base import INVALID, NEW, REJECTED, REPLACED, Archive, Info, Placement
from auroraqd.archives.cvt import CVTArchive, Tessellation, tessellate
from auroraqd.archives.dominated import DominatedArchive
from auroraqd.archives.grid import CellArchive, GridArchive
from auroraqd.archives.unstructured import UnstructuredArchive

__all__ = [
    "INVALID",
    "NEW",
    "REJECTED",
    "REPLACED",
    "Archive",
    "CVTArchive",
    "CellArchive",
    "DominatedArchive",
    "GridArchive",
    "Info",
    "Placement",
    "Tessellation",
    "UnstructuredArchive",
    "tessellate",
]
