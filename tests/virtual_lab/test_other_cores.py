"""Records of plants whose hysteresis is not the RDPI model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.plant import CORES, P5, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.dataset import core_deformation, plant_displacement
from rdpi_gym.virtual_lab.independent import simulate_truth
from tests.looping import over

TS_S = 1e-3
SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=400.0, shortest_s=TS_S, longest_s=4.0
)
OTHERS = [name for name in CORES if name != "rdpi"]


def bench(name: str) -> PlantModel:
    core = CORES[name].starts(SCALE)[0]
    return PlantModel(core, "own", (-30.0, 30.0), (0.0, 8.0))  # type: ignore[arg-type]


def path() -> tuple[np.ndarray, np.ndarray]:
    t = TS_S * np.arange(700)
    return t, 14.0 * np.sin(2 * np.pi * 1.9 * t) + 6.0 * np.sin(2 * np.pi * 7.0 * t)


@over("name", OTHERS)
def test_on_the_fine_grid_a_plant_does_what_it_does_on_the_coarse_one(name):
    t, u = path()
    plant = bench(name)
    fine, coarse = plant_displacement(plant, [], t, u), Plant(plant, TS_S).simulate(u)
    # a rate over a sampling interval moves LuGre's state within it
    near = 2e-2 if CORES[name].rated else 1e-6
    assert float(np.max(np.abs(fine - coarse))) < near * float(np.ptp(coarse))


def test_of_the_rdpi_model_it_is_the_independent_formulation():
    t, u = path()
    ours = simulate_truth(
        lambda step, parts: core_deformation(P5.hysteresis, step, parts), [], t, u
    )
    assert float(np.max(np.abs(ours - plant_displacement(P5, [], t, u)))) < 1e-3 * float(
        np.ptp(ours)
    )


def test_effects_around_it_act_and_those_of_the_rdpi_model_are_refused():
    t, u = path()
    plant = bench("bouc_wen")
    lag = CATALOGUE["sensor_lag"](time_constant_s=5e-3)
    with_lag = plant_displacement(plant, [lag], t, u)
    model = Plant(replace(plant, effects=(lag,)), TS_S).simulate(u)
    assert float(np.max(np.abs(with_lag - model))) < 2e-3 * float(np.ptp(model))
    with pytest.raises(InputError, match="congruency changes the RDPI model itself"):
        plant_displacement(plant, [CATALOGUE["congruency"]()], t, u)


def test_simulate_takes_such_a_plant_and_hides_nothing_in_it():
    plant = bench("stop")
    data = rg.simulate(plant, seed=2, ts_factor=4.0)
    assert len(data.records) > 10
    with pytest.raises(InputError, match="plant own has the core stop; give the plant its effects"):
        rg.simulate(plant, hide="creep", seed=2, ts_factor=4.0)
