"""The lanes' generators give NumPy's numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rdpi_gym.envs.vector.random import (
    draw_normals,
    draw_reference,
    next_seed,
    next_uniform,
    next_word,
    seed_generator,
)
from tests.looping import over

SEEDS = st.integers(0, 2**64 - 1) | st.integers(0, 2**32)


def generators(seed):
    """Return a lane's generator and NumPy's, from one seed."""
    words = np.zeros(4, dtype=np.uint64)
    seed_generator(np.uint64(seed), words)
    return words, np.random.default_rng(seed)


@given(SEEDS)
def test_the_state_is_that_of_numpys_generator(seed):
    words, rng = generators(seed)
    high, low, increment_high, increment_low = (int(word) for word in words)
    state = rng.bit_generator.state["state"]
    assert (high << 64) + low == state["state"]
    assert (increment_high << 64) + increment_low == state["inc"]
    assert [next_word(words) for _ in range(4)] == rng.bit_generator.random_raw(4).tolist()


@given(SEEDS)
def test_seeds_and_uniform_numbers(seed):
    words, rng = generators(seed)
    assert [next_seed(words) for _ in range(3)] == rng.integers(2**63, size=3).tolist()
    assert [next_uniform(words) for _ in range(5)] == rng.random(5).tolist()


@given(SEEDS, st.integers(1, 9) | st.integers(2**31, 2**32 - 1))
def test_what_a_reference_draws(seed, choices):
    """Also where numbers are rejected: every other one is for choices just above 2**31."""
    words, rng = generators(seed)
    expected = (rng.integers(choices), rng.random(), rng.integers(2**31))
    assert draw_reference(words, choices) == pytest.approx(expected, rel=0, abs=0)


@over("seed", range(3))
def test_normal_numbers_those_of_the_tail_included(seed):
    words, rng = generators(seed)
    numbers = np.empty(20_000)
    draw_normals(words, numbers)
    np.testing.assert_array_equal(numbers, rng.standard_normal(20_000))
    assert np.abs(numbers).max() > 3.6542  # beyond the last strip
    assert next_word(words) == rng.bit_generator.random_raw()
