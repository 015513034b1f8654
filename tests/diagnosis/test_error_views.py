"""The error by its own frequency, harmonics, rests and clock: parts add up, causes are named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rdpi_gym.diagnosis import compare
from rdpi_gym.diagnosis.comparison.error_views import PARTS
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P5, Plant
from rdpi_gym.plant.effects import CATALOGUE
from tests.looping import over

TS = 1e-3
NOISE_UM = 0.01


def measured(u, name="a", effects=(), start_s=0.0, extra=0.0, role="train"):
    t = start_s + np.arange(u.size) * TS
    y = Plant(replace(P5, effects=tuple(effects)), TS).simulate(u)
    y = y + extra + NOISE_UM * np.random.default_rng(u.size).standard_normal(u.size)
    return Record(name, t, u, y, ts_s=TS, role=role)


def sine(frequency_hz=5.0, samples=4000, **keywords):
    return measured(10.0 * np.sin(2 * np.pi * frequency_hz * np.arange(samples) * TS), **keywords)


def stairs(**keywords):
    levels = np.repeat([0.0, 8.0, 4.0, -8.0, 2.0, -4.0, 6.0], 4000)
    return measured(levels, name="stairs", **keywords)


def compared(*records):
    return compare(
        Dataset("made", (*records, replace(records[0], name="held", role="validation"))), P5
    )


def test_spectrum_adds_up_to_the_error():
    result = compared(sine(effects=[CATALOGUE["delay"](2e-3)]), sine(20.0, name="fast"))
    total = float((result.spectrum["residual_um"] ** 2).sum())
    assert total == pytest.approx(result.rmse_um() ** 2, rel=0.05)
    noise = float((result.spectrum["noise_um"] ** 2).sum())
    assert noise == pytest.approx(result.noise_floor_um**2, rel=1e-9)


def test_linear_error_is_coherent_and_a_disturbance_is_not():
    u = 10.0 * lfilter([0.1], [1.0, -0.9], np.random.default_rng(0).standard_normal(20_000))
    disturbance = lfilter([0.1], [1.0, -0.9], np.random.default_rng(1).standard_normal(20_000))

    def coherent(extra):
        table = compared(measured(u, extra=extra)).spectrum
        power = table["residual_um"] ** 2
        return float((table["coherent_percent"] * power).sum() / power.sum())

    assert coherent(lfilter([0.02], [1.0, -0.9], u)) > 95.0
    assert coherent(disturbance) < 10.0
    text = compared(measured(u, extra=0.05 * u)).findings["spectrum"]
    assert "a linear filter could remove most of it" in text


@over(
    "change, part, words",
    [
        (lambda r: replace(r, y_um=1.05 * r.y_um), "gain_um", "a gain that is off"),
        (lambda r: replace(r, y_um=np.roll(r.y_um, 2)), "width_um", "a lag, a delay"),
        (lambda r: replace(r, y_um=r.y_um + 2e-3 * r.u_V**2), "even_um", "asymmetry"),
        (
            lambda r: replace(r, y_um=r.y_um + 0.1 * np.sin(6 * np.pi * 5.0 * r.t_s)),
            "odd_um",
            "odd harmonics",
        ),
        (
            lambda r: replace(r, y_um=r.y_um + np.linspace(0, 1, r.t_s.size)),
            "other_um",
            "not periodic",
        ),
    ],
)
def test_periodic_error_is_named_by_its_largest_part(change, part, words):
    result = compared(change(sine()))
    row = result.distortion.iloc[0]
    assert max(PARTS, key=lambda name: row[name]) == part
    assert words in result.findings["distortion"]


def test_parts_of_the_periodic_error_add_up():
    record = sine(effects=[CATALOGUE["asymmetry"](0.05, 10.0), CATALOGUE["sensor_lag"](2e-3)])
    result = compared(record)
    row = result.distortion.iloc[0]
    residual = result.traces[0].residual_um[200:]
    assert sum(row[name] ** 2 for name in PARTS) == pytest.approx(np.var(residual), rel=1e-3)


def test_creep_goes_on_in_rests():
    gain = 0.02
    result = compared(stairs(effects=[CATALOGUE["creep"](gain)]))
    assert "creep is missing" in result.findings["since_rest"]
    table = result.since_rest
    resting = table[(table["state"] == "resting") & (table["time_s"] > 0.1)]
    assert np.all(np.diff(resting["moved_um"]) > 0)
    for effects in ((), [CATALOGUE["asymmetry"](0.05, 10.0)]):
        assert "no marked creep" in compared(stairs(effects=effects)).findings["since_rest"]


def test_no_rest_tells_no_creep():
    result = compared(sine())
    assert "cannot tell whether creep is missing" in result.findings["since_rest"]
    assert result.to_dict()["since_rest"] == []


def test_drift_runs_across_records():
    rate_um_s = 0.05
    records = []
    for i, frequency_hz in enumerate((2.0, 5.0, 11.0)):
        start_s = 10.0 * i
        drift = rate_um_s * (start_s + np.arange(4000) * TS)
        records.append(sine(frequency_hz, name=f"r{i}", start_s=start_s, extra=drift))
    held = sine(3.0, name="held", start_s=30.0, extra=rate_um_s * (30.0 + np.arange(4000) * TS))
    result = compare(Dataset("drifting", (*records, replace(held, role="validation"))), P5)
    assert result.findings["clock"].endswith("drift.")
    assert "no marked drift" not in result.findings["clock"]
    slope = np.polyfit(result.clock["t_s"], result.clock["mean_um"], 1)[0]
    assert slope == pytest.approx(rate_um_s, rel=0.02)


def test_overlapping_times_are_no_common_clock():
    result = compared(sine(), sine(7.0, name="b"))
    assert "no common clock" in result.findings["clock"]
    assert not result.clock["common_clock"].any()
    for _, rows in result.clock.groupby("name"):
        assert np.average(rows["mean_um"], weights=rows["samples"]) == pytest.approx(0.0, abs=1e-9)
