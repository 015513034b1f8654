"""Plants of every kind of hysteresis, from measured and published records: `python -m studies.core_plants`.

The PICMA stack by every kind whose loops turn its way, each beside a creep and a lag of the sensor;
the friction damper by every kind whose loops turn clockwise; LuGre's friction with the numbers of the
paper. Their parameters ship as plants; so do the stack's records, while `RDPI_DATA` names the damper's.
"""

from __future__ import annotations

import itertools
import math
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import rdpi_gym.plant
from rdpi_gym.identification.cores import CoreFit, fit_core
from rdpi_gym.identification.kinds import choose_kind
from rdpi_gym.measurement import Dataset, Quantities, Quantity, load
from rdpi_gym.measurement.loading import DATA_HINT, example_folder, measured_data
from rdpi_gym.measurement.options import DataOptions
from rdpi_gym.plant import CORES, Plant, PlantModel
from rdpi_gym.plant.cores.lugre import LuGre
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar

LIBRARY = Path(rdpi_gym.plant.__file__).parent / "library"
_PICMA = (
    "PICMA P-885.91 stack, Y. N. Aye, W. T. Ang, ICSTSD 2018; repository yan9a/DiscreteBacklashOperator",
    "MIT, Copyright (c) 2019 Yan Naing Aye",
)
_DAMPER = (
    "banded rotary friction device with backlash, 36 lb band tension, dataset-2; repository "
    "ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash",
    "CC BY-SA 4.0, Copyright Daniel Coble, Parker Huggins, Liang Cao, James Ricles, Austin Downey 2022",
)
_LUGRE = (
    "Canudas de Wit, Olsson, Åström, Lischinsky, IEEE Trans. Automat. Contr. 40 (1995) 419, Table I; "
    "the command range is ours"
)
_UNITS = {"u": "mm", "y": "kN"}
# Of the command range beyond the data's, and of what a slow walk through the range reaches, where
# references lie.
_MARGIN, _REACHED = 0.05, 0.9
_TS_S, _LEG_S = 1e-3, 2.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit the plants and write them."""
    return Options("core_plants", __doc__, out=LIBRARY).run(arguments, _run)


def _run(options: Namespace) -> None:
    folder = measured_data("friction_damper")
    if folder is None:
        raise InputError(f"the folder friction_damper is missing. {DATA_HINT}")
    picma = load(example_folder("picma"))
    damper = load(folder, DataOptions(units=_UNITS))
    with progress_bar() as show:
        for plant in (*_of_the_stack(picma, show), *_of_the_damper(damper, show), published()):
            print(plant.save(options.out / f"{plant.name}.json"))


def _of_the_stack(
    data: Dataset, show: Callable[[str, int, int], None]
) -> Iterator[PlantModel[Any]]:
    found = choose_kind(data, progress=show)
    for fit in found.fits:
        if fit.plant.hysteresis.clockwise is not True:
            yield _shipped(fit, f"picma-{fit.plant.hysteresis.name}", data, *_PICMA)


def _of_the_damper(
    data: Dataset, show: Callable[[str, int, int], None]
) -> Iterator[PlantModel[Any]]:
    for kind in CORES.values():
        if kind.clockwise is True:
            fit = fit_core(data, kind, progress=show)
            yield _shipped(fit, f"friction_damper-{kind.name}", data, *_DAMPER)


def published() -> PlantModel[Any]:
    """Return LuGre's friction with the numbers of the paper: force (N) over displacement (µm)."""
    s0 = 1e5  # N/m; s1 = √s0 N s/m, s2 = 0.4 N s/m, Fc = 1 N, Fs = 1.5 N, vs = 1 mm/s
    core = LuGre(1e-6 * s0, 1e-6 * math.sqrt(s0), 1e-6 * 0.4, 1e6 / s0, 1.5, 1e3)
    quantities = Quantities(Quantity("displacement", "x", "µm"), Quantity("force", "F", "N"))
    stated = {"source": _LUGRE, "quantities": quantities.to_dict()}
    reached = (0.0, _REACHED * core.s0 * core.coulomb_V)  # of Fc, however fast it slides
    make: Callable[..., PlantModel[Any]] = PlantModel
    note = f"friction as published: {_LUGRE}."
    return make(core, "lugre-1995", (-100.0, 100.0), reached, note=note, identification=stated)


def _shipped(fit: CoreFit, name: str, data: Dataset, source: str, licence: str) -> PlantModel[Any]:
    """Return a fitted plant that counts from rest and says where it is from."""
    stated: dict[str, Any] = {
        "source": source,
        "licence": licence,
        "held_out_rmse_um": fit.validation_rmse_um,
        "train_rmse_um": fit.train_rmse_um,
        "at_bound": list(fit.at_bound),
        "smoothness": fit.smoothness,
    }
    quantities = data.quantities
    if not quantities.are_standard:
        stated["quantities"] = quantities.to_dict()
    held = f"{fit.validation_rmse_um:.3g} {quantities.output.unit} rms held out"
    note = f"fitted to {data.title}; {held}"
    return _ranged(
        replace(fit.plant, name=name, offset_um=0.0, note=f"{note}.", identification=stated)
    )


def _ranged(plant: PlantModel[Any]) -> PlantModel[Any]:
    """Return a plant with references (µm) that a slow walk through its commands reaches."""
    low, high = plant.command_range_V
    margin = _MARGIN * (high - low)
    turns = (0.0, high - margin, low + margin, high - margin, low + margin)
    legs = [np.linspace(a, b, round(_LEG_S / _TS_S)) for a, b in itertools.pairwise(turns)]
    y: Array = Plant(plant, _TS_S).simulate(np.concatenate(legs))[-2 * len(legs[0]) :]
    least, most = float(y.min()), float(y.max())
    return replace(plant, reference_um=(0.5 * (least + most), 0.5 * _REACHED * (most - least)))


if __name__ == "__main__":
    sys.exit(main())
