"""The adaptive feedforward: what it identifies, what it reaches, and that it survives a load."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from baselines.adaptive_feedforward import AdaptiveFeedforward
from baselines.least_squares import ForgettingLeastSquares
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10, Sensor
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.signals import Triangle
from tests.baselines.playing import play

TS = 1e-4
BARE = replace(limit_band(P10, 800.0), sensor=Sensor(noise_um=0.01))
LAYOUT = replace(ObservationLayout.for_plant(BARE, TS), preview=8)
TRIANGLE = Triangle(amplitude_um=40.0, frequency_hz=20.0, smooth_start_s=0.05)(
    TS * np.arange(2500)
)[:, None]


def stage(f0_hz):
    effects = (
        load_effect("actuator_lag")(time_constant_s=1.5e-4),
        load_effect("delay")(delay_s=2e-4),
        load_effect("resonance")(f0_hz=f0_hz, damping=0.03),
    )
    return replace(BARE, effects=effects)


def played(controller, truths, reference_um=TRIANGLE):
    rngs = [np.random.default_rng(lane) for lane in range(len(truths))]
    return play(controller, truths, np.repeat(reference_um, len(truths), axis=1), rngs)


@pytest.fixture(scope="module")
def learned():
    """Errors (µm) and estimates on stages with a mode at 700 Hz and, loaded, at 350 Hz."""
    controller = AdaptiveFeedforward(BARE, LAYOUT, {"lead_samples": 4.0})
    _, errors, state, _ = played(controller, [stage(700.0), stage(350.0)])
    return errors, controller.fit.theta(controller.rows.of(state, "fit"))


def percent(errors_um):
    return 100.0 * np.sqrt(np.mean(errors_um[1000:] ** 2, axis=0)) / 80.0


@pytest.mark.slow
def test_an_unknown_stage_is_tracked_to_a_fifth_of_a_percent(learned):
    errors, _ = learned
    assert percent(errors)[0] < 0.2


def test_a_load_that_moves_the_mode_to_350_hz_is_survived(learned):
    """Learning from low-passed tracking errors leaves 28.7 % here."""
    errors, _ = learned
    assert percent(errors)[1] < 0.6


def test_the_mode_is_identified_from_the_triangle_s_corners(learned):
    """Of lag and mode (1 + τ s)(1 + 2 ζ s / ω0 + s² / ω0²), two samples ahead of their delay."""
    _, theta = learned
    for lane, f0_hz in enumerate((700.0, 350.0)):
        omega = 2.0 * np.pi * f0_hz * TS
        inverse = np.convolve([1.0, 1.5], [1.0, 0.06 / omega, omega**-2])
        ahead = -2.0
        expected = np.convolve(inverse, [1.0, ahead, ahead**2 / 2.0, ahead**3 / 6.0])
        assert theta[1, lane] == pytest.approx(expected[2], rel=0.15)  # f0 to 7 %


def test_a_known_stage_needs_no_learning():
    """With the plant as belief the prior is the answer: nothing is worse before it has learned."""
    truth = stage(700.0)
    learning = AdaptiveFeedforward(truth, LAYOUT, {})
    errors = played(learning, [truth], TRIANGLE[:600]).errors_um
    assert learning.lead == 4
    first = 100.0 * np.sqrt(np.mean(errors**2)) / 80.0
    assert first < 0.25


def test_a_preview_that_is_too_short_is_said():
    short = replace(LAYOUT, preview=3)
    said = AdaptiveFeedforward(BARE, short, {"lead_samples": 4.0}).warning()
    assert said == "lead cut to 1 samples: preview 3, 7 needed"
    assert AdaptiveFeedforward(BARE, LAYOUT, {}).warning() is None


def test_least_squares_solve_their_normal_equations_lane_by_lane():
    rng = np.random.default_rng(0)
    prior, spread, kept = rng.normal(size=5), rng.uniform(0.1, 2.0, 5), math.exp(-1e-3 / 0.05)
    fit = ForgettingLeastSquares(prior, spread, noise=0.3, memory_s=0.05, ts_s=1e-3)
    memory, left, right = fit.start(3), np.diag((0.3 / spread) ** 2), (0.3 / spread) ** 2 * prior
    sums, moments = np.zeros((5, 5)), np.zeros(5)
    for _ in range(40):
        phi, z = rng.normal(size=(5, 3)), rng.normal(size=3)
        fit.learn(memory, phi, z, np.array([True, True, False]))
        sums = kept * sums + np.outer(phi[:, 1], phi[:, 1])
        moments = kept * moments + phi[:, 1] * z[1]
    expected = np.linalg.solve(left + sums, right + moments)
    np.testing.assert_allclose(fit.theta(memory)[:, 1], expected, rtol=1e-12)
    np.testing.assert_array_equal(fit.theta(memory)[:, 2], prior)


def test_least_squares_forget_the_data_and_never_the_prior():
    fit = ForgettingLeastSquares([1.0, 2.0], [1.0, 1.0], noise=0.1, memory_s=0.01, ts_s=1e-3)
    memory, seen = fit.start(1), np.array([True])
    for _ in range(200):
        fit.learn(memory, np.array([[1.0], [0.0]]), np.array([5.0]), seen)
    first, second = fit.theta(memory)[:, 0]
    assert first == pytest.approx(5.0, abs=0.01)  # the data outweigh the prior a hundred times
    assert second == 2.0  # nothing was seen of it
    for _ in range(200):
        fit.learn(memory, np.zeros((2, 1)), np.zeros(1), seen)
    np.testing.assert_allclose(fit.theta(memory)[:, 0], [1.0, 2.0], atol=1e-4)
