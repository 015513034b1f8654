"""Model error by properties of the command."""

from rdpi_gym.diagnosis.comparison.compare import (
    MOST_MODELS,
    Comparison,
    ModelComparison,
    compare,
    compare_several,
)
from rdpi_gym.diagnosis.comparison.findings import FEW_HALF_CYCLES
from rdpi_gym.diagnosis.comparison.traces import Plane, Trace
from rdpi_gym.diagnosis.features.cycles import HalfCycles, half_cycles

__all__ = [
    "FEW_HALF_CYCLES",
    "MOST_MODELS",
    "Comparison",
    "HalfCycles",
    "ModelComparison",
    "Plane",
    "Trace",
    "compare",
    "compare_several",
    "half_cycles",
]
