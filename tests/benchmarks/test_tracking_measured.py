import numpy as np
import pytest

from benchmarks.tracking import measured
from benchmarks.tracking.measured import COLUMNS, local_gain, score_measured, score_records
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import RDPI, Plant, PlantModel, named_plant

STACK = PlantModel(
    RDPI.from_law([10.0, 2.0, 1.0, 0.5], 0.15, 0.0),
    "stack",
    (0.0, 4.0),
    (25.0, 20.0),
    offset_um=-3.0,
)
TS_S = 5e-3


def record(name="run", shift_um=0.0):
    t = np.arange(1000) * TS_S
    u = 1.8 - 1.8 * np.cos(2 * np.pi * t) * np.minimum(1.0, 0.6 + t / 5.0)
    y = Plant(STACK, TS_S).simulate(u) + shift_um
    return Record(name, t, u, y, ts_s=TS_S)


def test_the_exact_inverse_returns_the_applied_voltage():
    scores = score_records(Dataset("d", (record(),)), ["classical-static", "pi", "none"], STACK)
    table = scores.table.set_index("controller")
    assert tuple(scores.table.columns) == COLUMNS
    assert list(table.index) == ["classical-static", "none"]  # feedback has nothing to feed back
    assert table.loc["classical-static", "rms_V"] < 1e-12
    assert table.loc["none", "rms_V"] > 0.02
    assert (table["samples"] == 800).all()


def test_the_sensors_zero_is_the_free_constant():
    scores = score_records(Dataset("d", (record(shift_um=70.0),)), ["classical-static"], STACK)
    row = scores.table.iloc[0]
    assert row["rms_V"] < 1e-12
    assert row["offset_um"] == pytest.approx(70.0)


def test_micrometres_are_volts_times_the_local_gain(monkeypatch):
    class Half:
        def command_block(self, reference_um):
            return one.u_V[:, None] + np.where(np.arange(1000) % 2, 0.1, -0.1)[:, None]

    one = record()
    monkeypatch.setattr(measured, "make_controller", lambda *_: Half())
    row = score_records(Dataset("d", (one,)), ["mine"], STACK).table.iloc[0]
    gain = local_gain(STACK.hysteresis, one.u_V, TS_S)[200:]
    assert row["rms_V"] == pytest.approx(0.1)
    assert row["rms_um"] == pytest.approx(0.1 * np.sqrt(np.mean(gain**2)))
    assert gain.min() == STACK.hysteresis.a0
    assert gain.max() == pytest.approx(STACK.hysteresis.A)


def test_what_is_masked_does_not_count():
    one = record()
    mask = np.ones(1000, dtype=bool)
    mask[500:] = False
    wild = one.y_um.copy()
    wild[900:] += 5.0
    masked = Record("run", one.t_s, one.u_V, wild, ts_s=TS_S, error_mask=mask)
    row = score_records(Dataset("d", (masked,)), ["classical-static"], STACK).table.iloc[0]
    assert (row["samples"], row["rms_V"] < 1e-12) == (300, True)


def test_a_failing_controller_leaves_a_row_that_says_so(monkeypatch):
    class Raises:
        def command_block(self, reference_um):
            raise RuntimeError("no")

    monkeypatch.setattr(measured, "make_controller", lambda *_: Raises())
    table = score_records(Dataset("d", (record(),)), ["mine"], STACK).table
    assert table["status"].tolist() == ["error: RuntimeError: no"]
    assert table["rms_V"].isna().all()


def test_on_the_measured_stack_compensation_is_far_nearer_to_the_applied_voltage_than_none():
    table = score_measured(["none", "classical-reference-rate"], named_plant("picma")).table
    volts = table.pivot(index="record", columns="controller", values="rms_V")
    assert set(volts.index) == {"identification", "validation"}
    assert (volts["classical-reference-rate"] < 0.25 * volts["none"]).all()
