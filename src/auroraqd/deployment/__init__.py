"""Deployment: a folder with skills for a robot, whose computer has NumPy and nothing else.

In it are the arrays, `skills.npz`, with no pickle in it; `skills.py`, which reads them and finds the skill for a goal; and a
README. `auroraqd/deployment/skills.py` is copied as it is, and is no part of what runs here.
"""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import numpy as np

from auroraqd._files import folder_at, replacing
from auroraqd.descriptors._affine import Affine
from auroraqd.individuals import Columns
from auroraqd.observations import has_streams, streams_of
from auroraqd.refinement import Ruler
from auroraqd.tasks import Genes

_COLUMNS = "genotype", "fitness", "descriptor", "ground_truth"
_README = """# {n} skills

They were found by auroraqd{origin}. Python and NumPy are all that is needed here.

```python
import skills

rows, distance = skills.reach({goal}, k={k})  # {by}; NaN for what does not matter
best = rows[0]
print({given})  # what the controller gets
```

{described}

`distance` is a root mean square, where each channel of the outcome goes from -1 to 1 in the whole repertoire.

| in `skills` and `skills.npz` | shape | |
|---|---|---|
{table}
"""
_MEANING = {
    "genotype": "parameters of the controller, in [0, 1]",
    "fitness": "quality, larger is better",
    "descriptor": "the numbers by which skills differ",
    "ground_truth": "what the skill led to, as the task calls it",
    "observation": "what the robot sensed, as the task has it",
    "row": "which row of the repertoire it was",
}


def arrays_of(
    columns: Columns, rows: np.ndarray, rulers: Mapping[str, Ruler], genes: Genes | None, affine: Affine | None
) -> dict[str, np.ndarray]:
    """What is in `skills.npz`.

    Args:
        columns: of the repertoire.
        rows: (n,), which of its skills.
        rulers: what measures outcomes, by the column in which they are.
        genes: of the robot, if they have names.
        affine: the descriptor, if it is one matrix.
    """
    arrays = {name: columns[name][rows] for name in _COLUMNS if name in columns}
    observation = columns["observation"][rows]
    for name, stream in streams_of(observation).items():
        arrays[f"observation.{name}" if has_streams(observation) else "observation"] = stream
    for name, ruler in rulers.items():
        arrays[f"half.{name}"], arrays[f"stream.{name}"] = ruler
    for name in ("center", "factor", "limit", "weight", "offset") if affine is not None else ():
        arrays[f"describe.{name}"] = getattr(affine, name)
    names, units, bounds = ([], [], np.empty((0, 2))) if genes is None else (genes.names, genes.units, genes.bounds)
    return {**arrays, "genes": np.array(names, "U"), "units": np.array(units, "U"), "bounds": bounds, "row": rows}


def written(folder: Path, arrays: Mapping[str, np.ndarray], origin: str, overwrite: bool) -> list[Path]:
    """Write a folder for a robot; returns its files.

    Args:
        folder: to create.
        arrays: see `arrays_of`.
        origin: where they come from, for the README.
        overwrite: whether it may be there.

    Raises:
        FileExistsError: it is there.
        OSError: it cannot be written.
    """
    if (folder.exists() or folder.is_symlink()) and not overwrite:
        raise FileExistsError(f"{folder} exists: choose another folder, or replace its files with overwrite")
    folder_at(folder)
    paths = [folder / name for name in ("skills.npz", "skills.py", "README.md")]
    with replacing(paths[0]) as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType] - no array is called like an option
    with replacing(paths[1]) as file:
        file.write(resources.files("auroraqd.deployment").joinpath("skills.py").read_bytes())
    with replacing(paths[2]) as file:
        file.write(_readme(arrays, origin).encode())
    return paths


def _readme(arrays: Mapping[str, np.ndarray], origin: str) -> str:
    by = "ground_truth" if "ground_truth" in arrays else "observation"
    outcomes = {name: rows for name, rows in arrays.items() if name.partition(".")[0] == by}
    examples = {name.partition(".")[2]: _example(name, rows) for name, rows in outcomes.items()}
    goal = examples.get("") or "{" + ", ".join(f'"{name}": {text}' for name, text in examples.items()) + "}"
    shown = [name for name in arrays if name.partition(".")[0] in _MEANING]
    table = [f"| `{name}` | {arrays[name].shape} | {_MEANING[name.partition('.')[0]]} |" for name in shown]
    genes = [
        f"| gene `{name}` | | {low:g} to {high:g}{unit and ' '}{unit} |"
        for name, unit, (low, high) in zip(arrays["genes"], arrays["units"], arrays["bounds"].tolist(), strict=True)
    ]
    described = (
        "`skills.describe(observations)` gives descriptors of other observations, (n, ...)."
        if "describe.weight" in arrays
        else "The descriptor of this run is not a matrix: it takes auroraqd to describe other observations."
    )
    return _README.format(
        n=f"{len(arrays['genotype']):,}",
        origin=origin,
        goal=goal,
        k=min(3, len(arrays["genotype"])),
        by=f"the nearest in {by.replace('_', ' ')}",
        given="skills.values(best)" if len(genes) else "skills.genotype[best]",
        described=described,
        table="\n".join([*table, *genes]),
    )


def _example(name: str, rows: np.ndarray) -> str:
    """A goal, as Python has it: an outcome that there is, in short if it is."""
    if rows[0].size > 6:
        where = name.partition(".")
        return f'skills.observation["{where[2]}"][0]' if where[1] else f"skills.{name}[0]"
    return str(np.round(rows[0].astype(float), 3).tolist())
