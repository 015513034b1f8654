"""Training: seeds reproduce it, interruptions leave no trace, bad input overwrites nothing."""

import csv
import json

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import torch

from baselines.learned import environments
from baselines.learned.checkpoint import _checkpoints
from baselines.learned.options import PLANTS
from baselines.learned.policy import Policy
from baselines.learned.training import trainer
from rdpi_gym.support.errors import InputError

TRAINERS = {name: trainer(name) for name in ("ppo", "sac", "td3")}
WRAPPERS = """
  env_wrapper:
    - rdpi_gym.envs.wrappers.history.HistoryObservation: {history: 2}
    - rdpi_gym.envs.wrappers.scaling.ScaledObservation: {error: 0.05}
"""
SMALL = {
    "ppo": "n_steps: 16\n  batch_size: 32\n  n_epochs: 2\n  learning_rate: lin_1e-3",
    "sac": "buffer_size: 90\n  learning_starts: 30\n  batch_size: 16\n  learning_rate: 0.001",
    "td3": "buffer_size: 90\n  learning_starts: 30\n  batch_size: 16\n  noise_type: normal\n"
    "  noise_std: 0.1\n  train_freq: [2, step]",
}
COMMON = "  n_envs: 4\n  n_timesteps: 320\n  gamma: 0.9\n  policy_kwargs: {net_arch: [8]}\n  "


@pytest.fixture(autouse=True)
def _few_samples(monkeypatch):
    for name, value in {"LANES": 4, "SAMPLES": 30, "FIRST": 5}.items():
        monkeypatch.setattr(environments, name, value)


def options(tmp_path, algorithm, folder="run", more="", **fields):
    path = tmp_path / f"{algorithm}.yml"
    path.write_text(f"default:\n{COMMON}{SMALL[algorithm]}{more}{WRAPPERS}")
    given = {"out": tmp_path / folder, "hyperparameters": path, "every": 128, "episode": 25}
    return TRAINERS[algorithm].Options(**(given | fields))


def curve(folder):
    with (folder / "training.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def weights(folder):
    return Policy.load(folder / "policy").actor.state_dict()


def last_checkpoint(folder):
    (newest,) = _checkpoints(folder / "checkpoint")
    return torch.load(newest / "model.pt", weights_only=True)["parameters"]


def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b


def interrupted_at(steps):
    def show(stage, done, total):
        if done >= steps:
            raise KeyboardInterrupt

    return show


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "more"),
    [("ppo", ""), ("ppo", "\n  use_sde: true\n  sde_sample_freq: 4"), ("sac", ""), ("td3", "")],
)
def test_an_interruption_changes_no_bit_of_the_result(tmp_path, algorithm, more):
    train = TRAINERS[algorithm].train
    whole = options(tmp_path, algorithm, "whole", more)
    train(whole)
    cut = options(tmp_path, algorithm, "cut", more)
    for steps in (64, 200, 300):  # before the first checkpoint, and between others
        with pytest.raises(KeyboardInterrupt):
            train(cut, interrupted_at(steps))
    torch.rand(3)
    np.random.rand(3)  # noqa: NPY002  # what else a process has drawn does not matter
    train(cut)
    assert curve(cut.out) == curve(whole.out)
    assert same(weights(cut.out), weights(whole.out))
    assert same(last_checkpoint(cut.out), last_checkpoint(whole.out))
    steps = [int(row["timesteps"]) for row in curve(whole.out)]
    assert steps[0] == 0
    assert steps[-1] >= 320
    assert steps[1:3] == [128, 256]


def test_a_finished_training_is_not_trained_further(tmp_path):
    asked = options(tmp_path, "sac")
    TRAINERS["sac"].train(asked)
    before = curve(asked.out), weights(asked.out)
    assert TRAINERS["sac"].train(asked) == asked.out / "policy"
    assert curve(asked.out) == before[0]
    assert same(weights(asked.out), before[1])
    (newest,) = _checkpoints(asked.out / "checkpoint")
    assert sorted(path.name for path in newest.iterdir()) == ["checkpoint.json", "model.pt"]


