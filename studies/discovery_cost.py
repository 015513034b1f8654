"""Time and memory of ``rdpi discover`` on the standard protocol, over samples and candidates.

    python -m studies.discovery_cost
    python -m studies.discovery_cost --oversampled 4000000

Two effects (creep and delay) are hidden by ``rdpi simulate``; they are discovered in a process of its
own with two workers, compiled code in the cache; the time of computing is that of one process. Memory
is the largest resident set of the main process plus that of the largest worker for each worker: no less
than what was held at once.

With ``--oversampled N``, one row of a table of its own: three records of N samples together, sampled
far finer than their commands need, as a recorder that streams makes them; one process.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.cli import main as rdpi
from rdpi_gym.measurement import Record, load
from rdpi_gym.measurement.writing import write_csv
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.plant.effects.sensor_lag import SensorLag
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "discovery_cost"
HIDDEN = ("creep", "delay")
# The hidden effects, then rivals in the order of the catalogue's chain.
CANDIDATES = (
    *HIDDEN, "sensor_lag", "asymmetry", "thermal_drift", "saturation", "gain_drift", "rate_law",
    "backlash", "congruency", "actuator_lag", "initial_memory", "resonance", "slew_limit", "mains_hum",
)  # fmt: skip
CELLS = ((2.0, 15), (1.0, 15), (0.5, 15), (1.0, 3), (1.0, 8))
"""Factor of the sampling time, and number of candidates."""
_JOBS = 2
# Lowest and highest frequency (Hz) of the commands of oversampled records.
_BANDS = {"slow": (0.15, 5.0), "wide": (1.0, 200.0), "validation": (0.4, 120.0)}
_RUN = """
import json, resource, sys, time
from pathlib import Path
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import load
from rdpi_gym.plant.effects import CATALOGUE
data, jobs, names = sys.argv[1], int(sys.argv[2]), sys.argv[3].split(",")
began = time.perf_counter()
found = discover(load(Path(data)), catalogue={name: CATALOGUE[name] for name in names}, jobs=jobs)
seconds = time.perf_counter() - began
owners = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
own, worker = (resource.getrusage(owner).ru_maxrss / 1024 for owner in owners)
print("COST " + json.dumps({
    "found": "+".join(sorted(c.effect for c in found.named)),
    "verdict": found.verdict,
    "seconds": seconds,
    "cpu_s": sum(resource.getrusage(resource.RUSAGE_SELF)[:2]),
    "memory_mib": own + (jobs > 1) * jobs * worker,
}))
"""


def cost(data: Path, candidates: Sequence[str], jobs: int) -> dict[str, Any]:
    """Discover the hidden effects in a process of its own; return the result and its cost."""
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL")}
    done = subprocess.run(
        [sys.executable, "-c", _RUN, str(data), str(jobs), ",".join(candidates)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | threads,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("COST ")]
    if done.returncode or not lines:
        raise RuntimeError(f"discovery in {data} failed: {done.stderr.strip()[-300:]}")
    found: dict[str, Any] = json.loads(lines[-1].removeprefix("COST "))
    return found


def simulate(folder: Path, ts_factor: float) -> Path:
    """Write a data set with hidden effects, as ``rdpi simulate`` does; return its folder."""
    arguments = ["simulate", "--hide", ",".join(HIDDEN), "--ts-factor", str(ts_factor)]
    if not folder.exists() and rdpi([*arguments, "--out", str(folder)]):
        raise RuntimeError(f"rdpi {' '.join(arguments)} failed")
    return folder / "data"


def measure(folder: Path, ts_factor: float, candidates: int, repeats: int) -> dict[str, Any]:
    """Return the fastest of some discoveries, the computing time of one process, the most memory."""
    data = simulate(folder / f"data-{ts_factor:g}", ts_factor)
    names = CANDIDATES[:candidates]
    costs = [cost(data, names, _JOBS) for _ in range(repeats)]
    best = min(costs, key=lambda c: float(c["seconds"]))
    return {
        "ts_factor": ts_factor,
        "training_samples": sum(int(record.error_mask.sum()) for record in load(data).train),
        "candidates": candidates,
        "found": best["found"],
        "verdict": best["verdict"],
        "seconds": round(best["seconds"], 2),
        "cpu_s": round(cost(data, names, 1)["cpu_s"], 2),
        "memory_mib": round(max(c["memory_mib"] for c in costs)),
    }


def exponent(rows: pd.DataFrame, over: str) -> float:
    """Return how seconds of computing grow: the slope over a column, both in logarithms."""
    return float(np.polyfit(np.log(rows[over]), np.log(rows["cpu_s"]), 1)[0])


def oversample(folder: Path, samples: int) -> Path:
    """Write three records of P10 with creep and a sensor lag, 100,000 samples a second."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    t = np.arange(samples // 3, dtype=np.float64) * 1e-5
    effects = (Creep(gain_per_decade=0.02), SensorLag(time_constant_s=1.5e-4))
    plant = Plant(replace(P10, effects=effects), 1e-5)
    for name, (low_hz, high_hz) in _BANDS.items():
        u = np.zeros(t.size)
        for f in np.geomspace(low_hz, high_hz, 12):
            u += np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi)) / f**0.3
        u -= u[0]
        u *= 60.0 / float(np.max(np.abs(u)))
        plant.reset()
        y = np.asarray(plant.simulate(u) + rng.normal(0.0, 0.012, t.size))
        write_csv(Record(name, t, u, y, ts_s=1e-5), folder / f"{name}.csv")
    return folder


def _table(rows: Sequence[dict[str, Any]]) -> str:
    return frame_table(pd.DataFrame(rows), digits=None, rule="plain")


def _files(chosen: Namespace) -> Files:
    python = f"Python {platform.python_version()}"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        cost(simulate(folder / "warm", 2.0), HIDDEN, _JOBS)
        if chosen.oversampled:
            found = cost(oversample(folder / "data", chosen.oversampled), CANDIDATES, 1)
            row = {"samples": chosen.oversampled, "candidates": len(CANDIDATES)} | found
            row |= {name: round(found[name], 1) for name in ("seconds", "cpu_s")}
            row["memory_mib"] = round(found["memory_mib"])
            text = (
                "# Time and memory of `rdpi discover` on oversampled records\n\n"
                f"Made by `python -m studies.discovery_cost --oversampled {chosen.oversampled}` ({python}, one "
                "process), hidden: creep and sensor_lag; reading the files is part of it.\n\n"
            )
            return {"oversampled.md": f"{text}{_table([row])}\n"}
        rows = []
        for cell in CELLS:
            rows.append(measure(folder, *cell, chosen.repeats))
            print(rows[-1], flush=True)
    table = pd.DataFrame(rows)
    over_samples = exponent(table[table["candidates"] == len(CANDIDATES)], "training_samples")
    over_candidates = exponent(table[table["ts_factor"] == 1.0], "candidates")
    text = (
        "# Time and memory of `rdpi discover`\n\n"
        f"Made by `python -m studies.discovery_cost` ({python}, {os.cpu_count()} cores, {_JOBS} processes), hidden: "
        f"{' and '.join(HIDDEN)}, seed 0.\n\n{_table(rows)}\n\n"
        f"Computing time grows with samples to the power {over_samples:.2f} and with candidates to the power "
        f"{over_candidates:.2f}.\n"
    )
    return {"discovery_cost.csv": table, "discovery_cost.md": text}


main = Study(
    "discovery_cost", __doc__, _files, RESULTS,
    numbers=(
        ("--repeats", 2, "of each measurement"),
        ("--oversampled", None, "samples of three oversampled records, and nothing else"),
    ),
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
