"""`rdpi tune`: the settings of a controller, found on training draws of tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption, words
from rdpi_gym.support.progress import progress_bar


def tune(
    controller: Annotated[str, typer.Argument(metavar="CONTROLLER", show_default=False)],
    task: Annotated[
        str, typer.Option("--task", metavar="NAME,...", help="Tasks, one after the other.")
    ] = "Stage",
    out: OutOption = Path("results/tune"),
    trials: Annotated[int, typer.Option("--trials", help="Settings that are tried.")] = 40,
    plants: Annotated[
        int, typer.Option("--plants", help="Training plants, each with every reference.")
    ] = 16,
    seed: SeedOption = 0,
) -> None:
    """Find the settings of a controller on training draws of a task, and score them on others.

    What its loop is certain of is printed first. The same command continues an interrupted search.
    """
    asked = words(task) or [task]
    for each in asked:
        print(rg.certificate(controller, each), flush=True)
    for each in asked:
        with progress_bar() as show:
            found = rg.tune(
                controller, each, out, trials=trials, seed=seed, plants=plants, progress=show
            )
        print(found, flush=True)
