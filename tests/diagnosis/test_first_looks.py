"""What is decided before a refit: which starts, which forms, and what is not worth refining."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.search.separability import next_experiment, typical_effects
from rdpi_gym.diagnosis.search.setting import Setting
from rdpi_gym.diagnosis.suitability import comb
from rdpi_gym.identification.cores import FIRST_SAMPLES
from rdpi_gym.identification.joint import first_steps, fit_joint
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import Effect

TS_S = 1e-3


def record(name: str, *effects: Effect, seed: int = 0, noise_um: float = 0.01) -> Record:
    t = TS_S * np.arange(6000)
    u = 30.0 * np.sin(2 * np.pi * 1.3 * t) * (0.4 + 0.6 * np.sin(2 * np.pi * 0.11 * t) ** 2)
    y = Plant(replace(P10, effects=effects), TS_S).simulate(u)
    noise = np.random.default_rng(seed).standard_normal(len(t))
    return Record(name, t, u, y + noise_um * noise, ts_s=TS_S)


def setting(*effects: Effect) -> Setting:
    train, validation = record("a", *effects), record("b", *effects, seed=1)
    return Setting((train,), (validation,), data_scale((train, validation)))


def test_an_experiment_that_was_made_is_not_advised_again() -> None:
    here = setting()
    typical = typical_effects(CATALOGUE, here.scale)
    pair = typical["saturation"], typical["congruency"]
    first = next_experiment(*pair, P10.hysteresis, here.scale)
    assert first is not None
    second = next_experiment(*pair, P10.hysteresis, here.scale, first.records)
    assert second is not None
    assert second.records != first.records


def test_first_steps_come_near_the_fit_that_they_begin():
    lag = CATALOGUE["sensor_lag"]
    here = setting(lag(time_constant_s=0.01))
    start = lag.starts(here.scale)[0]
    steps = first_steps(here.train, comb(here.train), (start,), 4, samples=FIRST_SAMPLES)
    fit = fit_joint(here.train, comb(here.train), (start,))
    assert steps.train_rmse_um == pytest.approx(fit.train_rmse_um, rel=0.05)
    (found,) = steps.variant.effects
    (best,) = fit.variant.effects
    assert found.values["time_constant_s"] == pytest.approx(best.values["time_constant_s"], rel=0.1)


def test_derivatives_of_another_start_lead_to_the_same_place():
    lag = CATALOGUE["sensor_lag"]
    here = setting(lag(time_constant_s=0.01))
    start = (lag(time_constant_s=0.005),)
    near = first_steps(here.train, comb(here.train), start, 0, samples=FIRST_SAMPLES)
    own, other = (
        first_steps(
            here.train,
            comb(here.train),
            (lag(time_constant_s=0.008),),
            4,
            samples=FIRST_SAMPLES,
            near=columns,
        )
        for columns in (None, near)
    )
    assert other.train_rmse_um == pytest.approx(own.train_rmse_um, rel=0.02)
