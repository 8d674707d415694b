"""Callbacks: what looks at a run while it goes on. `base` says what one is."""

from auroraqd.callbacks.base import Callbacks
from auroraqd.callbacks.loggers import CSV, Logger, MLflow, TensorBoard, WeightsAndBiases
from auroraqd.callbacks.passive import PassiveGrid, Score

__all__ = ["CSV", "Callbacks", "Logger", "MLflow", "PassiveGrid", "Score", "TensorBoard", "WeightsAndBiases"]
