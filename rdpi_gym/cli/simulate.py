"""`rdpi simulate`: a measurement-like data set from a plant, with effects hidden in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rdpi_gym.cli.options import OutOption, SeedOption
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
    import numpy as np

    from rdpi_gym.plant import find_plant
    from rdpi_gym.virtual_lab import HIDEABLE, Truth, hide_one, simulate_dataset, write_dataset
    from rdpi_gym.virtual_lab import hide as hide_named

    names = _names(hide, HIDEABLE)
    truth = Truth(find_plant(model), (), noise_um, seed, ts_factor)
    known = [effect.name for effect in truth.plant.effects]
    if taken := [name for name in names if name in known]:
        raise InputError(f"--hide: {model} has {taken[0]} already; hide another effect")
    rng = np.random.default_rng([seed, 1])
    free = [name for name in HIDEABLE if name not in known]
    with progress_bar() as show:
        show("drawing", 0, 0)
        truth = hide_one(free, truth, rng) if hide == "random" else hide_named(names, truth, rng)
        dataset = simulate_dataset(truth, progress=show)
        show("writing", 0, 0)
        folder = out / "data"
        write_dataset(dataset, folder, "Simulated by `rdpi simulate`.")
        answer = truth.save(out / "truth.json")
    samples = sum(len(record.u_V) for record in dataset.train)
    print(
        f"{len(dataset.records)} records of {truth.plant.name}: {samples} samples to fit, "
        f"{sum(len(record.u_V) for record in dataset.validation)} to validate on"
    )
    print(f"data: {folder}")
    print(f"{'hidden effects' if hide else 'nothing is hidden'}: {answer}")


def _names(hide: str | None, known: tuple[str, ...]) -> list[str]:
    from rdpi_gym.measurement.options import unknown_name

    if hide is None or hide == "random":
        return []
    names = [word.strip() for word in hide.split(",") if word.strip()]
    if not names:
        raise InputError("--hide names no effect; give one, as in --hide creep, or leave it out")
    for name in names:
        if name == "random":
            raise InputError("--hide: random stands alone; give it without other effects")
        if name not in known:
            raise unknown_name("--hide", name, [*known, "random"])
        if names.count(name) > 1:
            raise InputError(f"--hide: {name} is there twice; a plant has each effect once")
    return names
