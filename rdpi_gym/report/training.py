"""A training: error, cost, command variation and time over its steps, as picture and page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

from rdpi_gym.report.chart import Axis, Chart, Level, Mark, Panel, Series
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import INK, MUTED, PALETTE

_HELD_OUT = "policy, held-out plants"
_STEPS = "environment steps"


def training_picture(curve: pd.DataFrame, compensator: str, kept_at: float | None) -> bytes:
    """Draw error, cost, command variation and time over the steps of a training."""
    panels = [
        replace(panel, row=1 + i // 2, column=1 + i % 2, x=panel.x if i > 1 else Axis())
        for i, panel in enumerate(_panels(curve, compensator, kept_at))
    ]
    return chart_png(Chart(panels, shared="x", legend="below"), (9.0, 5.8), dpi=120)


def training_chart(curve: pd.DataFrame, compensator: str) -> Chart:
    """Draw the error on held-out plants over the steps, beside the compensator's."""
    error, *_ = _panels(curve, compensator, None)
    return Chart(
        [replace(error, title="", y=replace(error.y, label="RMSE on held-out plants (µm)"))]
    )


def write_training_page(
    path: Path | str,
    curve: pd.DataFrame,
    compensator: str,
    kept_at: float | None,
    title: str,
    answer: str,
) -> Path:
    """Write a training as a self-contained page: answer, the four courses, every evaluation."""
    dotted = Axis(f"{_STEPS}, dotted: the policy that is kept")
    sections = [
        Section(
            panel.title, text.format(compensator), Chart([replace(panel, title="", x=dotted)], 380)
        )
        for panel, text in zip(_panels(curve, compensator, kept_at), _TEXTS, strict=True)
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
    note = "Means over the held-out plants, as in training.csv. The first row is the untrained network."
    return write_page(
        path, title, answer, [*sections, Section("Every evaluation", note, None, named)]
    )


_TEXTS = (
    "Root mean square tracking error on plants and references that were never trained on. The dashed "
    "line is {}'s on the same ones.",
    "The reward with its sign turned, so that less is better: the error over the amplitude, and the "
    "price of moving the command. In training it holds exploration too.",
    "Total variation of the command over time. Above about 1.5 times that of {} it dithers or passes "
    "noise on.",
    "Time that passed until an evaluation was done, evaluations included.",
)


def _panels(curve: pd.DataFrame, compensator: str, kept_at: float | None) -> list[Panel]:
    """Return error, cost, command variation and time, in the order of their texts."""

    def line(values: pd.Series, name: str, colour: str = PALETTE[0]) -> list[Mark]:
        x, y = curve["timesteps"].to_numpy(float), values.astype(float).to_numpy()
        drawn = Series(x, y, name, colour, marker="circle", size=5.0)
        if colour == INK:
            drawn = replace(drawn, dash="dash", marker=None)
        return [drawn] if values.notna().any() else []

    kept: list[Mark] = (
        [] if kept_at is None else [Level(kept_at, "policy that is kept", MUTED, "dot", 1.6, "x")]
    )
    steps = Axis(_STEPS, powers=True)
    rival = curve["compensator_rmse_um"], curve["compensator_command_variation_V_s"]
    return [
        Panel(
            [*line(curve["rmse_um"], _HELD_OUT), *line(rival[0], compensator, INK), *kept],
            steps,
            Axis("RMSE (µm)", log=True, ticks="1-2-5"),
            "Error",
        ),
        Panel(
            [
                *line(-curve["reward"], _HELD_OUT),
                *line(-curve["training_reward"], "policy, in training", PALETTE[1]),
                *kept,
            ],
            steps,
            Axis("cost of a sample (−reward)", log=True, ticks="1-2-5"),
            "Cost",
        ),
        Panel(
            [
                *line(curve["command_variation_V_s"], _HELD_OUT),
                *line(rival[1], compensator, INK),
                *kept,
            ],
            steps,
            Axis("command variation (V/s)", log=True, ticks="1-2-5"),
            "Command variation",
        ),
        Panel(
            [*line(curve["seconds"], _HELD_OUT), *kept],
            steps,
            Axis("time (s)", from_zero=True),
            "Time",
        ),
    ]
