"""Figures of one record beside several models of it: before an effect was added, and after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from rdpi_gym.diagnosis.comparison.residual_views import Profile, ResidualProfiles, view_trace
from rdpi_gym.diagnosis.results import View
from rdpi_gym.report.style import MEASURED, MODEL, PALETTE, figure_text, styled
from rdpi_gym.report.thin import DISPLAY_SAMPLES, thin_index
from rdpi_gym.report.trace_figures import (
    DISPLACEMENT_UM,
    axis_range,
    gapped,
    loop_index,
    shade_left_out,
)
from rdpi_gym.support.arrays import Array

BEFORE, AFTER = PALETTE[1], MODEL
"""Colours of the first model and of the last, on every figure of the laboratory."""
FLOOR = PALETTE[2]
"""Colour of the noise floor."""
_BETWEEN = (PALETTE[3], PALETTE[4], PALETTE[5], PALETTE[6])
_BAND_ALPHA = 0.16


@dataclass(frozen=True)
class Look:
    """How a model is drawn: its name in the legend, its colour, shown at once or on demand."""

    name: str
    colour: str
    visible: bool | str


def looks(labels: list[str]) -> dict[str, Look]:
    """Give every model its look: the first orange, the last blue, those between on demand."""
    found = {
        label: Look(figure_text(label), _BETWEEN[i % len(_BETWEEN)], "legendonly")
        for i, label in enumerate(labels)
    }
    if labels:
        found[labels[0]] = Look(figure_text(labels[0]), BEFORE, True)
        found[labels[-1]] = Look(figure_text(labels[-1]), AFTER, True)
    return found


def over_time(view: View, noise_floor_um: float, samples: int = DISPLAY_SAMPLES) -> Any:
    """Draw measured and modelled displacement over time, below them what is left."""
    figure = _over_time(view, thin_index(view.y_um, *_ends(view), samples=samples), noise_floor_um)
    if view.models_um:
        shade_left_out(figure, view_trace(view, next(iter(view.models_um))))
    return figure


def largest_error(view: View, noise_floor_um: float, samples: int = DISPLAY_SAMPLES) -> Any:
    """Draw the half-cycle in which the first model is farthest off, and its two neighbours."""
    trace = view_trace(view, next(iter(view.models_um)))
    edges = trace.cycles.edges
    worst = int(np.argmax(np.where(trace.counted, np.abs(trace.residual_um), -1.0)))
    at = int(np.searchsorted(edges, worst, side="right")) - 1
    around = np.arange(edges[max(0, at - 1)], edges[min(edges.size - 1, at + 2)])
    thinned = thin_index(
        view.y_um[around], *(e[around] for e in _ends(view)), samples=samples
    )  # fmt: skip
    return _over_time(view, around[thinned], noise_floor_um)


def _ends(view: View) -> list[Array]:
    """Residuals of the first model and of the last: of these no peak may be lost."""
    models = list(view.models_um.values())
    return [view.y_um - model for model in (models[:1] + models[1:][-1:])]


def _over_time(view: View, k: NDArray[np.intp], noise_floor_um: float) -> Any:
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.55, 0.45], vertical_spacing=0.06
    )
    t = view.t_s[k]
    figure.add_scatter(
        x=t, y=_single(view.y_um[k]), name="measured", line={"color": MEASURED}, row=1, col=1
    )
    counted = np.asarray(view.counted, dtype=np.bool_)[k]
    shown = k[counted] if counted.any() else k
    heights, errors = [view.y_um[shown]], [np.array([-noise_floor_um, noise_floor_um])]
    for label, look in looks(list(view.models_um)).items():
        model = view.models_um[label]
        common: dict[str, Any] = {
            "x": t, "name": look.name, "legendgroup": label, "visible": look.visible, "col": 1,
        }  # fmt: skip
        line = {"color": look.colour, "width": 1.4}
        figure.add_scatter(y=_single(model[k]), line={**line, "dash": "dot"}, row=1, **common)
        figure.add_scatter(
            y=_single((view.y_um - model)[k]),
            line={**line, "width": 1},
            showlegend=False,
            row=2,
            **common,
        )
        if look.visible is True:
            heights.append(model[shown])
            errors.append((view.y_um - model)[shown])
    _band(figure, noise_floor_um, row=2, col=1, legend=True)
    figure.update_yaxes(
        title_text=DISPLACEMENT_UM, range=axis_range(np.concatenate(heights)), row=1, col=1
    )
    figure.update_yaxes(
        title_text="Measured − model ({output_unit})",
        range=axis_range(np.concatenate(errors)),
        row=2,
        col=1,
    )
    figure.update_xaxes(title_text="Time (s)", row=2, col=1)
    return styled(figure, 600)


def loops(view: View, noise_floor_um: float, samples: int = 2 * DISPLAY_SAMPLES) -> Any:
    """Draw displacement over command with the models', and beside it what each leaves."""
    labels = list(view.models_um)
    k = loop_index(view_trace(view, labels[0]), samples)
    u = gapped(view.u_V, k)
    figure = make_subplots(
        rows=1,
        cols=2,
        horizontal_spacing=0.11,
        subplot_titles=["Loops", "What is left"],
    )
    figure.add_scatter(
        x=u, y=gapped(view.y_um, k), name="measured", line={"color": MEASURED}, row=1, col=1
    )
    errors = [np.array([-noise_floor_um, noise_floor_um])]
    known = k[k >= 0]
    for label, look in looks(labels).items():
        model = view.models_um[label]
        for col, values in ((1, model), (2, view.y_um - model)):
            figure.add_scatter(
                x=u,
                y=gapped(values, k),
                name=look.name,
                legendgroup=label,
                showlegend=col == 1,
                visible=look.visible,
                line={"color": look.colour, "width": 1},
                row=1,
                col=col,
            )
        if look.visible is True:
            errors.append((view.y_um - model)[known])
    _band(figure, noise_floor_um, row=1, col=2, legend=True)
    figure.update_xaxes(title_text="Command ({input_unit})")
    figure.update_yaxes(title_text=DISPLACEMENT_UM, row=1, col=1)
    figure.update_yaxes(
        title_text="Measured − model ({output_unit})",
        range=axis_range(np.concatenate(errors)),
        row=1,
        col=2,
    )
    return styled(figure, 480)


