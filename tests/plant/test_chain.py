"""The order of the chain stands in one list, and every walk along it is the plant's."""

import pickle
from dataclasses import replace

import numpy as np

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.vector.chain import run_chain
from rdpi_gym.envs.vector.lanes import WORK, make_lanes
from rdpi_gym.envs.vector.plants import CoreLanes, EffectStages
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, Plant, empty_state, pack
from rdpi_gym.plant.effects import CATALOGUE

EVERY = replace(P10, effects=tuple(kind() for kind in CATALOGUE.values()))
TS_S = 1e-4
T = np.arange(600) * TS_S
U = 30.0 * np.sin(2 * np.pi * 40.0 * T) * np.cos(9.0 * T)


def test_the_jacobian_simulates_what_the_plant_does():
    record = Record("record", T, U, U, ts_s=TS_S)
    variant = Variant(EVERY.hysteresis, EVERY.effects)
    own = simulate_effects([variant], record)[:, 0]
    np.testing.assert_array_equal(own, Plant(EVERY, TS_S).simulate(U))


def test_the_vector_environment_runs_what_the_plant_does():
    """Its compiled walk is a twin of the list."""
    plant = replace(EVERY, effects=tuple(e for e in EVERY.effects if e.slot != "memory"))
    stages, core = EffectStages(plant, TS_S, 0.0), CoreLanes(plant, TS_S).kernel
    layout = ObservationLayout.for_plant(plant, TS_S, preview=1)
    p = pack([plant.hysteresis], TS_S, [0.0])
    rows = (len(p), len(empty_state(plant.hysteresis.n, 1)), *stages.rows)
    lanes = make_lanes((1, 32), rows, layout)
    lanes.p[0], lanes.stage_p[0] = p, stages.column(plant)[:, None]
    lanes.state[:, 0], lanes.stage_state[:] = np.nan, np.nan
    work, y = np.zeros((WORK, 32)), np.empty_like(U)
    for k, u in enumerate(U):
        work[0] = u
        row = run_chain(
            core, lanes.p[0], lanes.state[0], stages.table, lanes.stage_p[0], lanes.stage_state[0],
            TS_S, work,
        )  # fmt: skip
        y[k] = work[row, 7]
    np.testing.assert_allclose(y, Plant(plant, TS_S).simulate(U), rtol=0, atol=1e-11)


def test_a_plant_is_pickled_with_the_memory_that_it_has_gathered():
    plant = Plant(EVERY, TS_S)
    plant.simulate(U[:200])
    copy = pickle.loads(pickle.dumps(plant))
    np.testing.assert_array_equal(copy.simulate(U[200:]), plant.simulate(U[200:]))
    np.testing.assert_array_equal(copy.memory, plant.memory)
