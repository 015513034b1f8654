"""What the paper's figures share: sheets, panel titles, legends, one style a reading."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rdpi_gym.report.style import INK, PALETTE, REFERENCE

WIDTH_IN = 9.0
BLUE, RED, GREEN, PINK, ORANGE, SKY, GREY = PALETTE
STYLES: dict[str, dict[str, Any]] = {
    "none": {"color": REFERENCE, "ls": "-"},
    "literal": {"color": RED, "ls": "-"},
    "given": {"color": BLUE, "ls": "-"},
    "low-passed in both": {"color": SKY, "ls": (0, (5, 3))},
    "low-passed": {"color": GREEN, "ls": "-"},
    "reference-rate/A": {"color": PINK, "ls": "-"},
    "closed-form reference-rate/A": {"color": ORANGE, "ls": (0, (4, 1.5))},
    "closed-form reference-rate": {"color": GREY, "ls": (0, (4, 1.5))},
    "closed-form own-rate": {"color": INK, "ls": (0, (1, 1.2))},
}
"""Colour and line of each reading, the same in every figure."""


def sheet(
    rows: int, columns: int, height_in: float, width_in: float = WIDTH_IN, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure and its axes, always as an array of `rows` by `columns`."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def title_panel(axes: Axes, letter: str, title: str) -> None:
    """Title a panel at its left, with its letter if it has one."""
    axes.set_title(f"({letter})  {title}" if letter else title, loc="left")


def legend_below(figure: Figure, columns: int) -> None:
    """Put one legend of everything labelled in the figure under its axes."""
    found: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(
        list(found.values()),
        list(found),
        loc="outside lower center",
        ncols=columns,
        handlelength=2.6,
    )


def write_seconds(ts_s: float) -> str:
    """Write a sampling time for a figure: as a power of ten where it is one, else in µs."""
    exponent = np.log10(ts_s)
    if abs(exponent - round(exponent)) < 1e-6:
        return f"$T_s = 10^{{{round(exponent)}}}$ s"
    return f"$T_s$ = {1e6 * ts_s:g} µs"
