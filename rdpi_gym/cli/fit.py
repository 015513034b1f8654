"""`rdpi fit`: identifies the RDPI model, or another kind of hysteresis, from a measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import DataArgument, OutOption, SeedOption
from rdpi_gym.cli.tables import print_table
from rdpi_gym.face.options import DataOptions
from rdpi_gym.support.progress import progress_bar

_PLAYS = 10


def fit(
    data: DataArgument,
    reading: DataOptions,
    out: OutOption = Path("results/fit"),
    plays: Annotated[
        int, typer.Option("--plays", "-n", min=1, help="Number of play operators.")
    ] = _PLAYS,
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
    core: Annotated[
        str,
        typer.Option(
            "--core",
            help="Kind of hysteresis: rdpi, stop, preisach, ...; auto fits them all and chooses.",
        ),
    ] = "rdpi",
    seed: SeedOption = 0,  # accepted by every command; nothing is drawn at random here
) -> None:
    """Identify the RDPI model from a measurement, by Equations 9 and 10, or another kind of hysteresis.

    Writes model.json: the plant, its standard errors, and what the data do not determine.
    """
    if core != "rdpi":
        _fit_core(data, reading, core, out, plays != _PLAYS or free_memory or rate_bandwidth)
        return
    with progress_bar() as show:
        show("reading", 0, 0)
        records = rg.load(data, **vars(reading))
        model = rg.fit(
            records,
            plays,
            rate_bandwidth_hz=rate_bandwidth,
            free_memory=free_memory,
            progress=show,
        )
        path = model.plant.save(out / "model.json")
    print(model, records.describe(), sep="\n\n")
    print_table(model.overview())
    print(path)


def _fit_core(
    data: Path, reading: DataOptions, core: str, out: Path, of_the_rdpi_model: object
) -> None:
    if of_the_rdpi_model:
        raise rg.InputError(
            f"--plays, --free-memory and --rate-bandwidth belong to the core rdpi; leave them out with --core {core}"
        )
    with progress_bar() as show:
        show("reading", 0, 0)
        records = rg.load(data, **vars(reading))
        model = (
            rg.choose_kind(records, progress=show)
            if core == "auto"
            else rg.fit_core(records, core, progress=show)
        )
        path = model.plant.save(out / "model.json")
    print(model, records.describe(), sep="\n\n")
    print_table(model.overview())
    print(path)
