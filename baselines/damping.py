"""``integral-resonant``, ``positive-position``, ``dual-loop``: a mode is damped, and then tracked.

An inner loop C_d damps the believed mode and an outer one, k_i / s + k_p, tracks on the damped path:
C = C_d + k_i / s + k_p. The inner loops of the literature feed the position back positively; here they
see the deviation from the reference, which is the same loop, and leave the reference to the
feedforward. Each gives -k at rest, so what is damped yields more: 1 / (1 - k). Their corner is where
the loop at the mode has no phase, with lags, delay and the sample that computing takes counted in,
plays sticking as much as sliding:
there L is large and positive, and |1 / (1 + L)| small. Where that takes another sign than the
literature's (a long delay), it is turned round.
"""

from __future__ import annotations

import cmath
import math
from abc import abstractmethod

import numpy as np

from baselines.adaptive_feedforward import AdaptiveFeedforward
from baselines.base import Observation
from baselines.linear_designs import CorrectedInverse, LinearFeedback
from baselines.loops import (
    BeliefPath,
    LinearSystem,
    Mode,
    belief_path,
    gain,
    integral_shape,
    largest_factor,
    sampled,
    unit_delay,
)
from baselines.tuning import Knob, Settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

# What a mode may have of half the sampling frequency to be damped by a filter in samples.
_FASTEST = 0.8


class DampedTracking(LinearFeedback):
    """An inner loop that damps the mode, and integral tracking of what it leaves.

    A belief without a mode gives a controller without an inner loop. Both loops are turned up to a
    share of the largest gain that leaves |1 / (1 + L)| at most 2, the inner one alone, then the
    outer one on the damped path.
    """

    knobs = (
        Knob("damping_share", 0.0, 1.0, 0.7),
        Knob("corner_share", 0.2, 5.0, 1.0, logarithmic=True),
        Knob("gain_share", 0.01, 3.0, 0.7, logarithmic=True),
        Knob("proportional_s", 1e-6, 2e-3, 5e-5, "s", logarithmic=True),
        Knob("second_integral_hz", 0.0, 60.0, 0.0, "Hz"),
        Knob("lowpass_hz", 50.0, 5000.0, 3000.0, "Hz", logarithmic=True),
    )

    @abstractmethod
    def damper(self, mode: Mode, lead_rad: float) -> LinearSystem:
        """Return C_d of gain about 1 whose phase at the mode is `lead_rad`, 0 to π."""

    def design(self) -> LinearSystem:
        """Return both loops side by side."""
        ts_s, extremes = self.layout.ts_s, self.path.extremes
        inner = self._inner()
        damped = [(unit_delay() * inner * each).closed() for each in extremes]
        shape = self.tracking()
        unit = 1.0 / ts_s
        outer = [
            unit * (unit_delay() * shape * each).response(self.z) * left.response(self.z)
            for each, left in zip(extremes, damped, strict=True)
        ]
        factor = self.settings["gain_share"] * largest_factor(outer) * unit
        # where damping takes all that is allowed, what would track is no state of the loop either
        return inner + shape.times(factor) if factor else inner

    def tracking(self) -> LinearSystem:
        """Return the outer loop but for its gain."""
        return integral_shape(self.settings, self.layout.ts_s)

    def _inner(self) -> LinearSystem:
        mode, ts_s = self.path.mode, self.layout.ts_s
        if mode is None or mode.omega0_rad_s * ts_s > _FASTEST * math.pi:
            return gain(0.0)
        at = np.array([cmath.exp(1j * mode.omega0_rad_s * ts_s)])
        paths = (unit_delay() * each for each in self.path.extremes)
        between = sum(complex(path.response(at)[0]) for path in paths)
        needed = -cmath.phase(between) % (2.0 * math.pi)
        sign = 1.0 if needed <= math.pi else -1.0
        found = self.damper(mode, needed % math.pi).times(sign)
        loops = [(unit_delay() * found * each).response(self.z) for each in self.path.extremes]
        return found.times(self.settings["damping_share"] * largest_factor(loops))


class IntegralResonant(DampedTracking):
    """Integral resonant control: C_d = -k ω_c / (s + ω_c).

    An integrator in positive feedback around the path and a feedthrough is that low-pass; its corner
    ω_c turns the position at the mode into a velocity.

    Source: Fleming, Aphale, Moheimani, IEEE Trans. Nanotechnology 9, 2010; compared with PI and
    inversion by Fleming, Leang, ACC 2013.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> stage = replace(P10, effects=(load_effect("resonance")(f0_hz=739.0, damping=0.03),))
    >>> controller = IntegralResonant(stage, ObservationLayout.for_plant(stage, 1e-4, preview=8), {})
    >>> controller.certified.stable
    True
    """

    name = "integral-resonant"

    def damper(self, mode: Mode, lead_rad: float) -> LinearSystem:
        """Return the low-pass; it turns by 90 degrees at most, so the lead is 90 at least."""
        lag = min(max(math.pi - lead_rad, 0.05), 0.5 * math.pi - 0.05)
        corner = self.settings["corner_share"] * mode.omega0_rad_s / math.tan(lag)
        return sampled([-corner], [1.0, corner], self.layout.ts_s, mode.omega0_rad_s)


