"""The loops that compensators close through their own memory, while every play slides.

Then ξ_i = u - r_i - δ2 v (rising), so each compensator is a linear recursion in z, with q = δ2 / Ts,
g = S / a_0, κ = S δ2 / (A Ts) and p the pole of the low-pass on the rate (0 where it is literal).
Sticking plays drop out of S and only lower g and κ.
"""

from __future__ import annotations

import math

import numpy as np

from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

DEFAULT_CUTOFF_HZ = 500.0
"""Low-pass (Hz) on an own rate where that is well within the limit."""
CUTOFF_FRACTION = 0.6
"""Largest part of the limiting cut-off that is used; it leaves a gain margin of 1 / 0.6."""


def spectral_radius(polynomial: Array) -> float:
    """Largest magnitude of a polynomial's roots; 0 where it has none."""
    return float(np.abs(np.roots(polynomial)).max(initial=0.0))


def nyquist_gain(model: Core, ts_s: float) -> float:
    """Gain (µm/V) of the all-sliding plant at z = -1: of RDPI A - 2 (S δ2 / Ts) (1 - p) / (1 + p).

    It is above zero where the sampled plant has minimum phase: its zero is then within the unit
    circle, be it for a long Ts or for a rate that is low-passed below A / (2π S δ2).
    """
    p = model.rate_pole(ts_s)
    return model.A + 2.0 * model.rate_gain_um_s_V / ts_s * (1.0 - p) / (1.0 + p)


def inversion_free_polynomial(model: RDPI, ts_s: float) -> Array:
    """Return the loop of Eq. 6 on its own rate, z² + (g - p - w) z + w - g p with w = g q (1 - p)."""
    p = model.rate_pole(ts_s)
    w = model.g * model.delta2_s / ts_s * (1.0 - p)
    return np.array([1.0, model.g - p - w, w - model.g * p])


def classical_polynomial(model: RDPI, ts_s: float) -> Array:
    """Return the loop of the classical inverse on its own rate, z² - (p + w) z + w, w = κ (1 - p)."""
    p = model.rate_pole(ts_s)
    w = model.S * model.delta2_s / (model.A * ts_s) * (1.0 - p)
    return np.array([1.0, -(p + w), w])


def limiting_cutoff_hz(model: RDPI) -> float:
    """Cut-off A / (2π S δ2) (Hz) below which an own rate may be low-passed as Ts → 0."""
    return model.zero_rad_s / (2.0 * math.pi)


def default_cutoff_hz(model: RDPI) -> float:
    """Low-pass (Hz) of the low-passed compensators: 500, or 0.6 of the limit where that is lower."""
    return min(DEFAULT_CUTOFF_HZ, CUTOFF_FRACTION * limiting_cutoff_hz(model))
