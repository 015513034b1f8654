"""``adaptive-feedforward``, ``adaptive-inverse``: what the belief lacks, or its weights, estimated while it runs."""

from __future__ import annotations

import math
from functools import cached_property
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.base import Observation, Rows, lane_products, product, shift_in
from baselines.core_inverse import (
    TERMS,
    hysteresis_inverse,
    inverse_command,
    linear_inverse,
    look_ahead,
)
from baselines.feedforward import Feedforward
from baselines.inverses.linear import preview_weights
from baselines.least_squares import ForgettingLeastSquares
from baselines.monitors import BAND_HZ, RingingMonitor
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.play import play
from rdpi_gym.support.arrays import Array


def spline_weights(order: int) -> Array:
    """Weights of ``order + 1`` samples for the value and all but the last derivatives in the middle.

    Row q is (1 + z)^(order - q) (2 (z - 1))^q / 2^order, a spline's q-th derivative per sample:
    smoothing and derivatives share one frequency response but (2 tan(ω Ts / 2))^q, which at 740 Hz
    and 0.1 ms is 2 % above (ω Ts)^q. So the coefficients of a fit mean the same for any two signals.
    """
    rows = []
    for q in range(order):
        row = np.array([1.0])
        for factor in [[1.0, 1.0]] * (order - q) + [[-2.0, 2.0]] * q:
            row = np.convolve(row, factor)
        rows.append(row / 2.0**order)
    return np.array(rows)


SPLINE = spline_weights(4)
"""Weights of five samples for the value and three derivatives of a cubic."""
HALF = 2
PLAYS = (0.03, 0.08, 0.15, 0.25, 0.4, 0.55, 0.75, 1.0)
"""Thresholds of the plays that make up for wrong weights, as shares of the scale."""
PRODUCTS = (1, 3, 5)
"""Plays whose products with r make up for small loops that differ from place to place."""
POWERS = (2, 3)
"""Powers of r that make up for a gain that differs from place to place."""
SLOW_S = (0.01, 0.1)
"""Time constants (s) of the low-passes that make up for creep."""
GAIN_SPREAD, PLAY_SPREAD, OFFSET_SPREAD = 0.1, 0.2, 0.025
"""Expected size of the corrections of the gain, of a play and its like, and of the offset as share
of the scale."""
MOST = 0.5
"""Largest correction as share of the scale."""
ROUNDING = 1e-5
"""Margin, as share of the command range: observations are float32."""


