"""Share of PPO's wall time that is spent in the environment, adapter and wrappers included.

    python -m studies.training_share

Agents are trained as ``rdpi train ppo`` trains them, with 256 plants side by side; the time between
the actions that the algorithm gives and the observations, rewards and infos that it gets is counted,
and that of everything, evaluations and checkpoints left out.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from pathlib import Path
from typing import Any

import pandas as pd

from rdpi_gym.support.markdown import frame_table
from studies.agents.study import BASELINE
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
LANES = 256
CASES: dict[str, dict[str, Any]] = {
    "increment": {"action": "increment"},
    "correction": {"action": "correction", "baseline": BASELINE},
}
"""Options of the training."""


class Stopwatch:
    """An environment of Stable-Baselines3 and the time that its steps have taken.

    Parameters
    ----------
    env
        A ``VecEnv``.

    Attributes
    ----------
    seconds
        In :meth:`step` so far.
    """

    def __init__(self, env: Any) -> None:
        self.seconds = 0.0
        self._step = env.step
        env.step = self.step

    def step(self, actions: Any) -> Any:
        """Step as the environment does."""
        began = time.perf_counter()
        found = self._step(actions)
        self.seconds += time.perf_counter() - began
        return found


def measure(case: str, lanes: int, updates: int, seed: int = 0) -> dict[str, Any]:
    """Train for some updates after a first one, which compiles."""
    from stable_baselines3 import PPO

    from baselines.learned.folder import Run
    from baselines.learned.stable_baselines import StableBaselinesLearner
    from baselines.learned.training import Options

    run = Run.open(Options(lanes=lanes, seed=seed, **CASES[case]), "ppo", PPO)
    learner = StableBaselinesLearner(run)
    model, env = learner.model, learner.env
    model.learn(lanes * model.n_steps)  # one update: kernels are loaded
    watch = Stopwatch(env)
    began, before = time.perf_counter(), model.num_timesteps
    model.learn(updates * lanes * model.n_steps, reset_num_timesteps=False)
    seconds = time.perf_counter() - began
    return {
        "case": case,
        "lanes": lanes,
        "steps": model.num_timesteps - before,
        "seconds": seconds,
        "environment_s": watch.seconds,
        "share_percent": 100.0 * watch.seconds / seconds,
    }


def as_markdown(table: pd.DataFrame) -> str:
    """Return the table with what was measured and how."""
    return (
        "# What PPO waits for its environment\n\n"
        "Written by `python -m studies.training_share`: PPO as `rdpi train ppo` runs it, one thread, "
        "on the four plants of a training side by side; `environment_s` is the time in `step` of the "
        "`VecEnv`, adapter, history and scaling included.\n\n"
        f"{frame_table(table)}\n"
    )


def _files(chosen: Namespace) -> Files:
    table = pd.DataFrame([measure(case, chosen.lanes, chosen.updates) for case in CASES])
    return {"training_share.csv": table, "training_share.md": as_markdown(table)}


main = Study(
    "training_share", __doc__, _files, RESULTS,
    numbers=(("--lanes", LANES, "plants side by side"), ("--updates", 10, "that are timed")),
    csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
