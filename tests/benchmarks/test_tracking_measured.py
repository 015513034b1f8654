"""Feedforwards on measured records: the command beside the voltage that was really applied."""

import numpy as np
import pytest

from benchmarks.tracking import measured
from benchmarks.tracking.measured import COLUMNS, local_gain, score_measured, score_records
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import RDPI, Plant, PlantModel, named_plant

STACK = PlantModel(
    RDPI.from_law([10.0, 2.0, 1.0, 0.5], 0.15, 0.0), "stack", (0.0, 4.0), (25.0, 20.0),
    offset_um=-3.0,
)  # fmt: skip
TS_S = 5e-3
T = np.arange(1000) * TS_S
U = 1.8 - 1.8 * np.cos(2 * np.pi * T) * np.minimum(1.0, 0.6 + T / 5.0)


def table(*controllers, add_um=0.0, **options):
    y = Plant(STACK, TS_S).simulate(U) + add_um
    record = Record("run", T, U, y, ts_s=TS_S, **options)
    return score_records(Dataset("d", (record,)), controllers, STACK).table


def test_the_exact_inverse_returns_the_applied_voltage_whatever_the_sensors_zero_is():
    found = table("classical-static", "pi", "none")
    assert tuple(found.columns) == COLUMNS
    found = found.set_index("controller")
    assert list(found.index) == ["classical-static", "none"]  # feedback has nothing to feed back
    assert found.loc["classical-static", "rms_V"] < 1e-12
    assert found.loc["none", "rms_V"] > 0.02
    assert (found["samples"] == 800).all()
    row = table("classical-static", add_um=70.0).iloc[0]
    assert row["rms_V"] < 1e-12
    assert row["offset_um"] == pytest.approx(70.0)


def test_micrometres_are_volts_times_the_local_gain(monkeypatch):
    class Half:
        def command_block(self, reference_um):
            return U[:, None] + np.where(np.arange(1000) % 2, 0.1, -0.1)[:, None]

    monkeypatch.setattr(measured, "make_controller", lambda *_: Half())
    row = table("mine").iloc[0]
    gain = local_gain(STACK.hysteresis, U, TS_S)[200:]
    assert row["rms_V"] == pytest.approx(0.1)
    assert row["rms_um"] == pytest.approx(0.1 * np.sqrt(np.mean(gain**2)))
    assert gain.min() == STACK.hysteresis.a0
    assert gain.max() == pytest.approx(STACK.hysteresis.A)


def test_what_is_masked_does_not_count():
    k = np.arange(1000)
    row = table("classical-static", add_um=np.where(k < 900, 0.0, 5.0), error_mask=k < 500).iloc[0]
    assert (row["samples"], row["rms_V"] < 1e-12) == (300, True)


def test_a_failing_controller_leaves_a_row_that_says_so(monkeypatch):
    class Raises:
        def command_block(self, reference_um):
            raise RuntimeError("no")

    monkeypatch.setattr(measured, "make_controller", lambda *_: Raises())
    found = table("mine")
    assert found["status"].tolist() == ["error: RuntimeError: no"]
    assert found["rms_V"].isna().all()


def test_on_the_measured_stack_compensation_is_far_nearer_to_the_applied_voltage_than_none():
    found = score_measured(["none", "classical-reference-rate"], named_plant("picma")).table
    volts = found.pivot(index="record", columns="controller", values="rms_V")
    assert set(volts.index) == {"identification", "validation"}
    assert (volts["classical-reference-rate"] < 0.25 * volts["none"]).all()
