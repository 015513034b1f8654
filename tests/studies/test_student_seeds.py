import pandas as pd

from studies import student_seeds


def test_the_sentence_is_the_tables(monkeypatch, tmp_path, capsys):
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
    assert student_seeds.main(["--seeds", "0", "--out", str(out)]) == 2
    assert "--seeds" in capsys.readouterr().err
