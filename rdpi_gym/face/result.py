"""What every result of the face can do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

if TYPE_CHECKING:
    import pandas as pd


@runtime_checkable
class Result(Protocol):
    """A result: it prints itself, draws itself, becomes a table, a page or a file.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> isinstance(rg.simulate("P5", seed=1, ts_factor=4.0), Result)
    True
    """

    def _repr_html_(self) -> str:
        """HTML of a notebook's cell: the answer, a table, a figure."""
        ...

    def plot(self) -> Any:
        """Draw the result and return Matplotlib's axes."""
        ...

    def to_dataframe(self) -> pd.DataFrame:
        """Return the result as a table."""
        ...

    def page(self, path: Path | str) -> Path:
        """Write the result as a self-contained HTML page and return its path."""
        ...

    def save(self, path: Path | str) -> Path:
        """Write the result to a file from which it can be loaded, and return its path."""
        ...
