"""`rdpi warm`: afterwards no command compiles."""

import json
import subprocess
import sys

import pytest

ANSWERS = """
import json
import gymnasium as gym
import rdpi_gym as rg
from rdpi_gym.support.compiling import compilations

with compilations() as found:
    env = gym.make("rdpi_gym/PiezoStage-v0")
    env.reset(seed=1)
    env.step(env.action_space.sample())
    data = rg.example("picma")
    model = rg.fit(data, 5)
    rg.compare(data, model)
    rg.simulate("P10", hide="creep", ts_factor=4.0)
print(json.dumps(found.kernels))
"""


@pytest.mark.slow
def test_afterwards_no_answer_compiles(tmp_path):
    command = [sys.executable, "-m", "rdpi_gym", "warm"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.splitlines()[-1].endswith(" s")
    assert "kernels compiled in" in run.stdout
    command = [sys.executable, "-c", ANSWERS]
    run = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert json.loads(run.stdout) == 0
