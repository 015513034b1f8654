"""The payoff of knowing an effect in one picture."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from rdpi_gym.report.payoff.figures import BELIEF_COLOURS
from rdpi_gym.report.style import MUTED, PALETTE, matplotlib_style

_MARKERS = {"bare": "o", "fitted": "s", "discovered": "D", "true": "|"}


def payoff_picture(summary: pd.DataFrame) -> bytes:
    """Draw the error of each compensator by belief, one panel a compensator.

    A line joins the fitted to the discovered belief, with the factor by which the error falls.
    """
    style: Any = matplotlib_style()
    controllers = list(dict.fromkeys(summary["controller"]))
    plants = list(dict.fromkeys(summary["plant"]))
    with rc_context(style):
        figure = Figure(figsize=(3.0 + 2.9 * len(controllers), 1.7 + 0.5 * len(plants)))
        figure.set_layout_engine("constrained")
        panels = figure.subplots(1, len(controllers), sharey=True, squeeze=False)[0]
        for axes, controller in zip(panels, controllers, strict=True):
            rows = summary[summary["controller"] == controller].set_index("plant").loc[plants]
            _draw(axes, rows)
            axes.set_title(controller, loc="left")
            axes.set_xlabel("RMSE (% of peak to peak)")
        panels[0].set_yticks(np.arange(len(plants)), [_short(name) for name in plants])
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        stream = io.BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def _draw(axes: Any, rows: pd.DataFrame) -> None:
    place = np.arange(len(rows))
    beliefs = [name for name in BELIEF_COLOURS if name in rows.columns]
    every = rows[beliefs].to_numpy(dtype=np.float64)
    axes.set_xscale("log")
    axes.set_xlim(0.5 * np.nanmin(every), 3.0 * np.nanmax(every))
    axes.set_ylim(-0.5, len(rows) - 0.5)
    right = axes.get_xlim()[1]
    for name, colour in BELIEF_COLOURS.items():
        if name not in beliefs:
            continue
        size = 160 if _MARKERS[name] == "|" else 42
        axes.scatter(
            rows[name], place, marker=_MARKERS[name], s=size, c=colour, label=name, zorder=3
        )
    for y, row in enumerate(rows.to_dict("records")):
        if row["diverged"]:
            label = f"{row['diverged']}: diverged "
            axes.text(right, y, label, ha="right", va="center", color=PALETTE[1], fontsize=8)
            continue
        ends = [row["fitted"], row["discovered"]]
        axes.plot(ends, [y, y], color=MUTED, linewidth=1.0, zorder=1)
        fall = f"÷ {row['fall_from_fitted']:.3g}"
        axes.text(
            np.sqrt(ends[0] * ends[1]), y - 0.08, fall, ha="center", va="bottom", fontsize=8,
            color=MUTED,
        )  # fmt: skip


def _short(plant: str) -> str:
    return plant.replace(" with ", "\nwith ", 1)
