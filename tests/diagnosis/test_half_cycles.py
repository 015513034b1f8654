"""Frequency, amplitude and direction of a command, from its reversals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rdpi_gym.diagnosis import half_cycles
from tests.looping import over


@given(
    frequency_hz=st.floats(0.1, 500.0),
    amplitude_V=st.floats(1e-3, 1e3),
    offset_V=st.floats(-100.0, 100.0),
    phase=st.floats(0.0, 6.28),
    per_period=st.floats(16.0, 1000.0),
)
def test_sine(frequency_hz, amplitude_V, offset_V, phase, per_period):
    ts_s = 1.0 / (frequency_hz * per_period)
    t = np.arange(round(5 * per_period)) * ts_s
    cycles = half_cycles(
        offset_V + amplitude_V * np.sin(2 * np.pi * frequency_hz * t + phase), ts_s
    )
    inner = slice(1, -1)
    assert cycles.whole[inner].all()
    assert 8 <= cycles.whole.sum() <= 10
    np.testing.assert_allclose(cycles.frequency_hz[inner], frequency_hz, rtol=0.02)
    np.testing.assert_allclose(cycles.amplitude_V[inner], amplitude_V, rtol=0.02)


def test_chirp_is_followed():
    t = np.arange(0.0, 10.0, 1e-3)
    cycles = half_cycles(np.sin(2 * np.pi * (1.0 * t + 0.5 * 0.9 * t**2)), 1e-3)
    middle = 0.5 * (t[cycles.edges[:-1]] + t[cycles.edges[1:] - 1])[cycles.whole]
    np.testing.assert_allclose(cycles.frequency_hz[cycles.whole], 1.0 + 0.9 * middle, rtol=0.02)


def test_amplitude_of_nested_loops():
    sizes = np.repeat([8.0, 6.0, 4.0, 2.0], 200)
    u = sizes * np.sin(2 * np.pi * np.arange(800) / 200)
    cycles = half_cycles(u, 1e-2)
    expected = [0.5 * (a + b) for a, b in [(8, 8), (8, 6), (6, 6), (6, 4), (4, 4), (4, 2), (2, 2)]]
    np.testing.assert_allclose(cycles.amplitude_V[1:-1], expected, rtol=1e-3)


def test_every_sample_is_in_one_stretch_and_directions_alternate():
    u = np.cumsum(np.random.default_rng(3).standard_normal(3000))
    cycles = half_cycles(u, 1e-3)
    assert cycles.edges[0] == 0
    assert cycles.edges[-1] == u.size
    assert np.all(np.diff(cycles.edges) > 0)
    assert np.all(cycles.rising[1:] != cycles.rising[:-1])
    ends = u[np.maximum(cycles.edges - 1, 0)]
    assert np.array_equal(np.diff(ends) > 0, cycles.rising)


def test_noise_makes_no_reversals():
    t = np.arange(4000) * 1e-3
    u = np.sin(2 * np.pi * 2.0 * t) + 0.005 * np.random.default_rng(1).standard_normal(t.size)
    cycles = half_cycles(u, 1e-3)
    assert cycles.rising.size == 17
    np.testing.assert_allclose(cycles.frequency_hz[cycles.whole], 2.0, rtol=0.15)
    assert np.mean(cycles.frequency_hz[cycles.whole]) == pytest.approx(2.0, rel=0.02)


def test_triangle():
    u = np.concatenate(
        [np.linspace(0, 1, 50, endpoint=False), np.linspace(1, 0, 50, endpoint=False)]
    )
    cycles = half_cycles(np.tile(u, 6), 1e-2)
    np.testing.assert_allclose(cycles.frequency_hz[cycles.whole], 1.0, rtol=0.02)
    np.testing.assert_allclose(cycles.amplitude_V[cycles.whole], 0.5, rtol=0.02)


def test_steps_and_holds_have_direction_but_no_frequency():
    u = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0], 100)
    cycles = half_cycles(u, 1e-3)
    assert not cycles.whole.any()
    assert cycles.rising.any()
    assert not cycles.rising.all()


@over("u, rising", [(np.arange(50.0), True), (-np.arange(50.0), False)])
def test_one_ramp_is_one_stretch(u, rising):
    cycles = half_cycles(u, 1e-3)
    assert cycles.rising.tolist() == [rising]
    assert not cycles.whole.any()


def test_constant_command():
    cycles = half_cycles(np.full(30, 2.0), 1e-3)
    assert cycles.edges.tolist() == [0, 30]
    assert not cycles.whole.any()
