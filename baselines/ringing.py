"""The monitor that an adaptive controller runs: whether its error rings, and grows."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.support.arrays import Array

BAND_HZ = 250.0
"""Upper end of the band (Hz) that references are expected in; what the error has above it rings."""
FAST_S, SLOW_S = 4e-3, 4e-2
"""Time constants (s) of the energies that are compared: a few periods of a mode, and ten times that."""
WITHDRAW_S, RETURN_S = 2e-3, 5e-2
"""Time constants (s) with which a correction is withdrawn and given back."""
SMALL, LARGE = 0.05, 0.2
"""Error above the band, as shares of the scale: below the first nothing rings; above the second it
rings whether it grows or not."""
GROWTH = 2.0
"""Ratio of the fast to the slow energy from which it grows."""


class RingingMonitor:
    """Trust in a correction, 0 to 1, by the error above the reference's band.

    Error and reference pass a second-order high-pass; their energies are averaged over 4 ms. It
    rings where the error's energy is above that of the reference there, above 5 % of the scale, and
    grows or is above 20 %. While it rings the trust decays, 2 ms; else it comes back, 50 ms.

    Examples
    --------
    An error at 350 Hz that doubles within 5 ms costs the trust:

    >>> monitor = RingingMonitor(200.0, 40.0, 1e-4)
    >>> memory = monitor.start(np.zeros(1))
    >>> for k in range(400):
    ...     error = 0.2 * 2.0 ** (k / 50) * np.sin(2 * np.pi * 350.0 * 1e-4 * k)
    ...     trust, ringing = monitor.watch(memory, np.array([error]), np.zeros(1))
    >>> bool(ringing[0]), bool(trust[0] < 0.1)
    (True, True)
    """

    rows = 8  # of its memory

    def __init__(
        self,
        band_hz: float,  # upper end of the reference's band (Hz)
        scale_um: float,  # unit of displacements (µm)
        ts_s: float,  # sampling time (s)
    ) -> None:
        # shares of a sample that enter the high-pass, the fast and the slow energy; the part of the
        # trust that stays, and of the rest that returns; energies (µm²) of small and of large
        self.numbers = (
            1.0 - math.exp(-2.0 * math.pi * band_hz * ts_s),
            1.0 - math.exp(-ts_s / FAST_S),
            1.0 - math.exp(-ts_s / SLOW_S),
            math.exp(-ts_s / WITHDRAW_S),
            1.0 - math.exp(-ts_s / RETURN_S),
            (SMALL * scale_um) ** 2,
            (LARGE * scale_um) ** 2,
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest at references (µm) ``(B,)``: full trust, float64[rows, B]."""
        memory = np.zeros((self.rows, len(reference_um)))
        memory[2] = reference_um
        memory[-1] = 1.0
        return memory

    def watch(
        self, memory: Array, error_um: Array, reference_um: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Take one sample in."""
        ringing: NDArray[np.bool_] = _watch(memory, error_um, reference_um, *self.numbers)
        return memory[7], ringing


@njit(cache=True)
def _watch(
    memory: Array,
    error_um: Array,
    reference_um: Array,
    passes: float,
    fast: float,
    slow: float,
    withdraw: float,
    returns: float,
    small: float,
    large: float,
) -> NDArray[np.bool_]:
    """Move all lanes on by one sample, and return where it rings."""
    lanes = memory.shape[1]
    ringing = np.empty(lanes, dtype=np.bool_)
    for lane in range(lanes):
        of = memory[:, lane]
        error, asked = error_um[lane], reference_um[lane]
        for stage in range(2):
            of[stage] += passes * (error - of[stage])
            error -= of[stage]
            of[2 + stage] += passes * (asked - of[2 + stage])
            asked -= of[2 + stage]
        squared = error * error
        of[4] += fast * (squared - of[4])
        of[5] += slow * (squared - of[5])
        of[6] += fast * (asked * asked - of[6])
        grows = of[4] > GROWTH * of[5] or of[4] > large
        ringing[lane] = of[4] > small and of[4] > of[6] and grows
        of[7] = withdraw * of[7] if ringing[lane] else of[7] + returns * (1.0 - of[7])
    return ringing
