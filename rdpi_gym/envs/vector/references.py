"""The references of many lanes: sines by formula in the kernels, every other signal from a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.references import (
    FrequencyChoice,
    ReferenceChoice,
    frequency_at,
    frequency_bounds,
)
from rdpi_gym.envs.vector.begin import (
    CHOICE,
    FREQUENCY,
    SINE_AMPLITUDE,
    SINE_CENTRE,
    SINE_PHASE,
    SINE_RISE,
    Drawn,
)
from rdpi_gym.envs.vector.lanes import FIRST, NEVER, OMEGA, Integers, Lanes
from rdpi_gym.signals import Signal, Sine
from rdpi_gym.signals.base import smoothstep
from rdpi_gym.support.arrays import Array

# Phase of a sample (rad) up to which sines are had by formula: far more than samples can show.
_FASTEST_RAD = 1e3
# Samples of a table: what the single environment makes at a time, or fewer where episodes are
# shorter. NumPy may compute whole vectors otherwise than what is left over behind them, in the last
# digit: so a table that is cut is a whole number of vectors.
_CHUNK, _VECTOR = 2048, 16


class Offer(NamedTuple):
    """The references that episodes may draw."""

    choices: Sequence[ReferenceChoice]
    bounds_hz: tuple[float, float]
    table: Array  # float64[C, 5]: a row of rdpi_gym.envs.vector.begin for each choice


class References:
    """References of B lanes.

    Parameters
    ----------
    single
        An environment of the same options: it makes signals and refuses those that go too far.
    lanes
        Number of lanes B.
    tables_only
        Whether sines come from tables too, for a baseline that plans over samples.
    max_steps
        Steps of an episode.

    Attributes
    ----------
    rises : float64[R, M]
        Smooth starts, sample by sample; the first row is none.
    tables_um : float64[B, M]
        Samples of the lanes whose reference is no sine; without rows until there is one.
    due : int
        First step at which a table has no sample left to show ahead.
    """

    def __init__(
        self, single: PiezoTrackingEnv, lanes: int, tables_only: bool, max_steps: int
    ) -> None:
        self._single, self._lanes, self._tables_only = single, lanes, tables_only
        self._preview, self._ts_s = single.layout.preview, single.layout.ts_s
        self._durations_s = [0.0]
        self.rises: Array = np.ones((1, 1))
        samples = _CHUNK + self._preview
        if not tables_only:  # a plan over fewer samples may be another one
            whole = -(-(max_steps + 1 + self._preview) // _VECTOR) * _VECTOR
            samples = min(samples, whole)
        self.tables_um: Array = np.zeros((0, samples))
        self._signals: dict[int, Signal] = {}
        self._due: Integers = np.full(lanes, NEVER)
        self.due = NEVER
        source = single.references
        self.offer = self._offered(source.choices, source.frequency_hz)

    def offered(
        self, reference: ReferenceChoice | None, frequency_hz: FrequencyChoice | None
    ) -> Offer:
        """Return what episodes may draw, with what a reset gives instead.

        Raises
        ------
        InputError
            No such signal or frequency.
        """
        if reference is None and frequency_hz is None:
            return self.offer
        bounds = self.offer.bounds_hz if frequency_hz is None else frequency_bounds(frequency_hz)
        return self._offered(self.offer.choices if reference is None else (reference,), bounds)

    def begin(
        self, step: int, indices: Integers, offer: Offer, drawn: Drawn, fresh: Lanes
    ) -> Array:
        """Fill the tables of the lanes that begin and need one.

        Parameters
        ----------
        step
            Of the environment.
        indices : int64[m]
            The lanes.
        offer, drawn
            What they drew of what.
        fresh
            One block, whose sines stand.

        Returns
        -------
        float64[m, preview + 1]
            What they show first; without rows where all are sines.

        Raises
        ------
        InputError
            A reference goes farther than what can be shown.
        """
        tabled = np.flatnonzero(np.isnan(fresh.numbers[0, OMEGA, : len(indices)]))
        # All are made before one is kept: an error leaves the running episodes as they are.
        made = [self._make(offer, drawn, j) for j in tabled.tolist()]
        self._due[indices] = NEVER
        if made and not len(self.tables_um):
            self.tables_um = np.zeros((self._lanes, self.tables_um.shape[1]))
        for lane, (signal, samples_um) in zip(indices[tabled].tolist(), made, strict=True):
            self._signals[lane], self.tables_um[lane] = signal, samples_um
            self._due[lane] = step + self.tables_um.shape[1] - self._preview
        if self._signals:
            self.due = int(self._due.min())
        first = self.tables_um[indices] if made else self.tables_um[:0]
        return np.ascontiguousarray(first[:, : self._preview + 1])

    def extend(self, step: int, lanes: Lanes) -> None:
        """Fill the tables that end before what `step` shows.

        Raises
        ------
        InputError
            A reference goes farther than what can be shown.
        """
        width = lanes.state.shape[2]
        for lane in np.flatnonzero(self._due <= step).tolist():
            first = lanes.numbers[lane // width, FIRST]
            start = int(first[lane % width]) + self.tables_um.shape[1]
            self.tables_um[lane] = self._samples_um(self._signals[lane], start)
            first[lane % width] = start
            self._due[lane] += self.tables_um.shape[1]
        self.due = int(self._due.min())

    def _make(self, offer: Offer, drawn: Drawn, j: int) -> tuple[Signal, Array]:
        choice = offer.choices[min(int(drawn.choice[j]), len(offer.choices) - 1)]
        frequency = frequency_at(offer.bounds_hz, float(drawn.position[j]))
        signal = self._single.references.make(choice, frequency, int(drawn.signal_seed[j]))
        return signal, self._samples_um(signal, 0)

    def _samples_um(self, signal: Signal, start: int) -> Array:
        samples: Array = self._single.reference_um(signal, start, start + self.tables_um.shape[1])
        return samples[:, 0]

    def _offered(self, choices: Sequence[ReferenceChoice], bounds_hz: tuple[float, float]) -> Offer:
        table = np.full((len(choices), CHOICE), np.nan)
        for row, choice in zip(table, choices, strict=True):
            signal = self._single.references.make(choice, bounds_hz[0], 0)
            if (
                self._tables_only
                or type(signal) is not Sine
                or not self._fits(signal, bounds_hz[1])
            ):
                row[SINE_AMPLITUDE:] = 0.0
                continue
            given = isinstance(choice, Signal) or (
                isinstance(choice, Mapping) and "frequency_hz" in choice
            )
            row[FREQUENCY] = signal.frequency_hz if given else np.nan
            row[SINE_PHASE] = signal.phase_rad
            row[SINE_AMPLITUDE], row[SINE_CENTRE] = signal.amplitude_um, signal.offset_um
            row[SINE_RISE] = self._rise(signal.smooth_start_s)
        return Offer(choices, bounds_hz, table)

    def _fits(self, sine: Sine, highest_hz: float) -> bool:
        """Say whether a sine is sure to stay within what can be shown, and its formula exact."""
        if 2.0 * np.pi * max(sine.frequency_hz, highest_hz) * self._ts_s > _FASTEST_RAD:
            return False
        extremes = np.array(
            [0.0, sine.offset_um - sine.amplitude_um, sine.offset_um + sine.amplitude_um]
        )
        centre = self._single.layout.centre_um
        return bool(np.abs(extremes - centre).max() <= self._single.bound_um)

    def _rise(self, duration_s: float) -> int:
        """Return the row of `rises` for a smooth start of so long, made where there is none."""
        if duration_s not in self._durations_s:
            self._durations_s.append(duration_s)
            samples = max(int(np.ceil(each / self._ts_s)) for each in self._durations_s) + 2
            t: Array = self._ts_s * np.arange(samples, dtype=np.float64)
            self.rises = np.array(
                [
                    smoothstep(t / each) if each > 0.0 else np.ones(samples)
                    for each in self._durations_s
                ]
            )
        return self._durations_s.index(duration_s)
