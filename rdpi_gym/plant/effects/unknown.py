"""Unknown: a free block for what no effect of the catalogue is, as records teach it."""

from __future__ import annotations

from dataclasses import dataclass

from rdpi_gym.plant.effects.unknown_drives import (
    CURVE,
    LAG,
    RATE,
    TWO_LAGS,
    OfTheRate,
    Static,
    WithMemory,
    WithTwoMemories,
)
from rdpi_gym.plant.effects.unknown_places import MICROMETRES, VOLTS, Before, Behind, Beside, In


@dataclass(frozen=True)
class Unknown(Behind, Static):
    """A curve behind the hysteresis, of which nothing is known but what records teach.

    Examples
    --------
    >>> block = Unknown(even_1=0.1, odd_1=0.0, span_um=10.0)
    >>> block.run([-10.0, 0.0, 5.0], 1e-3).tolist()
    [-9.0, 0.0, 5.25]
    """

    name = "unknown"
    on_request = True
    parameters = (*CURVE, *MICROMETRES)
    equation = "y = y_h + Y (E(|s|) + sgn(s) O(|s|) + c S(s)), s = (y_h - A u_c) / Y, E and O quadratic splines, S a smooth step"
    source = "A Hammerstein or Wiener block in the chain; no effect is claimed."
    signature = (
        "An error that follows from the command and that no effect of the catalogue explains."
    )
    experiment = "The one that its portrait asks for."
    mistaken_for = ()


_IN_FRONT = "u' = u + U z, s = (u - u_c) / U"
_WITHIN = "y = a_0 u + (1 + z) (y_h - a_0 u), s = (u - u_c) / U"
_PARALLEL = "y = y_h + A U z, s = (u - u_c) / U"
_BEHIND = "y = y_h + Y z, s = (y_h - A u_c) / Y"
_CURVED = "z = E(|s|) + sgn(s) O(|s|) + c S(s), E and O quadratic splines, S a smooth step"
_OF_THE_RATE = "z = c_1 |r| + c_2 r |r| + c_3 s r, r the rate of s"
_LAGS = "τ dz/dt + z = c_1 s + c_2 |s| + c_3 s² + c_4 s |s| + c_5 S(s) + c_6 |r|, r the rate of s"
_LAGS_TWICE = "z = z_1 + z_2, τ_k dz_k/dt + z_k = c_1k s + c_2k |s| + c_3k s² + c_4k s |s| + c_5k S(s) + c_6k |r|"


@dataclass(frozen=True)
class RateBehind(Behind, OfTheRate, of=Unknown):
    """What the rate adds behind the hysteresis."""

    form = "of the rate, behind"
    parameters = (*RATE, *MICROMETRES)
    equation = f"{_BEHIND}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateIn(In, OfTheRate, of=Unknown):
    """Weights of the plays that change with the rate."""

    form = "of the rate, in"
    parameters = (*RATE, *VOLTS)
    equation = f"{_WITHIN}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateBefore(Before, OfTheRate, of=Unknown):
    """What the rate adds to the command."""

    form = "of the rate, before"
    parameters = (*RATE, *VOLTS)
    equation = f"{_IN_FRONT}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateBeside(Beside, OfTheRate, of=Unknown):
    """What the rate of the command adds to the displacement."""

    form = "of the rate, beside"
    parameters = (*RATE, *VOLTS)
    equation = f"{_PARALLEL}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class StaticIn(In, Static, of=Unknown):
    """Weights of the plays along a curve of the command."""

    form = "static, in"
    parameters = (*CURVE, *VOLTS)
    equation = f"{_WITHIN}, {_CURVED}"


@dataclass(frozen=True)
class StaticBefore(Before, Static, of=Unknown):
    """A curve of the command before the hysteresis."""

    form = "static, before"
    parameters = (*CURVE, *VOLTS)
    equation = f"{_IN_FRONT}, {_CURVED}"


@dataclass(frozen=True)
class StaticBeside(Beside, Static, of=Unknown):
    """A curve of the command that is added to the displacement."""

    form = "static, beside"
    parameters = (*CURVE, *VOLTS)
    equation = f"{_PARALLEL}, {_CURVED}"


@dataclass(frozen=True)
class MemoryBehind(Behind, WithMemory, of=Unknown):
    """A leaky memory of the displacement, of its size and of its speed, behind the hysteresis."""

    form = "with memory, behind"
    parameters = (*LAG, *MICROMETRES)
    equation = f"{_BEHIND}, {_LAGS}"


@dataclass(frozen=True)
class MemoryIn(In, WithMemory, of=Unknown):
    """Weights of the plays that follow a leaky memory of the command, of its size and its speed."""

    form = "with memory, in"
    parameters = (*LAG, *VOLTS)
    equation = f"{_WITHIN}, {_LAGS}"


@dataclass(frozen=True)
class MemoryBefore(Before, WithMemory, of=Unknown):
    """A leaky memory of the command, of its size and of its speed, before the hysteresis."""

    form = "with memory, before"
    parameters = (*LAG, *VOLTS)
    equation = f"{_IN_FRONT}, {_LAGS}"


@dataclass(frozen=True)
class MemoryBeside(Beside, WithMemory, of=Unknown):
    """A leaky memory of the command that is added to the displacement."""

    form = "with memory, beside"
    parameters = (*LAG, *VOLTS)
    equation = f"{_PARALLEL}, {_LAGS}"


@dataclass(frozen=True)
class MemoriesBehind(Behind, WithTwoMemories, of=Unknown):
    """Two leaky memories behind the hysteresis."""

    form = "with two memories, behind"
    parameters = (*TWO_LAGS, *MICROMETRES)
    equation = f"{_BEHIND}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesIn(In, WithTwoMemories, of=Unknown):
    """Weights of the plays that follow two leaky memories."""

    form = "with two memories, in"
    parameters = (*TWO_LAGS, *VOLTS)
    equation = f"{_WITHIN}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesBefore(Before, WithTwoMemories, of=Unknown):
    """Two leaky memories before the hysteresis."""

    form = "with two memories, before"
    parameters = (*TWO_LAGS, *VOLTS)
    equation = f"{_IN_FRONT}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesBeside(Beside, WithTwoMemories, of=Unknown):
    """Two leaky memories of the command that are added to the displacement."""

    form = "with two memories, beside"
    parameters = (*TWO_LAGS, *VOLTS)
    equation = f"{_PARALLEL}, {_LAGS_TWICE}"
