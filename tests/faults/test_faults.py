"""After a kill or a full disk at any call that changes the disk: the old state or the new one, whole.

A rerun ends as an undisturbed run does, and leaves nothing beside it. `python tests/faults/jobs.py
FOLDER` prints the counts.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
LEAST = {
    "file": 20, "new file": 20, "folder, one step": 70, "folder, two renames": 70, "rows": 50,
    "rows, a damaged line": 80, "rows, stale rows": 100, "candidates of a search": 25,
    "benchmark": 60,
}  # fmt: skip
"""Faults that each job meets."""


pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="children are forked")


def run(*words):
    done = subprocess.run(
        [sys.executable, *words], cwd=TOP, env=os.environ | {"PYTHONPATH": str(TOP)},
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.splitlines()


def test_every_writer_leaves_the_old_or_the_new_and_a_rerun_completes(tmp_path):
    lines = run("-m", "tests.faults.jobs", tmp_path)[:-1]
    counts = dict(line.split(" faults (")[0].rsplit(": ", 1) for line in lines)
    for name, least in LEAST.items():
        assert int(counts[name]) >= least, name


def test_a_command_that_is_killed_leaves_whole_files_and_a_rerun_completes(tmp_path):
    program = (
        "import random, sys; from pathlib import Path; import rdpi_gym.cli\n"
        "from tests.faults.commands import CHEAP, commands, disturb\n"
        "for name in CHEAP:\n"
        "    print(disturb(name, commands()[name], Path(sys.argv[1]), random.Random(name), 1))\n"
    )
    run("-c", program, tmp_path)
