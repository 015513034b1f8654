"""Where the compensators' own loops decay, by formula and by simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from baselines import FEEDFORWARDS, make_controller
from baselines.classical import classical_own_rate, pack_inverse
from baselines.feedforward import (
    classical_polynomial,
    inversion_free_polynomial,
    limiting_cutoff_hz,
    nyquist_gain,
    spectral_radius,
)
from baselines.inversion_free import inversion_free_own_rate
from baselines.preview import learning_recursion
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import P5, P10, RDPI, empty_state, pack


def ripple(u):
    """Largest second difference of a command in the last quarter of a ramp, over its step."""
    tail = u[-len(u) // 4 :, 0]
    return np.abs(np.diff(tail, 2)).max() / abs(np.mean(np.diff(tail)))


def ramp(ts_s, samples=6000):
    return (100.0 * ts_s * np.arange(samples))[:, None]


def unlimited(model):
    return replace(model, command_range_V=(-1e9, 1e9))


def ramp_ripple(name, model, ts_s):
    wide = unlimited(model)
    layout = ObservationLayout.for_plant(wide, ts_s)
    return ripple(make_controller(name, wide, layout).command_block(ramp(ts_s)))


def test_sampling_time_limit_by_simulation_on_both_sides():
    for model, name, limit_s in (
        (P5, "inversion-free-literal", 0.252e-3),
        (P10, "inversion-free-literal", 0.382e-3),
        (P5, "classical-literal", 0.151e-3),
        (P10, "classical-literal", 0.194e-3),
    ):
        assert ramp_ripple(name, model, 0.98 * limit_s) > 0.1, name
        assert ramp_ripple(name, model, 1.02 * limit_s) < 1e-8, name
        unstable, stable = 0.5 * limit_s, 2.0 * limit_s
        while stable - unstable > 0.002 * limit_s:
            middle = 0.5 * (unstable + stable)
            if ramp_ripple(name, model, middle) > 1e-4:
                unstable = middle
            else:
                stable = middle
        assert stable == pytest.approx(limit_s, rel=0.01), name


def test_low_pass_limit_by_simulation_on_both_sides():
    ts_s = 1e-5
    r, u = ramp(ts_s, 20_000), np.empty((20_000, 1))
    for model in (P5, P10):
        for kernel, packed in (
            (inversion_free_own_rate, lambda each: pack([each], ts_s, [0.0])),
            (classical_own_rate, lambda each: pack_inverse([each], ts_s)),
        ):
            found = []
            for factor in (0.95, 1.10):
                limit = limiting_cutoff_hz(model.hysteresis)
                low_passed = model.hysteresis.band_limited(factor * limit)
                kernel(r, packed(low_passed), empty_state(low_passed.n, 1), ts_s, u)
                found.append(ripple(u))
            assert found[0] < 1e-6
            assert found[1] > 0.1


def test_low_passed_compensators_stay_within_the_limit():
    model = unlimited(P5.with_hysteresis(replace(P5.hysteresis, delta2_s=2e-3)))
    limit = limiting_cutoff_hz(model.hysteresis)
    for ts_s in (2e-6, 5e-5, 1e-3):
        layout = ObservationLayout.for_plant(model, ts_s)
        for name in ("inversion-free-low-passed", "classical-low-passed"):
            controller = make_controller(name, model, layout)
            assert controller.model.rate_bandwidth_hz == pytest.approx(0.6 * limit)
            assert controller.warning() is None
            samples = round(0.2 / ts_s) + 2000  # past the last threshold
            assert ripple(controller.command_block(ramp(ts_s, samples))) < 1e-6, (name, ts_s)


def test_reference_rate_needs_a_loop_gain_below_one():
    name = "inversion-free-reference-rate"
    for weight, decays in ((0.95, True), (1.05, False)):
        model = P5.with_hysteresis(RDPI.from_law([1.0, weight], 1.0, 3e-4))
        assert (ramp_ripple(name, model, 1e-4) < 1e-8) == decays
        layout = ObservationLayout.for_plant(model, 1e-4)
        assert (make_controller(name, model, layout).warning() is None) == decays


def test_literal_with_a_loop_gain_above_one_has_a_longest_sampling_time_too():
    model = P5.with_hysteresis(RDPI.from_law([1.0, 1.5], 1.0, 1e-3))
    longest = 2.0 * 1.5e-3 / 0.5
    for ts_s, decays in ((0.97 * longest, True), (1.03 * longest, False)):
        assert (ramp_ripple("inversion-free-literal", model, ts_s) < 1e-6) == decays
        layout = ObservationLayout.for_plant(model, ts_s)
        warning = make_controller("inversion-free-literal", model, layout).warning()
        assert (warning is None) == decays
        assert decays or "below 0.006 s" in warning


def test_a_certificate_stands_where_no_warning_does():
    found = {}
    for ts_s in (5e-5, 1e-3):
        layout = ObservationLayout.for_plant(P10, ts_s)
        for name in FEEDFORWARDS:
            controller = make_controller(name, P10, layout)
            assert (controller.certificate() is None) == (controller.warning() is not None)
            found[name] = controller.certificate()
    assert found["classical-static"] == "no loop: nothing is fed back"
    assert found["classical-literal"] == "Jury: poles of its own loop within 0.4405"
    assert found["static-inverse-multiplicative"] == "small gain: g = S / a_0 = 0.967, below 1"


def test_warnings_of_the_paper_s_plants():
    for model in (P5, P10):
        for ts_s in (5e-5, 1e-3):
            layout = ObservationLayout.for_plant(model, ts_s)
            unstable = {
                name for name in FEEDFORWARDS if make_controller(name, model, layout).warning()
            }
            literal = {"inversion-free-literal", "classical-literal"}
            assert unstable == (literal if ts_s < 1e-4 else set())
            said = make_controller("pi-classical-literal", model, layout).warning()
            alone = make_controller("classical-literal", model, layout).warning()
            assert said == alone or (alone is None and "has no mode" in said)


compensators = st.builds(
    lambda a0, s, delta2, hz: RDPI((a0, s), (1.0,), delta2, hz),
    st.floats(0.2, 3.0),
    st.floats(0.0, 3.0),
    st.floats(0.0, 1e-3),
    st.one_of(st.none(), st.floats(5.0, 5000.0)),
)


@settings(deadline=None)
@given(model=compensators, ts_s=st.floats(1e-5, 1e-2))
@pytest.mark.parametrize("lag", [0, 1], ids=["classical", "inversion-free"])
def test_polynomials_are_the_loops(lag, model, ts_s):
    """A small kick to a command that rises by 1 V a sample dies or grows as the polynomial says."""
    polynomial = (inversion_free_polynomial if lag else classical_polynomial)(model, ts_s)
    assume(spectral_radius(polynomial) < 3.0)
    samples, kick = 6, 1e-4
    u0 = np.arange(1.0, samples + 1)
    drop = model.thresholds_V[0] + model.delta2_s / ts_s  # every play slides
    r = (model.a0 * u0 + model.S * (u0 - lag - drop))[:, None]
    memory = -drop if lag else -drop * model.A
    kernel = inversion_free_own_rate if lag else classical_own_rate
    packed = pack([model], ts_s, [0.0]) if lag else pack_inverse([model], ts_s)
    u = np.empty_like(r)
    kernel(r, packed, np.array([[kick], [1.0 / ts_s], [memory]]), ts_s, u)
    assume(np.diff(u[:, 0], prepend=kick).min() > 0.0)  # it still rises
    d = (u[:, 0] - u0) / kick
    expected = d.copy()
    for k in range(2, samples):
        expected[k] = -polynomial[1] * expected[k - 1] - polynomial[2] * expected[k - 2]
    np.testing.assert_allclose(d, expected, atol=1e-6 * (1.0 + np.abs(d).max()))


@settings(deadline=None)
@given(model=compensators, ts_s=st.floats(1e-6, 1e-2))
def test_the_inversion_s_learning_contracts_at_every_frequency(model, ts_s):
    """|1 - γ L P| <= 1 for γ up to 2, sliding and sticking, for either way to sample L."""
    ahead, pole = learning_recursion(model, ts_s)
    z = np.exp(1j * np.linspace(1e-4, np.pi, 800))
    learning = (1 - pole) * (1 - ahead + ahead * z) / (1 - pole * z)
    p = model.rate_pole(ts_s)
    kappa = model.S * model.delta2_s / (model.A * ts_s)
    sliding = 1 - kappa * (1 - p) * (1 - 1 / z) / (1 - p / z)
    for plant in (sliding, np.full_like(z, model.a0 / model.A)):
        assert np.abs(1 - 2.0 * learning * plant).max() <= 1 + 1e-9


def test_minimum_phase_is_the_sign_at_nyquist():
    for model, ts_s in ((P5, 5e-5), (P10, 5e-5), (P10, 1e-3)):
        for hz in (None, 400.0, 800.0, 3000.0):
            hysteresis = model.hysteresis.band_limited(hz)
            p = hysteresis.rate_pole(ts_s)
            w = hysteresis.S * hysteresis.delta2_s / (hysteresis.A * ts_s) * (1 - p)
            zero = spectral_radius(np.array([1 - w, w - p]))
            assert (zero < 1) == (nyquist_gain(hysteresis, ts_s) > 0)
