"""A comparison finds a deviation that was put in, and its parts add up."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rdpi_gym.diagnosis import compare
from rdpi_gym.diagnosis.comparison import findings
from rdpi_gym.diagnosis.comparison.compare import _shares
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.identification import fit
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P5, P10, Plant, named_plant, settled_memory
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from tests.looping import over


def test_perfect_model_has_no_error_but_the_offset(sine_record, dataset):
    result = compare(dataset(sine_record(P5, offset_um=-128.0)), P5)
    assert result.rmse_um("train") < 1e-12
    assert result.records["offset_um"].to_numpy() == pytest.approx([-128.0, -128.0], abs=1e-12)
    json.dumps(result.to_dict(), allow_nan=False)


def test_error_of_noise_is_the_noise(sine_record, dataset):
    noise_um = 0.05
    record = sine_record(P5, noise_um=noise_um, periods=50.0)
    result = compare(dataset(record), P5)
    # 20000 samples: the standard error of an RMS is 1 / sqrt(2 N), 0.5 %
    assert result.rmse_um() == pytest.approx(noise_um, rel=0.03)
    assert result.records["scatter_um"].to_numpy() == pytest.approx(noise_um, rel=0.05)
    assert result.noise_floor_um == pytest.approx(noise_um, rel=0.03)
    assert result.systematic_share < 0.06
    assert "hardly more than noise" in result.findings["overall"]
    assert result.plane.explained_percent < 2.0


def test_systematic_share_is_what_noise_leaves(sine_record, dataset):
    record = sine_record(P5, gain=1.02, noise_um=0.05, periods=50.0)
    result = compare(dataset(record), P5)
    share = 1.0 - (0.05 / result.rmse_um()) ** 2
    assert share > 0.5
    assert result.systematic_share == pytest.approx(share, abs=0.03)
    document = result.to_dict()
    assert document["noise_floor_um"] == result.noise_floor_um
    assert document["systematic_share"] == result.systematic_share
    assert f"{100 * result.systematic_share:.0f} %" in result.findings["overall"]


def test_checks_stand_beside_the_comparison(sine_record, dataset):
    record = sine_record(P5)
    bent = replace(record, y_um=record.y_um + 0.002 * record.y_um**2)
    document = compare(dataset(bent), P5).to_dict()
    asymmetry = next(check for check in document["checks"] if check["name"] == "asymmetry")
    assert asymmetry["zone"] == "yes"
    assert asymmetry["value"] > asymmetry["threshold"]
    assert asymmetry["suggests"] == ["asymmetry"]


def test_roles_are_weighted_by_samples(sine_record, dataset):
    long = sine_record(P5, noise_um=0.1, periods=12.0, name="long")
    short = sine_record(P5, noise_um=0.3, periods=3.0, name="short")
    held = sine_record(P5, noise_um=0.2, name="held", role="validation")
    test = sine_record(P5, noise_um=0.4, name="spare", role="test")
    result = compare(dataset(long, short, held, test), P5)
    rows = result.records.set_index("name")
    squares = rows["samples"] * rows["rmse_um"] ** 2
    pooled = np.sqrt(squares[["long", "short"]].sum() / rows["samples"][["long", "short"]].sum())
    document = result.to_dict()
    assert document["train_rmse_um"] == pytest.approx(pooled, rel=1e-12)
    assert document["validation_rmse_um"] == pytest.approx(rows.at["held", "rmse_um"])
    assert document["test_rmse_um"] == pytest.approx(rows.at["spare", "rmse_um"])


def test_gain_error_grows_with_amplitude_at_a_constant_percentage(sine_record, dataset):
    records = [
        sine_record(P5, amplitude_V=a, gain=1.05, name=f"{a}", role="validation")
        for a in (5.0, 10.0, 20.0)
    ]
    result = compare(dataset(*records), P5)
    table = result.by_amplitude
    assert table["amplitude_V"].to_numpy() == pytest.approx([5.0, 10.0, 20.0], rel=1e-3)
    assert np.all(np.diff(table["rmse_um"]) > 0)
    # a play model's gain itself grows with amplitude; the share of the stroke stays the gain error
    relative = table["relative_percent"].to_numpy()
    assert relative.max() / relative.min() < 1.1
    assert result.records["gain_ratio"].to_numpy() == pytest.approx(1.05, rel=1e-3)
    assert "grows with amplitude" in result.findings["by_amplitude"]
    assert "5 % larger" in result.findings["gain"]


def test_missing_rate_dependence_grows_with_frequency_and_widens_the_loop(sine_record, dataset):
    records = [
        sine_record(P5, frequency_hz=f, name=f"{f}", role="validation") for f in (1.0, 10.0, 100.0)
    ]
    result = compare(dataset(*records), named_plant("P5-static"))
    table = result.by_frequency
    assert table["frequency_hz"].to_numpy() == pytest.approx([1.0, 10.0, 100.0], rel=0.01)
    # Eq. 8: thresholds grow by δ2 |v|, so at first order the error is proportional to frequency
    assert table["rmse_um"].to_numpy()[1] / table["rmse_um"].to_numpy()[0] == pytest.approx(
        10, rel=0.1
    )
    assert "grows with frequency" in result.findings["by_frequency"]
    means = result.by_direction.set_index("direction")["mean_um"]
    assert means["rising"] < 0 < means["falling"]
    assert "wider than the model's" in result.findings["by_direction"]


def test_one_frequency_tells_nothing_about_frequency(sine_record, dataset):
    result = compare(dataset(sine_record(P5)), P10)
    assert "cannot tell how the error depends on frequency" in result.findings["by_frequency"]


def test_parts_add_up_to_the_whole(sine_record, dataset):
    result = compare(
        dataset(sine_record(P5, noise_um=0.1), sine_record(P5, 50.0, name="fast")), P10
    )
    total = result.rmse_um() ** 2 * result.records["samples"].sum()
    for table in (result.by_direction, result.by_command):
        assert table["samples"].sum() == result.records["samples"].sum()
        assert (table["samples"] * table["rmse_um"] ** 2).sum() == pytest.approx(total, rel=1e-9)
    whole = result.by_frequency
    assert whole["samples"].sum() == result.by_amplitude["samples"].sum()
    assert (whole["samples"] * whole["rmse_um"] ** 2).sum() < total
    assert result.plane.samples.sum() + result.plane.outside == result.records["samples"].sum()


def test_residual_that_follows_command_and_rate_is_explained(sine_record, dataset):
    record = sine_record(P5, periods=40.0)
    bent = replace(record, y_um=record.y_um + 0.01 * record.u_V**2)
    result = compare(dataset(bent), P5)
    assert result.plane.explained_percent > 95.0
    middle = np.nanmean(result.plane.mean_um[11:13])
    ends = np.nanmean(result.plane.mean_um[[0, -1]])
    assert ends - middle == pytest.approx(0.01 * 10.0**2, rel=0.15)


def test_left_out_samples_are_simulated_but_not_counted(sine_record, dataset):
    record = sine_record(P5, role="validation")
    mask = np.ones(record.t_s.size, dtype=bool)
    mask[500:600] = False
    y = record.y_um.copy()
    y[500:600] += 100.0
    result = compare(dataset(replace(record, y_um=y, error_mask=mask)), P5)
    assert result.rmse_um() < 1e-12
    assert result.records["samples"].tolist() == [mask.sum()]
    assert result.traces[0].measured_um.size == mask.size


def test_what_was_left_out_is_said(sine_record, dataset):
    record = sine_record(P5, remarks=("left out: the first 1 s (200 samples)",))
    t = np.arange(100) * 1e-3
    quiet = Record("rest", t, np.zeros(100), np.zeros(100), ts_s=1e-3)
    said = " | ".join(compare(dataset(record, quiet), P5).left_out)
    assert "sine: left out: the first 1 s (200 samples)" in said
    assert "rest: constant voltage" in said
    assert "before the first or after the last reversal" in said


def test_steady_move_of_the_residual_is_called_slow(sine_record, dataset):
    record = sine_record(P5, periods=30.0, role="validation")
    moved = replace(record, y_um=record.y_um + np.linspace(0.0, 0.4, record.t_s.size))
    assert "moves by 0.3 µm, which suggests creep" in compare(dataset(moved), P5).findings["drift"]


@over(
    "factor, words",
    [
        (1e3, "close to 10^3"),
        (1e-6, "close to 10^-6"),
        (3.0, "3 times the model's; check --units"),
        (-1.0, "moves the other way"),
    ],
)
def test_model_far_away_is_called_so(sine_record, dataset, factor, words):
    result = compare(dataset(sine_record(P5, gain=factor)), P5)
    assert next(iter(result.findings)) == "far"
    assert words in result.findings["far"]


def test_model_close_by_is_not_called_far(sine_record, dataset):
    result = compare(dataset(sine_record(P5, gain=1.05)), P5)
    assert not {"far", "range"} & result.findings.keys()


def test_dead_sensor_is_called_so(sine_record, dataset):
    record = sine_record(P5)
    result = compare(dataset(replace(record, y_um=np.zeros_like(record.y_um))), P5)
    assert "never changes" in result.findings["far"]
    json.dumps(result.to_dict(), allow_nan=False)


def test_command_beyond_the_models_range_is_said(sine_record, dataset):
    result = compare(dataset(sine_record(P5, amplitude_V=30.0)), P5)
    assert "beyond the range of -25 to 25 V" in result.findings["range"]


def test_sixteen_samples_are_enough(dataset):
    t = np.arange(16) * 1e-2
    result = compare(dataset(Record("short", t, t, 2 * t, ts_s=1e-2)), P5)
    document = json.dumps(result.to_dict(), allow_nan=False)
    assert json.loads(document)["by_frequency"] == []


@over("free_memory", [False, True])
def test_errors_are_those_that_the_fit_states(sine_record, dataset, free_memory):
    plant = Plant(P5, 1e-3)
    t = np.arange(3000) * 1e-3
    u = 5.0 + 10.0 * np.sin(2 * np.pi * 2.0 * t) + 5.0 * np.sin(2 * np.pi * 9.0 * t)
    plant.reset(memory=settled_memory(P5.hysteresis.thresholds_V, [20.0]))
    remembering = Record("remembering", t, u, plant.simulate(u), ts_s=1e-3)
    data = dataset(remembering, sine_record(P5, noise_um=0.02, name="held", role="validation"))
    found = fit(data, n=5, free_memory=free_memory)
    document = compare(data, found.plant).to_dict()
    assert document["train_rmse_um"] == pytest.approx(found.train_rmse_um, rel=1e-9)
    assert document["validation_rmse_um"] == pytest.approx(found.validation_rmse_um, rel=1e-9)
    said = any("the memory that the fit found" in line for line in document["left_out"])
    assert said == free_memory


def test_nothing_that_counts_is_refused(sine_record, dataset):
    record = sine_record(P5)
    nothing = replace(record, error_mask=np.zeros(record.t_s.size, dtype=bool))
    with pytest.raises(InputError, match="no sample counts"):
        compare(dataset(nothing), P5)
    with pytest.raises(InputError, match="no sample counts"):
        compare(Dataset("empty", ()), P5)


def test_ringing_after_steps_leads_as_a_peak_and_is_no_creep():
    ts_s, n = 5e-4, 20_000
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-30.0, 30.0, n // 400), 400)
    stage = replace(P10, effects=(CATALOGUE["resonance"](180.0, 0.01),))
    y = Plant(stage, ts_s).simulate(u) + 0.01 * rng.standard_normal(n)
    steps = Record("steps", ts_s * np.arange(n), u, y, ts_s=ts_s)
    result = compare(Dataset("steps", (steps,)), P10)
    assert result.leading[0] == "spectrum"
    assert "between 140 and 220 Hz" in result.findings["spectrum"]
    assert "since_rest" not in result.leading
    assert not any("creeps too much" in text for text in result.findings.values())


@over(
    "last_percent, says",
    [(4.8, "Relative to the stroke, the error grows"), (1.6, "changes little")],
)
def test_a_trend_follows_its_numbers(last_percent, says):
    rows = {"frequency_hz": [1.0, 10.0], "amplitude_V": [5.0, 5.0], "samples": [500, 500],
            "half_cycles": [8, 8], "rmse_um": [0.303, 0.362], "relative_percent": [1.5, last_percent]}  # fmt: skip
    assert says in text_of(findings.trend(pd.DataFrame(rows), "frequency_hz"))


def test_what_leads_carries_most_of_the_error_in_that_order(sine_record, dataset):
    bent = replace(P5, effects=(CATALOGUE["asymmetry"](0.05, 40.0),))
    result = compare(dataset(sine_record(bent, noise_um=0.002, periods=50.0)), P5)
    assert 1 <= len(result.leading) <= 3
    shares = _shares(result)
    assert [shares[key] for key in result.leading] == sorted(
        (shares[key] for key in result.leading), reverse=True
    )
    noise = compare(dataset(sine_record(P5, noise_um=0.05, periods=50.0)), P5)
    assert "gain" not in noise.leading
    assert "distortion" not in noise.leading
