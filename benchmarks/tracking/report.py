"""Leaderboard as Markdown, as files and as the page of `rdpi bench`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from baselines import FULL_PREVIEW
from benchmarks.payoff.report import payoff_part, payoff_section
from benchmarks.rows import paragraphs, write_csv
from benchmarks.tracking import charts
from benchmarks.tracking.episode import BELOW_NOISE, BLOCK, MEANING, shown_error, words
from benchmarks.tracking.evaluation import (
    COLUMNS,
    CONFIDENCE,
    RANKING,
    Evaluation,
    ranking_view,
)
from benchmarks.tracking.measured import MEMORY_S, MeasuredScores
from benchmarks.tracking.stages import NOISE_UM, SPREAD, SUITE_VERSION, Stage
from rdpi_gym.envs.truth import RATE_BANDWIDTH_HZ
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import LEADING_ROWS, frame_table, leading, leading_rows, plain
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import number

METHOD = f"""\
- **Score.** Root mean square and largest tracking error of the noise-free displacement, in µm and in percent of the reference's peak to peak. A reference starts smoothly within its first period, which is not counted; the whole periods after it are.
- **Plants.** Every plant that scores has its rate low-passed at {RATE_BANDWIDTH_HZ:g} Hz at most, since a literal one rewards dither. Its displacement is measured with {1e3 * NOISE_UM:g} nm of white noise (one standard deviation) unless the plant states its own; only feedback sees the measurement.
- **Truth and belief.** Every controller holds the nominal plant, with its effects where it has some (column `belief`). The truth (column `plant`) of seed 0 is that plant; of every other seed it is drawn around it: each weight, each gap between thresholds and δ2 by its own factor, uniform within 1 ± {SPREAD:g}. The seed also draws the noise and the phases of multisine and noise references. All controllers meet the same truths.
- **Means and intervals.** Means over cases and seeds are geometric. An interval in brackets is the {100 * CONFIDENCE:g} % confidence interval of the mean over the drawn seeds, by Student's t on the logarithms; seed 0 is not among them.
- **Rank.** One more than the number of controllers that are better: those for which the {100 * CONFIDENCE:g} % confidence interval of the paired difference over the drawn seeds is below zero (Student's t on the difference of the logarithms of their means). `=` marks a rank that several controllers have; they are in the order of their means. `places` are the ranks that the paired differences of a controller with all others leave open.
- **Mean rank.** By RMSE within each case and seed, the bound aside.
- **Status.** In how many rows of all: {"; ".join(f"`{word}`: {text}" for word, text in MEANING.items())}.
- **Bound.** `{FULL_PREVIEW}` is no controller and has no rank. It holds the true plant of every row and the whole reference, and inverts the one along the other before it begins: what it leaves is what the sampling time, the command's range and the accuracy of its inversion leave. Nothing is measured, so noise costs it nothing. The benchmark gives the true plant to it alone.
- **Optimality gap.** RMSE over that of `{FULL_PREVIEW}` on the same row. It is large, since the bound is nearly exact on a smooth reference: it says what knowledge of the plant, preview and freedom from noise would be worth together.
- **Command variation.** Total variation of the command over that of the bound's command on the same row; a value far above 1 is chatter, dither or noise that is passed on.
- **Time.** `µs per sample` is the processor time of one decision for one plant through `predict`, the least mean of {BLOCK}, on the machine of this run.
"""
WHERE_TRAINED = (
    "A trained policy runs only at the sampling time of its training. Here all controllers are ranked "
    "over the cases of that sampling time, with the policies among them."
)


def leaderboard_text(evaluation: Evaluation) -> str:
    """Write the leaderboard as Markdown."""
    selection, table, cases = evaluation.selection, evaluation.table, evaluation.by_case
    order, measured, own = evaluation.order, evaluation.measured, evaluation.own
    seeds = ", ".join(map(str, selection.seeds))
    parts = [
        "# Leaderboard of the tracking benchmark",
        evaluation.answer,
        f"{len(table)} rows, seeds {seeds}, suite version {SUITE_VERSION}: every row is in "
        "`leaderboard.csv`, the rankings are in `ranking.csv`.",
        "\n".join(f"- {note}" for note in evaluation.notes),
        "## Ranking",
        "Geometric mean of the RMSE over the cases, with its confidence interval. The rank is one "
        "more than the number of controllers that are better beyond doubt; `=` marks a tie. "
        "`RMSE, seed 0`: where the belief is true.",
        leading_rows(ranking_view(evaluation.ranking), "ranking.csv", own=own),
    ]
    for ts, ranked in evaluation.where_trained.items():
        title = f"## Ranking at Ts = {ts:g} s, where trained policies run"
        shown = leading_rows(ranking_view(ranked), "ranking.csv", own=own)
        parts += [title, WHERE_TRAINED, shown]
    parts += ["## What the numbers mean", METHOD, _below_bound(table)]
    for stage in selection.stages:
        ts = stage.shown_ts_s
        part = cases[(cases["plant"] == stage.plant.name) & np.isclose(cases["ts_s"], ts)]
        if not part.empty:
            parts += [f"## {stage.plant.name} at Ts = {ts:g} s: RMSE (% of peak to peak)"]
            view = _case_view(part, order)
            parts += [_stage_words(stage, part), leading_rows(view, "leaderboard.csv", own=own)]
    parts += [
        "## Error against sampling time",
        "Geometric mean of the RMSE (%) over the references that every sampling time of a plant has.",
        leading_rows(_ts_view(cases[~cases["extrapolated"]], order), "leaderboard.csv", own=own),
    ]
    if words(table["status"].tolist()):
        parts += [
            "## Status",
            "Rows with each word in their status, of all rows, those beyond the identification "
            "among them.",
            leading_rows(_status_view(table, order), "leaderboard.csv", own=own),
        ]
    parts += ["## On real input", measured_text(measured)]
    if not measured.table.empty:
        parts.append(frame_table(measured.table, digits=4))
    return paragraphs(parts)


def _below_bound(table: pd.DataFrame) -> str:
    """State in which rows a controller has a smaller error than the bound, and why."""
    rows = table[table["controller"] != FULL_PREVIEW]
    below = rows[rows["optimality_gap"] < 1.0 - 1e-6]
    counted = int(rows["optimality_gap"].notna().sum())
    if below.empty:
        return f"No controller is below the bound in any of {counted} rows."
    named = zip(below["reference"], below["frequency_hz"], below["plant"], strict=True)
    where = ", ".join(dict.fromkeys(f"{ref} {hz:g} Hz on {plant}" for ref, hz, plant in named))
    return (
        f"The optimality gap is below 1 in {len(below)} of {counted} rows, at least "
        f"{number(float(below['optimality_gap'].min()))} ({where}): there the bound's inversion reaches the "
        "command's range or its last iteration, and it keeps the smallest error over the whole "
        "record, the smooth start that is not scored among it."
    )


def _stage_words(stage: Stage, part: pd.DataFrame) -> str:
    plant = stage.plant
    centre, amplitude = plant.reference_um
    low, high = plant.command_range_V
    return (
        f"References of {amplitude:.4g} µm about {centre:.4g} µm, commands from {low:g} to {high:g} V; "
        "means over the drawn seeds."
        + (" With a star: beyond the plant's identification." if part["extrapolated"].any() else "")
    )


def _case_view(part: pd.DataFrame, order: list[str]) -> pd.DataFrame:
    part = part.assign(
        case=[
            f"{reference} {hz:g} Hz{' *' if beyond else ''}"
            for reference, hz, beyond in zip(
                part["reference"], part["frequency_hz"], part["extrapolated"], strict=True
            )
        ],
        text=part["rmse_percent"].map(number),
    )
    wide = part.pivot(index="controller", columns="case", values="text")
    run = set(part["controller"])
    wide = wide.reindex(
        index=[name for name in order if name in run], columns=part["case"].drop_duplicates()
    )
    return wide.fillna("–").reset_index()


def _ts_view(cases: pd.DataFrame, order: list[str]) -> pd.DataFrame:
    columns = {}
    for plant, part in cases.groupby("plant", sort=False):
        times = sorted(part["ts_s"].unique())
        everywhere = part.groupby(["reference", "frequency_hz"])["ts_s"].transform("nunique")
        common = part[everywhere == len(times)]
        for ts in times:
            logs = np.log(common.loc[common["ts_s"] == ts].set_index("controller")["rmse_percent"])
            mean = logs.groupby(level=0).apply(lambda values: np.exp(values.mean(skipna=False)))
            columns[f"{plant}, Ts = {ts:g} s"] = mean.reindex(order)
    return pd.DataFrame(columns).rename_axis("controller").reset_index()


def _status_view(table: pd.DataFrame, order: list[str]) -> pd.DataFrame:
    found = words(table["status"].tolist())
    by_name = {name: rows["status"] for name, rows in table.groupby("controller")}
    counts = {
        word: [sum(word in words([text]) for text in by_name[name]) for name in order]
        for word in MEANING
        if word in found
    }
    ok = [sum(text == "ok" for text in by_name[name]) for name in order]
    rows = [len(by_name[name]) for name in order]
    return pd.DataFrame({"controller": list(order), "rows": rows, "ok": ok, **counts})


def measured_text(measured: MeasuredScores) -> str:
    """State what the scores on measured records are, or why there are none."""
    if measured.table.empty:
        return measured.note
    return (
        f"{measured.note} The measured displacement is the reference, the belief is the plant that was "
        "identified from the record `identification`, and no simulated plant is controlled. Scored is "
        "the difference between a feedforward's command and the voltage that was really applied: "
        "`rms_V`, in percent of the applied peak to peak, and in µm through the local gain dy/du of "
        "the belief. One constant of each record is free, the sensor's zero, which differs between "
        "the files: `offset_um` is the mean of what is measured above the belief's response to the "
        f"applied voltage. The first {MEMORY_S:g} s are not counted, in which the memory builds up. "
        "Feedback has nothing to feed back here and is left out. All rows are in `measured.csv`."
    )


def write_tables(out: Path, evaluation: Evaluation, payoff: pd.DataFrame | None = None) -> Path:
    """Write every table of a run into a folder; ``measured.csv`` only where it has rows."""
    table, text = evaluation.table, leaderboard_text(evaluation)
    if payoff is not None:
        table = pd.concat([table, payoff[list(COLUMNS)]], ignore_index=True)
        text += f"\n{payoff_part(payoff)}"
    rankings = [(float("nan"), evaluation.ranking), *evaluation.where_trained.items()]
    parts = [part.assign(ts_s=ts)[["ts_s", *RANKING]] for ts, part in rankings]
    write_csv(out / "leaderboard.csv", table)
    write_csv(out / "ranking.csv", pd.concat(parts, ignore_index=True))
    if not evaluation.measured.table.empty:
        write_csv(out / "measured.csv", evaluation.measured.table)
    return write_atomic(out / "leaderboard.md", text)


# --- the page ---

_LOOK = (
    "The colour shows the inverse (grey: none, red: inversion-free, blue: classical, green: feedback "
    "alone), the symbol the rate that it uses; a dotted line or an open symbol means added feedback."
)
_OF_FILES = ("- **Mean rank.**", "- **Optimality gap.**")
_HEADINGS = {
    "command_total_variation": "Command variation",
    "microseconds_per_sample": "µs per sample",
    "errors": "Rows with errors",
    "extrapolated": "Beyond identification",
}
_WIDTHS = ("_low", "_high", "_half_width")


def write_benchmark_page(
    path: Path, results: Evaluation, payoff: pd.DataFrame | None = None
) -> Path:
    """Write the results as a self-contained page: the leaders, and what unfolds."""
    measured, ranked = results.measured, results.ranking
    effort = charts.effort_charts(
        results.by_sampling_time.dropna(subset="rmse_percent"), results.order
    )
    rivals = ranked[ranked["rank"] != "bound"]
    rivals = ranked if rivals.empty else rivals
    first = leading(rivals, results.own)
    leaders = [name for name in results.order if name in set(first["controller"])]
    cases = results.by_case.dropna(subset="rmse_percent")
    frequency = charts.frequency_charts(cases, leaders)
    least_um = min(results.noise_um.values(), default=0.0)
    sections = [
        Section(
            "The leaders",
            "RMSE in percent of the reference's peak to peak, geometric mean over all cases, with its "
            "confidence interval over the drawn truths. = marks a rank that several have.",
            _ranking_chart(first),
            _leaders(first, least_um),
        ),
        _folded(
            f"All {len(rivals)} controllers",
            "The bound beside them knows the true plant. More columns are in ranking.csv.",
            _ranking_chart(ranked) if len(rivals) > LEADING_ROWS else None,
            _ranking_table(ranked, least_um),
        ),
        *(
            _folded(
                f"Ranking at Ts = {ts:g} s",
                f"{WHERE_TRAINED} The first {LEADING_ROWS}; ranking.csv has all.",
                None,
                _ranking_table(leading(part, results.own, 1 + LEADING_ROWS), least_um),
            )
            for ts, part in results.where_trained.items()
        ),
    ]
    if frequency:
        text = (
            "The leaders on sines of full amplitude. Point at a mark to see its confidence interval. "
            f"{_LOOK} Click on an entry of the legend to hide it, double-click to see it alone."
        )
        sections.append(_folded("Error against frequency", text, frequency))
    if effort:
        text = (
            "Geometric means over the references. Quiet commands are on the left; those that "
            "chatter, dither or pass noise on are on the right."
        )
        sections.append(_folded("Error against command effort", text, effort))
    pairs = _pairs(results, leaders)
    if pairs:
        text = (
            "The first scored period of the first seed. Choose a reference here, and two "
            "controllers, A and B, in the figure."
        )
        sections.append(_folded("Traces of any pair", text, pairs))
    text = (
        "RMSE of the leaders on each reference at the shortest sampling time, geometric mean over "
        "the drawn truths. Every row of every controller is in leaderboard.csv."
    )
    sections.append(_folded("Every reference", text, None, _by_reference(results, leaders)))
    if payoff is not None:
        sections.append(replace(payoff_section(payoff), folded=True))
    sections += [
        _folded("On real input", plain(measured_text(measured)), *_on_real_input(measured)),
        _folded("What the numbers mean", plain(_of_page(METHOD))),
    ]
    if results.notes:
        notes = "\n".join(f"- {note}" for note in results.notes)
        sections.append(_folded("What was left out", notes))
    scope = f"{len(rivals)} controllers were scored in {len(results.rows)} rows."
    return write_page(path, "Tracking benchmark", f"{results.answer}\n\n{scope}", sections)


def _folded(
    title: str, text: str, figure: Any = None, table: pd.DataFrame | None = None
) -> Section:
    return Section(title, text, figure, table, folded=True)


def _of_page(method: str) -> str:
    """Leave out what is explained of columns that the page does not show."""
    lines = method.splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith(_OF_FILES))


def _ranking_chart(ranked: pd.DataFrame) -> Any:
    return charts.ranking_chart(ranked) if ranked["rmse_percent"].notna().any() else None


def _leaders(first: pd.DataFrame, noise_um: float) -> pd.DataFrame:
    """Return what a reader wants first of a ranking."""
    view = table_view(_readable(first, noise_um))
    return view[[n for n in ("rank", "controller", *_ERRORS, "status") if n in view.columns]]


_ERRORS = ("rmse_percent", "Interval (%)")


def _ranking_table(ranked: pd.DataFrame, noise_um: float) -> pd.DataFrame:
    """Return a ranking as a reader of the page sees it; ``ranking.csv`` has the other columns."""
    columns = (
        "rank", "controller", "rmse_percent", "rmse_percent_low", "rmse_percent_high", "status",
        "command_total_variation", "microseconds_per_sample",
    )  # fmt: skip
    shown = _readable(ranked, noise_um)
    return table_view(shown[[name for name in columns if name in shown.columns]])


def _readable(ranked: pd.DataFrame, noise_um: float) -> pd.DataFrame:
    """Say of an error below the sensor noise that it is, and give no interval of it."""
    below = ranked["rmse_um"] < noise_um
    if not below.any():
        return ranked
    shown = [
        shown_error(percent, um, noise_um)
        for percent, um in zip(ranked["rmse_percent"], ranked["rmse_um"], strict=True)
    ]
    ends = {name: ranked[name].mask(below) for name in ("rmse_percent_low", "rmse_percent_high")}
    return ranked.assign(rmse_percent=shown, **ends)


def _by_reference(results: Evaluation, leaders: Sequence[str]) -> pd.DataFrame:
    """Return the errors (%) of some controllers, one row a plant and reference."""
    cases = results.by_case
    shortest = cases.groupby("plant")["ts_s"].transform("min")
    kept = cases[(cases["ts_s"] == shortest) & cases["controller"].isin(leaders)]
    texts = [
        shown_error(percent, um, results.noise_um[plant])
        for percent, um, plant in zip(
            kept["rmse_percent"], kept["rmse_um"], kept["plant"], strict=True
        )
    ]
    named = kept.assign(
        text=["< noise" if text == BELOW_NOISE else text for text in texts],
        reference=kept["reference"] + " " + kept["frequency_hz"].map("{:g} Hz".format),
    )
    keys = ["plant", "reference"]
    wide = named.pivot(index=keys, columns="controller", values="text").fillna("–")
    order = pd.MultiIndex.from_frame(named[keys].drop_duplicates())
    wide = wide.reindex(index=order, columns=list(leaders))
    return wide.rename(columns="{} (%)".format).reset_index()


def _on_real_input(measured: MeasuredScores) -> tuple[Any, pd.DataFrame | None]:
    """Return charts and table of the controllers that are nearest to what was applied."""
    table = measured.table
    if table.empty:
        return None, None
    best = table.groupby("controller")["rms_V"].mean().nsmallest(LEADING_ROWS).index
    traces = {
        record: {name: y for name, y in of.items() if name in {"t_s", "applied", *best}}
        for record, of in measured.traces.items()
    }
    wanted = ("controller", "record", "rms_V", "rms_percent", "rms_um", "status")
    shown = table.loc[table["controller"].isin(best), [n for n in wanted if n in table.columns]]
    return charts.measured_charts(traces), table_view(shown)


def table_view(frame: pd.DataFrame) -> pd.DataFrame:
    """Return every column under a reader's heading, the ends of the RMSE's interval in one cell.

    Other intervals are omitted; they are in the leaderboard.
    """
    view: dict[str, Sequence[object] | pd.Series[Any]] = {}
    for name in frame.columns.drop("cautions", errors="ignore"):
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


def _pairs(results: Evaluation, shown: Sequence[str]) -> dict[str, Any]:
    """Return the traces of the first seed, each a figure in which two controllers can be chosen.

    Of each plant and reference there is one, at the frequency nearest the middle.
    """
    by_case: dict[tuple[str, str], dict[float, dict[str, Row]]] = {}
    for row in results.rows:
        if "trace" in row and row["seed"] == results.first_seed and row["controller"] in shown:
            of = by_case.setdefault((row["plant"], row["reference"]), {})
            of.setdefault(row["frequency_hz"], {})[row["controller"]] = row
    drawn = {}
    for (plant, reference), of in by_case.items():
        hz = sorted(of)[len(of) // 2]
        ts_s = next(iter(of[hz].values()))["ts_s"]
        traces = {each: of[hz][each]["trace"] for each in shown if each in of[hz]}
        second = "none" if "none" in traces else list(traces)[-1]
        name = f"{plant}, {reference} {hz:g} Hz, Ts = {1e6 * ts_s:g} µs"
        drawn[name] = charts.pair_figure(traces, next(iter(traces)), second)
    return drawn
