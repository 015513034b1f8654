"""Figures of the benchmark: ranking, error against frequency and effort, traces of a pair."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import ArrayLike
from plotly.subplots import make_subplots

from rdpi_gym.report.style import INK, MUTED, PALETTE, REFERENCE, figure_text, styled
from rdpi_gym.report.thin import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import number

_BOUND = "full-preview-inversion"
# Errors of seed 0 that are smaller than this part of the smallest mean do not widen the axis.
_NEAR = 0.05
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
_DASHES = {"x": "dot", "circle": "solid", "square": "dash", "diamond": "dashdot"}


def look(controller: str) -> dict[str, str]:
    """Return colour, symbol and dash of a controller, the same in every figure."""
    feedforward = controller.removeprefix("pi-")
    known = () if ":" in controller else _COLOURS
    family = next((name for name in known if feedforward.startswith(name)), "")
    ending = next((name for name in _SYMBOLS if feedforward.endswith(name)), "")
    return {
        "color": _COLOURS.get(family, PALETTE[3]),
        "symbol": _SYMBOLS.get(ending, "triangle-up"),
        "dash": "solid" if feedforward == controller else "dot",
    }


def ranking_figure(ranking: pd.DataFrame) -> Any:
    """Draw the geometric mean of every controller's error with its confidence interval."""
    shown = ranking.dropna(subset=["rmse_percent"])
    names = [figure_text(name).replace("\n", "<br>") for name in marked_names(shown)]
    figure = go.Figure()
    figure.add_scatter(
        x=shown["rmse_percent"],
        y=names,
        mode="markers",
        name="drawn truths, with confidence interval",
        marker={"size": 9, "color": [look(name)["color"] for name in shown["controller"]]},
        error_x={
            "type": "data",
            "symmetric": False,
            "array": (shown["rmse_percent_high"] - shown["rmse_percent"]).fillna(0.0),
            "arrayminus": (shown["rmse_percent"] - shown["rmse_percent_low"]).fillna(0.0),
            "color": MUTED,
            "thickness": 1.2,
        },
        customdata=shown["optimality_gap"],
        hovertemplate="%{y}: %{x:.3g} %, optimality gap %{customdata:.3g}<extra></extra>",
    )
    figure.add_scatter(
        x=shown["seed_0_rmse_percent"],
        y=names,
        mode="markers",
        name="seed 0, where the belief is true",
        marker={"size": 8, "symbol": "line-ns-open", "color": INK, "line": {"width": 2}},
        hovertemplate="%{y}, seed 0: %{x:.3g} %<extra></extra>",
    )
    low, high = ranking_range(shown)
    for name, value in off_axis(shown, names, low):
        figure.add_annotation(
            x=float(np.log10(low)),
            y=name,
            text=f"\N{BLACK LEFT-POINTING POINTER} {number(value, 2)} %",
            showarrow=False,
            xanchor="left",
            font={"color": INK, "size": 11},
        )
    figure.update_xaxes(
        type="log",
        title_text=_RMSE,
        range=[float(np.log10(low)), float(np.log10(high))],
        dtick="D2",
    )
    figure.update_yaxes(autorange="reversed")
    lines = len(shown) + sum("<br>" in name for name in names)
    return styled(figure, 160 + 26 * lines)


def ranked_names(ranking: pd.DataFrame) -> list[str]:
    """Name the controllers, each with its rank before it where there is one."""
    names = [str(name) for name in ranking["controller"]]
    ranks = ranking["rank"] if "rank" in ranking.columns else [""] * len(names)
    return [f"{rank} {name}".strip() for rank, name in zip(ranks, names, strict=True)]


def statuses(ranking: pd.DataFrame) -> list[str]:
    """Return what is to be beware of in each controller's rows; nothing where that is nothing."""
    if "status" not in ranking.columns:
        return [""] * len(ranking)
    said = [str(text).removeprefix("bound").removeprefix(", ") for text in ranking["status"]]
    return ["" if text == "ok" else text for text in said]


