"""Where fitness matters: behaviours that can be had at several prices, and the archive keeps the cheaper ones."""

import numpy as np
import pytest
from sklearn.decomposition import PCA

import auroraqd

JOINTS = 6


def tip(genotypes):
    """Of an arm of unit length, (n, 2): many postures reach one place."""
    angle = np.cumsum(np.pi * (genotypes - 0.5), axis=1)
    return np.stack([np.cos(angle).sum(axis=1), np.sin(angle).sum(axis=1)], axis=1) / JOINTS


def effort(genotypes):
    return ((genotypes - 0.5) ** 2).sum(axis=1)


def thrifty(genotypes):
    return -effort(genotypes), tip(genotypes)


def careless(genotypes):
    return np.zeros(len(genotypes)), tip(genotypes)


def grown(task, competition="dominance"):
    archive = auroraqd.UnstructuredArchive(competition=competition)
    aurora = auroraqd.Aurora(JOINTS, PCA(2), seed=0, batch_size=100, archive=archive, resolution=auroraqd.VAT(cells=800))
    return aurora.run(task, generations=150)


def excess(archive):
    """How much more effort than the least that any of several thousand other postures needs to end as near, on average."""
    others = np.random.default_rng(1).random((4000, JOINTS))
    distance = np.linalg.norm(tip(others)[None] - archive.observation[:, None], axis=2)
    least = np.where(distance < 0.05, effort(others), np.inf).min(axis=1)
    return np.mean((effort(archive.genotype) - least)[np.isfinite(least)])


@pytest.mark.parametrize("competition", ["dominance", "elitist"])
def test_the_archive_prefers_what_is_cheap(competition):
    cheap, any_price = grown(thrifty, competition), grown(careless, competition)
    assert excess(cheap.archive) < 0.7 * excess(any_price.archive)
    fitness = cheap.history.column("mean_fitness")
    assert fitness[-1] > fitness[10]
    # without giving up places: as much of the disc is reached
    cells = [len(np.unique(np.floor(8 * a.archive.observation), axis=0)) for a in (cheap, any_price)]
    assert cells[0] > 0.85 * cells[1]


def test_cells_keep_the_cheapest():
    def with_truth(genotypes):
        return (*thrifty(genotypes), tip(genotypes))

    grid = auroraqd.GridArchive((12, 12), low=-1, high=1)
    aurora = auroraqd.Aurora(JOINTS, "hand-coded", seed=0, archive=grid, schedule=auroraqd.Never())
    best: dict = {}

    def watched(genotypes):
        for place, value in zip(np.floor((tip(genotypes) + 1) * 6).clip(0, 11), effort(genotypes), strict=True):
            best[tuple(place)] = min(value, best.get(tuple(place), np.inf))
        return with_truth(genotypes)

    aurora.run(watched, generations=50)
    cells = np.floor((aurora.archive.descriptor + 1) * 6).clip(0, 11)
    assert {tuple(cell): -value for cell, value in zip(cells, aurora.archive.fitness, strict=True)} == best
