"""Which look at which experiment shows each effect best, and with which parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rdpi_gym.report.effect_figure import Panel
from rdpi_gym.signals.experiments import Experiment, polyline
from rdpi_gym.signals.steps import Constant
from studies.effect_pages import panels
from studies.effect_pages.study import Study


@dataclass(frozen=True)
class Shown:
    """How an effect is shown.

    Parameters
    ----------
    values
        Parameters that are not at their defaults: an effect of a size that the eye sees.
    panels
        Left and right, of a study of the effect.
    """

    values: Mapping[str, float]
    panels: Callable[[Study], tuple[Panel, Panel]]


# Voltage below the first threshold of the plant, where every play sticks.
_SMALL_V = 0.8
_SMALL = polyline([0.0, *[_SMALL_V, -_SMALL_V] * 3, 0.0], rate_V_s=4.0 * _SMALL_V)
SMALL_TRIANGLE = Experiment(
    "small-triangle", "reversals while every play sticks", _SMALL, 1e-3, 3.0
)
STEP = Experiment("step", "ringing", polyline([0.0, 0.0, 5.0], rate_V_s=1e4), 2e-5, 0.02)
AT_REST = Experiment("at-rest", "drift", Constant(offset_um=0.0), 0.1, 300.0)

_LARGE, _REFIT = "A large sine of 50 Hz", "What a refit leaves of it"

SHOWN: dict[str, Shown] = {
    "saturation": Shown({"limit_V": 60.0}, lambda s: (
        panels.loops(s, "triangle-slow", "A slow decaying triangle"),
        panels.left_over_command(s, _REFIT, "triangle-slow"),
    )),
    "slew_limit": Shown({"rate_V_s": 5e3}, lambda s: (
        panels.over_time(s, "sine-50hz", _LARGE, 0.0, 0.04),
        panels.left_over_time(s, "sine-50hz", _REFIT, 0.0, 0.04),
    )),
    "actuator_lag": Shown({"time_constant_s": 3e-4}, lambda s: (
        panels.phase(s, "A small multisine: every play sticks"),
        panels.left_over_time(s, "sine-50hz", "What a refit leaves of a large sine", 0.1, 0.14),
    )),
    "rate_law": Shown({"exponent": 0.5}, lambda s: (
        panels.loops(s, "sine-10hz", "A large sine of 10 Hz"),
        panels.left_over_command(s, "What a refit leaves", "sine-10hz", "sine-50hz"),
    )),
    "initial_memory": Shown({"extremum_V": 25.0}, lambda s: (
        panels.over_time(s, "sine-10hz", "The first moments of a large sine", 0.0, 0.02),
        panels.left_over_time(s, "sine-10hz", _REFIT, 0.0, 0.5),
    )),
    "congruency": Shown({"coefficient": 0.3}, lambda s: (
        panels.loops(s, "minor-loops", "Minor loops at three biases"),
        panels.left_over_command(s, _REFIT, "minor-loops"),
    )),
    "asymmetry": Shown({"coefficient": 0.05}, lambda s: (
        panels.loops(s, "sine-10hz", "A large sine about zero"),
        panels.left_over_command(s, _REFIT, "sine-10hz"),
    )),
    "creep": Shown({"gain_per_decade": 0.02}, lambda s: (
        panels.onward(s, "stairs", "A hold of 30 s", 23.85, 53.8),
        panels.left_over_time(s, "stairs", "What a refit leaves of the stairs"),
    )),
    "resonance": Shown({"f0_hz": 1000.0, "damping": 0.02}, lambda s: (
        panels.gain(s, "A small multisine: every play sticks"),
        panels.response(s, STEP, "A step of 5 V"),
    )),
    "backlash": Shown({"half_width_um": 0.2}, lambda s: (
        panels.small_loop(s, SMALL_TRIANGLE, "Reversals while every play sticks", 0.5),
        panels.left_over_command(s, "What a refit leaves of minor loops", "minor-loops"),
    )),
    "gain_drift": Shown({"rate_per_s": 3e-4}, lambda s: (
        panels.displacement_of_repeats(
            s, "triangle-slow", "triangle-slow-again", "The first record once more, 85 s later"
        ),
        panels.left_over_command(
            s, "What a refit leaves of both", "triangle-slow", "triangle-slow-again"
        ),
    )),
    "thermal_drift": Shown({"rate_um_s": 0.02, "time_constant_s": 50.0}, lambda s: (
        panels.response(s, AT_REST, "Five minutes at a constant command"),
        panels.left_over_time(s, "stairs", "What a refit leaves of the stairs"),
    )),
    "delay": Shown({"delay_s": 3e-4}, lambda s: (
        panels.phase(s, "A small multisine: every play sticks"),
        panels.gain(s, "Its gain stays"),
    )),
    "sensor_lag": Shown({"time_constant_s": 2e-4}, lambda s: (
        panels.phase(s, "A small multisine: every play sticks"),
        panels.gain(s, "Its gain falls"),
    )),
    "mains_hum": Shown({"amplitude_um": 0.05}, lambda s: (
        panels.over_time(s, "quiet", "A quiet record", 0.0, 0.1),
        panels.spectrum(s, "triangle-slow", "What a refit leaves of a slow triangle", 120.0),
    )),
}  # fmt: skip
"""By the effect's name."""
