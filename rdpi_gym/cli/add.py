"""`rdpi add`: one effect added to a model, everything refitted, the error before and after."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.laboratory import carry_out
from rdpi_gym.cli.options import DataArgument, OutOption
from rdpi_gym.face.options import DataOptions, SearchOptions


def add(
    effect: Annotated[
        str,
        typer.Argument(
            metavar="EFFECT",
            help="Name of an effect, see `rdpi effects`; unknown is a free block that the records "
            "teach, and module:Class an effect of your own.",
            show_default=False,
        ),
    ],
    data: DataArgument,
    search: SearchOptions,
    reading: DataOptions,
    out: OutOption = Path("results/add"),
) -> None:
    """Add an effect to a model, refit everything, and show the error before and after.

    Writes model.json, add.json and the page report.html.
    """
    carry_out(partial(rg.add, effect), data, reading, search, out, "add.json")
