"""Videos: figures, frame by frame, as .gif or .mp4."""

import math
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.figure import Figure

from auroraqd._files import folder_at, told
from auroraqd.report.style import STYLE

LAST = 1.0
"""Seconds that the last frame stays."""


def arrangement(panels: int) -> tuple[int, int]:
    """Rows and columns of panels beside each other, about twice as wide as high."""
    columns = round(math.sqrt(1.5 * panels))
    return math.ceil(panels / columns), columns


@contextmanager
def video(figure: Figure, path: Path, rate: int) -> Iterator[Callable[[], None]]:
    """To write one: a function that adds what the figure shows as a frame.

    Args:
        figure: that is drawn.
        path: ends in .gif or .mp4. A file that is there is replaced when the new one is complete; its folder is created if
            needed.
        rate: frames a second.

    Raises:
        ValueError: the file has another ending, or there is no ffmpeg for .mp4.
        OSError: it cannot be written.
    """
    writer = _writer(path, rate)
    if os.path.isdir(path):  # of a name that is too long, Path.is_dir raises
        raise IsADirectoryError(f"{path} must be a file, and is a folder")
    folder_at(path.parent)
    temporary = path.with_name(f".tmp.{path.name}")
    with mpl.rc_context(STYLE):
        try:
            temporary.touch()  # ffmpeg would not say why it cannot
        except OSError as error:
            raise told(error, f"{path} could not be written") from None
        try:
            with writer.saving(figure, str(temporary), dpi=100):
                yield writer.grab_frame
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def _writer(path: Path, rate: int) -> PillowWriter | FFMpegWriter:
    if path.suffix.lower() == ".gif":
        return PillowWriter(fps=rate)
    if path.suffix.lower() == ".mp4":
        mpl.rcParams["animation.ffmpeg_path"] = ffmpeg()
        return FFMpegWriter(fps=rate, codec="h264", extra_args=["-pix_fmt", "yuv420p"])  # which every player knows
    raise ValueError(f"the animation must be a .gif or an .mp4, got {path.name!r}")


def ffmpeg() -> str:
    """Where ffmpeg is.

    Raises:
        ValueError: it is nowhere.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        try:
            from imageio_ffmpeg import get_ffmpeg_exe  # pyright: ignore[reportMissingImports] - an extra

            found = get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            raise ValueError(
                "an .mp4 needs ffmpeg: install it, or the extra auroraqd[video], or write a .gif, which needs neither"
            ) from None
    return found
