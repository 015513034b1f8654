"""What JAX takes over of the vector environment's arrays without a copy, on the CPU.

    python -m studies.jax_copies

Needs jax, which is not among the extras. In every step JAX's actions go to the environment and its
observations to JAX; whether memory is shared is read from addresses, not guessed from times.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd

import rdpi_gym  # noqa: F401  # registers the environment
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
LANES = (1, 64, 4096)


def measure(jax: Any, lanes: int, steps: int) -> dict[str, float]:
    """Step an environment with JAX on the other side."""
    envs = gym.make_vec(
        "rdpi_gym/PiezoTracking-v0", num_envs=lanes, vectorization_mode="vector_entry_point"
    )
    envs.reset(seed=0)
    action = jax.numpy.zeros((lanes, 1))
    there, back, kept, times = [], [], [], []
    for _ in range(steps):
        shown = np.asarray(action)
        there.append(shown.ctypes.data == action.unsafe_buffer_pointer())
        begun = time.perf_counter()
        observation, *_ = envs.step(shown)
        times.append(time.perf_counter() - begun)
        taken = jax.numpy.from_dlpack(observation)
        back.append(taken.unsafe_buffer_pointer() == observation.ctypes.data)
        kept.append(taken)  # so that no later array has the same place
    return {
        "lanes": lanes,
        "actions_shared_percent": 100.0 * float(np.mean(there)),
        "observations_shared_percent": 100.0 * float(np.mean(back)),
        "take_over_us": _median_us(lambda: jax.numpy.from_dlpack(observation), steps),
        "copy_us": _median_us(lambda: jax.numpy.array(observation), steps),
        "step_us": 1e6 * float(np.median(times)),
    }


def _median_us(call: Callable[[], Any], times: int) -> float:
    found = []
    for _ in range(times):
        begun = time.perf_counter()
        call().block_until_ready()
        found.append(time.perf_counter() - begun)
    return 1e6 * float(np.median(found))


def as_markdown(table: pd.DataFrame, steps: int) -> str:
    """Return the table, with what it says first."""
    observations, actions = table["observations_shared_percent"], table["actions_shared_percent"]
    return (
        "# JAX on the arrays of the vector environment\n\n"
        f"JAX shares the memory of {observations.min():.0f} % of the observations at least, and the environment that of {actions.min():.0f} % of JAX's actions.\n\n"
        f"Written by `python -m studies.jax_copies --steps {steps}` with JAX {version('jax')} on the CPU: shares by address, medians of times.\n\n"
        f"{frame_table(table)}\n"
    )


def _measure_all(chosen: Namespace) -> Files:
    try:
        jax = import_module("jax")
    except ImportError as error:
        raise InputError("this study needs jax, which is not installed; pip install jax") from error
    table = pd.DataFrame([measure(jax, lanes, chosen.steps) for lanes in LANES])
    return {"jax_copies.csv": table, "jax_copies.md": as_markdown(table, chosen.steps)}


main = Study(
    "jax_copies", __doc__, _measure_all, RESULTS,
    numbers=(("--steps", 300, "of the environment"),), csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
