"""A plant as C: its chain in order, its rest, every core."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.firmware.plants import plant_program
from rdpi_gym.plant import CORES, P10, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.model import Converter
from rdpi_gym.plant.parameters import DataScale
from tests.firmware.compiling import head, library, needs_gcc

TS_S = 1e-4
STAGE = ("slew_limit", "actuator_lag", "rate_law", "creep", "resonance", "delay", "mains_hum")


def _commands(samples=4000):
    t = TS_S * np.arange(samples)
    rng = np.random.default_rng(2)
    u = np.sin(2 * np.pi * 40.0 * t) + 0.4 * np.sin(2 * np.pi * 173.0 * t + 1.0)
    u[samples // 3 : samples // 3 + 300] = u[samples // 3]
    u += np.repeat(rng.normal(0.0, 0.2, samples // 500), 500)
    return 20.0 * np.clip(u / 1.6, -1.0, 1.0)


def _answers(program, u, folder, single=False):
    fields = [
        " ".join(f"rdpi_real {part.name}[{len(numbers)}];" for part, numbers in parts)
        or "char none;"
        for parts in (
            [(t, t.values) for t in program.tables],
            [(m, m.rest) for m in program.memory],
        )
    ]
    text = f"""{head(single)}
typedef struct {{ {fields[0]} }} rdpi_parameters;
typedef struct {{ {fields[1]} }} rdpi_memory;
{program.functions}
static rdpi_real rdpi_run(const rdpi_parameters *p, rdpi_memory *m, rdpi_real command_V) {{
{program.step}
}}
void go(const rdpi_parameters *p, rdpi_memory *m, int32_t n, const double *u, double *y);
void go(const rdpi_parameters *p, rdpi_memory *m, int32_t n, const double *u, double *y) {{
    for (int32_t k = 0; k < n; ++k) y[k] = (double)rdpi_run(p, m, (rdpi_real)u[k]);
}}
"""
    compiled = library(text, folder, f"plant{int(single)}")
    real = np.float32 if single else np.float64
    p = np.concatenate([t.values for t in program.tables]).astype(real)
    m = np.concatenate([part.rest for part in program.memory]).astype(real)
    y = np.empty(len(u))
    pointers = [each.ctypes.data_as(ctypes.c_void_p) for each in (p, m, u, y)]
    compiled.go(*pointers[:2], len(u), *pointers[2:])
    return y


def _core(name):
    scale = DataScale(0.0, 25.0, 25.0, 2e4, TS_S, 1.0)
    return P10.hysteresis if name == "rdpi" else CORES[name].starts(scale)[0]


@needs_gcc
@pytest.mark.parametrize("name", CORES)
def test_every_core_in_either_precision(name, tmp_path):
    program = plant_program(replace(P10, hysteresis=_core(name)), TS_S)
    u = _commands()
    expected = program.twin.plant(u[:, None])[:, 0]
    stroke = np.ptp(expected)
    found = _answers(program, u, tmp_path)
    if program.exact:
        assert (found == expected).all()
    assert np.abs(found - expected).max() < 1e-13 * stroke
    assert np.abs(_answers(program, u, tmp_path, single=True) - expected).max() < 1e-5 * stroke


@needs_gcc
def test_a_stage_with_many_effects_an_offset_and_a_converter(tmp_path):
    effects = tuple(CATALOGUE[name]() for name in STAGE)
    model = replace(P10, effects=effects, offset_um=0.7, converter=Converter(5e-4))
    program = plant_program(model, TS_S)
    assert [part.name for part in program.memory][:2] == ["converter", "core"]
    u = _commands()
    expected = program.twin.plant(u[:, None])[:, 0]
    assert np.abs(_answers(program, u, tmp_path) - expected).max() < 1e-13 * np.ptp(expected)


def test_a_plant_rests_where_its_initial_memory_leaves_it():
    settled = replace(P10, effects=(CATALOGUE["initial_memory"](extremum_V=15.0),))
    program = plant_program(settled, TS_S)
    bare = plant_program(P10, TS_S)
    own, zero = program.memory[0].rest, bare.memory[0].rest
    assert own[0] == zero[0] == 0.0
    assert np.abs(own[2:]).max() > 0.0 == np.abs(zero[2:]).max()


def test_what_counts_samples_says_how_long_a_float_counts():
    drifting = replace(P10, effects=(CATALOGUE["mains_hum"](),))
    assert any("1.68e+03 s" in note for note in plant_program(drifting, TS_S).notes)


def test_the_twin_begins_each_lane_at_rest():
    twin = plant_program(named_plant("P5"), TS_S).twin
    u = _commands(1000)[:, None]
    assert (twin.plant(np.hstack([u, u])) == twin.plant(u)).all()
