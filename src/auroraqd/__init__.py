"""auroraqd: a robot finds out by itself what it can do.

Quality-Diversity search with behavioural descriptors learned from sensory data (AURORA; Cully, GECCO 2019). Start with
`Aurora`.
"""

import lazy_loader

__version__ = "0.3.0"

# The public names are those of the stub, `__init__.pyi`. They are loaded when first used: the command line must answer before
# NumPy, Numba and scikit-learn are imported.
__getattr__, _names, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __dir__() -> list[str]:
    return [*_names(), "__version__"]
