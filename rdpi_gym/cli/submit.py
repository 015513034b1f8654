"""`rdpi submit`: a folder with a controller, its hash and its rows, for a leaderboard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, words
from rdpi_gym.cli.task_scores import (
    DrawsOption,
    JobsOption,
    TasksOption,
    print_scores,
    refuse_failures,
)
from rdpi_gym.support.progress import progress_bar


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
