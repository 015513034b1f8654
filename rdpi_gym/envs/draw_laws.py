"""Laws of an episode beyond numbers about one nominal plant: kinds, wear, changes on the way, noise, converter.

Each law is data, so that the single environment and the kernels of many lanes read the same one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

BLOCK = 25
"""Samples between two changes: what glides does so in steps, all lanes at once."""
NOISE_BLOCK = 1024
"""Samples of noise drawn at a time: one call of a generator costs as much as a hundred numbers."""
MAINS_HZ = 50.0
"""Frequency (Hz) of the mains."""

Ageing: TypeAlias = Callable[[PlantModel, float], PlantModel]
"""``law(model, share)``: a plant that has lived a share, 0 to 1, of its life."""
Schedule: TypeAlias = Callable[[PlantModel, np.random.Generator], Mapping[int, PlantModel]]
"""``law(model, rng)``: what a plant becomes in an episode, by the sample at which it does."""


@dataclass(frozen=True)
class NoiseLaw:
    """Noise of a sensor, in units of the standard deviation that its plant states.

    White noise; white noise through a first-order low-pass of a corner (Hz); and the amplitude of
    the mains at 50 Hz, its phase drawn for each episode.
    """

    white: float = 1.0
    wander: float = 0.0
    corner_hz: float = 5.0
    hum: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the whole."""
        return math.sqrt(self.white**2 + self.wander**2 + 0.5 * self.hum**2)


class ColouredNoise:
    """Noise that remembers: a :class:`~rdpi_gym.envs.tracking.NoiseSource`."""

    def __init__(self, law: NoiseLaw, ts_s: float, rng: np.random.Generator) -> None:
        self._law, self._ts_s, self._rng = law, ts_s, rng
        self._phase = rng.uniform(0.0, 2.0 * math.pi)
        self._wander = np.array([rng.standard_normal()])
        self._count = 0

    def standard_normal(self, size: int, /) -> Array:
        """Return the next numbers, ``float64[size]``."""
        from scipy.signal import lfilter  # which takes longer to import than all environments

        law, rng = self._law, self._rng
        white, driven = rng.standard_normal(size), rng.standard_normal(size)
        pole = math.exp(-2.0 * math.pi * law.corner_hz * self._ts_s)
        gain = math.sqrt(1.0 - pole**2)
        wander, last = lfilter([gain], [1.0, -pole], driven, zi=pole * self._wander)
        self._wander = last / pole if pole else last
        time = self._ts_s * np.arange(self._count, self._count + size)
        self._count += size
        hum = law.hum * np.sin(2.0 * math.pi * MAINS_HZ * time + self._phase)
        return np.asarray(law.white * white + law.wander * wander + hum)


@dataclass(frozen=True)
class Wear:
    """Ageing of a plant: relative changes at the end of its life, in proportion to the share lived.

    Parameters
    ----------
    gains, gaps
        Of the core's gains and of the gaps between its thresholds.
    effects
        Of one parameter of an effect: name of the effect, name of the parameter and change.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> worn = Wear(gains=-0.1)(named_plant("P5"), 0.5)
    >>> round(worn.hysteresis.a0 / named_plant("P5").hysteresis.a0, 9)
    0.95
    """

    gains: float = 0.0
    gaps: float = 0.0
    effects: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    def factors(self, core: Core, shares: Array) -> Array:
        """Return the factors ``(m, K)`` of a core's numbers after shares ``(m,)`` of its life."""
        factors = np.ones((len(shares), core.factors))
        gains, gaps = len(core.gains), len(core.gaps_V)
        factors[:, :gains] += self.gains * shares[:, None]
        factors[:, gains : gains + gaps] += self.gaps * shares[:, None]
        return factors

    def __call__(self, model: PlantModel, share: float) -> PlantModel:
        """Return the plant after a share, 0 to 1, of its life."""
        core = model.hysteresis
        old = model.with_hysteresis(core.scaled(self.factors(core, np.array([share]))[0]))
        for effect in model.effects:
            if effect.name in self.effects:
                name, change = self.effects[effect.name]
                values = {**effect.values, name: effect.values[name] * (1.0 + change * share)}
                old = with_effect(old, type(effect).within_bounds(**values))
        return old


@dataclass(frozen=True)
class Glide:
    """Change within an episode: a parameter of an effect glides to a fraction of its value.

    Parameters
    ----------
    effect, parameter
        Name of the effect, and of its parameter.
    first, spread
        First sample at which it may begin, and the number of samples over which the beginning is
        drawn, in steps of :data:`BLOCK`.
    low, high
        Bounds of the fraction, drawn uniformly.
    lowest
        Value that it never falls below, unless it began there.
    samples
        Duration; the parameter goes evenly in its logarithm, step by step of :data:`BLOCK`.
    """

    effect: str
    parameter: str
    first: int
    spread: int
    low: float
    high: float
    lowest: float
    samples: int

    def __post_init__(self) -> None:
        if not (self.first >= 1 and self.spread >= BLOCK and self.samples >= BLOCK):
            raise InputError(
                f"a change from sample {self.first} on, spread over {self.spread} samples, in "
                f"{self.samples}; give a first sample of 1 or more, and {BLOCK} or more of the others"
            )

    @property
    def steps(self) -> int:
        """Number of changes."""
        return self.samples // BLOCK

    def __call__(self, model: PlantModel, rng: np.random.Generator) -> Mapping[int, PlantModel]:
        """Return the later plants by the sample at which each begins."""
        (effect,) = (each for each in model.effects if each.name == self.effect)
        value = effect.values[self.parameter]
        begin = self.first + BLOCK * int(rng.integers(self.spread // BLOCK))
        last = max(value * float(rng.uniform(self.low, self.high)), min(self.lowest, value))
        return {
            begin + i * BLOCK: with_effect(
                model,
                replace(
                    effect, **{self.parameter: value * (last / value) ** ((i + 1) / self.steps)}
                ),
            )
            for i in range(self.steps)
        }


def with_effect(model: PlantModel, changed: Effect) -> PlantModel:
    """Return the plant with another effect in the place of its namesake."""
    effects = (changed if e.name == changed.name else e for e in model.effects)
    return replace(model, effects=tuple(effects))


@dataclass(frozen=True)
class DrawLaw:
    """Draws of an episode beyond factors and levels about its nominal plant.

    Parameters
    ----------
    nominals
        Nominal plants, one of which is drawn.
    noise
        Of the sensor; None: white.
    command_step_V
        Smallest step (V) of the command's converter; 0: none.
    ageing, schedule
        As :class:`Wear` and :class:`Glide`, or None.
    """

    nominals: tuple[PlantModel, ...]
    noise: NoiseLaw | None = None
    command_step_V: float = 0.0
    ageing: Ageing | None = None
    schedule: Schedule | None = None

    @property
    def draws(self) -> bool:
        """Whether plants differ even where no number is randomised."""
        return len(self.nominals) > 1 or self.ageing is not None or self.schedule is not None

    def kind_of(self, model: PlantModel) -> int:
        """Return the number of the first nominal plant with the core of a model; 0 where none has it."""
        names = [nominal.hysteresis.name for nominal in self.nominals]
        name = model.hysteresis.name
        return names.index(name) if name in names else 0
