"""A study's table as it is kept: CSV to compute with, Markdown to read."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from rdpi_gym.support.files import write_atomic


def keep_table(folder: Path, name: str, table: pd.DataFrame, text: str) -> None:
    """Write a table as CSV and its page as Markdown, both under one name, and print the page."""
    csv = table.to_csv(index=False, float_format="%.4g", lineterminator="\n")
    write_atomic(folder / f"{name}.csv", csv)
    print(text, f"written to {write_atomic(folder / f'{name}.md', text)}", sep="\n")
