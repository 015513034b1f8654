"""One number or law for each effect, from its card."""

import dataclasses

import numpy as np
import pytest

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, DataScale, Effect, load_effect
from tests.looping import over

H = P10.hysteresis


def plant_with(*effects: Effect, static: bool = False) -> PlantModel:
    model = P10.with_hysteresis(H.static()) if static else P10
    return dataclasses.replace(model, effects=effects)


def test_creep_gains_gamma_in_every_decade_of_a_hold():
    ts, gamma = 0.01, 0.015
    y = CATALOGUE["creep"](gain_per_decade=gamma).run(np.r_[0.0, np.full(10_001, 40.0)], ts)
    decades = np.array([0.1, 1.0, 10.0, 100.0])
    gained = np.diff(y[np.round(decades / ts).astype(int) + 1]) / 40.0
    np.testing.assert_allclose(gained, gamma, rtol=0.03)


def test_lags_before_and_behind_the_plays_agree_only_below_the_first_threshold():
    ts = 5e-5
    t = np.arange(4000) * ts
    lags = [
        Plant(plant_with(CATALOGUE[name](time_constant_s=2e-4)), ts)
        for name in ("actuator_lag", "sensor_lag")
    ]
    small = 0.9 * H.thresholds_V[0] * np.sin(2 * np.pi * 300 * t)
    front, behind = (lag.simulate(small) for lag in lags)
    np.testing.assert_allclose(front, behind, atol=1e-12)
    for lag in lags:
        lag.reset()
    front, behind = (lag.simulate(25 * np.sin(2 * np.pi * 100 * t)) for lag in lags)
    assert np.abs(front - behind)[2000:].max() > 0.1


def test_asymmetry_is_the_even_part_of_a_half_wave_symmetric_record():
    t = np.arange(2000) / 1000
    u = 30 * np.sin(2 * np.pi * t)
    bare = Plant(plant_with(static=True), 1e-3).simulate(u)[1000:]
    distorted = Plant(
        plant_with(CATALOGUE["asymmetry"](coefficient=0.03, span_um=40.0), static=True), 1e-3
    ).simulate(u)[1000:]

    def even(y: np.ndarray) -> np.ndarray:
        return (y + np.roll(y, 500)) / 2

    np.testing.assert_allclose(even(bare), 0.0, atol=1e-9)
    np.testing.assert_allclose(even(distorted), 0.03 / 40 * bare**2, atol=1e-9)


def test_gain_falls_with_amplitude_under_saturation_only():
    def gains(model: PlantModel) -> np.ndarray:
        swing = np.sin(2 * np.pi * np.arange(800) / 400)
        return np.array(
            [np.ptp(Plant(model, 1e-3).simulate(a * swing)[400:]) / (2 * a) for a in (25, 40)]
        )

    bare, soft = gains(plant_with()), gains(plant_with(CATALOGUE["saturation"](limit_V=60.0)))
    assert bare[1] > bare[0]
    assert soft[1] < soft[0]
    whole = CATALOGUE["saturation"](limit_V=50.0, centre_V=20.0).run([-1e4, 20.0, 1e4], 1e-3)
    np.testing.assert_allclose(whole, [-30.0, 20.0, 70.0])


def test_slew_limit_acts_from_the_critical_amplitude_times_frequency():
    ts, rate = 1e-5, 5000.0
    effect, t = CATALOGUE["slew_limit"](rate_V_s=rate), np.arange(10_000) * 1e-5
    for factor in (0.99, 2.0):
        u = factor * rate / (2 * np.pi * 50) * np.sin(2 * np.pi * 50 * t)
        y = effect.run(u, ts)
        if factor < 1:
            np.testing.assert_array_equal(y, u)
        else:  # a triangle: it moves at the limit nearly always
            speed = np.abs(np.diff(y[2000:])) / ts
            assert np.mean(np.isclose(speed, rate, rtol=1e-6)) > 0.99


@over("rate", [2e3, 1e4, 3e4])
def test_rate_law_widens_sliding_plays_by_a_power_of_the_rate(rate):
    ts, p, v0 = 1e-5, 0.6, 1e4
    ramp = rate * ts * np.arange(round(80 / rate / ts))
    shift = []
    for effects in ((), (CATALOGUE["rate_law"](exponent=p, reference_rate_V_s=v0),)):
        static = Plant(plant_with(static=True), ts).simulate(ramp)
        shift.append((static - Plant(plant_with(*effects), ts).simulate(ramp))[-1])
    assert shift[0] == pytest.approx(H.S * H.delta2_s * rate, rel=1e-9)
    assert shift[1] == pytest.approx(H.S * H.delta2_s * v0 * (rate / v0) ** p, rel=1e-9)


def test_congruency_makes_the_area_of_a_minor_loop_grow_with_its_bias():
    def area(model: PlantModel, bias: float) -> float:
        loop = bias + 6 * np.sin(2 * np.pi * np.arange(801) / 400)
        u = np.concatenate([[-40.0, 40.0], loop])
        y = Plant(model, 1e-3).simulate(u)[-401:]
        return float(np.abs(np.trapezoid(y, loop[-401:])))

    bare = plant_with(static=True)
    grown = plant_with(CATALOGUE["congruency"](coefficient=0.2, span_V=40.0), static=True)
    assert area(bare, 28.0) == pytest.approx(area(bare, 0.0), rel=1e-9)
    assert area(grown, 28.0) / area(grown, 0.0) == pytest.approx(1 + 0.2 * 0.7**2, rel=0.03)


