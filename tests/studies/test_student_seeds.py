import pandas as pd

from studies import student_seeds


def test_the_sentence_is_the_tables(monkeypatch, tmp_path, capsys):
    def measured(task, seeds, plants, runs):
        rows = [
            (task, "seed 0", 0.04, 0.5),
            (task, "seed 1", 0.05, 0.625),
            (task, student_seeds.RIVAL, 0.08, 1.0),
        ]
        return pd.DataFrame(rows, columns=["task", "student", "iqm_percent", "over_rival"])

    monkeypatch.setattr(student_seeds, "measure", measured)
    out = tmp_path / "out"
    assert student_seeds.main(["--out", str(out), "--runs", str(tmp_path / "runs")]) == 0
    assert "Stage 0.50 to 0.62; Resonance 0.50 to 0.62." in (out / "student_seeds.md").read_text()
    assert student_seeds.main(["--seeds", "1", "--out", str(out)]) == 2
    assert "--seeds" in capsys.readouterr().err
