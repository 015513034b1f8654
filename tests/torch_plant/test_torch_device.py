"""A step looks at no value, moves no memory and is one graph: it can be compiled and captured."""

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import RDPI, Converter, Plant, PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.torch_plant import TorchPlant, TorchTracking
from rdpi_gym.torch_plant.stages import has_twin

TS_S = 2e-5
EVERYTHING = PlantModel(
    RDPI.from_law([0.6, 0.2, 0.1, 0.1], 1.0, 3e-4, 800.0),
    "everything",
    (-40.0, 40.0),
    (0.0, 20.0),
    effects=tuple(kind() for kind in CATALOGUE.values() if has_twin(kind)),
    sensor=Sensor(0.01, 0.03),
    converter=Converter(1e-4),
)
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device is there")


def tracking(model: PlantModel, lanes: int, device: str = "cpu") -> TorchTracking:
    layout = ObservationLayout.for_plant(model, ts_s=TS_S, action="increment")
    task = TorchTracking(model, layout, lanes, command_cost=0.1, device=device)
    if device != "meta":
        task.reset(torch.ones(50, lanes))
    return task


@pytest.fixture
def fresh_compiler() -> Iterator[None]:
    torch.compiler.reset()
    yield
    torch.compiler.reset()


def test_a_step_looks_at_no_value() -> None:
    """Tensors of the device `meta` have none: a step that branched on one or fetched it would raise."""
    task = tracking(EVERYTHING, lanes=7, device="meta")
    observation, reward = task.step(torch.zeros(7, device="meta"))
    assert observation.shape == (7, task.layout.size)
    assert reward.shape == (7,)
    with pytest.raises(RuntimeError):
        task.check()  # which does look


def test_a_step_moves_no_memory() -> None:
    task = tracking(EVERYTHING, lanes=3)
    kept = [*task.plant.state.tensors(), task.displacement_um, task.error_um, task.command_V]
    before = [tensor.data_ptr() for tensor in kept]
    for action in torch.linspace(-1.0, 1.0, 9):
        task.step(action.expand(3))
    now = [*task.plant.state.tensors(), task.displacement_um, task.error_um, task.command_V]
    assert [tensor.data_ptr() for tensor in now] == before


@pytest.mark.usefixtures("fresh_compiler")
def test_a_step_is_one_graph_whatever_the_sample() -> None:
    graphs = []

    def backend(graph: torch.fx.GraphModule, inputs: list[torch.Tensor]) -> torch.fx.GraphModule:
        graphs.append(graph)
        return graph

    torch.manual_seed(0)
    task = tracking(EVERYTHING, lanes=4)
    actions = torch.linspace(-1.0, 1.0, 80).reshape(20, 4)
    eager = [task.step(action) for action in actions]
    torch.manual_seed(0)
    again = tracking(EVERYTHING, lanes=4)
    compiled = torch.compile(again.step, fullgraph=True, backend=backend)
    for action, (observation, reward) in zip(actions, eager, strict=True):
        observed, rewarded = compiled(action)
        assert torch.equal(observed, observation)
        assert torch.equal(rewarded, reward)
    assert len(graphs) == 1


def test_gradients_through_time_are_those_of_finite_differences() -> None:
    model = named_plant("P5").with_hysteresis(named_plant("P5").hysteresis.band_limited(800.0))
    model = PlantModel.from_dict(
        model.to_dict() | {"effects": [CATALOGUE[n]().to_dict() for n in ("creep", "delay")]}
    )
    rng = np.random.default_rng(0)
    u = np.cumsum(rng.normal(0.0, 2.0, (120, 1)), axis=0)

    plant = TorchPlant(model, TS_S, dtype=torch.float64)
    names = ("a0", "weights", "thresholds_V", "delta2_s", "offset_um")
    for name in names:
        getattr(plant.parameters, name).requires_grad_()
    command = torch.from_numpy(u).requires_grad_()
    target = torch.from_numpy(rng.normal(0.0, 1.0, u.shape))

    def score(commands: torch.Tensor) -> torch.Tensor:
        plant.reset()
        return (plant.simulate(commands) * target).mean()

    score(command).backward()
    leaves = [(getattr(plant.parameters, name), 1e-6) for name in names]
    leaves[3] = (plant.parameters.delta2_s, 1e-10)
    for leaf, step in [*leaves, (command, 1e-6)]:
        gradient = leaf.grad
        assert gradient is not None
        flat = leaf.detach().view(-1)
        for i in range(0, len(flat), max(1, len(flat) // 6)):
            value = float(flat[i])
            differences = []
            for moved in (value + step, value - step):
                flat[i] = moved
                with torch.no_grad():
                    differences.append(float(score(command)))
            flat[i] = value
            estimate = (differences[0] - differences[1]) / (2 * step)
            assert float(gradient.view(-1)[i]) == pytest.approx(estimate, rel=1e-5, abs=1e-9)


def test_a_step_takes_no_gradients_and_a_block_keeps_detached_memory() -> None:
    plant = TorchPlant(named_plant("P5"), TS_S)
    plant.parameters.weights.requires_grad_()
    assert not plant.step(torch.ones(1)).requires_grad
    assert plant.simulate(torch.ones(3)).requires_grad
    assert not any(tensor.requires_grad for tensor in plant.state.tensors())


@needs_cuda
def test_cuda_agrees_with_the_kernels_captured_too() -> None:
    model = named_plant("P10")
    u = 70.0 * np.sin(2 * np.pi * 50.0 * TS_S * np.arange(2000))[:, None] * np.ones((1, 32))
    y = Plant(model, TS_S, lanes=32).simulate(u)
    plant = TorchPlant(model, TS_S, lanes=32, device="cuda")
    rows = torch.from_numpy(u).cuda()
    assert np.abs(plant.simulate(rows).cpu().numpy() - y).max() < 1e-6 * np.ptp(y)
    static = rows[0].clone()
    plant.step(static)
    torch.cuda.synchronize()
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        out = plant.step(static)
    plant.reset()
    captured = []
    for row in rows:
        static.copy_(row)
        graph.replay()
        captured.append(out.clone())
    assert np.abs(torch.stack(captured).cpu().numpy() - y).max() < 1e-6 * np.ptp(y)
