"""Samples a second of every hysteresis core's kernel, beside those of the RDPI model in the same run.

    python -m studies.core_speed

Each case is measured in turn with the RDPI model P10, ten plays, on the same commands: sines of three
times the core's length, a phase of its own in each lane, as one block of samples and in calls of one
sample. Times are of the processor, and the median of the rounds' ratios counts, so that other work
on the machine disturbs little.
"""

from __future__ import annotations

import dataclasses
import platform
import sys
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.plant import CORES, P10, pack
from rdpi_gym.plant.cores.base import Core, empty_state
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
LANES = (16, 64, 256)
PERIODS = (50, 200, 2000)
"""Samples of a period of the command."""
SAMPLES = 400
_TS_S = 1e-3
_AMPLITUDE_V, _LENGTH_V = 30.0, 10.0
_SCALE = DataScale(
    centre_V=0.0, span_V=_AMPLITUDE_V, stroke_um=20.0, fastest_V_s=400.0, shortest_s=_TS_S,
    longest_s=4.0,
)  # fmt: skip
_PLAYS = 10
_SHAPES: Mapping[str, tuple[Mapping[str, float], ...]] = {
    "bouc_wen": tuple({"limit_V": _LENGTH_V, "sigma": 0.7, "exponent": n} for n in (1.0, 1.5, 3.0)),
    "asymmetric_bouc_wen": ({"limit_V": _LENGTH_V, "sigma": 0.7, "exponent": 1.5, "skew": 0.2},),
    "dahl": tuple({"limit_V": _LENGTH_V, "exponent": i} for i in (0.5, 1.0, 1.5)),
    "duhem": ({"length_V": _LENGTH_V},),
    "lugre": ({"coulomb_V": _LENGTH_V, "stribeck_V_s": 100.0},),
}


def cases() -> dict[str, Core]:
    """Return the cores that are measured, by what the table calls them.

    Those of plays or stops have ten, as P10 has; the others the numbers that a fit begins with, and
    a length of 10 V.
    """
    found: dict[str, Core] = {}
    for name, kind in CORES.items():
        start = P10.hysteresis if name == P10.hysteresis.name else kind.starts(_SCALE)[0]
        for shape in _SHAPES.get(name, ({},)):
            core = _with_ten_plays(start).with_shape(shape)
            said = f", exponent {shape['exponent']:g}" if "exponent" in shape else ""
            found[f"{name}{said}"] = core
    return found


def _with_ten_plays(core: Any) -> Core:
    more = len(core.thresholds_V) - _PLAYS if core.spaced else 0
    if more > 0:
        thresholds, weights = core.thresholds_V[:-more], core.weights[:-more]
        core = dataclasses.replace(core, thresholds_V=thresholds, weights=weights)
    return core  # type: ignore[no-any-return]


class _Kernel:
    """A core's kernel on the same commands, again and again; each call continues the last one."""

    def __init__(self, core: Core, u: Array) -> None:
        self._block = type(core).block
        self._u, self._v = u, np.gradient(u, axis=0) / _TS_S
        self._p = pack([core] * u.shape[1], _TS_S, [0.0] * u.shape[1])
        self._state, self._y = empty_state(core.n, u.shape[1]), np.empty_like(u)

    def block_ns(self) -> float:
        """Time of one sample and lane (ns) in one block."""
        begin = time.process_time_ns()
        self._block(self._u, self._v, self._p, self._state, self._y)
        return max(time.process_time_ns() - begin, 1) / self._u.size

    def steps_ns(self) -> float:
        """The same in calls of one sample."""
        begin = time.process_time_ns()
        for t in range(len(self._u)):
            at = slice(t, t + 1)
            self._block(self._u[at], self._v[at], self._p, self._state, self._y[at])
        return max(time.process_time_ns() - begin, 1) / self._u.size


def _commands(lanes: int, period: int) -> Array:
    """Sines, float64[SAMPLES, lanes] (V), each with a phase of its own."""
    phases = np.linspace(0.0, 2.0 * np.pi, lanes, endpoint=False)
    u: Array = _AMPLITUDE_V * np.sin(np.arange(SAMPLES)[:, None] * (2.0 * np.pi / period) + phases)
    return u


def measure(
    rounds: int, lanes: Sequence[int] = LANES, periods: Sequence[int] = PERIODS
) -> pd.DataFrame:
    """Measure every core in turn with the RDPI model."""
    rows = []
    for period in periods:
        for count in lanes:
            u = _commands(count, period)
            kernels = {label: _Kernel(core, u) for label, core in cases().items()}
            rdpi = _Kernel(P10.hysteresis, u)
            for kernel in (rdpi, *kernels.values()):
                kernel.block_ns()
                kernel.steps_ns()
            times = np.array(
                [
                    [
                        (k.block_ns(), rdpi.block_ns(), k.steps_ns(), rdpi.steps_ns())
                        for k in kernels.values()
                    ]
                    for _ in range(rounds)
                ]
            )
            for i, label in enumerate(kernels):
                block, its_block, steps, its_steps = times[:, i].T
                rows.append(
                    {
                        "core": label,
                        "lanes": count,
                        "samples_a_period": period,
                        "block_ns": np.median(block),
                        "rdpi_block_ns": np.median(its_block),
                        "block_ratio": np.median(its_block / block),
                        "steps_ratio": np.median(its_steps / steps),
                    }
                )
    return pd.DataFrame(rows)


def as_markdown(table: pd.DataFrame, rounds: int) -> str:
    """Return the table with what was measured and how."""
    slowest = table.sort_values("block_ratio").iloc[0]
    return (
        "# Samples a second of the hysteresis cores, over those of the RDPI model\n\n"
        f"The slowest is {slowest['core']} at {slowest['lanes']} lanes and "
        f"{slowest['samples_a_period']} samples a period: {slowest['block_ratio']:.2g} of the RDPI "
        "model's samples a second in a block.\n\n"
        f"Written by `python -m studies.core_speed`: {rounds} rounds, each core in turn with the RDPI "
        f"model P10 of {_PLAYS} plays in one process, on sines of {_AMPLITUDE_V:g} V with a phase of its "
        f"own in each lane, {SAMPLES} samples as one block and in calls of one sample. Lengths of z are "
        f"{_LENGTH_V:g} V, plays and stops {_PLAYS}, levels 15; nanoseconds of the processor for one "
        "sample and lane, medians; ratios above one are faster than the RDPI model.\n\n"
        f"NumPy {version('numpy')}, numba {version('numba')}, Python {platform.python_version()}, "
        f"{platform.machine()}.\n\n"
        f"{frame_table(table)}\n"
    )


def _files(chosen: Namespace) -> Files:
    table = measure(chosen.rounds)
    return {"core_speed.csv": table, "core_speed.md": as_markdown(table, chosen.rounds)}


main = Study(
    "core_speed", __doc__, _files, RESULTS, numbers=(("--rounds", 15, "of timing"),), csv="%.4g"
)

if __name__ == "__main__":
    sys.exit(main())
