"""What a page holds of a stream of what was observed: that of each skill, and what the descriptor makes of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auroraqd.observations import streams_of
from auroraqd.repertoire import Repertoire
from auroraqd.report.explorer.decoders import Decode, decoder
from auroraqd.report.explorer.places import stage_of
from auroraqd.report.explorer.sights import Sight
from auroraqd.report.explorer.tables import back, table

BYTES = 7_000_000
"""Of what is observed, in a page."""


@dataclass(frozen=True, eq=False)
class View:
    """A stream, and how it is shown.

    Args:
        stream: its name.
        sight: how it is shown.
        decode: from descriptors to what is seen there, or None.
        decoder: the same for the browser, or None.
    """

    stream: str
    sight: Sight
    decode: Decode | None
    decoder: dict[str, Any] | None

    @classmethod
    def of(cls, repertoire: Repertoire, stream: str) -> "View":
        """That of a stream of a repertoire."""
        observation = streams_of(repertoire.observation)[stream]
        sight = Sight.of(observation.shape[1:], observation.dtype)
        decode = _decode(repertoire, sight, stream)
        return cls(stream, sight, decode, decoder(decode, repertoire.descriptor) if decode else None)

    @property
    def bytes_each(self) -> int:
        """Of a skill, in a page."""
        observed = 1 if self.sight.kind == "image" else 2
        return self.sight.features * (observed + (0 if self._exact or self.decode is None else 1))

    @property
    def _exact(self) -> bool:
        return self.decoder is not None and self.decoder["kind"] == "affine"

    def content(self, repertoire: Repertoire, config: Mapping[str, Any], rows: np.ndarray) -> dict[str, Any]:
        """What the page holds of it, of these rows, as values that become JSON, and arrays."""
        observation, sight = streams_of(repertoire.observation)[self.stream], self.sight
        seen = sight.seen(observation[rows])
        observed = _one_scale(seen) if sight.kind == "image" else table(seen)
        differences = None
        if self.decode is not None and not self._exact:
            differences = table(self.decode(repertoire.descriptor[rows]) - back(observed), np.int8)
        return {
            "sight": {"kind": sight.kind, "shape": list(sight.shape), "given": list(sight.given)},
            "observed": observed,
            "decoder": self.decoder,
            "differences": differences,
            "stage": stage_of(config, repertoire, sight, observation),
        }


def fitting(views: Sequence[View], skills: int, share: float) -> list[bool]:
    """Which views are in a page: the first, and of the others those for which there is room.

    Args:
        views: in the order of their worth.
        skills: in the page.
        share: of the bytes of a page that are for them.
    """
    left, fits = share * BYTES - skills * views[0].bytes_each, [True]
    for view in views[1:]:
        fits.append(skills * view.bytes_each <= left)
        left -= skills * view.bytes_each * fits[-1]
    return fits


def _decode(repertoire: Repertoire, sight: Sight, stream: str) -> Decode | None:
    """From descriptors to what is seen there; None where the descriptor cannot reconstruct, or not here."""

    def decode(places: np.ndarray) -> np.ndarray:
        return sight.seen(streams_of(repertoire.reconstruct(places))[stream])

    try:
        return decode if np.isfinite(decode(repertoire.descriptor[:1])).all() else None
    except (RuntimeError, ValueError):
        return None


def _one_scale(pixels: np.ndarray) -> dict[str, Any]:
    """A table of images, for which each pixel would otherwise have its own scale."""
    flat = table(pixels.reshape(-1, 1), np.uint8)
    columns = pixels.shape[1]
    return {"values": flat["values"].reshape(pixels.shape), "low": flat["low"] * columns, "step": flat["step"] * columns}
