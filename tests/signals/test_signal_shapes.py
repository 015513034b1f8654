"""What makes each signal that signal."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.signals import (
    BandLimitedNoise,
    Chirp,
    Constant,
    DecayingSine,
    LaplaceProcess,
    Multisine,
    NestedLoops,
    RandomSteps,
    Raster,
    RasterSlowRamp,
    RasterSlowStairs,
    Sawtooth,
    Sequence,
    Sine,
    Steps,
    Sum,
    Triangle,
    WienerProcess,
    first_order_reversals,
)
from tests.looping import over


def lines_of(signal, frequencies_hz):
    """Amplitudes of a signal's lines, from its samples over one period."""
    count = 8192
    t = np.arange(count) / count * signal.period_s
    spectrum = 2.0 * np.abs(np.fft.rfft(signal(t))) / count
    index = np.rint(np.asarray(frequencies_hz) * signal.period_s).astype(int)
    rest = spectrum.copy()
    rest[index] = 0.0
    return spectrum[index], rest.max()


def test_the_value_is_window_times_offset_plus_amplitude_times_shape():
    t = 0.03
    s = t / 0.1
    window = 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5
    signal = Sine(amplitude_um=4.0, offset_um=7.0, frequency_hz=3.0, smooth_start_s=0.1)
    assert signal(t) == pytest.approx(window * (7.0 + 4.0 * np.sin(6.0 * np.pi * t)), rel=1e-12)


def test_derivatives_at_corners_are_those_to_the_right():
    assert Triangle(frequency_hz=1.0).derivative([0.25, 0.75]) == pytest.approx([-4.0, 4.0])
    assert Triangle(frequency_hz=10.0).derivative(0.1 * 3 + 0.025) == pytest.approx(-40.0)
    forc = NestedLoops(turning_points=(1.0, -1.0), frequency_hz=1.0)
    assert forc.derivative([0.25, 0.75]) == pytest.approx([-4.0, 4.0])
    walk = WienerProcess(interval_s=0.1, duration_s=1.0, spread_s=50.0)
    np.testing.assert_allclose(
        walk.derivative(np.arange(20) * 0.1), walk.derivative(np.arange(20) * 0.1 + 0.05)
    )


def test_a_sawtooth_jumps_where_its_flyback_takes_no_time():
    jump = Sawtooth(frequency_hz=1.0)
    assert jump([0.5 - 1e-6, 0.5]) == pytest.approx([1.0, -1.0], abs=1e-5)
    slow = Sawtooth(frequency_hz=1.0, flyback_fraction=0.2)
    assert slow([0.4, 0.5, 0.6]) == pytest.approx([1.0, 0.0, -1.0])
    assert slow.derivative([0.0, 0.5]) == pytest.approx([2.5, -10.0])


@settings(deadline=None)
@given(
    trace=st.floats(0.1, 0.9),
    part=st.floats(0.01, 1.0),
    cycle=st.floats(0.0, 3.0),
)
def test_a_rounded_raster_turns_at_constant_acceleration(trace, part, cycle):
    turnaround = part * min(trace, 1.0 - trace)
    scan = Raster(frequency_hz=1.0, trace_fraction=trace, turnaround_fraction=turnaround)
    up = scan.derivative(0.5 * trace)
    down = scan.derivative(0.5 * (1.0 + trace))
    assert up * trace == pytest.approx(-down * (1.0 - trace))
    limit = (up - down) / turnaround
    h = 1e-3 * turnaround
    bend = (scan.derivative(cycle + h) - scan.derivative(cycle)) / h
    assert abs(bend) <= limit * (1.0 + 1e-6)
    assert abs(scan(cycle)) <= 1.0 + 1e-12


def test_a_sharp_raster_between_its_corners():
    scan = Raster(frequency_hz=2.0, trace_fraction=0.8, turnaround_fraction=0.0)
    assert scan([0.0, 0.2, 0.4, 0.45, 0.5]) == pytest.approx([-1.0, 0.0, 1.0, 0.0, -1.0])


def test_the_slow_axis_takes_one_frame_up_and_one_down():
    lines = 5
    stairs = RasterSlowStairs(frequency_hz=10.0, lines=lines)
    levels = stairs((np.arange(2 * lines) + 0.5) * 0.1)
    np.testing.assert_allclose(levels[:lines], np.linspace(-1.0, 1.0, lines))
    np.testing.assert_allclose(levels[lines:], levels[:lines][::-1])
    ramp = RasterSlowRamp(frequency_hz=10.0, lines=lines)
    np.testing.assert_allclose(ramp([0.0, 0.5, 1.0]), [-1.0, 1.0, -1.0])


