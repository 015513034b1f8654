"""What a refit decides: gain over the noise, records that become worse, and how sure an improvement is."""

import math

import numpy as np
import pytest

from rdpi_gym.diagnosis.results import Errors
from rdpi_gym.diagnosis.search.candidates import Outcome
from rdpi_gym.diagnosis.search.ranking import LEAST_GAIN, LEAST_SHARE, rank
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.identification.residuals import PIECES, beats
from rdpi_gym.plant import P5
from rdpi_gym.plant.effects import CATALOGUE

NOISE_UM = 0.1
EXCESS = 1.0 - NOISE_UM**2
CREEP = CATALOGUE["creep"]


def outcome(effect, train_um, *records):
    """A refit whose validation records have these mean squares (µm²)."""
    pieces = np.repeat(np.array(records)[:, None], PIECES, axis=1)
    names = {"run": train_um, **{f"record {k}": math.sqrt(x) for k, x in enumerate(records)}}
    fit = JointFit(Variant(P5.hysteresis, (CREEP(),)), train_um, (), {}, 3, True)
    return Outcome(effect, fit, Errors(train_um, math.sqrt(np.mean(pieces)), 0.0, names), pieces)


NOW = outcome("", 1.0, 1.0, 1.0)


def ranked(candidate):
    (found,) = rank(NOW, [candidate], [CREEP], NOISE_UM, seed=0)
    return found


def test_a_candidate_is_worth_the_smaller_share_of_the_excess_over_the_noise():
    found = ranked(outcome("creep", 0.7, 0.25, 0.25))
    assert found.earned
    assert found.candidate.share == pytest.approx(0.75 / EXCESS)
    assert found.worth == found.train_share == pytest.approx((1.0 - 0.49) / EXCESS)


def test_a_gain_counts_where_it_is_more_than_a_share_of_the_noise_and_of_the_excess():
    least = sorted((LEAST_GAIN * NOISE_UM**2, LEAST_SHARE * EXCESS))
    for gain, earned in (
        (0.9 * least[0], False),
        (math.sqrt(math.prod(least)), False),
        (1.1 * least[1], True),
    ):
        assert ranked(outcome("creep", 0.5, 1.0 - gain, 1.0 - gain)).earned is earned, gain


def test_a_candidate_that_makes_a_record_worse_is_not_added():
    found = ranked(outcome("creep", 0.5, 0.1, 1.4))
    assert found.worse
    assert not found.earned
    assert found.candidate.remarks == ("record 1 becomes worse",)


def test_the_winner_is_better_in_the_share_of_draws():
    rng = np.random.default_rng(0)
    large, small = np.ones((2, PIECES)), 0.9 * np.ones((2, PIECES))
    assert beats(large, small, rng) == 1.0
    assert beats(small, large, rng) == 0.0
    mixed = np.where(np.arange(2 * PIECES) % 2, 0.8, 1.2).reshape(2, PIECES)
    assert 0.2 < beats(large, mixed, rng) < 0.8
