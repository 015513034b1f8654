import numpy as np
import pytest
from scipy.signal import lfilter

from rdpi_gym.diagnosis.beam import constants
from rdpi_gym.diagnosis.beam.score import (
    Blocks,
    correlation_length,
    cross_fitted,
    independent_share,
    orthogonal,
)


def test_white_noise_is_correlated_over_one_sample_and_an_autoregression_over_its_memory():
    rng = np.random.default_rng(0)
    white = rng.normal(size=20_000)
    slow = lfilter([1.0], [1.0, -0.9], white)
    assert correlation_length(white) == pytest.approx(1.0, abs=0.1)
    assert correlation_length(slow) == pytest.approx(1.9 / 0.1, rel=0.25)  # (1 + a) / (1 - a)


def test_values_of_white_noise_are_independent_and_of_an_autoregression_few():
    """Bartlett's 1 / Σ ρ_k² is (1 - a²) / (1 + a²) for ρ_k = a^|k|."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=200_000)
    slow = lfilter([1.0], [1.0, -0.9], white)
    assert independent_share(white) == pytest.approx(1.0, abs=0.05)
    assert independent_share(slow) == pytest.approx(0.19 / 1.81, rel=0.1)
    assert independent_share(np.ones(9)) == 1.0


def test_a_residual_that_repeats_is_no_more_than_one_period():
    rng = np.random.default_rng(1)
    period = rng.normal(size=500)
    assert independent_share(np.tile(period, 20)) == pytest.approx(1 / 20, rel=0.15)
    blocks = Blocks((4, 2))
    shares = blocks.independent([np.tile(period, 20), rng.normal(size=4000)])
    assert shares == pytest.approx([1 / 20] * 4 + [1.0] * 2, rel=0.15)


def test_scores_are_logarithms_above_the_floor_and_zero_below():
    left = np.concatenate([np.full(100, 2.0), np.full(100, 0.1)])
    blocks = Blocks((2,))
    assert blocks.scores([left], np.ones(1)) == pytest.approx([np.log(4.0), 0.0])


def test_a_residual_that_leaves_the_floats_at_no_floor_scores_as_a_large_one():
    blocks = Blocks((2,))
    wild, floor_um = np.full(8, 1e10), np.zeros(8)  # 1e160 floors, whose square is no number
    assert np.isfinite(blocks.scores([wild], [floor_um])).all()
    assert (blocks.scores([wild], [floor_um]) > blocks.scores([np.ones(8)], [np.ones(8)])).all()


def test_noise_at_its_floor_scores_what_is_expected_of_it():
    rng, blocks = np.random.default_rng(0), Blocks((32, 16))
    drawn = [[rng.normal(size=1600), rng.normal(size=3200)] for _ in range(200)]
    found = np.mean([blocks.scores(lefts, np.ones(2)) for lefts in drawn], axis=0)
    expected = blocks.of_noise(drawn[0])
    assert found[:32].mean() == pytest.approx(expected[0], rel=0.1)
    assert found[32:].mean() == pytest.approx(expected[-1], rel=0.1)


def test_a_slow_residual_has_few_blocks_and_a_white_one_many():
    rng = np.random.default_rng(1)
    slow = np.cumsum(rng.normal(size=4000))
    assert Blocks.of([slow]).counts == (constants.FEWEST_BLOCKS,)
    assert Blocks.of([rng.normal(size=4000)]).counts == (constants.MOST_BLOCKS,)


def test_cross_fit_of_a_linear_model_is_the_refit_without_each_stretch():
    rng = np.random.default_rng(2)
    x, noise = rng.normal(size=(320, 3)), rng.normal(size=320)
    y = x @ [1.0, -2.0, 0.5] + noise
    whole = np.linalg.lstsq(x, y, rcond=None)[0]
    rows = np.column_stack([x, y - x @ whole])
    (found,) = cross_fitted([rows], np.ones(3, dtype=np.bool_))
    part = np.arange(320) < 320 // constants.FOLDS
    rest = np.linalg.lstsq(x[~part], y[~part], rcond=None)[0]
    assert found[part] == pytest.approx((y - x @ rest)[part], abs=1e-5)
    assert np.sum(found**2) > np.sum(rows[:, -1] ** 2)


def test_a_number_that_may_not_move_has_no_part_in_the_cross_fit():
    rng = np.random.default_rng(3)
    x, left = rng.normal(size=(200, 2)), rng.normal(size=200)
    one = cross_fitted([np.column_stack([x[:, :1], left])], np.array([True]))
    both = cross_fitted([np.column_stack([x, left])], np.array([True, False]))
    assert both[0] == pytest.approx(one[0])


def test_numbers_of_the_experiment_go_on_in_records_to_judge_by_and_those_of_the_plant_do_not():
    rng = np.random.default_rng(5)
    plant, later = rng.normal(size=(2, 320))
    fitted = np.column_stack([plant, np.zeros(320), 0.01 * rng.normal(size=320)])
    judged = np.column_stack([plant, later, plant + 2.0 * later])
    moves, own = np.array([True, True]), np.array([False, True])
    alone = cross_fitted([fitted], moves, [judged])[1]
    both = cross_fitted([fitted], moves, [judged], own)[1]
    assert alone == pytest.approx(plant + 2.0 * later, abs=0.01)
    part = slice(0, 320 // constants.FOLDS)
    rest = slice(part.stop, None)
    step = (later[rest] @ judged[rest, -1]) / (later[rest] @ later[rest])
    assert both[part] == pytest.approx((judged[:, -1] - step * later)[part], abs=0.01)


def test_phantom_columns_hold_nothing_of_the_effect_own_ones():
    rng = np.random.default_rng(4)
    own = [rng.normal(size=(50, 2)), rng.normal(size=(70, 2))]
    ghosts = [a @ [[1.0], [2.0]] + rng.normal(size=(len(a), 1)) for a in own]
    left = np.concatenate(orthogonal(ghosts, own))
    assert np.abs(np.concatenate(own).T @ left).max() < 1e-9 * np.abs(np.concatenate(ghosts)).sum()


def test_every_number_of_the_search_stands_in_its_table():
    named = {k: v for k, v in vars(constants).items() if k.isupper() and k != "TABLE"}
    assert {c.name: c.value for c in constants.TABLE} == named
    assert len(named) < 25
    assert all(c.unit and c.meaning and c.source for c in constants.TABLE)
