"""The payoff in tables, text and charts: error of each compensator by belief."""

from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.payoff.scores import BELIEFS, HIDDEN_PLANTS, NOISE_UM, PREVIEW, TS_S, HiddenPlant
from benchmarks.rows import paragraphs
from benchmarks.tracking.episode import DIVERGED, ERROR, shown_error, words
from benchmarks.tracking.stages import NOISE_UM as SENSOR_NOISE_UM
from rdpi_gym.envs.truth import RATE_BANDWIDTH_HZ
from rdpi_gym.report.chart import Axis, Chart, Mark, Note, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.page import Section
from rdpi_gym.report.style import INK, MUTED, PALETTE
from rdpi_gym.support.markdown import frame_table, plain
from rdpi_gym.support.words import number

METHOD = f"""\
- **Plants.** P10 with one effect or two, each at a common size; their rate is low-passed at {RATE_BANDWIDTH_HZ:g} Hz for tracking and {1e3 * SENSOR_NOISE_UM:g} nm of white noise is measured. Ts is {1e6 * TS_S:g} µs, and observations show {PREVIEW} samples of the reference ahead.
- **Beliefs.** `bare`: the true hysteresis without the effects, which no data show. `fitted`: the RDPI model of `rdpi fit`, fitted to the standard protocol of records of the plant, with {1e3 * NOISE_UM:g} nm of noise. `discovered`: the model of `rdpi discover` on the same records. `true`: the plant itself. The records are not made by the stages that are fitted: they are integrated independently on a fine grid.
- **Compensators.** `extended-inverse` undoes the effects of its belief around the classical inverse at the rate of the reference; with a belief without effects it is `classical-reference-rate`. `pi-extended-inverse` adds feedback, tuned from the belief. `preview-inversion` inverts its belief over the whole reference beforehand; with the belief `true` it is the bound.
- **Error.** RMSE of the displacement after the smooth start, in percent of the reference's peak to peak; means over the references are geometric. `diverged`: the error is larger than that of standing still.
"""


