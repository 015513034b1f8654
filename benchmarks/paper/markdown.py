"""Numbers, sampling times and tables as the paper's page writes them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rdpi_gym.support import markdown, words


def table(head: Sequence[str], rows: Iterable[Sequence[str]], right: bool = True) -> str:
    """Write a table, its first column to the left and the others to the right, if `right`."""
    return markdown.table(head, rows, range(1, len(head)) if right else ())


def number(value: float, digits: int = 3) -> str:
    """Write a number with a few significant digits."""
    return words.number(value, digits, "short")


def seconds(value: float) -> str:
    """Write a sampling time in s as a power of ten."""
    mantissa, _, exponent = f"{value:.3e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)} s"
