"""One term with free exponents in place of a block: it tells with which power an effect grows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rdpi_gym.plant.effects.base import Parameter
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.plant.effects.unknown_drives import weight
from rdpi_gym.plant.effects.unknown_places import (
    MICROMETRES,
    VOLTS,
    Before,
    Behind,
    Beside,
    Block,
    In,
    Place,
    Terms,
)

_POWERS = (
    weight("weight", "share w"),
    Parameter("power", "1", 0.0, 8.0, (1.0, 3.0), "exponent a of |s|"),
    Parameter("rate_power", "1", 0.0, 4.0, (0.0, 2.0), "exponent b of |r|"),
    Parameter("time_constant_s", "s", 1e-6, 1e9, (0.1, 10.0), "time constant τ of its lag"),
    Parameter("signed", "1", 0.0, 1.0, (0.0, 1.0), "whether it has the sign of s", fixed=True),
    Parameter("rate_signed", "1", 0.0, 1.0, (0.0, 1.0), "whether it has the sign of r", fixed=True),
)


@dataclass(frozen=True)
class PowerLaw(Block):
    """One term w |s|^a |r|^b, lagging: it tells exponents, and is no form of the block."""

    weight: float = 0.02
    power: float = 2.0
    rate_power: float = 0.0
    time_constant_s: float = 1.0
    signed: float = 0.0
    rate_signed: float = 0.0

    name = "unknown"
    form = "power law"
    on_request = True
    equation = "τ dz/dt + z = ±w |s|^a |r|^b, r the rate of s"
    source, signature, experiment = Unknown.source, Unknown.signature, Unknown.experiment
    mistaken_for = ()

    def memories(self) -> list[tuple[float, Terms]]:
        """One."""
        return [(self.time_constant_s, self.values)]


@dataclass(frozen=True)
class _PowerBefore(Before, PowerLaw):
    parameters = (*_POWERS, *VOLTS)


@dataclass(frozen=True)
class _PowerIn(In, PowerLaw):
    parameters = (*_POWERS, *VOLTS)


@dataclass(frozen=True)
class _PowerBeside(Beside, PowerLaw):
    parameters = (*_POWERS, *VOLTS)


@dataclass(frozen=True)
class _PowerBehind(Behind, PowerLaw):
    parameters = (*_POWERS, *MICROMETRES)


POWER_LAWS: Mapping[Place, type[PowerLaw]] = {
    "before": _PowerBefore,
    "in": _PowerIn,
    "behind": _PowerBehind,
    "beside": _PowerBeside,
}
"""Power laws by their place."""
