"""Measurements: read, check and split records of voltage and displacement."""

from rdpi_gym.measurement.checking import MIN_SAMPLES
from rdpi_gym.measurement.loading import DATA_HINT, example_folder, load, measured_data
from rdpi_gym.measurement.options import COLUMNS, UNITS, DataOptions, parse_columns, parse_units
from rdpi_gym.measurement.quantities import Quantities, Quantity, stated_quantities
from rdpi_gym.measurement.record import (
    LARGEST,
    Dataset,
    Record,
    Role,
    hold_out_blocks,
    longest_counted,
)
from rdpi_gym.measurement.sampling import JITTER
from rdpi_gym.measurement.writing import other_name, write_csv

__all__ = [
    "COLUMNS",
    "DATA_HINT",
    "JITTER",
    "LARGEST",
    "MIN_SAMPLES",
    "UNITS",
    "DataOptions",
    "Dataset",
    "Quantities",
    "Quantity",
    "Record",
    "Role",
    "example_folder",
    "hold_out_blocks",
    "load",
    "longest_counted",
    "measured_data",
    "other_name",
    "parse_columns",
    "parse_units",
    "stated_quantities",
    "write_csv",
]
