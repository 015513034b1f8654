"""The study in words and tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.tracking.stages import NOISE_UM, RATE_BANDWIDTH_HZ
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.words import number
from studies.agents.scores import PREVIEW_INVERSION
from studies.agents.study import BASELINE, Study
from studies.agents.summary import ALL_GROUPS, CONFIDENCE
from studies.agents.worlds import TS_S

METHOD = f"""\
- **Agents.** Each is trained with several seeds by `python -m studies.agents --stage train`. `correction`: its action is added to the command of `{BASELINE}`; `increment`: its action changes the command, and nothing else tracks.
- **Belief.** Every controller holds the nominal P10 without effects; so does the baseline that an agent corrects.
- **Held-out plants.** Drawn about P10 with the effects of the group, from seeds of which no training draws: weights, gaps between thresholds and δ2 within 1 ± 0.05, parameters of the effects within 1 ± 0.4. `all`: a lag of the amplifier, creep and a mode at 739 Hz; `lag`, `resonance` and `creep` one of them, a combination that no training had; `bare` none. The rate is low-passed at {RATE_BANDWIDTH_HZ:g} Hz; {1e3 * NOISE_UM:g} nm of noise is measured. Ts is {1e6 * TS_S:g} µs.
- **References.** Sines of 25, 50, 80 and 100 Hz, triangle, raster and nested loops of 20 Hz, multisine of 10 to 100 Hz, as far as they were asked for. Raster and nested loops were in no training.
- **Score of a plant.** Mean over the references of the RMSE of the noise-free displacement after the smooth start, in percent of the reference's peak to peak, and of the command's total variation (V/s).
- **Interquartile mean.** As rliable defines it: the mean of the middle half of the scores of all trainings on all plants (where a quarter of them is no whole number, the scores at its ends count in part). Brackets hold its {100 * CONFIDENCE:g} % bootstrap interval: trainings and plants are drawn again, plants within their group. A run that failed counts as infinite.
- **Ratios** are to the best causal compensator in the same group, feedforward or with feedback, by its interquartile mean, and to the best feedforward; `{PREVIEW_INVERSION}` knows the whole reference beforehand and is not among them.
"""

GAP_METHOD = f"""\
- **Domains.** `bare`: P10 without effects; `with effects`: with lag, creep and mode; `picma`: the plant identified from the measured PICMA record, on which a policy runs in proportion to amplitude and command range. That record has 1 Hz, so 20 to 100 Hz are extrapolated; `picma at 1 Hz` is within it. Plants are drawn about each of them as in the scores.
- **Literal.** The same plants with the rate as Eq. (5) writes it, in place of low-passed at {RATE_BANDWIDTH_HZ:g} Hz; agents and beliefs are the same. A command that exploits the artefact of the literal model dithers: its ratio lies far below those of the smooth compensators, and its command variation far above theirs.
- **Command variation** is over that of the best causal compensator on the low-passed plants of the domain.
- **Numbers** are interquartile means with bootstrap intervals, as in `agents.md`.
"""


def agents_text(study: Study, summary: pd.DataFrame, trainings: pd.DataFrame) -> str:
    """Write scores and trainings as Markdown."""
    worlds = [ALL_GROUPS, *(name for name in summary["world"].unique() if name != ALL_GROUPS)]
    parts = [
        "# Trained agents beside the compensators",
        _trained(study, trainings),
        METHOD,
    ]
    for world in worlds:
        part = summary[summary["world"] == world]
        if part.empty:
            continue
        best, feedforward = part["best"].iloc[0], part["best_feedforward"].iloc[0]
        parts += [
            f"## Plants: {world}",
            f"Best causal compensator: `{best}`; best feedforward: `{feedforward}`.",
            frame_table(_score_view(part)),
        ]
    parts += ["## Trainings", frame_table(trainings)]
    return _joined(parts)


def gap_text(study: Study, summary: pd.DataFrame, trainings: pd.DataFrame) -> str:
    """Write the domain gap as Markdown."""
    parts = ["# The same agents elsewhere", _trained(study, trainings), GAP_METHOD]
    for domain, part in summary.groupby("domain", sort=False):
        parts += [f"## {domain}", frame_table(_gap_view(part))]
    return _joined(parts)


def _trained(study: Study, trainings: pd.DataFrame) -> str:
    """Say which trainings the tables are made of, and which are missing."""
    there = {(str(agent), int(seed)) for agent, seed in zip(*_named(trainings), strict=True)}
    wanted = [(agent.name, seed) for agent in study.agents for seed in study.seeds]
    missing = [f"{name} with seed {seed}" for name, seed in wanted if (name, seed) not in there]
    text = (
        f"{len(there)} trainings, {study.plants} plants a group with seeds 0 to {study.plants - 1}, "
        f"references {', '.join(study.references)}. Made by `python -m studies.agents`."
    )
    return text + (f" Not trained: {', '.join(missing)}." if missing else "")


def _named(trainings: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    return trainings["agent"], trainings["seed"]


def _score_view(part: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "controller": part["contestant"],
            "kind": part["kind"],
            "trainings": part["trainings"],
            "RMSE (%)": _ranged(part, "rmse_percent"),
            "RMSE over the best": _ranged(part, "rmse_ratio"),
            "RMSE over the best feedforward": _ranged(part, "rmse_over_feedforward"),
            "command variation (V/s)": _ranged(part, "command_variation_V_s"),
            "variation over the best": _ranged(part, "variation_ratio"),
            "variation over the best feedforward": _ranged(part, "variation_over_feedforward"),
            "failed": part["failed"],
        }
    )


def _gap_view(part: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "controller": part["contestant"],
            "RMSE (%)": _ranged(part, "rmse_percent"),
            "literal: RMSE (%)": _ranged(part, "literal_rmse_percent"),
            "literal over low-passed": _ranged(part, "literal_ratio"),
            "command variation": _ranged(part, "variation_ratio"),
            "literal: command variation": _ranged(part, "literal_variation_ratio"),
        }
    )


def _ranged(frame: pd.DataFrame, column: str) -> list[str]:
    parts = [frame[name] for name in (column, f"{column}_low", f"{column}_high")]
    return [
        f"{number(value)} ({number(low)} to {number(high)})" if np.isfinite(value) else "failed"
        for value, low, high in zip(*parts, strict=True)
    ]


def _joined(parts: list[str]) -> str:
    return "\n\n".join(part.strip() for part in parts) + "\n"
