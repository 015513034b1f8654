"""A search on plants whose hysteresis is not the RDPI model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import add_effect, discover
from rdpi_gym.identification.plausibility import orientation
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES, PAPER_III_B, PlantModel
from rdpi_gym.plant.cores.stop import Stop
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.dataset import plant_displacement

TS_S = 4e-3
SLIPS_V = (0.5, 1.0, 1.6, 2.3, 3.1, 4.0, 5.0, 6.1, 7.3)
FRICTION = PlantModel(Stop((0.4,) * 9, SLIPS_V, 0.2), "damper", (-15.0, 15.0), (0, 5))  # type: ignore[arg-type]


def records(plant: PlantModel) -> Dataset:
    t = TS_S * np.arange(1200)
    found = []
    for name, fast in (("slow", 0.9), ("fast", 4.0), ("held out", 2.1)):
        swell = np.sin(np.pi * t / t[-1])
        u = swell * (7.0 * np.sin(2 * np.pi * fast * t) + 3.0 * np.sin(6.3 * fast * t + 1.0))
        y = plant_displacement(plant, list(plant.effects), t, u)
        y = y + np.random.default_rng(len(found)).normal(0.0, 0.01, t.size)
        role = "validation" if name == "held out" else "train"
        found.append(Record(name, t + 10.0 * len(found), u, y, ts_s=TS_S, role=role))
    return Dataset("damper", tuple(found))


def test_an_effect_is_added_to_a_comb_of_stops():
    lag = CATALOGUE["sensor_lag"](time_constant_s=8e-3)
    data = records(replace(FRICTION, effects=(lag,)))
    found = add_effect(data, CATALOGUE["sensor_lag"], FRICTION)
    assert found.plant.hysteresis.name == "stop"
    assert found.plant.effects[0].values["time_constant_s"] == pytest.approx(8e-3, rel=0.05)
    assert found.final.validation_rmse_um < 0.5 * found.base.validation_rmse_um
    # what is saved has only the thresholds that carry weight
    assert 9 <= found.plant.hysteresis.n < 40


def test_what_only_the_rdpi_model_has_is_not_added_to_another_core():
    given = FRICTION.with_hysteresis(CORES["stop"]((1.0,), (2.0,)))
    with pytest.raises(InputError, match="rate_law changes what only the core rdpi has"):
        add_effect(records(FRICTION), CATALOGUE["rate_law"], given)


def test_clockwise_loops_are_found_to_be_friction_before_an_effect_is_named():
    found = discover(records(FRICTION))
    core = found.core
    assert core.clockwise
    assert "stop" in (core.kind, *core.alike)
    assert found.plant.hysteresis.name == core.kind != "rdpi"
    assert found.verdict == "no missing effect"
    assert "the loops turn clockwise" in core.sentence
    assert SearchResult.from_dict(found.to_dict()).core == core


def test_rdpi_stays_where_nothing_speaks_against_it():
    data = records(PlantModel(PAPER_III_B, "piezo", (-15.0, 15.0), (0, 5)))
    assert orientation(data.train) is False
    found = discover(data, catalogue={})
    assert (found.core.kind, found.core.alike, found.verdict) == ("rdpi", (), "no missing effect")


def test_a_kind_of_fewer_numbers_that_leaves_half_beyond_the_noise_takes_the_place_of_plays():
    plant = PlantModel(CORES["duhem"](1.0, 0.7, 6.0), "duhem", (-15.0, 15.0), (0, 5))  # type: ignore[arg-type]
    found = discover(records(plant), catalogue={})
    assert "duhem" in (found.core.kind, *found.core.alike)
    assert found.verdict == "no missing effect"
