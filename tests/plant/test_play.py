"""Laws of the play operator and of the RDPI sum, as properties."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rdpi_gym.plant import P5, P10, Plant, PlantModel
from rdpi_gym.plant.cores.play import play_columns
from tests.looping import over

VOLTS = st.floats(-30.0, 30.0, allow_nan=False, width=32)
THRESHOLD = st.floats(0.01, 20.0)


def commands(length: int = 40) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, length, elements=VOLTS)


def play(u: np.ndarray, threshold: float, start: float = 0.0) -> np.ndarray:
    out = np.empty((1, len(u)))
    play_columns(u, np.zeros_like(u), np.array([threshold]), 0.0, np.array([start]), out)
    return out[0]


def static(model: PlantModel) -> PlantModel:
    return model.with_hysteresis(model.hysteresis.static())


@given(commands(), arrays(np.float64, 40, elements=st.floats(0.0, 10.0)), THRESHOLD)
def test_play_is_monotone(u, above, threshold):
    assert np.all(play(u, threshold) <= play(u + above, threshold))


@given(commands(), commands(), THRESHOLD)
def test_play_is_lipschitz_with_constant_one(u, w, threshold):
    difference = np.abs(play(u, threshold) - play(w, threshold))
    assert np.all(difference <= np.maximum.accumulate(np.abs(u - w)) + 1e-12)


@given(commands(), THRESHOLD, VOLTS)
def test_play_stays_within_its_threshold(u, threshold, start):
    assert np.all(np.abs(u - play(u, threshold, start)) <= threshold * (1 + 1e-12) + 1e-12)


@given(commands(20), st.integers(2, 7))
def test_rate_independent_model_does_not_see_the_sampling(u, factor):
    fine = np.interp(np.arange((len(u) - 1) * factor + 1) / factor, np.arange(len(u)), u)
    fine[::factor] = u
    coarse = Plant(static(P10), 1e-3).simulate(u)
    np.testing.assert_allclose(
        Plant(static(P10), 1e-3 / factor).simulate(fine)[::factor], coarse, atol=1e-12
    )


def test_rate_dependent_loop_is_the_same_at_two_sampling_times():
    loops = []
    for ts in (1e-5, 5e-6):
        t = np.arange(round(3 / 50 / ts)) * ts
        loops.append(Plant(P5, ts).simulate(10 * np.sin(2 * np.pi * 50 * t))[:: round(1e-5 / ts)])
    assert np.abs(loops[0] - loops[1]).max() < 1e-3 * 10


@given(commands())
def test_model_is_odd(u):
    up, down = Plant(P5, 1e-3).simulate(u), Plant(P5, 1e-3).simulate(-u)
    np.testing.assert_allclose(up, -down, atol=1e-12)


@over("bias", [-8.0, -3.0, 5.0])
def test_minor_loops_of_one_span_are_congruent(bias):
    def loop(centre: float) -> np.ndarray:
        plant = Plant(static(P10), 1e-3)
        swing = centre + 6.0 * np.sin(2 * np.pi * np.arange(400) / 100)
        y = plant.simulate(np.concatenate([[-30.0, 30.0], swing]))[-100:]
        return y - y[0]

    np.testing.assert_allclose(loop(bias), loop(0.0), atol=1e-12)


def test_below_the_first_threshold_the_model_is_a_gain():
    t = np.arange(2000) * 1e-5
    u = 0.9 * P5.hysteresis.thresholds_V[0] * np.sin(2 * np.pi * 200 * t)
    np.testing.assert_allclose(Plant(P5, 1e-5).simulate(u), P5.hysteresis.a0 * u, atol=1e-14)


@given(st.lists(st.integers(1, 59), max_size=4), st.sampled_from([1, 3, 17]), st.booleans())
def test_splitting_a_block_anywhere_changes_nothing(cuts, lanes, band_limited):
    model = P5.with_hysteresis(P5.hysteresis.band_limited(800.0)) if band_limited else P5
    u = np.random.default_rng(7).normal(0, 8, (60, lanes)).cumsum(axis=0)
    whole, pieces = Plant(model, 1e-4, lanes), Plant(model, 1e-4, lanes)
    expected = whole.simulate(u)
    parts = [pieces.simulate(part) for part in np.split(u, sorted(set(cuts)))]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    np.testing.assert_array_equal(pieces.memory, whole.memory)


def test_band_limited_rate_is_a_first_order_low_pass():
    ts, cutoff = 1e-5, 100.0
    model = P5.with_hysteresis(P5.hysteresis.band_limited(cutoff))
    ramp = 1e4 * ts * np.arange(3000)
    lag = Plant(model, ts).simulate(ramp) - Plant(P5, ts).simulate(ramp)
    time_constant = 1 / (2 * np.pi * cutoff)
    missing_rate = 1e4 * np.exp(-(np.arange(3000)) * ts / time_constant)
    sliding = slice(600, 1500)
    expected = P5.hysteresis.S * P5.hysteresis.delta2_s * missing_rate
    np.testing.assert_allclose(lag[sliding], expected[sliding], rtol=1e-6, atol=1e-11)
