"""The numerical floor of a verdict, and the tests that see an effect without a model."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.diagnosis.search.verdict import numerical_floor
from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.virtual_lab import Truth, simulate_dataset

NOISE_UM = 0.012
BARE = Variant(P10.hysteresis, ())
BENT = Variant(P10.hysteresis, (CATALOGUE["asymmetry"](0.02, 40.0),))


def record(name, variant, u, ts_s=1e-3, seed=0, role="train", t0=0.0):
    t = t0 + np.arange(u.size) * ts_s
    still = Record(name, t, u, np.zeros_like(u), ts_s=ts_s, role=role)
    noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
    return replace(still, y_um=simulate_effects([variant], still)[:, 0] + noise)


def sine(amplitude_V, frequency_hz, samples=2000, ts_s=1e-3, phase=0.0):
    return amplitude_V * np.sin(2 * np.pi * frequency_hz * np.arange(samples) * ts_s + phase)


def test_the_numerical_floor_falls_with_the_square_of_the_sampling_time():
    mode = Variant(P10.hysteresis, (CATALOGUE["resonance"](60.0, 0.1),))
    slow, fast = (
        record("run", mode, sine(30.0, 9.0, n, ts), ts) for n, ts in ((1000, 2e-3), (4000, 5e-4))
    )
    floors = [numerical_floor(mode, [each]) for each in (slow, fast)]
    assert floors[0].step_um / floors[1].step_um == pytest.approx(16.0, rel=0.25)
    finer = simulate_between(mode, fast, 8) - simulate_effects([mode], fast)[:, 0]
    assert floors[1].step_um == pytest.approx(np.std(finer) * 64.0 / 63.0, rel=0.03)
    assert floors[0].needed_hz(0.01 * floors[0].total_um) > 500.0
    assert numerical_floor(BARE, [record("run", BARE, sine(30.0, 9.0))]).total_um == 0.0


def test_what_a_check_suggests_is_an_effect_of_the_catalogue():
    checks = run_checks(simulate_dataset(Truth(P10, (), NOISE_UM, 3)))
    suggested = {name for check in checks for name in check.suggests}
    assert suggested
    assert suggested <= set(CATALOGUE)
