"""What is scored: the reference signals, and which part of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.signals import Signal, make_signal
from rdpi_gym.support.arrays import Array

SUITE_VERSION = 2
REFERENCES = ("sine", "triangle", "raster", "steps", "multisine", "nested-loops", "noise")
SINE_HZ = (1.0, 10.0, 25.0, 50.0, 80.0, 100.0, 200.0)
SEEDS = 5
FEWEST_SAMPLES, MOST_SAMPLES = 20, 20_000
"""Samples that a period of the highest frequency has at least, and a whole period at most."""


@dataclass(frozen=True)
class Case:
    """A reference signal and the part of it that is scored.

    Parameters
    ----------
    reference
        Its name in :data:`REFERENCES`.
    frequency_hz
        Sine, triangle: frequency; raster: line rate; steps: levels per second; nested loops: that
        of the major loop; multisine, noise: the highest line (Hz).
    signal
        The signal about 0 µm; it starts smoothly within `start_s`.
    start_s
        Time (s) of the smooth start, which is not scored.
    period_s
        Time (s) after which the signal repeats.
    periods
        Whole periods that are scored.

    Examples
    --------
    >>> case = cases(("sine",), amplitude_um=10.0, base_hz=10.0)[3]
    >>> case.frequency_hz, case.window(1e-3)
    (50.0, (20, 180))
    """

    reference: str
    frequency_hz: float
    signal: Signal
    start_s: float
    period_s: float
    periods: int

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


def cases(references: Sequence[str], amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    """Build the cases of some references.

    Parameters
    ----------
    references
        Names of :data:`REFERENCES`.
    amplitude_um
        Peak (µm).
    base_hz
        What the frequencies of all but the sines are multiples of (Hz).
    """
    holds = 4.0 * base_hz
    fields: dict[str, tuple[float, int, dict[str, float]]] = {
        "triangle": (base_hz, 2, {"frequency_hz": base_hz}),
        "raster": (base_hz, 2, {"frequency_hz": base_hz}),
        "steps": (holds, 1, {"hold_s": 1.0 / holds}),
        "multisine": (5.0 * base_hz, 1, {"frequency_hz": 0.5 * base_hz, "lines": 10}),
        "nested-loops": (base_hz, 1, {"frequency_hz": base_hz}),
        "noise": (5.0 * base_hz, 1, {"high_hz": 5.0 * base_hz, "repeat_s": 3.0 / base_hz}),
    }
    built = []
    for name in references:
        if name == "sine":
            for hz in SINE_HZ:
                periods = min(8, max(1, round(0.2 * hz)))
                built.append(_case(name, hz, 1.0 / hz, periods, amplitude_um, {"frequency_hz": hz}))
        else:
            hz, periods, options = fields[name]
            built.append(_case(name, hz, 1.0 / base_hz, periods, amplitude_um, options))
    return tuple(built)


def _case(
    name: str,
    hz: float,
    start_s: float,
    periods: int,
    amplitude_um: float,
    options: dict[str, float],
) -> Case:
    signal = make_signal(name, amplitude_um=amplitude_um, smooth_start_s=start_s, **options)
    assert signal.period_s is not None
    return Case(name, hz, signal, start_s, signal.period_s, periods)
