"""Plants of measured and published records: they say where they are from, and can be driven."""

import gymnasium as gym
import numpy as np

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.measurement import stated_quantities
from rdpi_gym.plant import MEASURED, Plant, named_plant
from studies import core_plants
from tests.looping import over

OTHERS = [name for name in MEASURED if name != "picma"]


@over("name", OTHERS)
def test_a_plant_says_where_it_is_from_and_reaches_its_references(name):
    plant = named_plant(name)
    assert plant.identification["source"]
    held_out = plant.identification.get("held_out_rmse_um")
    assert held_out is None or (held_out > 0.0 and plant.identification["licence"])
    low, high = plant.command_range_V
    rise, fall = np.linspace(low, high, 4000), np.linspace(high, low, 4000)
    y = Plant(plant, 1e-3).simulate(np.concatenate([rise, fall, rise, fall]))[8000:]
    centre, amplitude = plant.reference_um
    assert y.min() < centre - amplitude < centre + amplitude < y.max()


def test_the_damper_is_in_its_own_units():
    told = stated_quantities(named_plant("friction_damper-pinched_stop").identification)
    assert (told.input.unit, told.output.unit) == ("mm", "kN")


def test_the_published_plant_is_what_its_command_writes():
    assert core_plants.published() == named_plant("lugre-1995")


def test_the_environment_takes_one_by_name():
    env = gym.make("rdpi_gym/PiezoTracking-v0", plant="picma-duhem")
    env.reset(seed=0)
    observation, *_ = env.step(np.zeros(1, dtype=np.float32))
    assert np.isfinite(observation).all()


def test_without_the_records_the_command_says_where_they_are(monkeypatch, tmp_path, capsys):
    monkeypatch.delenv("RDPI_DATA", raising=False)
    assert core_plants.main(["--out", str(tmp_path)]) == 2
    line = capsys.readouterr().err
    assert "the folder friction_damper is missing" in line
    assert line.count("\n") == 1
    assert not list(tmp_path.iterdir())
