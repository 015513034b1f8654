"""The rival's table counts as ours does; without PySINDy its command says what to install."""

import importlib.util

import pytest

from studies import sindy_rival
from studies.sindy_rival import report

TRUTH = {
    "noise_um": 0.01, "sampling_um": 0.0, "rates_hz": [1e3], "hidden": [{"effect": "delay"}],
    "protocol": "multisines", "degraded": "", "excused": [], "alike": {"delay": ["sensor_lag"]},
}  # fmt: skip


def row(name):
    said = [{"effect": name, "confidence": 0.9}]
    return {
        "key": f"single/{name}", "study": "single", "subject": ["delay"], "number": 0, "seed": 0,
        "status": "done", "noise_um": 0.01, "validation_um": 0.01, "verdict": "unexplained",
        "seconds": 1.0, "ranking": said, "steps": said, "truth": TRUTH,
        "true_left": {"clean_um": 0.0, "by_input_um": 0.0},
    }  # fmt: skip


def test_names_count_by_class_and_others_are_falsely_added():
    rows = [row("delay"), row("sensor_lag"), row("creep")]
    line = report({"E-SINDy": rows}, "1/8", 0).splitlines()[4]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[:3] == ["E-SINDy", "3", "2 of 3"]
    assert cells[5] == "1 of 3"


@pytest.mark.skipif(importlib.util.find_spec("pysindy") is not None, reason="PySINDy is there")
def test_without_pysindy_one_line_says_what_to_install(tmp_path, capsys):
    assert sindy_rival.main(["--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "install it with: pip install 'rdpi-gym[sindy]'" in said
    assert said.count("\n") == 1
