"""`rdpi compare`: model against measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rdpi_gym.cli.data_options import (
    ColumnsOption,
    DataArgument,
    SamplingTimeOption,
    SkipOption,
    UnitsOption,
    ValidateOption,
    data_options,
)
from rdpi_gym.cli.options import OutOption
from rdpi_gym.support.progress import progress_bar


def compare(
    data: DataArgument,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="M",
            help="A plant file, as `rdpi fit` writes it, or a plant's name.",
            show_default=False,
        ),
    ],
    out: OutOption = Path("results/compare"),
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    sampling_time: SamplingTimeOption = None,
    validate: ValidateOption = None,
    skip: SkipOption = None,
) -> None:
    """Compare a model with a measurement: the error by record, frequency, amplitude, direction, time.

    Tests of the data that need no model stand beside it. Writes compare.json and report.html.
    """
    from rdpi_gym.diagnosis import compare as compare_with
    from rdpi_gym.measurement import load
    from rdpi_gym.plant import find_plant
    from rdpi_gym.report.comparison.page import write_compare_page
    from rdpi_gym.support.files import write_json

    options = data_options(columns, units, sampling_time, validate, skip)
    with progress_bar() as show:
        show("reading", 0, 3)
        plant = find_plant(model)
        dataset = load(data, options)
        show("comparing", 1, 3)
        result = compare_with(dataset, plant)
        numbers = write_json(out / "compare.json", result.to_dict())
        show("drawing", 2, 3)
        page = write_compare_page(out / "report.html", result)

    print(dataset.describe())
    print()
    print(
        result.records[
            ["name", "role", "rmse_um", "nrmse_percent", "systematic_percent", "max_um"]
        ].to_string(index=False, float_format=lambda value: f"{value:.4g}")
    )
    print()
    for finding in result.findings.values():
        print(f"- {finding}")
    noticed = [check for check in result.checks if check.zone == "yes"]
    unclear = sum(check.zone == "cannot tell" for check in result.checks)
    print(
        f"\nWithout a model: {len(noticed)} of {len(result.checks)} tests found something, "
        f"{unclear} cannot tell."
    )
    for check in noticed:
        print(f"- {check.sentence}")
    print(f"\n{numbers}\n{page}")
