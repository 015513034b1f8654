"""Charts of the benchmark: ranking, error over frequency and effort, traces of controllers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.tracking.evaluation import Evaluation
from rdpi_gym.report.chart import (
    Axis,
    Chart,
    Dash,
    Mark,
    Note,
    Panel,
    Series,
    side_by_side,
    single,
    stacked,
)
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.chart_plotly import plotly_figure
from rdpi_gym.report.style import INK, PALETTE, REFERENCE, figure_text
from rdpi_gym.report.traces import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.markdown import LEADING_ROWS
from rdpi_gym.support.words import number

_BOUND = "full-preview-inversion"
# Errors of seed 0 that are smaller than this part of the smallest mean do not widen the axis.
_NEAR = 0.05
# Samples of a curve on the page: a screen shows no more of a period, or of some seconds.
_PAIR_SAMPLES, _RECORD_SAMPLES = 100, 400
_RMSE = "RMSE (% of peak to peak)"
# Colour says which inverse, the symbol at which rate, the dash whether feedback is added.
_COLOURS = {
    "inversion-free": PALETTE[1],
    "classical": PALETTE[0],
    "none": PALETTE[6],
    "pi": PALETTE[2],
    _BOUND: INK,
}
_SYMBOLS = {"literal": "x", "reference-rate": "circle", "low-passed": "square", "static": "diamond"}
_DASHES: dict[str, Dash] = {"x": "dot", "square": "dash", "diamond": "dashdot"}
_PICTURED = (
    "none", "pi", "inversion-free-literal", "inversion-free-reference-rate",
    "classical-reference-rate", "pi-classical-reference-rate", "pi-inversion-free-reference-rate",
)  # fmt: skip
"""Controllers whose error over the frequency is in the picture."""


def look(controller: str) -> tuple[str, str, bool]:
    """Return colour and symbol of a controller, and whether feedback is added, the same everywhere."""
    feedforward = controller.removeprefix("pi-")
    known = () if ":" in controller else _COLOURS
    family = next((name for name in known if feedforward.startswith(name)), "")
    ending = next((name for name in _SYMBOLS if feedforward.endswith(name)), "")
    symbol = _SYMBOLS.get(ending, "triangle-up")
    return _COLOURS.get(family, PALETTE[3]), symbol, feedforward != controller


def leaderboard_chart(results: Evaluation) -> Chart:
    """Draw the first of the ranking, and beside it the error over the frequency of some controllers."""
    finished = results.ranking.dropna(subset=["rmse_percent"])
    rivals = finished[finished["rank"] != "bound"].head(LEADING_ROWS)
    ranking = finished if rivals.empty else rivals
    panels = [_ranking_panel(ranking)]
    sines = _sines(results)
    if len(sines):
        names = [name for name in _PICTURED if name in results.order] or results.order[:6]
        plant, ts_s = sines[["plant", "ts_s"]].iloc[0]
        panels.append(_frequency_panel(sines, names, f"Sines on {_setting(plant, ts_s)}"))
    return side_by_side(panels, legend="below")


def leaderboard_png(results: Evaluation) -> bytes:
    """Draw the same as a PNG file."""
    width = 12.5 if len(_sines(results)) else 7.0
    return chart_png(leaderboard_chart(results), (width, 4.9))


def _sines(results: Evaluation) -> pd.DataFrame:
    """Return the cases with a sine on the first plant at its shortest sampling time."""
    plant, ts_s = results.shown_setting
    cases = results.by_case
    wanted = (
        (cases["plant"] == plant)
        & np.isclose(cases["ts_s"], ts_s)
        & (cases["reference"] == "sine")
        & cases["rmse_percent"].notna()
    )
    return cases[wanted]


def ranking_chart(ranking: pd.DataFrame) -> Chart:
    """Draw the geometric mean of every controller's error with its confidence interval."""
    shown = ranking.dropna(subset=["rmse_percent"])
    panel = _ranking_panel(shown.assign(cautions="ok"))  # the table beside it states them
    names = panel.y.categories or ()
    return Chart([replace(panel, title="")], 130 + 26 * len(names))


