"""The results of an experiment on disk, which add up over days and machines.

    settings.json    the settings of every variant that has results
    runs.csv         a `Result` a line
    curves.csv       a `Point` a line
    runs/            the run folders, with their repertoires

The first three are small and say what is done; the run folders are only needed for figures of repertoires and as references.
"""

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

from auroraqd._files import folder_at, read_table, replacing
from auroraqd.control.resolution import VAT
from auroraqd.experiments.replication import Point, Result
from auroraqd.experiments.settings import Genetic, Settings

SETTINGS, RUNS, CURVES, FOLDERS = "settings.json", "runs.csv", "curves.csv", "runs"
_SEEN = ("air-hockey-camera", "maze")  # tasks of images
_MEASURES = "measures"  # the field whose entries are columns of their own
_Row = TypeVar("_Row", Result, Point)


class Ledger:
    """The results in a folder.

    Args:
        folder: created when the first result is written.

    Raises:
        ValueError: its files are damaged.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._read()

    def _read(self) -> None:
        self.results: list[Result] = _table(self.folder / RUNS, Result)
        self.points: list[Point] = _table(self.folder / CURVES, Point)
        self._settings: dict[str, Any] = _read_settings(self.folder / SETTINGS)
        runs = Counter((result.variant, result.replication) for result in self.results)
        for (variant, replication), times in runs.items():
            if times > 1 or replication < 0:
                what = f"{variant} {replication} {times} times" if times > 1 else f"a replication {replication} of {variant}"
                raise ValueError(f"{self.folder / RUNS} is damaged: it lists {what}")
        unknown = sorted({row.variant for row in [*self.results, *self.points]} - set(self._settings))
        if unknown:
            raise ValueError(
                f"{self.folder / SETTINGS} must hold the settings of every variant with results, and has none of "
                f"{', '.join(unknown)}: it belongs to the results wherever they are copied"
            )

    def check(self, variants: Mapping[str, Settings]) -> None:
        """Make sure that results of these settings may be added.

        Raises:
            ValueError: there are results of a variant with other settings, or of any with another budget.
        """
        for name, settings in variants.items():
            wanted, known = _comparable(settings), self._settings.get(name)
            if known is not None and known != wanted:
                differ = [key for key in wanted if known.get(key) != wanted[key]]
                came = ", ".join(f"{key} {known.get(key)!r} and not {wanted[key]!r}" for key in differ) or "others"
                raise ValueError(f"{self.folder} holds results of {name} with other settings, {came}: choose another folder")
        for settings, (other, known) in product(variants.values(), self._settings.items()):
            ours, theirs = (f"{of['generations']:,} generations of {of['batch_size']}" for of in (settings.as_json(), known))
            if ours != theirs:
                raise ValueError(f"{self.folder} holds results of {other} after {theirs} and not {ours}: choose another folder")

    def done(self, variant: str) -> set[int]:
        """The replications of a variant that are done."""
        return {result.replication for result in self.results if result.variant == variant}

    def run_folder(self, variant: str, replication: int) -> Path:
        """Where the run folder of a replication is."""
        return self.folder / FOLDERS / f"{variant}-{replication}"

    def add(self, settings: Settings, result: Result, points: Iterable[Point]) -> None:
        """Write a result down, in place of one of the same run, beside what others have written meanwhile.

        Raises:
            ValueError: they were at work with other settings.
        """
        self._read()
        self.check({result.variant: settings})
        run = result.variant, result.replication
        self.results = sorted([*(r for r in self.results if (r.variant, r.replication) != run), result], key=lambda r: r[:2])
        kept = [p for p in self.points if (p.variant, p.replication) != run]
        self.points = sorted([*kept, *points], key=lambda p: p[:3])
        self._settings[result.variant] = _comparable(settings)
        folder_at(self.folder)
        _write(self.folder / SETTINGS, json.dumps(dict(sorted(self._settings.items())), indent=1) + "\n")
        _write(self.folder / CURVES, _csv(Point, self.points))
        _write(self.folder / RUNS, _csv(Result, self.results))  # last: what it lists is done


def _comparable(settings: Settings) -> dict[str, Any]:
    """All settings but the seed, with what the descriptor's are by default, as JSON gives them back."""
    values = json.loads(json.dumps({**settings.as_json(), "parameters": settings.parameters()}))
    return {name: value for name, value in values.items() if name != "seed"}


def _read_settings(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        values = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from None
    if not isinstance(values, dict) or not all(isinstance(value, dict) for value in values.values()):
        raise ValueError(f"{path} is damaged: it must hold a JSON object of objects")
    return {name: _as_now(value) for name, value in values.items()}


def _as_now(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings that earlier versions wrote, as they are called now. Version 0.2.0 set aside and refused nothing."""
    since = {"survival": 0.0, "robust": False, "asynchronous": False, "emitter": {"type": Genetic.__name__}}
    earlier: dict[str, Any] = {**since, **settings}
    kept = earlier.get("resolution")
    if isinstance(kept, dict) and kept.get("type") == VAT.__name__:
        earlier["resolution"] = {"robust": False, **kept}
    network = earlier.get("parameters", {}).get("network")
    if network == "convolutional":  # which "auto" gives the metric it always had
        earlier["parameters"] = {"beta": 0.0, "metric": "auto", **earlier["parameters"]}
    named, sees = network not in (None, "auto"), earlier["task"].partition(":")[0] in _SEEN
    if named or (network == "auto" and sees):  # which have no noise by default
        earlier["parameters"] = {"noise": None, **earlier["parameters"]}
    return earlier


def _table(path: Path, kind: type[_Row]) -> list[_Row]:
    return read_table(path, kind, rest=_MEASURES) if path.is_file() else []


def _csv(kind: type[_Row], rows: Sequence[_Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    fields = [name for name in kind._fields if name != _MEASURES]
    measures = list(dict.fromkeys(name for row in rows for name in row.measures))
    writer.writerow([*fields, *measures])
    for row in rows:
        values = [*(getattr(row, name) for name in fields), *(row.measures.get(name, float("nan")) for name in measures)]
        writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in values])
    return text.getvalue()


def _write(path: Path, text: str) -> None:
    with replacing(path) as file:
        file.write(text.encode())
