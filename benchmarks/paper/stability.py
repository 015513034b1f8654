"""Stability limits of compensators on their own rate, the model's zero, and Eq. 6 on other plants."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from baselines.feedforward import (
    classical_polynomial,
    inversion_free_polynomial,
    spectral_radius,
)
from benchmarks.paper.claims import SECTION_V
from benchmarks.paper.tracking import (
    PERIODS,
    READINGS,
    Chain,
    Reading,
    Sine,
    Tracking,
    ensemble_factors,
    track,
)
from rdpi_gym.plant import PAPER_IV_B, RDPI, Plant, empty_state, named_plant, pack
from rdpi_gym.plant.cores.play import rdpi_block
from rdpi_gym.support.arrays import Array

SLIDE_V_S = 1000.0
"""Rate (V/s) of the ramps on which all plays slide."""
MARGIN = 0.02
"""Relative distance from the limit at which both sides are tried."""
LOOP_TS_S = (5e-5, 1.2e-3)
"""Sampling times (s) between which the growth of a disturbance is followed."""
_KICK_UM = 1e-8
_FIT_SAMPLES = 8
_LONG_SAMPLES = 6000
_LAST_BITS = 1e-15


def _ramp(reading: Reading, hysteresis: RDPI, ts_s: float, samples: int) -> Array:
    """Return y_r, u and y, [3, K, 2], on a ramp that all plays slide on; lane 1 is kicked once."""
    chain = Chain(reading, hysteresis, ts_s, lanes=2)
    start = chain.slide(SLIDE_V_S)
    k = np.arange(1, samples + 1)
    y_r = np.repeat((start + hysteresis.A * SLIDE_V_S * ts_s * k)[:, None], 2, axis=1)
    y_r[0, 1] += _KICK_UM
    u, y = chain.advance(y_r, np.zeros_like(y_r))
    return np.stack([y_r, u, y])


@dataclass(frozen=True)
class SlidingLoop:
    """Dynamics of a small disturbance of the command while all plays slide."""

    ts_s: float  # sampling time (s)
    # coefficients of z² + b z + c = 0, fitted to the simulated disturbance
    b: float
    c: float

    @property
    def growth(self) -> float:
        """Factor by which the disturbance grows from sample to sample: the larger |z|."""
        return spectral_radius(np.array([1.0, self.b, self.c]))


def sliding_loop(reading: Reading, hysteresis: RDPI, ts_s: float) -> SlidingLoop:
    """Kick the reference of a slide by 1e-8 µm and fit the loop's polynomial to what follows."""
    _, u, _ = _ramp(reading, hysteresis, ts_s, _FIT_SAMPLES)
    d = u[:, 1] - u[:, 0]
    # the kick enters at the first sample; from the third on the loop is on its own
    (b, c), *_ = np.linalg.lstsq(np.column_stack([d[2:-1], d[1:-2]]), -d[3:], rcond=None)
    return SlidingLoop(ts_s, float(b), float(c))


def predicted_loop(reading: Reading, hysteresis: RDPI, ts_s: float) -> SlidingLoop:
    """Return the polynomial that the sliding loop has by the equations."""
    inverse = reading.structure == "closed-form"
    polynomial = classical_polynomial if inverse else inversion_free_polynomial
    _, b, c = polynomial(hysteresis, ts_s)
    return SlidingLoop(ts_s, float(b), float(c))


def limit_s(reading: Reading, hysteresis: RDPI) -> float:
    """Find the sampling time (s) at which a disturbance neither grows nor decays."""
    from scipy.optimize import brentq

    delta2 = hysteresis.delta2_s
    return float(
        brentq(
            lambda ts: np.log(sliding_loop(reading, hysteresis, ts).growth),
            0.2 * delta2,
            5.0 * delta2,
            xtol=1e-6 * delta2,
        )
    )


@dataclass(frozen=True)
class Side:
    """A long slide on one side of the limit, after a kick of 1e-8 µm."""

    ts_s: float  # sampling time (s)
    growth: float  # of a small disturbance, per sample
    # largest and RMS error over the last third of the slide (µm)
    max_error_um: float
    rms_error_um: float
    max_rate_V_s: float  # largest rate of the command there (V/s)
    # peak to peak of the error there (µm): zero where the disturbance has decayed
    ripple_um: float


