"""Further forms of effects in a joint refit."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE, DataScale, forms_of

TS = 1e-4
T = np.arange(6000) * TS


def form(name: str, words: str):
    return next(kind for kind in forms_of(CATALOGUE[name]) if kind.form == words)


def measured(core, u, *effects):
    record = Record("made", T, u, u, ts_s=TS)
    y = simulate_effects([Variant(core, effects)], record)[:, 0]
    return Record("made", T, u, y, ts_s=TS)


@pytest.mark.parametrize("unit", [1.0, 1e-4, 1e4])
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
