"""What the measures of an experiment took of a run, generation by generation, kept until the run is done.

A measure looks at individuals that later generations replace, so a run that is interrupted can only be measured in the end if
what was seen of it before is kept beside its checkpoints.
"""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auroraqd._files import folder_at
from auroraqd.runs import _tensors

_FOLDER = "looks"
_FORM = "auroraqd-looks"


class Looks:
    """A folder of them, a file a generation.

    Args:
        run: the folder of the run.

    Raises:
        OSError: there cannot be such a folder.
    """

    def __init__(self, run: Path):
        self._folder = run / _FOLDER

    def keep(self, generation: int, seen: Mapping[str, Any]) -> None:
        """What the measures took, by their names: numbers or arrays."""
        path = folder_at(self._folder) / f"{generation}.safetensors"
        _tensors.write(path, {name: np.asarray(value) for name, value in seen.items()}, _FORM, "", lasting=False)

    def kept(self, generation: int) -> dict[str, np.ndarray]:
        """What was kept of a generation.

        Raises:
            OSError, ValueError: there is nothing, or it is damaged.
        """
        return _tensors.read(self._folder / f"{generation}.safetensors", _FORM)[0]

    def remove(self) -> None:
        """All of them."""
        shutil.rmtree(self._folder, ignore_errors=True)
