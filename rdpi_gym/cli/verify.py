"""`rdpi verify`: whether exported C does what Python does."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import SeedOption
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar


def verify(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", show_default=False, help="What rdpi export c wrote. Its code is run."
        ),
    ],
    records: Annotated[int, typer.Option("--records", min=1, help="Random records.")] = 1000,
    samples: Annotated[int, typer.Option("--samples", min=1, help="Samples of each.")] = 1000,
    seed: SeedOption = 0,
) -> None:
    """Compile an exported folder, run its vectors and random records, and compare with Python."""
    with progress_bar() as show:
        found = rg.verify(folder, records=records, samples=samples, seed=seed, progress=show)
    print(found)
    if not found.passed:
        failed = next(row for row in found.rows if not row.passed)
        raise InputError(
            f"{folder} is not what Python is: {failed.what} in {failed.precision} differ by "
            f"{failed.largest:.2g}, {failed.allowed:.2g} are allowed; export it anew"
        )
