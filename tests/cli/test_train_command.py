"""`rdpi train`: what it writes, and bad input as one line with nothing overwritten."""

import json

import matplotlib.pyplot as plt
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

import rdpi_gym as rg
from baselines.learned import environments
from baselines.learned.policy import Policy
from rdpi_gym.cli import main
from rdpi_gym.face import training
from tests.looping import over

YAML = """
default:
  n_envs: 4
  n_timesteps: 128
  n_steps: 16
  batch_size: 32
"""


SCALING = "rdpi_gym.envs.wrappers.scaling.ScaledObservation"


DRAW = training._draw


@pytest.fixture(autouse=True)
def _few_samples(monkeypatch, tmp_path):
    monkeypatch.setattr(training, "_draw", lambda _: None)  # half a second each time
    for name, value in {"LANES": 4, "SAMPLES": 30, "FIRST": 5}.items():
        monkeypatch.setattr(environments, name, value)
    (tmp_path / "small.yml").write_text(YAML)
    monkeypatch.chdir(tmp_path)


def train(*words):
    return main(["train", "ppo", "--hyperparameters", "small.yml", "--out", "run", *words])


def test_it_writes_policy_curve_configuration_and_checkpoint(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(training, "_draw", DRAW)
    assert train("--every", "64", "--frequency", "30,60", "--references", "sine, triangle") == 0
    out = capsys.readouterr().out
    assert "RMSE" in out
    assert "classical-reference-rate" in out
    run = tmp_path / "run"
    assert sorted(p.name for p in run.iterdir()) == [
        "checkpoint", "config.json", "curve.png", "policy", "training.csv", "training.html",
    ]  # fmt: skip
    page = (run / "training.html").read_text(encoding="utf-8")
    assert out.splitlines()[0].removeprefix("a").replace(" um", " µm") in page
    assert page.count('class="figure"') == 4
    assert plt.imread(run / "curve.png").shape[0] > 400
    trained = rg.Training(run, run / "policy", "pi")
    assert trained.kept_at in (0, 64, 128)
    best = trained.to_dataframe().set_index("timesteps")["reward"].idxmax()
    assert trained.kept_at == best
    curve = pd.read_csv(run / "training.csv")
    assert curve["timesteps"].tolist() == [0, 64, 128]
    assert (curve[["rmse_um", "compensator_rmse_um", "command_variation_V_s"]] > 0).all(axis=None)
    config = json.loads((run / "config.json").read_text())
    assert (config["format"], config["algorithm"], config["lanes"]) == ("rdpi-training", "ppo", 4)
    assert config["options"]["frequency_hz"] == [30.0, 60.0]
    assert config["options"]["reference"] == ["sine", "triangle"]
    trained = [[e["effect"] for e in p["effects"]] for p in config["options"]["plants"]]
    assert trained == [
        ["actuator_lag", "creep", "resonance"], ["actuator_lag", "creep"], ["creep", "resonance"], [],
    ]  # fmt: skip
    assert Policy.load(run / "policy").baseline == "classical-reference-rate"


def test_the_same_command_again_finds_it_finished(tmp_path):
    assert train() == 0
    before = (tmp_path / "run" / "training.csv").read_bytes()
    assert train() == 0
    assert (tmp_path / "run" / "training.csv").read_bytes() == before


def test_the_native_ppo_leaves_a_policy_that_is_a_controller(tmp_path, capsys):
    words = ["train", "native-ppo", "--hyperparameters", "small.yml"]
    assert main([*words, "--out", "run", "--threads", "2"]) == 0
    assert "RMSE" in capsys.readouterr().out
    assert main(["export", "onnx", "run/policy", "--out", "policy.onnx"]) == 0
    (tmp_path / "small.yml").write_text(f"{YAML}  gamma: 0.9\n")
    capsys.readouterr()
    assert main([*words, "--out", "other"]) == 2
    assert "gamma is no hyper-parameter of NativePPO" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_it_trains_on_a_plants_file_from_the_command_alone(tmp_path):
    from rdpi_gym.plant import named_plant

    named_plant("P5").save(tmp_path / "mine.json")
    assert train("--plants", "mine.json", "--belief", "P5-static", "--action", "command") == 0
    policy = Policy.load(tmp_path / "run" / "policy")
    assert (policy.layout.action, policy.layout.scale_um) == ("command", 10.0)


@over(
    "words, message",
    [
        (["--lanes", "0"], "lanes is 0"),
        (["--lanes", "3"], "3 lanes for 4 plants"),
        (["--plants", "P5,P10"], "amplitude"),
        (["--timesteps", "-5"], "timesteps is -5"),
        (["--every", "0"], "every is 0"),
        (["--plants", "P10,P11"], "P11"),
        (["--belief", "missing.json"], "missing.json"),
        (["--baseline", "clasical-static"], "classical-static"),
        (["--references", "sine,sin"], "sin"),
        (["--frequency", "20"], "--frequency '20'"),
        (["--frequency", "100,20"], "frequency_hz"),
        (["--action", "jump"], "jump"),
        (["--ts", "0"], "ts_s is 0.0"),
        (["--ts", "1e-300"], "periods of 20 to 100 Hz have"),
        (["--ts", "10"], "periods of 20 to 100 Hz have 0.005 to 0.001 samples"),
        (["--plants", ""], "no plant"),
        (["--command-cost", "-1"], "command_cost"),
        (["--hyperparameters", "none.yml"], "none.yml"),
        (["--out", "small.yml"], "small.yml"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, words, message):
    assert train(*words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("rdpi: ")
    assert message in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["small.yml"]


@over(
    "text, message",
    [
        ("default: [", "YAML"),
        ("default:\n  n_envs: 2", "n_timesteps is None"),
        ("other:\n  n_envs: 2", "no hyper-parameters under rdpi_gym/PiezoTracking-v0"),
        ("[1, 2]", "no hyper-parameters"),
        (YAML + "  gama: 0.9\n", "gama is no hyper-parameter of PPO"),
        (YAML + "  learning_rate: 1e-3\n", "learning_rate is '1e-3'"),
        (YAML + "  env_wrapper: os.system\n", "env_wrapper 'os.system' is unknown"),
        (YAML + "  env_wrapper: [3]\n", "env_wrapper 3 is unknown"),
        (YAML + f"  env_wrapper: [{{{SCALING}: {{error: big}}}}]\n", "error of"),
        (YAML + f"  env_wrapper: [{{{SCALING}: {{unit: 1}}}}]\n", "no option 'unit'"),
        (YAML + f"  env_wrapper: [{{{SCALING}: {{error: 0}}}}]\n", "error is 0"),
        (YAML + "  policy_kwargs: {nets: [8]}\n", "PPO refuses its hyper-parameters"),
        (YAML + "  seed: 3\n", "seed is no hyper-parameter"),
        (YAML.replace("n_envs: 4", "n_envs: 0"), "n_envs is 0"),
        (YAML + "  policy_kwargs: 'dict(net_arch=[8])'\n", "policy_kwargs"),
        (YAML + "  gamma: high\n", "gamma"),
        (YAML.replace("32", "-1"), "batch_size"),
        (
            "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\nb: &b [*a, *a, *a, *a, *a, *a, *a, *a, *a]\n"
            "c: &c [*b, *b, *b, *b, *b, *b, *b, *b, *b]\nd: &d [*c, *c, *c, *c, *c, *c, *c, *c, *c]\n"
            "e: [*d, *d, *d, *d, *d, *d, *d, *d, *d]\n",
            "more than 10000 values",
        ),
        ("default: " + "[" * 5000, "no YAML"),
        ("default: " + "9" * 5000, "no YAML"),
        (f"default: {10**400}", "give numbers and words"),
        ("default: 2026-13-45", "no YAML"),
        ("default: !!python/object/apply:os.system [id]", "no YAML"),
        ("default: 2026-11-22", "give numbers and words"),
        (YAML + "  gamma: .nan\n", "give numbers and words"),
        (YAML + f"  env_wrapper: [{{{SCALING}: [1]}}]\n", "give its options by name"),
        (YAML.replace("n_envs: 4", "n_envs: 4000000000"), "1000000 at most"),
        (YAML + "  policy_kwargs: {activation_fn: 'os.getcwd'}\n", "refuses its hyper-parameters"),
    ],
)
def test_bad_hyperparameters_are_one_line_and_leave_nothing(tmp_path, capsys, text, message):
    (tmp_path / "small.yml").write_text(text)
    assert train() == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["small.yml"]


def test_other_options_are_refused_and_nothing_is_overwritten(tmp_path, capsys):
    assert train() == 0
    before = {p: p.read_bytes() for p in (tmp_path / "run").glob("**/*") if p.is_file()}
    capsys.readouterr()
    assert train("--seed", "1") == 2
    assert "run holds a training with options.seed 0, asked for is 1" in capsys.readouterr().err
    after = {p: p.read_bytes() for p in (tmp_path / "run").glob("**/*") if p.is_file()}
    assert after == before


def test_an_unknown_algorithm_is_one_line(capsys):
    assert main(["train", "ddpg"]) == 2
    assert "'ddpg' is not one of 'ppo', 'sac', 'td3', 'native-ppo'" in capsys.readouterr().err


def test_an_interrupted_command_says_that_it_continues(capsys, monkeypatch):
    from baselines.learned.training import Course

    def interrupt(self, reward):
        raise KeyboardInterrupt

    monkeypatch.setattr(Course, "rewarded", interrupt)
    assert train() == 130
    progress, last = capsys.readouterr().err.splitlines()
    assert progress == "training: 0 of 128"  # no terminal: lines, the first at once
    assert (
        last == "rdpi: interrupted; what was computed is kept, and the same command goes on from it"
    )
    monkeypatch.undo()
