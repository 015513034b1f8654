"""Types of all packages: a minute of one processor, beside which the other tests of the tier run."""

import subprocess
import sys

from tests.house import ROOT


def test_types_are_right():
    command = [sys.executable, "-m", "mypy"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
