"""`rdpi train --sweep`: an interrupted sweep ends as one that was not, and bad input is one line."""

import csv

import pytest
import yaml

pytest.importorskip("stable_baselines3")
pytest.importorskip("optuna")

from baselines.learned import environments
from baselines.learned.native_ppo import NativePPO
from baselines.learned.options import DivergedError
from baselines.learned.settings import SHIPPED, read_settings, read_values
from baselines.learned.stable_baselines import ALGORITHMS, StableBaselinesLearner
from baselines.learned.sweep import SPACES, read_space
from baselines.learned.training import Course
from rdpi_gym.cli import main
from tests.looping import over

YAML = """
default:
  n_envs: 4
  n_timesteps: 64
  n_steps: 8
  batch_size: 32
  learning_rate: lin_1e-3
"""
SPACE = """
learning_rate: {low: 1.0e-4, high: 1.0e-2, log: true}
gamma: [0.9, 0.95]
policy_kwargs.net_arch: [[4], [8, 8]]
"""


@pytest.fixture(autouse=True)
def _small(monkeypatch, tmp_path):
    for name, value in {"LANES": 4, "SAMPLES": 12, "FIRST": 2}.items():
        monkeypatch.setattr(environments, name, value)
    (tmp_path / "small.yml").write_text(YAML)
    (tmp_path / "space.yml").write_text(SPACE)
    monkeypatch.chdir(tmp_path)


def sweep(out, *words, trials=3):
    return main(
        ["train", "ppo", "--hyperparameters", "small.yml", "--every", "32", "--sweep", str(trials),
         "--search-space", "space.yml", "--out", out, *words]
    )  # fmt: skip


def table(folder):
    with (folder / "trials.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def test_an_interrupted_sweep_goes_on_within_its_trial_and_ends_the_same(
    tmp_path, monkeypatch, capsys
):
    assert sweep("whole") == 0
    said = capsys.readouterr().out.replace("whole", "again").splitlines()
    assert said[0].startswith("RMSE ")
    steps = []
    rewarded = Course.rewarded

    def interrupted(self, reward):
        if self.run.options.out.name == "001" and self.learner.timesteps > 40 and not steps:
            steps.append(self.learner.timesteps)
            raise KeyboardInterrupt
        rewarded(self, reward)

    monkeypatch.setattr(Course, "rewarded", interrupted)
    assert sweep("again") == 130
    assert len(table(tmp_path / "again")) == 1
    first = (tmp_path / "again" / "trials" / "000" / "training.csv").read_bytes()
    assert sweep("again", trials=2) == 0
    assert sweep("again") == 0
    assert capsys.readouterr().out.splitlines()[-3:] == said
    assert (tmp_path / "again" / "trials" / "000" / "training.csv").read_bytes() == first
    assert table(tmp_path / "again") == table(tmp_path / "whole")
    best = [(tmp_path / name / "best.yml").read_text() for name in ("whole", "again")]
    assert best[0] == best[1]
    rows = table(tmp_path / "whole")
    assert rows[0]["learning_rate"] == "0.001"  # the file's own first
    assert len({row["learning_rate"] for row in rows}) == 3
    chosen = max(rows, key=lambda row: float(row["reward"]))
    values = yaml.safe_load(best[0])["default"]
    assert values["learning_rate"] == f"lin_{chosen['learning_rate']}"
    assert str(values["policy_kwargs"]["net_arch"]) == chosen["policy_kwargs.net_arch"]
    assert sweep("again", "--seed", "1") == 2
    assert "again holds a sweep with options.seed 0, asked for is 1" in capsys.readouterr().err


def test_a_training_that_diverges_is_a_trial_that_failed(tmp_path, monkeypatch, capsys):
    learn = StableBaselinesLearner.learn

    def diverge(self, timesteps, between):
        if self.model.learning_rate(1.0) != 1e-3:
            raise DivergedError("the training diverged")
        learn(self, timesteps, between)

    monkeypatch.setattr(StableBaselinesLearner, "learn", diverge)
    assert sweep("run", trials=2) == 0
    assert [row["state"] for row in table(tmp_path / "run")] == ["finished", "diverged"]
    assert "1 of which diverged" in capsys.readouterr().out


@over(
    "words, message",
    [
        (["--sweep", "0"], "sweep is 0; give the number of trials"),
        (["--lanes", "3"], "3 lanes for 4 plants"),
        (["--search-space", "none.yml"], "none.yml"),
        (["--search-space", "small.yml"], "small.yml: default is {"),
    ],
)
def test_bad_input_is_one_line_and_a_better_command_is_taken(words, message, capsys, tmp_path):
    assert sweep("run", *words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list((tmp_path / "run").glob("trials/*"))


def test_a_search_space_without_a_sweep_is_refused(capsys):
    assert main(["train", "ppo", "--search-space", "space.yml"]) == 2
    assert "--search-space belongs to a sweep" in capsys.readouterr().err


def test_imitation_has_no_sweep(capsys):
    assert main(["train", "imitation", "--sweep", "2"]) == 2
    assert "sweep ppo, sac, td3 or native-ppo" in capsys.readouterr().err


def test_without_optuna_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "optuna", None)
    assert sweep("run") == 2
    said = capsys.readouterr().err
    assert "install rdpi-gym[tune]" in said
    assert said.count("\n") == 1


@over("algorithm", ["ppo", "sac", "td3", "native-ppo"])
def test_a_shipped_space_begins_at_the_shipped_values_and_holds_what_the_algorithm_takes(
    algorithm, tmp_path
):
    space, values = (
        read_space(SPACES / f"{algorithm}.yml"),
        read_values(SHIPPED / f"{algorithm}.yml"),
    )
    begun = space.applied(space.beginning(values), values)
    assert {name: begun[name] for name in values} | {"learning_rate": 0} == values | {
        "learning_rate": 0
    }
    kind = ALGORITHMS.get(algorithm, NativePPO)
    path = tmp_path / "begun.yml"
    path.write_text(yaml.safe_dump({"default": begun}))
    assert read_settings(path, kind).arguments()
