"""The inverses of single effects: exact where they claim it, harmless where nothing can be exact."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from baselines.inverses import INVERSES, Setting
from baselines.inverses.chain import congruent_inverse_block, rising_range
from baselines.inverses.linear import preview_weights
from rdpi_gym.plant import P10, pack
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.effects import CATALOGUE
from tests.looping import over

TS = 1e-4


def setting(rest=0.0, ts_s=TS):
    return Setting(ts_s, P10.hysteresis, 40.0, rest)


def run(name, values, y, rest=0.0, ahead=500, ts_s=TS):
    """Inputs for the samples of y that are not held back, and how many are."""
    effect = CATALOGUE[name](**values)
    inverse = INVERSES[name](effect, setting(rest, ts_s), ahead)
    state, _ = inverse.start(y[:1])
    return inverse.run(np.ascontiguousarray(y[1:, None]), state)[inverse.ahead :, 0], inverse.ahead


linear = st.one_of(
    st.tuples(st.just("sensor_lag"), st.fixed_dictionaries({"time_constant_s": st.floats(0, 1e-2)})),
    st.tuples(
        st.just("resonance"),
        st.fixed_dictionaries({"f0_hz": st.floats(20, 4e3), "damping": st.floats(0.005, 0.7)}),
    ),
    st.tuples(st.just("delay"), st.fixed_dictionaries({"delay_s": st.floats(0, 3e-3)})),
)  # fmt: skip


@settings(deadline=None, max_examples=60)
@given(case=linear, slope=st.floats(-2, 2), curve=st.floats(-0.02, 0.02))
def test_along_a_parabola_derivatives_undo_a_linear_effect_exactly(case, slope, curve):
    name, values = case
    assume(values.get("damping", 1.0) * values.get("f0_hz", 1e3) > 10.0)
    k = np.arange(3000.0)
    y = slope * k + curve * k**2 / 100.0
    x, ahead = run(name, values, y)
    again = CATALOGUE[name](**values).run(np.concatenate([y[:1], x]), TS)
    late = slice(2500, len(again))  # what the start has left has died away
    error = again[late] - y[: len(again)][late]
    assert np.abs(error).max() <= 1e-6 * np.abs(y).max() + 1e-9
    assert len(again) == len(y) - ahead


@over("name", ["creep", "asymmetry", "gain_drift", "thermal_drift"])
@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), rest=st.floats(-30, 30))
def test_exact_for_any_input(name, seed, rest):
    rng = np.random.default_rng(seed)
    x = rest + np.concatenate([[0.0], np.cumsum(rng.normal(0, 3, 80))])
    x = np.clip(x, -45, 45)
    effect = CATALOGUE[name]()
    y = effect.run(x, 0.05)
    found, _ = run(name, {}, y, rest=rest, ts_s=0.05)
    np.testing.assert_allclose(found, x[1:], atol=1e-9)


@settings(deadline=None)
@given(u=st.lists(st.floats(-150, 150), min_size=1, max_size=20))
def test_saturation_is_exact_up_to_its_rails(u):
    y = CATALOGUE["saturation"](limit_V=80.0).run(u, TS)
    found, _ = run("saturation", {"limit_V": 80.0}, np.concatenate([[0.0], y]))
    np.testing.assert_allclose(found, u, atol=1e-5)


def test_out_of_reach_stays_finite():
    y = np.array([0.0, -1e4, 1e4, -1e4])
    for name in ("saturation", "asymmetry"):
        found, _ = run(name, {}, y)
        assert np.all(np.isfinite(found))


def test_the_play_of_the_jump_is_the_reference():
    t = np.linspace(0.0, 1.0, 2000)
    y = 10 * np.sin(2 * np.pi * 3 * t) * t + 2 * np.sin(2 * np.pi * 11 * t)
    x, _ = run("backlash", {"half_width_um": 0.4}, y)
    again = CATALOGUE["backlash"](half_width_um=0.4).run(np.concatenate([y[:1], x]), TS)
    assert np.abs(again - y).max() < 1.1e-4 * 40.0


@settings(deadline=None, max_examples=40)
@given(c=st.floats(-0.5, 2.0), seed=st.integers(0, 2**32 - 1))
def test_congruency_is_inverted_with_the_plays(c, seed):
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.normal(0, 2.0, 300))
    u = np.ascontiguousarray(40.0 * np.sin(u / 40.0)[:, None])
    v = np.gradient(u, 1e-3, axis=0)
    p, growth = pack([P10.hysteresis], 1e-3, [0.0]), c / 40.0**2
    state, found = np.zeros((P10.hysteresis.n + 2, 1)), np.empty_like(u)
    plain = np.empty_like(u)
    given_rate_block(u, v, p, state.copy(), plain)
    y = plain + growth * u**2 * (plain - p[0] * u)
    powers = np.array([1.0, 0.0, growth])
    low, high = rising_range(P10.hysteresis, powers, (-80.0, 80.0))
    congruent_inverse_block(y, v, powers, p, state, low, high, found)
    again = np.empty_like(u)
    given_rate_block(found, v, p, np.zeros_like(state), again)
    again += growth * found**2 * (again - p[0] * found)
    np.testing.assert_allclose(again, y, atol=1e-9)


@settings(deadline=None)
@given(series=st.lists(st.floats(-5, 5), min_size=1, max_size=4), half=st.integers(2, 20))
def test_weights_have_the_moments_and_the_smallest_sum_of_squares(series, half):
    offsets = np.arange(-half, half + 1)
    weights = preview_weights(np.array(series), offsets)
    rows = [offsets**q / max(1, np.prod(range(1, q + 1))) for q in range(len(series))]
    np.testing.assert_allclose([w @ weights for w in rows], series, atol=1e-9)
    # least-norm solutions lie in the span of the conditions
    rest = weights - np.polyval(np.polyfit(offsets, weights, len(series) - 1), offsets)
    assert np.abs(rest).max() < 1e-9


@over("name", INVERSES)
def test_blocks_may_be_split(name):
    effect = CATALOGUE[name]()
    inverse = INVERSES[name](effect, setting(), ahead=3)
    y = np.cumsum(np.random.default_rng(0).normal(0, 1, (50, 2)), axis=0)
    whole, state = inverse.start(y[0])[0], inverse.start(y[0])[0]
    expected = inverse.run(y, whole)
    parts = [inverse.run(np.ascontiguousarray(p), state) for p in np.split(y, [1, 2, 30])]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    np.testing.assert_array_equal(state, whole)
