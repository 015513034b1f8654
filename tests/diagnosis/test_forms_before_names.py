"""A better form of an effect comes before another name, and pays for its freedom."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.signals import DecayingSine, Sine
from rdpi_gym.signals.experiments import polyline
from rdpi_gym.virtual_lab.independent import simulate_truth

NOISE_UM = 0.012
SCALE = DataScale(0.0, 40.0, 40.0, 1e4, 1e-4, 10.0)


def records(signals, effects=(), through=lambda u: u) -> Dataset:
    rng, found, clock = np.random.default_rng(0), [], 0.0
    for name, (signal, ts, duration) in signals.items():
        t = np.arange(round(duration / ts)) * ts
        u = np.asarray(signal(t))
        y = simulate_truth(asdict(P10.hysteresis), list(effects), t + clock, through(u))
        role = "validation" if name.startswith("validation") else "train"
        y = y + NOISE_UM * rng.standard_normal(t.size)
        found.append(Record(name, t + clock, u, y, ts_s=ts, role=role))
        clock += duration + 1.0
    return Dataset("records", tuple(found))


FAST = {
    "walk": (polyline([0.0, 40.0, -40.0, 30.0, -20.0, 12.0, -8.0, 3.0, 0.0], 400.0), 1e-3, 0.8),
    "sine": (Sine(amplitude_um=40.0, frequency_hz=20.0), 2e-4, 0.3),
    "validation-sine": (DecayingSine(amplitude_um=39.0, frequency_hz=9.0, decay_s=0.3), 4e-4, 0.8),
}


def few(*names):
    return {name: CATALOGUE[name] for name in names}


def test_a_command_clipped_at_unlike_rails_is_saturation_and_nothing_else():
    data = records(FAST, through=lambda u: np.clip(u, -22.0, 19.0))
    found = discover(
        data, catalogue=few("saturation", "congruency", "asymmetry", "gain_drift", "creep")
    )
    assert [(c.effect, c.form) for c in found.added] == [("saturation", "hard rails")]
    assert found.added[0].parameters["low_V"] == pytest.approx(-22.0, abs=0.01)
    assert found.added[0].parameters["high_V"] == pytest.approx(19.0, abs=0.01)
    assert found.verdict == "explained"
    assert found.headline.startswith("Missing: saturation, hard rails (")


def steps(levels, holds):
    corners, now = [(0.0, 0.0)], 0.0
    for level, hold in zip(levels, holds, strict=True):
        corners += [(now + 0.02, level), (now + hold, level)]
        now += hold
    times, values = zip(*corners, strict=True)
    return lambda t: np.interp(t, times, values)


SLOW = {
    "stairs": (steps((20.0, 40.0, -10.0, -40.0, 15.0), (1.0, 6.0, 12.0, 3.0, 20.0)), 1e-2, 42.0),
    "sine": (Sine(amplitude_um=40.0, frequency_hz=2.0), 2e-3, 2.0),
    "validation-stairs": (steps((-30.0, 10.0, 35.0, -15.0), (8.0, 2.0, 15.0, 5.0)), 1e-2, 30.0),
}


@pytest.mark.slow
def test_creep_of_two_time_constants_is_one_effect_in_a_better_form():
    data = records(SLOW)
    rng = np.random.default_rng(3)
    creeping = []
    for record in data.records:
        y = simulate_truth(asdict(P10.hysteresis), [], record.t_s, record.u_V)
        for gain, tau in ((0.02, 0.3), (0.03, 4.0)):
            z, decay = np.empty_like(y), math.exp(-record.ts_s / tau)
            z[0] = y[0]
            for k in range(1, y.size):  # y linear from sample to sample
                slope = (y[k] - y[k - 1]) / record.ts_s
                z[k] = y[k] - slope * tau + (z[k - 1] - y[k - 1] + slope * tau) * decay
            creeping.append((gain, z))
        y = y + sum(gain * z for gain, z in creeping[-2:])
        creeping.append(replace(record, y_um=y + NOISE_UM * rng.standard_normal(y.size)))
    data = replace(data, records=tuple(r for r in creeping if isinstance(r, Record)))
    found = discover(data, catalogue=few("creep", "rate_law", "thermal_drift", "delay"))
    assert [(c.effect, c.form) for c in found.added] == [("creep", "two time constants")]
    taus = sorted(v for k, v in found.added[0].parameters.items() if k.startswith("time"))
    assert taus == pytest.approx([0.3, 4.0], rel=0.1)
    assert found.final.validation_rmse_um < 1.15 * NOISE_UM


@pytest.mark.slow
def test_a_gain_that_goes_to_and_fro_is_a_smooth_curve_and_nothing_else():
    """Two and a half turns over the experiment, of which nothing in one record tells the next."""
    wandering = []
    for record in records(SLOW).records:
        angle = 2.0 * np.pi * 2.5 * record.t_s / 77.0
        walk = 0.02 * (np.sin(angle) + 0.4 * np.sin(0.6 * angle + 1.0))
        wandering.append(replace(record, y_um=record.y_um * (1.0 + walk)))
    found = discover(
        Dataset("records", tuple(wandering)), catalogue=few("gain_drift", "thermal_drift", "creep")
    )
    assert [(c.effect, c.form) for c in found.added] == [("gain_drift", "smooth curve")]
    assert found.verdict == "explained"
