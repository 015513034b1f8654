"""Actuator lag: the amplifier's output resistance charges the stack's capacitance."""

from __future__ import annotations

from dataclasses import dataclass

from rdpi_gym.plant.effects.base import Look, Picture, parameter
from rdpi_gym.plant.effects.linear import FirstOrderLag, FourthOrderLag, SecondOrderLag


@dataclass(frozen=True)
class ActuatorLag(FirstOrderLag):
    """First-order lag in front of the hysteresis.

    Examples
    --------
    >>> ActuatorLag(1e-3).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.368, 1.135, 2.05]
    """

    time_constant_s: float = parameter(
        2e-4, "s", 0.0, 0.1, (3e-5, 1e-3), "output resistance x capacitance, τ", neutral=0.0
    )

    name = "actuator_lag"
    slot = "input"
    order = 30
    equation = "τ du'/dt + u' = u"
    source = (
        "Capacitive load behind an output resistance; stacks of 10 to 100 µm have 2 to 20 µF "
        "(Thorlabs, piezo driver bandwidth tutorial). The cut-off of 50 Hz to 5 kHz is an estimate."
    )
    signature = (
        "A lag at every amplitude, small signals included; the plays and the rate see the lagged "
        "voltage, so at large amplitude it does not commute with the loop."
    )
    experiment = (
        "A multisine smaller than the first threshold, and large sines up to the cut-off; or "
        "measure the voltage at the stack."
    )
    cause = (
        "The output resistance of the amplifier and the capacitance of the actuator form a low- "
        "pass: the voltage at the stack follows the command with the time constant R C."
    )
    hardware = (
        "Every voltage-driven stack, the more so behind a current-limiting resistor, a long cable "
        "or a low-noise filter; large stacks have 2 to 20 µF."
    )
    magnitude = (
        "Stacks reach beyond 100 kHz, their drives usually a few kHz (Fleming, "
        "studylib.net/doc/18813258). With 10 µF a cut-off of 1 kHz needs less than 16 Ω. At 50 Hz "
        "a time constant of 0.2 ms is a phase of 3.6 degrees, and an error of 6 % of the "
        "amplitude."
    )
    remedy = (
        "Hardware: an amplifier with a lower output resistance, or a smaller capacitance. "
        "Compensation: lead by the same time constant, u + τ du/dt, behind the inverse of the "
        "hysteresis; it needs one sample of preview and amplifies noise of the reference."
    )
    mistaken_for = ("sensor_lag", "delay", "rate_law", "resonance")
    picture = Picture(
        {"time_constant_s": 3e-4},
        Look("phase", "A small multisine: every play sticks"),
        Look("left_over_time", "What a refit leaves of a large sine", "sine-50hz", 0.1, 0.14),
    )


@dataclass(frozen=True)
class SecondOrderActuatorLag(SecondOrderLag, of=ActuatorLag):
    """Two lags in a row in front of the hysteresis.

    Examples
    --------
    >>> SecondOrderActuatorLag(1e-3, 0.5).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.168, 0.762, 1.598]
    """

    equation = "τ1 τ2 d²u'/dt² + (τ1 + τ2) du'/dt + u' = u, τ2 = q τ1"
    cause = (
        "Resistance and capacitance charge through a second low-pass: the amplifier's own bandwidth, "
        "a filter at its input, the cable."
    )


@dataclass(frozen=True)
class FourthOrderActuatorLag(FourthOrderLag, of=ActuatorLag):
    """Low-pass of fourth order, with real poles or pairs.

    Examples
    --------
    >>> FourthOrderActuatorLag(1e-3, 3 / 7, 2 / 9, 0.3).run([0.0, 1.0, 2.0, 3.0], 1e-3).round(3).tolist()
    [0.0, 0.158, 0.996, 2.001]
    """