class PositivePosition(DampedTracking):
    """Positive position feedback: C_d = -k ω_f² / (s² + 2 ζ_f ω_f s + ω_f²), ζ_f = 1/2.

    Source: Fanson, Caughey, AIAA J. 28, 1990; on nanopositioners Aphale, Bhikkaji, Moheimani, IEEE
    Trans. Nanotechnology 7, 2008.
    """

    name = "positive-position"

    def damper(self, mode: Mode, lead_rad: float) -> LinearSystem:
        """Return the resonant filter, tuned above the mode where the path is late already."""
        # the filter lags by φ at the mode: tan φ = x / (1 - x²), x = ω0 / ω_f
        lag = min(max(math.pi - lead_rad, 0.1), math.pi - 0.1)
        t = math.tan(lag)
        x = (
            1.0
            if abs(t) > 1e6
            else (-1.0 + math.copysign(math.sqrt(1.0 + 4.0 * t * t), t)) / (2.0 * t)
        )
        tuned = self.settings["corner_share"] * mode.omega0_rad_s / x
        return sampled([-(tuned**2)], [1.0, tuned, tuned**2], self.layout.ts_s, mode.omega0_rad_s)


class DualLoop(DampedTracking):
    """Dual-loop damping and tracking: C_d = k (s - ω_a) / (s + ω_a).

    The non-minimum-phase filter has the same gain at every frequency and turns from 180 degrees to 0,
    by 90 at ω_a: k is held up to high frequencies, so the mode may move.

    Source: arXiv 2412.18374, Natu and HosseinNia, with bandwidths of 895 and 845 Hz on a stage whose
    mode is at 739 Hz; written from its abstract, the tuning is this package's own.
    """

    name = "dual-loop"

    def damper(self, mode: Mode, lead_rad: float) -> LinearSystem:
        """Return the all-pass."""
        half = 0.5 * (math.pi - min(max(lead_rad, 0.1), math.pi - 0.1))
        corner = self.settings["corner_share"] * mode.omega0_rad_s / math.tan(half)
        return sampled([1.0, -corner], [1.0, corner], self.layout.ts_s, mode.omega0_rad_s)


class CorrectedAdaptive(AdaptiveFeedforward):
    """The adaptive feedforward with a correction, which its estimate knows of."""

    def corrected_command(
        self, observation: Observation, correction_um: Array, state: Array
    ) -> Array:
        """Return u(k+1) (V), ``(B,)``; see :class:`baselines.linear_designs.CorrectedInverse`."""
        measured = self.layout.measured_um(observation)
        now = self.layout.reference_um(observation, slice(1))[:, 0]
        wanted = self.wanted_um(observation, measured, now, state)
        return self.driven(observation, self.corrected(wanted, state, correction_um), state)

    def corrected(self, wanted_um: Array, state: Array, *corrections_um: Array) -> Array:
        """Return w with its corrections (µm), ``(B,)``, added one after the other."""
        for correction in corrections_um:
            wanted_um = wanted_um + correction
        return wanted_um


class AdaptiveDualLoop(DualLoop):
    """``dual-loop`` on ``adaptive-feedforward`` in place of the belief's inverse.

    The feedforward learns what the belief lacks and needs a period for it; the feedback damps the
    mode and answers what is not learned. The estimate takes the correction for what it is, a part of
    what went in, so the two do not work against each other. The feedforward has its own settings.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, 1e-4, preview=8)
    >>> AdaptiveDualLoop(P10, layout, {}).inverse.name
    'adaptive-feedforward'
    """

    name = "adaptive-dual-loop"
    aliases = ("adaptive-feedforward-dual-loop",)
    needs_core = None  # its feedforward inverts any

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        self.feedforward = self.adaptive(belief, layout)
        super().__init__(belief, layout, settings)
        self.plant_samples += self.feedforward.plant_samples

    def adaptive(self, belief: PlantModel, layout: ObservationLayout) -> CorrectedAdaptive:
        """Return the feedforward; its settings are its own."""
        return CorrectedAdaptive(belief, layout)

    def tracking(self) -> LinearSystem:
        """Return the outer loop but for its gain; its zero is no faster than the believed lag, which it cancels."""
        proportional_s = max(self.settings["proportional_s"], self.path.delay_s)
        shaped = {**self.settings, "proportional_s": proportional_s}
        return integral_shape(shaped, self.layout.ts_s)

    def certificate(self) -> str | None:
        """Return what is certain of the feedback on its belief, which the adaptation is no part of."""
        line = super().certificate()
        most = self.feedforward.most_um
        return line and f"{line}; of the feedback alone: the adaptation adds {most:.3g} µm at most"

    def inverse_and_path(self) -> tuple[CorrectedInverse, BeliefPath]:
        """Return the adaptive feedforward, and the belief's path: the correction passes all of it."""
        return self.feedforward, belief_path(self.belief, self.layout.ts_s)
