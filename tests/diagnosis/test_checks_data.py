"""Checks of the data: faults of the measurement, what a command leaves untested, poor data."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.measurement import Dataset, Record, example_folder, load
from rdpi_gym.plant import P5, Plant, settled_memory
from tests.looping import over

TS = 1e-3


def sine(frequency_hz=5.0, amplitude_V=10.0, samples=4000, noise_um=0.01, name="sine", **keywords):
    t = np.arange(samples) * TS
    u = amplitude_V * np.sin(2 * np.pi * frequency_hz * t)
    y = Plant(P5, TS).simulate(u)
    y += noise_um * np.random.default_rng(3).standard_normal(samples)
    return Record(name, t, u, y, ts_s=TS, **keywords)


def changed(record, **columns):
    values = {"t_s": record.t_s, "u_V": record.u_V, "y_um": record.y_um, **columns}
    return Record(record.name, **values, ts_s=record.ts_s)


def checks(*records):
    return {check.name: check for check in run_checks(Dataset("made", records))}


def test_sensor_that_clips():
    record = sine()
    clipped = checks(changed(record, y_um=np.minimum(record.y_um, 8.0)))["clipping"]
    assert clipped.zone == "yes"
    assert "near 8 µm" in clipped.sentence
    assert checks(record)["clipping"].zone == "no"


def test_coarse_steps_are_seen_and_fine_ones_are_not():
    record = sine(noise_um=0.002)
    coarse = checks(changed(record, y_um=np.round(record.y_um, 1)))["coarse resolution"]
    assert coarse.zone == "yes"
    assert "steps of 0.1 µm" in coarse.sentence
    fine = changed(record, y_um=np.round(record.y_um, 3))
    assert checks(fine)["coarse resolution"].zone == "no"


@over("closed, zone", [(True, "yes"), (False, "no")])
def test_command_that_follows_the_sensor_is_a_closed_loop(closed, zone):
    rng = np.random.default_rng(1)
    samples = 4000
    noise = 0.05 * rng.standard_normal(samples)
    reference = 5.0 * np.sin(2 * np.pi * 2.0 * np.arange(samples) * TS)
    plant, u, y = Plant(P5, TS), np.zeros(samples), np.zeros(samples)
    for k in range(1, samples):
        error = reference[k] - (y[k - 1] if closed else 0.0)
        u[k] = u[k - 1] + 0.2 * error if closed else reference[k] + 0.05 * rng.standard_normal()
        y[k] = plant.simulate(u[k : k + 1])[0] + noise[k]
    record = Record("loop", np.arange(samples) * TS, u, y, ts_s=TS)
    assert checks(record)["closed loop"].zone == zone


def test_lag_that_grows_with_time_means_two_clocks():
    record = sine(samples=8000)
    late = np.interp(record.t_s * (1.0 - 2e-4), record.t_s, record.y_um)
    found = checks(changed(record, y_um=late))["two clocks"]
    assert found.zone == "yes"
    assert found.value == pytest.approx(200.0, rel=0.05)  # µs a second
    assert checks(record)["two clocks"].zone == "no"


def test_memory_is_seen_where_a_loop_stands_about_its_start():
    record = sine(noise_um=0.002)
    plant = Plant(P5, TS)
    plant.reset(memory=settled_memory(P5.hysteresis.thresholds_V, [8.0]))
    remembering = changed(
        record, y_um=plant.simulate(record.u_V) + record.y_um - sine(noise_um=0.0).y_um
    )
    assert checks(remembering)["initial memory"].zone == "yes"
    assert checks(record)["initial memory"].zone == "no"


def test_one_slow_sine_says_what_it_cannot_tell():
    found = checks(sine(frequency_hz=1.0, noise_um=0.002))
    for name in ("few amplitudes", "few frequencies", "no long holds"):
        assert found[name].zone == "yes"
        assert found[name].next_step
    for name in ("creep", "congruency", "lag at small signals", "rate law"):
        assert found[name].zone == "cannot tell"
        assert found[name].next_step
    # it is enough for these
    for name in ("asymmetry", "initial memory", "no repetition"):
        assert found[name].zone == "no"


def test_what_does_not_count_is_not_used():
    record = sine()
    mask = np.ones(record.t_s.size, dtype=bool)
    mask[2500:] = False
    y = record.y_um.copy()
    y[2500:] += 0.05 * y[2500:] ** 2
    bent = Record("bent", record.t_s, record.u_V, y, ts_s=TS)
    assert checks(bent)["asymmetry"].zone == "yes"
    masked = Record("bent", record.t_s, record.u_V, y, ts_s=TS, error_mask=mask)
    assert checks(masked)["asymmetry"].zone == "no"


def test_test_records_are_left_alone():
    record = sine()
    bent = Record(
        "bent", record.t_s, record.u_V, record.y_um + 0.01 * record.y_um**2, TS, role="test"
    )
    assert checks(record, bent)["asymmetry"].zone == "no"


def test_quiet_record_alone_tells_drift_and_hum():
    t = np.arange(60_000) * 2e-3
    noise = 0.01 * np.random.default_rng(2).standard_normal(t.size)
    y = noise + 0.002 * t + 0.03 * np.sin(2 * np.pi * 60.0 * t)
    found = checks(sine(), Record("rest", t + 10.0, np.zeros(t.size), y, ts_s=2e-3))
    assert found["drift in holds"].zone == "yes"
    assert found["mains hum"].zone == "yes"
    assert found["mains hum"].value == pytest.approx(0.03, rel=0.05)
    assert found["creep"].zone == "cannot tell"


@settings(deadline=None, max_examples=60)
@given(
    samples=st.integers(16, 400),
    ts_s=st.floats(1e-6, 10.0),
    kind=st.sampled_from(["walk", "ramp", "steps", "constant", "sine", "spike"]),
    response=st.sampled_from(["none", "gain", "square", "noise", "coarse"]),
    seed=st.integers(0, 1000),
)
def test_any_data_set_gets_an_answer(samples, ts_s, kind, response, seed):
    rng = np.random.default_rng(seed)
    k = np.arange(samples)
    u = {
        "walk": np.cumsum(rng.standard_normal(samples)),
        "ramp": 0.1 * k,
        "steps": np.repeat(rng.standard_normal(samples // 20 + 1), 20)[:samples],
        "constant": np.full(samples, 2.0),
        "sine": 1e3 * np.sin(0.2 * k),
        "spike": 1.0 * (k == samples // 2),
    }[kind]
    y = {
        "none": np.zeros(samples),
        "gain": -2.0 * u,
        "square": u + 0.1 * u * u,
        "noise": rng.standard_normal(samples),
        "coarse": np.round(u),
    }[response]
    record = Record("any", k * ts_s, u, y, ts_s=ts_s)
    found = run_checks(Dataset("any", (record, Record("again", k * ts_s + 1e6, u, y, ts_s=ts_s))))
    assert len({check.name for check in found}) == len(found) == 24
    for check in found:
        json.dumps(check.to_dict(), allow_nan=False)
        assert check.zone in ("yes", "no", "cannot tell")
        assert check.sentence.endswith(".")
        assert check.zone != "cannot tell" or check.next_step


def test_empty_data_set():
    assert {check.zone for check in run_checks(Dataset("empty", ()))} <= {
        "yes",
        "no",
        "cannot tell",
    }


def test_picma():
    found = {check.name: check for check in run_checks(load(example_folder("picma")))}
    assert found["asymmetry"].zone == "yes"
    assert 1.0 < found["asymmetry"].value < 3.0
    # one frequency: delay, lags and rate law cannot be separated
    assert found["few frequencies"].zone == "yes"
    assert found["lag at small signals"].zone == "cannot tell"
    assert found["rate law"].zone == "cannot tell"
