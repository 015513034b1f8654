"""The adaptive inverse: weights within their bounds, and what they are worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from baselines import make_controller
from baselines.adaptive_inverse import AdaptiveInverse
from baselines.least_squares import SOLVE_EVERY, ForgettingLeastSquares
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band, randomise_plant
from rdpi_gym.plant import P10, Plant
from rdpi_gym.signals import Triangle
from tests.baselines.playing import play

TS = 1e-4
BELIEF = limit_band(P10, 800.0)
LAYOUT = replace(ObservationLayout.for_plant(BELIEF, TS), preview=8)


def test_least_squares_within_bounds_find_what_nnls_finds():
    rng = np.random.default_rng(0)
    wanted = np.array([1.0, -0.5, 0.3])
    fit = ForgettingLeastSquares(
        [0.0] * 3, [1e3] * 3, noise=1e-3, memory_s=1e6, ts_s=1e-3, least=[0.0] * 3
    )
    memory, rows = fit.start(1), rng.normal(size=(60 * SOLVE_EVERY, 3))
    rows[:, 2] += 0.5 * rows[:, 1]
    for row in rows:
        fit.learn(memory, row[:, None], np.array([row @ wanted]), np.array([True]))
        assert (fit.theta(memory) >= 0.0).all()
    expected, _ = nnls(rows, rows @ wanted)
    np.testing.assert_allclose(fit.theta(memory)[:, 0], expected, atol=0.01)


def test_wrong_weights_are_learned_and_driven_by():
    """A plant a fifth off: a fixed inverse leaves more than a percent, this one less than a tenth."""
    truth = randomise_plant(BELIEF, 0.2, np.random.default_rng(5))
    triangle = Triangle(amplitude_um=40.0, frequency_hz=20.0, smooth_start_s=0.05)
    r = triangle(TS * np.arange(1200))[:, None]
    u = make_controller("classical-reference-rate", BELIEF, LAYOUT).command_block(r)
    assert percent(Plant(truth, TS).simulate(u) - r) > 1.0
    controller = AdaptiveInverse(BELIEF, LAYOUT, {})
    _, errors, state, _ = play(controller, truth, r)
    assert percent(errors) < 0.1
    weights = controller.fit.theta(controller.rows.of(state, "fit"))[:-1, 0]
    assert weights.sum() == pytest.approx(truth.hysteresis.A, rel=0.02)


def percent(errors_um):
    return 100.0 * float(np.sqrt(np.mean(errors_um[700:] ** 2))) / 80.0


def test_a_preview_too_short_for_the_filter_is_said():
    said = AdaptiveInverse(BELIEF, replace(LAYOUT, preview=2), {}).warning()
    assert said == "delay and lags undone in part: preview 2, 4 needed"
