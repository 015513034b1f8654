"""Free responses of elements whose past no record tells."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.identification.jacobian import Variant, centred, simulate_effects
from rdpi_gym.identification.residuals import centred_residual, model_output, simulate_record
from rdpi_gym.measurement import Record
from rdpi_gym.plant import named_plant
from rdpi_gym.plant.effects.creep import Spectrum, TwoTimeConstants

_TS_S, _SAMPLES, _CUT, _CYCLE = 1e-2, 4000, 120, 500
_CREEPS = (TwoTimeConstants(0.03, 0.5, 0.05, 8.0), Spectrum(0.0, 0.01, 0.02, 0.02, 0.0, 0.01))


def _cut_in_motion(creep):
    """Record of a plant that rested and then moved, without its first seconds."""
    variant = Variant(named_plant("P5").hysteresis, (creep,))
    t = _TS_S * np.arange(_SAMPLES)
    u = 50.0 + 40.0 * np.sin(2.0 * np.pi * t / (_CYCLE * _TS_S))
    whole = Record("cut", t, u, t, ts_s=_TS_S, before_V=np.array([0.0]))
    y = simulate_effects([variant], whole)[:, 0]
    mask = np.arange(_SAMPLES - _CUT) >= _CYCLE  # the plays have passed both extremes
    record = Record("cut", t[_CUT:], u[_CUT:], y[_CUT:], ts_s=_TS_S, error_mask=mask)
    return variant, record


@pytest.mark.parametrize("creep", _CREEPS, ids=lambda creep: creep.form)
def test_creep_of_before_a_record_is_no_residual_where_its_past_is_unknown(creep):
    variant, record = _cut_in_motion(creep)
    at_rest = np.sqrt(np.mean(centred_residual(variant, record) ** 2))
    unknown = centred_residual(variant, replace(record, past_unknown=True))
    assert at_rest > 1e-4 * np.ptp(record.y_um)
    assert np.sqrt(np.mean(unknown**2)) < 1e-9 * at_rest


def test_a_simulated_record_begins_where_the_fit_lets_it_begin():
    variant, record = _cut_in_motion(_CREEPS[0])
    model = replace(named_plant("P5"), effects=variant.effects)
    at_rest = simulate_record(model, record)
    open_ = simulate_record(model, replace(record, past_unknown=True))
    assert open_.rmse_um < 1e-9 * at_rest.rmse_um
    np.testing.assert_allclose(
        open_.simulated_um + open_.offset_um + open_.error_um, record.y_um, rtol=1e-12
    )
    shown_um = model_output(variant, replace(record, past_unknown=True))
    np.testing.assert_allclose(shown_um, open_.simulated_um, rtol=1e-9)


def test_no_element_begins_farther_from_equilibrium_than_twice_the_motion_of_the_record():
    variant, record = _cut_in_motion(TwoTimeConstants(1e-3, 0.5, 1e-3, 8.0))
    record = replace(record, past_unknown=True)
    past_s = record.t_s - record.t_s[0]
    stroke_um = float(np.ptp(record.y_um[record.error_mask]))
    for share, explained in ((1.9, True), (100.0, False)):
        drift_um = share * 1e-3 * stroke_um * np.exp(-past_s / 8.0)
        left = centred(drift_um, record, variant.effects, np.ones(past_s.size, dtype=np.bool_))
        assert (np.ptp(left) < 1e-9 * stroke_um) == explained
        if not explained:
            assert np.ptp(left) > 0.9 * np.ptp(drift_um)


def test_without_a_creep_a_slow_drift_is_no_free_response():
    _, record = _cut_in_motion(_CREEPS[0])
    drift_um = np.exp(-(record.t_s - record.t_s[0]) / 8.0)
    kept = np.ones(drift_um.size, dtype=np.bool_)
    left = centred(drift_um, replace(record, past_unknown=True), (), kept)
    np.testing.assert_allclose(left, drift_um - drift_um.mean(), atol=1e-15)


def test_a_record_of_which_no_sample_counts_shows_no_free_response():
    variant, record = _cut_in_motion(_CREEPS[0])
    hidden = replace(record, past_unknown=True, error_mask=np.zeros(record.t_s.size, dtype=bool))
    plain_um = simulate_effects([variant], record)[:, 0]
    np.testing.assert_array_equal(model_output(variant, hidden), plain_um)
