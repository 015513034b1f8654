"""Speeds against another revision, measured in turn: ``python -m tests.speed --against REV``.

Two processes, one with this checkout and one with the revision in a temporary folder, do the same small
jobs, one after the other and round after round, after a first one that compiles: of one thread the
processor's time, of vectors and an import the clock's, of discoveries of two effects both, of their
processes together. The ratio is that of
the shortest times, this checkout over the revision; beside it stands the median of the rounds' ratios.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.house import PACKAGES, ROOT

JOBS = {
    "import": 5, "env.step": 30, "env.reset": 30, "vector step, 256": 30, "vector step, 4096": 30,
    "vector reset, 256": 15, "fit": 7, "discover": 3, "two effects, 1 job": 1,
    "two effects, 2 jobs": 1, "benchmark": 3,
}  # fmt: skip
"""Rounds of each job."""
CHILD = """
import json, os, subprocess, sys, time
from pathlib import Path
import gymnasium as gym, numpy as np
import rdpi_gym as rg

ID = "rdpi_gym/PiezoTracking-v0"
env, vectors = gym.make(ID), {}
action = np.zeros(1, np.float32)

def vector(lanes):
    if lanes not in vectors:
        made = gym.make_vec(ID, num_envs=lanes, vectorization_mode="vector_entry_point")
        made.reset(seed=0)
        vectors[lanes] = made, np.zeros((lanes, 1), np.float32)
    return vectors[lanes]

def env_step():
    env.reset(seed=0)
    began = time.process_time()
    for _ in range(3000):
        env.step(action)
    return time.process_time() - began

def env_reset():
    began = time.process_time()
    for seed in range(100):
        env.reset(seed=seed)
    return time.process_time() - began

def vector_step(lanes, steps):
    made, actions = vector(lanes)
    began = time.perf_counter()
    for _ in range(steps):
        made.step(actions)
    return time.perf_counter() - began

def vector_reset():
    made, _ = vector(256)
    began = time.perf_counter()
    made.reset(seed=1)
    return time.perf_counter() - began

def imported():
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import rdpi_gym as rg; rg.fit"], check=True)
    return time.perf_counter() - began

data = rg.simulate("P5", seed=1)
hidden = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
hidden = hidden.select("stairs", "sine-50hz", "validation-stairs", "quiet")

def timed(job):
    began = time.process_time()
    job()
    return time.process_time() - began

def processor_s():
    # of this process and those that it started
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        if str(os.getpid()) in (fields[1], stat.parent.name):
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")

two = []

def two_effects(count):
    if not two:
        two.append(rg.simulate("P5", hide=["creep", "saturation"], seed=1))
    used, began = processor_s(), time.perf_counter()
    rg.discover(two[0], jobs=count)
    return time.perf_counter() - began, processor_s() - used

jobs = {
    "import": imported,
    "env.step": env_step,
    "env.reset": env_reset,
    "vector step, 256": lambda: vector_step(256, 100),
    "vector step, 4096": lambda: vector_step(4096, 20),
    "vector reset, 256": vector_reset,
    "fit": lambda: timed(lambda: rg.fit(data)),
    "discover": lambda: timed(lambda: rg.discover(hidden, jobs=1)),
    "two effects, 1 job": lambda: two_effects(1),
    "two effects, 2 jobs": lambda: two_effects(2),
    "benchmark": lambda: timed(lambda: rg.benchmark(
        ["none", "classical-static"], plants=["P5"], references=["sine"], ts_s=[1e-3], seeds=1, jobs=1)),
}
print(json.dumps(rg.__file__), flush=True)
for line in sys.stdin:
    print(json.dumps(jobs[json.loads(line)]()), flush=True)
"""


class Tree:
    """A process that does jobs with the packages of a folder."""

    def __init__(self, folder: Path) -> None:
        environment = os.environ | {
            "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
        }  # fmt: skip
        self.process = subprocess.Popen(
            [sys.executable, "-c", CHILD],
            cwd=folder, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        imported = Path(self._answer())
        assert imported.is_relative_to(folder), f"{imported} is not of {folder}"

    def _answer(self):
        return json.loads(self.process.stdout.readline())

    def seconds(self, job: str) -> list[float]:
        """The time that a job takes there (s); of some the processor's beside it."""
        print(json.dumps(job), file=self.process.stdin, flush=True)
        answer = self._answer()
        return answer if isinstance(answer, list) else [answer]

    def end(self) -> None:
        """Let the process end."""
        self.process.stdin.close()
        self.process.wait()


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", required=True, metavar="REV")
    parser.add_argument("--jobs", default="", help="those whose name holds this text")
    parser.add_argument("--rounds", type=float, default=1.0, help="times so many rounds")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="speed-") as name:
        archive = subprocess.run(
            ["git", "archive", asked.against, *PACKAGES], cwd=ROOT, check=True, capture_output=True
        )
        subprocess.run(["tar", "x", "-C", name], input=archive.stdout, check=True)
        trees = Tree(ROOT), Tree(Path(name))
        print(f"{'':20}{'here':>10}{asked.against[:10]:>12}{'ratio':>8}{'median':>8}")
        for job, rounds in JOBS.items():
            if asked.jobs not in job:
                continue
            for tree in trees:
                tree.seconds(job)
            count = max(1, round(rounds * asked.rounds))
            # each is first in half of the rounds
            times = [[[0.0], [0.0]] for _ in range(count)]
            for k, row in enumerate(times):
                for which in (0, 1) if k % 2 else (1, 0):
                    row[which] = trees[which].seconds(job)
            for k, name in enumerate((job, "  its processes")[: len(times[0][0])]):
                here, there = (min(row[which][k] for row in times) for which in (0, 1))
                middle = statistics.median(own[k] / other[k] for own, other in times)
                print(
                    f"{name:20}{here:8.4g} s{there:10.4g} s{here / there:8.3f}{middle:8.3f}",
                    flush=True,
                )
        for tree in trees:
            tree.end()


if __name__ == "__main__":
    main()
