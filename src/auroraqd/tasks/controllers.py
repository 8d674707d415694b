"""Controllers: what moves a robot, made from a genotype.

An open-loop controller knows what it will do before it starts; a closed-loop one decides at each step by what it senses. Both
give controls in [-1, 1], which the task scales to the actions of its environment. In an environment of k discrete actions
there are k controls, and the action with the largest is taken.

One of one's own is any object with the methods of `OpenLoop` or `ClosedLoop`; one with the method `policy` is closed-loop.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, Protocol, TypeGuard

import numpy as np

from auroraqd._checks import number, numbers, shown, whole, wholes

_MOST = 10**6  # knots of an actuator, and neurons of a layer


class OpenLoop(Protocol):
    """What an open-loop controller must do."""

    def n_genes(self, actuators: int, /) -> int:
        """Genes it takes for a robot with this many actuators."""
        ...

    def __call__(self, genotypes: np.ndarray, actuators: int, time: np.ndarray, /) -> np.ndarray:
        """Controls in [-1, 1], (n, steps, actuators), of genotypes, (n, n_genes) in [0, 1].

        The steps begin at `time`, (steps,), in seconds, evenly spaced from 0 on. Each row must follow from its own genotype
        alone.
        """
        ...


class ClosedLoop(Protocol):
    """What a closed-loop controller must do."""

    def n_genes(self, observations: int, actuators: int, /) -> int:
        """Genes it takes for a robot that senses this many numbers, and has this many actuators."""
        ...

    def policy(self, genotypes: np.ndarray, observations: int, actuators: int, /) -> Callable[[np.ndarray], np.ndarray]:
        """For an episode of the robots with these genotypes, (n, n_genes) in [0, 1]: a function that is called at each step.

        It gets what all n sense at that moment, (n, observations), the environment's own observation, flat and unscaled, and
        returns controls in [-1, 1], (n, actuators). It may remember what was before. Each row must follow from its own
        genotype and observations alone; a robot whose episode has ended senses what it last did, and does not move.
        """
        ...


def is_closed_loop(controller: Any) -> TypeGuard[ClosedLoop]:
    """Whether it senses.

    Raises:
        ValueError: it is no controller.
    """
    closed = callable(getattr(controller, "policy", None))
    if isinstance(controller, type) or not (
        callable(getattr(controller, "n_genes", None)) and (closed or callable(controller))
    ):
        raise ValueError(
            "controller must have a method n_genes, and be callable (open-loop) or have a method policy (closed-loop), "
            f"got {shown(controller)}"
        )
    return closed


@dataclass(frozen=True)
class Sinusoids:
    """An open-loop controller: each actuator follows a sine of its own amplitude, phase and offset, all of one frequency.

    Genes, in this order: amplitudes, phases and offsets of all actuators, and the frequency.

    Args:
        slowest, fastest: bounds of the frequency in Hz.
        offset: the largest, in half ranges of the actuators.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> controller = auroraqd.tasks.Sinusoids()
        >>> genotypes = np.full((4, controller.n_genes(8)), 0.5)
        >>> controller(genotypes, 8, np.arange(20) / 20).shape  # individuals, steps, actuators
        (4, 20, 8)
    """

    slowest: float = 0.5
    fastest: float = 2.0
    offset: float = 0.5

    def __post_init__(self) -> None:
        number("slowest", self.slowest)
        number("fastest", self.fastest, least=self.slowest, wanted="at least slowest")
        number("offset", self.offset)

    def n_genes(self, actuators: int) -> int:
        """For a robot with this many actuators."""
        return 3 * actuators + 1

    def __call__(self, genotypes: np.ndarray, actuators: int, time: np.ndarray) -> np.ndarray:
        """Controls in [-1, 1], (n, steps, actuators), of genotypes, (n, n_genes), at times in seconds, (steps,)."""
        amplitude, phase, offset = np.split(genotypes[:, None, : 3 * actuators], 3, axis=2)
        frequency = self.slowest + (self.fastest - self.slowest) * genotypes[:, -1]
        waves = np.sin(2 * np.pi * (frequency[:, None, None] * time[:, None] + phase))
        return np.clip(amplitude * waves + self.offset * (2 * offset - 1), -1, 1)


@dataclass(frozen=True)
class Splines:
    """An open-loop controller: each actuator follows a smooth curve through knots, evenly spaced from first to last step.

    Genes: the knots of the first actuator, then of the second, and so on. The curve is SciPy's monotone cubic interpolation,
    which has no kinks and never leaves the range of the knots beside it.

    Args:
        knots: of each actuator, at least 2.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> controller = auroraqd.tasks.Splines(knots=4)
        >>> genotypes = np.full((2, controller.n_genes(3)), 0.5)
        >>> controller(genotypes, 3, np.arange(20) / 20).shape
        (2, 20, 3)
    """

    knots: int = 5

    def __post_init__(self) -> None:
        whole("knots", self.knots, least=2, most=_MOST)

    def n_genes(self, actuators: int) -> int:
        """For a robot with this many actuators."""
        return self.knots * actuators

    def __call__(self, genotypes: np.ndarray, actuators: int, time: np.ndarray) -> np.ndarray:
        """Controls in [-1, 1], (n, steps, actuators), of genotypes, (n, n_genes), at times in seconds, (steps,)."""
        from scipy.interpolate import PchipInterpolator  # takes half a second

        knots = 2 * genotypes.reshape(-1, actuators, self.knots) - 1
        finite = np.isfinite(knots)  # SciPy takes no others
        curve = PchipInterpolator(np.linspace(0, 1, self.knots), np.where(finite, knots, 0), axis=2)
        controls = np.moveaxis(curve(np.linspace(0, 1, len(time))), 2, 1)
        controls[~finite.all(axis=(1, 2))] = np.nan
        return controls


@dataclass(frozen=True)
class SquareWaves:
    """An open-loop controller for legs of three actuators: a square wave for the first, one for the second, and minus that for
    the third, so that the last link of a leg stays as it was, upright for instance.

    The controller of the hexapod in A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature
    521, 2015: a wave is 100 samples of a period, up for the share of it that is its duty cycle and then down, smoothed by a
    Gaussian of 3 samples that is cut at 10, and shifted by its phase.

    Genes, of each leg in turn: amplitude, phase and duty cycle of the first actuator, and the same of the second.

    Args:
        period: in seconds, more than 0.

    Examples:
        >>> import numpy as np
        >>> import auroraqd
        >>> controller = auroraqd.tasks.SquareWaves()
        >>> controller.n_genes(18)
        36
        >>> controls = controller(np.ones((1, 36)) / 2, 18, np.arange(100) / 100)
        >>> controls.shape, float(controls.max()), bool((controls[..., 2] == -controls[..., 1]).all())
        ((1, 100, 18), 0.5, True)
    """

    period: float = 1.0

    def __post_init__(self) -> None:
        if number("period", self.period) == 0:
            raise ValueError("period must be more than 0")

    def n_genes(self, actuators: int) -> int:
        """For a robot with this many actuators, three a leg.

        Raises:
            ValueError: they are not three a leg.
        """
        if actuators % 3:
            raise ValueError(f"SquareWaves are for legs of three actuators, and the robot has {actuators}")
        return 2 * actuators

    def __call__(self, genotypes: np.ndarray, actuators: int, time: np.ndarray) -> np.ndarray:
        """Controls in [-1, 1], (n, steps, actuators), of genotypes, (n, n_genes), at times in seconds, (steps,)."""
        amplitude, phase, duty = np.moveaxis(genotypes.reshape(len(genotypes), -1, 3), 2, 0)[..., None]  # (n, waves, 1) each
        sample = np.floor(_SAMPLES * time / self.period + 1e-9)  # what is a whole number may be a bit below one
        sample = (sample + np.floor(_SAMPLES * phase)).astype(int) % _SAMPLES
        waves = amplitude * _smoothed()[(_SAMPLES * duty).astype(int), sample]
        first, second = np.moveaxis(waves, 1, 2).reshape(len(waves), len(time), -1, 2).transpose(3, 0, 1, 2)
        return np.stack([first, second, -second], axis=3).reshape(len(waves), len(time), actuators)


_SAMPLES, _HALF_WIDTH, _SIGMA = 100, 10, 3.0  # of a period; of the Gaussian, in samples


@cache
def _smoothed() -> np.ndarray:
    """Square waves that are up for 0, 1, ... 100 samples, smoothed, (101, 100)."""
    up = np.arange(_SAMPLES) < np.arange(_SAMPLES + 1)[:, None]
    shifts = np.arange(-_HALF_WIDTH, _HALF_WIDTH + 1)
    weights = np.exp(-(shifts**2) / (2 * _SIGMA**2))
    around = np.where(up, 1.0, -1.0)[:, (np.arange(_SAMPLES)[:, None] + shifts) % _SAMPLES]
    return np.clip(around @ (weights / weights.sum()), -1, 1)  # or rounding would leave them


@dataclass(frozen=True)
class MLP:
    """A closed-loop controller: a small neural network from what the robot senses to its controls, all layers tanh.

    Genes are the weights and biases, layer by layer, a gene g standing for (2 g - 1) weight. Sensed numbers have any unit and
    often no bounds, so each x enters as x / (scale + abs(x)), which is in (-1, 1) and 1/2 at x = scale.

    Args:
        hidden: neurons of each hidden layer; () for none.
        weight: the largest weight and bias.
        scale: a number, or one for each entry of the observation, in its unit; more than 0.

    Examples:
        >>> import auroraqd
        >>> auroraqd.tasks.MLP(hidden=(8,)).n_genes(4, 2)  # weights of 4 to 8 to 2, and biases
        58
    """

    hidden: Sequence[int] = (16,)
    weight: float = 1.0
    scale: float | Sequence[float] = 1.0

    def __post_init__(self) -> None:
        wholes("hidden", self.hidden, "the neurons of each layer, like (16,)", most=_MOST)
        number("weight", self.weight)
        scale = numbers("scale", self.scale)
        if scale.ndim > 1 or not (np.isfinite(scale) & (scale > 0)).all():
            raise ValueError(f"scale must be more than 0, a number or one for each entry, got {shown(self.scale)}")

    def n_genes(self, observations: int, actuators: int) -> int:
        """For a robot that senses this many numbers, and has this many actuators."""
        return sum((inputs + 1) * outputs for inputs, outputs in self._layers(observations, actuators))

    def policy(self, genotypes: np.ndarray, observations: int, actuators: int) -> Callable[[np.ndarray], np.ndarray]:
        """From what n robots sense, (n, observations), to controls in [-1, 1], (n, actuators).

        Raises:
            ValueError: `scale` has another number of entries than the observation.
        """
        scale = np.asarray(self.scale, np.float64)
        if scale.ndim and len(scale) != observations:
            raise ValueError(f"scale must have {observations} entries, one for each of the observation, got {len(scale)}")
        layers, first = [], 0
        for inputs, outputs in self._layers(observations, actuators):
            genes = genotypes[:, first : first + (inputs + 1) * outputs].reshape(-1, inputs + 1, outputs)
            layers.append(np.ascontiguousarray(self.weight * (2 * genes - 1)))
            first += (inputs + 1) * outputs

        def act(sensed: np.ndarray) -> np.ndarray:
            values = sensed / (scale + np.abs(sensed))
            for layer in layers:
                values = np.tanh((values[:, None] @ layer[:, :-1])[:, 0] + layer[:, -1])
            return values

        return act

    def _layers(self, observations: int, actuators: int) -> list[tuple[int, int]]:
        return list(pairwise((observations, *self.hidden, actuators)))
