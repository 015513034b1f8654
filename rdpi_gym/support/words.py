"""Numbers as sentences write them."""

from __future__ import annotations

import math


def digits(value: float, count: int = 2) -> str:
    """Write a number with some significant digits and without an exponent.

    Examples
    --------
    >>> digits(110.3), digits(-0.01234), digits(2.0, 3)
    ('110', '-0.012', '2')
    """
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    places = count - 1 - math.floor(math.log10(abs(value)))
    text = f"{round(value, places):.{max(0, places)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def micrometres(value: float) -> str:
    """Write a displacement with three significant digits.

    Examples
    --------
    >>> micrometres(0.012345), micrometres(-3.0), micrometres(12345.6)
    ('0.0123 µm', '-3 µm', '12300 µm')
    """
    return f"{digits(value, 3)} µm"


def pm(value: float, error: float) -> str:
    """Write a value with its standard error.

    Examples
    --------
    >>> pm(0.263, 0.61)
    '0.26 ± 0.6'
    """
    return f"{digits(value)} ± {digits(error, 1)}" if math.isfinite(error) else "unknown"
