"""Markdown: the one writer of tables, and the marks taken out again."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Literal

from rdpi_gym.support.words import number

if TYPE_CHECKING:
    import pandas as pd

LEADING_ROWS = 8
"""Rows of a ranking that a page, a figure or the terminal shows; the file beside it holds the others."""

Rule = Literal["aligned", "plain", "tight"]
_RULES: dict[Rule, tuple[str, str, str, str]] = {
    "aligned": (":--", "--:", "| ", " | "),
    "plain": ("---", "---", "| ", " | "),
    "tight": ("---", "--:", "|", "|"),
}


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    right: Iterable[int] = (),
    rule: Rule = "aligned",
) -> str:
    r"""Write a table."""
    at_left, at_right, edge, bar = _RULES[rule]
    rights = set(right)
    sides = bar.join(at_right if i in rights else at_left for i in range(len(head)))
    lines = [_line(head), f"{edge}{sides}{edge[::-1]}", *map(_line, rows)]
    return "\n".join(lines)


def frame_table(frame: pd.DataFrame, digits: int | None = 3, rule: Rule = "aligned") -> str:
    """Write a data frame of strings and numbers."""
    from pandas.api.types import is_numeric_dtype

    head = list(map(str, frame.columns))
    if digits is None:
        return table(head, [[str(x) for x in row] for row in frame.to_numpy()], rule=rule)
    right = [i for i, kind in enumerate(frame.dtypes) if is_numeric_dtype(kind)]
    rows = [
        [number(x, digits) if isinstance(x, float) else str(x) for x in row]
        for row in frame.itertuples(index=False)
    ]
    return table(head, rows, right, rule)


def leading(
    frame: pd.DataFrame, own: Collection[str] = (), most: int = LEADING_ROWS
) -> pd.DataFrame:
    """Return the first rows of a ranking, and those of a user's own controllers wherever they stand."""
    names = frame["controller"] if own else [""] * len(frame)
    return frame[[k < most or name in own for k, name in enumerate(names)]]


def leading_rows(
    frame: pd.DataFrame,
    file: str,
    digits: int | None = 3,
    most: int = LEADING_ROWS,
    own: Collection[str] = (),
) -> str:
    """Write the leading rows of a data frame, and the file that holds all of them."""
    shown = leading(frame, own, most)
    text = frame_table(shown, digits)
    if len(shown) == len(frame):
        return text
    yours = ", and yours" if len(shown) > most else ""
    return f"{text}\n\nThe first {most} of {len(frame)} rows of `{file}`{yours}."


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def plain(markdown: str) -> str:
    """Return Markdown without its marks of emphasis and code."""
    return markdown.replace("**", "").replace("`", "")
