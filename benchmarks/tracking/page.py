"""The page of `rdpi bench`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.tracking import charts
from benchmarks.tracking.evaluation import Evaluation
from rdpi_gym.report.page import Section, write_page

_LOOK = (
    "The colour shows the inverse (grey: none, red: inversion-free, blue: classical, green: feedback "
    "alone), the symbol the rate that it uses; a dotted line or an open symbol means added feedback."
)
_HEADINGS = {
    "seed_0_rmse_percent": "RMSE, seed 0 (%)",
    "command_total_variation": "Command variation",
    "microseconds_per_sample": "µs per sample",
    "errors": "Rows with errors",
    "extrapolated": "Beyond identification",
}
_WIDTHS = ("_low", "_high", "_half_width")


def write_benchmark_page(
    path: Path,
    results: Evaluation,
    answer: str,
    method: str,
    measured: str,
    where_trained: str,
    payoff: Section | None = None,
) -> Path:
    """Write the results as a self-contained page."""
    sections = [
        Section(
            "Ranking",
            "Geometric mean of the RMSE over the cases, with its confidence interval over the drawn "
            "truths. The upright bar marks the error where the plant equals the controller's belief.",
            charts.ranking_chart(results.ranking) if _finished(results) else None,
            table_view(results.ranking),
        ),
        *_where_trained(results, where_trained),
        Section("What the numbers mean", method),
        *_curves(results),
        *_pairs(results),
        Section(
            "Every case",
            "Mean over the drawn truths with its confidence interval, and the total variation of the "
            "command over the smallest that tracks. The single rows are in leaderboard.csv.",
            table=table_view(results.by_case),
        ),
        *([] if payoff is None else [payoff]),
        _measured(results, measured),
    ]
    return write_page(path, "Tracking benchmark", _summary(results, answer), sections)


def table_view(frame: pd.DataFrame) -> pd.DataFrame:
    """Return every column under a reader's heading, the ends of the RMSE's interval in one cell.

    Other intervals are left out; they stand in the leaderboard.
    """
    view: dict[str, Sequence[object] | pd.Series[Any]] = {}
    for name in frame.columns:
        stem = next((name.removesuffix(end) for end in _WIDTHS if name.endswith(end)), name)
        if stem != name and stem in frame.columns:
            continue
        view[_HEADINGS.get(name, name)] = frame[name]
        if name == "rmse_percent" and f"{name}_low" in frame.columns:
            ends = zip(frame[f"{name}_low"], frame[f"{name}_high"], strict=True)
            view["Interval (%)"] = [
                f"{low:.3g} to {high:.3g}" if np.isfinite(low) else "–" for low, high in ends
            ]
    return pd.DataFrame(view)


def _where_trained(results: Evaluation, text: str) -> list[Section]:
    return [
        Section(
            f"Ranking at Ts = {ts:g} s",
            text,
            charts.ranking_chart(ranked) if ranked["rmse_percent"].notna().any() else None,
            table_view(ranked),
        )
        for ts, ranked in results.where_trained.items()
    ]


def _finished(results: Evaluation) -> bool:
    return bool(results.ranking["rmse_percent"].notna().any())


def _summary(results: Evaluation, answer: str) -> str:
    scope = (
        f"{len(results.order)} controllers were scored in {len(results.rows)} rows; the ranking is by "
        "the geometric mean of the RMSE over all cases and drawn truths."
    )
    notes = "\n".join(f"- {note}" for note in results.notes)
    return f"{answer}\n\n{scope}\n\n{notes}"


def _curves(results: Evaluation) -> list[Section]:
    cases, settings = results.by_case, results.by_sampling_time
    frequency = charts.frequency_charts(cases.dropna(subset="rmse_percent"), results.order)
    effort = charts.effort_charts(settings.dropna(subset="rmse_percent"), results.order)
    sections = []
    if frequency:
        sections.append(
            Section(
                "Error against frequency",
                "Sines of full amplitude. Point at a mark to see its confidence interval. "
                f"{_LOOK} Click on an entry of the legend to hide it, double-click to see it alone.",
                frequency,
            )
        )
    if effort:
        sections.append(
            Section(
                "Error against command effort",
                "Geometric means over the references. Quiet commands are on the left; those that "
                "chatter, dither or pass noise on are on the right.",
                effort,
            )
        )
    return sections


def _pairs(results: Evaluation) -> list[Section]:
    by_case: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in results.rows:
        if "trace" in row and row["seed"] == results.first_seed:
            name = (
                f"{row['plant']}, {row['reference']} {row['frequency_hz']:g} Hz, "
                f"Ts = {1e6 * row['ts_s']:g} µs"
            )
            by_case.setdefault(name, {})[row["controller"]] = row["trace"]
    if not by_case:
        return []
    drawn = {}
    for name, traces in by_case.items():
        ordered = {
            controller: traces[controller] for controller in results.order if controller in traces
        }
        first = next(iter(ordered))
        second = "none" if "none" in ordered else list(ordered)[-1]
        drawn[name] = charts.pair_figure(ordered, first, second)
    return [
        Section(
            "Traces of any pair",
            "The first scored period of the first seed. Choose a reference here, and two "
            "controllers, A and B, in the figure.",
            drawn,
        )
    ]


def _measured(results: Evaluation, text: str) -> Section:
    measured = results.measured
    if measured.table.empty:
        return Section("On real input", text)
    return Section("On real input", text, charts.measured_charts(measured.traces), measured.table)
