"""`rdpi effects`: the catalogue of physical effects."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.tables import print_table
from rdpi_gym.support.command_line import check_folder


def effects(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="One effect in full; module:Class is one of your own.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for effects.json and effects.md; nothing is written without it.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """List the physical effects that a plant can have: equations, parameters, signatures."""
    if out is not None:
        check_folder(out)
    if name is None:
        print_table(rg.effects.table(), lines=True, width=80)
    else:
        first, *rest = rg.effects.describe(name)
        print(first, end="\n\n")
        print_table(rg.effects.parameters(name), lines=True, width=110)
        print(*rest, sep="\n")
    if out is not None:
        print(*rg.effects.write(out, *([] if name is None else [name])), sep="\n")
