"""`rdpi compare`: model against measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import DataArgument, OutOption
from rdpi_gym.cli.tables import print_table
from rdpi_gym.face.options import DataOptions
from rdpi_gym.support.files import write_json
from rdpi_gym.support.progress import progress_bar


def compare(
    data: DataArgument,
    reading: DataOptions,
    model: Annotated[
        list[str],
        typer.Option(
            "--model",
            metavar="M",
            help="A plant file, as `rdpi fit` writes it, or a plant's name; given again, models are "
            "shown beside each other.",
            show_default=False,
        ),
    ],
    out: OutOption = Path("results/compare"),
) -> None:
    """Compare models with a measurement: the error by record, frequency, amplitude, direction, time.

    Tests of the data that need no model stand beside it. Several models: which is nearest where,
    with all traces in one figure. Writes compare.json and report.html.
    """
    with progress_bar() as show:
        show("reading", 0, 3)
        records = rg.load(data, **vars(reading))
        show("comparing", 1, 3)
        result = rg.compare(records, *model)
        numbers = write_json(out / "compare.json", result.to_dict())
        show("drawing", 2, 3)
        page = result.page(out / "report.html")
    for finding in result.findings.values():
        print(f"- {finding}")
    print_table(result.overview())
    one = result.comparisons[0] if isinstance(result, rg.ModelComparison) else result
    noticed = [check for check in one.checks if check.zone == "yes"]
    unclear = sum(check.zone == "cannot tell" for check in one.checks)
    print(
        f"Without a model: {len(noticed)} of {len(one.checks)} tests found something, "
        f"{unclear} cannot tell."
    )
    for check in noticed:
        print(f"- {check.sentence}")
    print("", records.describe(), "", numbers, page, sep="\n")
