"""Display of results: printing, a notebook's cell, axes, files."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

from rdpi_gym.measurement import Quantities
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import capital

if TYPE_CHECKING:
    import pandas as pd

    from rdpi_gym.report.chart import Chart


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


def draw(chart: Chart, inches: tuple[float, float], fill: Callable[[str], str] = str) -> Any:
    """Draw a chart in a figure of its own; return Matplotlib's axes."""
    import matplotlib.pyplot as plt

    from rdpi_gym.report.chart_matplotlib import draw_chart
    from rdpi_gym.report.style import matplotlib_style

    style: Any = matplotlib_style()
    with plt.rc_context(style):
        return draw_chart(plt.figure(figsize=inches, layout="constrained"), chart, fill)


_ROWS = 40
"""Rows of a table that a notebook's cell shows."""


class DisplayMixin:
    """Display of a result: a subclass states its lines, its table and its chart.

    A subclass is a frozen dataclass of one of the rooms below, this class before it among its bases.
    """

    saved_as: ClassVar[str]
    """Names the class in a file."""
    figure_inches: ClassVar[tuple[float, float]] = (9.0, 3.6)

    @classmethod
    def of(cls, found: Any, **further: Any) -> Self:
        """Return a result of a room below, or of a class derived from this, as one that displays itself."""
        names = [field.name for field in fields(cls) if hasattr(found, field.name)]  # type: ignore[arg-type]
        return cls(**{name: getattr(found, name) for name in names} | further)

    def _lines(self) -> Sequence[str]:
        """Return the result in lines, the answer first."""
        raise NotImplementedError

    def _evidence(self) -> Sequence[str]:
        """Return at most three sentences that support the answer."""
        return [capital(line.removeprefix("- ")) for line in self._lines()[1:4]]

    def summary_lines(self) -> list[str]:
        """Return the answer, and at most three sentences that support it."""
        return list(map(self._quantities().fill, [self._lines()[0], *self._evidence()]))

    def overview(self) -> pd.DataFrame:
        """Return the table that a notebook shows: units in headings or cells."""
        raise NotImplementedError

    def brief(self) -> pd.DataFrame:
        """Return the rows and columns of :meth:`overview` that support the answer, the first ones first."""
        return self.overview()

    def _chart(self) -> Chart:
        """Return the chart that a notebook's cell and :meth:`plot` show."""
        raise NotImplementedError

    def _quantities(self) -> Quantities:
        found = getattr(self, "quantities", None)
        return found if isinstance(found, Quantities) else Quantities()

    def __repr__(self) -> str:
        return "\n".join(map(self._quantities().fill, self._lines()))

    def _repr_html_(self) -> str:
        first, *rest = map(self._quantities().fill, self._lines())
        parts = [f"<p><strong>{escape(first)}</strong></p>"]
        if rest:
            parts.append(f"<pre>{escape(chr(10).join(rest))}</pre>")
        parts.append(self.overview().to_html(index=False, escape=True, max_rows=_ROWS, border=0))
        picture = base64.b64encode(self._png()).decode()
        parts.append(f'<img alt="{escape(first)}" src="data:image/png;base64,{picture}">')
        return f"<div>{''.join(parts)}</div>"

    def _png(self) -> bytes:
        from rdpi_gym.report.chart_matplotlib import chart_png

        return chart_png(self._chart(), self.figure_inches, 100, self._quantities().fill)

    def plot(self) -> Any:
        """Draw the result.

        Returns
        -------
        matplotlib.axes.Axes, or an array of them
            In a figure of their own, which a notebook shows; ``matplotlib.pyplot.show()`` does
            elsewhere.
        """
        return draw(self._chart(), self.figure_inches, self._quantities().fill)

    def _table_in_units(self, frame: pd.DataFrame, *columns: str) -> pd.DataFrame:
        """Fill the headings of a table, and the cells of columns, with the quantities of the result."""
        fill = self._quantities().fill
        for name in columns:
            frame[name] = [fill(cell) for cell in frame[name]]
        return frame.rename(columns={name: fill(str(name)) for name in frame.columns})

    def save(self, path: Path | str) -> Path:
        """Write the result to one file: arrays, and JSON for everything else.

        Parameters
        ----------
        path
            Ends in ``.npz``.

        Returns
        -------
        Path
            The path written; :meth:`load` and :func:`rdpi_gym.load_result` read it back.

        Raises
        ------
        InputError
            Another ending, or the file cannot be written.
        """
        from rdpi_gym.face.saving import write_result

        return write_result(path, self.saved_as, self)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a result of this kind that :meth:`save` wrote; nothing in the file is run.

        Raises
        ------
        InputError
            The file is missing, damaged, no result, or a result of another kind.
        """
        from rdpi_gym.face.saving import read_result

        found = read_result(path, {cls.saved_as: cls})
        if not isinstance(found, cls):
            raise InputError(f"{path} holds a {type(found).__name__}, no {cls.__name__}")
        return found
