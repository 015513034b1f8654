"""What voltage does to displacement: play operators, the RDPI model, the plant as a chain."""

from rdpi_gym.plant.cores.base import CORES, Core
from rdpi_gym.plant.cores.rdpi import PAPER_III_B, PAPER_IV_B, RDPI, settled_memory
from rdpi_gym.plant.instruments import PAPER_CONVERTER, PAPER_SENSOR, Converter, Sensor
from rdpi_gym.plant.model import PlantModel
from rdpi_gym.plant.named import MEASURED, P5, P10, PLANTS, find_plant, named_plant
from rdpi_gym.plant.packing import check_ts, empty_state, pack
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
