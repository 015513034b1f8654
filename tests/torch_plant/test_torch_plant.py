"""The plant in torch runs the kernels themselves: the same displacement, memory and refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

pytest.importorskip("torch")

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.plant import CORES, RDPI, Converter, Plant, PlantModel, named_plant
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant import TorchPlant
from rdpi_gym.torch_plant.translation import Lanes, UntranslatableError

TS_S = 1e-4
SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=400.0, shortest_s=TS_S, longest_s=4.0
)


def commands(samples, lanes, ts_s=TS_S):
    """Sines of 1 to 400 Hz within 40 V, with minor loops on them."""
    rng = np.random.default_rng(0)
    t = ts_s * np.arange(samples)[:, None]
    slow, fast = rng.uniform(1.0, 100.0, lanes), rng.uniform(100.0, 400.0, lanes)
    phase = rng.uniform(0.0, 2 * np.pi, (2, lanes))
    place = 0.85 * np.sin(2 * np.pi * slow * t + phase[0])
    return 40.0 * (place + 0.15 * np.sin(2 * np.pi * fast * t + phase[1]))


def random_models(lanes, *effects):
    """Plants that differ in every parameter, those of the effects included."""
    rng = np.random.default_rng(0)
    models = []
    for _ in range(lanes):
        drawn = []
        for effect in effects:
            values = {p.name: rng.uniform(*p.typical) for p in effect.parameters}
            drawn.append(type(effect)(**values))
        weights = rng.uniform(0.05, 0.5, 6)
        core = RDPI.from_law(weights, rng.uniform(0.5, 2.0), rng.uniform(1e-4, 5e-4), 800.0)
        model = PlantModel(core, "random", (-40.0, 40.0), (0.0, 20.0), rng.uniform(-5.0, 5.0))
        models.append(replace(model, effects=tuple(drawn)))
    return models


def deviations(models, u, ts_s=TS_S):
    """Largest difference from the kernels at each sample, relative to the stroke."""
    lanes = 1 if isinstance(models, list) else u.shape[1]
    y = Plant(models, ts_s, lanes).simulate(u)
    ours = TorchPlant(models, ts_s, lanes).simulate(torch.from_numpy(u)).numpy()
    return np.abs(ours - y).max(axis=1) / np.ptp(y)


def deviation(models, u, ts_s=TS_S):
    """Largest difference from the kernels, relative to the stroke."""
    return float(deviations(models, u, ts_s).max())


def follows_the_kernels(forms):
    for form in forms:
        assert deviation(random_models(3, form()), commands(25, lanes=3)) < 1e-14, form.full_name()


def test_every_effect_is_that_of_the_kernels():
    follows_the_kernels(CATALOGUE.values())


@pytest.mark.slow
def test_every_further_form_is_that_of_the_kernels():
    follows_the_kernels(form for kind in CATALOGUE.values() for form in kind.forms)


@settings(max_examples=25)
@given(
    st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=20),
    st.integers(0, 5),
    st.floats(-40.0, 40.0) | st.none(),
)
def test_any_walk_of_the_command_is_followed_from_any_rest(walk, seed, rest_V):
    model = random_models(6)[seed]
    plant, ours = Plant(model, TS_S), TorchPlant(model, TS_S)
    plant.reset(u0_V=rest_V)
    ours.reset(u0_V=rest_V)
    u = np.array(walk)[:, None]
    error = ours.simulate(torch.from_numpy(u)).numpy() - plant.simulate(u)
    assert np.abs(error).max() < 1e-14 * 80.0 * model.hysteresis.A


def test_every_core_is_that_of_the_kernels_or_is_refused():
    u = commands(25, lanes=3)
    for name, kind in CORES.items():
        for core in kind.starts(SCALE):
            model = PlantModel(core, name, (-40.0, 40.0), (0.0, 20.0), 0.3)
            if name in ("preisach", "bouc_wen", "asymmetric_bouc_wen"):
                with pytest.raises(
                    InputError, match=f"plant {name} cannot be run in torch: a loop"
                ):
                    TorchPlant(model, TS_S)
                continue
            assert deviation(model, u) < 1e-14, core


@pytest.mark.slow
def test_all_effects_together_in_blocks_and_in_steps():
    models = random_models(3, *(kind() for kind in CATALOGUE.values()))
    u = commands(700, lanes=3)  # longer than the delay's ring
    assert deviation(models, u) < 1e-13
    whole, parts = TorchPlant(models, TS_S), TorchPlant(models, TS_S)
    ours = whole.simulate(torch.from_numpy(u[:80]))
    stepped = [parts.step(row) for row in torch.from_numpy(u[:30])]
    stepped += list(parts.simulate(torch.from_numpy(u[30:80])))
    assert torch.equal(torch.stack(stepped), ours)


def test_resets_are_those_of_the_plant():
    models = random_models(4, CATALOGUE["initial_memory"](), CATALOGUE["delay"]())
    plant, ours = Plant(models, TS_S), TorchPlant(models, TS_S)
    u, memory = commands(60, lanes=4), np.linspace(-3.0, 3.0, 5)
    mask = np.array([True, False, True, False])
    for arguments in (
        {},
        {"u0_V": 7.0},
        {"u0_V": np.arange(4.0), "lanes": mask},
        {"lanes": mask},
        {"memory": memory, "lanes": ~mask},
        {"memory": np.outer(memory, np.arange(4.0)), "u0_V": -1.0},
    ):
        plant.reset(**arguments)
        ours.reset(**arguments)
        np.testing.assert_array_equal(ours.memory.numpy(), plant.memory)
        y = plant.simulate(u)
        found = ours.simulate(torch.from_numpy(u)).numpy()
        assert np.abs(found - y).max() < 1e-13 * np.ptp(y), arguments


def test_the_converter_holds_its_output():
    model = named_plant("P5-bench")
    held = PlantModel.from_dict(model.to_dict() | {"converter": {"period_s": 7 * TS_S}})
    assert held.converter == Converter(7 * TS_S)
    u = commands(40, lanes=3)
    plant, ours = Plant(held, TS_S, lanes=3), TorchPlant(held, TS_S, lanes=3)
    for block in (u[:10], u[10:27], u[27:]):
        found = ours.simulate(torch.from_numpy(block)).numpy()
        np.testing.assert_allclose(found, plant.simulate(block), rtol=0, atol=1e-12)


@njit
def _jumps(x, table, b):
    if x < -1.0:
        return -table[0, b]
    place = min(int(x + 1.0), table.shape[0] - 1)
    return float(table[place, b]) if x < 2.0 or table[0, b] > 0.5 else math.inf


@njit
def _branches(x, p, state, y):
    total = np.zeros(x.shape[1])
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = 0.0
            if x[t, b] == 0.0:
                y[t, b] = 9.0
                continue
            for k in range(4):
                if abs(x[t, b]) < 0.5 * k:
                    break
                total[b] += 2.0**k
                if not -3.0 <= x[t, b] <= 3.0:
                    state[0, b] = k + 1
                    break
            low, high = (x[t, b], 2.0) if x[t, b] < 2.0 else (2.0, x[t, b])
            y[t, b] += (high - low) ** 0.5 + total[b] + _jumps(x[t, b], p, b)
            state[1 + int(abs(x[t, b])) % 3, b] -= y[t, b]


def test_branches_loops_and_places_differ_from_lane_to_lane():
    x = np.array([[-4.0, -1.5, -0.2, 0.0, 0.3, 1.2, 1.9, 2.5, 7.0]])
    p = np.random.default_rng(0).uniform(0.0, 1.0, (3, 9))
    state, y = np.zeros((4, 9)), np.empty((1, 9))
    _branches(x, p, state, y)
    assert len(np.unique(state[0])) > 1

    def cells(rows):
        made = np.empty((len(rows), 1), dtype=object)
        for i, row in enumerate(rows):
            made[i, 0] = torch.from_numpy(row.copy())
        return made

    ours, left = cells(np.full((1, 9), np.nan)), cells(np.zeros((4, 9)))
    Lanes(9, torch.device("cpu")).translated(_branches)(cells(x), cells(p), left, ours)
    np.testing.assert_allclose(ours[0, 0].numpy(), y[0], rtol=1e-15)
    np.testing.assert_allclose(torch.stack(list(left[:, 0])).numpy(), state, rtol=1e-15)


@njit
def _searches(x, y):
    while y[0, 0] < x[0, 0]:
        y[0, 0] += 1.0


@njit
def _sorts(x, y):
    y[0, 0] = np.sort(x)[0, 0]


@pytest.mark.parametrize(
    ("kernel", "message"), [(_searches, "a loop whose length"), (_sorts, r"sort\(\)")]
)
def test_what_cannot_be_translated_is_one_line(kernel, message):
    one, other = np.empty((2, 1, 1), dtype=object)
    one[0, 0], other[0, 0] = torch.ones(2), torch.zeros(2)
    with pytest.raises(UntranslatableError, match=message):
        Lanes(2, torch.device("cpu")).translated(kernel)(one, other)


def test_gradients_through_time_are_those_of_finite_differences():
    core = named_plant("P5").hysteresis.band_limited(800.0)
    names = ("creep", "delay", "rate_law", "slew_limit")
    effects = tuple(CATALOGUE[name]() for name in names)
    model = replace(named_plant("P5"), hysteresis=core, effects=effects)
    rng = np.random.default_rng(0)
    u = np.cumsum(rng.normal(0.0, 2.0, (16, 1)), axis=0)
    plant = TorchPlant(model, TS_S)
    command = torch.from_numpy(u).requires_grad_()
    target = torch.from_numpy(rng.normal(0.0, 1.0, u.shape))

    def score(commands):
        plant.reset()
        return (plant.simulate(commands) * target).mean()

    leaves = [command, *(plant.parameters[name].requires_grad_() for name in ("core", "creep"))]
    score(command).backward()
    for leaf in leaves:
        flat, gradient = leaf.detach().view(-1), leaf.grad.view(-1)
        for i in range(0, len(flat), max(1, len(flat) // 4)):
            value = float(flat[i])
            step = 1e-6 * max(abs(value), 1e-3)
            differences = []
            for moved in (value + step, value - step):
                flat[i] = moved
                with torch.no_grad():
                    differences.append(float(score(command)))
            flat[i] = value
            estimate = (differences[0] - differences[1]) / (2 * step)
            assert float(gradient[i]) == pytest.approx(estimate, rel=1e-5, abs=1e-9), (i, value)


def test_a_lane_at_rest_spoils_no_derivative():
    """Of a rate of zero a power has no derivative: its branch is another one."""
    for form in ("rate_law", "rate_law, piecewise power", "rate_law, logarithm"):
        kind = next(
            k for each in CATALOGUE.values() for k in forms_of(each) if k.full_name() == form
        )
        plant = TorchPlant(replace(named_plant("P5"), effects=(kind(),)), TS_S, lanes=2)
        command = torch.tensor([[1.0, 1.0], [1.0, 2.0], [1.0, 4.0]], dtype=torch.float64)
        plant.simulate(command.requires_grad_()).sum().backward()
        assert torch.isfinite(command.grad).all(), form


def test_a_step_takes_no_gradients_and_a_block_keeps_detached_memory():
    plant = TorchPlant(named_plant("P5"), TS_S)
    plant.parameters["core"].requires_grad_()
    assert not plant.step(torch.ones(1)).requires_grad
    assert plant.simulate(torch.ones(3)).requires_grad
    assert not plant.memory.requires_grad


def test_blocks_and_devices_that_cannot_run_are_one_line():
    plant = TorchPlant(named_plant("P5"), TS_S, lanes=2)
    for block, message in (
        (torch.zeros(5), r"a block of shape \(5,\) for 2 lanes; give \(samples, 2\)"),
        (torch.tensor([[0.0, math.nan]]), "sample 0 of lane 1 is nan; commands are finite"),
    ):
        with pytest.raises(InputError, match=message):
            plant.simulate(block)
    with pytest.raises(InputError, match="device 'nowhere' is none that torch has here"):
        TorchPlant(named_plant("P5"), TS_S, device="nowhere")
    with pytest.raises(InputError, match="give at least one model"):
        TorchPlant(named_plant("P5"), TS_S, lanes=0)