@dataclass(frozen=True)
class Limit:
    """A stability limit: predicted, found, and both sides of it."""

    # what was simulated
    plant: str
    reading: Reading
    # the limit (s) from the loop's polynomial, and the one found by simulation
    predicted_s: float
    found_s: float
    # long slides at a sampling time 2 % above and below the limit found
    above: Side
    below: Side
    # fitted and predicted loops over a range of sampling times
    loops: tuple[SlidingLoop, ...]
    predicted_loops: tuple[SlidingLoop, ...]

    @property
    def sides(self) -> dict[str, Side]:
        """Both sides of the limit by name."""
        return {"above": self.above, "below": self.below}

    def verdict(self, side: Side) -> str:
        """Verdict on "no condition" by one side of the limit."""
        agrees = abs(self.found_s / self.predicted_s - 1.0) < 1e-3
        source = f"limit {1e3 * self.found_s:.3f} ms" + (", as predicted" if agrees else "")
        if side.growth < 1.0 and side.ripple_um < 1e-6:
            return f"stable: disturbance shrinks {side.growth:.4f} a sample; {source}"
        return (
            f"a condition: disturbance grows {side.growth:.4f} a sample, error ripples by "
            f"{side.ripple_um:.2g}; {source}"
        )


def _side(reading: Reading, hysteresis: RDPI, ts_s: float) -> Side:
    y_r, u, y = _ramp(reading, hysteresis, ts_s, _LONG_SAMPLES)[:, -_LONG_SAMPLES // 3 :, 1]
    error = y_r - y
    return Side(
        ts_s,
        sliding_loop(reading, hysteresis, ts_s).growth,
        float(np.abs(error).max()),
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(np.diff(u)).max() / ts_s),
        float(np.ptp(error)),
    )


def stability_limit(plant: str, hysteresis: RDPI, reading: Reading) -> Limit:
    """Find a limit, look at both sides of it, and follow the growth over the sampling time."""
    found = limit_s(reading, hysteresis)
    range_s = np.geomspace(*LOOP_TS_S, 30).tolist()
    return Limit(
        plant,
        reading,
        reading.stable_from_ts_s(hysteresis),
        found,
        _side(reading, hysteresis, found * (1.0 + MARGIN)),
        _side(reading, hysteresis, found * (1.0 - MARGIN)),
        tuple(sliding_loop(reading, hysteresis, ts) for ts in range_s),
        tuple(predicted_loop(reading, hysteresis, ts) for ts in range_s),
    )


def zero_rad_s(hysteresis: RDPI) -> float:
    """Measure the model's right-half-plane zero (rad/s) on a ramp with a ripple in its rate.

    While all plays slide, y = A u - S δ2 u̇ - c: A and S δ2 are regressed from the simulated
    displacement on the command and its rate.
    """
    ts_s, samples = 1e-5, 2000
    # the ripple is slow enough that u - δ2 u̇ keeps rising and no play sticks
    t = ts_s * np.arange(samples)
    v = SLIDE_V_S * (1.0 + 0.1 * np.sin(2.0 * np.pi * 200.0 * t))
    u = ts_s * np.cumsum(v)
    state = empty_state(hysteresis.n, 1)
    state[1] = SLIDE_V_S
    state[2:, 0] = -np.asarray(hysteresis.thresholds_V) - hysteresis.delta2_s * SLIDE_V_S
    y = np.empty((samples, 1))
    rdpi_block(u[:, None], pack([hysteresis], ts_s, [0.0]), state, ts_s, y)
    (gain, lag, _), *_ = np.linalg.lstsq(
        np.column_stack([u, -v, np.ones(samples)]), y[:, 0], rcond=None
    )
    return float(gain / lag)


