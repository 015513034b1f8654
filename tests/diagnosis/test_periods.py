"""Steady periods of a command, its rests, and the harmonics of what follows it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.diagnosis import half_cycles
from rdpi_gym.diagnosis.features.cycles import harmonics, orders_off_mains, steady_periods
from rdpi_gym.diagnosis.features.recurrence import find_rests
from rdpi_gym.measurement import Record
from tests.looping import over

TS = 1e-3


def record(u, y=None):
    t = np.arange(u.size) * TS
    return Record("a", t, u, u if y is None else y, ts_s=TS)


def periods_of(u, y=None):
    r = record(u, y)
    return steady_periods(r, half_cycles(r.u_V, TS))


@settings(deadline=None)
@given(
    length=st.floats(20.0, 300.0),
    count=st.integers(4, 12),
    offset_V=st.floats(-100.0, 100.0),
    phase=st.floats(0.0, 6.28),
)
def test_period_of_a_sine_need_not_be_whole(length, count, offset_V, phase):
    k = np.arange(int(count * length) + 2)
    found = periods_of(offset_V + 3.0 * np.sin(2 * np.pi * k / length + phase))
    assert found.length == pytest.approx(length, rel=2e-3)
    assert found.count in (count - 1, count)


def test_period_of_a_multisine_is_that_of_its_basic_frequency():
    k = np.arange(5000)
    rng = np.random.default_rng(0)
    u = sum(np.sin(2 * np.pi * h * k / 1000 + rng.uniform(0, 6)) for h in (1, 3, 5, 9, 11))
    found = periods_of(u)
    assert (found.first, found.length, found.count) == (0, 1000.0, 5)


def test_equal_loops_inside_a_record_are_found():
    parts = [
        np.sin(2 * np.pi * np.arange(150) / 150 * 0.7),
        np.sin(2 * np.pi * np.arange(1000) / 100),
    ]
    u = np.concatenate([3.0 * parts[0], parts[1], 0.3 * np.linspace(0, 1, 400)])
    found = periods_of(u)
    assert found.length == pytest.approx(100.0, abs=0.5)
    assert found.count >= 7
    assert 150 <= found.first < 300


@over(
    "u",
    [
        np.linspace(0.0, 1.0, 3000),
        np.sin(2 * np.pi * (5.0 * np.arange(3000) * TS + 10.0 * (np.arange(3000) * TS) ** 2)),
        np.exp(-np.arange(3000) / 800) * np.sin(2 * np.pi * np.arange(3000) / 150),
        np.cumsum(np.random.default_rng(1).standard_normal(3000)),
        np.full(3000, 2.0),
        np.sin(2 * np.pi * np.arange(250) / 100),
    ],
)
def test_what_does_not_repeat_has_no_periods(u):
    assert periods_of(u) is None


def test_harmonics_see_through_a_drift():
    k = np.arange(4000)
    u = np.sin(2 * np.pi * k / 200)
    y = 5.0 * u + 0.2 * u**2 + 0.1 * u**3 + 3e-3 * k + 7.0
    found = harmonics(periods_of(u, y), y)
    amplitude = 2.0 * np.abs(found.mean)
    # u² = (1 - cos 2ωt) / 2, u³ = (3 sin ωt - sin 3ωt) / 4
    assert amplitude[1:5] == pytest.approx([5.075, 0.1, 0.025, 0.0], abs=1e-6)


def test_noise_of_harmonics_is_that_of_the_mean():
    k = np.arange(40_000)
    u = np.sin(2 * np.pi * k / 200)
    y = u + 0.1 * np.random.default_rng(4).standard_normal(k.size)
    periods = periods_of(u, y)
    found = harmonics(periods, y)
    # white noise: σ² / N on each line, N the samples of the periods that are used
    expected = 0.1**2 / (200 * (periods.count - 1))
    assert np.mean(found.noise[5:]) == pytest.approx(expected, rel=0.1)
    assert found.rms(np.arange(2, 90, 2))[0] < 0.01


def test_orders_off_the_mains():
    k = np.arange(4000)
    periods = periods_of(np.sin(2 * np.pi * 10.0 * k * TS))
    orders = np.arange(1, 13)
    # 50, 60, 100 and 120 Hz of the multiples of 10 Hz
    assert set(orders) - set(orders_off_mains(periods, orders)) == {5, 6, 10, 12}


def test_rests_of_stairs_with_slopes_between():
    u = np.concatenate(
        [np.zeros(50), np.linspace(0, 4, 20), np.full(80, 4.0), np.linspace(4, 1, 15), np.ones(60)]
    )
    found = find_rests(record(u), 4.0)
    assert [(r.first, r.last) for r in found] == [(0, 51), (69, 151), (164, 225)]
    assert [r.move_V for r in found] == pytest.approx([0.0, 4.0, -3.0])


def test_crest_of_a_slow_wave_is_no_rest():
    assert find_rests(record(np.sin(2 * np.pi * np.arange(200_000) / 100_000)), 2.0) == []


def test_rests_of_a_measured_command():
    rng = np.random.default_rng(5)
    u = np.repeat([0.0, 5.0, -5.0], 400) + 0.01 * rng.standard_normal(1200)
    found = find_rests(record(u), 10.0)
    assert [(r.first, r.last) for r in found] == [(0, 400), (400, 800), (800, 1200)]
