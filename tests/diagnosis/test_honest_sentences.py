"""A sum of sines, a random command, a single cycle, each alone in one file: nothing that is not so."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.cli import main
from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.diagnosis.comparison.compare import compare
from rdpi_gym.diagnosis.features.recurrence import find_rests
from rdpi_gym.measurement import Dataset, Record, write_csv
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import CATALOGUE
from tests.looping import over

TS_S, SAMPLES = 1e-3, 12_000
T_S = TS_S * np.arange(SAMPLES)
SPAN_V = 30.0
CREEP, LAG = CATALOGUE["creep"](0.015), CATALOGUE["actuator_lag"](2e-3)
OFF = replace(
    P10,
    hysteresis=replace(
        P10.hysteresis,
        weights=tuple(w * (1.1 if i % 2 else 0.93) for i, w in enumerate(P10.hysteresis.weights)),
    ),
)


def sum_of_sines():
    phases = np.random.default_rng(1).uniform(0.0, 2 * np.pi, 5)
    waves = zip((0.7, 1.9, 3.3, 7.1, 13.7), phases, strict=True)
    return sum(np.sin(2 * np.pi * f * T_S + p) / f**0.3 for f, p in waves)


def random_command():
    spectrum = np.fft.rfft(np.random.default_rng(2).standard_normal(SAMPLES))
    spectrum[np.fft.rfftfreq(SAMPLES, TS_S) > 6.0] = 0.0
    return np.fft.irfft(spectrum, SAMPLES)


def random_steps():
    return np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, SAMPLES // 24), 24)


def single_cycle():
    return np.sin(2 * np.pi * T_S / T_S[-1])


COMMANDS = {
    "sines": sum_of_sines,
    "random": random_command,
    "steps": random_steps,
    "cycle": single_cycle,
}


def measured(name, *effects, add=0.0):
    u = COMMANDS[name]()
    u = SPAN_V * u / np.max(np.abs(u))
    y = Plant(replace(P10, effects=effects), TS_S).simulate(u) + add
    y = y + 0.012 * np.random.default_rng(4).standard_normal(SAMPLES)
    return Dataset(name, (Record(name, T_S, u, y, ts_s=TS_S),))


def suggested(data):
    return {effect for c in run_checks(data) if c.zone == "yes" for effect in c.suggests}


@over("name", list(COMMANDS))
@over("effects", [(), (LAG,)])
def test_no_check_suggests_what_is_not_there(name, effects):
    there = {effect.name for effect in effects}
    assert suggested(measured(name, *effects)) <= there


FALSE = (
    "still goes on, or drift", "line: drift", ": creep is missing", "creeps too much", "suggests creep", "lay it", "asymmetry",
    "repeatable function",
)  # fmt: skip


@over("name", ["sines", "random", "cycle"])
@over("model", [P10, OFF])
def test_compare_says_nothing_that_is_not_so(name, model):
    found = compare(measured(name), model).findings
    told = " ".join(text for key, text in found.items() if key != "plane" or name == "cycle")
    assert [words for words in FALSE if words in told] == []


@over("name", ["sines", "random", "cycle"])
def test_the_command_line_says_no_more(name, tmp_path, capsys):
    path = write_csv(measured(name).records[0], tmp_path / f"{name}.csv")
    out = ["--out", str(tmp_path / "out")]
    assert main(["compare", str(path), "--model", str(OFF.save(tmp_path / "m.json")), *out]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert [words for words in FALSE[:-1] if words in told] == []


def test_a_lag_that_is_not_over_is_no_creep():
    creep = next(c for c in run_checks(measured("steps", LAG)) if c.name == "creep")
    assert creep.zone == "cannot tell"
    assert "not as creep does" in creep.sentence
    found = compare(measured("steps", LAG), P10).findings["since_rest"]
    assert "a lag that is not over" in found


def test_creep_in_rests_is_still_found():
    assert "creep" in suggested(measured("steps", CREEP))
    data = measured("steps", CREEP)
    late = next(c for c in run_checks(data) if c.name == "drift in holds")
    assert late.zone != "yes"  # rests of 24 ms tell nothing of a minute


@over("name", ["sines", "random"])
def test_a_drift_that_is_there_is_still_said(name):
    told = compare(measured(name, add=0.2 * T_S), P10).findings["clock"]
    assert told.endswith("on a straight line: creep that still goes on, or drift.")


def test_the_error_of_a_gain_over_one_cycle_is_no_drift():
    told = compare(measured("cycle"), OFF).findings
    assert "a drift cannot be seen" in told["clock"]
    assert "passes through the same command" in told["plane"]
    assert "slower than a spectrum" in told["spectrum"]


@over("power", [3, 5])
def test_the_shoulder_of_a_wave_is_no_rest(power):
    """However flat a command passes through a point, it does not stop there."""
    x = np.linspace(-1.0, 1.0, 8001)
    u = 10.0 * x**power
    assert find_rests(Record("shoulder", x, u, u, ts_s=2.5e-4), 20.0) == []


def test_a_step_that_ends_in_a_rest_is_one():
    u = np.concatenate([np.linspace(0.0, 5.0, 50), np.full(400, 5.0)])
    (rest,) = find_rests(Record("step", TS_S * np.arange(450), u, u, ts_s=TS_S), 20.0)
    assert (rest.first, rest.last) == (49, 450)
    assert rest.move_V == 5.0


def test_even_harmonics_that_the_command_has_too_are_not_laid_to_the_actuator():
    wave = np.sin(2 * np.pi * 2.0 * T_S) + 0.4 * np.sin(2 * np.pi * 4.0 * T_S)
    u = 20.0 * wave
    y = Plant(OFF, TS_S).simulate(u)
    data = Dataset("two lines", (Record("two lines", T_S, u, y, ts_s=TS_S),))
    result = compare(data, P10)
    assert not result.distortion["odd_command"].any()
    assert "asymmetry." not in result.findings["distortion"]


def test_even_harmonics_of_an_odd_command_are():
    u = SPAN_V * np.sin(4 * np.pi * T_S)
    y = Plant(P10, TS_S).simulate(u)
    bent = Record("bent", T_S, u, y + 0.002 * y**2, ts_s=TS_S)
    assert "asymmetry" in compare(Dataset("bent", (bent,)), P10).findings["distortion"]


def test_outliers_are_left_out_of_a_comparison_and_said():
    data = measured("sines")
    (record,) = data.records
    y = record.y_um.copy()
    y[np.random.default_rng(5).choice(SAMPLES, 120, replace=False)] += 3.0
    clean, spoiled = compare(data, P10), compare(Dataset("s", (replace(record, y_um=y),)), P10)
    assert spoiled.rmse_um() == pytest.approx(clean.rmse_um(), rel=0.02)
    assert spoiled.noise_floor_um == pytest.approx(clean.noise_floor_um, rel=0.02)
    assert any("stand alone" in line and "outliers, left out" in line for line in spoiled.left_out)
    # neither are the tests without a model misled
    assert [c.zone for c in spoiled.checks] == [c.zone for c in clean.checks]
