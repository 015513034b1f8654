"""The payoff in tables and words."""

from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.payoff.beliefs import BELIEFS, HIDDEN_PLANTS, NOISE_UM, HiddenPlant
from benchmarks.payoff.scores import PREVIEW, TS_S
from benchmarks.tracking.scoring import DIVERGED, ERROR, words
from benchmarks.tracking.stages import NOISE_UM as SENSOR_NOISE_UM
from benchmarks.tracking.stages import RATE_BANDWIDTH_HZ
from rdpi_gym.support.markdown import frame_table
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


def summary_view(summary: pd.DataFrame) -> pd.DataFrame:
    """Return the summary with the headings and words that a reader sees."""
    shown = {name: [] for name in ("plant", "controller", *BELIEFS)}  # type: dict[str, list[str]]
    for row in summary.to_dict("records"):
        lost = str(row["diverged"]).split(", ")
        for name in ("plant", "controller"):
            shown[name].append(str(row[name]))
        for name in BELIEFS:
            shown[name].append("diverged" if name in lost else number(float(row[name])))
    falls = {
        "bare / discovered": summary["fall_from_bare"],
        "fitted / discovered": summary["fall_from_fitted"],
    }
    return pd.DataFrame({**shown, **falls})


def payoff_part(table: pd.DataFrame) -> str:
    """Write the payoff as a section of a longer text."""
    parts = [
        "## What it pays to know the effect",
        "Geometric mean of the RMSE (%) over the references, on plants with effects that a bare "
        "belief does not know, and by how much it falls when they have been discovered.",
        frame_table(summary_view(payoff_summary(table))),
        METHOD,
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def payoff_text(table: pd.DataFrame) -> str:
    """Write the payoff as Markdown."""
    summary = payoff_summary(table)
    seeds = ", ".join(str(seed) for seed in sorted(table["seed"].unique()))
    parts = [
        "# What it pays to know the effect",
        f"{len(table)} rows, seed {seeds}; every row is in `payoff.csv`. Made by "
        "`python -m benchmarks.payoff`.",
        "## RMSE (%) by belief",
        "Geometric mean over the references, and by how much it falls when the effect has been "
        "discovered.",
        frame_table(summary_view(summary)),
        "## What the numbers mean",
        METHOD,
        "## Every reference: RMSE (µm)",
        frame_table(_by_case(table)),
        "## What was hidden",
        frame_table(_hidden_view(HIDDEN_PLANTS)),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _by_case(table: pd.DataFrame) -> pd.DataFrame:
    named = table.assign(
        case=[
            f"{reference} {hz:g} Hz"
            for reference, hz in zip(table["reference"], table["frequency_hz"], strict=True)
        ],
        text=[
            "diverged" if words([said]) & {DIVERGED, ERROR} else number(rmse)
            for said, rmse in zip(table["status"], table["rmse_um"], strict=True)
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
