"""Sensor lag: the bandwidth of the displacement sensor or of its anti-alias filter."""

from __future__ import annotations

from dataclasses import dataclass

from rdpi_gym.plant.effects.base import Look, Picture, parameter
from rdpi_gym.plant.effects.linear import FirstOrderLag, FourthOrderLag, SecondOrderLag


@dataclass(frozen=True)
class SensorLag(FirstOrderLag):
    """First-order lag behind the mechanics.

    Examples
    --------
    >>> SensorLag(1e-3).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.368, 1.135, 2.05]
    """

    time_constant_s: float = parameter(
        1e-4, "s", 0.0, 0.1, (2e-5, 3e-4), "1 / (2π bandwidth), τ", neutral=0.0
    )

    name = "sensor_lag"
    slot = "output"
    order = 60
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


@dataclass(frozen=True)
class SecondOrderSensorLag(SecondOrderLag, of=SensorLag):
    """Two lags in a row behind the mechanics.

    Examples
    --------
    >>> SecondOrderSensorLag(1e-3, 0.5).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.168, 0.762, 1.598]
    """

    time_constant_s: float = parameter(
        1e-4, "s", 0.0, 0.1, (2e-5, 3e-4), SecondOrderLag.parameters[0].meaning, neutral=0.0
    )

    equation = "τ1 τ2 d²y'/dt² + (τ1 + τ2) dy'/dt + y' = y, τ2 = q τ1"
    cause = (
        "The sensor's bandwidth and an anti-alias filter behind it, or a filter of second order."
    )


@dataclass(frozen=True)
class FourthOrderSensorLag(FourthOrderLag, of=SensorLag):
    """Low-pass of fourth order, with real poles or pairs.

    Examples
    --------
    >>> FourthOrderSensorLag(1e-3, 3 / 7, 2 / 9, 0.3).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.158, 0.996, 2.001]
    """
