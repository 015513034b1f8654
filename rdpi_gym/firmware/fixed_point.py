"""Fixed point: compensators without transcendental functions on 32-bit integers, for cores without a floating-point unit.

Displacements and commands are fractions of a scale in units of 2^-31 ("codes"). A coefficient is a
whole number of up to 31 bits and a power of two that stands in the text as a literal; products and sums
are of 64 bits, rounded to the nearest, and nothing that 32-bit inputs can bring about overflows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.base import Baseline
from baselines.classical import (
    ClassicalInverse,
    ClassicalLiteral,
    ClassicalLowPassed,
    ClassicalReferenceRate,
    ClassicalStatic,
)
from baselines.classical_inverse_kernels import pack_inverse
from baselines.feedforward import Feedforward
from baselines.inversion_free import (
    InversionFree,
    InversionFreeLiteral,
    InversionFreeLowPassed,
    InversionFreeReferenceRate,
    StaticInverseMultiplicative,
)
from baselines.pi import PI
from baselines.static_gain import StaticGain
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

Integer: TypeAlias = Literal["int32_t", "uint32_t", "int64_t"]

TOLERANCE = 1e-6
"""How far (fraction of the command range) the codes may be from the controller in double."""
_ONE = 2**31
_LARGEST = _ONE - 1
# Bits of a sum of coefficients, after the integer's fraction of an accumulator, and of a rate.
_BITS, _INTEGRAL_BITS, _RATE_BITS = 30, 24, 16
# A displacement may stray as far again from the references as they do from their centre.
_HEADROOM = 2.0
_FEEDFORWARDS: frozenset[type[Baseline]] = frozenset(
    {
        StaticGain, InversionFreeLiteral, InversionFreeReferenceRate, InversionFreeLowPassed,
        StaticInverseMultiplicative, ClassicalReferenceRate, ClassicalStatic, ClassicalLiteral,
        ClassicalLowPassed,
    }
)  # fmt: skip


@dataclass(frozen=True)
class FixedTable:
    """Whole numbers that the code reads and never writes: one field of its struct of parameters.

    Parameters
    ----------
    name
        Identifier of C, lower case.
    type
        Of an element.
    values
        At least one.
    """

    name: str
    type: Integer
    values: tuple[int, ...]


@dataclass(frozen=True)
class FixedMemory:
    """Whole numbers that the code keeps from sample to sample: one field of its struct of memory.

    Parameters
    ----------
    name
        Identifier of C, lower case.
    type
        Of an element.
    rest
        Where an episode begins; not read where `from_reference`.
    from_reference
        Whether it begins at the code of the first reference instead.
    """

    name: str
    type: Integer
    rest: tuple[int, ...]
    from_reference: bool = False


@dataclass(frozen=True)
class FixedPoint:
    """One sample of a controller as C on integers, with ``rdpi_real`` an ``int32_t``.

    The body stands in the same function as that of a
    :class:`~rdpi_gym.firmware.program.Program`; its ``reference_um``, ``ahead_um``, ``measured_um``
    and what it returns are codes: r = centre + displacement_scale · code / 2^31, and
    u = voltage_scale · code / 2^31. Every int32 is a valid input.

    Parameters
    ----------
    displacement_scale_um, centre_um
        Unit and zero (µm) of displacements: twice the amplitude of the references, about their centre.
    voltage_scale_V
        Unit (V) of commands about 0 V: the farther end of the range is code ±(2^31 - 1).
    low, high, rest
        Codes of the lowest and highest command, and of that at which an episode begins.
    reach
        Code of the references' amplitude.
    tables, memory
        In the order of their structs.
    functions
        C text of static functions that `step` calls, callees first; it needs ``<stdint.h>`` alone.
    step
        C text of the body.
    notes
        What a user should know, a sentence each.
    """

    displacement_scale_um: float
    centre_um: float
    voltage_scale_V: float
    low: int
    high: int
    rest: int
    reach: int
    tables: Sequence[FixedTable]
    memory: Sequence[FixedMemory]
    functions: str
    step: str
    notes: Sequence[str] = field(default_factory=tuple)

    @property
    def tolerance(self) -> int:
        """How many codes a command may be from that of the controller in double, :data:`TOLERANCE`."""
        return math.ceil(TOLERANCE * (self.high - self.low))

    def displacement_codes(self, displacement_um: ArrayLike) -> NDArray[np.int32]:
        """Return the codes of displacements (µm), of the same shape; beyond the scale its ends."""
        fraction = (np.asarray(displacement_um) - self.centre_um) / self.displacement_scale_um
        return _codes(fraction)

    def command_codes(self, command_V: ArrayLike) -> NDArray[np.int32]:
        """Return the codes of commands (V), of the same shape; beyond the scale its ends."""
        return _codes(np.asarray(command_V) / self.voltage_scale_V)

    def displacements_um(self, codes: ArrayLike) -> Array:
        """Return displacements (µm) from their codes, of the same shape."""
        place = np.asarray(codes, dtype=np.float64) / _ONE
        return np.asarray(self.centre_um + self.displacement_scale_um * place)

    def commands_V(self, codes: ArrayLike) -> Array:
        """Return commands (V) from their codes, of the same shape."""
        return np.asarray(self.voltage_scale_V * (np.asarray(codes, dtype=np.float64) / _ONE))


def fixed_point_body(controller: Baseline) -> FixedPoint:
    """Return a controller on integers.

    Parameters
    ----------
    controller
        ``none``, an ``inversion-free-*``, ``static-inverse-multiplicative``, a ``classical-*``, or
        ``pi`` alone or on one of those.

    Raises
    ------
    InputError
        It is none of them, or one of its coefficients is too large for the format.

    Examples
    --------
    >>> from baselines import make_controller
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-4)
    >>> body = fixed_point_body(make_controller("pi-classical-static", plant, layout))
    >>> [f"{part.type} {part.name}[{len(part.rest)}]" for part in body.memory]
    ['int32_t plays[5]', 'int64_t integral[1]']
    >>> body.commands_V(body.high).tolist(), body.tolerance
    (25.0, 4295)
    """
    raise NotImplementedError
