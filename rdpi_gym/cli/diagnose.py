"""`rdpi diagnose`: which effect a model misses."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

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
from rdpi_gym.cli.options import EffectOption, JobsOption, OutOption, SeedOption, model_option


def diagnose(
    data: DataArgument,
    model: Annotated[
        str | None,
        model_option(
            "A plant file, as `rdpi fit` writes it, or a plant's name; its effects are kept. "
            "Without it the bare model is fitted."
        ),
    ] = None,
    out: OutOption = Path("results/diagnose"),
    seed: SeedOption = 0,
    jobs: JobsOption = -1,
    effect: EffectOption = None,
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    sampling_time: SamplingTimeOption = None,
    validate: ValidateOption = None,
    skip: SkipOption = None,
) -> None:
    """Rank the effects that a model may miss, each refitted with it, by the error on validation records.

    Writes diagnosis.json and the page report.html; an interrupted run continues.
    """
    from rdpi_gym.diagnosis.search.discover import diagnose as diagnose_data

    options = data_options(columns, units, sampling_time, validate, skip)
    catalogue = candidates(effect)
    Work(data, options, model, out, jobs, seed, catalogue).carry_out(
        partial(diagnose_data, catalogue=catalogue),
        "diagnosis.json",
        "What is missing",
    )
