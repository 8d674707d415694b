"""Callbacks: what looks at a run while it goes on. `base` says what one is."""

from auroraqd.callbacks.base import Callbacks
from auroraqd.callbacks.passive import PassiveGrid

__all__ = ["Callbacks", "PassiveGrid"]
