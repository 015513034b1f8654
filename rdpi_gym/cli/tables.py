"""Tables as the terminal shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rdpi_gym.support.terminal import console

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import pandas as pd

    import rdpi_gym as rg

    Found = (
        rg.FitResult
        | rg.CoreFit
        | rg.KindChoice
        | rg.Comparison
        | rg.ModelComparison
        | rg.SearchResult
    )

_MOST_ROWS = 12

_SHORT = 24  # letters of a cell that is never broken; headings are


def print_table(
    table: pd.DataFrame, title: str = "", *, lines: bool = False, width: int = 140
) -> None:
    """Print a table of texts and numbers, as a result's `overview` returns it; the headings hold the units.

    Numbers are right-aligned, with four digits. `width` (characters) holds where there is no terminal;
    `lines` part the rows.
    """
    from rich.box import HEAVY_HEAD, SIMPLE
    from rich.table import Table

    shown = Table(
        title=title or None,
        title_justify="left",
        box=HEAVY_HEAD if lines else SIMPLE,
        show_lines=lines,
    )
    cells = [
        [f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in table[name]]
        for name in table.columns
    ]
    for name, kind, column in zip(table.columns, table.dtypes, cells, strict=True):
        shown.add_column(
            str(name),
            justify="right" if kind.kind in "iuf" else "left",
            min_width=widest if (widest := max(map(len, column), default=0)) <= _SHORT else None,
        )
    for row in zip(*cells, strict=True):
        shown.add_row(*row)
    console(width=width).print(shown)


def print_result(
    result: Found,
    records: rg.Dataset,
    written: Sequence[Path],
    verbose: bool,
    title: str = "",
    further: Sequence[str] = (),
) -> None:
    """Print the answer, what supports it, a table, and the file written last; all there is if `verbose`.

    `further` are lines of the latter alone, beside the records and every file that was written.
    """
    if verbose:
        print(result)
        print_table(result.overview(), title)
        print(*further, records.describe(), "", *written, sep="\n")
        return
    print(*filter(None, [*result.summary_lines(), records.units_assumed]), sep="\n")
    table = result.brief()
    print_table(table.head(_MOST_ROWS), title)
    more = len(table) - _MOST_ROWS
    print(f"{written[-1]}{f' and --verbose have {more} more rows' if more > 0 else ''}")
