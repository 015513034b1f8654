"""Changes within an episode: a plant with a load and a coarse converter, and coloured sensor noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array

BLOCK = 25
"""Samples between two changes: what glides does so in steps, all lanes at once."""


class ChangingPlant(Plant):
    """Plants that become others at certain samples, behind a converter of finite resolution.

    `later` says for each lane what it becomes, by the sample of the episode. Displacements and
    velocities go on where a mode moves, see :meth:`Plant.retune`. `command_step_V` is the smallest
    step (V) of the converter; 0: none.
    """

    def __init__(
        self,
        models: Sequence[PlantModel],
        ts_s: float,
        later: Sequence[Mapping[int, PlantModel]],
        command_step_V: float = 0.0,
    ) -> None:
        self._first, self._later = tuple(models), tuple(later)
        self._turns = frozenset(sample for each in later for sample in each)
        self._step_V, self._sample = command_step_V, 0
        self._is_as_begun = True
        super().__init__(models, ts_s)

    def reset(self, *args: object, **options: object) -> None:
        """Begin an episode, as the plants that were there at first; see :meth:`Plant.reset`."""
        if not self._is_as_begun:
            self.retune(self._first)
        self._sample, self._is_as_begun = 0, True
        super().reset(*args, **options)  # type: ignore[arg-type]  # handed on as they came

    def step(self, u_V: Array) -> Array:
        """Advance one sample; see :meth:`Plant.step`."""
        if self._sample in self._turns:
            pairs = zip(self.models, self._later, strict=True)
            self.retune([later.get(self._sample, model) for model, later in pairs])
            self._is_as_begun = False
        self._sample += 1
        if self._step_V:
            u_V = np.rint(u_V / self._step_V) * self._step_V
        return super().step(u_V)


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
        law, rng = self._law, self._rng
        white, driven = rng.standard_normal(size), rng.standard_normal(size)
        pole = math.exp(-2.0 * math.pi * law.corner_hz * self._ts_s)
        gain = math.sqrt(1.0 - pole**2)
        wander, last = lfilter([gain], [1.0, -pole], driven, zi=pole * self._wander)
        self._wander = last / pole if pole else last
        time = self._ts_s * np.arange(self._count, self._count + size)
        self._count += size
        hum = law.hum * np.sin(2.0 * math.pi * 50.0 * time + self._phase)
        return np.asarray(law.white * white + law.wander * wander + hum)
