"""Monitors of a loop: whether its error rings, and whether it goes further than the loops of a training did."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.base import Observation
from rdpi_gym.envs.layout import DEFAULT_FIELDS, ObservationLayout
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

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


QUANTITIES = ("reference_step", "error", "measured_step", "command_step")
"""Reference, measured displacement and command change by so much from sample to sample, and the error
that is seen: in units of the layout's amplitude, commands of half their range."""
AVERAGED_S = 5e-3
"""Time constant (s) over which their squares are averaged."""
MARGIN = 3.0
"""Times the largest average of the training from which on a loop has left what was trained on."""


class Watch:
    """Root mean squares over the last 5 ms of what an observation tells of a loop.

    A policy knows what its training showed it. How fast the reference moves, how fast stage and
    command answer and how large the error is tells a loop from it before anything rings or ends at a
    limit: a student of a stage with damped modes leaves six to ten times its errors on one that has
    a mode of its own. Its memory: mean squares; reference, measured displacement and command before.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, ts_s=1e-4, preview=1)
    >>> watch = Watch(layout)
    >>> memory = watch.start(1)
    >>> for measured in (0.0, 0.1, 0.1):
    ...     found = watch.take(memory, np.array([[0.1, 0.1, measured, 0.5]]))
    >>> dict(zip(QUANTITIES, found[:, 0].round(4).tolist()))
    {'reference_step': 0.0, 'error': 0.0138, 'measured_step': 0.0139, 'command_step': 0.0}
    """

    rows = len(QUANTITIES) + 3

    def __init__(self, layout: ObservationLayout) -> None:
        self._forgets = 1.0 - math.exp(-layout.ts_s / AVERAGED_S)
        self._columns = [layout.columns[name].start for name in DEFAULT_FIELDS]

    def start(self, lanes: int) -> Array:
        """Return the memory of loops that begin, float64[rows, B]."""
        memory = np.zeros((self.rows, lanes))
        memory[len(QUANTITIES) :] = np.nan
        return memory

    def take(self, memory: Array, observation: Observation) -> Array:
        """Take one sample in, and return the averages."""
        means, before = memory[: len(QUANTITIES)], memory[len(QUANTITIES) :]
        now = np.asarray(observation, dtype=np.float64)[:, self._columns].T
        steps = np.nan_to_num(now - before)
        quantities = np.stack([steps[0], now[0] - now[1], steps[1], steps[2]])
        means += self._forgets * (quantities**2 - means)
        before[:] = now
        return np.asarray(np.sqrt(means))


class EnvelopeRecorder:
    """The largest averages over all loops of an evaluation."""

    def __init__(self, layout: ObservationLayout) -> None:
        self._watch = Watch(layout)
        self._memory: Array | None = None
        self._most = np.zeros(len(QUANTITIES))

    def take(self, observation: Observation) -> None:
        """Take one sample of all loops in, ``(B, D)``."""
        if self._memory is None:
            self._memory = self._watch.start(len(observation))
        found = self._watch.take(self._memory, observation).max(axis=1)
        self._most = np.maximum(self._most, found)

    @property
    def largest(self) -> dict[str, float]:
        """So far, rounded to four digits."""
        return {name: float(f"{x:.4g}") for name, x in zip(QUANTITIES, self._most, strict=True)}


def checked_envelope(document: Any) -> dict[str, float]:
    """Return what a description says was seen; empty where it is of before this was kept."""
    if document is None:
        return {}
    if (
        not isinstance(document, Mapping)
        or sorted(document) != sorted(QUANTITIES)
        or not all(is_finite(x) and x > 0 for x in document.values())
    ):
        raise InputError(
            f"seen is {quoted(document)}; give numbers above 0 for {', '.join(QUANTITIES)}"
        )
    return {name: float(document[name]) for name in QUANTITIES}