@dataclass(frozen=True)
class Divergence:
    """Two runs whose references differ by a relative 1e-15: how far their commands part."""

    reading: Reading  # the compensator
    t_s: Array  # time (s), ``(K,)``
    command_V: Array  # difference of the commands (V), ``(K,)``

    @property
    def largest_V(self) -> float:
        """Largest difference over the last period (V)."""
        return float(np.abs(self.command_V[-(len(self.command_V) // PERIODS) :]).max())


def divergence(reading: Reading, sine: Sine) -> Divergence:
    """Run a sine and a copy of it that is larger by a relative 1e-15."""
    samples = PERIODS * sine.samples
    y_r = sine.values(0, samples)[:, None] * np.array([1.0, 1.0 + _LAST_BITS])
    rate = np.diff(y_r, axis=0, prepend=y_r[:1]) / sine.ts_s
    u, _ = Chain(reading, sine.hysteresis, sine.ts_s, lanes=2).advance(y_r, rate)
    t = sine.ts_s * np.arange(samples, dtype=np.float64)
    return Divergence(reading, t, u[:, 1] - u[:, 0])


def identified_g() -> float:
    """Return g of the plant that was identified from the measured PICMA record."""
    return named_plant("picma").hysteresis.g


@dataclass(frozen=True)
class StaticRun:
    """Eq. 6 and the exact inverse on a plant without a rate, 80 Hz, 40 µm, 50 µs."""

    g: float  # S / a_0 of the plant, in plant and compensator
    run: Tracking  # Eq. 6 as printed.
    # the classical inverse, which is exact here: the command that Eq. 6 should find.
    smooth: Tracking

    @property
    def growth(self) -> float:
        """Factor by which a disturbance grows from sample to sample while all plays slide."""
        sine = self.run.sine
        return spectral_radius(inversion_free_polynomial(sine.hysteresis, sine.ts_s))

    @property
    def spikes(self) -> float:
        """Largest rate of the command over that of the exact inverse, median of the realisations."""
        return self.run.median_max_rate / self.smooth.max_rate

    @property
    def verdict(self) -> str:
        """Verdict on "no condition": whether the loop of Eq. 6 alone decays."""
        rate = f"command {self.spikes:.3g} times as fast as the exact inverse's"
        if self.growth < 1.0:
            return f"stable: g = {self.g:.3g} is below 1; {rate}"
        return f"a condition: g = {self.g:.3g} is above 1; {rate}"


def static_plant(g: float) -> RDPI:
    """Return the plant of Section IV-B without its rate, its plays scaled to S / a_0 = `g`."""
    a0, *plays = PAPER_IV_B.weights
    scaled = (a * g / PAPER_IV_B.g for a in plays)
    return RDPI((a0, *scaled), PAPER_IV_B.thresholds_V, 0.0)


def static_runs(lanes: int, seed: int) -> tuple[StaticRun, ...]:
    """Run Eq. 6 on static plants of several g."""
    found = []
    for g in (0.9, identified_g(), 2.0):
        sine = Sine(
            f"P10-static, g = {g:.3g}",
            static_plant(g),
            SECTION_V.amplitude_um,
            SECTION_V.frequency_hz,
            SECTION_V.ts_s,
        )
        literal = track(READINGS["literal"], sine, lanes, seed)
        exact = track(READINGS["closed-form same thresholds"], sine, 1, seed)
        found.append(StaticRun(g, literal, exact))
    return tuple(found)


REALISABLE = tuple(r for r in READINGS.values() if r.plant_rate == "own" and not r.plant_lowpass_hz)
"""Readings whose compensator needs nothing but the reference; the plant is as it is."""
PLANT_LOWPASS_HZ = (1000.0, 800.0)
_FINER = 10
"""Samples of the bench's plant in one period of its converter."""


def on_bench(reading: Reading, sine: Sine, lanes: int, seed: int) -> Tracking:
    """Run a compensator at Ts on the paper's bench: 50 µs converter, 10 nm sensor with noise.

    The plant has its rate low-passed at 800 Hz, is solved at a tenth of Ts, and the error is the
    reference less the sensor's reading at each of these instants, over the last of three periods.
    """
    chain = Chain(reading, sine.hysteresis, sine.ts_s, lanes)
    factors = ensemble_factors(lanes, seed)
    y_r = sine.values(0, PERIODS * sine.samples)[:, None] * factors
    rate = np.diff(y_r, axis=0, prepend=y_r[:1]) / sine.ts_s
    u, _ = chain.advance(y_r, rate)
    fine = replace(sine, ts_s=sine.ts_s / _FINER)
    bench = named_plant("P10-bench").with_hysteresis(
        sine.hysteresis.band_limited(PLANT_LOWPASS_HZ[-1])
    )
    y = Plant(bench, fine.ts_s, lanes).simulate(np.repeat(u, _FINER, axis=0))
    measured = bench.sensor.read(y, np.random.default_rng(seed))
    wanted = fine.values(0, PERIODS * fine.samples)[:, None] * factors
    error = (wanted - measured)[-fine.samples :]
    steps = np.abs(np.diff(u, axis=0))[-sine.samples :]
    return Tracking(
        reading,
        sine,
        np.abs(error).max(axis=0),
        np.sqrt(np.mean(error**2, axis=0)),
        steps.max(axis=0) / sine.ts_s,
    )


@dataclass(frozen=True)
class Implementation:
    """One reading on one plant that is not the literal model."""

    plant: str  # the plant, in words
    run: Tracking  # errors and the command's rate, 80 Hz and 40 µm


def implementations(lanes: int, seed: int) -> tuple[Implementation, ...]:
    """Run every realisable reading on plants other than the literal model, 80 Hz, 40 µm, 50 µs."""
    literal = [track(reading, SECTION_V, lanes, seed) for reading in REALISABLE]
    filtered = {
        f"rate low-passed at {hz:g} Hz": [
            track(replace(reading, plant_lowpass_hz=hz), SECTION_V, lanes, seed)
            for reading in REALISABLE
        ]
        for hz in PLANT_LOWPASS_HZ
    }
    bench = [on_bench(reading, SECTION_V, lanes, seed) for reading in REALISABLE]
    runs = {"rate of Eq. 5": literal, **filtered, "test bench": bench}
    return tuple(Implementation(plant, run) for plant, each in runs.items() for run in each)
