"""The monitor that an adaptive controller runs: whether its error rings, and grows."""

from __future__ import annotations

import math

import numpy as np
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
    """How much of a correction is trusted, 0 to 1, by the error above the reference's band.

    Error and reference pass a second-order high-pass; their energies are averaged over 4 ms. It
    rings where the error's energy is above that of the reference there, above 5 % of the scale, and
    grows or is above 20 %. While it rings the trust decays, 2 ms; else it comes back, 50 ms.

    Parameters
    ----------
    band_hz
        Upper end of the reference's band (Hz).
    scale_um
        Unit of displacements (µm).
    ts_s
        Sampling time (s).

    Attributes
    ----------
    rows : int
        Rows of its memory.

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

    rows = 8

    def __init__(self, band_hz: float, scale_um: float, ts_s: float) -> None:
        self._pass = 1.0 - math.exp(-2.0 * math.pi * band_hz * ts_s)
        self._fast = 1.0 - math.exp(-ts_s / FAST_S)
        self._slow = 1.0 - math.exp(-ts_s / SLOW_S)
        self._withdraw = math.exp(-ts_s / WITHDRAW_S)
        self._return = 1.0 - math.exp(-ts_s / RETURN_S)
        self._small, self._large = (SMALL * scale_um) ** 2, (LARGE * scale_um) ** 2

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest at references (µm) ``(B,)``: full trust, float64[rows, B]."""
        memory = np.zeros((self.rows, len(reference_um)))
        memory[2] = reference_um
        memory[-1] = 1.0
        return memory

    def watch(
        self, memory: Array, error_um: Array, reference_um: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Take one sample in.

        Parameters
        ----------
        memory
            ``float64[rows, B]``, moved on in place.
        error_um, reference_um
            ``(B,)``.

        Returns
        -------
        trust : float64[B]
            A view of the memory.
        ringing : bool[B]
        """
        error = self._above(memory[0:2], error_um)
        asked = self._above(memory[2:4], reference_um)
        energy, slow, driven = memory[4], memory[5], memory[6]
        squared = np.square(error)
        energy += self._fast * (squared - energy)
        slow += self._slow * (squared - slow)
        driven += self._fast * (np.square(asked) - driven)
        grows = (energy > GROWTH * slow) | (energy > self._large)
        ringing = (energy > self._small) & (energy > driven) & grows
        trust = memory[7]
        trust[:] = np.where(ringing, self._withdraw * trust, trust + self._return * (1.0 - trust))
        return trust, ringing

    def _above(self, low: Array, signal: Array) -> Array:
        """Part of a signal above the band; the two low-passes are moved on."""
        for state in low:
            state += self._pass * (signal - state)
            signal = signal - state
        return signal
