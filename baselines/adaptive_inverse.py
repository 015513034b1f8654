"""``adaptive-inverse``: the classical inverse of weights that are estimated while it runs."""

from __future__ import annotations

import numpy as np

from baselines.base import Observation, Rows, product, shift_in
from baselines.core_inverse import POWERS, linear_inverse, look_ahead
from baselines.inverses.linear import preview_weights
from baselines.least_squares import ForgettingLeastSquares
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.support.arrays import Array

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
        self._weights = preview_weights(np.convolve(series, look_ahead(delay))[:POWERS], offsets)
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
