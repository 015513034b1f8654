"""Certificates of a loop before it drives anything: poles, small gain, passivity.

From sample to sample plays turn a change of their input into θ times that change, 0 ≤ θ ≤ 1, so a
hysteresis whose thresholds stand still is, for changes, a gain between a_0 and A that varies in
time; the inverse of another one before it makes that a sector about 1. A linear loop around such a
gain is stable for every course of it where the small-gain theorem holds about the sector's middle
(the circle criterion), and for every gain from 0 up where the loop is passive (Gorbet, Morris, Wang,
IEEE Trans. Control Syst. Technol. 9, 2001). Poles tell of a gain that stays. Thresholds that move with
the rate are looked at as all sliding; no theorem covers what lies between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.loops.systems import LinearSystem, Response, gain
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

SMALLEST_DAMPING = 0.02
"""Damping ratio of the mode that a belief without one is asked about: of bare stages."""


@dataclass(frozen=True)
class Certificate:
    """Stability of a loop, and for which hysteresis it is certain.

    Parameters
    ----------
    radius
        Largest magnitude of a closed-loop pole, over the gains that stay; stable below 1 (what
        Jury's test decides).
    sector
        Lowest and highest gain of the hysteresis, over that which the loop was designed for.
    share
        Part of that sector, in its logarithm, for which the small-gain theorem holds: 1 for all.
    passive
        Whether the loop is passive: stable for every hysteresis of any slope from 0 to the sector's
        highest.

    Examples
    --------
    >>> print(Certificate(0.9, (0.5, 2.0), 0.5, False).line())
    small gain in part: stable for any course of a hysteresis of 0.707 to 1.41 times the believed gain, of 0.5 to 2 that it may have; poles within 0.9
    """

    radius: float
    sector: tuple[float, float]
    share: float
    passive: bool

    @property
    def stable(self) -> bool:
        """Whether the poles are within the unit circle."""
        return self.radius < 1.0

    @property
    def whole(self) -> bool:
        """Whether the small-gain theorem or passivity covers all of the hysteresis."""
        return self.stable and (self.passive or self.share >= 1.0)

    def line(self) -> str | None:
        """Return what is certain in one line; None where nothing is."""
        if not self.stable:
            return None
        (low, high), poles = self.sector, f"poles within {self.radius:.6g}"
        if self.passive:
            return f"passive: stable for any hysteresis of at most {high:.3g} times the believed gain; {poles}"
        if self.share >= 1.0:
            return f"small gain: stable for any course of a hysteresis of {low:.3g} to {high:.3g} times the believed gain; {poles}"
        if self.share > 0.0:
            return (
                f"small gain in part: stable for any course of a hysteresis of {low**self.share:.3g} to "
                f"{high**self.share:.3g} times the believed gain, of {low:.3g} to {high:.3g} that it may have; {poles}"
            )
        return f"eigenvalues alone: {poles}"


def certify(
    loops: Sequence[LinearSystem],
    z: Response,
    sector: tuple[float, float],
    steady: Sequence[float] = (1.0,),
) -> Certificate:
    """Look at open loops of the gain that they were designed for."""
    low, high = sector
    radius = max((gain(g) * loop).closed().radius for loop in loops for g in steady)
    responses = [loop.response(z) for loop in loops]
    passive = all(bool((1.0 + high * response.real > 0.0).all()) for response in responses)
    share = 0.0
    if radius < 1.0:
        for part in np.linspace(0.0, 1.0, 41)[1:].tolist():
            centre, half = 0.5 * (high**part + low**part), 0.5 * (high**part - low**part)
            if any(np.abs(half * r / (1.0 + centre * r)).max() >= 1.0 for r in responses):
                break
            if any((gain(centre) * loop).closed().radius >= 1.0 for loop in loops):
                break
            share = part
    return Certificate(radius, sector, share, passive)


def harmful_mode_hz(loop: Response, angles: Array, ts_s: float) -> float:
    """Return the frequency (Hz) below which a mode that nobody knows of makes a loop unstable.

    Its peak is 1 / (2 ζ), ζ of :data:`SMALLEST_DAMPING`: where |L| is above 2 ζ, it lifts the loop
    above 1 at a phase that turns by 180 degrees.
    """
    harmful = np.abs(loop) > 2.0 * SMALLEST_DAMPING
    return float(angles[harmful].max(initial=0.0) / (2.0 * np.pi * ts_s))


def loop_warning(
    certified: Certificate, harmful_hz: float | None, belief: PlantModel, ts_s: float
) -> str | None:
    """Say in one line what is wrong with a loop before it drives anything."""
    if not certified.stable:
        return (
            f"outside its stability limit: pole magnitude {certified.radius:.3g} at Ts = {ts_s:g} s "
            f"with belief {belief.name}"
        )
    if harmful_hz:
        return f"belief {belief.name} has no mode, and one below {harmful_hz:.3g} Hz (damping {SMALLEST_DAMPING:g}) makes the loop unstable"
    if certified.line() is None:
        return "no certificate of stability"
    return None
