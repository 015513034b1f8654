"""`rdpi submit`, `rdpi score`, and what `rdpi bench --task` shares with them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, words
from rdpi_gym.cli.tables import print_table
from rdpi_gym.support.command_line import check_jobs
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar

TASKS_HELP = "Short names or ids of tasks, for example Stage,Load; all: every one."
LEGEND = (
    "RMSE in percent of the reference's peak to peak, a plant's mean over its references: 90th "
    "percentile (p90) and mean of the middle half of the plants (IQM), each with its 95 % interval. "
    "Failures decide first, then p90, then IQM; = marks a tie. Over noise: IQM in units of the "
    "sensor's noise."
)

TasksOption: TypeAlias = Annotated[str, typer.Option("--task", metavar="NAME,...", help=TASKS_HELP)]
DrawsOption: TypeAlias = Annotated[
    int | None,
    typer.Option("--draws", min=1, help="Test plants of each task; 20 by default."),
]
SeedFileOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--seed-file",
        metavar="FILE",
        help="A file with the seed of the test plants, one whole number; else the public seed.",
    ),
]
JobsOption: TypeAlias = Annotated[
    int,
    typer.Option("--jobs", help="Worker processes; -1: one for each core.", callback=check_jobs),
]


def print_scores(scores: rg.TaskScores, own: Sequence[str], out: Path) -> None:
    """Print the first of each task, write all tables, and say where they are."""
    page = scores.write(out)
    print(scores.answer)
    for task in scores.tasks:
        print_table(scores.leaders(task, own), f"{task}: {scores.seen}")
    print(LEGEND)
    print(f"{len(scores.rows)} rows, {scores.computed} of them computed now")
    for note in scores.notes:
        print(note)
    print(f"tables: {page}")


def refuse_failures(scores: rg.TaskScores, own: Sequence[str]) -> None:
    """End with an error where a controller that the user gave raised one on every plant.

    Raises
    ------
    InputError
        With the first reason.
    """
    for name in own:
        said = [str(row["failure"]) for row in scores.rows if row["controller"] == name]
        if said and all(reason.startswith(("error", "too slow")) for reason in said):
            raise InputError(f"{name} has no score on any plant; the first row says {said[0]!r}")


def score(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", help="As rdpi submit leaves it; its code is run.", show_default=False
        ),
    ],
    out: OutOption = Path("results/score"),
    seed_file: SeedFileOption = None,
    jobs: JobsOption = -1,
) -> None:
    """Score a submission; with --seed-file on plants that nobody has seen."""
    with progress_bar() as show:
        scores = rg.score_submission(folder, seed_file=seed_file, out=out, jobs=jobs, progress=show)
    print_scores(scores, [], out)


def submit(
    controller: Annotated[
        str,
        typer.Argument(
            metavar="NAME|MODULE:ATTRIBUTE|learned:FOLDER",
            help="A controller: one that ships, one of your own in a single file, or a trained policy.",
            show_default=False,
        ),
    ],
    out: OutOption = Path("results/submission"),
    task: TasksOption = "Stage",
    draws: DrawsOption = None,
    jobs: JobsOption = -1,
) -> None:
    """Score a controller on public plants, and put what a leaderboard needs into a folder."""
    with progress_bar() as show:
        scores = rg.submit(
            controller,
            out,
            words(task) or (),
            **({} if draws is None else {"plants": draws}),
            jobs=jobs,
            progress=show,
        )
    print_scores(scores, [controller], out)
    print(f"submission: {out / 'submission.json'}")
    refuse_failures(scores, [controller])
