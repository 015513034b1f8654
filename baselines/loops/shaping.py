"""How far a loop may be turned up: the largest gain that leaves a margin on every plant given."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from baselines.loops.systems import LinearSystem, Response, gain, integrator, sampled

FACTORS = np.geomspace(1e-5, 10.0, 241)
"""Gains that are tried, in units of one in a sample."""


def integral_shape(settings: Mapping[str, float], ts_s: float) -> LinearSystem:
    """Return (1 / s + t_p) (1 + ω_2 / s) / (τ s + 1): integral, proportional, again integral."""
    shape = integrator(ts_s) + gain(settings["proportional_s"])
    if settings["second_integral_hz"]:
        again = integrator(ts_s).times(2.0 * math.pi * settings["second_integral_hz"])
        shape = (gain(1.0) + again) * shape
    lag_s = 1.0 / (2.0 * math.pi * settings["lowpass_hz"])
    return sampled([1.0], [lag_s, 1.0], ts_s) * shape


def largest_factor(loops: Sequence[Response], sensitivity: float = 2.0) -> float:
    """Return the largest factor of some open loops at which |1 / (1 + L)| stays within a bound."""
    allowed = 0.0
    for factor in FACTORS.tolist():
        if min(float(np.abs(1.0 + factor * loop).min()) for loop in loops) < 1.0 / sensitivity:
            break
        allowed = factor
    return allowed