def _ranking_panel(shown: pd.DataFrame) -> Panel:
    names = marked_names(shown)
    low, high = ranking_range(shown)
    means = Series(
        shown["rmse_percent"], names, "drawn truths, with confidence interval", INK, None,
        marker="circle", size=9.0, fill=[look(name)[0] for name in shown["controller"]], edge=0.0,
        errors=_interval(shown), errors_along="x", data=shown["optimality_gap"],
        hover="%{y}: %{x:.3g} %, optimality gap %{customdata:.3g}",
    )  # fmt: skip
    nominal = Series(
        shown["seed_0_rmse_percent"], names, "seed 0, where the belief is true", INK, None,
        marker="line-ns-open", size=8.0, edge=2.0, hover="%{y}, seed 0: %{x:.3g} %",
    )  # fmt: skip
    notes = [
        Note(low, name, f"\N{BLACK LEFT-POINTING TRIANGLE} {number(value, 2)} %", INK)
        for name, value in off_axis(shown, names, low)
    ]
    x = Axis(_RMSE, log=True, limits=(low, high), ticks="1-2-5")
    return Panel(
        [means, nominal, *notes], x, Axis(categories=names, reversed=True), title="Ranking"
    )


def _interval(means: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Return the parts of the confidence interval below and above the mean."""
    mean = means["rmse_percent"]
    below, above = mean - means["rmse_percent_low"], means["rmse_percent_high"] - mean
    return below.fillna(0.0), above.fillna(0.0)


def marked_names(ranking: pd.DataFrame) -> list[str]:
    """Name the controllers with their ranks, each with its cautions below where it has any."""
    columns = (ranking[name] for name in ("rank", "controller", "cautions"))
    return [
        f"{rank} {controller}" + ("" if cautions == "ok" else f"\n({cautions})")
        for rank, controller, cautions in zip(*columns, strict=True)
    ]


def ranking_range(ranking: pd.DataFrame) -> tuple[float, float]:
    """Return the axis (%) that shows every mean and interval of controllers that compete.

    A bound's error is next to none and would push all others together, as would that of an inverse
    whose belief is the truth: they are noted at the axis's end, see :func:`off_axis`.
    """
    rivals = ranking[ranking["controller"] != _BOUND]
    rivals = ranking if rivals.empty else rivals
    ends = rivals[["rmse_percent", "rmse_percent_low", "rmse_percent_high"]].to_numpy().ravel()
    nominal = rivals["seed_0_rmse_percent"].to_numpy()
    shown = np.concatenate([ends, nominal[nominal > _NEAR * np.nanmin(ends)]])
    return float(np.nanmin(shown)) / 1.5, float(np.nanmax(shown)) * 1.5


def off_axis(
    ranking: pd.DataFrame, names: Sequence[str], low: float
) -> Iterator[tuple[str, float]]:
    """Yield the names whose mean, or else error of seed 0, lies before the axis, and that error (%)."""
    columns = zip(names, ranking["rmse_percent"], ranking["seed_0_rmse_percent"], strict=True)
    for name, mean, nominal in columns:
        if min(mean, nominal) < low:
            yield name, float(mean if mean < low else nominal)


def frequency_charts(by_case: pd.DataFrame, order: Sequence[str]) -> dict[str, Chart]:
    """Draw the error over the sines' frequency, a chart for each plant and sampling time."""
    return _by_setting(by_case[by_case["reference"] == "sine"], order, _frequency_panel)


def effort_charts(by_sampling_time: pd.DataFrame, order: Sequence[str]) -> dict[str, Chart]:
    """Draw the error over the command's effort, a chart for each plant and sampling time."""
    return _by_setting(by_sampling_time, order, _effort_panel)


def _by_setting(
    rows: pd.DataFrame,
    order: Sequence[str],
    draw: Callable[[pd.DataFrame, Sequence[str]], Panel],
) -> dict[str, Chart]:
    height = 520 + 8 * len(order)
    return {
        _setting(plant, ts): Chart([draw(part, order)], height, legend="below")
        for (plant, ts), part in rows.groupby(["plant", "ts_s"], sort=False)
    }


def _frequency_panel(sines: pd.DataFrame, order: Sequence[str], title: str = "") -> Panel:
    lines = []
    for name in order:
        line = sines[sines["controller"] == name].sort_values("frequency_hz")
        colour, symbol, feedback = look(name)
        if not line.empty:
            lines.append(
                Series(
                    line["frequency_hz"], line["rmse_percent"], name, colour, "dot" if feedback else "solid",
                    1.5, symbol, 7.0, errors=_interval(line) if title else None,
                    data=line[["rmse_percent_low", "rmse_percent_high"]], tagged=True,
                    hover="%{x:g} Hz: %{y:.3g} % (%{customdata[0]:.2g} to %{customdata[1]:.2g} %)",
                )
            )  # fmt: skip
    x = Axis("Frequency (Hz)", log=True, ticks="1-2-5")
    return Panel(lines, x, Axis(_RMSE, log=True), title)


def _effort_panel(rows: pd.DataFrame, order: Sequence[str]) -> Panel:
    points = []
    for name in order:
        point = rows[rows["controller"] == name]
        colour, symbol, feedback = look(name)
        if not point.empty:
            points.append(
                Series(
                    point["command_total_variation"], point["rmse_percent"], name, colour, None,
                    marker=f"{symbol}-open" if feedback else symbol, size=11.0, edge=2.0, tagged=True,
                    hover="effort %{x:.3g}, error %{y:.3g} %",
                )
            )  # fmt: skip
    x = Axis("Command's total variation / smallest that tracks", log=True)
    return Panel(points, x, Axis(_RMSE, log=True))


def _setting(plant: object, ts_s: Any) -> str:
    return f"{plant}, Ts = {1e6 * ts_s:g} µs"


def pair_figure(traces: Mapping[str, Mapping[str, Any]], first: str, second: str) -> Any:
    """Draw the reference, and error and command of two controllers that the reader chooses.

    The choice is for pages alone: returns a Plotly figure.
    """
    names = list(traces)
    stride = -(-len(traces[names[0]]["reference_um"]) // _PAIR_SAMPLES)
    step_ms = stride * 1e3 * traces[names[0]]["step_s"]
    reference = single(traces[names[0]]["reference_um"][::stride])
    marks: list[list[Mark]] = [
        [Series(step_ms, reference, "reference", REFERENCE, width=3.0)], [], [],
    ]  # fmt: skip
    menus = []
    # one below the other: side by side they would overlap on a narrow screen
    roles: tuple[tuple[str, str, str, Dash, float], ...] = (
        ("A", first, PALETTE[0], "solid", 1.26),
        ("B", second, PALETTE[1], "dash", 1.187),
    )
    for role, chosen, colour, dash, place in roles:
        for name in names:
            for row, key in enumerate(("error_um", "command_V"), start=1):
                marks[row].append(
                    Series(
                        step_ms, single(traces[name][key][::stride]), f"{role}: {name}", colour, dash, 1.5,
                        visible=name == chosen, listed=row == 1,
                    )
                )  # fmt: skip
        menus.append(_menu(role, names, chosen, place))
    axes = (Axis("Reference (µm)"), Axis("Error (µm)"), Axis("Command (V)"))
    panels = [Panel(part, y=axis) for part, axis in zip(marks, axes, strict=True)]
    panels[-1] = Panel(marks[-1], Axis("Time (ms)"), axes[-1])
    figure = plotly_figure(stacked(panels, (0.2, 0.45, 0.35), 760))
    order = [trace.name for trace in figure.data]
    for role, menu in zip("AB", menus, strict=True):
        members = [i for i, name in enumerate(order) if name.startswith(f"{role}: ")]
        for button in menu["buttons"]:
            shown = [order[i] == button["label"] for i in members]
            button["args"] = [{"visible": shown}, members]
    for trace in figure.data:
        if trace.visible == "legendonly":
            trace.visible = False
    return figure.update_layout(
        updatemenus=menus, margin={"t": 180}, legend={"y": 1.01}, hovermode="x unified"
    )


def _menu(role: str, names: Sequence[str], chosen: str, place: float) -> dict[str, Any]:
    buttons = [{"label": f"{role}: {figure_text(name)}", "method": "restyle"} for name in names]
    return {
        "buttons": buttons, "active": names.index(chosen), "direction": "down", "x": 0.0, "xanchor": "left",
        "y": place, "yanchor": "top", "showactive": True, "font": {"size": 12}, "pad": {"t": 0},
    }  # fmt: skip


def measured_charts(traces: Mapping[str, Mapping[str, Array]]) -> dict[str, Chart]:
    """Draw applied voltage and commands of each measured record, and their differences."""
    charts = {}
    for record, columns in traces.items():
        applied = columns["applied"]
        kept = thin_index(applied, samples=_RECORD_SAMPLES)
        t = columns["t_s"][kept]
        above: list[Mark] = [Series(t, applied[kept], "applied", INK, width=3.0)]
        below: list[Mark] = []
        for name in (name for name in columns if name not in ("t_s", "applied")):
            colour, symbol, _ = look(name)
            for marks, y in ((above, columns[name]), (below, columns[name] - applied)):
                marks.append(
                    Series(
                        t, single(y[kept]), name, colour, _DASHES.get(symbol, "solid"), 1.3, group=name,
                        listed=marks is above,
                    )
                )  # fmt: skip
        panels = [
            Panel(above, y=Axis("Voltage (V)")),
            Panel(below, Axis("Time (s)"), Axis("Command − applied (V)")),
        ]
        chart = stacked(panels, (0.5, 0.5), 640)
        charts[record] = Chart(
            chart.panels, 640, heights=chart.heights, shared="x", row_gap=0.05, legend="below"
        )
    return charts
