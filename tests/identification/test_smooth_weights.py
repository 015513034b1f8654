"""Weights with a price on their roughness: what one loop cannot tell is not filled with noise."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.suitability import comb
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.rdpi import comb_roughness

TS, THRESHOLDS = 1e-3, np.linspace(0.25, 10.0, 40)
NOISE_UM = 0.05


def sine(amplitude_V: float, density: np.ndarray) -> Record:
    t = np.arange(4000) * TS
    u = amplitude_V * np.sin(2 * np.pi * t)
    plant = Variant(RDPI((1.0, *density), tuple(THRESHOLDS), 0.0), ())
    noise = np.random.default_rng(1).normal(0.0, NOISE_UM, len(t))
    still = Record("sine", t, u, noise, ts_s=TS)
    return replace(still, y_um=simulate_effects([plant], still)[:, 0] + noise)


def unevenness(model: RDPI) -> float:
    density = np.array(model.weights[1:]) / np.diff([0.0, *model.thresholds_V])
    return float(np.std(np.diff(density)) / np.mean(density))


def test_smooth_weights_leave_the_noise_and_are_more_even():
    record = sine(10.0, 0.04 * np.exp(-THRESHOLDS / 5.0))
    start = comb([record])
    jagged, smooth = (fit_joint([record], start, smoothness=s) for s in (0.0, 0.004))
    assert smooth.smoothness == 0.004
    assert jagged.train_rmse_um < smooth.train_rmse_um < 1.05 * NOISE_UM
    first, second = (unevenness(f.variant.hysteresis) for f in (jagged, smooth))
    assert second < 0.2 * first


def test_roughness_is_that_of_the_density_at_any_scale_of_the_thresholds():
    weights = np.array([3.0, 1.0, 2.0, 0.5])
    r = np.array([1.0, 2.0, 4.0])
    assert weights @ comb_roughness(r) @ weights > 0.0
    # thresholds in another unit: the density changes with it, the displacement does not
    assert (weights / 7.0) @ comb_roughness(7.0 * r) @ (weights / 7.0) == pytest.approx(
        weights @ comb_roughness(r) @ weights
    )
    assert not comb_roughness([1.0]).any()
