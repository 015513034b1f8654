"""Options that every subcommand shares."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

OutOption: TypeAlias = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder that the results are written to.")
]
SeedOption: TypeAlias = Annotated[
    int, typer.Option("--seed", min=0, help="Seed of every random draw.")
]
