"""`rdpi discover`: from measured records to a model that explains them, or a plain no."""

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


def discover(
    data: DataArgument,
    model: Annotated[
        str | None,
        model_option(
            "A plant file or a plant's name to start from; its effects are kept. Without it "
            "the bare model is fitted."
        ),
    ] = None,
    out: OutOption = Path("results/discover"),
    seed: SeedOption = 0,
    jobs: JobsOption = -1,
    effect: EffectOption = None,
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    sampling_time: SamplingTimeOption = None,
    validate: ValidateOption = None,
    skip: SkipOption = None,
) -> None:
    """Fit, then find and add missing effects until nothing more is earned.

    Writes model.json, discovery.json and the page report.html; an interrupted run continues.
    """
    from rdpi_gym.diagnosis.search.discover import discover as discover_effects

    options = data_options(columns, units, sampling_time, validate, skip)
    catalogue = candidates(effect)
    Work(data, options, model, out, jobs, seed, catalogue).carry_out(
        partial(discover_effects, catalogue=catalogue),
        "discovery.json",
        "Missing effects",
    )
