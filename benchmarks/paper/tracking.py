"""Readings of Eq. 6 and of the classical inverse, and their tracking errors on a sine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from baselines.classical import classical_own_rate, pack_inverse
from baselines.inversion_free import inversion_free_given_rate, inversion_free_own_rate
from rdpi_gym.plant import RDPI, empty_state, pack
from rdpi_gym.plant.cores.play import given_rate_block, rdpi_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

LOWPASS_HZ = 500.0
"""Cut-off (Hz) of the low-passed readings."""


@dataclass(frozen=True)
class Reading:
    """One way to read the paper's compensators."""

    name: str  # what tables call it
    # ``none`` (u = y_r), ``inversion-free`` (Eq. 6) or ``closed-form`` (the classical inverse).
    structure: Literal["none", "inversion-free", "closed-form"]
    # rate that sets the compensator's thresholds: of its ``own`` command one sample ago, of the
    # ``reference``, or of the ``reference/A``
    rate: Literal["own", "reference", "reference/A"]
    says: str  # the reading in a sentence
    # rate that sets the plant's: its ``own`` command's, or ``given``, the compensator's
    plant_rate: Literal["own", "given"] = "own"
    # cut-off (Hz) of a first-order low-pass on the own rate; None is Eq. 5 as printed.
    compensator_lowpass_hz: float | None = None
    plant_lowpass_hz: float | None = None

    @property
    def runs_on_own_rate(self) -> bool:
        """Whether the compensator feeds its own rate back, so that it is a loop."""
        return self.structure != "none" and self.rate == "own"

    def stable_from_ts_s(self, hysteresis: RDPI) -> float:
        """Sampling time (s) above which the loop of an unfiltered own rate decays; else 0.

        With all plays sliding, Eq. 6 is z² + g (1 - q) z + g q = 0, q = δ2 / Ts, and the closed
        form z² - h z + h = 0, h = S δ2 / (A Ts).
        """
        if not self.runs_on_own_rate or self.compensator_lowpass_hz is not None:
            return 0.0
        if self.structure == "inversion-free":
            return hysteresis.g * hysteresis.delta2_s
        return 1.0 / hysteresis.zero_rad_s


_ALL = (
    Reading("none", "none", "own", "no compensation, u = y_r"),
    Reading(
        "literal",
        "inversion-free",
        "own",
        "Eq. 6 as printed: thresholds from the rate v(k-1) of its own command, Eq. 5",
    ),
    Reading(
        "given",
        "inversion-free",
        "reference",
        "Eq. 6 with given thresholds: r_i(t) is one function of time, from the rate of y_r, "
        "in plant and compensator (the wording of Section II)",
        plant_rate="given",
    ),
    Reading(
        "low-passed in both",
        "inversion-free",
        "own",
        f"Eq. 6 with its own rate low-passed at {LOWPASS_HZ:g} Hz, on a plant whose rate is too",
        compensator_lowpass_hz=LOWPASS_HZ,
        plant_lowpass_hz=LOWPASS_HZ,
    ),
    Reading(
        "low-passed",
        "inversion-free",
        "own",
        f"Eq. 6 with its own rate low-passed at {LOWPASS_HZ:g} Hz, on the plant of Eq. 5",
        compensator_lowpass_hz=LOWPASS_HZ,
    ),
    Reading(
        "reference-rate/A",
        "inversion-free",
        "reference/A",
        "Eq. 6 with the rate of y_r over A, on the plant of Eq. 5",
    ),
    Reading(
        "closed-form reference-rate/A",
        "closed-form",
        "reference/A",
        "classical inverse with the rate of y_r over A, on the plant of Eq. 5",
    ),
    Reading(
        "closed-form reference-rate",
        "closed-form",
        "reference",
        "classical inverse with the rate of y_r, on the plant of Eq. 5",
    ),
    Reading(
        "closed-form own-rate",
        "closed-form",
        "own",
        "classical inverse with the rate of its own command, one sample old",
    ),
    Reading(
        "closed-form same thresholds",
        "closed-form",
        "reference",
        "classical inverse with one function of time as thresholds in plant and compensator",
        plant_rate="given",
    ),
)

