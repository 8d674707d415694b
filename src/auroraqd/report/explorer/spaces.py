"""A space in which skills are points: its columns, and the directions in which they vary most."""

from typing import Any

import numpy as np

from auroraqd.report.explorer.tables import single, table


def space(title: str, values: np.ndarray, rows: np.ndarray, names: list[str]) -> dict[str, Any]:
    """A space as the page holds it.

    Args:
        title: of its map.
        values: (n, columns), of all skills.
        rows: of those in the page.
        names: of the columns.
    """
    found: dict[str, Any] = {
        "title": title,
        "names": names,
        "table": table(values[rows]),
        "main": None,
        "shown": [0, min(1, len(names) - 1)],
    }
    if len(names) > 2 and np.isfinite(values).all() and np.ptp(values, axis=0).any():
        directions = main_directions(values)
        middle = values.mean(axis=0)
        found["main"] = single((values[rows] - middle) @ directions.T)
        found["shown"] = [len(names), len(names) + 1]
        found["directions"], found["middle"] = directions.tolist(), middle.tolist()
    return found


def main_directions(values: np.ndarray) -> np.ndarray:
    """The two directions in which values, (n, columns), vary most, (2, columns)."""
    _, directions = np.linalg.eigh(np.cov(values, rowvar=False))
    return directions[:, :-3:-1].T