def test_steps_hold_and_repeat():
    stairs = Steps(levels=[0.0, 1.0, -0.5], hold_s=0.1, amplitude_um=10.0)
    t = np.arange(6) * 0.1
    np.testing.assert_allclose(stairs(t), [0.0, 10.0, -5.0] * 2)
    np.testing.assert_allclose(stairs(t + 0.0999), [0.0, 10.0, -5.0] * 2)
    assert not stairs.has_derivative
    assert not stairs.derivative(t).any()


def test_risen_steps_reach_the_next_level_when_its_hold_begins():
    soft = Steps(levels=(0.0, 1.0), hold_s=0.1, rise_s=0.04)
    assert soft([0.05, 0.08, 0.1, 0.15]) == pytest.approx([0.0, 0.5, 1.0, 1.0])
    assert soft.derivative(0.08) == pytest.approx(15.0 / 8.0 / 0.04)


def test_random_steps_fill_the_range_evenly():
    levels = RandomSteps(count=20_000, hold_s=1.0, seed=2)(np.arange(20_000) + 0.5)
    shares, _ = np.histogram(levels, bins=10, range=(-1.0, 1.0))
    assert shares.sum() == 20_000
    assert np.abs(shares - 2000).max() < 5.0 * np.sqrt(2000)


@over("sweep", ["linear", "logarithmic"])
def test_a_chirp_goes_through_its_frequencies_and_stays(sweep):
    chirp = Chirp(start_hz=2.0, stop_hz=32.0, duration_s=4.0, sweep=sweep)
    half = 17.0 if sweep == "linear" else 8.0
    assert chirp.instantaneous_hz([0.0, 2.0, 4.0, 9.0]) == pytest.approx([2.0, half, 32.0, 32.0])
    t = np.linspace(0.0, 6.0, 600_001)
    crossings = t[1:][np.diff(np.signbit(chirp(t)).astype(int)) < 0]
    periods = np.diff(crossings)
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    np.testing.assert_allclose(1.0 / periods, chirp.instantaneous_hz(middle), rtol=0.03)


def test_a_decaying_sine_shrinks_by_the_same_ratio():
    t = np.linspace(0.0, 0.5, 101)
    spiral = DecayingSine(frequency_hz=2.0, decay_s=1.5)
    np.testing.assert_allclose(spiral(t + 0.5), np.exp(-0.5 / 1.5) * spiral(t), atol=1e-13)


def test_first_order_reversals_return_to_the_top_at_one_rate():
    loops = 4
    forc = NestedLoops(
        turning_points=first_order_reversals(loops), frequency_hz=2.0, amplitude_um=10.0
    )
    t = np.linspace(0.0, forc.period_s, 400_000, endpoint=False)
    assert forc.derivative(0.0) == pytest.approx(80.0)
    np.testing.assert_allclose(np.abs(forc.derivative(t)), 80.0)
    y = forc(t)
    turn = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
    highs, lows = y[turn[0::2]], y[turn[1::2]]
    np.testing.assert_allclose(highs, 10.0, atol=1e-3)
    np.testing.assert_allclose(lows, [5.0, 0.0, -5.0, -10.0], atol=1e-3)
    assert forc(0.0) == 0.0


def test_turning_points_off_zero_start_nearest_to_it():
    loops = NestedLoops(turning_points=(0.8, 0.2), frequency_hz=1.0)
    assert loops(0.0) == pytest.approx(0.2)
    assert loops(0.15) == pytest.approx(0.8)
    assert loops.period_s == pytest.approx(0.3)


@settings(deadline=None)
@given(lines=st.integers(1, 60), odd=st.booleans(), seed=st.integers(0, 10_000))
def test_a_multisine_has_equal_lines_and_its_amplitude_as_peak(lines, odd, seed):
    signal = Multisine(frequency_hz=3.0, lines=lines, odd=odd, seed=seed, amplitude_um=5.0)
    sizes, rest = lines_of(signal, signal.lines_hz)
    rms = 5.0 / signal.crest_factor
    np.testing.assert_allclose(sizes, rms * np.sqrt(2.0 / lines), rtol=1e-9)
    assert rest < 1e-9
    harmonics = signal.lines_hz / 3.0
    np.testing.assert_allclose(harmonics, (1 + odd) * np.arange(lines) + 1.0)
    t = np.arange(20_000) / 20_000 / 3.0
    step = np.pi * harmonics[-1] / 20_000  # half a sample, as phase of the highest line
    peak = np.abs(signal(t)).max()
    assert 5.0 * (1.0 - 0.5 * step**2) <= peak <= 5.0 * (1.0 + 1e-9)


