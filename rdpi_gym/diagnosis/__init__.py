"""Where a model fails: its error taken apart by what the command was doing."""

from rdpi_gym.diagnosis.breakdown import Plane
from rdpi_gym.diagnosis.compare import Comparison, compare
from rdpi_gym.diagnosis.findings import FEW_HALF_CYCLES
from rdpi_gym.diagnosis.half_cycles import HalfCycles, half_cycles
from rdpi_gym.diagnosis.traces import Trace

__all__ = [
    "FEW_HALF_CYCLES",
    "Comparison",
    "HalfCycles",
    "Plane",
    "Trace",
    "compare",
    "half_cycles",
]