def payoff_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise the references of every plant and compensator."""
    lines = []
    for (plant, controller), rows in table.groupby(["plant", "controller"], sort=False):
        means: dict[str, float] = {}
        lost = []
        for belief in BELIEFS:
            part = rows[rows["belief"] == belief]
            if words(part["status"].tolist()) & {DIVERGED, ERROR}:
                lost.append(belief)
                means[belief] = np.nan
            else:
                means[belief] = float(np.exp(np.log(part["rmse_percent"]).mean()))
        lines.append(
            {
                "plant": plant,
                "controller": controller,
                **means,
                "fall_from_bare": means["bare"] / means["discovered"],
                "fall_from_fitted": means["fitted"] / means["discovered"],
                "diverged": ", ".join(lost),
            }
        )
    return pd.DataFrame(lines)


def summary_view(summary: pd.DataFrame, noise_percent: float = 0.0) -> pd.DataFrame:
    """Return the summary with the headings and words that a reader sees.

    Errors below the sensor noise (% of the references' peak to peak) are said to be that, and count as
    the noise in what they are divided by.
    """
    view = summary[["plant", "controller"]].astype(str)
    for name in BELIEFS:
        # an error is missing where the loop diverged, and nowhere else
        view[name] = [
            "diverged" if np.isnan(x) else shown_error(x, x, noise_percent)
            for x in summary[name].astype(float)
        ]
    least = summary["discovered"].clip(lower=noise_percent)
    return view.assign(
        **{f"{name} / discovered": summary[name] / least for name in ("bare", "fitted")}
    )


def payoff_part(table: pd.DataFrame) -> str:
    """Write the payoff as a section of a longer text."""
    return paragraphs(
        [
            "## What it pays to know the effect",
            "Geometric mean of the RMSE (%) over the references, on plants with effects that a bare "
            "belief does not know, and by how much it falls when they have been discovered.",
            frame_table(summary_view(payoff_summary(table))),
            METHOD,
        ]
    )


def payoff_text(table: pd.DataFrame) -> str:
    """Write the payoff as Markdown."""
    seeds = ", ".join(str(seed) for seed in sorted(table["seed"].unique()))
    return paragraphs(
        [
            "# What it pays to know the effect",
            f"{len(table)} rows, seed {seeds}; every row is in `payoff.csv`. Made by "
            "`python -m benchmarks.payoff`.",
            "## RMSE (%) by belief",
            "Geometric mean over the references, and by how much it falls when the effect has been "
            "discovered.",
            frame_table(summary_view(payoff_summary(table))),
            "## What the numbers mean",
            METHOD,
            "## Every reference: RMSE (µm)",
            frame_table(_by_case(table)),
            "## What was hidden",
            frame_table(_hidden_view(HIDDEN_PLANTS)),
        ]
    )


def _by_case(table: pd.DataFrame) -> pd.DataFrame:
    named = table.assign(
        case=[
            f"{reference} {hz:g} Hz"
            for reference, hz in zip(table["reference"], table["frequency_hz"], strict=True)
        ],
        text=[
            "diverged" if words([status]) & {DIVERGED, ERROR} else number(rmse)
            for status, rmse in zip(table["status"], table["rmse_um"], strict=True)
        ],
    )
    keys = ["plant", "controller", "belief"]
    wide = named.pivot(index=keys, columns="case", values="text")
    order = pd.MultiIndex.from_frame(named[keys].drop_duplicates())
    return wide.reindex(index=order, columns=named["case"].drop_duplicates()).reset_index()


def _hidden_view(plants: tuple[HiddenPlant, ...]) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "plant": hidden.name,
                "effect": effect.full_name(),
                "parameters": ", ".join(f"{k} {v:g}" for k, v in effect.values.items()),
                "equation": effect.equation,
            }
            for hidden in plants
            for effect in hidden.hidden
        ]
    )


_BELIEFS = {
    "bare": (PALETTE[6], "circle"),
    "fitted": (PALETTE[1], "square"),
    "discovered": (PALETTE[2], "diamond"),
    "true": (INK, "line-ns-open"),
}
"""Colour and symbol of each belief."""


def payoff_section(table: pd.DataFrame) -> Section:
    """Make the section of a page that shows the payoff."""
    summary = payoff_summary(table)
    stroke_um = 2.0 * HIDDEN_PLANTS[0].base.reference_um[1]
    noise_percent = 100.0 * SENSOR_NOISE_UM / stroke_um
    view = summary_view(summary, noise_percent)
    falls = view["fitted / discovered"].dropna()
    answer = (
        f"Discovering the effect divides the tracking error by {number(falls.min(), 2)} to "
        f"{number(falls.max(), 2)}, in the median by {number(falls.median(), 2)}. "
        if len(falls)
        else ""
    )
    text = (
        f"{answer}The plants have an effect that the bare model lacks. Each line goes from the error "
        "with an RDPI model fitted to records of the plant to the error with the model in which the "
        f"effect was discovered from the same records.\n\n{plain(METHOD)}"
    )
    drawn = summary.assign(
        **{name: summary[name].clip(lower=noise_percent) for name in BELIEFS},
        fall_from_fitted=view["fitted / discovered"],
    )
    return Section("What it pays to know the effect", text, payoff_chart(drawn), view)


def payoff_chart(summary: pd.DataFrame) -> Chart:
    """Draw the error by belief, one panel a compensator; a line joins the fitted to the discovered."""
    plants = [name.replace(" with ", "\nwith ", 1) for name in dict.fromkeys(summary["plant"])]
    panels: list[Panel] = []
    for controller in dict.fromkeys(summary["controller"]):
        rows = summary[summary["controller"] == controller]
        marks: list[Mark] = []
        for name, row in zip(plants, rows.to_dict("records"), strict=True):
            if row["diverged"]:
                note = f"{row['diverged']}: diverged"
                marks.append(Note(None, name, note, PALETTE[1], "right", 15.0))
                continue
            ends = [row["fitted"], row["discovered"]]
            marks.append(Series(ends, [name, name], colour=MUTED, width=1.0, hover=""))
            fall = f"÷ {row['fall_from_fitted']:.3g}"
            marks.append(Note(float(np.sqrt(ends[0] * ends[1])), name, fall, MUTED, "center", 9.0))
        marks += [
            Series(
                rows[belief], plants, belief, colour, None, marker=symbol, size=11.0, edge=2.0, group=belief,
                listed=not panels, hover=f"%{{y}}, {belief}: %{{x:.3g}} %",
            )
            for belief, (colour, symbol) in _BELIEFS.items() if belief in rows.columns
        ]  # fmt: skip
        x, y = (
            Axis("RMSE (% of peak to peak)", log=True, ticks="decades"),
            Axis(categories=plants, reversed=True),
        )
        panels.append(Panel(marks, x, y, controller))
    return side_by_side(panels, 190 + 44 * len(plants), gap=0.03, shared="y")


def payoff_picture(summary: pd.DataFrame) -> bytes:
    """Draw the same as a PNG file."""
    chart = payoff_chart(summary)
    plants = len(chart.panels[0].y.categories or ())
    return chart_png(chart, (3.0 + 2.9 * len(chart.panels), 1.7 + 0.5 * plants))
