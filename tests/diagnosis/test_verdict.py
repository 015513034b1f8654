"""One verdict for every search, on the model that is saved; no cause is named that was not tried."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.diagnosis.search.setting import Setting
from rdpi_gym.diagnosis.search.verdict import (
    NumericalFloor,
    held_about,
    judge,
    numerical_floor,
    open_squares,
)
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.virtual_lab import Truth, simulate_dataset
from tests.looping import over

NOISE_UM = 0.012
DYNAMIC = ("sine-50hz", "multisine", "validation-chirp", "validation-noise")


def measured(effects, seed, ts_factor, names):
    """Some records of the standard protocol on P10 with hidden effects."""
    data = simulate_dataset(Truth(P10, tuple(effects), NOISE_UM, seed, ts_factor))
    return replace(data, records=tuple(r for r in data.records if r.name in (*names, "quiet")))


SLEW = CATALOGUE["slew_limit"](7470.588199522548)
CREEP, LAG = CATALOGUE["creep"](0.012023907418648538), CATALOGUE["sensor_lag"](0.000243006835)


@pytest.mark.slow
@over(
    "hidden, seed, names",
    [
        ([SLEW], 7, ("triangle-slow", *DYNAMIC)),
        ([CREEP, LAG], 11, ("stairs", "validation-stairs", *DYNAMIC)),
    ],
)
def test_a_right_model_of_records_sampled_too_slowly_is_no_riddle(hidden, seed, names):
    catalogue = {effect.name: CATALOGUE[effect.name] for effect in hidden}
    found = discover(measured(hidden, seed, 4.0, names), catalogue=catalogue)
    assert {c.effect for c in found.added} == set(catalogue)
    assert found.final.validation_rmse_um > 1.15 * found.noise_floor_um
    assert found.verdict == "explained"
    assert "Sample faster than" in found.headline
    assert "Hz: the records miss motion between their samples (validation-chirp has 5000 Hz)" in (
        found.sampling or ""
    )
    assert "disturbance" not in found.headline + found.remainder


def sampled(variant, ts_s, fine_s=1e-5):
    """A record of a plant that moves between its samples, with noise."""
    parts = round(ts_s / fine_s)
    t = np.arange(4000) * ts_s
    u = 30.0 * np.sin(2 * np.pi * 120.0 * t) * np.sin(2 * np.pi * 3.0 * t)
    record = Record("fast", t, u, np.zeros_like(t), ts_s=ts_s)
    noise = NOISE_UM * np.random.default_rng(1).standard_normal(len(t))
    return replace(record, y_um=simulate_between(variant, record, parts) + noise)


def test_steps_between_samples_change_nothing_without_an_effect():
    bare = Variant(P10.hysteresis, ())
    record = sampled(bare, 2e-4)
    coarse = simulate_effects([bare], record)[:, 0]
    np.testing.assert_allclose(simulate_between(bare, record, 5), coarse, atol=1e-9)


@over("added, good", [(True, "explained"), (False, "no missing effect")])
def test_the_same_judgement_with_and_without_steps(added, good):
    lagging = Variant(P10.hysteresis, (LAG,))
    record = sampled(lagging, 4e-4)
    error = record.y_um - simulate_effects([lagging], record)[:, 0]
    rmse_um = float(np.std(error))
    setting = Setting((record,), (record,), data_scale([record]))
    assert rmse_um > 2 * NOISE_UM
    floor = numerical_floor(lagging, [record])
    found = judge(setting, lagging, rmse_um, NOISE_UM, floor, added)
    assert (found.verdict, found.sampling is None) == (good, False)
    assert judge(setting, lagging, 1.1 * NOISE_UM, NOISE_UM, floor, added).sampling is None


@over(
    "floors, shown, verdict, says",
    [
        (1.3, 3.0, "explained", True),
        (2.0, 3.0, "explained", True),
        (1.3, 0.1, "explained", False),
        (2.0, 0.1, "unexplained", False),
    ],
)
def test_faster_sampling_is_advised_where_the_error_bears_it_out(floors, shown, verdict, says):
    bare = Variant(P10.hysteresis, ())
    record = sampled(bare, 2e-4)
    moved = replace(record, y_um=record.y_um + 0.05 * np.sin(2 * np.pi * 7.0 * record.t_s))
    setting = Setting((moved,), (moved,), data_scale([moved]))
    floor = NumericalFloor(0.0, 3.0 * NOISE_UM, 5000.0, shown_um=shown * NOISE_UM)
    found = judge(setting, bare, floors * NOISE_UM, NOISE_UM, floor, added=True)
    assert (found.verdict, found.sampling is not None) == (verdict, says)


def test_a_command_that_was_not_held_speaks_against_one_that_is():
    limited = Variant(P10.hysteresis, (CATALOGUE["slew_limit"](2e4),))
    record = sampled(limited, 2e-4)
    floor = numerical_floor(limited, [record])
    assert floor.held_um > 10.0 * NOISE_UM
    assert floor.borne_um < 0.2 * floor.held_um
    held = held_about(record.u_V, 4)
    fine = Record("fine", 5e-5 * np.arange(held.size), held, held, ts_s=5e-5)
    answer = replace(record, y_um=simulate_effects([limited], fine)[::4, 0])
    assert numerical_floor(limited, [answer]).borne_um > 0.9 * floor.held_um


def test_an_effect_too_fast_for_the_records_is_named_with_the_rate_that_would_do():
    mode = Variant(P10.hysteresis, (CATALOGUE["resonance"](1000.0, 0.02),))
    record = sampled(mode, 2e-4)
    moved = replace(record, y_um=record.y_um + 0.3 * np.sin(2 * np.pi * 7.0 * record.t_s))
    setting = Setting((moved,), (moved,), data_scale([moved]))
    floor = numerical_floor(mode, [moved])
    found = judge(setting, mode, 5.0, NOISE_UM, floor, added=True)
    assert found.verdict == "unexplained"
    assert found.sampling is not None
    assert text_of(found.sampling) == (
        "Sample faster than 10000 Hz before anything more is concluded: resonance (1000 Hz) is too "
        "fast for records of 5000 Hz."
    )


def test_what_a_simulation_leaves_open_lies_where_the_command_jumps():
    mode = Variant(P10.hysteresis, (CATALOGUE["resonance"](300.0, 0.1),))
    t = np.arange(4000) * 2e-4
    u = np.repeat([0.0, 30.0, 5.0, 20.0], 1000)
    still = Record("steps", t, u, np.zeros_like(u), ts_s=2e-4)
    steps = replace(still, y_um=simulate_effects([mode], still)[:, 0])
    opened = open_squares(mode, steps)
    assert np.mean(opened) == pytest.approx(numerical_floor(mode, [steps]).borne_um ** 2)
    near = np.zeros(t.size, dtype=np.bool_)
    for jump in (1000, 2000, 3000):
        near[jump - 1 : jump + 100] = True  # until the mode has died away
    assert opened[near].sum() > 0.99 * opened.sum()
