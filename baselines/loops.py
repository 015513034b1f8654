"""Linear loops in samples: systems, the path that a belief has, and certificates of stability."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array

Response = NDArray[np.complex128]


@dataclass(frozen=True)
class LinearSystem:
    """x(k+1) = A x(k) + b u(k), y(k) = c x(k) + d u(k)."""

    a: Array  # (n, n)
    b: Array  # (n,)
    c: Array  # (n,)
    d: float  # the part of the input that the output has at once

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.b)

    @property
    def radius(self) -> float:
        """Largest magnitude of a pole; 0 without states."""
        return float(np.abs(np.linalg.eigvals(self.a)).max(initial=0.0)) if self.order else 0.0

    def __mul__(self, other: LinearSystem) -> LinearSystem:
        """Run one behind the other, the right one first."""
        a = np.block(
            [[other.a, np.zeros((other.order, self.order))], [np.outer(self.b, other.c), self.a]]
        )
        b = np.concatenate([other.b, self.b * other.d])
        return LinearSystem(a, b, np.concatenate([self.d * other.c, self.c]), self.d * other.d)

    def __add__(self, other: LinearSystem) -> LinearSystem:
        """Run both side by side."""
        a = np.block(
            [
                [self.a, np.zeros((self.order, other.order))],
                [np.zeros((other.order, self.order)), other.a],
            ]
        )
        joined = np.concatenate([self.b, other.b]), np.concatenate([self.c, other.c])
        return LinearSystem(a, *joined, self.d + other.d)

    def times(self, factor: float) -> LinearSystem:
        """Return the system with its output multiplied."""
        return LinearSystem(self.a, self.b, factor * self.c, factor * self.d)

    def closed(self) -> LinearSystem:
        """Return 1 / (1 + L): what negative feedback leaves of what comes in."""
        left = 1.0 / (1.0 + self.d)
        a = self.a - left * np.outer(self.b, self.c)
        return LinearSystem(a, left * self.b, -left * self.c, left)

    def around(self, other: LinearSystem) -> LinearSystem:
        """Return P / (1 + P Q): this system with another in its negative feedback, no state twice."""
        left = 1.0 / (1.0 + self.d * other.d)
        own, back = left * self.c, -left * self.d * other.c
        through = left * self.d
        fed = 1.0 - other.d * through
        a = np.block(
            [
                [
                    self.a - np.outer(self.b, other.d * own),
                    -np.outer(self.b, other.c + other.d * back),
                ],
                [np.outer(other.b, own), other.a + np.outer(other.b, back)],
            ]
        )
        b = np.concatenate([fed * self.b, through * other.b])
        return LinearSystem(a, b, np.concatenate([own, back]), through)

    def response(self, z: Response) -> Response:
        """Return the frequency response at points z, ``complex128[F]``."""
        if not self.order:
            return np.full(z.shape, self.d, dtype=np.complex128)
        shifted = z[:, None, None] * np.eye(self.order) - self.a
        states = np.linalg.solve(shifted, np.broadcast_to(self.b[:, None], (len(z), self.order, 1)))
        return np.asarray(states[..., 0] @ self.c + self.d, dtype=np.complex128)


def gain(factor: float) -> LinearSystem:
    """Return a gain without memory."""
    return LinearSystem(np.zeros((0, 0)), np.zeros(0), np.zeros(0), factor)


def weighted(weights: Sequence[float]) -> LinearSystem:
    """Return the weighted sum of the newest inputs, the newest first."""
    n = len(weights) - 1
    b = np.eye(n, 1)[:, 0] if n else np.zeros(0)
    return LinearSystem(np.eye(n, k=-1), b, np.array(weights[1:], dtype=float), float(weights[0]))


def unit_delay() -> LinearSystem:
    """Return a delay by one sample."""
    return weighted([0.0, 1.0])


def integrator(ts_s: float) -> LinearSystem:
    """Return Ts / (1 - 1/z): what has come in up to now, over time."""
    return LinearSystem(np.eye(1), np.ones(1), np.full(1, ts_s), ts_s)


def sampled(
    numerator: Sequence[float], denominator: Sequence[float], ts_s: float, at_rad_s: float = 0.0
) -> LinearSystem:
    """Sample a filter in s by Tustin's rule."""
    from scipy import signal

    half = 0.5 * at_rad_s * ts_s
    step = ts_s * math.tan(half) / half if 0.0 < half < 1.5 else ts_s
    a, b, c, d = signal.tf2ss(numerator, denominator)
    a, b, c, d, _ = signal.cont2discrete((a, b, c, d), step, "bilinear")
    return LinearSystem(a, b[:, 0], c[0], float(d[0, 0]))


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


def largest_factor(loops: Sequence[Response], factors: Array = FACTORS) -> float:
    """Return the largest factor of open loops with |1 / (1 + L)| of at most 2: phase margin 29°."""
    allowed = 0.0
    for factor in factors.tolist():
        if min(float(np.abs(1.0 + factor * loop).min()) for loop in loops) < 0.5:
            break
        allowed = factor
    return allowed


