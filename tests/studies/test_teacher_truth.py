"""What the teacher says of a student that is turned up, and what becomes of its picture without the hysteresis."""

import pandas as pd
import pytest

pytest.importorskip("torch")

from studies import teacher_truth


def test_near_the_shipped_student_only_the_whole_picture_says_what_happens(monkeypatch):
    monkeypatch.setattr(teacher_truth, "CHANGES", ((1.0, 1.2),))
    (row,) = teacher_truth.measure("Lag", 1).to_dict("records")
    assert row["change_nm"] > 1.0
    assert row["whole"] > 95.0
    assert row["inverse_exact"] < 80.0


def test_the_sentence_is_the_tables(monkeypatch, tmp_path):
    def measured(task, plants):
        columns = ["task", "student", "change_nm", "whole", "inverse_exact"]
        return pd.DataFrame([(task, "1 to 1.2", 3.0, 99.0, float(len(task)))], columns=columns)

    monkeypatch.setattr(teacher_truth, "measure", measured)
    assert teacher_truth.main(["--out", str(tmp_path)]) == 0
    said = (tmp_path / "teacher_truth.md").read_text()
    assert "from 1 to 1.2, 99 to 99 % (3 to 9 % with" in said
