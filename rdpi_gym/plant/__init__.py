"""Models of the displacement over the voltage: play operators, the RDPI model, the plant as a chain."""

from rdpi_gym.plant.cores.base import CORES, Core, check_ts, empty_state, pack
from rdpi_gym.plant.cores.families import settled_memory
from rdpi_gym.plant.cores.rdpi import PAPER_III_B, PAPER_IV_B, RDPI
from rdpi_gym.plant.model import (
    MEASURED,
    P5,
    P10,
    PAPER_CONVERTER,
    PAPER_SENSOR,
    PLANTS,
    Converter,
    PlantModel,
    Sensor,
    find_plant,
    named_plant,
)
from rdpi_gym.plant.plant import Plant
from rdpi_gym.support.arrays import Array

__all__ = [
    "CORES",
    "MEASURED",
    "P5",
    "P10",
    "PAPER_CONVERTER",
    "PAPER_III_B",
    "PAPER_IV_B",
    "PAPER_SENSOR",
    "PLANTS",
    "RDPI",
    "Array",
    "Converter",
    "Core",
    "Plant",
    "PlantModel",
    "Sensor",
    "check_ts",
    "empty_state",
    "find_plant",
    "named_plant",
    "pack",
    "settled_memory",
]