@dataclass(frozen=True)
class Mode:
    """The slowest lightly damped mode of a belief."""

    f0_hz: float  # undamped natural frequency (Hz)
    damping: float  # damping ratio ζ

    @property
    def omega0_rad_s(self) -> float:
        """2π f0 (rad/s)."""
        return 2.0 * math.pi * self.f0_hz


@dataclass(frozen=True)
class BeliefPath:
    """The linear part of a belief at a sampling time."""

    dynamics: LinearSystem  # lags, modes and delay in a row, gain 1 at rest
    # The inverted hysteresis for small changes while all plays slide and thresholds move with the
    # rate, over its gain A: 1 where they do not.
    sliding: LinearSystem
    mode: Mode | None  # the slowest one, None where the belief has none
    delay_s: float  # of slow signals (s)

    @property
    def extremes(self) -> tuple[LinearSystem, LinearSystem]:
        """The path with all plays sticking and with all sliding; others lie between."""
        return self.dynamics, self.dynamics * self.sliding


def belief_path(belief: PlantModel, ts_s: float) -> BeliefPath:
    """Return what a belief says of the path; effects that are not linear, and creep, are left out."""
    linear = [e for e in belief.effects if is_linear(e)]
    dynamics = linear_part(linear, belief.hysteresis, ts_s)
    # the response turns by ω times the delay where ω is small
    slow = np.exp(1j * np.array([1e-4]))
    turned = -float(np.angle(dynamics.response(slow))[0]) / 1e-4
    modes = [
        Mode(effect.values[f0], effect.values[damping])
        for effect in linear
        for f0, damping in (("f0_hz", "damping"), ("second_hz", "second_damping"))
        if f0 in effect.values
    ]
    mode = min(modes, key=lambda each: each.f0_hz, default=None)
    return BeliefPath(dynamics, sliding_system(belief.hysteresis, ts_s), mode, turned * ts_s)


def is_linear(effect: Effect) -> bool:
    """Whether an effect is a linear system of few states, or a delay."""
    return type(effect).block in (delay_block, linear_block)


def linear_part(effects: Sequence[Effect], core: Core, ts_s: float) -> LinearSystem:
    """Return the linear ones of effects in a row, as a system."""
    system = gain(1.0)
    for effect in filter(is_linear, effects):
        system = effect_system(effect, core, ts_s) * system
    return system


def effect_system(effect: Effect, core: Core, ts_s: float) -> LinearSystem:
    """Return a linear effect, or a delay, as a system."""
    column = np.array(effect.coefficients(ts_s, core))
    if type(effect).block is delay_block:
        whole, part = int(column[0]), float(column[1])
        return weighted([*([0.0] * whole), 1.0 - part, *([part] if part else [])])
    m = round(math.sqrt(len(column) + 3.0)) - 2
    f = column[: m * m].reshape(m, m)
    g0, g1, c = (column[m * m + k * m : m * m + (k + 1) * m] for k in range(3))
    # x(k+1) = F x + G0 u(k) + G1 u(k+1) with the state x - G1 u
    return LinearSystem(f, f @ g1 + g0, c, float(c @ g1 + column[m * m + 3 * m]))


def sliding_system(core: Core, ts_s: float) -> LinearSystem:
    """Return all plays sliding over A: 1 - κ (1 - z⁻¹) (1 - p) / (1 - p z⁻¹)."""
    p = core.rate_pole(ts_s)
    lead = core.rate_gain_um_s_V / (ts_s * core.A) * (1.0 - p)
    return LinearSystem(np.array([[p]]), np.ones(1), np.array([lead * (p - 1.0)]), 1.0 + lead)


def grid(path: BeliefPath, ts_s: float, points: int = 600) -> tuple[Array, Response]:
    """Return angles (rad a sample) up to half the sampling frequency, close about the mode, and z."""
    angles = np.geomspace(1e-5, math.pi, points)
    if path.mode is not None:
        width = 1.0 + path.mode.damping * np.linspace(-20.0, 20.0, 201)
        angles = np.concatenate([angles, path.mode.omega0_rad_s * ts_s * width])
    angles = np.sort(angles[(angles > 0.0) & (angles <= math.pi)])
    return angles, np.exp(1j * angles)


SMALLEST_DAMPING = 0.02
"""Damping ratio of the mode that a belief without one is asked about: of bare stages."""


@dataclass(frozen=True)
class Certificate:
    """Stability of a loop, and for which hysteresis it is certain.

    Examples
    --------
    >>> print(Certificate(0.9, (0.5, 2.0), 0.5, False).line())
    small gain in part: stable for any course of a hysteresis of 0.707 to 1.41 times the believed gain, of 0.5 to 2 that it may have; poles within 0.9
    """

    radius: float  # largest magnitude of a closed-loop pole, over the gains that stay (Jury's test)
    sector: tuple[float, float]  # gains of the hysteresis, over that of the design
    share: float  # of the sector, in its logarithm, for which the small-gain theorem holds
    passive: bool  # stable for every hysteresis of any slope from 0 to the sector's highest

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
