"""Reference and excitation signals: displacement (µm) at any time (s), with exact derivatives."""

from rdpi_gym.signals.base import Signal
from rdpi_gym.signals.broadband import (
    BandLimitedNoise,
    Chirp,
    DecayingSine,
    LaplaceProcess,
    Multisine,
    WienerProcess,
)
from rdpi_gym.signals.combine import Sequence, Sum
from rdpi_gym.signals.measured import Measured
from rdpi_gym.signals.periodic import NestedLoops, Sawtooth, Sine, Triangle, first_order_reversals
from rdpi_gym.signals.raster import Raster, RasterSlowRamp, RasterSlowStairs
from rdpi_gym.signals.registry import SIGNALS, make_signal, signal_from_dict
from rdpi_gym.signals.steps import Constant, RandomSteps, Steps

__all__ = [
    "SIGNALS",
    "BandLimitedNoise",
    "Chirp",
    "Constant",
    "DecayingSine",
    "LaplaceProcess",
    "Measured",
    "Multisine",
    "NestedLoops",
    "RandomSteps",
    "Raster",
    "RasterSlowRamp",
    "RasterSlowStairs",
    "Sawtooth",
    "Sequence",
    "Signal",
    "Sine",
    "Steps",
    "Sum",
    "Triangle",
    "WienerProcess",
    "first_order_reversals",
    "make_signal",
    "signal_from_dict",
]
