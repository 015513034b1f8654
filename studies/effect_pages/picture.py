"""What an effect does to a record, in a small picture for its page of text."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from rdpi_gym.report.style import (
    FALLING,
    MODEL,
    PALETTE,
    REFERENCE,
    RESIDUAL,
    RISING,
    matplotlib_style,
)
from rdpi_gym.report.thin import thin_index
from rdpi_gym.support.arrays import Array

WITHOUT, WITH, LEFT = "without it", "with it", "left after a refit"
"""Names of the lines that have the same colour in every picture."""

_COLOURS = {WITHOUT: REFERENCE, WITH: MODEL, LEFT: RESIDUAL, "rising": RISING, "falling": FALLING}
_SPARE = (RESIDUAL, PALETTE[4], PALETTE[2])
_SIZE_IN, _DPI = (7.6, 2.9), 110
_SAMPLES = 1200


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a panel: its name in the legend, and float64[N] each way."""

    name: str
    x: Array
    y: Array


@dataclass(frozen=True)
class Panel:
    """One panel of a picture.

    Parameters
    ----------
    title
        What is seen.
    x_label, y_label
        With their units.
    lines
        In the order in which they are drawn.
    log_x
        Whether the horizontal axis is logarithmic.
    from_zero
        Whether the vertical axis begins at zero.
    """

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log_x: bool = False
    from_zero: bool = False


def effect_picture(panels: Sequence[Panel]) -> bytes:
    """Draw panels side by side."""
    style: Any = matplotlib_style()
    with rc_context(style):
        figure = Figure(figsize=_SIZE_IN, layout="constrained")
        for axes, panel in zip(
            figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
        ):
            _draw(axes, panel)
        stream = io.BytesIO()
        # no version of the library in the file: the same result is the same picture
        figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return stream.getvalue()


def _draw(axes: Any, panel: Panel) -> None:
    spare = iter(_SPARE)
    for line in panel.lines:
        shown = thin_index(line.y, samples=_SAMPLES)
        colour = _COLOURS.get(line.name) or next(spare)
        axes.plot(line.x[shown], line.y[shown], color=colour, label=line.name)
    if panel.log_x:
        axes.set_xscale("log")
    if panel.from_zero:
        axes.set_ylim(0.0, 1.1 * max(float(np.max(line.y)) for line in panel.lines))
    axes.set_title(panel.title, loc="left")
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    if len(panel.lines) > 1:
        axes.legend(handlelength=1.4, frameon=True, framealpha=0.85, edgecolor="none")
