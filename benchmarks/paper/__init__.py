"""The paper's figures and numbers, recomputed for each reading of its Eq. 6."""

from benchmarks.paper.claims import paper_cases
from benchmarks.paper.run import (
    COLUMNS,
    PaperResults,
    implementation_rows,
    paper_rows,
    reproduce_paper,
    sweep_rows,
    to_csv,
)
from benchmarks.paper.text import paper_markdown

__all__ = [
    "COLUMNS",
    "PaperResults",
    "implementation_rows",
    "paper_cases",
    "paper_markdown",
    "paper_rows",
    "reproduce_paper",
    "sweep_rows",
    "to_csv",
]
