"""Limits of safe operation, and the costs of leaving them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

COSTS = ("saturation", "rate", "ringing", "stroke")
"""Components of the cost, each 1 in a sample that leaves its limit and 0 in any other."""
COST_KEYS = (*(f"cost_{name}" for name in COSTS), "cost")
"""Keys of ``info``, the components and their sum, as Safety-Gymnasium names them."""


class Bounds(NamedTuple):
    """Limits of one sample."""

    most_change_V: float
    most_ringing_um: float
    lowest_um: float
    highest_um: float


@dataclass(frozen=True)
class Limits:
    """Limits of a sample, from the true displacement and the command.

    Parameters
    ----------
    rate_V_s
        Rate of the command (V/s): beyond it ``cost_rate`` is 1.
    ringing_um_s2
        Second difference of the tracking error over the sampling time squared (µm/s²): beyond it
        ``cost_ringing`` is 1. Of a mode of f (Hz) it is (2π f)² times the amplitude.
    stroke_um
        Farthest displacement from the references' centre (µm): beyond it ``cost_stroke`` is 1.

    A command or action that was clipped has ``cost_saturation`` 1, without a limit of its own.

    Raises
    ------
    InputError
        A limit is not above zero.

    Examples
    --------
    >>> Limits(stroke_um=50.0).rate_V_s
    inf
    """

    rate_V_s: float = math.inf
    ringing_um_s2: float = math.inf
    stroke_um: float = math.inf

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (value == math.inf or (is_finite(value) and value > 0.0)):
                raise InputError(f"limit {field.name} is {quoted(value)}; give a number above 0")

    @classmethod
    def of(cls, limits: Limits | Mapping[str, float] | None) -> Limits | None:
        """Return limits, given as such or as a dictionary of them; None: no limits."""
        if limits is None or isinstance(limits, Limits):
            return limits
        names = [field.name for field in fields(cls)]
        if not isinstance(limits, Mapping) or not set(limits) <= set(names):
            raise InputError(f"limits is {quoted(limits)}; give a dictionary of {', '.join(names)}")
        return cls(**limits)

    def of_sample(self, layout: ObservationLayout) -> Bounds:
        """Return the limits of one sample of a layout."""
        return Bounds(
            self.rate_V_s * layout.ts_s,
            self.ringing_um_s2 * layout.ts_s * layout.ts_s,
            layout.centre_um - self.stroke_um,
            layout.centre_um + self.stroke_um,
        )
