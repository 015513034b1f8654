"""A case: a reference signal, and which part of it is scored."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from rdpi_gym.signals import Signal
from rdpi_gym.support.arrays import Array

FEWEST_SAMPLES, MOST_SAMPLES = 20, 20_000
"""Samples that a period of the highest frequency has at least, and a whole period at most."""


@dataclass(frozen=True)
class Case:
    """A reference signal and the part of it that is scored."""

    reference: str  # name in :data:`benchmarks.tracking.stages.REFERENCES`
    # sine, triangle: frequency; raster: line rate; steps: levels per second; nested loops: that of
    # the major loop; multisine, noise: the highest line (Hz)
    frequency_hz: float
    signal: Signal  # about 0 µm; it starts smoothly within `start_s`
    start_s: float  # time of the smooth start, which is not scored
    period_s: float  # time after which the signal repeats
    periods: int  # whole periods that are scored

    @classmethod
    def smooth(cls, signal: Signal, frequency_hz: float, start_s: float, periods: int) -> Case:
        """Let a signal of finite period start smoothly, and score whole periods of it after that."""
        smooth = replace(signal, smooth_start_s=start_s)
        assert smooth.period_s is not None
        return cls(signal.name, frequency_hz, smooth, start_s, smooth.period_s, periods)

    @property
    def name(self) -> str:
        """Reference and frequency: what tables call it."""
        return f"{self.reference} {self.frequency_hz:g} Hz"

    def fits(self, ts_s: float) -> bool:
        """Whether Ts (s) resolves the reference and a period is not needlessly long."""
        resolved = 1.0 / (self.frequency_hz * ts_s) >= FEWEST_SAMPLES * (1 - 1e-9)
        return resolved and self.period_s / ts_s <= MOST_SAMPLES * (1 + 1e-9)

    def window(self, ts_s: float) -> tuple[int, int]:
        """First scored sample and number of samples in all, at sampling time `ts_s` (s)."""
        first = math.ceil(self.start_s / ts_s - 1e-9)
        return first, first + round(self.periods * self.period_s / ts_s)

    def samples(self, ts_s: float, centre_um: float, rest_um: float, seed: int) -> Array:
        """Return the reference (µm), (K,), from the plant's displacement at rest (µm)."""
        signal = replace(self.signal, offset_um=centre_um - rest_um).with_seed(seed)
        return rest_um + signal(ts_s * np.arange(self.window(ts_s)[1]))


CaseMaker: TypeAlias = Callable[[float, float], tuple[Case, ...]]
"""Makes the cases of a reference from its peak (µm) and the plant's base frequency (Hz)."""
References: TypeAlias = Mapping[str, CaseMaker]
"""Content of ``REFERENCES`` in a file of the folder ``references``."""
