"""Whether a long training with the native PPO ends as well as it was at its best.

    python -m studies.training_stability --seeds 5 --timesteps 20000000

Each seed is one training of ``rdpi train native-ppo`` with increments of the command, kept in
``--runs``: the same command goes on with those that were interrupted, exactly, and reads those that
are finished. What is compared are evaluations on 24 held-out plants and references.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

import pandas as pd

from rdpi_gym.support.command_line import Options
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import progress_bar
from studies.agents.training import BASELINE
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "training_stability"
GOAL = 1.2
"""Largest ratio of the last evaluation's error to the best one's."""


def row_of(seed: int, curve: pd.DataFrame) -> dict[str, Any]:
    """Return what a learning curve, ``training.csv``, says of a training's end."""
    last, best = curve.iloc[-1], curve.iloc[int(curve["rmse_um"].to_numpy().argmin())]
    return {
        "seed": seed,
        "timesteps": int(last["timesteps"]),
        "seconds": float(last["seconds"]),
        "best_at": int(best["timesteps"]),
        "best_rmse_um": float(best["rmse_um"]),
        "last_rmse_um": float(last["rmse_um"]),
        "last_over_best": float(last["rmse_um"] / best["rmse_um"]),
        "compensator_rmse_um": float(last["compensator_rmse_um"]),
        "command_variation_V_s": float(last["command_variation_V_s"]),
    }


def as_markdown(table: pd.DataFrame, command: str) -> str:
    """Return the answer with its number first, then the table."""
    worst = float(table["last_over_best"].max())
    held = "No seed" if worst <= GOAL else "Not every seed"
    ends = f"ends above {GOAL} times" if worst <= GOAL else f"ends within {GOAL} times"
    return (
        f"# How trainings with the native PPO end\n\n"
        f"{held} of {len(table)} {ends} its best evaluation: the last error is {worst:.3g} times the "
        f"best at most, after {int(table['timesteps'].min()):,} steps.\n\n"
        f"Written by `{command}`. Errors are means over 24 held-out plants with references of their "
        "own; `seconds` are of the clock, evaluations and checkpoints among them, on a machine that "
        "may have had other work.\n\n"
        f"{frame_table(table)}\n"
    )


def _run(chosen: Namespace) -> Files:
    from baselines.learned import training

    native_ppo = training.trainer("native-ppo")

    rows, curves = [], []
    with progress_bar() as show:
        for seed in range(chosen.seeds):
            folder = chosen.runs / f"seed-{seed}"
            asked = native_ppo.Options(
                out=folder, seed=seed, timesteps=chosen.timesteps, threads=chosen.threads,
                action="increment", baseline=BASELINE,
            )  # fmt: skip
            native_ppo.train(asked, show)
            curve = pd.read_csv(folder / "training.csv")
            rows.append(row_of(seed, curve))
            curves.append(
                curve[["timesteps", "rmse_um", "command_variation_V_s"]].assign(seed=seed)
            )
    table = pd.DataFrame(rows)
    command = (
        f"python -m studies.training_stability --seeds {chosen.seeds} "
        f"--timesteps {chosen.timesteps} --threads {chosen.threads}"
    )
    return {
        "seeds.csv": table,
        "curves.csv": pd.concat(curves),
        "stability.md": as_markdown(table, command),
    }


def _more(options: Options) -> None:
    options.add_folder("--runs", Path("results/training-stability"), "folder of the trainings")


main = Study(
    "training_stability", __doc__, _run, RESULTS,
    numbers=(
        ("--seeds", 5, "that are trained, from 0 on"),
        ("--timesteps", 20_000_000, "of a training"),
        ("--threads", 1, "of a training"),
    ),
    more=_more, csv="%.5g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
