"""`rdpi tune`: the answer first, a search that goes on, and bad input as one line."""

import dataclasses
import json

import pytest

pytest.importorskip("optuna")

from baselines import CONTROLLERS
from baselines.tuning import read_tunings
from benchmarks.stages import tuning
from rdpi_gym.cli import main
from rdpi_gym.envs.tasks import TASKS
from tests.looping import over


@pytest.fixture(autouse=True)
def _small(monkeypatch, tmp_path):
    short = dataclasses.replace(TASKS["Bare"], samples=150, first=80, references=("sine",))
    monkeypatch.setattr(tuning, "named_task", lambda name: short if name == "Bare" else TASKS[name])
    monkeypatch.setattr(tuning, "VALIDATION_PLANTS", 2)
    monkeypatch.chdir(tmp_path)


def tuned(*words):
    return main(["tune", "lqg-preview", "--task", "Bare", "--plants", "2", "--out", "t", *words])


def test_it_says_what_is_certain_and_what_was_found_and_goes_on_where_it_was(tmp_path, capsys):
    assert tuned("--trials", "6") == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("lqg-preview on Bare, certificate: ")
    assert said[1].startswith("RMSE ")
    assert "untuned" in said[1]
    whole = json.loads((tmp_path / "t" / "lqg-preview.json").read_text())
    kind = CONTROLLERS["lqg-preview"]
    found = read_tunings(tmp_path / "t" / "lqg-preview.json", kind.name, kind.knobs)["Bare"]
    assert found.plant_samples == (6 * 2 + 4 * 2) * 150  # trials, then the validation of four
    assert found.effects == ()
    assert found.command == "rdpi tune lqg-preview --task Bare --trials 6 --plants 2 --seed 0"
    (tmp_path / "t" / "lqg-preview.journal").unlink()
    assert tuned("--trials", "3") == 0
    assert tuned("--trials", "6") == 0
    assert json.loads((tmp_path / "t" / "lqg-preview.json").read_text()) == whole


def test_settings_outside_the_stability_limit_are_not_chosen(monkeypatch, tmp_path):
    kind = CONTROLLERS["lqg-preview"]
    best = tuning.tune("lqg-preview", "Bare", tmp_path / "free", trials=6, plants=2).tuning.settings

    class BestIsUnstable(kind):
        @property
        def certified(self):
            found = super().certified
            return dataclasses.replace(found, radius=1.1) if self.settings == best else found

    monkeypatch.setattr(tuning, "CONTROLLERS", {"lqg-preview": BestIsUnstable})
    for folder in ("free", "held"):  # a search that is finished already, and one that is not
        found = tuning.tune("lqg-preview", "Bare", tmp_path / folder, trials=6, plants=2)
        assert found.tuning.settings != best


@over(
    "words, said",
    [
        (["pi"], "'pi' has no knobs to turn; those that have are"),
        (["dual-lop"], "did you mean 'dual-loop'?"),
        (["dual-loop", "--trials", "0"], "trials is 0; give a whole number of 1 or more"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys):
    assert main(["tune", *words, "--task", "Bare"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
