"""`rdpi diagnose`: which effect a model misses."""

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
from rdpi_gym.cli.laboratory import (
    CHECKPOINT,
    EffectOption,
    JobsOption,
    candidates,
    check_jobs,
    print_ranking,
    print_verdict,
    progress_bar,
)
from rdpi_gym.cli.options import OutOption, SeedOption


def diagnose(
    data: DataArgument,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="M",
            help="A plant file, as `rdpi fit` writes it, or a plant's name; its effects are kept. "
            "Without it the bare model is fitted.",
            show_default=False,
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
    from rdpi_gym.diagnosis.discover import diagnose as diagnose_data
    from rdpi_gym.files import write_json
    from rdpi_gym.measurement import load
    from rdpi_gym.plant import find_plant
    from rdpi_gym.report.discovery_page import write_discovery_page

    check_jobs(jobs)
    options = data_options(columns, units, sampling_time, validate, skip)
    catalogue = candidates(effect)
    given = None if model is None else find_plant(model)
    dataset = load(data, options)
    with progress_bar() as show:
        result = diagnose_data(
            dataset,
            given,
            catalogue=catalogue,
            jobs=jobs,
            seed=seed,
            progress=show,
            checkpoint=out / CHECKPOINT,
        )
        numbers = write_json(out / "diagnosis.json", result.to_dict())
        show("drawing", 0, 0)
        page = write_discovery_page(
            out / "report.html", f"What is missing: {dataset.title}", result, catalogue
        )
    print(dataset.describe())
    print_ranking(result.candidates, result.base)
    print_verdict(result)
    print(f"\n{numbers}\n{page}")
