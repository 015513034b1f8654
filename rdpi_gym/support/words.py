"""Numbers, values, names and lists, as tables and sentences write them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from reprlib import Repr
from typing import Literal

_WIDTH = 60
_MOST_ZEROS = 15  # that a number without exponent is written with: more are not counted at a glance
_QUOTE = Repr()
_QUOTE.maxstring = _QUOTE.maxother = _QUOTE.maxlong = _WIDTH
_QUOTE.maxlist = _QUOTE.maxtuple = 6
_QUOTE.maxlevel = 2


Exponent = Literal["never", "rare", "short", "usual"]


def number(value: float, count: int = 3, exponent: Exponent = "rare") -> str:
    """Write a number with some significant digits; a dash where there is none."""
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
    """Write a number in a sentence: few significant digits, no exponent up to fifteen zeros."""
    return number(value, count, "never")


def micrometres(value: float) -> str:
    """Write a displacement with three significant digits."""
    return f"{digits(value, 3)} µm" if math.isfinite(value) else "no finite error"


def joined(names: Sequence[str]) -> str:
    """Write a list of names in words."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def closed(sentence: str) -> str:
    """End a sentence with a full stop where it has none."""
    return sentence if sentence.rstrip().endswith((".", "!", "?")) else f"{sentence}."


def capital(sentence: str) -> str:
    """Begin a sentence with a capital letter, but for one that begins with a symbol, as a_2 or δ2."""
    is_word = sentence[:2].strip().isalpha()
    return sentence[:1].upper() + sentence[1:] if is_word else sentence


def first_sentence(text: str) -> str:
    """Return a text up to its first full stop before a capital letter."""
    return re.split(r"(?<=[.!?]) (?=[A-Z])", text, maxsplit=1)[0]


def pm(value: float, error: float) -> str:
    """Write a value with its standard error."""
    return f"{digits(value)} ± {digits(error, 1)}" if math.isfinite(error) else "unknown"


def guess(name: object, known: Iterable[str]) -> str:
    """Ask whether a known name was meant, where one is close; else nothing."""
    close = get_close_matches(str(name), list(known), 1)
    return f"did you mean {close[0]!r}?" if close else ""


def quoted(value: object) -> str:
    """Show what a file or a caller gave, for an error line: on one line, short, however long it is.

    Examples
    --------
    >>> quoted("ten"), quoted(0.5), quoted(list(range(100)))
    ("'ten'", '0.5', '[0, 1, 2, 3, 4, 5, ...]')
    """
    try:
        return short(" ".join(_QUOTE.repr(value).split()))
    except Exception:  # a whole number of thousands of digits, or a foreign object's own fault
        return f"a {type(value).__name__}"


def some(names: Iterable[object], count: int = 8) -> str:
    """List names for an error line: the first few, and how many more there are."""
    listed = list(names)
    shown = ", ".join(short(str(name)) for name in listed[:count])
    return f"{shown} and {len(listed) - count} more" if len(listed) > count else shown


def short(text: str) -> str:
    """Cut a name for an error line."""
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."
