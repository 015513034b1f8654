"""`rdpi fit`: identifies the RDPI model from a measurement."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from rdpi_gym.cli.options import OutOption, SeedOption
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.terminal import console

if TYPE_CHECKING:
    from rich.table import Table

    from rdpi_gym.identification import FitResult


def fit(
    data: DataArgument,
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
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    sampling_time: SamplingTimeOption = None,
    validate: ValidateOption = None,
    skip: SkipOption = None,
) -> None:
    """Identify the RDPI model from a measurement, by Equations 9 and 10.

    Writes model.json: the plant, its standard errors, and what the data do not determine.
    """
    from rdpi_gym.identification import fit as identify
    from rdpi_gym.measurement import load

    options = data_options(columns, units, sampling_time, validate, skip)
    with progress_bar() as show:
        show("reading", 0, 0)
        dataset = load(data, options)
        result = identify(
            dataset,
            plays,
            rate_bandwidth_hz=rate_bandwidth,
            free_memory=free_memory,
            progress=show,
        )
        path = result.plant.save(out / "model.json")

    print(dataset.describe())
    print()
    console(width=100).print(_table(result))
    print(f"training error    {result.train_rmse_um:.4g} µm rms")
    if result.validation_rmse_um is not None:
        print(f"validation error  {result.validation_rmse_um:.4g} µm rms, one offset a record free")
    for warning in result.warnings:
        print(f"- {warning}")
    print(f"\n{path}")


def _table(result: FitResult) -> Table:
    from rich.box import SIMPLE
    from rich.table import Table

    from rdpi_gym.identification import interval_95

    table = Table(box=SIMPLE)
    table.add_column("parameter", no_wrap=True)
    for name in ("value", "standard error", "95 % interval"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit")
    intervals = result.intervals_95
    for name, value in result.parameters.items():
        row = _row(value, result.standard_errors[name], intervals[name])
        shown, unit = {"delta1_V": ("δ1", "V"), "delta2_s": ("δ2", "s")}.get(name, (name, "µm/V"))
        table.add_row(shown, *row, unit)
    for name, value in result.offsets_um.items():
        error = result.offset_errors_um[name]
        table.add_row(f"offset of {name}", *_row(value, error, interval_95(value, error)), "µm")
    for name, error in result.extremum_errors_V.items():
        value = result.extrema_V[name]
        table.add_row(f"extremum of {name}", *_row(value, error, interval_95(value, error)), "V")
    return table


def _row(value: float, error: float, interval: tuple[float, float]) -> tuple[str, str, str]:
    if not math.isfinite(error):
        return f"{value:.5g}", "not determined", ""
    return f"{value:.5g}", f"{error:.2g}", f"{interval[0]:.5g} to {interval[1]:.5g}"
