"""Further forms of effects in a joint refit."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import DataScale, Effect, load_effect
from tests.looping import over

TS = 1e-4
T = np.arange(6000) * TS
SCALE = DataScale(0.0, 40.0, 40.0, 3e3, TS, 0.6)


def form(name: str, words: str) -> type[Effect]:
    return load_effect(name, words)


def measured(core, u, *effects):
    record = Record("made", T, u, u, ts_s=TS)
    y = simulate_effects([Variant(core, effects)], record)[:, 0]
    return Record("made", T, u, y, ts_s=TS)


@over("unit", [1.0, 1e-4, 1e4])
def test_unlike_hard_rails_are_found_in_any_unit(unit):
    hard, scale = form("saturation", "hard rails"), 40.0 * unit
    u = scale * np.exp(-2.0 * T) * np.sin(2 * np.pi * 10.0 * T)
    hidden = hard(-0.55 * scale, 0.48 * scale)
    core = replace(
        P10.hysteresis, thresholds_V=tuple(unit * r for r in P10.hysteresis.thresholds_V)
    )
    record = measured(core, u, hidden)
    start = hard.starts(DataScale(0.0, scale, 40.0, 3e3 * unit, TS, 0.6))[0]
    fit = fit_joint([record], core, (start,))
    found = fit.variant.effects[0]
    assert fit.train_rmse_um < 1e-4 * np.std(record.y_um)
    assert found.values == pytest.approx(hidden.values, rel=1e-4)
    assert set(fit.standard_errors) == {"saturation.low_V", "saturation.high_V"}


def test_a_rail_that_no_sample_reaches_has_no_standard_error():
    hard = form("saturation", "hard rails")
    record = measured(P10.hysteresis, 40.0 * np.sin(2 * np.pi * 10.0 * T), hard(-1e3, 20.0))
    fit = fit_joint([record], P10.hysteresis, (hard(-1e3, 24.0),))
    assert fit.standard_errors["saturation.low_V"] is None
    assert fit.standard_errors["saturation.high_V"] < 1e-3


def test_a_spectrum_whose_other_gains_end_at_zero_converges_in_a_few_passes():
    """A number at its bound takes part in no step: the others would be led astray."""
    spectrum = form("creep", "spectrum")
    levels = np.repeat(np.random.default_rng(1).uniform(-40.0, 40.0, 12), 500)
    u = np.convolve(np.pad(levels, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
    record = measured(P10.hysteresis, u, form("creep", "one time constant")(0.03, 0.1))
    noise = np.random.default_rng(2).normal(0.0, 1e-3, len(T))
    record = Record("made", T, u, record.y_um + noise, ts_s=TS)
    fit = fit_joint([record], P10.hysteresis, spectrum.starts(SCALE))
    found = fit.variant.effects[0].values
    assert fit.converged
    assert fit.passes <= 12
    assert found["gain_at_100ms"] == pytest.approx(0.03, rel=1e-2)
    assert max(found["gain_at_10ms"], found["gain_at_1s"]) < 1e-3
    assert fit.at_bound == ()


def test_two_time_constants_are_found_from_one():
    one, two = form("creep", "one time constant"), form("creep", "two time constants")
    levels = np.repeat(np.random.default_rng(1).uniform(-40.0, 40.0, 12), 500)
    u = np.convolve(np.pad(levels, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
    hidden = two(0.03, 0.004, 0.02, 0.1)
    record = measured(P10.hysteresis, u, hidden)
    fits = [fit_joint([record], P10.hysteresis, (start,)) for start in one.starts(SCALE)]
    simpler = min(fits, key=lambda fit: fit.train_rmse_um).variant.effects[0]
    fits = [fit_joint([record], P10.hysteresis, (s,)) for s in two.from_simpler(simpler, SCALE)]
    found = min(fits, key=lambda fit: fit.train_rmse_um).variant.effects[0]
    assert found.values == pytest.approx(hidden.values, rel=0.02)


@over("volt, second, micrometre", [(1e-4, 1e3, 1e3), (1e3, 1e-3, 1e-3)])
def test_a_refit_is_the_same_in_any_unit(volt, second, micrometre):
    """Kilonewtons by the hour, or metres over millivolts: no size is built in."""

    def left(volt: float, second: float, micrometre: float) -> float:
        h, noise = P10.hysteresis, np.random.default_rng(2).normal(0.0, 0.01, len(T))
        core = replace(
            h,
            weights=tuple(a * micrometre / volt for a in h.weights),
            thresholds_V=tuple(r * volt for r in h.thresholds_V),
            delta2_s=h.delta2_s * second,
        )
        u = 40.0 * volt * np.exp(-2.0 * T) * np.sin(2 * np.pi * 10.0 * T)
        bare = Record("made", T * second, u, u, ts_s=TS * second)
        bent = form("asymmetry", "cubic")(0.1, -0.05, 40.0 * micrometre)
        y = simulate_effects([Variant(core, (bent,))], bare)[:, 0] + micrometre * noise
        scale = DataScale(0.0, 40.0 * volt, 40.0 * micrometre, 2e3 * volt / second, TS, 0.6)
        record = replace(bare, y_um=y)
        fit = fit_joint([record], core, form("asymmetry", "cubic").starts(scale))
        return fit.train_rmse_um / micrometre

    assert left(1.0, 1.0, 1.0) == pytest.approx(0.01, rel=0.05)
    assert left(volt, second, micrometre) == pytest.approx(left(1.0, 1.0, 1.0), rel=1e-4)


def test_unlike_envelopes_are_found_with_the_weights_of_the_plays():
    envelopes = form("asymmetry", "unlike envelopes")
    u = 40.0 * np.exp(-2.0 * T) * np.sin(2 * np.pi * 10.0 * T)
    hidden = envelopes(0.1, -0.02, 0.25, 0.03, centre_V=0.0, span_V=40.0)
    record = measured(P10.hysteresis, u, hidden)
    wrong = replace(P10.hysteresis, weights=(0.8, *np.full(P10.hysteresis.n, 0.1)))
    fit = fit_joint([record], wrong, envelopes.starts(SCALE))
    assert fit.train_rmse_um < 1e-4 * np.std(record.y_um)
    assert fit.variant.effects[0].values == pytest.approx(hidden.values, rel=1e-3, abs=1e-4)
    assert fit.variant.hysteresis.weights == pytest.approx(P10.hysteresis.weights, abs=1e-3)
