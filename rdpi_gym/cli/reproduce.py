"""`rdpi reproduce`: the paper's figures and numbers, ours beside the paper's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption
from rdpi_gym.support.progress import progress_bar


def reproduce(
    out: OutOption = Path("results/paper"),
    seed: SeedOption = 0,
    realisations: Annotated[
        int,
        typer.Option(
            min=2, help="Realisations of each compensator whose own rate may make it chatter."
        ),
    ] = 16,
) -> None:
    """Recompute the paper's figures and numbers, ours beside the paper's.

    Writes paper.md with its figures, paper.csv, sweep.csv and implementation.csv.
    """
    with progress_bar() as show:
        results = rg.reproduce(seed=seed, realisations=realisations, progress=show)
        show("figures", 0, 0)
        page = results.write(out)
    print(results)
    rows = len(results.to_dataframe())
    print(f"{page}: the paper's figures and numbers beside ours; {rows} rows in paper.csv")
