"""Trainings: seeds reproduce them, interruptions leave no trace, bad input overwrites nothing."""

import csv
import json

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import torch

from baselines.learned import environments, training
from baselines.learned.checkpoint import _checkpoints
from baselines.learned.options import PLANTS
from baselines.learned.policy import Policy
from baselines.learned.training import trainer
from rdpi_gym.support.errors import InputError

TRAINERS = {name: trainer(name) for name in ("ppo", "sac", "td3", "native-ppo")}
COMMON = """default:
  n_envs: 4
  n_timesteps: 320
  env_wrapper:
    - rdpi_gym.envs.wrappers.history.HistoryObservation: {history: 2}
    - rdpi_gym.envs.wrappers.scaling.ScaledObservation: {error: 0.05}
"""
_OF_SB3 = "  gamma: 0.9\n  policy_kwargs: {net_arch: [8]}\n"
_REPLAYED = _OF_SB3 + "  buffer_size: 90\n  learning_starts: 30\n  batch_size: 16\n"
_PPO = "  n_steps: 16\n  batch_size: 32\n  n_epochs: 2\n  learning_rate: lin_1e-3\n"
SMALL = {
    "ppo": _OF_SB3 + _PPO,
    "sac": _REPLAYED + "  learning_rate: 0.001\n",
    "td3": _REPLAYED + "  noise_type: normal\n  noise_std: 0.1\n  train_freq: [2, step]\n",
    "native-ppo": "  net_arch: [8]\n" + _PPO,
}


@pytest.fixture(autouse=True)
def _few_samples(monkeypatch):
    for name, value in {"LANES": 4, "SAMPLES": 30, "FIRST": 5}.items():
        monkeypatch.setattr(environments, name, value)


def options(tmp_path, algorithm, folder="run", more="", **fields):
    path = tmp_path / f"{algorithm}.yml"
    path.write_text(f"{COMMON}{SMALL[algorithm]}{more}")
    given = {"out": tmp_path / folder, "hyperparameters": path, "every": 128, "episode": 25}
    return TRAINERS[algorithm].Options(**(given | fields))


def train(tmp_path, algorithm, *arguments, **fields):
    return TRAINERS[algorithm].train(options(tmp_path, algorithm, *arguments, **fields))


