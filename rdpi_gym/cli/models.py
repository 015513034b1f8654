"""`rdpi fit`, `rdpi compare`, `rdpi simulate`, `rdpi effects`: models, measurements, the catalogue."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import DataArgument, OutOption, SeedOption, VerboseOption, as_typed, words
from rdpi_gym.cli.tables import print_result, print_table
from rdpi_gym.face.options import DataOptions
from rdpi_gym.support.command import check_folder
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json
from rdpi_gym.support.progress import progress_bar

_PLAYS = 10


def fit(
    data: DataArgument,
    reading: DataOptions,
    out: OutOption = Path("results/fit"),
    plays: Annotated[
        int, typer.Option("--plays", "-n", min=1, help="Number of play operators.")
    ] = _PLAYS,
    free_memory: bool = False,
    rate_bandwidth: float | None = None,
    core: str = "rdpi",
    seed: SeedOption = 0,  # accepted by every command; nothing is drawn at random here
    verbose: VerboseOption = False,
) -> None:
    """Identify the RDPI model from a measurement, by Equations 9 and 10, or another kind of hysteresis.

    Writes model.json: the plant, its standard errors, and what the data do not determine.

    Parameters
    ----------
    free_memory
        Also find the extremum that each record came from.
    rate_bandwidth : HZ
        Cut-off of the low-pass on the model's rate; by default the literal rate.
    core
        Kind of hysteresis: rdpi, stop, preisach, ...; auto fits them all and chooses.
    """
    of_the_rdpi_model = plays != _PLAYS or free_memory or rate_bandwidth
    if core != "rdpi" and of_the_rdpi_model:
        raise rg.InputError(
            f"--plays, --free-memory and --rate-bandwidth belong to the core rdpi; leave them out with --core {core}"
        )
    model: rg.FitResult | rg.CoreFit | rg.KindChoice
    with progress_bar() as show:
        show("reading", 0, 0)
        records = rg.load(data, **vars(reading))
        if core == "rdpi":
            model = rg.fit(
                records,
                plays,
                rate_bandwidth_hz=rate_bandwidth,
                free_memory=free_memory,
                progress=show,
            )
        elif core == "auto":
            model = rg.choose_kind(records, progress=show)
        else:
            model = rg.fit_core(records, core, progress=show)
        path = model.plant.save(out / "model.json")
    print_result(model, records, [path], verbose)


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
    verbose: VerboseOption = False,
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
    print_result(result, records, [numbers, page], verbose, further=_tests(result))


def _tests(result: rg.Comparison | rg.ModelComparison) -> list[str]:
    """Return what the tests without a model found, in lines."""
    one = result.comparisons[0] if isinstance(result, rg.ModelComparison) else result
    noticed = [check for check in one.checks if check.zone == "yes"]
    unclear = sum(check.zone == "cannot tell" for check in one.checks)
    return [
        f"Without a model: {len(noticed)} of {len(one.checks)} tests found something, "
        f"{unclear} cannot tell.",
        "",
    ]


def simulate(
    model: str = "P10",
    out: OutOption = Path("results/simulate"),
    hide: str | None = None,
    seed: SeedOption = 0,
    noise_um: float = 0.012,
    ts_factor: float = 1.0,
) -> None:
    """Simulate the standard protocol of experiments on a plant, as if it had been measured.

    Writes one CSV file for each record into DIR/data, and what is hidden into DIR/truth.json.

    Parameters
    ----------
    model : M
        A plant file, or a plant's name.
    hide : EFFECT,...|random
        Effects to hide, sized at random so that they show; nothing by default.
    noise_um
        White noise of the sensor (µm rms).
    ts_factor
        Factor on the protocol's sampling times.
    """
    names = words(hide)
    if names == []:  # as a variable of the shell is that was never set
        raise InputError("--hide names no effect; give one, as in creep, or leave it out")
    typed = {"hide": "--hide", "noise_um": "--noise-um", "ts_factor": "--ts-factor"}
    with as_typed(typed), progress_bar() as show:
        data = rg.simulate(
            model,
            "random" if hide == "random" else names,
            seed=seed,
            noise_um=noise_um,
            ts_factor=ts_factor,
            progress=show,
        )
        show("writing", 0, 0)
        folder = data.write(out / "data")
        answer = data.truth.save(out / "truth.json")
    print(data.summary)
    print(f"data: {folder}")
    print(f"{'hidden effects' if hide else 'nothing is hidden'}: {answer}")


def effects(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="One effect in full; module:Class is one of your own.",
            show_default=False,
        ),
    ] = None,
    out: Path | None = None,
) -> None:
    """List the physical effects that a plant can have: equations, parameters, signatures.

    Parameters
    ----------
    out : DIR
        Folder for effects.json and effects.md; nothing is written without it.
    """
    if out is not None:
        check_folder(out)
    if name is None:
        print_table(rg.effects.table(), lines=True, width=80)
    else:
        first, *rest = rg.effects.describe(name)
        print(first, end="\n\n")
        print_table(rg.effects.parameters(name), lines=True, width=110)
        print(*rest, sep="\n")
    if out is not None:
        print(*rg.effects.write(out, *([] if name is None else [name])), sep="\n")


def warm() -> None:
    """Compile every kernel that the commands use, once per installation: for images and CI.

    Kernels are kept beside the package, or in the folder that NUMBA_CACHE_DIR names.
    """
    with progress_bar() as show:
        table = rg.warm(progress=show)
    print_table(table)
    print(f"{table['kernels'].sum()} kernels compiled in {table['compiled_s'].sum():.0f} s")
