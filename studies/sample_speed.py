"""Time for a hundred thousand samples: every signal evaluated, a record written as text read.

    python -m studies.sample_speed

Each is measured in turn with what NumPy alone takes for as many samples: ``np.sin`` of the same
times, ``np.loadtxt`` of the same file. Times are of the processor, and the median of the rounds'
ratios counts, so that other work on the machine disturbs little.
"""

from __future__ import annotations

import platform
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.measurement import Record, load, write_csv
from rdpi_gym.signals import SIGNALS, Signal, Sine, Triangle
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
SAMPLES = 100_000
_PARTS: dict[str, dict[str, Any]] = {
    "sum": {"parts": (Sine(), Triangle())},
    "sequence": {"parts": (Sine(), Triangle()), "durations_s": (1.0, 1.5)},
    "measured": {"times_s": np.linspace(0.0, 20.0, 2001), "values_um": np.arange(2001.0)},
}


def signals() -> list[Signal]:
    """Return one signal of each kind, with its defaults where it has them."""
    return [kind(**_PARTS.get(name, {})) for name, kind in SIGNALS.items()]


def measure(rounds: int, samples: int) -> pd.DataFrame:
    """Measure every case in turn with its yardstick."""
    t = np.linspace(0.0, 20.0, samples)
    rows = [_row(s.name, partial(s, t), "np.sin", partial(np.sin, t), rounds) for s in signals()]
    with tempfile.TemporaryDirectory() as folder:
        record = Record("run", t, np.sin(9 * t), np.cos(7 * t), float(t[1]))
        path = write_csv(record, Path(folder) / "run.csv")
        numpy = partial(np.loadtxt, path, delimiter=",", skiprows=1)
        rows.append(_row("read a text file", partial(load, path), "np.loadtxt", numpy, rounds))
    return pd.DataFrame(rows)


def _row(
    case: str,
    ours: Callable[[], object],
    yardstick: str,
    theirs: Callable[[], object],
    rounds: int,
) -> dict[str, object]:
    ours()  # what is kept after the first use is no part of the measure
    pairs = np.array([(_milliseconds(ours), _milliseconds(theirs)) for _ in range(rounds)])
    ratios = pairs[:, 0] / pairs[:, 1]
    return {
        "case": case,
        "milliseconds": float(np.median(pairs[:, 0])),
        "yardstick": yardstick,
        "yardstick_milliseconds": float(np.median(pairs[:, 1])),
        "ratio": float(np.median(ratios)),
        "ratio_lowest": float(ratios.min()),
        "ratio_highest": float(ratios.max()),
    }


def _milliseconds(call: Callable[[], object]) -> float:
    begin = time.process_time_ns()
    call()
    return max(1e-6 * (time.process_time_ns() - begin), 1e-3)


def as_markdown(table: pd.DataFrame, rounds: int) -> str:
    """Return the table with what was measured and how."""
    return (
        f"# Time for {SAMPLES} samples\n\n"
        f"Written by `python -m studies.sample_speed`: {rounds} rounds, each case in turn with its "
        "yardstick in one process; median processor times, and the ratio ours / yardstick. Signals are "
        "evaluated at as many times over 20 s, beside `np.sin` of the same times; the text file has as "
        "many lines of time, voltage and displacement, and `np.loadtxt` reads the same file without "
        "checking it.\n\n"
        f"NumPy {version('numpy')}, Python {platform.python_version()}, {platform.machine()}.\n\n"
        f"{frame_table(table)}\n"
    )


def _files(chosen: Namespace) -> Files:
    table = measure(chosen.rounds, SAMPLES)
    return {"sample_speed.csv": table, "sample_speed.md": as_markdown(table, chosen.rounds)}


main = Study(
    "sample_speed", __doc__, _files, RESULTS, numbers=(("--rounds", 15, "of timing"),), csv="%.4g"
)

if __name__ == "__main__":
    sys.exit(main())
