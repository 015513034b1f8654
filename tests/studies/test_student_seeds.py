import pandas as pd
import pytest

pytest.importorskip("torch")

from baselines.learned.options import CURVE
from studies import student_seeds


def test_the_sentence_is_the_tables(monkeypatch, tmp_path):
    def measured(task, timesteps, seeds, plants, runs):
        rows = [
            (task, "seed 0", 0.5, 1.0),
            (task, "seed 1", 0.625, 1.1),
            (task, student_seeds.RIVAL, 1.0, None),
        ]
        return pd.DataFrame(rows, columns=["task", "student", "over_rival", "last_over_best"])

    monkeypatch.setattr(student_seeds, "measure", measured)
    out = tmp_path / "out"
    assert student_seeds.main(["--out", str(out), "--runs", str(tmp_path / "runs")]) == 0
    said = (out / "student_seeds.md").read_text()
    assert "Stage 0.50 to 0.62; Resonance 0.50 to 0.62; Creep" in said
    assert "No training ends above 1.10 times" in said


def test_students_of_creep_are_scored_on_bare_too(monkeypatch, tmp_path):
    def trained(options, show):
        options.out.mkdir(parents=True)
        (options.out / CURVE).write_text("rmse_percent\n2.0\n1.0\n1.5\n")
        return "imitation-creep"

    monkeypatch.setattr(student_seeds, "train", trained)
    table = student_seeds.measure("Creep", 1, 1, 2, tmp_path)
    assert list(table["task"]) == ["Creep", "Creep", "Bare", "Bare"]
    student, rival = table[table["task"] == "Bare"].to_dict("records")
    assert (student["taught_on"], student["last_over_best"]) == ("Creep", 1.5)
    assert student["over_rival"] == student["iqm_percent"] / rival["iqm_percent"] < 1.0
