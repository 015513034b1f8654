"""Delay: samples in the converters and in the computer between command and measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, parameter
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def _input(x: Array, state: Array, k: int, b: int) -> float:
    """Sample k of lane b, from before the block where k is negative."""
    if k >= 0:
        return float(x[k, b])
    place = int(state[0, b]) + k + 1
    return float(state[1 + (place if place >= 0 else place + state.shape[0] - 1), b])


@njit(cache=True)
def _one_sample(x: Array, p: Array, state: Array, y: Array) -> None:
    """Take the newest sample into the ring, then read both that the delay lies between."""
    size = state.shape[0] - 1
    for b in range(x.shape[1]):
        place = int(state[0, b]) + 1
        place = place if place < size else 0
        newer = place - int(p[0, b])
        older = newer - 1
        # Read first: the oldest of the ring stands where the newest goes.
        last = state[1 + (older if older >= 0 else older + size), b]
        state[1 + place, b] = x[0, b]
        first = state[1 + (newer if newer >= 0 else newer + size), b]
        y[0, b] = first + p[1, b] * (last - first)
        state[0, b] = place


@njit(cache=True)
def delay_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exact for an input linear between samples.

    Rows of ``p``: whole samples of delay, fraction of a sample. Rows of the state: place of the
    last input in the ring, the ring.
    """
    size, length = state.shape[0] - 1, x.shape[0]
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
            state[1:, b] = x[0, b]
    if length == 1:
        _one_sample(x, p, state, y)
        return
    for t in range(length):
        for b in range(x.shape[1]):
            k = t - int(p[0, b])
            newer, older = _input(x, state, k, b), _input(x, state, k - 1, b)
            y[t, b] = newer + p[1, b] * (older - newer)
    for b in range(x.shape[1]):
        place = int(state[0, b])
        for t in range(max(length - size, 0), length):
            state[1 + (place + 1 + t) % size, b] = x[t, b]
        state[0, b] = (place + length) % size


@dataclass(frozen=True)
class Delay(Effect):
    """Transport delay of any fraction of a sample.

    Examples
    --------
    >>> Delay(delay_s=2.25e-3).run([0.0, 1.0, 4.0, 9.0, 16.0], 1e-3).tolist()
    [0.0, 0.0, 0.0, 0.75, 3.25]
    """

    delay_s: float = parameter(1e-4, "s", 0.0, 1.0, (1e-5, 5e-4), "transport delay T", neutral=0.0)

    name = "delay"
    slot = "output"
    order = 50
    equation = "y(t) = y_m(t - T)"
    source = (
        "A zero-order hold delays by half a sample and computing by one or two; 10 to 500 µs is an "
        "estimate."
    )
    signature = (
        "Residual like the velocity at any amplitude: the phase grows with f, the gain stays."
    )
    experiment = (
        "A multisine smaller than the first threshold, at high frequency; pairs of sines with the "
        "same largest rate."
    )
    cause = (
        "Conversion, computing and the zero-order hold take time in which nothing is known of the "
        "motion."
    )
    hardware = (
        "Every digital loop; digital sensors with averaging, interferometers and buses (USB, "
        "Ethernet) above all."
    )
    magnitude = (
        "Half a sample for the hold and one or two for computing; 10 to 500 µs is an estimate. At "
        "50 Hz 0.1 ms is 1.8 degrees, an error of 3 % of the amplitude; at 500 Hz ten times that."
    )
    remedy = (
        "Hardware: sample faster, convert and compute in step, average less. Compensation: read "
        "the reference that many samples ahead, which is exact where it is known beforehand; in "
        "feedback a delay cannot be undone and limits the gain."
    )
    mistaken_for = ("sensor_lag", "actuator_lag", "rate_law", "resonance")
    picture = Picture(
        {"delay_s": 3e-4},
        Look("phase", "A small multisine: every play sticks"),
        Look("gain", "Its gain stays"),
    )
    block = staticmethod(delay_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """A small delay, and some samples of the fastest record: δ2 takes up what is less."""
        small = cls.parameters[0].typical[0]
        sizes = dict.fromkeys((small, scale.shortest_s, 4.0 * scale.shortest_s))
        return tuple(cls.within_bounds(delay_s=size) for size in sizes)

    @property
    def slow_lag_s(self) -> float:
        """The delay."""
        return self.delay_s

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Whole samples and the rest."""
        whole, part = divmod(self.delay_s / ts_s, 1.0)
        return [whole, part]

    def state_rows(self, ts_s: float) -> int:
        """Place in the ring, and the ring."""
        return 2 + int(self.delay_s / ts_s)


@dataclass(frozen=True)
class DelayInSamples(Effect, of=Delay):
    """Delay by the same number of samples in every record, whatever their sampling time.

    Examples
    --------
    >>> DelayInSamples(samples=1.0).run([0.0, 1.0, 4.0, 9.0], 1e-3).tolist()
    [0.0, 0.0, 1.0, 4.0]
    """

    samples: float = parameter(1.0, "1", 0.0, 1e3, (0.5, 2.0), "delay in samples, n", neutral=0.0)

    form = "whole samples"
    equation = "y(t) = y_m(t - n Ts), Ts of that record"
    cause = (
        "Command and displacement are converted one after the other, or written in different rows: "
        "the two are apart by a number of samples and not by a time."
    )
    signature = (
        "As a delay, and records with another sampling time show another delay, in proportion."
    )
    experiment = "The same small multisine, recorded at two sampling rates."
    block = staticmethod(delay_block)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same delay at the shortest sampling time."""
        return (cls.within_bounds(samples=simpler.values["delay_s"] / scale.shortest_s),)

    def sampled_at(self, ts_s: float) -> Effect:
        """The delay (s) that its samples are there."""
        return Delay.within_bounds(delay_s=self.samples * ts_s)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Whole samples and the rest."""
        whole, part = divmod(self.samples, 1.0)
        return [whole, part]

    def state_rows(self, ts_s: float) -> int:
        """Place in the ring, and the ring."""
        return 2 + int(self.samples)
