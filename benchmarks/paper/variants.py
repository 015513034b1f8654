"""Eq. 6 on other plants: without a rate, with a band-limited rate, behind a converter and a sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from baselines.feedforward import inversion_free_polynomial, spectral_radius
from benchmarks.paper.cases import SECTION_V
from benchmarks.paper.readings import READINGS, Chain, Reading
from benchmarks.paper.tracking import PERIODS, Sine, Tracking, ensemble_factors, track
from rdpi_gym.plant import PAPER_IV_B, RDPI, Plant, named_plant


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


@dataclass(frozen=True)
class Implementation:
    """One reading on one plant that is not the literal model."""

    plant: str  # what the plant is, in words
    run: Tracking  # errors and the command's rate, 80 Hz and 40 µm


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


def implementations(lanes: int, seed: int) -> Iterator[Implementation]:
    """Run every realisable reading on each plant, 80 Hz, 40 µm, 50 µs."""
    for reading in REALISABLE:
        yield Implementation("rate of Eq. 5", track(reading, SECTION_V, lanes, seed))
    for hz in PLANT_LOWPASS_HZ:
        for reading in REALISABLE:
            run = track(replace(reading, plant_lowpass_hz=hz), SECTION_V, lanes, seed)
            yield Implementation(f"rate low-passed at {hz:g} Hz", run)
    for reading in REALISABLE:
        yield Implementation("test bench", on_bench(reading, SECTION_V, lanes, seed))
