"""The inverse stages by effect."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from baselines.effect_inverses.asymmetry import AsymmetryInverse
from baselines.effect_inverses.backlash import BacklashInverse
from baselines.effect_inverses.base import Inverse
from baselines.effect_inverses.creep import CreepInverse
from baselines.effect_inverses.delay import DelayInverse
from baselines.effect_inverses.drifts import GainDriftInverse, ThermalDriftInverse
from baselines.effect_inverses.lags import ActuatorLagInverse, SensorLagInverse
from baselines.effect_inverses.resonance import ResonanceInverse
from baselines.effect_inverses.saturation import SaturationInverse

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
