"""Steps per second of one environment beside Gymnasium's CartPole-v1, in the same process.

    python -m studies.environment_speed

The two are measured in turn, round after round, so that a machine that slows down slows both, and
the median of the rounds' ratios counts. ``benchmark_step`` is Gymnasium's own measure; it draws a
random action for each step. The second measure steps through actions drawn beforehand.
"""

from __future__ import annotations

import platform
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from importlib.metadata import version
from itertools import cycle, product
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
import pandas as pd
from gymnasium.spaces import Box
from gymnasium.utils.performance import benchmark_step

import rdpi_gym  # noqa: F401  # registers the environment
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

# Declared for whole seconds; any number of them works.
_benchmark_step: Callable[[Any, float, int], float] = cast(Any, benchmark_step)
RESULTS = Path(__file__).parent / "results"
YARDSTICK = "CartPole-v1"
PIEZO = "rdpi_gym/PiezoTracking-v0"
CASES: dict[str, dict[str, Any]] = {
    "defaults": {},
    "increment, noisy sensor, randomised plant": {
        "plant": "P10-bench",
        "action": "increment",
        "randomise": 0.1,
        "command_cost": 0.1,
    },
}


def step_without_sampling(env: gym.Env[Any, Any], duration_s: float, seed: int) -> float:
    """Measure steps per second as ``benchmark_step`` does, with actions drawn beforehand."""
    env.action_space.seed(seed)
    actions = [env.action_space.sample() for _ in range(1000)]
    env.reset(seed=seed)
    steps, start = 0, time.perf_counter()
    for action in cycle(actions):
        steps += 1
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
        if time.perf_counter() - start > duration_s:
            break
    return steps / (time.perf_counter() - start)


def step_with_plain_box(env: gym.Env[Any, Any], duration_s: float, seed: int) -> float:
    """Measure as ``benchmark_step`` does, with actions from Gymnasium's own ``Box.sample``."""
    space, plain = env.action_space, Box(-1.0, 1.0, (1,), np.float32)
    if space != plain:
        return _benchmark_step(env, duration_s, seed)
    env.unwrapped.action_space = plain
    try:
        return _benchmark_step(env, duration_s, seed)
    finally:
        env.unwrapped.action_space = space


MEASURES: dict[str, Callable[[Any, Any, int], float]] = {
    "benchmark_step": _benchmark_step,
    "actions drawn beforehand": step_without_sampling,
    "benchmark_step, plain Box": step_with_plain_box,
}


def measure(
    rounds: int, duration_s: float, measures: Sequence[str] = tuple(MEASURES)
) -> pd.DataFrame:
    """Measure every case in turn with the yardstick."""
    yardstick = gym.make(YARDSTICK)
    rows = []
    for (case, keywords), name in product(CASES.items(), measures):
        steps_per_s = MEASURES[name]
        env = gym.make(PIEZO, **keywords)
        _benchmark_step(env, 0, 0)  # compiled kernels are loaded before the clock runs
        pairs = [
            (steps_per_s(yardstick, duration_s, seed), steps_per_s(env, duration_s, seed))
            for seed in range(rounds)
        ]
        theirs, ours = np.array(pairs).T
        rows.append(
            {
                "case": case,
                "measure": name,
                "steps_per_s": round(np.median(ours)),
                "cartpole_steps_per_s": round(np.median(theirs)),
                "ratio": round(float(np.median(ours / theirs)), 3),
                "ratio_lowest": round(float(np.min(ours / theirs)), 3),
                "ratio_highest": round(float(np.max(ours / theirs)), 3),
            }
        )
        env.close()
    yardstick.close()
    return pd.DataFrame(rows)


def as_markdown(table: pd.DataFrame, rounds: int, duration_s: float) -> str:
    """Return the table with what was measured and how."""
    return (
        f"# {PIEZO} beside {YARDSTICK}\n\n"
        f"Written by `python -m studies.environment_speed`: {rounds} rounds of {duration_s:g} s, the two "
        "environments in turn in one process, both made by `gymnasium.make`; medians, and the ratio "
        "ours / CartPole. `benchmark_step` is Gymnasium's own measure and draws a random action for "
        "each step. The environment's action space is equal to a `Box` and draws the same numbers, "
        "but faster: the rows with actions drawn beforehand leave drawing out on both sides, the rows "
        "with a plain Box draw through Gymnasium's own `Box.sample`.\n\n"
        f"Gymnasium {version('gymnasium')}, NumPy {version('numpy')}, numba {version('numba')}, "
        f"Python {platform.python_version()}, {platform.machine()}.\n\n{frame_table(table, digits=None, rule='tight')}\n"
    )


def _files(chosen: Namespace) -> Files:
    table = measure(chosen.rounds, chosen.seconds)
    text = as_markdown(table, chosen.rounds, chosen.seconds)
    return {"environment_speed.csv": table, "environment_speed.md": text}


def _more(options: Options) -> None:
    options.add_argument("--seconds", type=float, default=1.0, help="of each measurement")


main = Study(
    "environment_speed",
    __doc__,
    _files,
    RESULTS,
    numbers=(("--rounds", 9, "of timing"),),
    more=_more,
)

if __name__ == "__main__":
    sys.exit(main())
