"""The students of five seeds on each task: how much of a score is luck, and whether trainings hold what they reach.

    python -m studies.student_seeds

Each corrects ``adaptive-dual-loop``, beside which it is scored on the same 100 plants of its task,
Creep's on Bare too. Those that ship correct ``adaptive-core-bank``. A training takes some minutes of
a core; an interrupted one goes on.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from pathlib import Path

import pandas as pd

from baselines.learned.imitation.rounds import Options as Teaching
from baselines.learned.imitation.rounds import train
from baselines.learned.options import CURVE
from rdpi_gym.face.tasks import score_tasks
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import progress_bar
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "agents"
RUNS = Path("results/student-seeds")
RIVAL = "adaptive-dual-loop"
TAUGHT = (
    ("Stage", 28_800_000),
    ("Resonance", 28_800_000),
    ("Creep", 9_600_000),
    ("Lag", 9_600_000),
)
"""Tasks, and for how many steps of all plants together students are taught on each."""
ALSO = {"Creep": ("Bare",)}
"""Further tasks on which the students of a task are scored: none is taught on Bare, where Creep's are the best."""
COLUMNS = (
    "iqm_percent", "iqm_low", "iqm_high", "p90_percent", "failed", "command_variation_V_s"
)  # fmt: skip


def measure(task: str, timesteps: int, seeds: int, plants: int, runs: Path) -> pd.DataFrame:
    """Teach the students of a task and score them, there and on the tasks of `ALSO`."""
    policies, held = {}, {}
    for seed in range(seeds):
        taught = Teaching(
            out=runs / f"{task}-{seed}", task=task, baseline=RIVAL, timesteps=timesteps, seed=seed
        )
        with progress_bar() as show:
            policies[f"seed {seed}"] = f"learned:{train(taught, show)}"
        errors = pd.read_csv(taught.out / CURVE)["rmse_percent"]
        held[f"seed {seed}"] = float(errors.iloc[-1] / errors.min())
    scored = [task, *ALSO.get(task, ())]
    scores = score_tasks([*policies.values(), RIVAL], scored, plants, jobs=1)
    rows = []
    for other in scored:
        found = {str(row["controller"]): row for row in scores.ranking(other).to_dict("records")}
        rival = float(found[RIVAL]["iqm_percent"])
        rows += [
            {
                "task": other,
                "taught_on": task if label in policies else None,
                "student": label,
                **{column: found[name][column] for column in COLUMNS},
                "over_rival": float(found[name]["iqm_percent"]) / rival,
                "last_over_best": held.get(label),
            }
            for label, name in {**policies, RIVAL: RIVAL}.items()
        ]
    return pd.DataFrame(rows)


def as_markdown(table: pd.DataFrame, seeds: int, plants: int) -> str:
    """Return the table, with what it says first."""
    students = table[table["student"] != RIVAL]
    said = "; ".join(
        f"{task} {own['over_rival'].min():.2f} to {own['over_rival'].max():.2f}"
        for task, own in students.groupby("task", sort=False)
    )
    steps = ", ".join(f"{task} {timesteps:,}" for task, timesteps in TAUGHT)
    return (
        f"# Students of {seeds} seeds\n\n"
        f"Error over that of `{RIVAL}`, which they correct: {said}. No training ends above "
        f"{students['last_over_best'].max():.2f} times its least error on the validation draws.\n\n"
        f"Written by `python -m studies.student_seeds --seeds {seeds} --plants {plants}`: trainings of so many steps, {steps}; "
        f"scored on {plants} test draws of each task. The students that ship correct `adaptive-core-bank` and have seed 0.\n\n{frame_table(table)}\n"
    )


def _measure_all(chosen: Namespace) -> Files:
    if chosen.runs.exists() and not chosen.runs.is_dir():
        raise InputError(f"{chosen.runs} is no folder; give one for the trainings")
    table = pd.concat(
        [
            measure(task, timesteps, chosen.seeds, chosen.plants, chosen.runs)
            for task, timesteps in TAUGHT
        ]
    )
    text = as_markdown(table, chosen.seeds, chosen.plants)
    return {"student_seeds.csv": table, "student_seeds.md": text}


def _more(options: Options) -> None:
    options.add_folder("--runs", RUNS, "folder of the trainings")


main = Study(
    "student_seeds", __doc__, _measure_all, RESULTS,
    numbers=(("--seeds", 5, "students of each task"), ("--plants", 100, "test draws of a task")),
    more=_more, csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
