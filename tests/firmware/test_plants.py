"""A plant as C: its chain in order, its rest, every core."""

from dataclasses import replace

import numpy as np

from rdpi_gym.firmware.making import plant_program
from rdpi_gym.plant import CORES, P10, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.model import Converter
from rdpi_gym.plant.parameters import DataScale
from tests.firmware.programs import answers, needs_gcc

TS_S = 1e-4
STAGE = ("slew_limit", "actuator_lag", "rate_law", "creep", "resonance", "delay", "mains_hum")


def _commands(samples=4000):
    t = TS_S * np.arange(samples)
    rng = np.random.default_rng(2)
    u = np.sin(2 * np.pi * 40.0 * t) + 0.4 * np.sin(2 * np.pi * 173.0 * t + 1.0)
    u[samples // 3 : samples // 3 + 300] = u[samples // 3]
    u += np.repeat(rng.normal(0.0, 0.2, samples // 500), 500)
    return 20.0 * np.clip(u / 1.6, -1.0, 1.0)[:, None]


@needs_gcc
def test_every_core_in_either_precision(tmp_path):
    scale = DataScale(0.0, 25.0, 25.0, 2e4, TS_S, 1.0)
    u = _commands()
    for name in CORES:
        own = P10.hysteresis if name == "rdpi" else CORES[name].starts(scale)[0]
        program = plant_program(replace(P10, hysteresis=own), TS_S)
        expected = program.twin(u)
        found = answers(program, tmp_path, u)
        assert not program.exact or (found == expected).all(), name
        assert np.abs(found - expected).max() < 1e-13 * np.ptp(expected), name
        single = answers(program, tmp_path, u, single=True)
        assert np.abs(single - expected).max() < 1e-5 * np.ptp(expected), name


@needs_gcc
def test_a_stage_with_many_effects_an_offset_and_a_converter(tmp_path):
    effects = tuple(CATALOGUE[name]() for name in STAGE)
    model = replace(P10, effects=effects, offset_um=0.7, converter=Converter(5e-4))
    program = plant_program(model, TS_S)
    assert [part.name for part in program.memory][:2] == ["converter", "core"]
    u = _commands()
    expected = program.twin(u)
    assert np.abs(answers(program, tmp_path, u) - expected).max() < 1e-13 * np.ptp(expected)


def test_a_plant_rests_where_its_initial_memory_leaves_it():
    settled = replace(P10, effects=(CATALOGUE["initial_memory"](extremum_V=15.0),))
    own, zero = (plant_program(each, TS_S).memory[0].rest for each in (settled, P10))
    assert own[0] == zero[0] == 0.0
    assert np.abs(own[2:]).max() > 0.0 == np.abs(zero[2:]).max()
    twin = plant_program(named_plant("P5"), TS_S).twin  # each of its lanes begins at rest
    u = _commands(1000)
    assert (twin(np.hstack([u, u])) == twin(u)).all()


def test_an_effect_that_counts_samples_notes_how_long_a_float_counts():
    drifting = replace(P10, effects=(CATALOGUE["mains_hum"](),))
    assert any("1.68e+03 s" in note for note in plant_program(drifting, TS_S).notes)
