"""Nanoseconds of a step of generated code on this machine, beside those of the controller in Python.

    python -m studies.firmware_speed

Each is measured in turn with the Python controller's ``predict`` of one lane. Times are of the
processor, medians of the rounds.
"""

from __future__ import annotations

import platform
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from baselines.registry import known_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.firmware.compiling import STRICT, compiler, run
from rdpi_gym.firmware.making import package_of
from rdpi_gym.firmware.writing.vectors import SAMPLES
from rdpi_gym.plant import P10
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.bare_metal.boards import HERE
from studies.bare_metal.counted import write_sources
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
TS_S = 5e-5
ASKED_NS = 150
"""Longest step of ten plays with PI."""
CONTROLLERS = (
    "classical-reference-rate", "inversion-free-reference-rate", "pi", "pi-classical-reference-rate",
    "lqg-preview", "adaptive-feedforward",
)  # fmt: skip
_PRECISIONS = {64: "double", 32: "float", 31: "Q31"}
_PYTHON_STEPS = 1000


def measure(rounds: int, names: Sequence[str] = CONTROLLERS) -> pd.DataFrame:
    """Measure controllers on P10, ten plays."""
    rows = []
    for name in names:
        source = package_of(P10, TS_S, name).source
        row: dict[str, Any] = {"controller": name}
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            write_sources(source, folder)
            for precision, word in _PRECISIONS.items():
                timed = precision in source.precisions
                row[f"{word}_ns"] = _compiled_ns(folder, precision, rounds) if timed else np.nan
        row["python_ns"] = _python_ns(name, rounds)
        rows.append({**row, "times": row["python_ns"] / row["double_ns"]})
    return pd.DataFrame(rows)


def _compiled_ns(folder: Path, precision: int, rounds: int) -> float:
    program = folder / f"speed{precision}"
    sources = [str(HERE / "speed.c"), str(folder / "rdpi_controller.c")]
    words = [*compiler(), *STRICT, f"-DRDPI_PRECISION={precision}", f"-I{folder}", *sources]
    done = run([*words, "-o", str(program), "-lm"], folder)
    if done.returncode:
        raise InputError(f"the compiler refuses the code: {done.stderr.strip()[:300]}")
    said = run([str(program), str(rounds)], folder).stdout
    return float(np.median([float(line) for line in said.split()]))


def _python_ns(name: str, rounds: int) -> float:
    made, ahead = known_controller(name), 1
    while True:
        controller = made(P10, ObservationLayout.for_plant(P10, ts_s=TS_S, preview=ahead))
        if controller.needed_preview <= ahead:
            break
        ahead = controller.needed_preview
    shown = np.random.default_rng(0).uniform(-0.5, 0.5, (_PYTHON_STEPS, controller.layout.size))
    state = None
    times = []
    for _ in range(rounds + 1):
        begin = time.process_time_ns()
        for row in shown:
            _, state = controller.predict(row, state)
        times.append((time.process_time_ns() - begin) / _PYTHON_STEPS)
    return float(np.median(times[1:]))  # the first compiles kernels


def as_markdown(table: pd.DataFrame, rounds: int) -> str:
    """Return the table with what was measured and how."""
    ten = table[table["controller"] == "pi-classical-reference-rate"]
    head = "".join(
        f"Ten plays with PI take {float(each):.0f} ns a step in double, {ASKED_NS} allowed.\n\n"
        for each in ten["double_ns"]
    )
    return (
        "# Time of a step of generated code on a desktop\n\n"
        f"{head}"
        f"Written by `python -m studies.firmware_speed`: {rounds} rounds of {SAMPLES} vectors fifty times "
        f"over, a step and its acknowledgement; plant P10, Ts {TS_S:g} s. Compiled with "
        f"`{' '.join([*compiler(), *STRICT])}`. Python is `predict` of one lane, an observation at a "
        "time; `times`: steps of C in double while Python does one. Nanoseconds of the processor, "
        "medians.\n\n"
        f"Python {platform.python_version()}, {platform.machine()}.\n\n"
        f"{frame_table(table)}\n"
    )


def _files(chosen: Namespace) -> Files:
    table = measure(chosen.rounds)
    return {"firmware_speed.csv": table, "firmware_speed.md": as_markdown(table, chosen.rounds)}


main = Study(
    "firmware_speed", __doc__, _files, RESULTS, numbers=(("--rounds", 15, "of timing"),), csv="%.4g"
)

if __name__ == "__main__":
    sys.exit(main())
