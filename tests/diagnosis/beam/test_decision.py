import math

import numpy as np
import pytest

from rdpi_gym.diagnosis.beam.constants import TEMPERATURE
from rdpi_gym.diagnosis.beam.decision import (
    chances,
    classes,
    draw_blocks,
    drawn_weights,
    log_prior,
)


def test_of_moves_that_gain_nothing_one_in_twenty_rounds_takes_any():
    rng = np.random.default_rng(0)
    taken = [
        chances(rng.normal(size=(10, 60)), np.zeros(10), draw_blocks(60, k)).min() < 0.05
        for k in range(200)
    ]
    assert 0.01 < np.mean(taken) < 0.11


def test_a_gain_counts_beyond_its_bar_alone():
    rng = np.random.default_rng(1)
    gains, draws = 0.5 + 0.5 * rng.normal(size=(2, 80)), draw_blocks(80)
    low, high = chances(gains, np.array([0.0, 0.6]), draws)
    assert low < 0.01
    assert high > 0.5


def test_moves_that_are_one_and_the_same_cost_no_more_than_one():
    gains = np.random.default_rng(2).normal(0.25, 1.0, size=60)
    draws = draw_blocks(60)
    one = chances(gains[None], np.zeros(1), draws)[0]
    many = chances(np.tile(gains, (20, 1)), np.zeros(20), draws)[0]
    apart = np.vstack([gains, np.random.default_rng(3).normal(size=(19, 60))])
    assert many == one
    assert chances(apart, np.zeros(20), draws)[0] > one


def test_priors_of_all_sets_sum_to_one():
    total = sum(math.comb(15, k) * math.exp(log_prior(k, 15)) for k in range(16))
    assert total == pytest.approx(1.0)


def test_weights_follow_the_scores_and_are_flat_where_these_are_alike():
    draws = draw_blocks(40)
    alike = drawn_weights(np.ones((2, 40)), [0.0, 0.0], draws).mean(axis=0)
    worse = np.full(40, 10.0 * TEMPERATURE / 40)
    apart = drawn_weights(np.array([worse, np.zeros(40)]), [0.0, 0.0], draws).mean(axis=0)
    assert alike == pytest.approx([0.5, 0.5])
    assert apart[0] == pytest.approx(math.exp(-10.0), rel=1e-3)


def test_names_that_take_each_other_weight_are_one_class():
    rng = np.random.default_rng(4)
    first = rng.uniform(size=300)
    weights = np.column_stack([0.9 * first, 0.9 * (1.0 - first), np.full(300, 0.1)])
    members = [frozenset({"creep", "delay"}), frozenset({"drift", "delay"}), frozenset({"delay"})]
    found = classes(weights, members)
    assert found["creep"] == ("drift",)
    assert found["delay"] == ()