@over("low, high, count", [(0.3, 20.0, 198), (0.0, 5.0, 50)])
def test_noise_keeps_to_its_band(low, high, count):
    noise = BandLimitedNoise(low_hz=low, high_hz=high, repeat_s=10.0, seed=6)
    assert noise.lines_hz.size == count
    sizes, rest = lines_of(noise, noise.lines_hz)
    assert np.ptp(sizes) < 1e-9 < sizes.min()
    assert rest < 1e-9


@over("process, kurtosis", [(WienerProcess, 3.0), (LaplaceProcess, 6.0)])
def test_increments_of_the_processes(process, kurtosis):
    """Standard deviation amplitude √(interval / spread); kurtosis of the distribution."""
    grid, count = 1e-3, 100_000
    walk = process(interval_s=grid, spread_s=1e7, duration_s=grid * count, amplitude_um=10.0)
    increments = np.diff(walk(np.arange(count + 1) * grid))
    assert increments.std() == pytest.approx(10.0 * np.sqrt(grid / 1e7), rel=0.02)
    assert np.mean((increments / increments.std()) ** 4) == pytest.approx(kurtosis, rel=0.1)


@over("process", [WienerProcess, LaplaceProcess])
def test_walks_are_reflected_linear_between_the_grid_and_retraced(process):
    walk = process(interval_s=0.1, spread_s=0.2, duration_s=50.0, seed=9)
    grid = np.arange(501) * 0.1
    knots = walk(grid)
    assert knots[0] == 0.0
    assert np.abs(knots).max() <= 1.0
    assert np.abs(knots).max() > 0.95
    np.testing.assert_allclose(walk(grid[:-1] + 0.03), 0.7 * knots[:-1] + 0.3 * knots[1:])
    np.testing.assert_allclose(walk(100.0 - grid), knots, atol=1e-9)


@over("process", [WienerProcess, LaplaceProcess])
def test_a_longer_walk_goes_on_from_a_shorter_one(process):
    t = np.linspace(0.0, 10.0, 501)
    short, long = process(duration_s=10.0, seed=1), process(duration_s=90.0, seed=1)
    np.testing.assert_allclose(short(t), long(t), atol=1e-9)


def test_a_sum_adds_and_knows_its_period():
    sine, triangle = Sine(frequency_hz=4.0), Triangle(frequency_hz=6.0, offset_um=2.0)
    both = Sum(parts=[sine, triangle, Constant(offset_um=1.0)], amplitude_um=3.0)
    t = np.linspace(0.0, 1.0, 77)
    np.testing.assert_allclose(both(t), 3.0 * (sine(t) + triangle(t) + 1.0))
    assert both.period_s == pytest.approx(0.5)
    assert Sum(parts=[sine, Sine(frequency_hz=np.pi)]).period_s is None
    assert Sum(parts=[sine, DecayingSine()]).period_s is None
    assert not Sum(parts=[sine, Steps()]).has_derivative


def test_a_sequence_gives_each_part_its_turn_and_its_own_time():
    sine, ramp = Sine(frequency_hz=2.0), Sawtooth(frequency_hz=0.1, smooth_start_s=0.05)
    turns = Sequence(parts=[sine, ramp], durations_s=[0.3, 0.7])
    t = np.array([0.1, 0.29, 0.3, 0.32, 0.9, 1.0, 1.1, 2.29])
    expected = [sine(0.1), sine(0.29), *ramp([0.0, 0.02, 0.6]), *sine([0.0, 0.1, 0.29])]
    np.testing.assert_allclose(turns(t), expected, atol=1e-9)
    assert turns.period_s == 1.0
    assert not turns.has_derivative  # the sine ends at -0.59, the ramp begins at 0
    whole = Sequence(parts=[sine, Triangle()], durations_s=[0.5, 1.0])
    assert whole.has_derivative
    gap = Sequence(parts=[sine, Triangle(offset_um=1.0)], durations_s=[0.5, 1.0])
    assert not gap.has_derivative
