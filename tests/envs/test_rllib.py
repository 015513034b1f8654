"""RLlib trains on the registered environment, by the lines of the documentation."""

import json
import math
import os
import secrets
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="torch is not installed: pip install 'rdpi-gym[rl]'")
pytest.importorskip("ray", reason="Ray is not installed: pip install 'rdpi-gym[ray]'")

PAGE = Path(__file__).parents[2] / "docs" / "interoperability.md"
REPORT = """
import json
losses = result["learners"]["default_policy"]
module = algorithm.get_module()
print("RESULT", json.dumps({
    "iterations": result["training_iteration"],
    "steps": result["num_env_steps_sampled_lifetime"],
    "losses": {name: float(losses[name]) for name in ("policy_loss", "vf_loss", "entropy")},
    "shown": list(module.observation_space.shape),
    "finite": all(bool(p.isfinite().all()) for p in module.parameters()),
}))
algorithm.stop()
ray.shutdown()
"""


def snippet():
    _, section = PAGE.read_text(encoding="utf-8").split("## RLlib\n")
    return section.split("```python\n")[1].split("```")[0]


def test_two_iterations_of_ppo_on_one_machine(tmp_path):
    # A process of its own: Ray leaves threads and settings behind. The token is the test's, so that
    # Ray writes none into the user's home.
    own = {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": secrets.token_hex(32),
        "RAY_USAGE_STATS_ENABLED": "0",
        "OMP_NUM_THREADS": "1",
    }
    run = subprocess.run(
        [sys.executable, "-c", snippet() + REPORT],
        env=os.environ | own,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-3000:]
    (line,) = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
    found = json.loads(line.removeprefix("RESULT "))
    assert (found["iterations"], found["steps"]) == (2, 256)
    assert found["shown"] == [7]  # preview of 4: its options reach the environment
    assert all(map(math.isfinite, found["losses"].values()))
    assert found["finite"]
