"""`rdpi score`: scores a submission, on plants that it need not have seen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption
from rdpi_gym.cli.task_scores import JobsOption, SeedFileOption, print_scores
from rdpi_gym.support.progress import progress_bar


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
