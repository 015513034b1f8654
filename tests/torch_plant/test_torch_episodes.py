"""Episodes that begin lane by lane on a device are those of the vector environment."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from rdpi_gym.envs import ActionMode, ObservationLayout
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.plant import Converter, PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant import TorchEpisodes, TorchPlant

LANES, SAMPLES, NAMES = 5, 400, ("actuator_lag", "delay", "creep", "resonance")
PLANT = replace(
    named_plant("P10"), effects=tuple(CATALOGUE[name]() for name in NAMES), sensor=Sensor()
)


def lanes_and_pool(action: ActionMode) -> tuple[PiezoTrackingVectorEnv, TorchEpisodes]:
    """The lanes of the kernels, and a pool of what they have drawn with seeds 0 ... 2 LANES - 1."""
    envs = PiezoTrackingVectorEnv(
        LANES, plant=PLANT, action=action, randomise=0.2, randomise_effects=0.3, command_cost=0.4,
        reference=["sine", "triangle"], max_episode_steps=None,
    )  # fmt: skip
    single = envs.single
    plants, references = [], []
    for seed in range(2 * LANES):
        single.reset(seed=seed)
        assert single.signal is not None
        plants.append(single.truth)
        references.append(single.reference_um(single.signal, 0, SAMPLES)[:, 0])
    pool = TorchEpisodes(
        plants, np.stack(references, axis=1), single.layout, LANES,
        command_cost=0.4, bound_um=single.bound_um,
    )  # fmt: skip
    return envs, pool


@pytest.mark.parametrize("action", ["command", "increment"])
def test_lanes_are_those_of_the_vector_environment(action: ActionMode) -> None:
    envs, ours = lanes_and_pool(action)
    still, every = torch.zeros(LANES), torch.arange(LANES)
    expected, _ = envs.reset(seed=0)
    # The plays are float32, and so is the reference where the error is formed: 1e-7 of the stroke.
    assert np.abs(ours.begin(every, every, every, still).numpy() - expected).max() < 1e-6
    actions = np.random.default_rng(0).uniform(-1.1, 1.1, (SAMPLES - 20, LANES)).astype(np.float32)
    for k, action_k in enumerate(actions):
        if k in (50, 120):  # some lanes begin anew, with what the last seeds draw
            begun = np.array([0, 3]) if k == 50 else np.array([1, 3, 4])
            mask = np.isin(np.arange(LANES), begun)
            seeds = [int(LANES + i) if mask[i] else None for i in range(LANES)]
            expected, _ = envs.reset(seed=seeds, options={"reset_mask": mask})
            drawn = torch.from_numpy(begun + LANES)
            shown = ours.begin(torch.from_numpy(begun), drawn, drawn, still[: len(begun)])
            assert np.abs(shown.numpy() - expected[begun]).max() < 1e-6
        expected, reward, _, _, info = envs.step(action_k[:, None])
        seen, rewarded = ours.step(torch.from_numpy(action_k), still)
        assert np.abs(seen.numpy() - expected).max() < 2e-6
        assert np.abs(rewarded.numpy() - reward).max() < 2e-6
        assert np.abs(ours.command_V.numpy() - info["command_V"]).max() < 1e-11


def test_copies_of_plants_go_on_as_the_plants_do() -> None:
    model = replace(PLANT, converter=Converter(3e-4))
    slow = CATALOGUE["delay"](delay_s=2e-3)
    others = tuple(effect for effect in model.effects if effect.name != "delay")
    model, longer = (replace(model, effects=(*others, e)) for e in (CATALOGUE["delay"](), slow))
    plants = TorchPlant([model, longer, model.with_hysteresis(named_plant("P10").hysteresis)], 1e-4)
    u = torch.linspace(0.0, 30.0, 40, dtype=torch.float64)
    for now in u[:7]:
        plants.step(now.expand(3))
    columns = torch.tensor([2, 1, 1, 0])
    copies = plants.picked(columns)
    used = plants.picked(torch.zeros(4, dtype=torch.int64))
    used.step(torch.full((4,), 9.0))
    before = [tensor.data_ptr() for tensor in used.state.tensors()]
    used.become(torch.arange(4), plants, columns)
    for now in u[7:]:
        expected = plants.step(now.expand(3)).index_select(0, columns)
        assert torch.equal(copies.step(now.expand(4)), expected)
        assert torch.equal(used.step(now.expand(4)), expected)
    assert [tensor.data_ptr() for tensor in used.state.tensors()] == before


def test_readings_are_noisy_rounded_and_end_where_the_sensor_does() -> None:
    model = replace(named_plant("P5"), sensor=Sensor(noise_um=0.25, resolution_um=0.5))
    layout = ObservationLayout.for_plant(model, ts_s=1e-4, preview=1)
    lanes = TorchEpisodes([model], np.zeros((3, 1)), layout, 4, bound_um=2.0)
    which, noise = torch.arange(4), torch.tensor([0.0, 0.9, 1.1, -100.0])
    first = lanes.begin(which, *([torch.zeros(4, dtype=torch.int64)] * 2), noise)
    assert (first[:, 2] * layout.scale_um).tolist() == pytest.approx([0.0, 0.0, 0.5, -2.0])
    seen, _ = lanes.step(torch.zeros(4), noise)
    assert (seen[:, 2] * layout.scale_um).tolist() == pytest.approx([0.0, 0.0, 0.5, -2.0])


def test_bad_input_is_refused_in_one_line() -> None:
    model = named_plant("P5")
    layout = ObservationLayout.for_plant(model, ts_s=1e-4)
    refused = {
        "baseline does not run": lambda: TorchEpisodes(
            [model], np.zeros((3, 1)), replace(layout, action="correction"), 2
        ),
        r"shape \(3,\)": lambda: TorchEpisodes([model], np.zeros(3), layout, 2),
        r"finite displacements": lambda: TorchEpisodes([model], [[np.nan]], layout, 2),
        "no lane": lambda: TorchEpisodes([], np.zeros((3, 1)), layout, 2),
    }
    for words, call in refused.items():
        with pytest.raises(InputError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)


def test_a_plant_without_rounding_shares_no_memory_with_its_pool() -> None:
    model: PlantModel = named_plant("P5")
    layout = ObservationLayout.for_plant(model, ts_s=1e-4)
    lanes = TorchEpisodes([model], np.zeros((3, 1)), layout, 2)
    which, first, still = torch.arange(2), torch.zeros(2, dtype=torch.int64), torch.zeros(2)
    shown = lanes.begin(which, first, first, still).clone()
    for _ in range(5):
        lanes.step(torch.ones(2), still)
    assert torch.equal(lanes.begin(which, first, first, still), shown)
