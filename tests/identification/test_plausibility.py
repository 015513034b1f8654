"""Mistakes that every fit survives are said in one line; what a stage may do raises no alarm."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.cli import main
from rdpi_gym.identification import fit
from rdpi_gym.identification.plausibility import plausibility_warnings
from rdpi_gym.identification.residuals import RecordResidual, simulate_record
from rdpi_gym.measurement import Dataset, Record, example_folder, load, measured_data, write_csv
from rdpi_gym.plant import P5, P10, Plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.virtual_lab import Truth, simulate_dataset
from studies.measured_effects import mirror_axis
from tests.looping import over

TS_S = 1e-3
NOISE = np.random.default_rng(3).standard_normal(1500)


def tones(scale_V=1.0):
    t = np.arange(1500) * TS_S
    parts = zip((3.0, 8.3, 40.0), (15.0, 10.0, 5.0), strict=True)
    return t, scale_V * np.sum([a * np.sin(2 * np.pi * f * t) for f, a in parts], axis=0)


def motion(u):
    return Plant(P10, TS_S).simulate(u) + 0.01 * NOISE


def mistaken(kind):
    t, u = tones()
    y = motion(u)
    return {
        "swapped": (t, y, u),
        "milliseconds": (1e3 * t, u, y),
        "microseconds as seconds": (1e-6 * t, u, y),
        "metres": (t, u, 1e-6 * y),
        "millimetres": (t, u, 1e-3 * y / 5),
        "nanometres": (t, u, 1e3 * y),
        "millivolts": (t, 1e3 * u, y),
        "kilovolts": (t, 1e-5 * u, y),
        "noise": (t, u, 0.3 * NOISE + 2e-3 * u),
    }[kind]


def fitted(kind, tmp_path, capsys):
    t, u, y = mistaken(kind)
    path = write_csv(Record("run", t, u, y, ts_s=t[1]), tmp_path / "run.csv")
    assert main(["fit", str(path), "-n", "4", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    model = json.loads((tmp_path / "out" / "model.json").read_text(encoding="utf-8"))
    return model["identification"]["warnings"], printed


@over(
    "kind, said",
    [
        ("swapped", "the loops turn the wrong way"),
        ("swapped", "u and y swapped?"),
        ("milliseconds", "time in ms?"),
        ("microseconds as seconds", "check the units of t and y"),
        ("metres", "y in m? Then give --units y=m"),
        ("millimetres", "y in mm?"),
        ("nanometres", "y in nm?"),
        ("millivolts", "u in mV?"),
        ("kilovolts", "u in kV?"),
        ("noise", "hardly more than a constant would: does y follow u at all?"),
    ],
)
def test_a_mistake_is_said_in_the_file_and_on_the_terminal(kind, said, tmp_path, capsys):
    warnings, printed = fitted(kind, tmp_path, capsys)
    assert any(said in warning for warning in warnings)
    assert said.casefold() in printed.casefold()
    assert all("\n" not in warning and len(warning) < 250 for warning in warnings)


def test_milliseconds_are_known_by_delta2_where_sampling_is_fast(tmp_path):
    t = np.arange(4000) * 0.05
    u = 30.0 * np.sin(2 * np.pi * 0.05 * t) + 5.0 * np.sin(2 * np.pi * 0.5 * t)
    slow = replace(P10, hysteresis=replace(P10.hysteresis, delta2_s=0.39))
    y = Plant(slow, 0.05).simulate(u) + 0.01 * np.random.default_rng(0).standard_normal(t.size)
    found = fit([Record("run", t, u, y, ts_s=0.05)], n=10)
    assert any("δ2 is 0.39 s" in w and "time in ms?" in w for w in found.warnings)


@over("plant, hidden", [(P5, None), (P10, None), (P10, "delay"), (P10, "backlash")])
def test_no_alarm_on_the_standard_protocol(plant, hidden):
    effects = () if hidden is None else (CATALOGUE[hidden](),)
    data = simulate_dataset(Truth(plant, effects, 0.012, 1, 4.0))
    left = [simulate_record(plant, record) for record in data.train]
    assert plausibility_warnings(left) == []


def test_no_alarm_on_one_small_fast_record():
    ts_s = 2.5e-5
    t = np.arange(3000) * ts_s
    u = 0.2 * np.sin(2 * np.pi * 200.0 * t)
    record = Record("small", t, u, Plant(P10, ts_s).simulate(u) + 0.01 * NOISE[0], ts_s=ts_s)
    assert plausibility_warnings([simulate_record(P10, record)]) == []


def test_no_alarm_on_the_measured_stack():
    data = load(example_folder("picma"))
    plant = fit(data).plant
    assert plausibility_warnings([simulate_record(plant, r) for r in data.train]) == []


@pytest.mark.skipif(measured_data("fsm") is None, reason="set RDPI_DATA")
def test_of_the_mirror_only_its_dynamics_are_missed():
    """The static model explains nothing there, a linear filter of u a part: no word of columns."""
    data = mirror_axis(measured_data("fsm"))
    plant = fit(data, 4).plant
    (warning,) = plausibility_warnings([simulate_record(plant, r) for r in data.train])
    assert "fast dynamics are missing" in warning


def test_noise_alone_is_refused_with_a_reason_where_it_falls_by_chance():
    t, u = tones()
    y = 0.3 * NOISE - 1e-3 * u
    with pytest.raises(ValueError, match="does not follow the voltage: their correlation"):
        fit(Dataset("noise", (Record("run", t, u, y, ts_s=TS_S),)), 4)


def test_a_loop_of_noise_turns_nowhere():
    t, u = tones()
    y = u + 3.0 * NOISE
    record = Record("run", t, u, y, ts_s=TS_S)
    error = y - u
    left = RecordResidual(record, u, 0.0, error, float(np.std(error)))
    assert plausibility_warnings([left]) == []
