"""``smith-predictor``: PI on what a model of the path says without the delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from baselines.linear_feedback import LinearFeedback
from baselines.loops.path import belief_path
from baselines.loops.systems import FACTORS, LinearSystem, gain, integrator, unit_delay
from baselines.tuning import Knob


class SmithPredictor(LinearFeedback):
    """C = C_0 / (1 + C_0 G_0 (1 - D)), with C_0 = k_i / s + k_p and the belief's path G_0 D.

    G_0 has lags, modes and the sample that computing takes, D the delay. Were the belief true,
    C_0 would see a path without delay. k_i is a share of the largest that leaves |1 / (1 + L)| within
    a bound with all plays sticking and with all sliding, which the model knows nothing of.

    Source: O. J. M. Smith, Chem. Eng. Prog. 53, 1957.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> late = replace(P10, effects=(load_effect("delay")(delay_s=5e-4),))
    >>> controller = SmithPredictor(late, ObservationLayout.for_plant(late, 1e-4, preview=8), {})
    >>> controller.certified.stable
    True
    """

    name = "smith-predictor"
    knobs = (
        Knob("gain_share", 0.01, 3.0, 0.5, logarithmic=True),
        Knob("proportional_s", 1e-6, 2e-3, 5e-5, "s", logarithmic=True),
        Knob("sensitivity", 1.2, 3.0, 2.0),
    )

    def design(self) -> LinearSystem:
        """Return the PI with its inner model."""
        ts_s = self.layout.ts_s
        prompt = tuple(e for e in self.belief.effects if e.name != "delay")
        model = belief_path(replace(self.belief, effects=prompt), ts_s).dynamics
        missing = unit_delay() * (model + self.path.dynamics.times(-1.0))
        pi = integrator(ts_s) + gain(self.settings["proportional_s"])
        pi = pi.times(self.settings["gain_share"] * self._largest(pi, missing))
        return pi.around(missing)

    def _largest(self, pi: LinearSystem, missing: LinearSystem) -> float:
        """Largest gain up to which |1 / (1 + L)| stays within the bound on both extremes."""
        inner = (pi * missing).response(self.z)
        late = unit_delay() * pi
        outer = [(late * each).response(self.z) for each in self.path.extremes]
        allowed = 0.0
        for factor in (FACTORS / self.layout.ts_s).tolist():
            left = 1.0 + factor * inner
            peaks = (np.abs(left / (left + factor * each)).max() for each in outer)
            if max(peaks) > self.settings["sensitivity"]:
                break
            allowed = factor
        return allowed
