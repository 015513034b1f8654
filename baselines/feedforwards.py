"""Every feedforward by its name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from baselines.classical_literal import ClassicalLiteral
from baselines.classical_low_passed import ClassicalLowPassed
from baselines.classical_reference_rate import ClassicalReferenceRate
from baselines.classical_static import ClassicalStatic
from baselines.extended import ExtendedInverse
from baselines.feedforward import Feedforward
from baselines.inversion_free_literal import InversionFreeLiteral
from baselines.inversion_free_low_passed import InversionFreeLowPassed
from baselines.inversion_free_reference_rate import InversionFreeReferenceRate
from baselines.static_gain import StaticGain

FEEDFORWARDS: Mapping[str, type[Feedforward]] = MappingProxyType(
    {
        "none": StaticGain,
        "inversion-free-literal": InversionFreeLiteral,
        "inversion-free-reference-rate": InversionFreeReferenceRate,
        "inversion-free-low-passed": InversionFreeLowPassed,
        "classical-literal": ClassicalLiteral,
        "classical-reference-rate": ClassicalReferenceRate,
        "classical-low-passed": ClassicalLowPassed,
        "classical-static": ClassicalStatic,
        "extended-inverse": ExtendedInverse,
    }
)
