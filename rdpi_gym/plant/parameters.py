"""Parameters of effects and cores, and the size of the data that they are fitted to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, TypeVar

One = TypeVar("One")


def moved(one: One, checks: type, **values: Any) -> One:
    """Return a frozen dataclass with other values of some fields, which the caller has checked.

    A class whose checks are not those of the class `checks` checks all of its fields anew.
    """
    kind: Any = type(one)
    if kind.__post_init__ is not checks.__post_init__:  # type: ignore[attr-defined]
        return replace(one, **values)  # type: ignore[type-var]
    made: One = object.__new__(kind)
    if vars(one).keys() == kind.__dataclass_fields__.keys():  # nothing cached beside the fields
        vars(made).update(vars(one), **values)
        return made
    for name in kind.__dataclass_fields__:
        object.__setattr__(made, name, values[name] if name in values else getattr(one, name))
    return made


@dataclass(frozen=True)
class Parameter:
    """One number of an effect or of a hysteresis core.

    Parameters
    ----------
    name, unit
        As in its dataclass; unit ``1`` has none.
    low, high
        Physical bounds: a fit stays within them and reports a value at one of them.
    typical
        Range that is commonly met, used for random plants.
    meaning
        In words.
    neutral
        The value at which the effect changes nothing, whatever its other parameters, or in a form
        with several of them the part of it that this one sizes; None where no value does.
    fixed
        A scale that is chosen and not fitted: another parameter would trade with it.
    step
        Finite difference by which a fit takes derivatives, of the logarithm where `low` is above
        zero; None: a thousandth, which is too far for a frequency that is counted over minutes.

    Examples
    --------
    >>> Parameter("delay_s", "s", 0.0, 0.02, (1e-5, 5e-4), "delay T", neutral=0.0).fixed
    False
    """

    name: str
    unit: str
    low: float
    high: float
    typical: tuple[float, float]
    meaning: str
    neutral: float | None = None
    fixed: bool = False
    step: float | None = None


@dataclass(frozen=True)
class DataScale:
    """Size and rate of measured records, from which a search starts.

    Parameters
    ----------
    centre_V, span_V
        Middle of the command and half of its widest swing (V).
    stroke_um
        Half of the displacement's widest swing (µm).
    fastest_V_s
        Largest rate of the command, jumps left out (V/s).
    shortest_s, longest_s
        Shortest sampling time and longest record (s).
    end_s
        Where the last record ends on the experiment's clock (s).
    """

    centre_V: float
    span_V: float
    stroke_um: float
    fastest_V_s: float
    shortest_s: float
    longest_s: float
    end_s: float = 0.0

    @property
    def slowness(self) -> float:
        """Factor on the times of the standard protocol, a power of ten from 1 on.

        Its slowest sine over the full range, 10 Hz, then is about as fast as these records.
        """
        pace_hz = self.fastest_V_s / (2.0 * math.pi * self.span_V)
        return 10.0 ** max(round(math.log10(10.0 / pace_hz)), 0)

    @property
    def lasts_s(self) -> float:
        """Time scale of slow drifts (s): until the experiment's end, at least the longest record."""
        return max(self.end_s, self.longest_s)
