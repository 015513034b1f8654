"""``repetitive``: what was missing one period ago is added, within the episode."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from baselines.base import Observation
from baselines.core_inverse import (
    POWERS,
    hysteresis_inverse,
    inverse_command,
    linear_inverse,
    look_ahead,
)
from baselines.feedforward import checked_reference
from baselines.inverses.linear import preview_weights
from baselines.lanes import Rows
from baselines.loops import belief_path
from baselines.model_predictive import MODE_FACTORS, with_mode_at
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

    Parameters
    ----------
    belief, layout, settings
        As :class:`baselines.tuning.Tunable`.

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
        super().__init__(belief, layout, settings)
        self._inverse = hysteresis_inverse(belief, layout)
        delay, series = linear_inverse(belief, layout.ts_s)
        self._ahead = round(delay) + WINDOW
        offsets = np.arange(-WINDOW, self._ahead + 1)
        self._undo = preview_weights(np.convolve(series, look_ahead(delay))[:POWERS], offsets)
        self._lead = round(delay + series[1])
        self._half = max(round(HALF_S / layout.ts_s), 1)
        band = min(2.0 * self.settings["band_hz"] * layout.ts_s, 0.95)
        self._q = signal.firwin(2 * self._half + 1, band)
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
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`.

        Raises
        ------
        InputError
            There is no plan, or one for another number of episodes.
        """
        lanes = len(reference_um)
        if self._first is None:
            raise InputError(
                "there is no plan; call plan(reference_um) with the whole reference, (samples, lanes), before an episode"
            )
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
