"""Experiments as data: `Settings` name everything that a run depends on."""

from auroraqd.experiments.settings import Settings

__all__ = ["Settings"]
