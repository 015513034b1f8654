"""The references of many lanes: waves that kernels sample, and every other signal from a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.references import (
    FrequencyChoice,
    ReferenceChoice,
    frequency_at,
    frequency_bounds,
)
from rdpi_gym.envs.vector.lanes import BEGUN, NEVER, Integers, Lanes, aligned
from rdpi_gym.envs.vector.waves import (
    AHEAD,
    ANGLE,
    APART,
    COLUMNS,
    FIRST,
    FREQUENCY,
    HEIGHT,
    LINES,
    MIDDLE,
    MULTISINE,
    SAMPLED,
    SEED,
    SHAPE,
    SINE,
    START,
    TRIANGLE,
    Drawn,
)
from rdpi_gym.signals import Multisine, Signal, Sine, Triangle
from rdpi_gym.signals.base import smoothstep
from rdpi_gym.support.arrays import Array

# Phase of a sample (rad) up to which sines are had by formula: far more than samples can show.
_FASTEST_RAD = 1e3
# Samples of a table: what the single environment makes at a time, or fewer where episodes are
# shorter. NumPy may compute whole vectors otherwise than what is left over behind them, in the last
# digit: so a table that is cut is a whole number of vectors.
_CHUNK, _VECTOR = 2048, 16
# Lines of a multisine that kernels add up.
_MOST_LINES = 64


class Offer(NamedTuple):
    """The references that episodes may draw."""

    choices: Sequence[ReferenceChoice]
    bounds_hz: tuple[float, float]
    tabled: bool  # whether one of them is no sine
    sampled: bool  # whether Python samples one of them
    table: (
        Array  # float64[C, COLUMNS]: the waves of rdpi_gym.envs.vector.waves, one for each choice
    )


class References:
    """References of B lanes; `single`, an environment of the same options, makes signals and refuses them.

    With `tables_only` sines come from tables too, for a baseline that plans over samples.

    Attributes
    ----------
    rises : float64[R, M]
        Smooth starts, sample by sample; the first row is none.
    waves : float64[B, C]
        As :mod:`rdpi_gym.envs.vector.waves` has them.
    ahead_um : float64[N, AHEAD, W]
        Next samples of the lanes whose reference is no sine; without rows until there is one.
    tables_um : float64[B, M]
        Samples of the lanes whose reference is no wave; one row until there is one.
    due : int
        First step at which a table has no sample left to show ahead.
    """

    def __init__(
        self,
        single: PiezoTrackingEnv,
        lanes: int,
        shape: tuple[int, int],
        tables_only: bool,
        max_steps: int,
        share: int,
    ) -> None:
        self._single, self._lanes, self._tables_only = single, lanes, tables_only
        self._preview, self._ts_s = single.layout.preview, single.layout.ts_s
        self._durations_s = [0.0]
        self.rises: Array = np.ones((1, 1))
        samples = _CHUNK + self._preview
        if not tables_only:  # a plan over fewer samples may be another one
            whole = -(-(max_steps + 1 + self._preview + AHEAD) // _VECTOR) * _VECTOR
            samples = min(samples, whole)
        self._shape, self._share = shape, share
        self.ahead_um: Array = np.zeros((0, AHEAD, 1))
        self.tables_um: Array = np.zeros((1, samples))
        self.waves: Array = np.zeros((lanes, COLUMNS))
        self._signals: dict[int, Signal] = {}
        self._due: Integers = np.full(lanes, NEVER)
        self.due = NEVER
        source = single.references
        self.offer = self._offered(source.choices, source.frequency_hz)

    def offered(
        self, reference: ReferenceChoice | None, frequency_hz: FrequencyChoice | None
    ) -> Offer:
        """Return what episodes may draw, with what a reset gives instead."""
        if reference is None and frequency_hz is None:
            return self.offer
        bounds = self.offer.bounds_hz if frequency_hz is None else frequency_bounds(frequency_hz)
        return self._offered(self.offer.choices if reference is None else (reference,), bounds)

    def ready(
        self, step: int, indices: Integers, offer: Offer, drawn: Drawn, fresh: Lanes
    ) -> tuple[Any, ...]:
        """Make room for the references of lanes that begin, and fill the tables of those that need one."""
        most = COLUMNS + int(offer.table[:, LINES].max())
        if most > self.waves.shape[1]:
            wider = np.zeros((self._lanes, most))
            wider[:, : self.waves.shape[1]] = self.waves
            self.waves = wider
        if offer.tabled and not len(self.ahead_um):
            self.ahead_um = aligned((self._shape[0], AHEAD, self._shape[1]))
        if offer.sampled:
            self._sample(step, indices, offer, drawn)
        rows = (1, self._preview + 1, len(indices)) if offer.tabled else (0, 1, 1)
        return (
            step, self._share, indices, *offer.bounds_hz, offer.table, drawn.choice, drawn.position,
            drawn.signal_seed, self._ts_s, self.rises, fresh.numbers, self.waves, self.tables_um,
            self.ahead_um, np.empty(rows),
        )  # fmt: skip

    def _sample(self, step: int, indices: Integers, offer: Offer, drawn: Drawn) -> None:
        """Fill the tables of lanes that begin with a signal that is no wave."""
        # All are made before one is kept: an error leaves the running episodes as they are.
        shapes = offer.table[np.minimum(drawn.choice, len(offer.table) - 1), SHAPE]
        sampled = np.flatnonzero(shapes == SAMPLED)
        made = [self._make(offer, drawn, j) for j in sampled.tolist()]
        if len(self.tables_um) < self._lanes:
            self.tables_um = np.zeros((self._lanes, self.tables_um.shape[1]))
        self._due[indices] = NEVER
        for lane, (signal, samples_um) in zip(indices[sampled].tolist(), made, strict=True):
            self._signals[lane], self.tables_um[lane] = signal, samples_um
            self._due[lane] = step + self._covered
        self.due = int(self._due.min())

    @property
    def _covered(self) -> int:
        """Steps from the sample at which a table begins to that at which its end may be near."""
        return int(self.tables_um.shape[1]) - self._preview - AHEAD

    def extend(self, step: int, lanes: Lanes) -> None:
        """Fill the tables that end before what `step` may take of them, from that step on."""
        width = lanes.state.shape[2]
        for lane in np.flatnonzero(self._due <= step).tolist():
            if self.waves[lane, SHAPE] != SAMPLED:
                self._due[lane] = NEVER
                continue
            start = step - int(lanes.numbers[lane // width, BEGUN, lane % width])
            self.tables_um[lane] = self._samples_um(self._signals[lane], start)
            self.waves[lane, FIRST] = start
            self._due[lane] = step + self._covered
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
        rows = []
        for choice in choices:
            signal = self._single.references.make(choice, bounds_hz[0], 0)
            rows.append(self._wave(signal, bounds_hz[1]))
            if not isinstance(choice, Signal):
                given = choice if isinstance(choice, Mapping) else {}
                for column, name in ((FREQUENCY, "frequency_hz"), (SEED, "seed")):
                    if name not in given:
                        rows[-1][column] = np.nan
        table = np.array(rows)
        shapes = table[:, SHAPE]
        tabled, sampled = bool((shapes != SINE).any()), bool((shapes == SAMPLED).any())
        return Offer(choices, bounds_hz, tabled, sampled, table)

    def _wave(self, signal: Signal, highest_hz: float) -> Array:
        """Return the wave that a signal is, as one that Python samples where it is none."""
        wave = np.zeros(COLUMNS)
        wave[SHAPE] = SAMPLED
        if self._tables_only:
            return wave
        if type(signal) is Sine or type(signal) is Triangle:
            wave[SHAPE] = SINE if type(signal) is Sine else TRIANGLE
            wave[FREQUENCY], wave[ANGLE] = signal.frequency_hz, signal.phase_rad
            fastest = max(signal.frequency_hz, highest_hz)
        elif type(signal) is Multisine and signal.lines <= _MOST_LINES:
            wave[SHAPE], wave[FREQUENCY] = MULTISINE, signal.frequency_hz
            wave[SEED], wave[LINES] = signal.seed, signal.lines
            wave[APART] = 2.0 if signal.odd else 1.0
            fastest = max(signal.frequency_hz, highest_hz) * 2 * signal.lines
        else:
            return wave
        wave[HEIGHT], wave[MIDDLE] = signal.amplitude_um, signal.offset_um
        if not self._fits(signal, fastest):
            wave[SHAPE] = SAMPLED
            return wave
        wave[START] = self._rise(signal.smooth_start_s)
        return wave

    def _fits(self, signal: Signal, fastest_hz: float) -> bool:
        """Say whether a wave is sure to stay within what can be shown, and its formula exact."""
        if 2.0 * np.pi * fastest_hz * self._ts_s > _FASTEST_RAD:
            return False
        extremes = np.array(
            [0.0, signal.offset_um - signal.amplitude_um, signal.offset_um + signal.amplitude_um]
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
