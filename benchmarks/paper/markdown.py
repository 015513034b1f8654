"""Pieces of a Markdown page: tables and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]], right: bool = True) -> str:
    """Write a table, its first column to the left and the others to the right, if `right`.

    Examples
    --------
    >>> print(table(["reading", "max"], [["none", "1.6"]]))
    | reading | max |
    |---|---:|
    | none | 1.6 |
    """
    rule = "|---" + ("|---:" if right else "|---") * (len(head) - 1) + "|"
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    return "\n".join([lines[0], rule, *lines[1:]])


def number(value: float, digits: int = 3) -> str:
    """Write a number with a few significant digits.

    Examples
    --------
    >>> number(0.70518), number(1e-6), number(470512.0)
    ('0.705', '1e-6', '4.71e5')
    """
    text = f"{value:.{digits}g}"
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if e else text


def seconds(value: float) -> str:
    """Write a sampling time in s as a power of ten.

    Examples
    --------
    >>> seconds(1e-3), seconds(2.5e-5)
    ('1e-3 s', '2.5e-5 s')
    """
    mantissa, _, exponent = f"{value:.3e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)} s"


def names(words: Sequence[str]) -> str:
    """Join names to an English list.

    Examples
    --------
    >>> names(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
