"""What holds for every signal: exact derivative, period, bounds, seeds, preview, smooth start."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.signals import (
    SIGNALS,
    BandLimitedNoise,
    Chirp,
    Constant,
    DecayingSine,
    LaplaceProcess,
    Measured,
    Multisine,
    NestedLoops,
    RandomSteps,
    Raster,
    RasterSlowRamp,
    RasterSlowStairs,
    Sawtooth,
    Sequence,
    Signal,
    Sine,
    Steps,
    Sum,
    Triangle,
    WienerProcess,
    first_order_reversals,
)
from rdpi_gym.support.errors import InputError
from tests.looping import over

COMMON = {"amplitude_um": 12.0, "offset_um": 15.0}
EXAMPLES: list[Signal] = [
    Constant(level=0.25, **COMMON),
    Sine(frequency_hz=2.0, phase_rad=0.3, **COMMON),
    Triangle(frequency_hz=2.0, phase_rad=-0.4, **COMMON),
    Sawtooth(frequency_hz=2.0, **COMMON),
    Sawtooth(frequency_hz=2.0, flyback_fraction=0.2, **COMMON),
    Steps(hold_s=0.125, **COMMON),
    Steps(hold_s=0.125, rise_s=0.05, **COMMON),
    RandomSteps(hold_s=0.125, count=8, seed=5, **COMMON),
    Raster(frequency_hz=4.0, trace_fraction=0.7, turnaround_fraction=0.15, **COMMON),
    Raster(frequency_hz=4.0, trace_fraction=0.7, turnaround_fraction=0.0, **COMMON),
    RasterSlowRamp(frequency_hz=8.0, lines=6, **COMMON),
    RasterSlowStairs(frequency_hz=8.0, lines=6, rise_s=0.02, **COMMON),
    Chirp(start_hz=1.0, stop_hz=30.0, duration_s=2.0, **COMMON),
    Chirp(start_hz=30.0, stop_hz=1.0, duration_s=2.0, sweep="logarithmic", **COMMON),
    DecayingSine(frequency_hz=5.0, decay_s=0.5, **COMMON),
    NestedLoops(frequency_hz=4.0, **COMMON),
    Multisine(frequency_hz=1.0, lines=20, seed=3, **COMMON),
    Multisine(frequency_hz=1.0, lines=10, odd=True, seed=3, **COMMON),
    BandLimitedNoise(low_hz=3.0, high_hz=20.0, repeat_s=2.0, seed=3, **COMMON),
    WienerProcess(interval_s=0.05, duration_s=2.0, seed=3, **COMMON),
    LaplaceProcess(interval_s=0.05, duration_s=2.0, seed=3, **COMMON),
    Sum(parts=(Sine(frequency_hz=2.0), Triangle(frequency_hz=3.0)), amplitude_um=6.0),
    Sequence(parts=(Sine(frequency_hz=1.0), Triangle(frequency_hz=2.0)), durations_s=(1.0, 1.5)),
    Measured(times_s=[0.0, 0.4, 1.0, 1.7], values_um=[0.0, 1.0, -1.0, 0.5], amplitude_um=6.0),
]
# A signal that is not among them is held to the laws as its defaults make it.
EXAMPLES += [
    kind() for name, kind in SIGNALS.items() if name not in {example.name for example in EXAMPLES}
]
# Twice where one class has two faces: with its name and a number.
IDS = [
    f"{signal.name}-{[type(other) for other in EXAMPLES[:i]].count(type(signal))}"
    for i, signal in enumerate(EXAMPLES)
]
every_signal = over("signal", EXAMPLES)


def test_the_examples_cover_every_name():
    assert {signal.name for signal in EXAMPLES} == set(SIGNALS)


def real(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


COMMON_FIELDS = {
    "amplitude_um": real(0.1, 50.0),
    "offset_um": real(-50.0, 50.0),
    "smooth_start_s": st.sampled_from([0.0, 0.05, 3.0]),
}
FREQUENCY = real(0.5, 200.0)
SEED = st.integers(0, 2**32)
# Between two corners of a piecewise signal lies a cell; a time is (cell + inside) * its length.
CELL, INSIDE = st.integers(0, 40), real(0.05, 0.95)


SMOOTH = st.one_of(
    st.builds(Sine, frequency_hz=FREQUENCY, phase_rad=real(-7.0, 7.0), **COMMON_FIELDS),
    st.builds(
        Chirp, start_hz=FREQUENCY, stop_hz=FREQUENCY, duration_s=real(5.0, 9.0),
        sweep=st.sampled_from(["linear", "logarithmic"]), **COMMON_FIELDS,
    ),
    st.builds(DecayingSine, frequency_hz=FREQUENCY, decay_s=real(0.1, 5.0), **COMMON_FIELDS),
    st.builds(
        Multisine, frequency_hz=real(0.5, 10.0), lines=st.integers(1, 10), odd=st.booleans(),
        seed=SEED, **COMMON_FIELDS,
    ),
    st.builds(
        BandLimitedNoise, low_hz=real(0.0, 20.0), high_hz=real(40.0, 200.0),
        repeat_s=real(0.1, 2.0), seed=SEED, **COMMON_FIELDS,
    ),
)  # fmt: skip
"""Signals without corners."""

# A signal with corners of a frequency f, and the length of its cells.
PIECEWISE = [
    lambda f, seed, levels, **c: (Triangle(frequency_hz=f, **c), 0.25 / f),
    # zero at the middle of the ramp: corners at 0.4 and 0.6 of a period
    lambda f, seed, levels, **c: (Sawtooth(frequency_hz=f, flyback_fraction=0.2, **c), 0.2 / f),
    # corners of the rate at 0.05, 0.65, 0.75 and 0.95 of a line
    lambda f, seed, levels, **c: (Raster(frequency_hz=f, trace_fraction=0.7, turnaround_fraction=0.1, **c), 0.05 / f),
    lambda f, seed, levels, **c: (RasterSlowRamp(frequency_hz=f, lines=4, **c), 4.0 / f),
    lambda f, seed, levels, **c: (Steps(levels=levels, hold_s=1.0 / f, rise_s=0.5 / f, **c), 0.5 / f),
    lambda f, seed, levels, **c: (WienerProcess(interval_s=1.0 / f, spread_s=1.0, duration_s=7.0 / f, seed=seed, **c), 1.0 / f),
    lambda f, seed, levels, **c: (LaplaceProcess(interval_s=1.0 / f, spread_s=1.0, duration_s=7.0 / f, seed=seed, **c), 1.0 / f),
    # turning points half an amplitude apart
    lambda f, seed, levels, **c: (NestedLoops(turning_points=first_order_reversals(4), frequency_hz=f, **c), 0.125 / f),
]  # fmt: skip


@st.composite
def piecewise_cases(draw):
    """A signal with corners, a time away from them, and the length of the cell that holds it."""
    common = {name: draw(field) for name, field in COMMON_FIELDS.items()}
    levels = tuple(draw(st.lists(real(-1.0, 1.0), min_size=1, max_size=6)))
    make = draw(st.sampled_from(PIECEWISE))
    signal, length = make(draw(FREQUENCY), draw(SEED), levels, **common)
    return signal, (draw(CELL) + draw(INSIDE)) * length, length


@settings(deadline=None)
@given(st.one_of(st.tuples(SMOOTH, real(0.01, 4.5), st.just(1.0 / 200.0)), piecewise_cases()))
def test_derivative_is_the_limit_of_central_differences(case):
    signal, t, length = case
    assert signal.has_derivative
    # The shortest time in which the signal or its smooth start changes.
    shortest = min(length, signal.smooth_start_s or length)
    h = 1e-4 * shortest
    difference = (signal(t + h) - signal(t - h)) / (2.0 * h)
    # The error is h² / 6 of the third derivative, which is below 700 / shortest³ in this unit.
    scale = (signal.amplitude_um + abs(signal.offset_um)) / shortest
    assert abs(signal.derivative(t) - difference) <= 2e-6 * scale


@every_signal
def test_the_derivative_adds_up_to_the_change(signal):
    t = np.linspace(0.0, 3.1, 62_001)
    middle = 0.5 * (t[1:] + t[:-1])
    travelled = np.sum(signal.derivative(middle)) * (t[1] - t[0])
    if signal.has_derivative:
        assert travelled == pytest.approx(signal(3.1) - signal(0.0), abs=0.02)
    else:
        jumps = np.abs(np.diff(signal(t))).max()
        assert jumps > 1.0


@every_signal
def test_a_period_repeats_values_and_rates(signal):
    if signal.period_s is None:
        assert isinstance(signal, Constant | Chirp | DecayingSine | Measured)
        return
    t = np.linspace(0.0, signal.period_s, 997, endpoint=False) + 1e-4
    for cycles in (1, 7):
        later = t + cycles * signal.period_s
        np.testing.assert_allclose(signal(later), signal(t), atol=1e-9)
        np.testing.assert_allclose(signal.derivative(later), signal.derivative(t), atol=1e-6)


@over("signal", [s for s in EXAMPLES if not isinstance(s, Sum | Sequence | Measured)])
def test_the_signal_stays_within_its_amplitude_and_some_reach_it(signal):
    peak = np.abs(signal(np.linspace(0.0, 6.0, 600_001)) - signal.offset_um).max()
    assert peak <= signal.amplitude_um * (1.0 + 1e-9)
    reach = {"sine", "triangle", "nested-loops", "multisine", "noise", "chirp"}
    if signal.name in reach or signal.name.startswith("raster"):
        assert peak == pytest.approx(signal.amplitude_um, rel=1e-4)


@over("name", ["multisine", "noise", "random-steps", "wiener", "laplace"])
def test_a_seed_reproduces_and_another_differs(name):
    t = np.linspace(0.0, 3.0, 301)
    signal = SIGNALS[name](seed=11)
    assert np.array_equal(signal(t), SIGNALS[name]().with_seed(11)(t))
    assert np.abs(signal(t) - signal.with_seed(12)(t)).max() > 0.1


def test_the_parts_of_a_combination_are_drawn_apart():
    t = np.linspace(0.0, 3.0, 301)
    noisy = Sum(parts=(WienerProcess(), WienerProcess(), Sine()))
    drawn = noisy.with_seed(4)
    assert drawn == noisy.with_seed(4) != noisy.with_seed(5)
    assert np.abs(drawn.parts[0](t) - drawn.parts[1](t)).max() > 0.1
    assert drawn.parts[2] == Sine()


@every_signal
def test_preview_is_direct_evaluation(signal):
    t, ts = np.array([[0.0, 0.31], [0.7, 1.9]]), 0.013
    ahead = signal.preview(t, ts, 5)
    assert ahead.shape == (2, 2, 5)
    for k in range(5):
        np.testing.assert_allclose(ahead[..., k], signal(t + ts * (k + 1)), atol=1e-12)
    assert signal.preview(0.5, ts, 0).shape == (0,)


@over("ts_s, samples", [(0.0, 3), (-1e-3, 3), (np.nan, 3), (1e-3, -1)])
def test_preview_refuses_bad_sampling(ts_s, samples):
    with pytest.raises(InputError, match=r"ts_s|samples"):
        Sine().preview(0.0, ts_s, samples)


@every_signal
def test_two_sampling_rates_agree_at_common_times(signal):
    """Jumps too: 125 * 1e-3 and 1250 * 1e-4 differ by rounding, the signal there does not."""
    coarse, fine = np.arange(6000) * 1e-3, np.arange(60_000) * 1e-4
    np.testing.assert_allclose(signal(coarse), signal(fine)[::10], atol=1e-9)
    np.testing.assert_allclose(signal.derivative(coarse), signal.derivative(fine)[::10], atol=1e-6)


@every_signal
def test_values_do_not_depend_on_the_shape_of_the_times(signal):
    t = np.linspace(-0.2, 2.0, 24)
    for method in (signal, signal.derivative):
        folded = method(t.reshape(2, 3, 4))
        np.testing.assert_allclose(folded, method(t).reshape(2, 3, 4), atol=1e-9)
        assert method(t[7]).shape == ()
        assert method(t[7]) == pytest.approx(method(t)[7], abs=1e-9)
        assert method([]).shape == (0,)


@every_signal
def test_before_the_start_the_first_value_is_held(signal):
    assert np.array_equal(signal([-5.0, -1e-12]), np.full(2, signal(0.0)))
    assert np.array_equal(signal.derivative([-5.0, -1e-12]), np.zeros(2))


@every_signal
def test_the_smooth_start_leaves_rest_without_a_step(signal):
    soft = replace(signal, smooth_start_s=0.2)
    assert soft(0.0) == 0.0
    assert soft.derivative(0.0) == 0.0
    h = 1e-5
    assert abs(soft(h)) < 1e-9 * 60.0  # like t³: no jump, no rate, no acceleration
    t = np.linspace(0.2, 3.0, 501)
    assert np.array_equal(soft(t), signal(t))
    assert np.array_equal(soft.derivative(t), signal.derivative(t))


@every_signal
def test_signals_compare_hash_and_travel_between_processes(signal):
    signal(0.3)  # with whatever it keeps after use
    again = pickle.loads(pickle.dumps(signal))
    assert again == signal
    assert hash(again) == hash(signal)
    assert again(0.7) == signal(0.7)


@every_signal
def test_times_that_are_not_finite_are_refused(signal):
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match="finite times"):
            signal([0.0, bad])
        with pytest.raises(InputError, match="finite times"):
            signal.derivative(bad)
