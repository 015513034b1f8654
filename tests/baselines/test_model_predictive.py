"""Model predictive control: its closed form, no offset, and a certificate that tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from baselines import model_predictive
from baselines.loops import LinearSystem
from baselines.model_predictive import ModelPredictive, horizon_gains
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import load_effect
from tests.baselines.playing import play

TS = 1e-4


def stage(f0_hz, offset_um=0.0):
    effects = (
        load_effect("delay")(delay_s=1e-4),
        load_effect("resonance")(f0_hz=f0_hz, damping=0.03),
    )
    return replace(limit_band(P10, 800.0), effects=effects, offset_um=offset_um)


BELIEF = stage(739.0)
LAYOUT = replace(ObservationLayout.for_plant(BELIEF, TS), preview=8)


def test_the_gains_are_the_minimum_of_the_horizon_s_price():
    a, b, c = np.array([[0.9, 0.2], [-0.3, 0.8]]), np.array([0.1, 0.4]), np.array([1.0, 0.5])
    model, rho = LinearSystem(a, b, c, 0.2), 0.05
    r, x, last = np.array([1.0, 2.0, 0.5, -1.0]), np.array([0.3, -0.2]), np.array([0.4, 0.6])

    def price(plan):
        state, total = x, 0.0
        every = np.concatenate([last, plan])
        for wanted, reference in zip(plan, r, strict=True):
            total += (reference - c @ state - 0.2 * wanted) ** 2
            state = a @ state + b * wanted
        return total + rho * np.sum(np.diff(every, 2) ** 2)

    on_r, on_x, on_last = horizon_gains(model, 4, rho)
    found = minimize(price, np.zeros(4), options={"gtol": 1e-10}).x[0]
    assert on_r @ r + on_x @ x + on_last @ last == pytest.approx(found, abs=1e-6)


def settled(controller, truth, samples=1100):
    level = np.full((samples, 1), 10.0)
    level[:100, 0] = np.linspace(0.0, 10.0, 100)
    return np.abs(play(controller, truth, level).errors_um[:, 0])


def test_an_offset_that_nobody_believes_is_gone_after_a_tenth_of_a_second():
    errors = settled(ModelPredictive(BELIEF, LAYOUT, {}), stage(739.0, offset_um=1.0))
    assert errors[20] > 0.5
    assert errors[-200:].max() < 2e-3


def test_a_band_is_lowered_until_the_certificate_covers_a_moved_mode(monkeypatch):
    bold = ModelPredictive(BELIEF, LAYOUT, {"band_hz": 200.0})
    assert bold.band_hz < 100.0
    assert "small gain: stable" in bold.certificate()
    moved = stage(0.6 * 739.0)
    assert settled(bold, moved)[-200:].max() < 0.2
    monkeypatch.setattr(model_predictive, "MOST_GAIN", np.inf)  # what it would be without
    unchecked = ModelPredictive(BELIEF, LAYOUT, {"band_hz": 200.0})
    assert settled(unchecked, moved)[-200:].max() > 5.0
    assert ModelPredictive(limit_band(P10, 800.0), LAYOUT, {}).certificate() is None
