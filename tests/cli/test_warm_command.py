"""`rdpi warm`: afterwards no command compiles."""

import json
import subprocess
import sys

import pytest

import rdpi_gym as rg
from rdpi_gym.face import warming

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
    again = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert again.stdout.splitlines()[-1] == "0 kernels compiled in 0 s"
    command = [sys.executable, "-c", ANSWERS]
    run = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert json.loads(run.stdout) == 0


def test_what_is_compiled_is_left_alone_until_a_source_or_a_kernel_changes(tmp_path, monkeypatch):
    calls = []
    kernel = tmp_path / "kernel.nbi"
    kernel.touch()
    monkeypatch.setattr(warming, "_PARTS", {"part": lambda: calls.append(1)})
    monkeypatch.setattr(warming, "_stamp", lambda: tmp_path / "warm.json")
    monkeypatch.setattr(warming, "_kernels", lambda: [str(p) for p in tmp_path.glob("*.nbi")])
    for change, times in (
        (lambda: None, 1),
        (lambda: None, 1),
        (kernel.unlink, 2),
        (lambda: (tmp_path / "warm.json").write_text("[]"), 3),
        (lambda: monkeypatch.setattr(warming.sys, "version", "another"), 4),
        (lambda: None, 4),
    ):
        change()
        table = rg.warm()
        assert (len(calls), list(table["part"])) == (times, ["part"])