def marked_names(ranking: pd.DataFrame) -> list[str]:
    r"""Name the controllers, each with its status in a line below where there is one to beware of."""
    pairs = zip(ranked_names(ranking), statuses(ranking), strict=True)
    return [f"{name}\n({said})" if said else name for name, said in pairs]


def ranking_range(ranking: pd.DataFrame) -> tuple[float, float]:
    """Return the axis (%) that shows every mean and interval of controllers that compete.

    A bound's error is next to none and would push all others together, as would that of an inverse
    whose belief is the truth: they stand at the axis's end, see :func:`off_axis`.
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


def frequency_figures(by_case: pd.DataFrame, order: Sequence[str]) -> dict[str, Any]:
    """Draw the error over the sines' frequency, a figure for each plant and sampling time."""
    sines = by_case[by_case["reference"] == "sine"]
    figures = {}
    for (plant, ts), part in sines.groupby(["plant", "ts_s"], sort=False):
        figure = go.Figure()
        for name in order:
            line = part[part["controller"] == name].sort_values("frequency_hz")
            if not line.empty:
                _add_line(figure, name, line)
        figure.update_xaxes(type="log", title_text="Frequency (Hz)", dtick="D2")
        figures[_setting(plant, ts)] = _with_legend(figure, len(order))
    return figures


def effort_figures(by_sampling_time: pd.DataFrame, order: Sequence[str]) -> dict[str, Any]:
    """Draw the error over the command's effort, a figure for each plant and sampling time."""
    figures = {}
    for (plant, ts), part in by_sampling_time.groupby(["plant", "ts_s"], sort=False):
        figure = go.Figure()
        for name in order:
            point = part[part["controller"] == name]
            if not point.empty:
                _add_point(figure, name, point["command_total_variation"], point["rmse_percent"])
        figure.update_xaxes(
            type="log", title_text="Command's total variation / smallest that tracks"
        )
        figures[_setting(plant, ts)] = _with_legend(figure, len(order))
    return figures


def _add_line(figure: Any, name: str, line: pd.DataFrame) -> None:
    style = look(name)
    figure.add_scatter(
        x=line["frequency_hz"],
        y=line["rmse_percent"],
        name=figure_text(name),
        mode="lines+markers",
        line={"color": style["color"], "dash": style["dash"], "width": 1.5},
        marker={"symbol": style["symbol"], "size": 7},
        customdata=line[["rmse_percent_low", "rmse_percent_high"]],
        hovertemplate="%{x:g} Hz: %{y:.3g} % (%{customdata[0]:.2g} to %{customdata[1]:.2g} %)"
        f"<extra>{figure_text(name)}</extra>",
    )


def _add_point(figure: Any, name: str, x: Any, y: Any) -> None:
    style = look(name)
    symbol = style["symbol"] if style["dash"] == "solid" else f"{style['symbol']}-open"
    figure.add_scatter(
        x=x,
        y=y,
        name=figure_text(name),
        mode="markers",
        marker={"symbol": symbol, "size": 11, "color": style["color"], "line": {"width": 2}},
        hovertemplate="effort %{x:.3g}, error %{y:.3g} %<extra>" + figure_text(name) + "</extra>",
    )


def _setting(plant: object, ts_s: Any) -> str:
    return f"{plant}, Ts = {1e6 * ts_s:g} µs"


def _with_legend(figure: Any, entries: int) -> Any:
    figure.update_yaxes(type="log", title_text=_RMSE)
    styled(figure, 520 + 8 * entries)
    figure.update_layout(
        legend={"orientation": "h", "x": 0, "y": -0.16, "yanchor": "top", "entrywidth": 250},
        margin={"t": 20},
    )
    return figure


