"""Numbers, values and names as sentences write them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from reprlib import Repr

_WIDTH = 60
_QUOTE = Repr()
_QUOTE.maxstring = _QUOTE.maxother = _QUOTE.maxlong = _WIDTH
_QUOTE.maxlist = _QUOTE.maxtuple = _QUOTE.maxdict = 4
_QUOTE.maxlevel = 2


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


def joined(names: Sequence[str]) -> str:
    """Write a list of names in words.

    Examples
    --------
    >>> joined(["creep"]), joined(["creep", "delay", "resonance"])
    ('creep', 'creep, delay and resonance')
    """
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def closed(sentence: str) -> str:
    """End a sentence with a full stop where it has none.

    Examples
    --------
    >>> closed("creep"), closed("Is it?")
    ('creep.', 'Is it?')
    """
    return sentence if sentence.rstrip().endswith((".", "!", "?")) else f"{sentence}."


def pm(value: float, error: float) -> str:
    """Write a value with its standard error.

    Examples
    --------
    >>> pm(0.263, 0.61)
    '0.26 ± 0.6'
    """
    return f"{digits(value)} ± {digits(error, 1)}" if math.isfinite(error) else "unknown"


def quoted(value: object) -> str:
    """Show what a file or a caller gave, for an error line: short, however long it is.

    Examples
    --------
    >>> quoted("creep"), quoted(3.5)
    ("'creep'", '3.5')
    >>> quoted(list(range(1000))), len(quoted("x" * 10_000))
    ('[0, 1, 2, 3, ...]', 60)
    """
    try:
        return _QUOTE.repr(value)
    except ValueError:  # a whole number of thousands of digits
        return f"a {type(value).__name__}"


def some(names: Iterable[object], count: int = 8) -> str:
    """List names for an error line: the first few, and how many more there are.

    Examples
    --------
    >>> some(["t", "u", "y"]), some(range(100), 3)
    ('t, u, y', '0, 1, 2 and 97 more')
    """
    listed = list(names)
    shown = ", ".join(short(str(name)) for name in listed[:count])
    return f"{shown} and {len(listed) - count} more" if len(listed) > count else shown


def short(text: str) -> str:
    """Cut a name for an error line.

    Examples
    --------
    >>> short("voltage"), len(short("x" * 10_000))
    ('voltage', 60)
    """
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."
