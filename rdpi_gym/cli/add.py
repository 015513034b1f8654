"""`rdpi add`: one effect added to a model, everything refitted, the error before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    JobsOption,
    candidates,
    check_jobs,
    print_staircase,
    print_verdict,
    progress_bar,
)
from rdpi_gym.cli.options import OutOption, SeedOption

if TYPE_CHECKING:
    from rdpi_gym.diagnosis.results import Discovery

FORMAT, VERSION = "rdpi-add", 1


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
        typer.Option(
            "--model",
            metavar="M",
            help="A plant file, as `rdpi fit` writes it, or a plant's name; its effects are kept.",
            show_default=False,
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
    from rdpi_gym.diagnosis.discover import add_effect
    from rdpi_gym.files import write_json
    from rdpi_gym.measurement import load
    from rdpi_gym.plant import find_plant
    from rdpi_gym.plant.effects import load_effect
    from rdpi_gym.report.discovery_page import write_discovery_page

    check_jobs(jobs)
    options = data_options(columns, units, sampling_time, validate, skip)
    kind = load_effect(effect)
    catalogue = candidates([effect] if ":" in effect else None)
    given = find_plant(model)
    dataset = load(data, options)
    with progress_bar() as show:
        result = add_effect(
            dataset, given, kind, jobs=jobs, seed=seed, progress=show, checkpoint=out / CHECKPOINT
        )
        plant = result.model.save(out / "model.json")
        numbers = write_json(out / "add.json", document(result))
        show("drawing", 0, 0)
        page = write_discovery_page(
            out / "report.html", f"{kind.name} added: {dataset.title}", result, catalogue
        )
    print(dataset.describe())
    print_staircase(result)
    print_verdict(result)
    for note in result.notes:
        print(note)
    print(f"\n{plant}\n{numbers}\n{page}")


def document(result: Discovery) -> dict[str, Any]:
    """Return the content of ``add.json``: the step, with the errors before and after it.

    Parameters
    ----------
    result
        With the one step that was added. `before` is the model as it was, refitted like `after`,
        so that the difference is the effect's alone; `given` is it as given.
    """
    written = result.to_dict()
    (step,) = written.pop("steps")
    errors = {key: step.pop(key) for key in result.steps[0].errors.to_dict()}
    before = written.pop("base")
    return {
        **written,
        "format": FORMAT,
        "version": VERSION,
        "effect": step.pop("effect"),
        "before": before,
        "after": errors,
        **step,
    }
