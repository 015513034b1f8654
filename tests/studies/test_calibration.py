"""The calibration of stated probabilities: none is wrong where they hold, and it is seen where they do not."""

import numpy as np
import pytest

from rdpi_gym.support.store import named_rows
from studies import calibration
from studies.calibration import answers, calibration_error, report
from tests.looping import over


def row(number, rng, is_true=None):
    """A search that added creep with a probability; it is there as often, unless that is asked for."""
    said = float(rng.uniform(0.05, 0.99))
    there = bool(rng.random() < said) if is_true is None else is_true
    step = {"effect": "creep", "indistinguishable": []}
    return {
        "key": f"single/{number}", "study": "single", "subject": ["creep"], "status": "done", "number": number,
        "truth": {"hidden": [{"effect": "creep" if there else "delay"}], "excused": [], "alike": {}},
        "steps": [step],
        "probabilities": {
            "effects": {"creep": said, "delay": 1.0 - said}, "classes": {"creep": said}, "none": 0.0,
            "something else": 0.0, "probable": ["creep", "delay"],
        },
    }  # fmt: skip


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(0)
    return [row(number, rng) for number in range(2000)]


def test_probabilities_that_hold_have_no_error_and_names_that_are_wrong_are_seen(rows):
    rng = np.random.default_rng(1)
    wrong = [row(number, rng, is_true=False) for number in range(200)]
    _, judged = report({"right": rows, "wrong": wrong})
    assert calibration_error(*judged["right"]["added"]) < 0.05
    assert calibration_error(*judged["wrong"]["added"]) > 0.4


@over("kinds, other", [(["preisach"], False), ([], True)])
def test_a_kind_that_the_search_does_not_have_is_outside(rows, kinds, other):
    truth = {"hidden": [], "excused": [], "alike": {}, "kinds": kinds}
    found = answers(rows[0] | {"study": "kind", "subject": ["pinched"], "truth": truth})
    assert found["other"] == [(0.0, other)]
    assert found["none"] == [(0.0, not other)]


@over("subject, other", [("force", True), ("bouc-wen", False)])
def test_what_is_outside_the_catalogue_hides_no_effect_and_a_kind_of_hysteresis_is_in_it(
    rows, subject, other
):
    found = answers(rows[0] | {"study": "outside", "subject": [subject]})
    assert found["other"] == [(0.0, other)]
    assert found["none"] == [(0.0, not other)]
    assert not any(true for _, true in found["added"] + found["not added"])


def test_the_command_writes_table_and_picture(rows, tmp_path, capsys):
    for name in calibration.FOLDERS:
        named_rows(tmp_path / name / calibration.ROWS_FILE).append(rows[:200])
    words = [w for n in calibration.FOLDERS for w in (f"--{n}", str(tmp_path / n))]
    assert calibration.main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "The largest calibration error is" in capsys.readouterr().out
    assert (tmp_path / "out" / "reliability.png").read_bytes().startswith(b"\x89PNG")


def test_a_folder_without_rows_is_one_line(tmp_path, capsys):
    assert calibration.main(["--first", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "has no rows; run the study first" in said
    assert said.count("\n") == 1
