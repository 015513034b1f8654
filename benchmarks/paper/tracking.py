"""One reading tracks one sine: errors over the last of three periods, by blocks of any length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.paper.readings import Chain, Reading
from rdpi_gym.plant import RDPI
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

PERIODS = 3
"""Periods simulated; errors are taken over the last."""
PERTURBATION = 1e-12
"""Relative standard deviation by which the references of an ensemble differ."""
_BLOCK = 1 << 15


@dataclass(frozen=True)
class Sine:
    """The reference y_r(k) = amplitude sin(2π f k Ts) of a plant's simulation.

    Raises
    ------
    InputError
        A period is not a whole number of samples.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_III_B
    >>> Sine("P5", PAPER_III_B, 10.0, 50.0, 1e-3).samples
    20
    """

    plant: str  # name of the parameter set
    hysteresis: RDPI  # its parameters
    amplitude_um: float  # amplitude (µm)
    # frequency (Hz) and sampling time (s); a period is a whole number of samples
    frequency_hz: float
    ts_s: float

    def __post_init__(self) -> None:
        period = 1.0 / (self.frequency_hz * self.ts_s)
        if abs(period - round(period)) > 1e-6 * period or round(period) < 4:
            raise InputError(
                f"a period of {period:g} samples at {self.frequency_hz} Hz and Ts = {self.ts_s} s; "
                "choose Ts so that it is a whole number of 4 or more"
            )

    @property
    def samples(self) -> int:
        """Samples M of a period."""
        return round(1.0 / (self.frequency_hz * self.ts_s))

    def values(self, start: int, stop: int) -> Array:
        """Reference (µm) of the samples `start` to `stop - 1`."""
        k = np.arange(start, stop)
        return np.asarray(
            self.amplitude_um * np.sin(2.0 * np.pi * self.frequency_hz * k * self.ts_s)
        )


@dataclass(frozen=True)
class Trace:
    """The last period of one realisation: time (s), reference (µm), command (V), displacement (µm)."""

    t: Array
    y_r: Array
    u: Array
    y: Array

    @property
    def error(self) -> Array:
        """Compensation error e = y_r - y (µm)."""
        return self.y_r - self.y


@dataclass(frozen=True)
class Tracking:
    """Tracking errors of one reading on one sine."""

    # what ran
    reading: Reading
    sine: Sine
    # largest and RMS error (µm) and largest rate of the command (V/s), one value a realisation;
    # the first is that of the exact reference
    max_error_um: Array
    rms_error_um: Array
    max_rate_V_s: Array
    trace: Trace | None = None  # the last period of the first realisation, where it was asked for

    @property
    def max_error(self) -> float:
        """Largest error (µm) with the exact reference."""
        return float(self.max_error_um[0])

    @property
    def rms_error(self) -> float:
        """RMS error (µm) with the exact reference."""
        return float(self.rms_error_um[0])

    @property
    def max_rate(self) -> float:
        """Largest rate of the command (V/s) with the exact reference."""
        return float(self.max_rate_V_s[0])

    @property
    def median_max_error(self) -> float:
        """Median over the realisations of the largest error (µm)."""
        return float(np.median(self.max_error_um))

    @property
    def median_rms_error(self) -> float:
        """Median over the realisations of the RMS error (µm)."""
        return float(np.median(self.rms_error_um))

    @property
    def median_max_rate(self) -> float:
        """Median over the realisations of the command's largest rate (V/s)."""
        return float(np.median(self.max_rate_V_s))

    @property
    def jump_V(self) -> float:
        """Median over the realisations of the largest change of u from sample to sample (V)."""
        return self.median_max_rate * self.sine.ts_s

    @property
    def percent(self) -> float:
        """Median of the largest error in percent of the reference's amplitude."""
        return 100.0 * self.median_max_error / self.sine.amplitude_um

    @property
    def reproducible(self) -> bool:
        """Whether realisations that differ by 1e-12 in the reference agree to 1e-9."""
        return float(np.ptp(self.max_error_um)) <= 1e-9 * self.sine.amplitude_um


def ensemble_factors(lanes: int, seed: int) -> Array:
    """Return factors 1 + 1e-12 N(0, 1) by which the references of an ensemble differ; first is 1."""
    factors = 1.0 + PERTURBATION * np.random.default_rng(seed).standard_normal(lanes)
    factors[0] = 1.0
    return factors


def track(
    reading: Reading, sine: Sine, lanes: int, seed: int, keep_trace: bool = False
) -> Tracking:
    """Simulate three periods of a sine from rest and measure the last."""
    chain = Chain(reading, sine.hysteresis, sine.ts_s, lanes)
    factors = ensemble_factors(lanes, seed)
    measured_from, end = (PERIODS - 1) * sine.samples, PERIODS * sine.samples
    largest, squares, fastest = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    kept: list[tuple[Array, Array]] = []
    before = np.zeros((1, lanes))
    u_before = np.zeros((1, lanes))
    for start in range(0, end, _BLOCK):
        stop = min(start + _BLOCK, end)
        y_r = sine.values(start, stop)[:, None] * factors
        # v(0) = 0: the reference rests at its first value before the record.
        rate = np.diff(y_r, axis=0, prepend=y_r[:1] if start == 0 else before) / sine.ts_s
        u, y = chain.advance(y_r, rate)
        skip = max(0, measured_from - start)
        if skip < stop - start:
            error = y_r[skip:] - y[skip:]
            np.maximum(largest, np.abs(error).max(axis=0), out=largest)
            squares += (error**2).sum(axis=0)
            last_u = u[skip - 1 : skip] if skip else u_before
            steps = np.abs(np.diff(u[skip:], axis=0, prepend=last_u))
            np.maximum(fastest, steps.max(axis=0), out=fastest)
            if keep_trace:
                kept.append((u[skip:, 0].copy(), y[skip:, 0].copy()))
        before, u_before = y_r[-1:], u[-1:]
    trace = None
    if keep_trace:
        u_last, y_last = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        trace = Trace(
            sine.ts_s * np.arange(sine.samples, dtype=np.float64),
            sine.values(measured_from, end),
            u_last,
            y_last,
        )
    return Tracking(
        reading, sine, largest, np.sqrt(squares / sine.samples), fastest / sine.ts_s, trace
    )
