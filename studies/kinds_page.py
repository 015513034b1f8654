"""The page of the kinds of hysteresis, from what their files declare: `python -m studies.kinds_page`.

The picture shows, for each kind, a large loop with small ones inside it.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from itertools import pairwise
from pathlib import Path

import numpy as np

from rdpi_gym.measurement import stated_quantities
from rdpi_gym.plant import CORES, MEASURED, Plant, PlantModel, named_plant
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.report.chart import Axis, Chart, Panel, Series
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.markdown import table
from studies.chromium import small_png
from studies.runner import Files, Study

OUT = Path(__file__).parents[1] / "docs"
PAGE, PICTURE = "kinds-of-hysteresis.md", "kinds-of-hysteresis.png"
_MAKER = "python -m studies.kinds_page"
_TS_S, _COLUMNS = 1e-3, 3
_SCALE = DataScale(
    centre_V=0.0, span_V=20.0, stroke_um=20.0, fastest_V_s=200.0, shortest_s=_TS_S, longest_s=6.0
)


def _files(options: Namespace) -> Files:
    return {PAGE: page_text(), PICTURE: small_png(_picture())}


def page_text() -> str:
    """Return the page."""
    kinds = CORES.values()
    overview = table(
        ["name", "kind", "loops turn", "small loops", "depends on the rate"],
        [
            [
                f"[`{kind.name}`](#{kind.name})",
                kind.title,
                {True: "clockwise", False: "counter-clockwise", None: "either way"}[kind.clockwise],
                "close and are forgotten" if kind.wipes_out else "leave a trace",
                "yes" if kind.rated else "no",
            ]
            for kind in kinds
        ],
    )
    return (
        "# Kinds of hysteresis\n\n"
        f"The middle of a plant's chain is one of {len(CORES)} hysteresis cores; whatever stands before and behind "
        "it, from the amplifier's lag to the sensor's noise, goes with any of them. `rdpi fit DATA --core NAME` fits "
        "one to a measurement, and `--core auto` fits all of them, each beside a creep and a lag, where much is left beside a backlash or a resonance too, and chooses by the held-out error; in Python these are `rg.fit_core` and `rg.choose_kind`. The controller `core-inverse` undoes any. "
        "The RDPI model has more: standard errors of every weight, the paper's compensators, the search for missing "
        "effects.\n\n"
        f"{overview}\n\n"
        f"![One large loop with small ones inside, by each kind]({PICTURE})\n\n"
        "*One command for all: triangles over the whole range with small loops on both branches. Each kind stands "
        "where its fits begin.*\n\n"
        + "\n".join(_section(kind) for kind in kinds)
        + f"\n{_plants()}\nMade from "
        f"`rdpi_gym/plant/cores` and the plants' files by `{_MAKER}`.\n"
    )


def _section(kind: type[Core]) -> str:
    numbers = (
        table(
            ["number", "unit", "bounds", "meaning"],
            [[f"`{p.name}`", p.unit, _bounds(p), p.meaning] for p in kind.shape],
        )
        if kind.shape
        else "No number beside its gains and the fixed thresholds or levels that they stand at.\n"
    )
    return (
        f"## {kind.name}\n\n{kind.title[0].upper()}{kind.title[1:]}: `{kind.equation}`.\n\n"
        f"**Met in:** {kind.hardware}\n\n**What gives it away:** {kind.signature}\n\n"
        f"**What shows it best:** {kind.experiment}\n\n{numbers}\n\n*Source: {kind.source}*\n"
    )


def _plants() -> str:
    """Return the section of the plants that state what record they are from."""
    plants = [plant for plant in map(named_plant, MEASURED) if "source" in plant.identification]
    rows, sources = [], {}
    for plant in plants:
        stated, told = plant.identification, stated_quantities(plant.identification)
        low, high = plant.command_range_V
        held = stated.get("held_out_rmse_um")
        share = (
            ""
            if held is None
            else f" ({50.0 * held / plant.reference_um[1]:.2g} % of a reference's stroke)"
        )
        rows.append(
            [
                f"`{plant.name}`",
                ", ".join([plant.hysteresis.name, *(effect.name for effect in plant.effects)]),
                f"{low:.4g} to {high:.4g} {told.input.unit}",
                "as published" if held is None else f"{held:.3g} {told.output.unit}{share}",
            ]
        )
        licence = f" ({stated['licence']})" if "licence" in stated else ""
        sources[plant.name.partition("-")[0]] = f"{stated['source']}{licence}"
    return (
        "## Plants of measured and published records\n\n"
        "Names that `rdpi simulate --model`, `rdpi bench --plants`, `rdpi compare --model` and "
        '`gymnasium.make("rdpi_gym/PiezoTracking-v0", plant=...)` take. Truth and belief of unlike cores show what a '
        "wrong kind of hysteresis costs. Held out is the rms error on records that were not fitted. The stack's plants "
        "have a creep and a lag beside the core; its record has 1 Hz alone, and what they do at other rates is "
        "extrapolated.\n\n"
        + table(["plant", "core and effects", "commands", "held out"], rows)
        + "\n\n"
        + "\n".join(f"- `{name}`: {source}." for name, source in sources.items())
        + "\n\nThe stack's records ship, the damper's do not: `python -m studies.core_plants` makes the files again, "
        "the damper's from records in `$RDPI_DATA`.\n"
    )


def _bounds(parameter: Parameter) -> str:
    return f"{parameter.low:g} to {parameter.high:g}"


def _command() -> Array:
    turns = [0.0, 20.0, -20.0, 20.0, 8.0, 14.0, 2.0, 8.0, -20.0, -8.0, -14.0, 0.0]
    legs = [np.linspace(a, b, 400)[1:] for a, b in pairwise(turns)]
    return np.concatenate(legs)


def _picture() -> bytes:
    u = _command()
    panels = []
    for place, kind in enumerate(CORES.values()):
        core = kind.starts(_SCALE)[-1]
        model = PlantModel(core, "shown", (-25.0, 25.0), (0.0, 10.0))
        y = Plant(model, _TS_S * 20.0).simulate(u)
        row, column = divmod(place, _COLUMNS)
        panels.append(
            Panel(
                [Series(u, y)], Axis("Command (V)"), Axis("Displacement (µm)"), kind.name, row + 1,
                column + 1,
            )
        )  # fmt: skip
    return chart_png(Chart(panels), (9.0, 2.8 * panels[-1].row), 110)


main = Study("kinds_page", __doc__, _files, OUT)

if __name__ == "__main__":
    sys.exit(main())
