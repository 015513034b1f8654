"""What is decided before a refit: which starts, which forms, and what is not worth refining."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.search.candidates import Setting, refit, taken_by
from rdpi_gym.diagnosis.search.separability import next_experiment, typical_effects
from rdpi_gym.diagnosis.suitability import comb
from rdpi_gym.identification.cores import FIRST_SAMPLES
from rdpi_gym.identification.joint import first_steps
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, RDPI, Plant
from rdpi_gym.plant.effects import CATALOGUE, load_effect
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


def fitted(here: Setting) -> RDPI:
    return here.fit(comb(here.train)).variant.hysteresis


def test_traces_of_a_drift_show_one_that_comes_back_and_a_line_does_not():
    wander = load_effect("thermal_drift", "smooth curve")
    knots = {f"at_{k}_um": 0.2 * math.sin(k) for k in range(1, 15)}
    here = setting(wander(duration_s=6.0, **knots))
    begun = here.first_steps(fitted(here), (), 0)
    taken = {
        name: taken_by(here.train, begun, CATALOGUE[name].traces(here.scale), FIRST_SAMPLES)
        for name in ("thermal_drift", "saturation")
    }
    assert taken["thermal_drift"] > 0.95
    assert taken["saturation"] < 0.3


def test_traces_take_of_noise_what_chance_gives_them():
    here = setting()
    begun = here.first_steps(fitted(here), (), 0)
    traces = CATALOGUE["thermal_drift"].traces(here.scale)
    taken = taken_by(here.train, begun, traces, FIRST_SAMPLES)
    assert taken == pytest.approx(len(traces) / 6000, abs=3 * math.sqrt(2 * len(traces)) / 6000)


def test_first_steps_come_near_the_fit_that_they_begin():
    lag = CATALOGUE["sensor_lag"]
    here = setting(lag(time_constant_s=0.01))
    start = lag.starts(here.scale)[0]
    steps = first_steps(here.train, comb(here.train), (start,), 4, samples=FIRST_SAMPLES)
    fit = here.fit(comb(here.train), (start,))
    assert steps.train_rmse_um == pytest.approx(fit.train_rmse_um, rel=0.05)
    (found,) = steps.variant.effects
    (best,) = fit.variant.effects
    assert found.values["time_constant_s"] == pytest.approx(best.values["time_constant_s"], rel=0.1)


def test_derivatives_of_another_start_lead_to_the_same_place():
    lag = CATALOGUE["sensor_lag"]
    here = setting(lag(time_constant_s=0.01))
    near = here.first_steps(comb(here.train), (lag(time_constant_s=0.005),), 0)
    own, other = (
        here.first_steps(comb(here.train), (lag(time_constant_s=0.008),), 4, near=columns)
        for columns in (None, near)
    )
    assert other.train_rmse_um == pytest.approx(own.train_rmse_um, rel=0.02)


def test_a_candidate_that_shows_nothing_is_not_refined():
    here, kind = setting(), CATALOGUE["creep"]
    hysteresis = fitted(here)
    bare = here.first_steps(hysteresis, (), 0).train_rmse_um
    left, refined = (
        refit(here, hysteresis, (), kind, least_um=least_um).fit
        for least_um in (0.99 * bare, math.inf)
    )
    assert left is not None
    assert refined is not None
    assert left.passes == 2 < refined.passes
    assert left.train_rmse_um == pytest.approx(refined.train_rmse_um, rel=5e-3)


def test_of_many_starts_those_that_leave_least_are_followed():
    kind = CATALOGUE["slew_limit"]
    here = setting(kind(rate_V_s=150.0))
    hysteresis = fitted(here)
    far = [kind(rate_V_s=10.0 ** (6 + 0.5 * k)) for k in range(8)]
    found = refit(here, hysteresis, (), kind, starts=[*far, kind(rate_V_s=140.0)])
    assert found.fit is not None
    (limit,) = found.fit.variant.effects
    assert limit.values["rate_V_s"] == pytest.approx(150.0, rel=0.02)


def test_a_start_that_spoils_the_model_is_not_where_an_idle_candidate_ends():
    kind = CATALOGUE["slew_limit"]
    here = setting()
    hysteresis = fitted(here)
    bare = here.first_steps(hysteresis, (), 0).train_rmse_um
    slow = [kind(rate_V_s=rate) for rate in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)]
    found = refit(here, hysteresis, (), kind, [*slow, kind(rate_V_s=1e6)], least_um=0.99 * bare)
    assert found.errors.validation_rmse_um == pytest.approx(bare, rel=0.05)