def residuals(profiles: Mapping[str, ResidualProfiles], noise_floor_um: float, ts_s: float) -> Any:
    """Draw what each model leaves over command, rate, time at rest and frequency."""
    held = any(p.hold is not None for p in profiles.values())
    titles = ["Over the command", "Over its rate", "Over the frequency"]
    if held:
        titles.append("While the command rests")
    figure = make_subplots(
        rows=2,
        cols=2,
        specs=[[{}, {}], [{}, {}] if held else [{"colspan": 2}, None]],
        horizontal_spacing=0.11,
        vertical_spacing=0.2,
        subplot_titles=titles,
    )
    for label, look in looks(list(profiles)).items():
        of = profiles[label]
        _means(figure, of.rising, look, label, 1, 1, legend=True)
        _means(figure, of.falling, look, label, 1, 1, dash="dot")
        # a record has few rates: no line leads from one to the next
        _means(figure, of.rate, look, label, 1, 2, mode="markers")
        figure.add_scatter(
            x=_single(of.frequency_hz),
            y=_single(of.density_um),
            name=look.name,
            legendgroup=label,
            showlegend=False,
            visible=look.visible,
            line={"color": look.colour, "width": 1.2},
            hovertemplate="%{x:.4g} Hz: %{y:.3g} {output_unit}/√Hz<extra>" + look.name + "</extra>",
            row=2,
            col=1,
        )
        if of.hold is not None:
            _means(figure, of.hold, look, label, 2, 2)
    for row, col in ((1, 1), (1, 2), *([(2, 2)] if held else [])):
        _band(figure, noise_floor_um, row=row, col=col, legend=(row, col) == (1, 1))
    figure.add_hline(
        y=noise_floor_um * float(np.sqrt(2.0 * ts_s)),
        line={"color": FLOOR, "dash": "dash", "width": 1.4},
        row=2,
        col=1,
    )
    figure.update_yaxes(title_text="Mean of measured − model ({output_unit})", row=1, col=1)
    figure.update_yaxes(title_text="Mean of measured − model ({output_unit})", row=1, col=2)
    figure.update_yaxes(
        title_text="Measured − model ({output_unit}/√Hz)",
        type="log",
        exponentformat="power",
        row=2,
        col=1,
    )
    figure.update_xaxes(title_text="Command ({input_unit})", row=1, col=1)
    figure.update_xaxes(title_text="Rate of the command ({input_unit}/s)", row=1, col=2)
    figure.update_xaxes(title_text="Frequency (Hz)", type="log", dtick="D2", row=2, col=1)
    if held:
        figure.update_yaxes(title_text="Onward since the move ({output_unit})", row=2, col=2)
        figure.update_xaxes(
            title_text="Time since the last move (s)", type="log", dtick="D2", row=2, col=2
        )
    return styled(figure, 760)


def _means(
    figure: Any,
    profile: Profile,
    look: Look,
    label: str,
    row: int,
    col: int,
    *,
    legend: bool = False,
    dash: str = "solid",
    mode: str = "lines+markers",
) -> None:
    figure.add_scatter(
        x=profile.x,
        y=_single(profile.mean_um),
        customdata=profile.samples,
        name=look.name,
        legendgroup=label,
        showlegend=legend,
        visible=look.visible,
        mode=mode,
        marker={"size": 5, "color": look.colour},
        line={"color": look.colour, "width": 1.4, "dash": dash},
        hovertemplate="%{x:.4g}: mean %{y:.3g} {output_unit}<br>%{customdata} samples<extra>"
        + look.name
        + "</extra>",
        row=row,
        col=col,
    )


def _band(figure: Any, noise_floor_um: float, row: int, col: int, legend: bool) -> None:
    """Shade what the noise alone may reach: the floor to either side of zero."""
    figure.add_hrect(
        y0=-noise_floor_um,
        y1=noise_floor_um,
        fillcolor=FLOOR,
        opacity=_BAND_ALPHA,
        line_width=0,
        layer="below",
        row=row,
        col=col,
    )
    if legend:
        figure.add_scatter(
            x=[None],
            y=[None],
            mode="markers",
            name="noise floor (± rms)",
            marker={"symbol": "square", "size": 11, "color": FLOOR, "opacity": 0.4},
            hoverinfo="skip",
            row=row,
            col=col,
        )


def _single(values: Array) -> NDArray[np.float32]:
    # seven digits are more than a screen shows, and half the bytes on the page
    return np.asarray(values, dtype=np.float32)
