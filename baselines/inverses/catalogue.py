"""The inverse stages by effect."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from baselines.inverses.asymmetry import AsymmetryInverse
from baselines.inverses.backlash import BacklashInverse
from baselines.inverses.base import Inverse
from baselines.inverses.creep import CreepInverse
from baselines.inverses.delay import DelayInverse
from baselines.inverses.drifts import GainDriftInverse, ThermalDriftInverse
from baselines.inverses.lags import ActuatorLagInverse, SensorLagInverse
from baselines.inverses.resonance import ResonanceInverse
from baselines.inverses.saturation import SaturationInverse

INVERSES: Mapping[str, type[Inverse]] = MappingProxyType(
    {
        kind.effect: kind
        for kind in (
            SaturationInverse,
            ActuatorLagInverse,
            AsymmetryInverse,
            CreepInverse,
            ResonanceInverse,
            BacklashInverse,
            GainDriftInverse,
            ThermalDriftInverse,
            DelayInverse,
            SensorLagInverse,
        )
    }
)
"""Inverse stages by the name of the effect that they undo, in the chain's order."""
