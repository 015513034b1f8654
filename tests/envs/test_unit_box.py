"""The action space is a Box in all but speed."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space

from rdpi_gym.envs import UnitBox

PLAIN = Box(-1.0, 1.0, (1,), np.float32)


def test_equal_to_the_plain_box_both_ways():
    ours, plain = UnitBox(), PLAIN
    assert ours == plain
    assert plain == ours


def test_samples_are_those_of_the_plain_box():
    ours, plain = UnitBox(seed=7), Box(-1.0, 1.0, (1,), np.float32, seed=7)
    drawn = [(ours.sample(), plain.sample()) for _ in range(1000)]
    assert all(np.array_equal(a, b) and a.dtype == b.dtype and a.shape == b.shape for a, b in drawn)
    assert all(ours.contains(a) for a, _ in drawn)


def test_batched_as_the_plain_box():
    assert batch_space(UnitBox(), 4) == batch_space(PLAIN, 4)
    assert batch_space(UnitBox(seed=0), 4).sample().shape == (4, 1)


def test_pickled_with_its_generator():
    space = UnitBox(seed=1)
    space.sample()
    twin = pickle.loads(pickle.dumps(space))
    assert twin == space
    assert twin.sample() == space.sample()


def test_refuses_a_mask_as_the_plain_box_does():
    with pytest.raises(gym.error.Error, match="mask"):
        UnitBox().sample(mask=np.ones(1))
