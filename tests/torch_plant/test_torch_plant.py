"""The plant on tensors is the plant of the kernels: the same displacement, state and memory."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rdpi_gym.plant import RDPI, Converter, Plant, PlantModel, named_plant
from rdpi_gym.plant.cores.duhem import Duhem
from rdpi_gym.plant.cores.stop import Stop
from rdpi_gym.plant.effects import CATALOGUE, Effect, forms_of
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant import TorchPlant
from rdpi_gym.torch_plant.stages import has_twin

TWINNED = tuple(name for name, kind in CATALOGUE.items() if has_twin(kind))
FORMS = tuple(form for kind in CATALOGUE.values() for form in forms_of(kind)[1:])

TS_S = 1e-4


def commands(model: PlantModel, ts_s: float, samples: int, lanes: int, seed: int = 0) -> NDArray:
    """Sines of 1 to 100 Hz over the whole range, with minor loops on them."""
    rng = np.random.default_rng(seed)
    low, high = model.command_range_V
    t = ts_s * np.arange(samples)[:, None]
    slow, fast = rng.uniform(1.0, 100.0, lanes), rng.uniform(100.0, 400.0, lanes)
    phase = rng.uniform(0.0, 2 * np.pi, (2, lanes))
    place = 0.85 * np.sin(2 * np.pi * slow * t + phase[0])
    place += 0.15 * np.sin(2 * np.pi * fast * t + phase[1])
    return low + 0.5 * (place + 1.0) * (high - low)


def deviation(ours: torch.Tensor, kernels: NDArray) -> float:
    """Largest difference from the kernels, relative to the stroke."""
    return float(np.abs(ours.numpy() - kernels).max() / np.ptp(kernels))


def band_limited(name: str, hz: float | None) -> PlantModel:
    model = named_plant(name)
    return model.with_hysteresis(model.hysteresis.band_limited(hz))


def random_models(lanes: int, *effects: Effect, seed: int = 0) -> list[PlantModel]:
    """Plants that differ in every parameter, those of the effects included."""
    rng = np.random.default_rng(seed)
    models = []
    for _ in range(lanes):
        drawn = []
        for effect in effects:
            values = {p.name: rng.uniform(*p.typical) for p in effect.parameters}
            drawn.append(type(effect)(**values))
        weights = rng.uniform(0.05, 0.5, 6)
        hysteresis = RDPI.from_law(weights, rng.uniform(0.5, 2.0), rng.uniform(1e-4, 5e-4), 800.0)
        offset = rng.uniform(-5.0, 5.0)
        models.append(
            PlantModel(
                hysteresis, "random", (-40.0, 40.0), (0.0, 20.0), offset, effects=tuple(drawn)
            )
        )
    return models


@pytest.mark.parametrize("ts_s", [1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("hz", [None, 800.0])
@pytest.mark.parametrize("name", ["P5", "P10", "picma"])
def test_displacement_is_that_of_the_kernels(name: str, hz: float | None, ts_s: float) -> None:
    model = band_limited(name, hz)
    u = commands(model, ts_s, samples=600, lanes=16)
    y = Plant(model, ts_s, lanes=16).simulate(u)
    single = TorchPlant(model, ts_s, lanes=16).simulate(torch.from_numpy(u))
    double = TorchPlant(model, ts_s, lanes=16, dtype=torch.float64).simulate(torch.from_numpy(u))
    # The kernels may sum the plays in another order, hence the last digits of float64.
    assert deviation(double, y) < 1e-14
    assert deviation(single.float(), y) < 1e-6


def test_stops_run_on_the_same_plays_and_another_core_is_refused() -> None:
    stop = PlantModel(Stop((2.0, 1.0), (1.0, 4.0), 0.5), "friction", (-9.0, 9.0), (0.0, 4.0))
    u = commands(stop, TS_S, samples=400, lanes=3)
    y = Plant(stop, TS_S, lanes=3).simulate(u)
    ours = TorchPlant(stop, TS_S, lanes=3, dtype=torch.float64).simulate(torch.from_numpy(u))
    assert deviation(ours, y) < 1e-13
    other = stop.with_hysteresis(Duhem(1.0, 0.7, 12.0))
    with pytest.raises(
        InputError, match="plant friction has the core duhem, and in torch there are"
    ):
        TorchPlant(other, TS_S)


@settings(max_examples=25)
@given(
    st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=40),
    st.integers(0, 5),
    st.floats(-40.0, 40.0) | st.none(),
)
def test_any_walk_of_the_command_is_followed(
    walk: list[float], seed: int, rest_V: float | None
) -> None:
    (model,) = random_models(1, seed=seed)
    plant, ours = Plant(model, TS_S), TorchPlant(model, TS_S)
    plant.reset(u0_V=rest_V)
    ours.reset(u0_V=rest_V)
    y = plant.simulate(np.array(walk))
    stroke_um = model.hysteresis.A * 80.0
    error = ours.simulate(torch.tensor(walk, dtype=torch.float64)).numpy() - y
    assert np.abs(error).max() < 1e-6 * stroke_um


@pytest.mark.slow
def test_a_long_run_gathers_no_error() -> None:
    model = band_limited("P10", 800.0)
    u = commands(model, TS_S, samples=10_000, lanes=8)
    y = Plant(model, TS_S, lanes=8).simulate(u)
    ours = TorchPlant(model, TS_S, lanes=8).simulate(torch.from_numpy(u)).numpy()
    error = np.abs(ours - y).max(axis=1) / np.ptp(y)
    assert error.max() < 3e-7
    assert error[-3000:].max() < 1.5 * error[:3000].max()


def test_a_command_rounded_to_float32_would_not_do() -> None:
    """The reason why command and rate are float64: rounding moves a threshold by δ2 / Ts times it."""
    model = named_plant("picma")
    u = commands(model, TS_S, samples=400, lanes=8)
    y = Plant(model, TS_S, lanes=8).simulate(u)
    rounded = TorchPlant(model, TS_S, lanes=8).simulate(torch.from_numpy(u).float())
    assert deviation(rounded, y) > 1e-6


@pytest.mark.parametrize("name", TWINNED)
def test_every_effect_is_that_of_the_kernels(name: str) -> None:
    models = random_models(5, CATALOGUE[name]())
    ts_s = 2e-5  # poles close to one, delays of many samples
    u = commands(models[0], ts_s, samples=800, lanes=5)
    y = Plant(models, ts_s).simulate(u)
    assert deviation(TorchPlant(models, ts_s).simulate(torch.from_numpy(u)).float(), y) < 1e-6
    double = TorchPlant(models, ts_s, dtype=torch.float64).simulate(torch.from_numpy(u))
    assert deviation(double, y) < 1e-14


@pytest.mark.parametrize("kind", FORMS, ids=[kind.full_name() for kind in FORMS])
def test_a_further_form_is_that_of_the_kernels_or_is_refused_by_name(kind: type[Effect]) -> None:
    models = random_models(5, kind())
    u = commands(models[0], TS_S, samples=800, lanes=5)
    if not has_twin(kind):
        with pytest.raises(InputError, match=f"effect {kind.full_name()} cannot be run in torch"):
            TorchPlant(models, TS_S)
        return
    double = TorchPlant(models, TS_S, dtype=torch.float64).simulate(torch.from_numpy(u))
    assert deviation(double, Plant(models, TS_S).simulate(u)) < 1e-13


def test_all_effects_together_in_blocks_and_in_steps() -> None:
    models = random_models(3, *(CATALOGUE[name]() for name in TWINNED))
    u = commands(models[0], TS_S, samples=900, lanes=3)
    y = Plant(models, TS_S).simulate(u)
    whole, parts = TorchPlant(models, TS_S), TorchPlant(models, TS_S)
    ours = whole.simulate(torch.from_numpy(u))
    assert deviation(ours.float(), y) < 1e-6
    stepped = [parts.step(row) for row in torch.from_numpy(u[:300])]
    stepped += list(parts.simulate(torch.from_numpy(u[300:])))
    assert torch.equal(torch.stack(stepped), ours)


def test_resets_are_those_of_the_plant() -> None:
    models = random_models(4, CATALOGUE["initial_memory"](), CATALOGUE["delay"]())
    plant, ours = Plant(models, TS_S), TorchPlant(models, TS_S, dtype=torch.float64)
    u = commands(models[0], TS_S, samples=60, lanes=4)
    mask = np.array([True, False, True, False])
    memory = np.linspace(-3.0, 3.0, 5)
    for arguments in (
        {},
        {"u0_V": 7.0},
        {"u0_V": np.arange(4.0), "lanes": mask},
        {"memory": memory, "lanes": ~mask},
        {"memory": np.outer(memory, np.arange(4.0)), "u0_V": -1.0},
    ):
        plant.reset(**arguments)
        ours.reset(**arguments)
        assert np.array_equal(plant.memory, ours.memory.numpy())
        assert deviation(ours.simulate(torch.from_numpy(u)), plant.simulate(u)) < 1e-13


def test_the_converter_holds_its_output() -> None:
    model = named_plant("P5-bench")
    held = PlantModel.from_dict(model.to_dict() | {"converter": {"period_s": 7e-5}})
    assert held.converter == Converter(7e-5)
    u = commands(model, 1e-5, samples=100, lanes=3)
    plant, ours = Plant(held, 1e-5, lanes=3), TorchPlant(held, 1e-5, lanes=3)
    for block in (u[:10], u[10:47], u[47:]):
        assert deviation(ours.simulate(torch.from_numpy(block)), plant.simulate(block)) < 1e-6


def test_parameters_drawn_on_the_device_stay_in_their_bounds() -> None:
    plant = TorchPlant(named_plant("P10"), TS_S, lanes=500, dtype=torch.float64)
    nominal = plant.parameters
    generator = torch.Generator().manual_seed(3)
    drawn = nominal.randomised(0.2, 500, generator)
    for name in ("a0", "weights", "delta2_s"):
        ratio = getattr(drawn, name) / getattr(nominal, name)
        assert ratio.shape[-1] == 500
        assert 0.8 <= ratio.min() < 0.85 < 1.15 < ratio.max() <= 1.2
    gaps = drawn.thresholds_V.diff(dim=0) / nominal.thresholds_V.diff(dim=0)
    assert gaps.min() > 0.8 - 1e-12
    assert gaps.max() < 1.2 + 1e-12
    plant.parameters = drawn
    lane = PlantModel.from_dict(
        named_plant("P10").to_dict()
        | {
            "hysteresis": {
                "weights": [float(drawn.a0[7]), *drawn.weights[:, 7].tolist()],
                "thresholds_V": drawn.thresholds_V[:, 7].tolist(),
                "delta2_s": float(drawn.delta2_s[7]),
            }
        }
    )
    u = commands(lane, TS_S, samples=100, lanes=1)
    y = plant.simulate(torch.from_numpy(u).expand(-1, 500))
    assert deviation(y[:, 7], Plant(lane, TS_S).simulate(u)[:, 0]) < 1e-13