def test_a_seed_is_a_run(tmp_path):
    first, again, other = (
        options(tmp_path, "ppo", name, seed=seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    for each in (first, again, other):
        TRAINERS["ppo"].train(each)
    assert curve(first.out) == curve(again.out)
    assert same(weights(first.out), weights(again.out))
    assert not same(weights(first.out), weights(other.out))


def test_the_policy_that_is_kept_is_the_best_on_the_held_out_plants(tmp_path):
    asked = options(tmp_path, "ppo", command_cost=5.0)
    TRAINERS["ppo"].train(asked)
    rows = curve(asked.out)
    best = max(rows, key=lambda row: float(row["reward"]))
    policy = Policy.load(asked.out / "policy")
    assert policy.training["timesteps"] == int(best["timesteps"])
    assert policy.training["rmse_um"] == float(best["rmse_um"])
    assert (policy.history, policy.error, policy.layout.action) == (2, 0.05, "correction")


@pytest.mark.parametrize("action", ["command", "increment"])
def test_an_agent_without_a_baseline_is_compared_with_it(tmp_path, action):
    asked = options(tmp_path, "ppo", action=action)
    TRAINERS["ppo"].train(asked)
    correcting = options(tmp_path, "ppo", "other")
    TRAINERS["ppo"].train(correcting)
    assert Policy.load(asked.out / "policy").baseline is None
    name = "compensator_rmse_um"
    assert {row[name] for row in curve(asked.out)} == {row[name] for row in curve(correcting.out)}


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.glob("**/*")) if path.is_file()}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"seed": 1}, r"options\.seed 0, asked for is 1"),
        ({"timesteps": 640}, "timesteps 320"),
        ({"plants": ("P10",)}, "plants"),
        ({"command_cost": 0.2}, "command_cost 0.5"),
    ],
)
def test_other_options_in_the_same_folder_are_refused_and_nothing_is_overwritten(
    tmp_path, fields, message
):
    TRAINERS["ppo"].train(options(tmp_path, "ppo"))
    before = contents(tmp_path / "run")
    with pytest.raises(InputError, match=message):
        TRAINERS["ppo"].train(options(tmp_path, "ppo", **fields))
    with pytest.raises(InputError, match="algorithm 'ppo', asked for is 'sac'"):
        TRAINERS["sac"].train(options(tmp_path, "sac"))
    assert contents(tmp_path / "run") == before


def test_results_without_a_configuration_are_not_overwritten(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "training.csv").write_text("mine")
    with pytest.raises(InputError, match=r"without config\.json"):
        TRAINERS["ppo"].train(options(tmp_path, "ppo"))
    assert (tmp_path / "run" / "training.csv").read_text() == "mine"


def damage(path, change):
    content = path.read_bytes()
    path.write_bytes(change(content))


def as_version(number):
    def change(content):
        return json.dumps(json.loads(content) | {"version": number}).encode()

    return change


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("model.pt", lambda content: content[:1000], "cut off"),
        ("model.pt", lambda content: b"", "cut off"),
        ("replay.npz", lambda content: content[:-200], "cut off"),
        ("checkpoint.json", lambda content: content[:60], "cut off"),
        ("checkpoint.json", as_version(2), "version 2"),
        ("checkpoint.json", as_version("1"), "version '1'"),
    ],
)
def test_a_checkpoint_that_cannot_be_gone_on_from_is_one_line(tmp_path, name, change, message):
    asked = options(tmp_path, "sac")
    with pytest.raises(KeyboardInterrupt):
        TRAINERS["sac"].train(asked, interrupted_at(200))
    (newest,) = _checkpoints(asked.out / "checkpoint")
    damage(newest / name, change)
    before = contents(asked.out)
    with pytest.raises(InputError, match=message) as caught:
        TRAINERS["sac"].train(asked)
    assert "\n" not in str(caught.value)
    assert contents(asked.out) == before


def test_a_configuration_of_another_version_is_one_line(tmp_path):
    asked = options(tmp_path, "ppo")
    TRAINERS["ppo"].train(asked)
    damage(asked.out / "config.json", as_version(7))
    before = contents(asked.out)
    with pytest.raises(InputError, match="version 7 of rdpi-training"):
        TRAINERS["ppo"].train(asked)
    assert contents(asked.out) == before


@pytest.mark.parametrize("algorithm", TRAINERS)
def test_a_training_that_diverges_says_so(tmp_path, algorithm):
    asked = options(tmp_path, algorithm)
    text = asked.hyperparameters.read_text()
    for rate in ("lin_1e-3", "0.001"):
        text = text.replace(f"learning_rate: {rate}", "learning_rate: 1.0e+30")
    if "learning_rate" not in text:
        text = text.replace("gamma", "learning_rate: 1.0e+30\n  gamma")
    asked.hyperparameters.write_text(text)
    with pytest.raises(InputError, match=r"diverged .* lower learning_rate"):
        TRAINERS[algorithm].train(asked)


def test_tensorboard_has_the_held_out_error(tmp_path):
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    TRAINERS["ppo"].train(options(tmp_path, "ppo", tensorboard=True))
    (folder,) = (tmp_path / "run" / "tensorboard").iterdir()
    log = events.EventAccumulator(str(folder))
    log.Reload()
    assert "held_out/rmse_um" in log.Tags()["scalars"]


@pytest.mark.slow
def test_within_seconds_ppo_halves_the_compensators_error_without_dither(tmp_path, monkeypatch):
    monkeypatch.undo()
    everything = PLANTS[:1]  # lag, creep and resonance, none of which the baseline believes in
    asked = TRAINERS["ppo"].Options(
        out=tmp_path / "run", plants=everything, timesteps=150_000, every=150_000
    )
    policy = Policy.load(TRAINERS["ppo"].train(asked))
    compensator = {k: float(v) for k, v in curve(asked.out)[0].items() if "compensator" in k}
    assert policy.training["rmse_um"] < 0.5 * compensator["compensator_rmse_um"]
    variation = compensator["compensator_command_variation_V_s"]
    assert policy.training["command_variation_V_s"] < 1.5 * variation