def pair_figure(traces: Mapping[str, Mapping[str, Any]], first: str, second: str) -> Any:
    """Draw displacement, error and command of two controllers that the reader chooses."""
    names = list(traces)
    figure = make_subplots(
        rows=3, cols=1, shared_xaxes=True, row_heights=[0.38, 0.31, 0.31], vertical_spacing=0.05
    )
    any_trace = traces[names[0]]
    axis = {"x0": 0.0, "dx": 1e3 * any_trace["step_s"]}
    figure.add_scatter(
        y=_short(any_trace["reference_um"]),
        name="reference",
        line={"color": REFERENCE, "width": 3},
        row=1,
        col=1,
        **axis,
    )
    menus = []
    # one below the other: side by side they would overlap on a narrow screen
    for role, chosen, colour, place in (
        ("A", first, PALETTE[0], 1.26),
        ("B", second, PALETTE[1], 1.187),
    ):
        begin = len(figure.data)
        for name in names:
            for row, key in enumerate(("displacement_um", "error_um", "command_V"), start=1):
                figure.add_scatter(
                    y=_short(traces[name][key]),
                    name=f"{role}: {figure_text(name)}",
                    line={
                        "color": colour,
                        "width": 1.5,
                        "dash": "solid" if role == "A" else "dash",
                    },
                    visible=name == chosen,
                    showlegend=row == 1,
                    row=row,
                    col=1,
                    **axis,
                )
        members = list(range(begin, len(figure.data)))
        menus.append(_menu(role, names, chosen, members, place))
    figure.update_yaxes(title_text="Displacement (µm)", row=1, col=1)
    figure.update_yaxes(title_text="Error (µm)", row=2, col=1)
    figure.update_yaxes(title_text="Command (V)", row=3, col=1)
    figure.update_xaxes(title_text="Time (ms)", row=3, col=1)
    styled(figure, 810)
    figure.update_layout(
        updatemenus=menus,
        margin={"t": 180},
        legend={"y": 1.01},
        hovermode="x unified",
    )
    return figure


def _menu(role: str, names: Sequence[str], chosen: str, members: list[int], place: float) -> Any:
    buttons = [
        {
            "label": f"{role}: {figure_text(name)}",
            "method": "restyle",
            "args": [{"visible": [other == name for other in names for _ in range(3)]}, members],
        }
        for name in names
    ]
    return {
        "buttons": buttons,
        "active": names.index(chosen),
        "direction": "down",
        "x": 0.0,
        "xanchor": "left",
        "y": place,
        "yanchor": "top",
        "showactive": True,
        "font": {"size": 12},
        "pad": {"t": 0},
    }


def _short(values: ArrayLike) -> Any:
    # single precision halves the page and is far finer than a screen
    return np.asarray(values, dtype=np.float32)


def measured_figures(traces: Mapping[str, Mapping[str, Array]]) -> dict[str, Any]:
    """Draw applied voltage and commands of each measured record, and what they differ by."""
    figures = {}
    for record, columns in traces.items():
        names = [name for name in columns if name not in ("t_s", "applied")]
        figure = make_subplots(
            rows=2, cols=1, shared_xaxes=True, row_heights=[0.5, 0.5], vertical_spacing=0.05
        )
        applied = columns["applied"]
        kept = thin_index(applied, samples=800)
        t = columns["t_s"][kept]
        figure.add_scatter(
            x=t, y=applied[kept], name="applied", line={"color": INK, "width": 3}, row=1, col=1
        )
        for name in names:
            style = look(name)
            command = columns[name]
            for row, y in ((1, command), (2, command - applied)):
                figure.add_scatter(
                    x=t,
                    y=_short(y[kept]),
                    name=figure_text(name),
                    legendgroup=name,
                    showlegend=row == 1,
                    line={
                        "color": style["color"],
                        "dash": _DASHES.get(style["symbol"], "solid"),
                        "width": 1.3,
                    },
                    row=row,
                    col=1,
                )
        figure.update_yaxes(title_text="Voltage (V)", row=1, col=1)
        figure.update_yaxes(title_text="Command − applied (V)", row=2, col=1)
        figure.update_xaxes(title_text="Time (s)", row=2, col=1)
        styled(figure, 640)
        figure.update_layout(
            legend={"orientation": "h", "x": 0, "y": -0.12, "yanchor": "top", "entrywidth": 250},
            margin={"t": 20},
        )
        figures[record] = figure
    return figures
