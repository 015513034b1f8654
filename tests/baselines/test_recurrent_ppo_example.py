"""`examples/recurrent_ppo.py`: a few updates, and that the memory is the same in rollout and update."""

import runpy
from pathlib import Path

import pytest

pytest.importorskip("torch")

import torch

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "recurrent_ppo.py"))
Agent, Options, train = (EXAMPLE[name] for name in ("Agent", "Options", "train"))


def small(out, **fields):
    asked = {"iterations": 2, "lanes": 4, "episode": 12, "hidden": 5, "epochs": 2, "minibatch": 2}
    return Options(task="rdpi_gym/PiezoBare-v0", out=out, **(asked | fields))


def curve(rows):
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def test_a_few_updates_move_every_weight_and_the_seed_reproduces_them(tmp_path):
    rows = curve(train(small(tmp_path / "a" / "one.pt")))
    assert [row["steps"] for row in rows] == [48, 96]
    assert all(row["reward"] < 0.0 < row["log_density_change"] for row in rows)
    assert curve(train(small(tmp_path / "two.pt"))) == rows
    assert curve(train(small(tmp_path / "three.pt", seed=1))) != rows
    torch.manual_seed(0)
    at_first = Agent(11, 5, -1.5).state_dict()
    trained = torch.load(tmp_path / "a" / "one.pt", weights_only=True)
    assert all(not torch.equal(trained[name], at_first[name]) for name in at_first)


def test_a_sequence_at_once_remembers_what_it_does_sample_by_sample():
    torch.manual_seed(0)
    agent, shown, past, means = Agent(3, 5, -1.5), torch.randn(6, 2, 3), None, []
    with torch.no_grad():
        whole, _, _ = agent(shown)
        for k in range(6):
            mean, _, past = agent(shown[k][None], past)
            means.append(mean)
        torch.testing.assert_close(torch.cat(means), whole)
        shown[0] += 1.0
        assert (agent(shown)[0][5] != whole[5]).all()  # what was seen first is not forgotten


def test_advantages_count_what_comes_after_the_cut():
    rollout = EXAMPLE["Rollout"](
        *[torch.zeros(1)] * 3,
        torch.tensor([[1.0], [2.0], [4.0]]),
        torch.tensor([[1.0], [1.0]]),
        0.0,
    )
    found = EXAMPLE["advantages_of"](rollout, 0.5, 0.5)
    # surprises: 1 + 0.5 * 2 - 1, then 1 + 0.5 * 4 - 2
    assert found[:, 0].tolist() == [1.0 + 0.25 * 1.0, 1.0]


def test_options_are_read_from_words():
    found = EXAMPLE["parse"](["--iterations", "3", "--task", "rdpi_gym/PiezoBare-v0"])
    assert (found.iterations, found.task, found.lanes) == (3, "rdpi_gym/PiezoBare-v0", 64)