def test_drifts_follow_the_clock():
    t = np.arange(3001) * 0.1
    gain = CATALOGUE["gain_drift"](rate_per_s=2e-4).run(np.full(3001, 30.0), 0.1)
    np.testing.assert_allclose(gain, 30 * (1 + 2e-4 * t))
    warm = CATALOGUE["thermal_drift"](rate_um_s=0.01, time_constant_s=20.0).run(0 * t, 0.1)
    assert warm[1] / 0.1 == pytest.approx(0.01, rel=3e-3)
    assert warm[-1] == pytest.approx(0.01 * 20, rel=1e-6)


def test_initial_memory_is_wiped_out_by_the_first_larger_excursion():
    u = np.concatenate([np.linspace(0, 12, 50), np.linspace(12, -30, 80), np.linspace(-30, 35, 99)])
    bare = Plant(plant_with(static=True), 1e-3).simulate(u)
    memory = plant_with(CATALOGUE["initial_memory"](extremum_V=25.0), static=True)
    remembered = Plant(memory, 1e-3).simulate(u)
    assert np.abs(remembered - bare)[:50].max() > 1.0
    np.testing.assert_allclose(remembered[130:], bare[130:], atol=1e-12)


@over(
    "words, values",
    [
        ("about the start", {"reach_V": 60.0, "ratio": 0.6}),
        ("last turns", {"reach_V": 60.0, "back": -0.7, "third": -0.4}),
    ],
)
def test_a_past_about_the_start_moves_with_the_command_at_which_a_record_begins(words, values):
    model = plant_with(load_effect("initial_memory", words)(**values), static=True)
    u = 20.0 * np.sin(np.arange(300) / 20.0)
    # every play has been driven from where the record begins, so that nothing but a shift is left
    low, high = (Plant(model, 1e-3).simulate(u + start) for start in (0.0, 35.0))
    np.testing.assert_allclose(high - high[0], low - low[0], atol=1e-12)
    bare = Plant(plant_with(static=True), 1e-3).simulate(u + 35.0)
    assert np.ptp(high - bare) > 1.0
    record = Record("run", np.arange(300) * 1e-3, u + 35.0, high, ts_s=1e-3)
    fitted = simulate_effects([Variant(model.hysteresis, model.effects)], record)[:, 0]
    np.testing.assert_allclose(fitted, high, atol=1e-12)


def test_a_past_about_the_start_is_that_of_a_rest_or_of_the_first_sample_of_each_lane():
    model = plant_with(load_effect("initial_memory", "last turns")(), static=True)
    u = 20.0 * np.sin(np.arange(300) / 20.0)[:, None] + np.array([35.0, -10.0])
    plant = Plant(model, 1e-3, lanes=2)
    begun = plant.simulate(u)
    plant.reset(u0_V=u[0])
    np.testing.assert_allclose(plant.simulate(u), begun, atol=1e-12)
    plant.reset(lanes=[False, True])
    left = plant.memory[:, 0]
    stepped = np.concatenate([plant.step(row[None]).copy() for row in u])
    np.testing.assert_allclose(stepped[:, 1], begun[:, 1], atol=1e-12)
    plant.reset(memory=left)
    given = plant.simulate(u)
    np.testing.assert_allclose(given[:, 0], stepped[:, 0], atol=1e-12)


def test_last_turns_go_on_from_a_history_that_decays_and_do_nothing_without_reach():
    decaying = load_effect("initial_memory", "about the start")(reach_V=30.0, ratio=0.5)
    turns = load_effect("initial_memory", "last turns")
    scale = DataScale(50.0, 50.0, 40.0, 3e4, 1e-5, 60.0)
    (start,) = turns.from_simpler(decaying, scale)
    assert start.turns_from(12.0) == decaying.turns_from(12.0)[:3]
    simple = CATALOGUE["initial_memory"](extremum_V=80.0)
    assert turns.from_simpler(simple, scale)[0].values["reach_V"] == 30.0
    u = 5.0 + 20.0 * np.sin(np.arange(300) / 20.0)
    still = plant_with(turns(reach_V=0.0), static=True)
    bare = Plant(plant_with(static=True), 1e-3).simulate(u)
    np.testing.assert_allclose(Plant(still, 1e-3).simulate(u), bare, atol=1e-12)


@over("exponent", [0.2, 0.9997, 3.0])
def test_a_rate_that_decays_below_all_numbers_leaves_the_thresholds_at_rest(exponent):
    law = CATALOGUE["rate_law"](exponent=exponent, reference_rate_V_s=1e4)
    widened = law.run(np.array([1e-300, -5e-324, 5e-324, 0.0]), 1e-3)
    assert np.isfinite(widened).all()
    assert np.abs(widened[1:]).max() < 1e-50