def curve(folder):
    with (folder / "training.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.glob("**/*")) if path.is_file()}


def interrupted_at(steps):
    def show(stage, done, total):
        if done >= steps:
            raise KeyboardInterrupt

    return show


@pytest.mark.parametrize(
    ("algorithm", "more", "fields"),
    [
        ("ppo", "", {}), ("ppo", "  use_sde: true\n  sde_sample_freq: 4\n", {}), ("sac", "", {}),
        ("td3", "", {}), ("native-ppo", "", {}), ("native-ppo", "", {"threads": 2}),
    ],
)  # fmt: skip
def test_an_interruption_changes_no_bit_of_the_result(
    tmp_path, algorithm, more, fields, monkeypatch
):
    whole, cut = (options(tmp_path, algorithm, name, more, **fields) for name in ("whole", "cut"))
    TRAINERS[algorithm].train(whole)
    monkeypatch.setattr(training, "LATEST_S", 0.0)
    for steps in (64, 200, 300):  # before the first checkpoint, and between others
        with pytest.raises(KeyboardInterrupt):
            TRAINERS[algorithm].train(cut, interrupted_at(steps))
        if steps < 300:  # the end of the training was kept already
            kept = Policy.load(cut.out / "latest").training["timesteps"]
            assert steps - 128 <= kept < steps
    torch.rand(3)
    np.random.rand(3)  # noqa: NPY002  # what else a process has drawn does not matter
    TRAINERS[algorithm].train(cut)
    assert curve(cut.out) == curve(whole.out)
    assert not (cut.out / "latest").exists()
    (newest,) = _checkpoints(whole.out / "checkpoint")
    assert sorted(path.name for path in newest.iterdir()) == ["checkpoint.json", "model.pt"]
    for name in ("policy/weights.pt", f"checkpoint/{newest.name}/model.pt"):
        assert (cut.out / name).read_bytes() == (whole.out / name).read_bytes(), name
    steps = [int(row["timesteps"]) for row in curve(whole.out)]
    assert steps[:3] == [0, 128, 256]
    assert steps[-1] >= 320
    assert Policy.load(cut.out / "policy").training["algorithm"] == algorithm
    before = contents(cut.out)
    TRAINERS[algorithm].train(cut)  # finished: not trained further
    assert contents(cut.out) == before


def test_a_seed_is_a_run_whose_best_policy_on_held_out_plants_is_kept(tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        train(tmp_path, "ppo", name, seed=seed, command_cost=5.0)
    weights = [(tmp_path / name / "policy" / "weights.pt").read_bytes() for name in "abc"]
    assert curve(tmp_path / "a") == curve(tmp_path / "b")
    assert weights[0] == weights[1] != weights[2]
    best = max(curve(tmp_path / "a"), key=lambda row: float(row["reward"]))
    policy = Policy.load(tmp_path / "a" / "policy")
    assert policy.training["timesteps"] == int(best["timesteps"])
    assert policy.training["rmse_um"] == float(best["rmse_um"])
    assert (policy.history, policy.error, policy.layout.action) == (2, 0.05, "correction")


def test_an_agent_without_a_baseline_is_compared_with_it(tmp_path):
    compared = set()
    for action in ("correction", "command", "increment"):
        policy = Policy.load(train(tmp_path, "ppo", action, action=action))
        assert (policy.baseline is None) == (action != "correction")
        compared |= {row["compensator_rmse_um"] for row in curve(tmp_path / action)}
    assert len(compared) == 1


def test_other_options_in_the_same_folder_are_refused_and_nothing_is_overwritten(tmp_path):
    train(tmp_path, "ppo")
    before = contents(tmp_path / "run")
    for fields, message in (
        ({"seed": 1}, r"options\.seed 0, asked for is 1"),
        ({"timesteps": 640}, "timesteps 320"),
        ({"plants": ("P10",)}, "plants"),
        ({"command_cost": 0.2}, "command_cost 0.5"),
    ):
        with pytest.raises(InputError, match=message):
            train(tmp_path, "ppo", **fields)
    with pytest.raises(InputError, match="algorithm 'ppo', asked for is 'sac'"):
        train(tmp_path, "sac")
    assert contents(tmp_path / "run") == before
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "training.csv").write_text("mine")
    with pytest.raises(InputError, match=r"without config\.json"):
        train(tmp_path, "ppo", "other")
    assert (tmp_path / "other" / "training.csv").read_text() == "mine"


def test_a_folder_that_was_damaged_is_one_line(tmp_path):
    asked = options(tmp_path, "sac")
    with pytest.raises(KeyboardInterrupt):
        TRAINERS["sac"].train(asked, interrupted_at(200))
    (newest,) = _checkpoints(asked.out / "checkpoint")

    def as_version(number):
        return lambda content: json.dumps(json.loads(content) | {"version": number}).encode()

    for path, change, message in (
        (newest / "model.pt", lambda content: content[:1000], "cut off"),
        (newest / "model.pt", lambda content: b"", "cut off"),
        (newest / "replay.npz", lambda content: content[:-200], "cut off"),
        (newest / "checkpoint.json", lambda content: content[:60], "cut off"),
        (newest / "checkpoint.json", as_version(2), "version 2"),
        (newest / "checkpoint.json", as_version("1"), "version '1'"),
        (asked.out / "config.json", as_version(7), "version 7 of rdpi-training"),
    ):
        whole = path.read_bytes()
        path.write_bytes(change(whole))
        before = contents(asked.out)
        with pytest.raises(InputError, match=message) as caught:
            TRAINERS["sac"].train(asked)
        assert "\n" not in str(caught.value)
        assert contents(asked.out) == before
        path.write_bytes(whole)


def test_bad_input_is_one_line_and_nothing_is_written(tmp_path):
    for more, fields, message in (
        ("  horizon_s: 0\n", {}, "horizon_s is 0; give a finite number above 0"),
        ("  gamma: 0.9\n", {}, "gamma is no hyper-parameter of NativePPO"),
        ("  target_kl: [1]\n", {}, r"target_kl is \[1\]"),
        ("  net_arch: [0]\n", {}, r"network widths are \[\d+, 0, 1\]"),
        ("  n_steps: 1000000000000\n", {}, "takes more memory than there is"),
        ("", {"tensorboard": True}, "writes no TensorBoard logs"),
        ("", {"lanes": 3}, "3 lanes for 4 plants"),
        ("", {"device": "cuda"}, "native-ppo has no device 'cuda'; leave --device out"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            train(tmp_path, "native-ppo", more=more, **fields)
        assert "\n" not in str(caught.value)
        assert not (tmp_path / "run").exists(), message
    document = options(tmp_path, "native-ppo").document()
    assert options(tmp_path, "native-ppo", device="cpu").document() == document


@pytest.mark.parametrize("algorithm", TRAINERS)
def test_a_training_that_diverges_says_so(tmp_path, algorithm):
    for rate in ("1.0e+38",) if algorithm == "native-ppo" else ("1.0e+30", "1.0e+38"):
        with pytest.raises(InputError, match=r"diverged .* lower learning_rate") as caught:
            train(tmp_path, algorithm, rate, more=f"  learning_rate: {rate}\n")
        assert "\n" not in str(caught.value)


def test_tensorboard_has_the_held_out_error(tmp_path):
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    train(tmp_path, "ppo", tensorboard=True)
    (folder,) = (tmp_path / "run" / "tensorboard").iterdir()
    log = events.EventAccumulator(str(folder))
    log.Reload()
    assert "held_out/rmse_um" in log.Tags()["scalars"]


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
