"""What a training leaves to look at: its curve as one picture, and as a page."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator, StrMethodFormatter

from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import INK, MUTED, PALETTE, figure_text, matplotlib_style, styled

_HELD_OUT = "policy, held-out plants"


@dataclass(frozen=True)
class _Line:
    """One line of a panel: a column of the curve, and what a reader calls it."""

    column: str
    label: str
    colour: str
    dash: bool = False


@dataclass(frozen=True)
class _Panel:
    title: str
    axis: str
    text: str
    lines: tuple[_Line, ...]
    is_logarithmic: bool = True


def training_picture(curve: pd.DataFrame, compensator: str, kept_at: float | None) -> bytes:
    """Draw error, cost, command variation and time over the steps of a training."""
    curve = _with_costs(curve)
    style: Any = matplotlib_style()
    with rc_context(style):
        figure = Figure(figsize=(9.0, 5.8), layout="constrained")
        grid = figure.subplots(2, 2, sharex=True).flat
        for axes, panel in zip(grid, _panels(compensator), strict=True):
            for line in panel.lines:
                y = curve[line.column]
                if y.notna().any():
                    axes.plot(
                        curve["timesteps"], y, color=line.colour, label=line.label,
                        linestyle="--" if line.dash else "-", marker="" if line.dash else "o",
                        markersize=3.0,
                    )  # fmt: skip
            if kept_at is not None:
                axes.axvline(kept_at, color=MUTED, linestyle=":", label="policy that is kept")
            if panel.is_logarithmic:
                axes.set_yscale("log", nonpositive="clip")
                axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axes.yaxis.set_minor_locator(NullLocator())
                axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            else:
                axes.set_ylim(bottom=0.0)
            axes.set_title(panel.title, loc="left")
            axes.set_ylabel(panel.axis)
            axes.xaxis.set_major_formatter(EngFormatter())
        for axes in figure.axes[2:]:
            axes.set_xlabel("environment steps")
        found = (axes.get_legend_handles_labels() for axes in figure.axes)
        handles = {label: handle for pair in found for handle, label in zip(*pair, strict=True)}
        figure.legend(
            list(handles.values()), list(handles), loc="outside lower center", ncols=len(handles)
        )
        stream = io.BytesIO()
        # no version of the library in the file: the same result is the same picture
        figure.savefig(stream, format="png", dpi=120, metadata={"Software": None})
    return stream.getvalue()


def write_training_page(
    path: Path | str,
    curve: pd.DataFrame,
    compensator: str,
    kept_at: float | None,
    title: str,
    answer: str,
) -> Path:
    """Write a training as a self-contained page: answer, the four courses, every evaluation."""
    curve = _with_costs(curve)
    sections = [
        Section(panel.title, panel.text, _figure(panel, curve, kept_at))
        for panel in _panels(compensator)
    ]
    table = curve[["timesteps", "seconds", "rmse_um", "rmse_percent", "reward"]].assign(
        variation=curve["command_variation_V_s"] / curve["compensator_command_variation_V_s"]
    )
    named = table.rename(
        columns={
            "timesteps": "Steps", "seconds": "Time (s)", "rmse_um": "RMSE (µm)",
            "rmse_percent": "RMSE (% of peak to peak)", "reward": "Reward of a sample",
            "variation": "Command variation over the compensator's",
        }
    )  # fmt: skip
    said = "Means over the held-out plants, as in training.csv. The first row is the untrained network."
    return write_page(
        path, title, answer, [*sections, Section("Every evaluation", said, None, named)]
    )


def _panels(compensator: str) -> tuple[_Panel, ...]:
    blue, orange = PALETTE[:2]
    return (
        _Panel(
            "Error",
            "RMSE (µm)",
            f"Root mean square tracking error on plants and references that were never trained on. The "
            f"dashed line is {compensator}'s on the same ones.",
            (
                _Line("rmse_um", _HELD_OUT, blue),
                _Line("compensator_rmse_um", compensator, INK, dash=True),
            ),
        ),
        _Panel(
            "Cost",
            "cost of a sample (−reward)",
            "The reward with its sign turned, so that less is better: the error over the amplitude, and "
            "the price of moving the command. In training it holds exploration too.",
            (
                _Line("cost", _HELD_OUT, blue),
                _Line("training_cost", "policy, in training", orange),
            ),
        ),
        _Panel(
            "Command variation",
            "command variation (V/s)",
            f"Total variation of the command over time. Above about 1.5 times that of {compensator} it "
            "dithers or passes noise on.",
            (
                _Line("command_variation_V_s", _HELD_OUT, blue),
                _Line("compensator_command_variation_V_s", compensator, INK, dash=True),
            ),
        ),
        _Panel(
            "Time",
            "time (s)",
            "Time that passed until an evaluation was done, evaluations included.",
            (_Line("seconds", _HELD_OUT, blue),),
            is_logarithmic=False,
        ),
    )


def _with_costs(curve: pd.DataFrame) -> pd.DataFrame:
    return curve.assign(
        cost=-curve["reward"].astype(float), training_cost=-curve["training_reward"].astype(float)
    )


def _figure(panel: _Panel, curve: pd.DataFrame, kept_at: float | None) -> Any:
    figure = go.Figure()
    for line in panel.lines:
        y = curve[line.column].to_numpy(float)
        if not np.isfinite(y).any():
            continue
        figure.add_scatter(
            x=curve["timesteps"], y=y, name=figure_text(line.label),
            mode="lines" if line.dash else "lines+markers",
            line={"color": line.colour, "dash": "dash" if line.dash else "solid"},
        )  # fmt: skip
    if kept_at is not None:
        figure.add_vline(x=kept_at, line={"color": MUTED, "dash": "dot"})
    figure.update_xaxes(title="environment steps, dotted: the policy that is kept")
    figure.update_yaxes(title=panel.axis)
    if panel.is_logarithmic:
        figure.update_yaxes(type="log", dtick="D2")  # 1, 2 and 5 are named
    figure.update_layout(showlegend=len(panel.lines) > 1)
    return styled(figure, height_px=380)
