"""The step on tensors is that of the environment: observations, rewards, clipping, sensor."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from rdpi_gym.envs import ActionMode, ObservationLayout, PiezoTrackingEnv, TrackingTask
from rdpi_gym.plant import PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.asymmetry import Asymmetry
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant import TorchPlant, TorchTracking

STEPS = 1500


class OwnEffect(Asymmetry):
    """What a user's project may add: an effect with a kernel of its own."""

    name = "own"

    @staticmethod
    def block(x: Any, u: Any, p: Any, state: Any, ts: float, y: Any) -> None:
        y[:] = x


def environments(lanes: int, action: ActionMode) -> list[PiezoTrackingEnv]:
    """Single environments with plants, references and effects of their own."""
    effects = [CATALOGUE[name]().to_dict() for name in ("creep", "resonance", "sensor_lag")]
    plant = PlantModel.from_dict(
        named_plant("P10").to_dict() | {"effects": effects, "offset_um": 300.0}
    )
    options = {"action": action, "randomise": 0.2, "command_cost": 0.3, "offset_um": 300.0}
    return [
        PiezoTrackingEnv(plant=plant, reference=["sine", "triangle"], **options)
        for _ in range(lanes)
    ]


@pytest.mark.parametrize("action", ["command", "increment"])
def test_lanes_are_single_environments(action: ActionMode) -> None:
    lanes = 3
    envs = environments(lanes, action)
    first = np.stack([env.reset(seed=seed)[0] for seed, env in enumerate(envs)])
    layout = envs[0].layout
    t = layout.ts_s * np.arange(STEPS // 2)
    reference = np.stack([env.signal(t) for env in envs if env.signal is not None], axis=1)
    # The second half of the episode is beyond the reference's end, where its last value is held.
    rng = np.random.default_rng(0)
    actions = np.clip(rng.normal(0.0, 0.3, (STEPS, lanes)).cumsum(0) % 5.0 - 2.5, -1.2, 1.2)
    actions = actions.astype(np.float32)
    task = TorchTracking([env.truth for env in envs], layout, command_cost=0.3)
    seen = task.reset(reference)
    assert seen.dtype == torch.float32
    assert np.abs(seen.numpy() - first).max() < 1e-6
    for k in range(STEPS // 2 - layout.preview - 1):
        seen, reward = task.step(torch.from_numpy(actions[k]))
        for lane, env in enumerate(envs):
            expected, expected_reward, _, _, info = env.step(actions[k, lane : lane + 1])
            # Displacements are shown in units of the amplitude, half of the reference's stroke.
            assert np.abs(seen[lane].numpy() - expected).max() < 2e-6
            assert abs(float(reward[lane]) - expected_reward) < 2e-6
            assert abs(float(task.error_um[lane]) - info["error_um"]) < 8e-5
            assert abs(float(task.command_V[lane]) - info["command_V"]) < 1e-11
            assert int(task.saturated[lane]) == info["saturated"]
    assert int(task.saturated.sum()) > 50


def test_a_reference_that_ends_is_held_and_may_be_shared() -> None:
    model = named_plant("P5")
    layout = ObservationLayout.for_plant(model, ts_s=1e-3, preview=3)
    reference = np.array([[0.0], [1.0], [2.0]])
    kernels = TrackingTask([model] * 2, layout)
    expected = [kernels.reset(np.repeat(reference, 2, axis=1))]
    task = TorchTracking(model, layout, lanes=2)
    seen = [task.reset(reference)]
    for _ in range(4):
        expected.append(kernels.step(np.array([5.0, -5.0])))
        seen.append(task.step(torch.tensor([[0.2], [-0.2]]))[0])
    assert np.abs(torch.stack(seen).numpy() - np.stack(expected)).max() < 1e-6


def test_another_episode_begins_as_the_first() -> None:
    model = named_plant("P5-bench")
    layout = ObservationLayout.for_plant(model, ts_s=1e-5, action="increment", action_scale_V=30.0)
    task = TorchTracking(model, layout, lanes=2)
    runs = []
    for _ in range(2):
        torch.manual_seed(1)
        first = task.reset(torch.zeros(5, 2))
        runs.append(torch.stack([first, *(task.step(torch.ones(2))[0] for _ in range(7))]))
        assert task.saturated.tolist() == [7, 7]
    assert torch.equal(*runs)


def test_the_sensor_is_noisy_and_rounds() -> None:
    model = named_plant("P5")
    sensors = [Sensor(), Sensor(0.0, 0.5), Sensor(0.25, 0.0), Sensor(0.25, 0.5)]
    models = [PlantModel.from_dict(model.to_dict() | {"sensor": vars(s)}) for s in sensors]
    layout = ObservationLayout.for_plant(model, ts_s=1e-4, preview=1)
    task = TorchTracking(models, layout)
    torch.manual_seed(0)
    task.reset(torch.zeros(1, 1))
    shown = torch.stack([task.step(torch.full((4,), 0.3))[0] for _ in range(2000)])
    read = (shown[500:, :, 2] * layout.scale_um).double()
    y = task.displacement_um[0]
    assert torch.allclose(read[:, 0], y, rtol=1e-6)
    assert float(read[:, 1].std()) == pytest.approx(0.5, rel=0.06)
    assert float(read[:, 1].mean() - y) == pytest.approx(0.0, abs=0.05)
    assert torch.allclose(read[:, 2], (y / 0.25).round() * 0.25)
    steps = read[:, 3] / 0.25
    assert float((steps - steps.round()).abs().max()) < 1e-5
    assert len(steps.round().unique()) > 5


def test_an_action_that_is_not_finite_spoils_its_lane_alone_and_is_found() -> None:
    model = named_plant("P5")
    layout = ObservationLayout.for_plant(model, ts_s=1e-4)
    task = TorchTracking(model, layout, lanes=3)
    task.reset(torch.zeros(10, 1))
    task.check()
    for action in ([0.1, 0.1, 0.1], [0.1, torch.nan, 0.1], [0.2, 0.2, 0.2]):
        observation, _ = task.step(torch.tensor(action))
    with pytest.raises(InputError, match="lane 1 "):
        task.check()
    assert torch.isfinite(observation[[0, 2]]).all()
    task.reset(torch.zeros(10, 1))
    task.step(torch.zeros(3))
    task.check()


def test_bad_input_is_refused_in_one_line() -> None:
    model = named_plant("P5")
    layout = ObservationLayout.for_plant(model, ts_s=1e-4)
    task = TorchTracking(model, layout, lanes=3)
    of_a_user = replace(model, effects=(OwnEffect(),))
    corrected = ObservationLayout.for_plant(model, ts_s=1e-4, action="correction")
    refused = {
        "lanes is 0": lambda: TorchPlant(model, 1e-4, lanes=0),
        "effect own cannot be run in torch": lambda: TorchPlant(of_a_user, 1e-4),
        "no lane": lambda: TorchPlant([], 1e-4),
        "float16": lambda: TorchPlant(model, 1e-4, dtype=torch.float16),
        "'gpu'": lambda: TorchPlant(model, 1e-4, device="gpu"),
        "ts_s is 0": lambda: TorchPlant(model, 0.0),
        "different effects": lambda: TorchPlant(
            [model, PlantModel.from_dict(model.to_dict() | {"effects": [CATALOGUE["creep"]().to_dict()]})],
            1e-4,
        ),
        r"\(2,\) for 3 lanes": lambda: task.step(torch.zeros(2)),
        r"\(3, 1\) for 3 lanes": lambda: task.plant.step(torch.zeros(3, 1)),
        "sample 1 of lane 0 is nan": lambda: task.plant.simulate(
            torch.tensor([[0.0, 0.0, 0.0], [torch.nan, 0.0, 0.0]])
        ),
        r"\(4, 2\) for 3 lanes": lambda: task.plant.simulate(torch.zeros(4, 2)),
        "lane 0 is inf": lambda: task.reset(torch.tensor([[0.0], [torch.inf]])),
        r"shape \(5, 2\)": lambda: task.reset(torch.zeros(5, 2)),
        "baseline": lambda: TorchTracking(model, corrected),
        "half_width is 1": lambda: task.plant.parameters.randomised(1.0, 3),
    }  # fmt: skip
    for words, call in refused.items():
        with pytest.raises(InputError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="no CUDA device"):
            TorchPlant(model, 1e-4, device="cuda")
