"""What a core is given: lists of numbers, weights, thresholds and the band of its rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.checks import is_finite, shown
from rdpi_gym.support.errors import InputError


def numbers(name: str, values: Sequence[float]) -> tuple[float, ...]:
    """Return a list of numbers as floats."""
    try:
        return tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {shown(values)}; give a list of numbers") from None


def check_weights(weights: Sequence[float], first: int = 0) -> None:
    """Refuse weights (µm/V) that are not finite or negative; `first` is the index of the first one."""
    for i, a in enumerate(weights, start=first):
        if not (math.isfinite(a) and a >= 0):
            raise InputError(f"weight a_{i} is {a}; weights are finite and not negative (µm/V)")


def check_thresholds(thresholds_V: Sequence[float], weights: int, operator: str) -> None:
    """Refuse thresholds (V) that do not increase from above zero, or are not one for each weight."""
    if len(thresholds_V) != weights:
        raise InputError(
            f"{len(thresholds_V)} thresholds for {weights} {operator} weights; give one threshold for each of a_1 ... a_n"
        )
    for i, (low, high) in enumerate(zip((0.0, *thresholds_V), thresholds_V, strict=False), start=1):
        if not (math.isfinite(high) and high > low):
            raise InputError(
                f"threshold r_{i} is {high} V after {low} V; thresholds increase from above 0 V"
            )


def check_rate_bandwidth(rate_bandwidth_hz: float | None) -> None:
    """Refuse a cut-off (Hz) of the rate's low-pass that is neither above zero nor None."""
    if rate_bandwidth_hz is not None and not (
        is_finite(rate_bandwidth_hz) and rate_bandwidth_hz > 0
    ):
        raise InputError(
            f"rate_bandwidth_hz is {shown(rate_bandwidth_hz)}; give a frequency above 0 Hz, or None for the literal rate"
        )


def check_shape(core: Core) -> None:
    """Refuse a number of a core's shape that is not finite or beyond its bounds."""
    for number in core.shape:
        value = getattr(core, number.name)
        if not (is_finite(value) and number.low <= value <= number.high):
            unit = "" if number.unit == "1" else f" {number.unit}"
            raise InputError(
                f"{number.name} is {shown(value)}; give a number from {number.low:g} to {number.high:g}{unit}"
            )


def check_gain(name: str, value: float, signed: bool = False) -> None:
    """Refuse a gain (µm/V) that is not finite, or negative where it may not be."""
    if not is_finite(value) or (value < 0 and not signed):
        kind = "gain" if signed else "gain that is not negative"
        raise InputError(f"{name} is {shown(value)}; give a finite {kind}")
