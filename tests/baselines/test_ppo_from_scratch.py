"""`examples/ppo_from_scratch.py` of docs/interoperability.md: it learns, ends with a policy, and its seed reproduces it."""

import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("torch")

import torch

from baselines import make_controller
from baselines.learned.policy import Policy
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError

PATH = Path(__file__).parents[2] / "examples" / "ppo_from_scratch.py"
EXAMPLE = runpy.run_path(str(PATH))
Agent, Options, train = (EXAMPLE[name] for name in ("Agent", "Options", "train"))
SMALL = {
    "total_steps": 3 * 8 * 16, "lanes": 8, "rollout": 16, "episode": 20, "history": 2,
    "hidden": 8, "minibatch": 50, "epochs": 2,
}  # fmt: skip


def test_a_tiny_run_ends_with_a_policy_that_its_seed_reproduces(tmp_path):
    folder = train(Options(out=tmp_path / "run", **SMALL))
    curve = pd.read_csv(tmp_path / "run" / "training.csv")
    assert tuple(curve) == EXAMPLE["COLUMNS"]
    assert curve["steps"].tolist() == [128, 256, 384]
    assert np.isfinite(curve.to_numpy()).all()
    policy = Policy.load(folder)
    assert (policy.history, policy.baseline) == (2, "classical-reference-rate")
    layout = replace(policy.layout, action="command")
    controller = make_controller(f"learned:{folder}", named_plant("P10"), layout)
    action, _ = controller.predict(np.zeros((3, layout.size), dtype=np.float32))
    assert np.isfinite(action).all()
    torch.manual_seed(0)
    trained, at_first = policy.actor.state_dict(), Agent(17, 8, -1.5).actor.state_dict()
    assert all(not torch.equal(trained[name], at_first[name]) for name in trained)
    for seed, same in ((0, True), (1, False)):
        other = train(Options(out=tmp_path / f"seed{seed}", seed=seed, **SMALL))
        found = Policy.load(other).actor.state_dict()
        assert all(torch.equal(found[name], trained[name]) == same for name in trained), seed


def test_the_last_observation_of_an_episode_is_not_the_first_of_the_next():
    following = np.zeros((3, 2), dtype=np.float32)
    last = np.array([None, np.ones(2, dtype=np.float32), None], dtype=object)
    over = np.array([False, True, False])
    ends = EXAMPLE["last_observations"](following, over, {"final_obs": last})
    np.testing.assert_array_equal(ends, [[0, 0], [1, 1], [0, 0]])
    assert not following.any()


def test_an_episode_that_was_cut_counts_with_the_value_of_its_last_observation():
    rewards, values = torch.tensor([[1.0], [2.0]]), torch.tensor([[1.0], [4.0]])
    nexts, over = torch.tensor([[6.0], [8.0]]), torch.tensor([[1.0], [0.0]])
    options = Options(gamma=0.5, gae_lambda=0.5)
    found = EXAMPLE["advantages_of"](options, rewards, values, nexts, over)
    # surprises: 1 + 0.5 * 6 - 1, and nothing of the next episode; then 2 + 0.5 * 8 - 4
    assert found[:, 0].tolist() == [3.0, 2.0]


def test_options_are_read_from_words():
    found = EXAMPLE["parse"](["--total-steps", "9000", "--learning-rate", "0.01"])
    assert (found.total_steps, found.learning_rate, found.gamma) == (9000, 0.01, 0.95)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"lanes": 0}, "lanes is 0"),
        ({"total_steps": 100}, "total_steps is 100; one rollout takes 128"),
        ({"seed": -1}, "seed is -1"),
        ({"plant": "P11"}, "P11"),
        ({"baseline": "nobody"}, "nobody"),
        ({"history": -1}, "history is -1"),
        ({"learning_rate": 1e30}, "diverged in iteration"),
    ],
)
def test_bad_options_are_one_line_and_nothing_is_written(tmp_path, fields, message):
    with pytest.raises(InputError, match=message) as caught:
        train(Options(out=tmp_path / "run", **(SMALL | fields)))
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_command_that_trains_nothing_says_so_in_one_line(tmp_path):
    words = [sys.executable, str(PATH), "--total-steps", "100", "--out", str(tmp_path / "run")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "error: total_steps is 100; one rollout takes 8192\n"
    assert not list(tmp_path.iterdir())
