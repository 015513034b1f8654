"""`rdpi fit`: identifies the RDPI model from a measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import DataArgument, OutOption, SeedOption
from rdpi_gym.cli.tables import print_table
from rdpi_gym.face.options import DataOptions
from rdpi_gym.support.progress import progress_bar


def fit(
    data: DataArgument,
    reading: DataOptions,
    out: OutOption = Path("results/fit"),
    plays: Annotated[
        int, typer.Option("--plays", "-n", min=1, help="Number of play operators.")
    ] = 10,
    free_memory: Annotated[
        bool,
        typer.Option("--free-memory", help="Also find the extremum that each record came from."),
    ] = False,
    rate_bandwidth: Annotated[
        float | None,
        typer.Option(
            "--rate-bandwidth",
            metavar="HZ",
            help="Cut-off of the low-pass on the model's rate; by default the literal rate.",
        ),
    ] = None,
    seed: SeedOption = 0,  # accepted by every command; nothing is drawn at random here
) -> None:
    """Identify the RDPI model from a measurement, by Equations 9 and 10.

    Writes model.json: the plant, its standard errors, and what the data do not determine.
    """
    with progress_bar() as show:
        show("reading", 0, 0)
        records = rg.load(data, **vars(reading))
        model = rg.fit(
            records,
            plays,
            rate_bandwidth_hz=rate_bandwidth,
            free_memory=free_memory,
            progress=show,
        )
        path = model.plant.save(out / "model.json")
    print(model, records.describe(), sep="\n\n")
    print_table(model.overview())
    print(path)