READINGS: dict[str, Reading] = {reading.name: reading for reading in _ALL}


class Chain:
    """A compensator and a plant behind it, lane by lane, with the memory of both.

    The same model is in compensator and plant, as the reading has it.
    """

    def __init__(self, reading: Reading, hysteresis: RDPI, ts_s: float, lanes: int) -> None:
        self._reading = reading
        self._hysteresis = hysteresis
        self._ts_s = ts_s
        self._scale = 1.0 / hysteresis.A if reading.rate == "reference/A" else 1.0
        model = hysteresis.band_limited(reading.compensator_lowpass_hz)
        plant = hysteresis.band_limited(reading.plant_lowpass_hz)
        if reading.structure == "closed-form":
            self._compensator = pack_inverse([model] * lanes, ts_s)
        else:
            self._compensator = pack([model] * lanes, ts_s, [0.0] * lanes)
        self._plant = pack([plant] * lanes, ts_s, [0.0] * lanes)
        self._compensator_state = self._rest(hysteresis.n, lanes)
        self._plant_state = self._rest(hysteresis.n, lanes)

    @staticmethod
    def _rest(n: int, lanes: int) -> Array:
        state = empty_state(n, lanes)
        state[0] = np.nan  # the record begins with the next sample: v(0) = 0
        return state

    def slide(self, rate_V_s: float) -> float:
        """Put all lanes where all plays have slid for long, at u(-1) = 0 V and a constant rate."""
        p, n = self._plant, self._hysteresis.n
        r = p[n + 1 : 2 * n + 1] + self._hysteresis.delta2_s * rate_V_s
        self._plant_state[0], self._plant_state[1], self._plant_state[2:] = 0.0, rate_V_s, -r
        y_r = -float(p[1 : n + 1, 0] @ r[:, 0])
        if self._reading.structure == "closed-form":
            s = self._compensator[n + 1 : 2 * n + 1] + self._compensator[2 * n + 1] * rate_V_s
            self._compensator_state[0], self._compensator_state[1] = 0.0, rate_V_s
            self._compensator_state[2:] = y_r - s
            return y_r
        self._compensator_state[:] = self._plant_state
        return y_r - self._hysteresis.S * rate_V_s * self._ts_s  # Ω is one sample late

    def advance(self, y_r: Array, rate: Array) -> tuple[Array, Array]:
        """Run a block of the reference."""
        v = rate * self._scale
        u = self._command(y_r, v)
        y = np.empty_like(u)
        if self._reading.plant_rate == "given":
            given_rate_block(u, v, self._plant, self._plant_state, y)
        else:
            rdpi_block(u, self._plant, self._plant_state, self._ts_s, y)
        return u, y

    def _command(self, y_r: Array, v: Array) -> Array:
        p, state = self._compensator, self._compensator_state
        u = np.empty_like(y_r)
        match self._reading.structure, self._reading.rate:
            case "none", _:
                u[:] = y_r
            case "inversion-free", "own":
                inversion_free_own_rate(y_r, p, state, self._ts_s, u)
            case "inversion-free", _:
                inversion_free_given_rate(y_r, v, p, state, u)
            case _, "own":
                classical_own_rate(y_r, p, state, self._ts_s, u)
            case _:
                given_rate_block(y_r, v, p, state, u)
        return u


PERIODS = 3
"""Periods simulated; errors are taken over the last."""
PERTURBATION = 1e-12
"""Relative standard deviation by which the references of an ensemble differ."""
_BLOCK = 1 << 15


@dataclass(frozen=True)
class Sine:
    """The reference y_r(k) = amplitude sin(2π f k Ts) of a plant's simulation."""

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
