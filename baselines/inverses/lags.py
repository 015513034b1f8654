"""Sensor lag and actuator lag undone: r + τ ṙ, of second order r + (τ1 + τ2) ṙ + τ1 τ2 r̈."""

from __future__ import annotations

from baselines.inverses.linear import LinearInverse
from rdpi_gym.plant.effects import Effect


class SensorLagInverse(LinearInverse):
    """The lag behind the mechanics, by a derivative over a tenth of its time constant either way.

    Examples
    --------
    >>> from baselines.inverses.base import Setting
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> lag, setting = load_effect("sensor_lag")(2e-4), Setting(1e-4, PAPER_IV_B, 40.0, 0.0)
    >>> SensorLagInverse(lag, setting, ahead=1).weights.round(3).tolist()
    [-1.083, 1.166, 0.917]
    """

    effect = "sensor_lag"
    forms = ("", "second order", "third order")
    urgency = 2

    @classmethod
    def half_window_s(cls, effect: Effect) -> float:
        """Return a tenth of the time constant (s), or of the sum of both."""
        values = effect.values
        return 0.1 * values["time_constant_s"] * (1.0 + values.get("second_ratio", 0.0))


class ActuatorLagInverse(SensorLagInverse):
    """The lag in front of the hysteresis."""

    effect = "actuator_lag"
    urgency = 1
