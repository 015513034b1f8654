"""Trained steps per second: the native PPO on one and two threads, and Stable-Baselines3's.

Where a CUDA device is there, the native PPO on it is a further case; where none is, the page says that
it was left out.

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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import Progress, progress_bar, silent

RESULTS = Path(__file__).parent / "results"
CASES = (("ppo", 1), ("native-ppo", 1), ("native-ppo", 2))
"""Algorithm, as on the command line, and threads."""
ON_DEVICE = ("native-ppo --device cuda", 1)
"""The case that needs a device."""
_LEFT_OUT = "No CUDA device was there: the training on a device is left out."


def cases(device: bool) -> tuple[tuple[str, int], ...]:
    """Return the cases that are measured, with or without a device."""
    return (*CASES, ON_DEVICE) if device else CASES


def has_device() -> bool:
    """Whether there is a CUDA device."""
    import torch

    return torch.cuda.is_available()


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
    learner, run, epochs = (
        _reference(threads)
        if algorithm == "ppo"
        else _native(threads, algorithm.partition("--device ")[2] or None)
    )
    lanes, samples = run.settings.lanes, run.settings.algorithm["n_steps"]
    learner.begin(0)
    # On a device graphs are captured in the first calls: a rollout has enough of them.
    learner.learn(lanes * samples, Uninterrupted())
    before, clock, process = learner.timesteps, time.perf_counter(), time.process_time()
    learner.learn(rollouts * lanes * samples, Uninterrupted())
    return {
        "learner": algorithm,
        "threads": threads,
        "lanes": lanes,
        "epochs": epochs,
        "steps": learner.timesteps - before,
        "seconds": time.perf_counter() - clock,
        "process_s": time.process_time() - process,
    }


def _native(threads: int, device: str | None) -> tuple[Any, Any, int]:
    from baselines.learned.native.ppo import NativePPO
    from baselines.learned.run import Run
    from baselines.learned.train_native_ppo import Options, learner_of

    options = Options(action="increment", threads=threads, device=device)
    run = Run.open(options, "native-ppo", NativePPO)
    return learner_of(run, device), run, run.settings.algorithm["n_epochs"]


def _reference(threads: int) -> tuple[Any, Any, int]:
    from stable_baselines3 import PPO

    from baselines.learned.run import Run
    from baselines.learned.stable_baselines import StableBaselinesLearner
    from baselines.learned.train_ppo import Options, actor

    run = Run.open(Options(action="increment", threads=threads), "ppo", PPO)
    return StableBaselinesLearner(run, PPO, actor), run, run.settings.algorithm["n_epochs"]


def measure_all(rounds: int, rollouts: int, progress: Progress = silent) -> pd.DataFrame:
    """Measure every case in turn, some rounds."""
    found, asked = [], cases(has_device())
    for done in range(rounds * len(asked)):
        progress("training", done, rounds * len(asked))
        found.append(measure(*asked[done % len(asked)], rollouts))
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
    told = _LEFT_OUT
    if ON_DEVICE in rates.index:
        on_clock = table.set_index(["learner", "threads"])["steps_per_s"]
        told = (
            f"On the device it trains {float(on_clock.loc[ON_DEVICE]):,.0f} in a second of the clock, with "
            "the lanes and minibatches of `native-ppo-device.yml`."
        )
    return (
        "# Trained steps per second\n\n"
        f"The native PPO trains {one:,.0f} steps in a second of one core, Stable-Baselines3's PPO "
        f"{reference:,.0f}: {one / reference:.1f} times as many. On two threads it trains {two:,.0f} in a "
        "second of the process. On the clock it is as many times that as the process is given cores. "
        f"{told}\n\n"
        f"Written by `python -m studies.training_speed`: {rounds} rounds, each case in turn, each with "
        "the hyper-parameters that ship, on the four plants of a training side by side with increments "
        "of the command; medians and bests over the rounds. A trained step is a sample of one lane that "
        "was used in the updates, `epochs` times. `steps_per_process_s` is over the seconds of the "
        f"process, all threads together. {os.cpu_count()} cores; while it ran, "
        f"{os.getloadavg()[1]:.1f} processes wanted them.\n\n"
        f"{frame_table(table)}\n"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it as CSV and Markdown."""
    options = Options("training_speed", __doc__, out=RESULTS)
    options.add_number("--rounds", 5, "of timing")
    options.add_number("--rollouts", 8, "of each measurement")
    return options.run(arguments, _measure_all)


def _measure_all(chosen: Namespace) -> None:
    with progress_bar() as show:
        table = measure_all(chosen.rounds, chosen.rollouts, progress=show)
    csv = table.to_csv(index=False, float_format="%.4g", lineterminator="\n")
    write_atomic(chosen.out / "training_speed.csv", csv)
    text = as_markdown(table, chosen.rounds)
    print(text, f"written to {write_atomic(chosen.out / 'training_speed.md', text)}", sep="\n")


if __name__ == "__main__":
    sys.exit(main())
