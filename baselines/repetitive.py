"""``repetitive``, ``iterative-learning``: what was missing a period ago, or in the pass before, is added."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from baselines.adaptive_feedforward import spline_weights
from baselines.base import Observation, Rows
from baselines.core_inverse import (
    TERMS,
    hysteresis_inverse,
    inverse_command,
    linear_inverse,
    look_ahead,
)
from baselines.feedforward import checked_reference
from baselines.inverses.linear import preview_weights
from baselines.loops import belief_path
from baselines.model_predictive import MODE_FACTORS, with_mode_at
from baselines.preview import NO_PLAN, Planned
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

ALIKE = 0.05
"""Largest difference of a period from the next, as share of the amplitude: a period need not be
whole samples, and what is learned is far smaller than the reference."""
HALF_S = 3e-3
"""Half the length (s) of the filter Q."""
WINDOW = 3
"""Samples on either side in the filter that undoes the belief's delay, lags and modes."""


class Repetitive(Tunable):
    """w(k) = w_0(k) + c(k), c(k) = Q [c(k - P) + γ e(k - P + lead)], P the period of the reference.

    w_0 is the reference through the belief's linear inverse, u the belief's classical inverse of w.
    As a period has passed, Q looks both ways: a low-pass of linear phase without delay, whose cut-off
    has to stay below what mode there may be, as the loop is stable where |Q (1 - γ P(z) z^lead)| < 1.
    The period is found in the reference, which :meth:`plan` is given; one without a period is
    driven by w_0 alone.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> controller = Repetitive(plant, ObservationLayout.for_plant(plant, ts_s=1e-4), {})
    >>> time = 1e-4 * np.arange(1000)
    >>> controller.plan(np.stack([np.sin(2 * np.pi * 50.0 * time), 20.0 * time], axis=1))
    >>> controller.periods.tolist()
    [200, 0]

    Notes
    -----
    Hara, Yamamoto, Omata, Nakano, IEEE Trans. Autom. Control 33, 1988; of piezo scanners Shan, Leang,
    Automatica 48, 2012.
    """

    name = "repetitive"
    knobs = (
        Knob("gain", 0.05, 1.0, 0.8),
        Knob("band_hz", 20.0, 2000.0, 120.0, "Hz", logarithmic=True),
    )

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        from scipy.signal import firwin

        super().__init__(belief, layout, settings)
        self._inverse = hysteresis_inverse(belief, layout)
        delay, series = linear_inverse(belief, layout.ts_s)
        self._ahead = round(delay) + WINDOW
        offsets = np.arange(-WINDOW, self._ahead + 1)
        self._undo = preview_weights(np.convolve(series, look_ahead(delay))[:TERMS], offsets)
        self._lead = round(delay + series[1])
        self._half = max(round(HALF_S / layout.ts_s), 1)
        band = min(2.0 * self.settings["band_hz"] * layout.ts_s, 0.95)
        self._q = firwin(2 * self._half + 1, band)
        self._first: Array | None = None

    def plan(self, reference_um: ArrayLike) -> None:
        """Take in the references of the episodes to come, and find their periods.

        Parameters
        ----------
        reference_um
            ``(K, B)``; one lane for each episode side by side, or one for all.

        Raises
        ------
        InputError
            The reference has another shape or is not finite.
        """
        reference = checked_reference(reference_um)
        before = np.repeat(reference[:1], WINDOW, axis=0)
        after = np.repeat(reference[-1:], self._ahead, axis=0)
        padded = np.concatenate([before, reference, after])
        windows = np.lib.stride_tricks.sliding_window_view(padded, len(self._undo), axis=0)
        self._first = windows @ self._undo
        found = [self._period(column) for column in reference.T]
        self.periods = np.array([period for period, _ in found])
        self._begins = np.array([begin for _, begin in found])
        held = int(self.periods.max(initial=0)) + 2 * self._half + self._lead + 2
        self._held = held
        self.rows = Rows(
            count=1,
            correction=held,
            error=held,
            inverse=len(self._inverse.start(np.zeros(1))),
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        lanes = len(reference_um)
        if self._first is None:
            raise InputError(NO_PLAN)
        state = np.zeros((self.rows.total, lanes))
        self.rows.of(state, "inverse")[:] = self._inverse.start(reference_um)
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Learn from e(k), answer r(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        assert self._first is not None
        of, lanes = self.rows.of, state.shape[1]
        lane, planned = np.arange(lanes), np.arange(lanes) % self._first.shape[1]
        count = of(state, "count")[0]
        k = count.astype(np.int64)
        corrections, errors = of(state, "correction"), of(state, "error")
        errors[k % self._held, lane] = reference_um[0] - self.layout.measured_um(observation)
        period, begins = self.periods[planned], self._begins[planned]
        then = k + 1 - period
        around = then + np.arange(-self._half, self._half + 1)[:, None]
        past = corrections[around % self._held, lane]
        missing = errors[(around + self._lead) % self._held, lane]
        learned = self._q @ (past + self.settings["gain"] * missing)
        knows = (period > 0) & (then - self._half >= begins)
        correction = np.where(knows, learned, 0.0)
        corrections[(k + 1) % self._held, lane] = correction
        count += 1.0
        wanted = self._first[np.minimum(k + 1, len(self._first) - 1), planned] + correction
        return inverse_command(self._inverse, observation, wanted, of(state, "inverse"))

    def certificate(self) -> str | None:
        """Return what the small-gain theorem says of the loop, a mode elsewhere included, else None."""
        ts, z = self.layout.ts_s, np.exp(1j * np.linspace(1e-3, math.pi, 3000))
        turns = np.arange(-self._half, self._half + 1)
        q = np.exp(1j * np.outer(np.angle(z), turns)) @ self._q
        left = 0.0
        for factor in (1.0, *MODE_FACTORS):
            for path in belief_path(with_mode_at(self.belief, factor), ts).extremes:
                answer = self.settings["gain"] * z**self._lead * path.response(z)
                left = max(left, float(np.abs(q * (1.0 - answer)).max()))
        if left >= 1.0:
            return None
        low, high = min(MODE_FACTORS), max(MODE_FACTORS)
        return (
            f"small gain: a period leaves at most {left:.3g} of the last one's error, with a mode of {low} "
            f"to {high} times the believed frequency, as far as the loop is linear"
        )

    def _period(self, reference: Array) -> tuple[int, int]:
        """Samples of the period, 0 for none, and where the periodic part begins."""
        last, least = len(reference), 2 * self._half + self._lead + 2
        begin = last // 5
        tail = reference[begin:]
        enough = 0.5 * ALIKE * float(np.ptp(tail))
        for period in range(least, len(tail) * 2 // 3):
            if abs(tail[period] - tail[0]) > enough:
                continue
            apart = np.abs(tail[period:] - tail[:-period])
            if apart.max() < enough:
                return self._best_near(tail, period), begin
        return 0, begin

    @staticmethod
    def _best_near(tail: Array, period: int) -> int:
        """Go on to where neighbouring periods fit best."""

        def apart(p: int) -> float:
            return float(np.mean(np.square(tail[p:] - tail[:-p])))

        while period + 1 < len(tail) - 1 and apart(period + 1) < apart(period):
            period += 1
        return period


# Error of the inverse model as share of the scale, and time constant (s) of what it may have to undo.
_DOUBT, _DYNAMICS_S = 1e-3, 3e-4
# Samples beyond the believed delay, for what a lag delays besides; samples of a derivative, less one:
# with delay, lag and mode the inverse has more than three derivatives that matter at a mode.
_AHEAD = 1
_ORDER = 6
_SPLINE = spline_weights(_ORDER)
# The inverse model is fitted to what lies above (Hz): below, hysteresis is most of the residual.
_FIT_HZ = 200.0


class IterativeLearning(Tunable, Planned):
    """w_{p+1} = w_p + γ F[e_p + θ_p · (e_p', e_p'', ...)] after pass p, u = the belief's inverse of w.

    F is a low-pass run forwards and backwards, so without phase. θ_p undoes delay, lag and mode; it
    is fitted after each pass by least squares of what went in, w_p, on the measured displacement
    and its derivatives, so a mode elsewhere than believed costs no stability. Where a pass was
    worse than the best one, the best is gone on from with half the gain.

    The protocol: :meth:`plan` with the reference of the pass, then a run from rest, then
    :meth:`learn`; a :meth:`plan` with another reference begins anew. Within a pass nothing is fed
    back.

    Attributes
    ----------
    repeats : bool
        It sees the reference again: scored in a track of its own.

    Examples
    --------
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> plant = named_plant("P10")
    >>> learner = IterativeLearning(plant, ObservationLayout.for_plant(plant, ts_s=1e-4), {})
    >>> r = 20.0 * np.sin(2 * np.pi * 50.0 * 1e-4 * np.arange(600))[:, None]
    >>> errors = []
    >>> for _ in range(4):
    ...     u = learner.plan(r)
    ...     y = Plant(plant, 1e-4).simulate(u)
    ...     learner.learn(r, y, u)
    ...     errors.append(float(np.sqrt(np.mean((r - y) ** 2))))
    >>> errors[-1] < 0.5 * errors[0]
    True

    Notes
    -----
    Bristow, Tharayil, Alleyne, A survey of iterative learning control, IEEE Control Syst. Mag. 26,
    2006; of piezo scanners Leang, Devasia, Mechatronics 16, 2006.
    """

    name = "iterative-learning"
    repeats = True
    knobs = (
        Knob("gain", 0.1, 1.5, 0.8),
        Knob("band_hz", 50.0, 3000.0, 1000.0, "Hz", logarithmic=True),
    )

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        from scipy.signal import butter

        super().__init__(belief, layout, settings)
        self._inverse = hysteresis_inverse(belief, layout)
        delay, series = linear_inverse(belief, layout.ts_s)
        self._lead = round(delay) + _AHEAD
        self._prior = np.convolve(series, look_ahead(delay - self._lead, _ORDER))[1:_ORDER]
        band = min(self.settings["band_hz"] * layout.ts_s * 2.0, 0.95)
        self._low_pass = butter(2, band, output="sos")
        fit_band = min(_FIT_HZ * layout.ts_s * 2.0, 0.5)
        self._high_pass = butter(2, fit_band, btype="highpass", output="sos")
        self._reference: Array | None = None

    def _commands(self, reference_um: Array) -> Array:
        if self._reference is None or not np.array_equal(self._reference, reference_um):
            self._reference = reference_um.copy()
            lanes = reference_um.shape[1]
            self._wanted = self._first(reference_um)
            self._best, self._least = self._wanted.copy(), np.full(lanes, np.inf)
            self._step = np.zeros_like(self._wanted)
            self._gain = np.full(lanes, self.settings["gain"])
        state = self._inverse.start(self._reference[0])
        commands = self._inverse.command_block(self._wanted, state)
        commands[0] = self.limits.rest_V
        return commands

    def learn(self, reference_um: ArrayLike, measured_um: ArrayLike, command_V: ArrayLike) -> None:
        """Take in what a pass left, for the next :meth:`plan` of the same reference.

        Parameters
        ----------
        reference_um, measured_um, command_V
            Reference and reading (µm) and applied command (V), ``(K, B)`` each.

        Raises
        ------
        InputError
            A shape is another one, a value is not finite, or the reference is not the planned one.
        """
        reference, measured = checked_reference(reference_um), checked_reference(measured_um)
        if self._reference is None or not np.array_equal(reference, self._reference):
            raise InputError(
                "learn is called for another reference than was planned; plan it first"
            )
        if measured.shape != reference.shape:
            raise InputError(
                f"readings of shape {measured.shape} for a reference of {reference.shape}; give as many"
            )
        error = reference - measured
        rms = np.sqrt(np.mean(error**2, axis=0))
        better = rms < self._least
        self._least = np.where(better, rms, self._least)
        self._best[:, better] = self._wanted[:, better]
        update = self._update(error, measured)
        self._step[:, better] = update[:, better]
        self._gain[~better] *= 0.5
        self._wanted = self._best + self._gain * self._step

    def _first(self, reference_um: Array) -> Array:
        """Return the first pass by the belief."""
        values, *derivatives = _derivatives(reference_um)
        wanted = values + np.einsum("f,fkb->kb", self._prior, np.array(derivatives))
        return _earlier(wanted, self._lead)

    def _update(self, error_um: Array, measured_um: Array) -> Array:
        """Return the correction of w for an error, by the inverse model that fits this pass."""
        from scipy.signal import sosfiltfilt

        smooth, *rates = _derivatives(measured_um)
        entered = _later(_derivatives(self._wanted)[0], self._lead)
        shown = np.array([*rates, smooth, entered])
        *phi_rows, target = sosfiltfilt(self._high_pass, shown, axis=1)
        phi = np.array(phi_rows)
        target = target - phi[-1]
        samples = self.layout.scale_um * _DOUBT
        dynamics = _DYNAMICS_S / self.layout.ts_s
        spread = np.array([*(dynamics**q for q in range(1, _ORDER)), 0.1])
        precision = np.diag((samples / spread) ** 2)
        prior = np.array([*self._prior, 0.0])
        left = np.einsum("fkb,gkb->bfg", phi, phi) / len(smooth) + precision
        right = np.einsum("fkb,kb->bf", phi, target) / len(smooth) + precision @ prior
        theta = np.linalg.solve(left, right[:, :, None])[:, :-1, 0]
        value, *changes = _derivatives(error_um)
        wanted = value + np.einsum("bf,fkb->kb", theta, np.array(changes))
        low: Array = sosfiltfilt(self._low_pass, wanted, axis=0)
        return _earlier(low, self._lead)


def _derivatives(block: Array) -> Array:
    """Value and derivatives per sample of a block (K, B), float64[_ORDER, K, B]."""
    padded = np.pad(block, ((_ORDER // 2,) * 2, (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _ORDER + 1, axis=0)
    derivatives: Array = np.einsum("dw,kbw->dkb", _SPLINE, windows)
    return derivatives


def _earlier(block: Array, samples: int) -> Array:
    return np.concatenate([block[samples:], np.repeat(block[-1:], samples, axis=0)])


def _later(block: Array, samples: int) -> Array:
    return np.concatenate([np.repeat(block[:1], samples, axis=0), block[: len(block) - samples]])
