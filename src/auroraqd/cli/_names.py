"""Names that a shell can complete.

They are written down here, and not read where they are defined, for that would take seconds at each press of a key; a test
holds them equal. Those with a colon are left out, for bash takes it to end a word.
"""

from collections.abc import Callable

NAMES = {
    "task": ("ballistic", "air-hockey", "air-hockey-camera", "maze", "hexapod", "octopus-arm"),
    "experiment": ("ballistic", "air-hockey", "follow-up", "paper"),
    "descriptor": ("pca", "autoencoder", "hand-coded", "genotype", "observation"),
    "emitter": ("genetic", "goals", "novelty-search", "nslc", "taxons"),
    "selection": ("curiosity", "uniform", "novelty", "surprise", "mixed"),
    "variation": ("polynomial", "gaussian", "iso-line"),
    "resolution": ("auto", "vat", "size", "fixed", "csc"),
    "schedule": ("doubling", "widening", "every", "never"),
    "archive": ("unstructured", "grid", "cvt", "cvt-prior", "dominated"),
    "competition": ("dominance", "elitist"),
}


def completed(kind: str) -> Callable[[str], list[str]]:
    """What completes the beginning of a name, for `typer.Option(autocompletion=...)`."""

    def completions(incomplete: str) -> list[str]:
        return [name for name in NAMES[kind] if name.startswith(incomplete)]

    return completions