class AdaptiveFeedforward(Tunable):
    """w = r + θ·φ[r] at the time k + 1 + lead, u(k+1) = the belief's classical inverse of w.

    φ holds r', r'', r''', which undo lags, a mode and what is left of a delay; r, 1 and eight plays
    of r, for wrong weights and thresholds; r², r³ and products of r and plays, for a hysteresis of
    another kind; two slow low-passes of r, for creep. θ is estimated as
    an inverse model, not from the tracking error: w is what went into the plant behind the belief's
    inverse, so least squares with forgetting of w - y on φ, derivatives taken of the *measured* y
    and both at the same sample, finds θ with w = y + θ·φ. What rings is then data and no
    disturbance: a mode anywhere, of a load too, is identified from its ringing, where learning from
    low-passed tracking errors is a loop through it that a mode at 350 Hz makes unstable.

    Before anything is learned θ is that of the belief's linear effects. It is estimated with that as
    prior, see :class:`baselines.least_squares.ForgettingLeastSquares`. Where
    the error rings, :class:`baselines.monitors.RingingMonitor`, nothing is learned and what was
    learned is withdrawn.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-4, preview=8)
    >>> AdaptiveFeedforward(plant, layout, {"lead_samples": 4}).needed_preview
    7

    Notes
    -----
    Inverse modelling: Widrow, Walach, Adaptive Inverse Control, 1996; the estimate of an inverse
    hysteresis operator with the plays of the wanted displacement: Kuhnen, Krejčí, IEEE Trans.
    Autom. Control 54, 2009. A cubic spline's derivatives are exact differences of its smoothing, so
    θ means the same for y and for r up to half the sampling frequency.
    """

    name = "adaptive-feedforward"
    aliases = ("adaptive-inverse-dynamics",)
    knobs = (
        Knob("lead_samples", 1.0, 12.0, 2.0),
        Knob("memory_s", 0.02, 5.0, 0.05, "s", logarithmic=True),
        Knob("doubt", 5e-4, 0.1, 1.5e-2, logarithmic=True),
        Knob("dynamics_s", 3e-5, 3e-3, 3e-4, "s", logarithmic=True),
    )
    half: ClassVar[int] = HALF  # of the samples that the estimate takes derivatives of y from

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        ts, scale = layout.ts_s, layout.scale_um
        delay, series = self.behind()
        self.wanted_lead = self.leads(delay)
        self.spline = spline_weights(2 * self.half)[: len(SPLINE)]
        self.lead = max(1, min(self.wanted_lead, layout.preview - 1 - HALF))
        prior = np.convolve(series, look_ahead(delay - self.lead))[1:4].tolist()
        self.thresholds_um = scale * np.array(PLAYS)
        self.slow = np.exp(-ts / np.array(SLOW_S))
        dynamics = self.settings["dynamics_s"] / ts
        spreads = [dynamics, dynamics**2, dynamics**3, GAIN_SPREAD, OFFSET_SPREAD * scale]
        plays = len(PLAYS) + len(PRODUCTS) + len(POWERS) + len(SLOW_S)
        spreads += [PLAY_SPREAD] * plays
        self.fit = ForgettingLeastSquares(
            [*prior, *[0.0] * (len(spreads) - len(prior))],
            spreads,
            noise=self.settings["doubt"] * scale,
            memory_s=self.settings["memory_s"],
            ts_s=ts,
        )
        self.monitor = RingingMonitor(BAND_HZ, scale, ts)
        # Reference times of the five samples about that of the correction that acts at k + 1.
        ahead = self.lead - 1 + np.arange(2 * HALF + 1)
        self.window = np.minimum(ahead, layout.preview)
        self._rings = self.lead + self.half + 2, 2 + plays
        self.rows = Rows(
            inverse=len(self.inverse_at_rest(np.zeros(1))),
            measured=2 * self.half + 1,
            wanted=self.lead + 2 * self.half + 1,
            plays=len(PLAYS),
            slow=len(SLOW_S),
            seen=math.prod(self._rings),
            fit=self.fit.rows,
            monitor=self.monitor.rows,
            last_V=1,
            count=1,
        )

    def behind(self) -> tuple[float, Array]:
        """Return what the belief has between w and y: its delay in samples, its inverse in powers of θ."""
        return linear_inverse(self.belief, self.layout.ts_s)

    @property
    def most_um(self) -> float:
        """Largest correction (µm)."""
        return MOST * self.layout.scale_um

    def leads(self, delay: float) -> int:
        """Return the lead (samples) to ask for where y is late by a delay (samples)."""
        return round(self.settings["lead_samples"] + delay)

    @cached_property
    def inverse(self) -> Feedforward:
        """Inverse of the belief's hysteresis, which w is given to."""
        return hysteresis_inverse(self.belief, self.layout)

    def inverse_at_rest(self, reference_um: Array) -> Array:
        """Return the memory at rest of what w is given to, its first row the last command (V)."""
        return self.inverse.start(reference_um)

    @property
    def needed_preview(self) -> int:
        """The lead, the sample that is set, and half the window of the derivatives."""
        return self.wanted_lead + 1 + HALF

    def warning(self) -> str | None:
        """Return one line where the preview is too short for the lead, else None."""
        if self.layout.preview >= self.needed_preview:
            return None
        return f"lead cut to {self.lead} samples: preview {self.layout.preview}, {self.needed_preview} needed"

    def certificate(self) -> str:
        """Return one line on what holds whatever is estimated."""
        return (
            f"bounded by construction: the inverse is fed the reference and a correction of {self.most_um:.3g} µm "
            "at most, withdrawn while the error rings; no fixed feedback"
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        lanes = len(reference_um)
        state, of = np.zeros((self.rows.total, lanes)), self.rows.of
        of(state, "inverse")[:] = self.inverse_at_rest(reference_um)
        for name in ("measured", "wanted", "slow"):
            of(state, name)[:] = reference_um
        of(state, "fit")[:] = self.fit.start(lanes)
        of(state, "last_V")[:] = self.limits.rest_V
        of(state, "monitor")[:] = self.monitor.start(reference_um)
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Learn from y(k), answer r(k+1+lead); see :meth:`baselines.base.Baseline.next_command`."""
        measured = self.layout.measured_um(observation)
        wanted = self.wanted_um(observation, measured, reference_um[0], state)
        return self.driven(observation, wanted, state)

    def driven(self, observation: Observation, wanted_um: Array, state: Array) -> Array:
        """Return u(k+1) (V), ``(B,)``, for a w (µm) that may differ from :meth:`wanted_um`; the estimate is told."""
        shift_in(self.rows.of(state, "wanted"), wanted_um)
        return inverse_command(self.inverse, observation, wanted_um, self.rows.of(state, "inverse"))

    def wanted_um(
        self,
        observation: Observation,
        measured_um: Array,
        reference_um: Array,
        state: Array,
        learns: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Return w (µm), what the belief's inverse is to answer next, and move the memory on but for w itself."""
        of = self.rows.of
        trust, ringing = self.monitor.watch(
            of(state, "monitor"), reference_um - measured_um, reference_um
        )
        window = self.layout.reference_um(observation)
        shown = product(SPLINE, window[:, self.window].T)  # r and its derivatives
        smooth = shown[0]
        static = self._static(smooth, state)
        shift_in(of(state, "measured"), measured_um)
        fit = of(state, "fit")
        counts = ~ringing & self._is_free(observation, state)
        self._learn(state, counts if learns is None else counts & learns)
        if ringing.any():
            self.fit.unlearn(fit, np.where(ringing, trust, 1.0))
        phi = np.concatenate([shown[1:], static])
        count = len(phi)
        believed = product(self.fit.prior[:count], phi)
        learned = lane_products(self.fit.theta(fit)[:count], phi)
        learned = trust * (learned - believed)
        wanted: Array = self._value(window, smooth) + self._bounded(believed, learned)
        return wanted

    def _bounded(self, believed_um: Array, learned_um: Array) -> Array:
        """Return the correction, what is believed and what was learned beside it, within its bounds."""
        most = self.most_um
        bounded: Array = np.minimum(np.maximum(believed_um + learned_um, -most), most)
        return bounded

    def _value(self, window_um: Array, smooth_um: Array) -> Array:
        """Value of the reference that the correction is added to, from what is shown and its smoothing."""
        return smooth_um

    def _is_free(self, observation: Observation, state: Array) -> NDArray[np.bool_]:
        """Whether the last command was within its limits, so that the plant was driven by w."""
        low, high, step = self.limits
        applied, last = self.layout.command_V(observation), self.rows.of(state, "last_V")
        room = ROUNDING * (high - low)
        within: NDArray[np.bool_] = (applied > low + room) & (applied < high - room)
        free: NDArray[np.bool_] = within & (np.abs(applied - last[0]) < step - room)
        last[0] = applied
        return free

    def _static(self, smooth_um: Array, state: Array) -> Array:
        """Part of φ without derivatives, at the time of the correction; kept until y gets there."""
        plays, slow = self.rows.of(state, "plays"), self.rows.of(state, "slow")
        static: Array = _features(
            smooth_um, plays, slow, self.thresholds_um, self.slow,
            self.layout.centre_um, self.layout.scale_um,
        )  # fmt: skip
        shift_in(self.rows.of(state, "seen").reshape(*self._rings, -1), static)
        return static

    def _learn(self, state: Array, counts: NDArray[np.bool_]) -> None:
        """Take in what went in and what came out, as soon as the memory holds both."""
        count = self.rows.of(state, "count")
        count += 1.0
        begun: NDArray[np.bool_] = count[0] > self.lead + 2 * self.half + 2
        self.fit.learn(self.rows.of(state, "fit"), *self.compared(state), counts & begun)

    def compared(self, state: Array) -> tuple[Array, Array]:
        """Return what went in and what came out at k - half: φ of the measured y, and w - y (µm)."""
        of = self.rows.of
        # The newest w has the reference time k + lead, the newest static row one more.
        came = product(self.spline, of(state, "measured"))
        entered = product(self.spline[0], of(state, "wanted")[: 2 * self.half + 1])
        static = of(state, "seen").reshape(*self._rings, -1)[0]
        return np.concatenate([came[1:], static]), entered - came[0]


@njit(cache=True)
def _features(
    smooth_um: Array,
    plays: Array,
    slow: Array,
    thresholds_um: Array,
    decay: Array,
    centre_um: float,
    scale_um: float,
) -> Array:
    """Move plays and low-passes on by one sample, and return r, 1, plays, products, powers, low-passes."""
    count = 2 + len(plays) + len(PRODUCTS) + len(POWERS) + len(slow)
    found = np.empty((count, len(smooth_um)))
    for lane, r in enumerate(smooth_um):
        place = (r - centre_um) / scale_um
        found[0, lane], found[1, lane] = r, 1.0
        row = 2
        for i, threshold in enumerate(thresholds_um):
            plays[i, lane] = play(plays[i, lane], r - threshold, r + threshold)
            found[row + i, lane] = plays[i, lane]
        row += len(plays)
        for i, which in enumerate(PRODUCTS):
            found[row + i, lane] = place * (plays[which, lane] - centre_um)
        row += len(PRODUCTS)
        for i, power in enumerate(POWERS):
            found[row + i, lane] = scale_um * place**power
        row += len(POWERS)
        for i, kept in enumerate(decay):
            slow[i, lane] += (1.0 - kept) * (r - slow[i, lane])
            found[row + i, lane] = slow[i, lane]
    return found


LEAST_A0 = 0.2
"""Smallest a_0, as share of the believed one: the inverse divides by it."""
WINDOW = 3
"""Samples before the one that is led to, and at most as many after it, of the inverse's filter."""


class AdaptiveInverse(Tunable):
    """a_0 ... a_n by recursive least squares of y on u and the plays, none below zero; its inverse drives.

    The plays ξ_i run along the applied command with the believed thresholds, so y = a_0 u + Σ a_i ξ_i
    + offset is linear in what is not known. Least squares with forgetting estimate it, with the
    believed weights as prior, among weights that are not below zero and an a_0 not below a fifth of
    the believed one. y
    is late by the belief's delay, lags and mode: regressors wait as many samples as these delay a
    slow signal, and both sides are low-passed, so that a mode is not taken for hysteresis. The
    inverse with b_i and s_i of the projected weights answers the reference, read ahead through the
    belief's linear inverse; its memory is that of the plays at every sample, so that it fits
    whatever the weights have become. Rates are the reference's, over A.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> controller = AdaptiveInverse(plant, ObservationLayout.for_plant(plant, ts_s=1e-4), {})
    >>> controller.fit.size
    12

    Notes
    -----
    As the reference [13] of the paper adapts a controller online around hysteresis (Al Janaideh,
    Bernstein, ACC 2013), here by the inverse: Kuhnen, Krejčí, IEEE Trans. Autom. Control 54, 2009.
    Thresholds stay as believed: their errors enter nonlinearly, and weights of neighbouring plays
    make up for most of them.
    """

    name = "adaptive-inverse"
    aliases = ("adaptive-play-weights",)
    needs_core = RDPI
    knobs = (
        Knob("memory_s", 0.02, 5.0, 0.1, "s", logarithmic=True),
        Knob("doubt", 5e-4, 0.1, 5e-3, logarithmic=True),
        Knob("spread", 0.02, 1.0, 0.1, logarithmic=True),
        Knob("band_hz", 50.0, 2000.0, 300.0, "Hz", logarithmic=True),
    )

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        model = belief.hysteresis
        self.model = model
        ts, self._n = layout.ts_s, model.n
        delay, series = linear_inverse(belief, ts)
        self.wait = round(delay + series[1])
        ahead = round(delay)
        self.wanted_ahead = ahead + WINDOW
        later = max(0, min(self.wanted_ahead, layout.preview - 1))
        offsets = np.arange(-WINDOW, later + 1)
        self._weights = preview_weights(np.convolve(series, look_ahead(delay))[:TERMS], offsets)
        self._later = later
        self._rest_V = np.array(model.thresholds_V)[:, None]
        spread = self.settings["spread"] * model.A / (1.0 + model.n) ** 0.5
        self.fit = ForgettingLeastSquares(
            [*model.weights, belief.offset_um],
            [*[spread] * (model.n + 1), 0.025 * layout.scale_um],
            noise=self.settings["doubt"] * layout.scale_um,
            memory_s=self.settings["memory_s"],
            ts_s=ts,
            least=[LEAST_A0 * model.a0, *[0.0] * model.n, -np.inf],
        )
        self._pass = 1.0 - np.exp(-2.0 * np.pi * self.settings["band_hz"] * ts)
        plant = Plant(belief, ts)
        plant.reset(u0_V=self.limits.rest_V)
        self._at_rest = plant.memory[:, :1]
        self.rows = Rows(
            plays=model.n,
            asked=WINDOW + 1 + later,
            settled_um=1,
            waiting=(self.wait + 1) * (model.n + 1),
            passed=2 * (model.n + 2),
            fit=self.fit.rows,
            rate_V_s=1,
        )

    @property
    def needed_preview(self) -> int:
        """The sample that is set, the delay, and the later half of the filter."""
        return 1 + self.wanted_ahead

    def warning(self) -> str | None:
        """Return one line where the preview is too short for the delay and the filter, else None."""
        if self.layout.preview >= self.needed_preview:
            return None
        return f"delay and lags undone in part: preview {self.layout.preview}, {self.needed_preview} needed"

    def certificate(self) -> str:
        """Return one line on what holds whatever is estimated."""
        return (
            "a stable inverse at every sample: weights projected to a_0 > 0, a_i >= 0, where the "
            "inverse of the plays exists; no fixed feedback"
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        lanes = len(reference_um)
        state, of = np.zeros((self.rows.total, lanes)), self.rows.of
        of(state, "plays")[:] = self._at_rest
        for name in ("asked", "settled_um"):
            of(state, name)[:] = reference_um
        of(state, "fit")[:] = self.fit.start(lanes)
        resting = np.vstack([np.full((1, 1), self.limits.rest_V), self._at_rest])
        of(state, "waiting").reshape(self.wait + 1, self._n + 1, lanes)[:] = resting
        passed = of(state, "passed").reshape(2, self._n + 2, lanes)
        passed[:, :-1] = resting
        passed[:, -1] = reference_um
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Learn from y(k), answer r(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        of, ts = self.rows.of, self.layout.ts_s
        applied = self.layout.command_V(observation)
        settled_um = of(state, "settled_um")
        asked = of(state, "asked")
        shown = self.layout.reference_um(observation)
        shift_in(asked, shown[:, min(1 + self._later, self.layout.preview)])
        wanted = product(self._weights, asked)
        rate = np.abs((wanted - settled_um[0]) / (ts * self.model.A))
        settled_um[0] = wanted
        # The plays as the applied command left them, at the rate that it had.
        plays, rated = of(state, "plays"), of(state, "rate_V_s")
        reach = self._rest_V + self.model.delta2_s * rated
        np.clip(plays, applied - reach, applied + reach, out=plays)
        rated[0] = rate
        measured = self.layout.measured_um(observation)
        weights = self._estimate(state, np.vstack([applied, plays]), measured)
        u = self._inverted(wanted, rate, plays, weights)
        low, high, step = self.limits
        return np.clip(np.clip(u, low, high), applied - step, applied + step)

    def _estimate(self, state: Array, regressors: Array, measured_um: Array) -> Array:
        """Return the weights and the offset, float64[n + 2, B]."""
        of, n, lanes = self.rows.of, self._n, state.shape[1]
        waiting = of(state, "waiting").reshape(self.wait + 1, n + 1, lanes)
        shift_in(waiting, regressors)
        passed = of(state, "passed").reshape(2, n + 2, lanes)
        low = np.vstack([waiting[0], measured_um])
        for stage in passed:
            stage += self._pass * (low - stage)
            low = stage
        phi = np.vstack([low[:-1], np.ones(lanes)])
        counts = np.ones(lanes, dtype=bool)
        self.fit.learn(of(state, "fit"), phi, low[-1], counts)
        return self.fit.theta(of(state, "fit"))

    def _inverted(self, wanted_um: Array, rate_V_s: Array, plays: Array, weights: Array) -> Array:
        """Return u with a_0 u + Σ a_i ξ_i[u] + offset = w, by the plays of the inverse."""
        a, offset = weights[:-1], weights[-1]
        c = np.cumsum(a, axis=0)
        gaps = np.diff(self._rest_V, axis=0, prepend=0.0)
        y = wanted_um - offset
        shift = a[0] * self.model.delta2_s * rate_V_s
        s = np.cumsum(c[:-1] * gaps, axis=0) + shift
        behind = np.cumsum((a[1:] * plays)[::-1], axis=0)[::-1] - a[1:] * plays
        eta = np.clip(c[1:] * plays + behind, y - s, y + s)
        b = -a[1:] / (c[1:] * c[:-1])
        command: Array = y / a[0] + np.sum(b * eta, axis=0)
        return command
