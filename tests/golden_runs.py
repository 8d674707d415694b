"""Four seeded runs whose course must not change unless that is meant, and what is kept of them.

    python tests/golden_runs.py     # from the top folder: writes tests/golden anew, because the course is to change

Bit for bit, a run is the same on one type of machine and one set of versions. So digests are kept by the environment they were
taken in; in another, runs are compared by how many individuals they store.
"""

import hashlib
import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np
from llvmlite.binding import get_host_cpu_name
from sklearn.decomposition import PCA
from threadpoolctl import threadpool_info

import auroraqd

GOLDEN = Path(__file__).parent / "golden"
DIGESTS, FOLDER = GOLDEN / "digests.json", GOLDEN / "run"
COLUMNS = ("genotype", "fitness", "observation", "descriptor", "ground_truth", "reconstruction_error", "curiosity", "id")
_COUNTS = ("generation", "evaluations", "size", "l", "rejected", "new", "replaced", "invalid", "mean_fitness", "rmse")
_VERSIONS = ("numpy", "scipy", "scikit-learn", "numba", "llvmlite", "jax", "jaxlib", "equinox", "optax")


def windy(genotypes, seeds):
    """A robot whose way depends on chance, and that fails now and then."""
    wind = np.array([np.random.default_rng(int(seed)).random(2) for seed in seeds])
    observation = np.stack([genotypes[:, :2] + 0.1 * wind, genotypes[:, 1:3] ** 2], axis=1)
    fitness = -np.abs(genotypes - 0.5).sum(axis=1)
    fitness[wind[:, 0] < 0.02] = np.nan
    return fitness, observation, observation[:, 0]


windy.seeded = True


def pca():
    """The paper's own: throws, PCA, curiosity, polynomial mutation, three updates."""
    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=1, resolution=auroraqd.VAT())
    return aurora.run(auroraqd.tasks.Ballistic(), generations=155)


def elitist():
    """A fitness that varies, invalid individuals, a full archive, updates of a descriptor that is not learned."""
    archive = auroraqd.UnstructuredArchive(k=5, competition="elitist", capacity=600)
    options = {
        "archive": archive,
        "variation": auroraqd.Gaussian(),
        "schedule": auroraqd.Every(7),
        "resolution": auroraqd.VAT(1e4),
    }
    return auroraqd.Aurora(3, "hand-coded", seed=2, batch_size=50, **options).run(windy, generations=40)


def cells():
    """MAP-Elites on a grid, pairs of parents, known controllers to start from."""
    archive = auroraqd.GridArchive((15, 15, 15), low=0.0, high=1.0)
    aurora = auroraqd.Aurora(3, "genotype", archive=archive, selection=auroraqd.Uniform(), variation=auroraqd.IsoLine(), seed=3)
    return aurora.run(windy, generations=25, initial=np.full((3, 3), 0.25))


def autoencoder():
    """An auto-encoder on the arm and its puck, small; saved between ask and tell, with individuals of all kinds."""
    encoder = auroraqd.AutoEncoder(2, hidden=(16, 8), max_epochs=2, min_steps=40, repeats=2)
    options = {"batch_size": 20, "schedule": auroraqd.Doubling(5), "resolution": auroraqd.VAT()}
    aurora = auroraqd.Aurora(8, encoder, seed=6, **options).run(auroraqd.tasks.AirHockey(), generations=40)
    aurora.ask()
    return aurora


RUNS = {run.__name__: run for run in (pca, elitist, cells, autoencoder)}


def environment():
    """What the bits of a run depend on."""
    features = np.show_config(mode="dicts")["SIMD Extensions"]  # pyright: ignore[reportOptionalSubscript]
    found = {
        "machine": platform.machine(),
        "processor": get_host_cpu_name(),
        "simd": [*features["baseline"], *features.get("found", [])],
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "blas": sorted({str(library.get("architecture")) for library in threadpool_info() if library["user_api"] == "blas"}),
        **{name: version(name) for name in _VERSIONS},
    }
    return json.dumps(found, sort_keys=True)


def columns_digest(individuals):
    """A number for the columns of an archive or a repertoire."""
    content = hashlib.blake2b(digest_size=16)
    for name in COLUMNS:
        column = getattr(individuals, name)
        if column is not None:
            content.update(f"{name} {column.dtype} {column.shape}".encode())
            content.update(np.ascontiguousarray(column).data)
    return content.hexdigest()


def digest(aurora):
    """A number for all that a run has found and how."""
    content = hashlib.blake2b(columns_digest(aurora.archive).encode(), digest_size=16)
    for record in aurora.history.records:
        content.update(repr([getattr(record, name) for name in _COUNTS]).encode())
    content.update(json.dumps(aurora._rng.bit_generator.state["state"], sort_keys=True).encode())
    return content.hexdigest()


def write():
    """Keep what the runs are now."""
    kept = json.loads(DIGESTS.read_text()) if DIGESTS.exists() else {}
    runs = {name: run() for name, run in RUNS.items()}
    sizes = {name: len(aurora.archive) for name, aurora in runs.items()}
    digests = kept.get("digests", {}) if kept.get("sizes") == sizes else {}
    digests[environment()] = {name: digest(aurora) for name, aurora in runs.items()}
    GOLDEN.mkdir(exist_ok=True)
    if not FOLDER.exists():  # it shows that what an earlier version wrote is read
        auroraqd.save(runs["autoencoder"], FOLDER)
    folder = columns_digest(auroraqd.load(FOLDER))
    DIGESTS.write_text(json.dumps({"folder": folder, "sizes": sizes, "digests": digests}, indent=2) + "\n")


if __name__ == "__main__":
    write()
