"""What repeats with the input's history is found without a learner, and so is what does not."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.features.recurrence import Trace, recurrence, unrepeated_um2
from rdpi_gym.measurement import Record

NOISE_UM = 0.05
RNG = np.random.default_rng(8)


def trace(u, follows, disturbs, ts_s=1e-3, begins_s=0.0):
    """A record and a residual with noise in it."""
    t = begins_s + np.arange(u.size) * ts_s
    left = follows + disturbs(t) + NOISE_UM * RNG.standard_normal(u.size)
    record = Record(f"from {begins_s} s", t, u, left, ts_s=ts_s)
    return Trace(record, left, record.error_mask)


def repeated(traces):
    found = recurrence(traces)
    count = found.counts.sum()
    return found.share, found.repeated.sum() / count, found.squares.sum() / count


def nothing(t):
    return np.zeros_like(t)


def force(t):
    hz = np.random.default_rng(3).uniform(20.0, 200.0, 80)
    return 0.2 * np.sqrt(2.0 / 80.0) * np.sin(2 * np.pi * np.outer(t, hz) + hz).sum(axis=1)


def wave(hz, samples=4000):
    return np.sin(2 * np.pi * hz * np.arange(samples) * 1e-3)


def random_u(seed, samples=3000):
    lines = np.random.default_rng(seed).uniform(1.0, 20.0, (2, 20))
    return np.sin(2 * np.pi * np.outer(np.arange(samples) * 1e-3, lines[0]) + lines[1]).sum(axis=1)


def test_cycles_are_split_into_what_repeats_and_what_does_not():
    u = wave(5.0)
    share, again, all_of_it = repeated([trace(u, 0.1 * wave(15.0), force)])
    assert share > 0.9
    assert again == pytest.approx(0.5 * 0.1**2, rel=0.2)
    assert all_of_it == pytest.approx(0.5 * 0.1**2 + 0.2**2 + NOISE_UM**2, rel=0.2)
    apart = unrepeated_um2([trace(u, 0.1 * wave(15.0), force)])
    assert apart.mean() == pytest.approx(0.2**2 + NOISE_UM**2, rel=0.25)


def test_a_stretch_that_another_record_goes_through_again_counts():
    u = random_u(1)
    again = [trace(u, 0.02 * u**2, nothing), trace(u, 0.02 * u**2, nothing, begins_s=10.0)]
    other = trace(random_u(2), 0.0, nothing, begins_s=20.0)
    assert recurrence([again[0], other]) is None
    share, repeats, all_of_it = repeated([*again, other])
    assert 0.4 < share < 0.7
    assert repeats == pytest.approx(all_of_it - NOISE_UM**2, rel=0.1)
    assert unrepeated_um2([*again, other]).mean() == pytest.approx(NOISE_UM**2, rel=0.1)


def test_a_slow_drift_neither_repeats_nor_differs():
    ramp = trace(wave(5.0), 0.0, lambda t: 0.5 * t)
    _, again, all_of_it = repeated([ramp])
    assert abs(again) < 0.2 * NOISE_UM**2
    assert all_of_it == pytest.approx(NOISE_UM**2, rel=0.15)
    assert unrepeated_um2([ramp]).mean() == pytest.approx(NOISE_UM**2, rel=0.15)


def test_samples_that_do_not_count_are_neither_asked_nor_compared():
    good = trace(wave(5.0), 0.0, nothing)
    counted = np.ones(4000, dtype=bool)
    counted[1500:1600] = False
    left = np.where(counted, good.residual_um, 100.0)
    record = replace(good.record, error_mask=counted)
    spiked = Trace(record, left, counted)
    assert repeated([spiked])[2] == pytest.approx(NOISE_UM**2, rel=0.15)
    assert unrepeated_um2([spiked]).max() < 2.0 * NOISE_UM**2


def test_a_single_sweep_never_comes_again():
    once = trace(np.linspace(-1.0, 1.0, 3000) ** 3, 0.0, nothing)
    assert recurrence([once]) is None
    assert unrepeated_um2([once]).size == 0
