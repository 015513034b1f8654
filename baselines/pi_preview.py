"""``pi-preview``: PI with a notch and a low-pass on a static or rated inverse that is read ahead."""

from __future__ import annotations

import math
from dataclasses import replace

from baselines.linear_feedback import LinearFeedback
from baselines.loops.path import belief_path
from baselines.loops.systems import (
    LinearSystem,
    integral_shape,
    largest_factor,
    sampled,
    unit_delay,
)
from baselines.tuning import Knob
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects.delay import Delay


class PIPreview(LinearFeedback):
    """C = N(s) (k_i / s + k_p) / (τ s + 1) on the inverse of r(t + lead).

    The lead is the belief's delay of slow signals, lags and mode included, times a share; the
    feedforward knows of the effects by it alone. N = (s² + 2 ζ ω0 s + ω0²) / (s² + 2 w ω0 s + ω0²)
    cuts the believed mode out, wider than it is; a belief without a mode gives a controller without
    a notch. k_i is a share of the largest that leaves |1 / (1 + L)| at most 2 on the belief, as
    :func:`baselines.pi.gains_within_margin` finds it.

    Source: PI, notch and inversion as compared by Fleming, Leang, ACC 2013.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> stage = replace(P10, effects=(load_effect("resonance")(f0_hz=700.0, damping=0.02),))
    >>> controller = PIPreview(stage, ObservationLayout.for_plant(stage, 1e-4, preview=8), {})
    >>> controller.certified.stable
    True
    """

    name = "pi-preview"
    knobs = (
        Knob("lead_share", 0.0, 2.0, 1.0),
        Knob("rate_share", 0.0, 1.5, 1.0),
        Knob("gain_share", 0.01, 3.0, 0.7, logarithmic=True),
        Knob("proportional_s", 1e-6, 2e-3, 5e-5, "s", logarithmic=True),
        Knob("second_integral_hz", 0.0, 60.0, 0.0, "Hz"),
        Knob("lowpass_hz", 50.0, 5000.0, 2000.0, "Hz", logarithmic=True),
        Knob("notch_width", 0.02, 3.0, 0.5, logarithmic=True),
    )

    def inverted_belief(self) -> PlantModel:
        """Return the belief with its effects as one delay, and its rate's share."""
        core = self.belief.hysteresis
        lead_s = self.settings["lead_share"] * belief_path(self.belief, self.layout.ts_s).delay_s
        rated = replace(core, delta2_s=self.settings["rate_share"] * core.delta2_s)
        effects = (Delay(min(max(lead_s, 0.0), 0.02)),) if lead_s else ()
        return replace(self.belief, hysteresis=rated, effects=effects)

    def design(self) -> LinearSystem:
        """Return the filtered PI."""
        ts_s, mode = self.layout.ts_s, self.path.mode
        shape = integral_shape(self.settings, ts_s)
        if mode is not None and mode.omega0_rad_s * ts_s < 0.9 * math.pi:
            w0, wide = mode.omega0_rad_s, max(self.settings["notch_width"], mode.damping)
            notch = sampled(
                [1.0, 2.0 * mode.damping * w0, w0**2], [1.0, 2.0 * wide * w0, w0**2], ts_s, w0
            )
            shape = notch * shape
        loops = [(unit_delay() * shape * each).response(self.z) for each in self.path.extremes]
        unit = 1.0 / ts_s  # largest_factor looks below 10: gains in units of a sample
        largest = largest_factor([unit * loop for loop in loops]) * unit
        return shape.times(self.settings["gain_share"] * largest)
