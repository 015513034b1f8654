"""The PICMA records that ship, published ones that do not, and how a user is told about them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from rdpi_gym.measurement import DATA_HINT, DataOptions, example_folder, load, measured_data
from rdpi_gym.support.errors import InputError


@pytest.fixture
def picma() -> Path:
    return example_folder("picma")


def test_an_example_that_does_not_ship_is_refused_with_those_that_do() -> None:
    with pytest.raises(InputError, match=r"no example is named 'fsm'; there is picma"):
        example_folder("fsm")


def test_its_licence_and_source_lie_beside_it(picma) -> None:
    assert "Permission is hereby granted" in (picma / "LICENSE").read_text("utf-8")
    assert "yan9a/DiscreteBacklashOperator" in (picma / "dataset.toml").read_text("utf-8")


def test_the_example_is_the_published_record(picma) -> None:
    """Digest of the numbers in the columns of the published files."""
    digests = {
        record.name: hashlib.sha256(
            record.u_V.astype("<f8").tobytes() + record.y_um.astype("<f8").tobytes()
        ).hexdigest()
        for record in load(picma).records
    }
    assert digests == {
        "identification": "aa2c851195fab4429cdbebb228f4a57cdc69a0e43ad01cd23e0b9e07a1cab2c4",
        "validation": "b198b0aa49db7a69b2e3d62e9e9c81e49c2d74ebb36ce441d72c2896b0b10b2f",
    }


def test_picma_records(picma) -> None:
    data = load(picma)
    (train,) = data.train
    (validation,) = data.validation
    assert (train.name, validation.name) == ("identification", "validation")
    assert (train.t_s.size, validation.t_s.size) == (8027 - 200, 14155 - 200)
    assert train.reference_um is None
    assert validation.reference_um is not None
    for record in (train, validation):
        assert record.t_s[0] == pytest.approx(1.0, abs=1e-12)
        assert record.ts_s == pytest.approx(5e-3, rel=1e-9)
        assert record.error_mask.all()
        assert record.u_V.min() >= 0
        assert record.u_V.max() <= 3.61
        assert record.remarks == (
            "left out: the first 1 s (200 samples)",
            "it begins with a step from 0 V, where the first displacement still is",
        )
        assert record.before_V.size == 201
    assert data.describe().count("left out: the first 1 s (200 samples)") == 2
    assert "PICMA" in data.title


def test_picma_start_up_is_left_out(picma) -> None:
    whole = load(picma, DataOptions(skip_s=0.0))
    for record, kept in zip(whole.records, load(picma).records, strict=True):
        assert record.y_um[:60].min() < kept.y_um.min() - 3.0  # the first 0.3 s
        np.testing.assert_allclose(record.y_um[200:], kept.y_um)


def test_picma_voltage_steps_where_the_compensator_was_switched_on(picma) -> None:
    """Before 37.16 s the voltage is linear in the reference, after it a feedforward runs."""
    (validation,) = load(picma).validation
    jump = np.abs(np.diff(validation.u_V))
    assert validation.t_s[1 + int(np.argmax(jump))] == pytest.approx(37.16, abs=5.1e-3)
    before = validation.t_s < 37.0
    assert validation.reference_um is not None
    u, reference = validation.u_V[before], validation.reference_um[before]
    line = np.polyval(np.polyfit(reference, u, 1), reference)
    assert np.abs(u - line).max() < 1e-3 * np.ptp(u)


def test_one_picma_file_is_read_with_what_its_folder_says(picma) -> None:
    data = load(picma / "identification.npz")
    assert data.records[0].t_s[0] == pytest.approx(1.0, abs=1e-12)
    assert "dataset.toml holds for this file too" in data.describe()
    assert data.holds_out_quarters


def test_where_the_data_are_looked_for(tmp_path, monkeypatch) -> None:
    (tmp_path / "friction_damper").mkdir()
    monkeypatch.setenv("RDPI_DATA", str(tmp_path))
    assert measured_data("friction_damper") == tmp_path / "friction_damper"
    assert measured_data("fsm") is None


def test_the_hint_names_sources_and_variable() -> None:
    for word in ("merijnfloren/fsm-benchmark-data", "Dataset-Friction-Damper", "RDPI_DATA"):
        assert word in DATA_HINT
