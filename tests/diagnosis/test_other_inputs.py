"""Other recorded inputs, or the temperature, explain what a model leaves, or do not, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rdpi_gym.diagnosis.search.discover import add_effect
from rdpi_gym.diagnosis.search.other_inputs import other_inputs, said_of
from rdpi_gym.identification import fit
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.measurement import DATA_HINT, DataOptions, Dataset, Record, load, measured_data
from rdpi_gym.plant import P5, Plant
from rdpi_gym.plant.effects import load_effect

TS_S, NOISE_UM = 1e-3, 0.01
MODEL = Variant(P5.hysteresis, ())


def record(seed, role="train", *, gain=0.0, drift=0.0, resembles=False, plant=P5, samples=6000):
    rng = np.random.default_rng(seed)
    smooth = np.exp(-np.arange(200) / 40.0)
    u, w = (np.convolve(rng.normal(size=samples), smooth)[:samples] for _ in range(2))
    t = TS_S * np.arange(samples)
    if resembles:
        w = np.tanh(u / 5.0) + 0.1 * u
    warmth = 20.0 + np.cumsum(rng.normal(0.0, 0.02, samples))
    y = Plant(plant, TS_S).simulate(u) + NOISE_UM * rng.normal(size=samples)
    y += gain * lfilter([0.1], [1.0, -0.9], w) + drift * lfilter(
        [2e-3], [1.0, -0.998], warmth - 20.0
    )
    return Record(
        f"{role}-{seed}", t, u, y, ts_s=TS_S, role=role, temperature_C=warmth, others={"u2": w}
    )


def found_in(**options):
    train = [record(seed, **options) for seed in (1, 2)]
    return other_inputs(MODEL, train, [record(3, "validation", **options)], NOISE_UM)


def test_a_second_input_through_a_lag_explains_what_it_causes():
    best, *_ = found = [each for each in found_in(gain=0.1) if len(each.names) == 1]
    assert best.names == ("u2",)
    assert best.low > 0.95
    assert best.after_um == pytest.approx(NOISE_UM, rel=0.1)
    assert best.sentence.startswith("The input u2 explains ")
    assert best.sentence.endswith("give all inputs to a model, or hold the others still.")
    other = found[1]
    assert other.names == ("temperature",)
    assert not other.explains
    assert "little or nothing" in other.sentence


def test_a_temperature_behind_a_slow_law_explains_the_drift():
    best, *_ = [each for each in found_in(drift=1.0) if len(each.names) == 1]
    assert best.names == ("temperature",)
    assert best.share > 0.9
    assert "hold it still" in best.sentence


def test_nothing_is_explained_where_nothing_is_left():
    assert not any(each.explains for each in found_in())


def test_an_input_that_only_resembles_the_models_own_explains_nothing():
    """A gain of the model that is wrong leaves what a copy of its input follows exactly."""
    wrong = Variant(replace(P5.hysteresis, weights=[1.1 * a for a in P5.hysteresis.weights]), ())
    train = [record(seed, resembles=True) for seed in (1, 2)]
    found = other_inputs(wrong, train, [record(3, "validation", resembles=True)], NOISE_UM)
    assert not any(each.explains for each in found)


def test_records_without_another_channel_have_none_to_test():
    t = TS_S * np.arange(500)
    plain = Record("plain", t, np.sin(t), np.sin(t), ts_s=TS_S)
    assert other_inputs(MODEL, [plain], [plain], 0.0) == ()
    still = Record("still", t, np.sin(t), np.sin(t), ts_s=TS_S, others={"u2": np.ones(500)})
    assert other_inputs(MODEL, [still], [still], 0.0) == ()
    assert said_of(()) == ""


def test_on_the_mirror_the_other_inputs_explain_what_is_left():
    folder = measured_data("fsm")
    if folder is None:
        pytest.skip(DATA_HINT)
    data = load(folder / "fsm_float32.npz", DataOptions(sampling_time_s=1 / 6400, units={"y": "m"}))
    records = [r for r in data.records if "300mV" in r.name and r.name[-1] in "12"]
    data = replace(data, records=tuple(records))
    model = Variant(fit(data, 2).plant.hysteresis, ())
    both, *alone = other_inputs(model, data.train, data.validation, 2e-3)
    assert set(both.names) == {"u2", "u3"}
    assert both.low > 0.6
    assert all(each.explains for each in alone)
    assert both.after_um < 0.65 * both.before_um
    assert said_of([both, *alone]).startswith("The inputs u2 and u3 together explain ")


@pytest.mark.slow
def test_a_search_says_which_other_input_explains_the_remainder():
    """From records to the sentence, masked stretches and all."""
    records = [record(1, gain=0.3), record(2, gain=0.3), record(3, "validation", gain=0.3)]
    for each in records:
        each.error_mask[2000:2300] = False
    found = add_effect(Dataset("two inputs", tuple(records)), load_effect("sensor_lag"), P5)
    assert "u2" in found.remainder
    assert " % of the squared residual (" in found.remainder
