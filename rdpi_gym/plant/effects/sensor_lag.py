"""Sensor lag: the bandwidth of the displacement sensor or of its anti-alias filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Parameter, Picture
from rdpi_gym.plant.effects.linear import ThirdOrderLag, linear_block, pack_lag, pack_two_lags


@dataclass(frozen=True)
class SensorLag(Effect):
    """First-order lag behind the mechanics.

    Examples
    --------
    >>> SensorLag(1e-3).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.368, 1.135, 2.05]
    """

    time_constant_s: float = 1e-4

    name = "sensor_lag"
    slot = "output"
    order = 60
    parameters = (
        Parameter(
            "time_constant_s", "s", 0.0, 0.1, (2e-5, 3e-4), "1 / (2π bandwidth), τ", neutral=0.0
        ),
    )
    equation = "τ dy'/dt + y' = y"
    source = (
        "Fleming 2013, doi 10.1016/j.sna.2012.10.016, as tabulated in T. Dehaeze's notes: strain "
        "gauges 1 to 10 kHz, capacitive sensors to 100 kHz, LVDT 1 kHz."
    )
    signature = (
        "Residual like the velocity with a gain that falls with frequency, at any amplitude."
    )
    experiment = (
        "A multisine smaller than the first threshold, up to about the cut-off; or the sensor's "
        "data sheet."
    )
    cause = (
        "The sensor's electronics filter: what is recorded lags behind the motion, while the "
        "motion itself is not changed."
    )
    hardware = (
        "Strain gauges with low-pass filters, capacitive sensors set to a low bandwidth for low "
        "noise, LVDTs."
    )
    magnitude = (
        "Strain gauges 1 to 10 kHz, capacitive sensors to 100 kHz, LVDTs about 1 kHz (Fleming "
        "2013, doi 10.1016/j.sna.2012.10.016). A bandwidth of 1 kHz is τ = 0.16 ms: at 50 Hz 2.9 "
        "degrees, 5 % of the amplitude."
    )
    remedy = (
        "Hardware: set the sensor to its largest bandwidth and accept its noise, or calibrate it "
        "against a faster one. Compensation: where the sensor is what is to be believed, lead as "
        "for any lag; where the motion itself counts, correct the reading and leave the command "
        "alone."
    )
    mistaken_for = ("delay", "actuator_lag", "rate_law", "resonance")
    picture = Picture(
        {"time_constant_s": 2e-4},
        Look("phase", "A small multisine: every play sticks"),
        Look("gain", "Its gain falls"),
    )
    block = staticmethod(linear_block)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """As :func:`~rdpi_gym.plant.effects.linear.linear_block` reads them."""
        return pack_lag(self.time_constant_s, ts_s)

    def state_rows(self, ts_s: float) -> int:
        """Last input and output."""
        return 2


@dataclass(frozen=True)
class SecondOrderSensorLag(Effect, of=SensorLag):
    """Two lags in a row behind the mechanics.

    Examples
    --------
    >>> SecondOrderSensorLag(1e-3, 0.5).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.168, 0.762, 1.598]
    """

    time_constant_s: float = 1e-4
    second_ratio: float = 0.3

    form = "second order"
    parameters = (
        Parameter(
            "time_constant_s", "s", 0.0, 0.1, (2e-5, 3e-4), "larger time constant, τ1", neutral=0.0
        ),
        Parameter("second_ratio", "1", 0.0, 1.0, (0.1, 1.0), "second over it, q", neutral=0.0),
    )
    equation = "τ1 τ2 d²y'/dt² + (τ1 + τ2) dy'/dt + y' = y, τ2 = q τ1"
    cause = (
        "The sensor's bandwidth and an anti-alias filter behind it, or a filter of second order."
    )
    signature = "As a lag, and beyond both cut-offs the phase goes to 180 degrees: steps begin with no slope."
    block = staticmethod(linear_block)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same delay of slow signals, shared unequally and equally."""
        whole = simpler.values["time_constant_s"]
        return tuple(
            cls.within_bounds(time_constant_s=whole / (1.0 + ratio), second_ratio=ratio)
            for ratio in (0.1, 0.7)
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """As :func:`~rdpi_gym.plant.effects.linear.linear_block` reads them."""
        return pack_two_lags(self.time_constant_s, self.second_ratio * self.time_constant_s, ts_s)

    def state_rows(self, ts_s: float) -> int:
        """Last input and what leaves each lag."""
        return 3


@dataclass(frozen=True)
class ThirdOrderSensorLag(ThirdOrderLag, of=SensorLag):
    """Low-pass of third order, with real poles or a pair.

    Examples
    --------
    >>> ThirdOrderSensorLag(1e-3, 0.4, 1 / 6).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.189, 0.998, 1.999]
    """
