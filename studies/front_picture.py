"""Picture of the front page: model against measurement, the effect that is missing, and the error falling.

The record is the measured stack that ships, ``rg.example("picma")``. No number is drawn.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import rdpi_gym as rg
from rdpi_gym.report.chart import Axis, Bars, Level, Note, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import FALLING, INK, MEASURED, MODEL, RESIDUAL, RISING
from rdpi_gym.support.command import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.words import number
from studies.chromium import small_png

OUT = Path("docs")
FILE = "front.png"
EFFECT = "asymmetry"
_SAMPLES = 400  # the last of the validation record: two cycles
_INCHES = (12.0, 3.9)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the picture."""
    return Options("front_picture", __doc__, out=OUT).run(arguments, _run)


def _run(options: Namespace) -> None:
    data = rg.example("picma")
    picture = small_png(front_picture(rg.add(EFFECT, data, rg.fit(data, plays=3))))
    print(f"picture: {write_atomic(options.out / FILE, picture)}")


def front_picture(found: rg.SearchResult) -> bytes:
    """Draw a discovery's last validation record, its residuals, and the errors of its models."""
    view = next(each for each in found.views if each.role == "validation")
    shown = slice(-_SAMPLES, None)
    u, y = view.u_V[shown], view.y_um[shown]
    before, after = (
        np.asarray(view.models_um[name])[shown] for name in _ends(list(view.models_um))
    )
    volts, micrometres = "Command (V)", "Displacement (µm)"
    loops = Panel(
        [
            Series(u, y, "measured", MEASURED, width=3.0),
            Series(u, after, "model", MODEL, width=1.5),
        ],
        Axis(volts), Axis(micrometres), "Model against measurement",
    )  # fmt: skip
    left = Panel(
        [
            Series(u, y - before, "residual without the effect", RISING, width=1.2),
            Series(u, y - after, "with it", FALLING, width=1.2),
        ],
        Axis(volts), Axis("Measured − model (µm)"), f"The missing effect: {EFFECT}",
    )  # fmt: skip
    errors = (found.given, found.base, found.final)
    heights = [each.validation_rmse_um for each in errors if each is not None]
    names = ["RDPI model,\n3 plays", "thresholds\nfree", f"with\n{EFFECT}"][-len(heights) :]
    floor = Level(found.noise_floor_um, f"noise {number(found.noise_floor_um, 2)} µm", RESIDUAL)
    fall = Panel(
        [
            Bars(names, heights, "", [RISING, RISING, FALLING][-len(heights) :], horizontal=False,
                 width=0.6),
            floor,
            *(Note(name, each, f"{number(each, 2)} µm", INK, "center", 9.0)
              for name, each in zip(names, heights, strict=True)),
        ],
        Axis(categories=names), Axis("Validation error (µm rms)"), "The error falls",
    )  # fmt: skip
    return chart_png(side_by_side([loops, left, fall], legend="below"), _INCHES)


def _ends(labels: Sequence[str]) -> tuple[str, str]:
    first, *_, last = labels
    return first, last


if __name__ == "__main__":
    sys.exit(main())
