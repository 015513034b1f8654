"""PPO in plain torch: it learns, ends with a policy, and its seed reproduces it."""

import csv
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from baselines import make_controller
from baselines.learned.policy import Policy
from baselines.learned.ppo_from_scratch import (
    COLUMNS,
    Agent,
    Options,
    last_observations,
    parse,
    train,
)
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError

SMALL = {
    "total_steps": 3 * 8 * 16, "lanes": 8, "rollout": 16, "episode": 20, "history": 2,
    "hidden": 8, "minibatch": 50, "epochs": 2,
}  # fmt: skip


def options(out, **fields):
    return Options(out=out, **(SMALL | fields))


def curve(out):
    with (out / "training.csv").open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def weights(folder):
    return Policy.load(folder).actor.state_dict()


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("scratch") / "run"
    return out, train(options(out))


def test_a_tiny_run_ends_with_a_policy_and_a_finite_curve(done):
    out, folder = done
    rows = curve(out)
    assert tuple(rows[0]) == COLUMNS
    assert [row["steps"] for row in rows] == [128, 256, 384]
    assert np.isfinite([list(row.values()) for row in rows]).all()
    policy = Policy.load(folder)
    assert (policy.history, policy.baseline) == (2, "classical-reference-rate")
    assert policy.training["algorithm"] == "ppo_from_scratch"
    plant = named_plant("P10")
    layout = replace(policy.layout, action="command")
    controller = make_controller(f"learned:{folder}", plant, layout)
    action, _ = controller.predict(np.zeros((3, layout.size), dtype=np.float32))
    assert np.isfinite(action).all()


def test_its_weights_have_moved(done):
    torch.manual_seed(0)
    at_first = Agent(17, 8, -1.5).actor.state_dict()
    trained = weights(done[1])
    assert trained.keys() == at_first.keys()
    assert all(not torch.equal(trained[name], at_first[name]) for name in trained)


def test_the_same_seed_makes_the_same_run_and_another_another(done, tmp_path):
    out, folder = done
    again = train(options(tmp_path / "again"))
    assert curve(tmp_path / "again") == curve(out)
    found, expected = weights(again), weights(folder)
    assert all(torch.equal(found[name], expected[name]) for name in expected)
    train(options(tmp_path / "other", seed=1))
    assert curve(tmp_path / "other") != curve(out)


def test_the_last_observation_of_an_episode_is_not_the_first_of_the_next():
    following = np.zeros((3, 2), dtype=np.float32)
    last = np.array([None, np.ones(2, dtype=np.float32), None], dtype=object)
    over = np.array([False, True, False])
    ends = last_observations(following, over, {"final_obs": last})
    np.testing.assert_array_equal(ends, [[0, 0], [1, 1], [0, 0]])
    assert not following.any()


def test_options_are_read_from_words():
    found = parse(["--total-steps", "9000", "--learning-rate", "0.01", "--plant", "P5"])
    assert (found.total_steps, found.learning_rate, found.plant) == (9000, 0.01, "P5")
    assert found.gamma == Options().gamma


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"lanes": 0}, "lanes is 0"),
        ({"total_steps": 100}, "total_steps is 100, fewer than one rollout .* give 128 or more"),
        ({"seed": -1}, "seed is -1"),
        ({"plant": "P11"}, "P11"),
        ({"baseline": "nobody"}, "nobody"),
        ({"history": -1}, "history is -1"),
        ({"learning_rate": 1e30}, "diverged in iteration"),
    ],
)
def test_bad_options_are_one_line_and_nothing_is_written(tmp_path, fields, message):
    with pytest.raises(InputError, match=message) as caught:
        train(options(tmp_path / "run", **fields))
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
