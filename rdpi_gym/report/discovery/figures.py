"""Figures of a search for missing effects: its steps, its candidates, its records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rdpi_gym.diagnosis.results import Candidate, Errors
from rdpi_gym.report.discovery.view_figures import AFTER, BEFORE, FLOOR
from rdpi_gym.report.style import INK, MUTED, PALETTE, figure_text, styled

_CLASS, _OTHER = "#8CBFE0", "#C3CAD1"
_ROOM = 1.3  # the axis of errors reaches so far beyond the error without a candidate
_SLIVER = 1e-3  # of that axis


def staircase(stairs: Sequence[tuple[str, Errors]], noise_floor_um: float) -> Any:
    """Draw the error of training and validation records, model by model."""
    names = [figure_text(name) for name, _ in stairs]
    figure = go.Figure()
    kinds = (
        ("validation records", [e.validation_rmse_um for _, e in stairs], AFTER, "solid"),
        ("training records", [e.train_rmse_um for _, e in stairs], MUTED, "dot"),
    )
    for kind, errors, colour, dash in kinds:
        figure.add_scatter(
            x=names,
            y=[_finite(error) for error in errors],
            name=kind,
            mode="lines+markers+text" if kind.startswith("validation") else "lines+markers",
            text=[f"{error:.3g}" if math.isfinite(error) else "none" for error in errors],
            textposition="top center",
            line={"color": colour, "dash": dash, "shape": "hvh", "width": 2},
            marker={"size": 9},
            cliponaxis=False,
            hovertemplate="%{x}: %{y:.4g} {output_unit}<extra>" + kind + "</extra>",
        )
    _floor_line(figure, noise_floor_um, axis="y")
    known = [v for _, values, _, _ in kinds for v in values if math.isfinite(v) and v > 0]
    limits = {"linear": [0.0, 1.15 * max([*known, noise_floor_um])]}
    low, high = min([*known, noise_floor_um or math.inf]), max([*known, noise_floor_um])
    wide = low > 0 and high / low > 30.0
    if low > 0:
        limits["log"] = [math.log10(low / 1.6), math.log10(high * 1.6)]
    chosen = "log" if wide else "linear"
    figure.update_yaxes(title_text="RMS error ({output_unit})", **_axis(chosen, limits[chosen]))
    figure.update_xaxes(range=[-0.5, len(names) - 0.5], showgrid=False)
    return _with_scale_buttons(styled(figure, 440), limits, chosen)


def _axis(kind: str, reach: list[float]) -> dict[str, Any]:
    """Give an axis its kind and reach; a logarithmic one ticks at 1, 2 and 5 of each decade."""
    if kind == "linear":
        return {"type": kind, "range": reach, "tickvals": None, "ticktext": None}
    decades = 10.0 ** np.arange(math.floor(reach[0]), math.ceil(reach[1]))
    ticks = np.outer(decades, [1.0, 2.0, 5.0]).ravel().tolist()
    return {
        "type": kind, "range": reach, "tickvals": ticks, "ticktext": [f"{t:.4g}" for t in ticks],
    }  # fmt: skip


def _with_scale_buttons(figure: Any, limits: Mapping[str, list[float]], chosen: str) -> Any:
    if len(limits) < 2:
        return figure
    buttons = [
        {
            "label": f"{kind} scale",
            "method": "relayout",
            "args": [{f"yaxis.{key}": value for key, value in _axis(kind, reach).items()}],
        }
        for kind, reach in limits.items()
    ]
    # in a row of their own over the legend, which may be as wide as the figure
    margin_px = 92
    plot_px = figure.layout.height - margin_px - figure.layout.template.layout.margin.b
    return figure.update_layout(
        margin_t=margin_px,
        updatemenus=[
            {
                "type": "buttons",
                "direction": "right",
                "buttons": buttons,
                "active": list(limits).index(chosen),
                "x": 0.0,
                "xanchor": "left",
                "y": 1.0 + 40.0 / plot_px,
                "yanchor": "bottom",
                "font": {"size": 12},
            }
        ],
    )


def ranking(
    candidates: Sequence[Candidate], noise_floor_um: float, without: Errors, taken: Sequence[str]
) -> Any:
    """Draw the validation error of every candidate of a round, its confidence and its share."""
    figure = make_subplots(
        rows=1,
        cols=2,
        shared_yaxes=True,
        column_widths=[0.64, 0.36],
        horizontal_spacing=0.04,
        subplot_titles=["Validation error,<br>candidate added", "Confidence,<br>share"],
    )
    names = [figure_text(c.effect) for c in candidates]
    reach = _ROOM * max(without.validation_rmse_um, noise_floor_um, 1e-12)
    _error_bars(figure, candidates, taken, reach)
    _certainty_dots(figure, candidates)
    _floor_line(figure, noise_floor_um, axis="x")
    _line(figure, without.validation_rmse_um, "without a candidate", BEFORE, axis="x")
    figure.update_xaxes(
        title_text="RMS error ({output_unit})", range=[0.0, reach], nticks=4, row=1, col=1
    )
    figure.update_xaxes(title_text="Value (%)", range=[-8.0, 108.0], row=1, col=2)
    figure.update_xaxes(tickangle=0)
    figure.update_annotations(font_size=13)  # titles fit over their panels on a narrow page
    figure.update_yaxes(
        categoryorder="array", categoryarray=names, range=[len(names) - 0.4, -0.6], showgrid=False
    )
    styled(figure, round(190 + 27 * len(names)))
    return figure.update_layout(
        barmode="overlay",
        legend={"y": -70.0 / (figure.layout.height - 130.0), "yanchor": "top"},
        margin={"b": 110},
    )


def _error_bars(
    figure: Any, candidates: Sequence[Candidate], taken: Sequence[str], reach: float
) -> None:
    """Draw a bar a candidate, coloured by whether it, or a rival of it, was taken."""
    rivals = {name for c in candidates if c.effect in taken for name in c.indistinguishable}
    groups: dict[str, tuple[str, list[Candidate]]] = {
        "the choice": (AFTER, []),
        "indistinguishable from it": (_CLASS, []),
        "others": (_OTHER, []),
    }
    for candidate in candidates:
        rival = "indistinguishable from it" if candidate.effect in rivals else "others"
        groups["the choice" if candidate.effect in taken else rival][1].append(candidate)
    for group, (colour, members) in groups.items():
        if members:
            figure.add_bar(
                x=[_length(c.errors.validation_rmse_um, reach) for c in members],
                y=[figure_text(c.effect) for c in members],
                orientation="h",
                width=0.68,
                name=group,
                marker_color=colour,
                text=[_bar_text(c, reach) for c in members],
                textposition="auto",
                insidetextanchor="end",
                textangle=0,
                hovertext=[_hover(c) for c in members],
                hovertemplate="%{hovertext}<extra></extra>",
                row=1,
                col=1,
            )


def _length(error_um: float, reach: float) -> float:
    """Keep a bar on the axis; one without an error is a sliver, since an empty bar shows no text."""
    return min(error_um, reach) if math.isfinite(error_um) else _SLIVER * reach


def _certainty_dots(figure: Any, candidates: Sequence[Candidate]) -> None:
    """Mark confidence and share of each candidate; what is far outside stands at the edge."""
    dots = (
        ("confidence", "circle", PALETTE[0], [100.0 * c.confidence for c in candidates]),
        ("share of the excess gone", "diamond-open", INK, [100.0 * c.share for c in candidates]),
    )
    for name, symbol, colour, values in dots:
        figure.add_scatter(
            x=[None if _finite(v) is None else min(max(v, -5.0), 105.0) for v in values],
            y=[figure_text(c.effect) for c in candidates],
            customdata=[_finite(v) for v in values],
            mode="markers",
            name=name,
            marker={"symbol": symbol, "size": 9, "color": colour},
            hovertemplate="%{y}: %{customdata:.3g} %<extra>" + name + "</extra>",
            row=1,
            col=2,
        )


def _bar_text(candidate: Candidate, reach: float) -> str:
    error = candidate.errors.validation_rmse_um
    if not math.isfinite(error):
        return "did not converge"
    mark = " (!)" if candidate.remarks else ""
    return f"{error:.3g}{' →' if error > reach else ''}{mark}"


def _hover(candidate: Candidate) -> str:
    lines = [
        f"<b>{figure_text(candidate.effect)}</b>",
        f"validation {candidate.errors.validation_rmse_um:.4g} {{output_unit}}, "
        f"training {candidate.errors.train_rmse_um:.4g} {{output_unit}}",
    ]
    if candidate.indistinguishable:
        lines.append(
            f"indistinguishable from {figure_text(', '.join(candidate.indistinguishable))}"
        )
    lines += [figure_text(remark) for remark in candidate.remarks]
    return "<br>".join(lines)


def records(
    stairs: Sequence[tuple[str, Errors]], roles: Mapping[str, str], noise_floor_um: float
) -> Any:
    """Draw the error of every record before and after."""
    names = list(dict.fromkeys(name for _, errors in stairs for name in errors.by_record_um))
    labels = [
        figure_text(f"{name} ({roles[name]})" if name in roles else name) for name in names
    ]  # fmt: skip
    ends = [stairs[0], stairs[-1]] if len(stairs) > 1 else [stairs[-1]]
    figure = go.Figure()
    if len(ends) == 2:
        for label, name in zip(labels, names, strict=True):
            pair = [_finite(errors.by_record_um.get(name, math.nan)) for _, errors in ends]
            figure.add_scatter(
                x=pair,
                y=[label, label],
                mode="lines",
                line={"color": _OTHER, "width": 3},
                showlegend=False,
                hoverinfo="skip",
            )
    for (step, errors), colour in zip(ends, (BEFORE, AFTER)[-len(ends) :], strict=True):
        figure.add_scatter(
            x=[_finite(errors.by_record_um.get(name, math.nan)) for name in names],
            y=labels,
            mode="markers",
            name=figure_text(step),
            marker={"size": 10, "color": colour},
            hovertemplate="%{y}: %{x:.4g} {output_unit}<extra>" + figure_text(step) + "</extra>",
        )
    _floor_line(figure, noise_floor_um, axis="x")
    figure.update_xaxes(title_text="RMS error ({output_unit})", rangemode="tozero")
    figure.update_yaxes(
        categoryorder="array", categoryarray=labels, range=[len(labels) - 0.4, -0.6]
    )
    return styled(figure, round(150 + 25 * len(labels)))


def _floor_line(figure: Any, noise_floor_um: float, axis: str) -> None:
    _line(figure, noise_floor_um, "noise floor", FLOOR, axis)


def _line(figure: Any, value_um: float, name: str, colour: str, axis: str) -> None:
    """Draw a line across the first panel, its name in the legend."""
    style = {"color": colour, "dash": "dash", "width": 1.6}
    across = "y" if axis == "x" else "x"
    if math.isfinite(value_um):
        figure.add_shape(
            type="line",
            line=style,
            **{f"{axis}0": value_um, f"{axis}1": value_um, f"{across}0": 0, f"{across}1": 1},
            **{f"{axis}ref": axis, f"{across}ref": f"{across} domain"},
        )
    figure.add_scatter(
        x=[None],
        y=[None],
        mode="lines",
        line=style,
        name=f"{name}, {value_um:.3g} {{output_unit}}",
        hoverinfo="skip",
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
