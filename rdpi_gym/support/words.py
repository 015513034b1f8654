"""Numbers, values, names and lists, as tables and sentences write them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from reprlib import Repr
from typing import Literal

_WIDTH = 60
_MOST_ZEROS = 15  # that a number without exponent is written with: more are not counted at a glance
_QUOTE = Repr()
_QUOTE.maxstring = _QUOTE.maxother = _QUOTE.maxlong = _WIDTH
_QUOTE.maxlist = _QUOTE.maxtuple = _QUOTE.maxdict = 4
_QUOTE.maxlevel = 2


Exponent = Literal["never", "rare", "short", "usual"]


def number(value: float, count: int = 3, exponent: Exponent = "rare") -> str:
    """Write a number with some significant digits; a dash where there is none.

    Parameters
    ----------
    value
        The number.
    count
        Significant digits; zeros at the end are left out.
    exponent
        ``never``, up to fifteen zeros; ``rare``, only below 1e-4 and from 1e6 on; ``usual``, also for large numbers of
        more digits than `count`; ``short``, as that but without the zeros of the power.

    Examples
    --------
    >>> number(1234.5), number(0.012345), number(0.0123, 2), number(float("nan"))
    ('1230', '0.0123', '0.012', '–')
    >>> [number(1234.5, exponent=e) for e in ("never", "rare", "usual", "short")]
    ['1230', '1230', '1.23e+03', '1.23e3']
    >>> [number(1e-6, exponent=e) for e in ("never", "rare", "usual", "short")]
    ['0.000001', '1e-06', '1e-06', '1e-6']
    """
    if math.isnan(value):
        return "–"
    text = f"{value:.{count}g}"
    mantissa, e, power = text.partition("e")
    if not e or exponent == "usual":
        return text
    if exponent == "short" or abs(int(power)) > _MOST_ZEROS:
        return f"{mantissa}e{int(power)}"
    if exponent == "rare":
        return f"{float(text):g}" if 1e-4 < abs(value) < 1e6 else text
    return f"{float(text):.{max(0, len(mantissa.lstrip('-').replace('.', '')) - 1 - int(power))}f}"


def digits(value: float, count: int = 2) -> str:
    """Write a number in a sentence: few significant digits, no exponent up to fifteen zeros.

    Examples
    --------
    >>> digits(110.3), digits(-0.01234), digits(2.0, 3), digits(2e-300)
    ('110', '-0.012', '2', '2e-300')
    """
    return number(value, count, "never")


def micrometres(value: float) -> str:
    """Write a displacement with three significant digits.

    Examples
    --------
    >>> micrometres(0.012345), micrometres(-3.0), micrometres(12345.6)
    ('0.0123 µm', '-3 µm', '12300 µm')
    >>> micrometres(float("inf"))
    'no finite error'
    """
    return f"{digits(value, 3)} µm" if math.isfinite(value) else "no finite error"


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


def guess(name: str, known: Iterable[str]) -> str:
    """Ask whether a known name was meant, where one is close; else nothing.

    Examples
    --------
    >>> guess("crep", ["creep", "delay"]), guess("x", ["creep", "delay"])
    ("did you mean 'creep'?", '')
    """
    close = get_close_matches(name, list(known), 1)
    return f"did you mean {close[0]!r}?" if close else ""


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
