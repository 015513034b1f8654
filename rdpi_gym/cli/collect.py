"""`rdpi collect`: a dataset of episodes for offline learning, in Minari's format."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption, words
from rdpi_gym.support.progress import progress_bar


class Action(StrEnum):
    """How the environment reads actions."""

    command = "command"
    increment = "increment"


def collect(
    task: Annotated[
        str, typer.Option("--task", metavar="NAME", help="Short name or id of a task.")
    ] = "Stage",
    controllers: Annotated[
        str,
        typer.Option(
            "--controllers", metavar="NAME,...", help="Each drives an equal share of the episodes."
        ),
    ] = "true-plant-horizon,pi-preview,adaptive-feedforward,random",
    episodes: Annotated[int, typer.Option("--episodes", help="How many in all.")] = 40,
    out: OutOption = Path("results/dataset"),
    steps: Annotated[
        int | None, typer.Option("--steps", help="Of an episode; else the task's, 2500.")
    ] = None,
    seed: SeedOption = 0,
    action: Annotated[
        Action, typer.Option("--action", metavar="command|increment", help="What an action is.")
    ] = Action.command,
) -> None:
    """Write episodes of a task's training draws, driven by controllers, for offline learning.

    Minari loads them; true-plant-horizon knows the true plant, random knows nothing.
    """
    with progress_bar() as show:
        collection = rg.collect(
            task, words(controllers) or [], episodes, out,
            steps=steps, seed=seed, action=action.value, progress=show,
        )  # fmt: skip
    print(collection)
