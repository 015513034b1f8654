"""Arrays go to PyTorch and come back without a copy: what docs/interoperability.md shows."""

import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation
from tests.looping import over

PAGE = (Path(__file__).parents[2] / "docs" / "interoperability.md").read_text(encoding="utf-8")


def lanes():
    return gym.make_vec(
        "rdpi_gym/PiezoTracking-v0",
        num_envs=4,
        vectorization_mode="vector_entry_point",
        action="increment",
    )


def test_the_page_prints_what_it_shows(capsys):
    code, printed = re.search(
        r"^```python\n([^`]*from_dlpack[^`]*)```\n\n```text\n(.*?)```$", PAGE, re.M | re.S
    ).groups()
    exec(code, {})
    assert capsys.readouterr().out == printed


@over(
    "wrapped",
    [
        lambda env: env,
        lambda env: VectorHistoryObservation(env, 2),
        lambda env: VectorScaledObservation(VectorHistoryObservation(env, 2)),
    ],
)
def test_what_is_written_into_an_observation_is_seen_by_the_tensor_and_by_no_later_step(wrapped):
    env, twin = wrapped(lanes()), wrapped(lanes())
    first, _ = env.reset(seed=0)
    expected, _ = twin.reset(seed=0)
    tensor = torch.from_dlpack(first)
    np.testing.assert_array_equal(tensor.numpy(), expected)
    first[1] = 7.0
    assert (tensor[1] == 7.0).all()
    tensor[2] = -7.0
    assert (first[2] == -7.0).all()
    action = torch.full((4, 1), 0.5)
    kept = first.copy()
    following, reward, *_ = env.step(action.numpy())
    np.testing.assert_array_equal(first, kept)  # the step wrote elsewhere
    np.testing.assert_array_equal(following, twin.step(np.full((4, 1), 0.5, np.float32))[0])
    assert torch.from_dlpack(reward).data_ptr() == reward.ctypes.data


def test_observations_begin_where_jax_takes_them_over():
    env = lanes()
    shown = [env.reset(seed=0)[0], env.reset(options={"reset_mask": np.arange(4) == 2})[0]]
    shown += [env.step(np.zeros((4, 1), np.float32))[0] for _ in range(20)]
    assert {each.ctypes.data % 64 for each in shown} == {0}


def test_jax_shares_the_memory():
    jax = pytest.importorskip("jax")
    observation, _ = lanes().reset(seed=0)
    assert jax.numpy.from_dlpack(observation).unsafe_buffer_pointer() == observation.ctypes.data
