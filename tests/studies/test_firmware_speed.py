import shutil

import pytest

from studies.firmware_speed import as_markdown, measure


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler to measure the code of")
def test_ten_plays_are_timed_in_every_precision():
    table = measure(rounds=1, names=["pi-classical-reference-rate"])
    timed = table[["double_ns", "float_ns", "Q31_ns", "python_ns"]].iloc[0]
    assert (timed > 0.0).all()
    assert timed["python_ns"] > 10.0 * timed["double_ns"]
    assert "Ten plays with PI take" in as_markdown(table, 1)
