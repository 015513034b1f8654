"""The calibration finds the law that made its data, and says where it does not hold."""

import json

import numpy as np
import pytest

from rdpi_gym.diagnosis import probability
from rdpi_gym.support.store import named_rows
from studies import calibration
from studies.calibration import Known, calibration_error, fitted, report


def row(number, rng, is_true=None):
    """A search that added creep with a share; the smaller the share, the more rarely it is there."""
    share = float(rng.uniform(0.05, 0.99))
    there = bool(rng.random() < share) if is_true is None else is_true
    told = {"effect": "creep", "share": share, "confidence": 1.0, "indistinguishable": []}
    other = {"effect": "delay", "share": 0.01, "confidence": 0.0, "indistinguishable": []}
    return {
        "key": f"single/{number}", "study": "single", "status": "done", "number": number,
        "truth": {"hidden": [{"effect": "creep" if there else "delay"}], "excused": [], "alike": {}},
        "floor_um": 0.01, "base_um": 0.1, "validation_um": 0.011, "steps": [told],
        "ranking": [told, other],
    }  # fmt: skip


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(0)
    return [row(number, rng) for number in range(2000)]


def test_probabilities_that_were_fitted_hold_on_others(rows):
    found = fitted([Known.of(r) for r in rows if r["number"] % 2 == 0])
    _, judged = report(found, 1000, {"others": [Known.of(r) for r in rows if r["number"] % 2]})
    assert calibration_error(*judged["others"]["added"]) < 0.05


def test_a_study_where_names_are_wrong_is_seen(rows):
    found = fitted([Known.of(r) for r in rows])
    rng = np.random.default_rng(1)
    wrong = [Known.of(row(number, rng, is_true=False)) for number in range(200)]
    _, judged = report(found, len(rows), {"wrong": wrong})
    assert calibration_error(*judged["wrong"]["added"]) > 0.4


def test_what_was_outside_the_catalogue_hides_nothing_of_it(rows):
    outside = Known.of(rows[0] | {"study": "outside"})
    assert outside.outside
    assert outside.there == frozenset()


def test_the_command_writes_table_picture_and_what_the_package_reads(
    rows, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(calibration, "_PACKAGE", tmp_path / "probabilities.json")
    for name in ("foreign", "hidden"):
        named_rows(tmp_path / name / calibration.ROWS_FILE).append(rows[:200])
    words = [w for n in ("foreign", "hidden") for w in (f"--{n}", str(tmp_path / n))]
    assert calibration.main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "Fitted to 100 searches" in capsys.readouterr().out
    assert (tmp_path / "out" / "reliability.png").read_bytes().startswith(b"\x89PNG")
    written = json.loads((tmp_path / "probabilities.json").read_text())
    assert written["format"] == probability.FORMAT


def test_a_folder_without_rows_is_one_line(tmp_path, capsys):
    assert calibration.main(["--foreign", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "has no rows; run the study first" in said
    assert said.count("\n") == 1
