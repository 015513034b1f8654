"""Plants by name: the paper's two, their static and test-bench forms, and those of measured records."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

from rdpi_gym.plant.cores.rdpi import PAPER_III_B, PAPER_IV_B
from rdpi_gym.plant.instruments import PAPER_CONVERTER, PAPER_SENSOR
from rdpi_gym.plant.model import PlantModel
from rdpi_gym.support.checks import shown
from rdpi_gym.support.errors import InputError

P5 = PlantModel(PAPER_III_B, "P5", (-25.0, 25.0), (0.0, 10.0), note="the paper, Section III-B")
P10 = PlantModel(PAPER_IV_B, "P10", (-80.0, 80.0), (0.0, 40.0), note="the paper, Section IV-B")


def _bench(model: PlantModel) -> PlantModel:
    return PlantModel(
        model.hysteresis,
        f"{model.name}-bench",
        model.command_range_V,
        model.reference_um,
        sensor=PAPER_SENSOR,
        converter=PAPER_CONVERTER,
        note=f"{model.note}, on the test bench of Section IV-A",
    )


def _library() -> Path:
    return Path(str(files("rdpi_gym.plant") / "library"))


MEASURED: tuple[str, ...] = tuple(sorted(path.stem for path in _library().glob("*.json")))
"""Those of measured or published records; each file says which, and what was held out."""
PLANTS: tuple[str, ...] = (
    "P5", "P10", "P5-static", "P10-static", "P5-bench", "P10-bench", *MEASURED,
)  # fmt: skip


@cache
def named_plant(name: str) -> PlantModel:
    """Return one of the plants of :data:`PLANTS`, RDPI models with the literal rate of Eq. 5.

    Parameters
    ----------
    name
        ``P5`` and ``P10`` are the paper's sets; ``-static`` has δ2 = 0; ``-bench`` adds 50 µs
        converters, 10 nm resolution and noise. ``picma`` was identified from a measured stack, and
        ``picma-preisach`` and its like from the same with another core; ``friction_damper-stop``
        and its like from a damper (kN over mm); ``lugre-1995`` is published (N over µm).

    Raises
    ------
    InputError
        No plant has that name.

    Examples
    --------
    >>> round(named_plant("P10").hysteresis.A, 4)
    1.2213
    """
    if name not in PLANTS:
        raise InputError(f"no plant is named {shown(name)}; known are {', '.join(PLANTS)}")
    if name in MEASURED:
        return PlantModel.load(_library() / f"{name}.json")
    base, _, form = name.partition("-")
    model = P5 if base == "P5" else P10
    if form == "static":
        return model.with_hysteresis(model.hysteresis.static(), name)
    return _bench(model) if form == "bench" else model


def find_plant(name_or_path: str) -> PlantModel:
    """Return a named plant, or load the JSON file at a path.

    Raises
    ------
    InputError
        Neither a name of :data:`PLANTS` nor a readable plant file.

    Examples
    --------
    >>> find_plant("P5").name
    'P5'
    """
    if name_or_path in PLANTS:
        return named_plant(name_or_path)
    try:
        found = Path(name_or_path).is_file()
    except OSError:  # a name longer than any file's
        found = False
    if not found:
        raise InputError(
            f"{shown(name_or_path)} is neither a plant file nor one of {', '.join(PLANTS)}"
        )
    return PlantModel.load(name_or_path)
