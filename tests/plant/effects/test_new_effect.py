"""A new effect is its own file, an inverse and an independent twin; every room then has it."""

import json

import pytest

from tests.copied import add, copied, python
from tests.plant.additions import EFFECT

SCRIPT = '''"""Ask every room for the new effect, and print what it said as JSON."""
import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np

import rdpi_gym
from baselines import make_controller
from rdpi_gym.cli import main
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.measurement import Record, write_csv
from rdpi_gym.plant import P5, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.virtual_lab import Truth, simulate_dataset

said = {"package": str(Path(rdpi_gym.__file__).parent), "catalogue": list(CATALOGUE)}
BENT = replace(P5, effects=(CATALOGUE["lever_ratio"](share=0.1),))


def command(*words):
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(list(words)) == 0


def record(name, frequency_hz, seed):
    t = np.arange(1200) * 1e-3
    u = 20.0 * np.sin(2 * np.pi * frequency_hz * t) * (0.4 + 0.6 * np.sin(2 * np.pi * 0.7 * t))
    y = Plant(BENT, 1e-3).simulate(u) + 0.005 * np.random.default_rng(seed).standard_normal(t.size)
    write_csv(Record(name, t, u, y, ts_s=1e-3), Path("data") / f"{name}.csv")


command("effects", "--out", "effects")
said["effects"] = [e["effect"] for e in json.loads(Path("effects/effects.json").read_text())["effects"]]

command("simulate", "--model", "P5", "--hide", "lever_ratio", "--ts-factor", "4", "--out", "hidden")
said["hidden"] = [e["effect"] for e in json.loads(Path("hidden/truth.json").read_text())["hidden"]]

truth = simulate_dataset(Truth(P5, BENT.effects, noise_um=0.0, seed=0)).records[0]
own = Plant(BENT, truth.ts_s).simulate(truth.u_V)
said["truth less plant (µm)"] = float(np.abs(truth.y_um - own).max())

for number, frequency_hz in enumerate((3.0, 7.0, 11.0)):
    record(f"run-{number}" if number < 2 else "validation", frequency_hz, number)
command("diagnose", "data", "--model", "P5", "--jobs", "1", "--out", "diagnosis")
found = json.loads(Path("diagnosis/diagnosis.json").read_text())["candidates"]
said["candidates"] = [candidate["effect"] for candidate in found]

keywords = {"plant": BENT, "randomise_effects": 0.2}
single = gym.make("rdpi_gym/PiezoTracking-v0", **keywords)
lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=2, **keywords)
single.reset(seed=3)
lanes.reset(seed=3)
apart = 0.0
for place in np.sin(0.05 * np.arange(200)):
    one = single.step(np.array([place], dtype=np.float32))[4]
    many = lanes.step(np.full((2, 1), place, dtype=np.float32))[4]
    apart = max(apart, abs(one["displacement_um"] - many["displacement_um"][0]))
said["vector less single (µm)"] = apart

layout = ObservationLayout.for_plant(BENT, ts_s=1e-4, preview=8)
reference = 8.0 * np.sin(2 * np.pi * 20.0 * layout.ts_s * np.arange(1000))[:, None]


def rmse_um(belief):
    controller = make_controller("extended-inverse", belief, layout)
    task, state, errors = TrackingTask(BENT, layout), None, []
    observation = task.reset(reference)
    for k in range(900):
        action, state = controller.predict(observation, state, np.array([k == 0]), True)
        observation = task.step(layout.place_to_V(np.asarray(action, dtype=float)[:, 0]))
        errors.append(task.error_um[0])
    return float(np.sqrt(np.mean(np.square(errors))))


said["rmse unknown (µm)"] = rmse_um(replace(BENT, effects=()))
said["rmse known (µm)"] = rmse_um(BENT)
said["json"] = PlantModel.from_dict(json.loads(json.dumps(BENT.to_dict()))) == BENT
print(json.dumps(said))
'''


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    copy = copied(tmp_path_factory.mktemp("effect") / "copy")
    add(copy, EFFECT | {"ask.py": SCRIPT})
    result = python(copy, "ask.py")
    assert result.returncode == 0, result.stderr[-3000:]
    answer = json.loads(result.stdout.splitlines()[-1])
    assert answer["package"] == str(copy / "rdpi_gym")
    return answer


def test_the_catalogue_and_the_command_list_it(said):
    assert "lever_ratio" in said["catalogue"]
    assert said["effects"] == said["catalogue"]
    assert said["catalogue"].index("creep") < said["catalogue"].index("lever_ratio")
    assert said["catalogue"].index("lever_ratio") < said["catalogue"].index("resonance")
    assert said["json"]


def test_it_can_be_hidden_and_its_twin_agrees_with_its_stage(said):
    assert said["hidden"] == ["lever_ratio"]
    assert said["truth less plant (µm)"] < 1e-4


def test_the_diagnosis_tries_it_and_finds_it(said):
    assert sorted(said["candidates"]) == sorted(said["catalogue"])
    assert said["candidates"][0] == "lever_ratio"


def test_single_and_vector_environments_run_it_alike(said):
    assert said["vector less single (µm)"] < 1e-9


def test_a_compensator_that_knows_it_undoes_it(said):
    assert said["rmse unknown (µm)"] > 0.2
    assert said["rmse known (µm)"] < 0.2 * said["rmse unknown (µm)"]
