"""Resonance undone: r + 2ζ/ω0 ṙ + r̈/ω0², other forms by the like derivatives of theirs."""

from __future__ import annotations

import math

from baselines.inverses.linear import LinearInverse
from rdpi_gym.plant.effects import Effect


class ResonanceInverse(LinearInverse):
    """One mode or two, by derivatives over a tenth of its period either way.

    Examples
    --------
    >>> from baselines.inverses.base import Setting
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> mode = load_effect("resonance")(f0_hz=1000.0, damping=0.02)
    >>> inverse = ResonanceInverse(mode, Setting(5e-5, PAPER_IV_B, 40.0, 0.0), ahead=2)
    >>> inverse.ahead, inverse.rows, float(inverse.weights.sum().round(12))
    (2, 4, 1.0)
    """

    effect = "resonance"
    forms = ("", "with a zero", "two modes")
    urgency = 3

    @classmethod
    def half_window_s(cls, effect: Effect) -> float:
        """Return a tenth of the period (s), of two modes that of the slower one."""
        values = effect.values
        return 0.1 / min(values["f0_hz"], values.get("second_hz", math.inf))
