"""`rdpi discover`: from measured records to a model that explains them, or a plain no."""

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
    print_staircase,
    print_verdict,
    progress_bar,
)
from rdpi_gym.cli.options import OutOption, SeedOption


def discover(
    data: DataArgument,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="M",
            help="A plant file or a plant's name to start from; its effects are kept. Without it "
            "the bare model is fitted.",
            show_default=False,
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
    from rdpi_gym.diagnosis.discover import discover as discover_effects
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
        result = discover_effects(
            dataset,
            given,
            catalogue=catalogue,
            jobs=jobs,
            seed=seed,
            progress=show,
            checkpoint=out / CHECKPOINT,
        )
        plant = result.model.save(out / "model.json")
        numbers = write_json(out / "discovery.json", result.to_dict())
        show("drawing", 0, 0)
        page = write_discovery_page(
            out / "report.html", f"Missing effects: {dataset.title}", result, catalogue
        )
    print(dataset.describe())
    print_staircase(result)
    print_verdict(result)
    for note in result.notes:
        print(note)
    print(f"\n{plant}\n{numbers}\n{page}")
