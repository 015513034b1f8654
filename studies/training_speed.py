"""Trained steps per second: the native PPO on one and two threads, and Stable-Baselines3's.

    python -m studies.training_speed

A trained step is one sample of one lane that was used in PPO's updates, as often as the algorithm's
hyper-parameters say (``n_epochs``). Each round runs every case in turn; seconds of the process count
beside those of the clock, as a machine that does other work stretches the latter. Evaluations and
checkpoints are left out; kernels are loaded, and one rollout is made, before the clock runs.
"""

from __future__ import annotations

import os
import sys
import time
from argparse import Namespace
from pathlib import Path
from typing import Any

import pandas as pd

from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import Progress, progress_bar, silent
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
CASES = (("ppo", 1), ("native-ppo", 1), ("native-ppo", 2))
"""Algorithm, as on the command line, and threads."""


class Uninterrupted:
    """Stands between two stretches of a training and does nothing."""

    def before_rollout(self) -> dict[str, float]:
        """Return no evaluation."""
        return {}

    def rewarded(self, reward: float) -> None:
        """Forget it."""

    def end(self) -> dict[str, float]:
        """Return no evaluation."""
        return {}


def measure(algorithm: str, threads: int, rollouts: int) -> dict[str, Any]:
    """Train for some rollouts after a first one."""
    from stable_baselines3 import PPO

    from baselines.learned.native_learner import NativeLearner
    from baselines.learned.native_ppo import NativePPO
    from baselines.learned.options import Run
    from baselines.learned.stable_baselines import StableBaselinesLearner
    from baselines.learned.training import Options as Training

    kind: Any = PPO if algorithm == "ppo" else NativePPO
    run = Run.open(Training(action="increment", threads=threads), algorithm, kind)
    learner: Any = StableBaselinesLearner(run) if algorithm == "ppo" else NativeLearner(run)
    lanes, samples = run.settings.lanes, run.settings.algorithm["n_steps"]
    learner.begin(0)
    learner.learn(lanes * samples, Uninterrupted())
    before, clock, process = learner.timesteps, time.perf_counter(), time.process_time()
    learner.learn(rollouts * lanes * samples, Uninterrupted())
    return {
        "learner": algorithm,
        "threads": threads,
        "lanes": lanes,
        "epochs": run.settings.algorithm["n_epochs"],
        "steps": learner.timesteps - before,
        "seconds": time.perf_counter() - clock,
        "process_s": time.process_time() - process,
    }


def measure_all(rounds: int, rollouts: int, progress: Progress = silent) -> pd.DataFrame:
    """Measure every case in turn, some rounds."""
    found = []
    for done in range(rounds * len(CASES)):
        progress("training", done, rounds * len(CASES))
        found.append(measure(*CASES[done % len(CASES)], rollouts))
    table = pd.DataFrame(found)
    table["steps_per_s"] = table["steps"] / table["seconds"]
    table["steps_per_process_s"] = table["steps"] / table["process_s"]
    rates = ["steps_per_s", "steps_per_process_s"]
    groups = table.groupby(["learner", "threads", "lanes", "epochs", "steps"], sort=False)[rates]
    return groups.median().join(groups.max().add_prefix("best_")).reset_index()


def as_markdown(table: pd.DataFrame, rounds: int) -> str:
    """Return the table with what was measured and how."""
    rates = table.set_index(["learner", "threads"])["steps_per_process_s"]
    reference, one, two = (float(rates.loc[case]) for case in CASES)
    return (
        "# Trained steps per second\n\n"
        f"The native PPO trains {one:,.0f} steps in a second of one core, Stable-Baselines3's PPO "
        f"{reference:,.0f}: {one / reference:.1f} times as many. On two threads it trains {two:,.0f} in a "
        "second of the process. On the clock it is as many times that as the process is given cores.\n\n"
        f"Written by `python -m studies.training_speed`: {rounds} rounds, each case in turn, each with "
        "the hyper-parameters that ship, on the four plants of a training side by side with increments "
        "of the command; medians and bests over the rounds. A trained step is a sample of one lane that "
        "was used in the updates, `epochs` times. `steps_per_process_s` is over the seconds of the "
        f"process, all threads together. {os.cpu_count()} cores; while it ran, "
        f"{os.getloadavg()[1]:.1f} processes wanted them.\n\n"
        f"{frame_table(table)}\n"
    )


def _files(chosen: Namespace) -> Files:
    with progress_bar() as show:
        table = measure_all(chosen.rounds, chosen.rollouts, progress=show)
    return {"training_speed.csv": table, "training_speed.md": as_markdown(table, chosen.rounds)}


main = Study(
    "training_speed", __doc__, _files, RESULTS,
    numbers=(("--rounds", 5, "of timing"), ("--rollouts", 8, "of each measurement")), csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
