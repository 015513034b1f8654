"""The students of other seeds beside the one that ships: how much of its score is luck.

    python -m studies.student_seeds

Each is taught as the shipped one was, from another seed, and scored on the same 100 plants of its
task beside the best controller that is not learned. A training takes some minutes of a core; an
interrupted one goes on.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from baselines.learned.imitation.options import Options as Teaching
from baselines.learned.train_imitation import train
from rdpi_gym.face.tasks import score_tasks
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import progress_bar
from studies.tables import keep_table

RESULTS = Path(__file__).parent / "results" / "agents"
RUNS = Path("results/student-seeds")
TASKS = ("Stage", "Resonance")
RIVAL = "adaptive-dual-loop"
TIMESTEPS = 28_800_000


def measure(task: str, seeds: int, plants: int, runs: Path) -> pd.DataFrame:
    """Teach the students of a task and score them.

    Parameters
    ----------
    task
        Short name.
    seeds
        How many; seed 0 is the one that ships.
    plants
        Test draws.
    runs
        Folder of the trainings.

    Returns
    -------
    DataFrame
        One row a student and one of the rival: mean of the middle half and 90th percentile of the
        error (%), plants on which it failed (%), error over the rival's.
    """
    policies = {f"seed 0 (imitation-{task.lower()})": f"learned:imitation-{task.lower()}"}
    for seed in range(1, seeds):
        taught = Teaching(
            out=runs / f"{task}-{seed}", task=task, timesteps=TIMESTEPS, seed=seed, lanes=96
        )
        with progress_bar() as show:
            policies[f"seed {seed}"] = f"learned:{train(taught, show)}"
    scores = score_tasks([*policies.values(), RIVAL], [task], plants, jobs=1)
    found = {str(row["controller"]): row for row in scores.ranking(task).to_dict("records")}
    rival = float(found[RIVAL]["iqm_percent"])
    rows = []
    for label, name in {**policies, RIVAL: RIVAL}.items():
        row = found[name]
        rows.append(
            {
                "task": task,
                "student": label,
                "iqm_percent": row["iqm_percent"],
                "p90_percent": row["p90_percent"],
                "failed_percent": row["failed"],
                "over_rival": float(row["iqm_percent"]) / rival,
            }
        )
    return pd.DataFrame(rows)


def as_markdown(table: pd.DataFrame, seeds: int, plants: int) -> str:
    """Return the table, with what it says first."""
    students = table[table["student"] != RIVAL]
    said = "; ".join(
        f"{task} {own['over_rival'].min():.2f} to {own['over_rival'].max():.2f}"
        for task, own in students.groupby("task", sort=False)
    )
    return (
        f"# Students of {seeds} seeds\n\n"
        f"Error over that of `{RIVAL}`, the best controller that is not learned: {said}.\n\n"
        f"Written by `python -m studies.student_seeds --seeds {seeds} --plants {plants}`: trainings of {TIMESTEPS:,} steps, "
        f"scored on {plants} test draws of their task.\n\n{frame_table(table)}\n"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Teach, score, print the table and write it."""
    options = Options("student_seeds", __doc__, out=RESULTS)
    options.add_number("--seeds", 5, "students of each task, the shipped one among them", least=2)
    options.add_number("--plants", 100, "test draws of a task")
    options.add_folder("--runs", RUNS, "folder of the trainings")
    return options.run(arguments, _measure_all)


def _measure_all(chosen: Namespace) -> None:
    if chosen.runs.exists() and not chosen.runs.is_dir():
        raise InputError(f"{chosen.runs} is no folder; give one for the trainings")
    table = pd.concat([measure(task, chosen.seeds, chosen.plants, chosen.runs) for task in TASKS])
    text = as_markdown(table, chosen.seeds, chosen.plants)
    keep_table(chosen.out, "student_seeds", table, text)


if __name__ == "__main__":
    sys.exit(main())
