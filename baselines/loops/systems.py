"""Linear systems in samples with one input and one output, and what is made of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from rdpi_gym.support.arrays import Array

Response = NDArray[np.complex128]


@dataclass(frozen=True)
class LinearSystem:
    """x(k+1) = A x(k) + b u(k), y(k) = c x(k) + d u(k).

    Examples
    --------
    >>> integrator = LinearSystem(np.eye(1), np.ones(1), np.ones(1), 0.0)
    >>> (integrator + gain(0.5)).response(np.array([-1.0 + 0j])).tolist()
    [0j]
    """

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


def largest_factor(loops: Sequence[Response], sensitivity: float = 2.0) -> float:
    """Return the largest factor of some open loops at which |1 / (1 + L)| stays within a bound."""
    allowed = 0.0
    for factor in FACTORS.tolist():
        if min(float(np.abs(1.0 + factor * loop).min()) for loop in loops) < 1.0 / sensitivity:
            break
        allowed = factor
    return allowed
