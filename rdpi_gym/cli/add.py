"""`rdpi add`: one effect added to a model, everything refitted, the error before and after."""

from __future__ import annotations

from functools import partial
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
from rdpi_gym.cli.laboratory import Work, candidates
from rdpi_gym.cli.options import JobsOption, OutOption, SeedOption, model_option


def add(
    effect: Annotated[
        str,
        typer.Argument(
            metavar="EFFECT",
            help="Name of an effect, see `rdpi effects`; module:Class is one of your own.",
            show_default=False,
        ),
    ],
    data: DataArgument,
    model: Annotated[
        str,
        model_option(
            "A plant file, as `rdpi fit` writes it, or a plant's name; its effects are kept."
        ),
    ],
    out: OutOption = Path("results/add"),
    seed: SeedOption = 0,
    jobs: JobsOption = -1,
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    sampling_time: SamplingTimeOption = None,
    validate: ValidateOption = None,
    skip: SkipOption = None,
) -> None:
    """Add an effect to a model, refit everything, and show the error before and after.

    Writes model.json, add.json and the page report.html.
    """
    from rdpi_gym.diagnosis.search.discover import add_effect
    from rdpi_gym.plant.effects import load_effect

    options = data_options(columns, units, sampling_time, validate, skip)
    kind = load_effect(effect)
    catalogue = candidates([effect] if ":" in effect else None)
    Work(data, options, model, out, jobs, seed, catalogue).carry_out(
        partial(add_effect, kind=kind), "add.json", f"{kind.name} added"
    )
