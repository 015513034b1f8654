"""`rdpi simulate`: a measurement-like data set from a plant, with effects hidden in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption, as_typed, words
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar


def simulate(
    model: Annotated[
        str, typer.Option("--model", metavar="M", help="A plant file, or a plant's name.")
    ] = "P10",
    out: OutOption = Path("results/simulate"),
    hide: Annotated[
        str | None,
        typer.Option(
            "--hide",
            metavar="EFFECT,...|random",
            help="Effects to hide, sized at random so that they show; nothing by default.",
        ),
    ] = None,
    seed: SeedOption = 0,
    noise_um: Annotated[
        float, typer.Option("--noise-um", help="White noise of the sensor (µm rms).")
    ] = 0.012,
    ts_factor: Annotated[
        float, typer.Option("--ts-factor", help="Factor on the protocol's sampling times.")
    ] = 1.0,
) -> None:
    """Simulate the standard protocol of experiments on a plant, as if it had been measured.

    Writes one CSV file for each record into DIR/data, and what is hidden into DIR/truth.json.
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
