"""Emitters: what makes the genotypes that are evaluated next.

An emitter has one method, and may have more::

    ask(archive, n, rng)            (genotypes, parents): (n, n_genes) in [0, 1], and (n,) ids of their parents, -1 for none
    tell(archive, batch, info)      what became of its genotypes: their `Columns`, all n of them, the descriptor and the
                                    reconstruction error of invalid ones NaN, and their `Info`, after the archive has taken them
    withdrawn(genotype)             genotypes of its own, (n, n_genes), that it will never be told about
    updated(archive, describe)      the descriptor has changed; `describe` adds the new one, and the reconstruction error if it
                                    gives one, to any `Columns` of individuals
    state(), restore(state)         what it remembers, as a dict of JSON values and arrays, for checkpoints

What these raise leaves the run whole: the error comes once what was told is kept, as an `EmitterError` that names the emitter.

It is not asked while nothing is stored, when genotypes are random, unless it has a true attribute `starts`. `Aurora` copies
what it is given, so that an emitter belongs to one run.
"""

from auroraqd.emitters.base import Emitter, EmitterError
from auroraqd.emitters.genetic import Genetic
from auroraqd.emitters.goals import Goals
from auroraqd.emitters.population import NSLC, TAXONS, NoveltySearch
from auroraqd.emitters.ribs import Ribs

__all__ = ["NSLC", "TAXONS", "Emitter", "EmitterError", "Genetic", "Goals", "NoveltySearch", "Ribs"]
