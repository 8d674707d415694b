"""Skills of a robot: which there are, and which of them comes closest to a goal. It needs NumPy alone.

auroraqd wrote it beside `skills.npz`, from which it takes everything. README.md says what is in there, and how to use it.
"""

from pathlib import Path

import numpy as np

with np.load(Path(__file__).with_name("skills.npz"), allow_pickle=False) as _file:
    _arrays = dict(_file)

genotype = _arrays["genotype"]
"""(n, n_genes) in [0, 1], a skill a row."""
genes = _arrays["genes"].tolist()
"""Names of the genes; empty where they have none."""
units = _arrays["units"].tolist()
"""Of the genes."""
bounds = _arrays["bounds"]
"""(n_genes, 2), the lowest and the highest value of each gene in its unit."""
fitness = _arrays["fitness"]
"""(n,), larger is better."""
descriptor = _arrays["descriptor"]
"""(n, d)."""
ground_truth = _arrays.get("ground_truth")
"""(n, ...), or None."""
observation = _arrays.get("observation")
"""(n, ...), or a dictionary of several such arrays by their names."""
if observation is None:
    observation = {name.partition(".")[2]: rows for name, rows in _arrays.items() if name.startswith("observation.")}
row = _arrays["row"]
"""(n,), which row of the repertoire each skill was."""


def reach(goal, by=None, k=1):
    """The skills whose outcome is closest to a goal, the closest first.

    Args:
        goal: an outcome, in the shape and units of one row; NaN for what does not matter. Of an observation that is a
            dictionary, those that matter.
        by: "ground_truth", "observation" or "descriptor". By default ground truth if there is some, and else the observation.
        k: how many.

    Returns:
        Skills, (k,), for `genotype[skills]` and the others; and their distances, (k,): the root mean square over the entries
        that are given, where each channel goes from -1 to 1 in the repertoire.
    """
    by = by or ("observation" if ground_truth is None else "ground_truth")
    outcomes = {"ground_truth": ground_truth, "observation": observation, "descriptor": descriptor}.get(by)
    if outcomes is None:
        raise ValueError(f"by must be ground_truth, observation or descriptor, and be stored, got {by!r}")
    if not 1 <= k <= len(genotype):
        raise ValueError(f"k must be from 1 to {len(genotype)}, got {k}")
    rows, wanted = _flat(outcomes), _goal(outcomes, goal)
    given = np.isfinite(wanted)
    if not given.any():
        raise ValueError("goal must have a finite entry")
    half, stream = _arrays[f"half.{by}"][given], _arrays[f"stream.{by}"][given]
    entries = np.bincount(stream)  # of each array of a dictionary, which count alike
    weight = 1 / (half * np.sqrt(entries[stream] * np.count_nonzero(entries)))
    distance = np.linalg.norm((rows[:, given] - wanted[given]) * weight, axis=1)
    skills = np.argsort(distance, kind="stable")[:k]
    return skills, distance[skills]


def values(skill):
    """What the controller of a skill gets: the value of each gene in its unit, by name."""
    if not genes:
        raise ValueError("the genes have no names: genotype[skill] is what the controller gets")
    low, high = bounds.T
    return dict(zip(genes, (low + genotype[skill] * (high - low)).tolist(), strict=True))


def describe(observed):
    """Descriptors, (n, d), of observations, (n, ...), or of a dictionary of several such arrays."""
    if "describe.weight" not in _arrays:
        raise ValueError("the descriptor of this run is not a matrix: it takes auroraqd to describe other observations")
    rows = _flat(observed)
    center, factor, limit, weight, offset = (
        _arrays[f"describe.{name}"] for name in ("center", "factor", "limit", "weight", "offset")
    )
    if rows.shape[1] != len(center):
        raise ValueError(f"observed must have {len(center)} entries a row, got {rows.shape[1]}")
    return np.clip((rows - center) * factor, -limit, limit) @ weight.T + offset


def _flat(outcomes):
    """(n, ...), or several, to (n, entries)."""
    parts = [outcomes[name] for name in sorted(outcomes)] if isinstance(outcomes, dict) else [outcomes]
    arrays = [np.asarray(part, float) for part in parts]
    return np.concatenate([array.reshape(len(array), -1) for array in arrays], axis=1)


def _goal(outcomes, goal):
    """(entries,), NaN for what does not matter."""
    if not isinstance(outcomes, dict):
        goal = np.asarray(goal, float)
        if goal.shape != outcomes.shape[1:]:
            raise ValueError(f"goal must have shape {outcomes.shape[1:]}, got {goal.shape}")
        return goal.reshape(-1)
    if not isinstance(goal, dict) or set(goal) - set(outcomes):
        raise ValueError(f"goal must be a dictionary of some of {', '.join(outcomes)}")
    return np.concatenate(
        [_goal(rows, goal.get(name, np.full(rows.shape[1:], np.nan))) for name, rows in sorted(outcomes.items())]
    )
