"""A study's table as it is kept: CSV to compute with, Markdown to read."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from rdpi_gym.support.files import write_atomic


def keep_table(folder: Path, name: str, table: pd.DataFrame, text: str) -> None:
    """Write a table as CSV and its page as Markdown, both under one name, and print the page.

    Parameters
    ----------
    folder
        That is written to.
    name
        Of the study.
    table
        Its rows.
    text
        The page.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     keep_table(Path(folder), "speed", pd.DataFrame({"ns": [1.23456]}), "# Speed")
    ...     (Path(folder) / "speed.csv").read_text().split()  # doctest: +ELLIPSIS
    # Speed
    written to ...
    ['ns', '1.235']
    """
    csv = table.to_csv(index=False, float_format="%.4g", lineterminator="\n")
    write_atomic(folder / f"{name}.csv", csv)
    print(text, f"written to {write_atomic(folder / f'{name}.md', text)}", sep="\n")
