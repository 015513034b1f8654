"""Charts of a search for missing effects: steps, candidates, records, residuals of the models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.comparison.traces import Profile, ResidualProfiles, view_trace
from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult, View
from rdpi_gym.report.chart import (
    Axis,
    Bars,
    Chart,
    Dash,
    Level,
    Mark,
    Panel,
    Series,
    decade_ticks,
    side_by_side,
    single,
)
from rdpi_gym.report.chart_plotly import plotly_figure
from rdpi_gym.report.comparison import MEAN_UM, RMS_UM
from rdpi_gym.report.discovery_text import staircase
from rdpi_gym.report.style import INK, MEASURED, MODEL, MUTED, PALETTE
from rdpi_gym.report.traces import (
    COMMAND,
    DISPLACEMENT_UM,
    DISPLAY_SAMPLES,
    FLOOR,
    TIME,
    Overlay,
    around_largest_error,
    loops,
    noise_band,
    over_time,
    thin_index,
)

BEFORE, AFTER = PALETTE[1], MODEL
"""Colours of the first model and of the last, on every figure of a search."""
_BETWEEN = (PALETTE[3], PALETTE[4], PALETTE[5], PALETTE[6])
_CLASS, _OTHER = "#8CBFE0", "#C3CAD1"
_ROOM = 1.3  # the axis of errors reaches so far beyond the error without a candidate
_SLIVER = 1e-3  # of that axis
_SHOWN = 8  # candidates beside the steps


def search_chart(result: SearchResult) -> Chart:
    """Draw the error of each model, and of the first candidates of the first round."""
    stairs = [(name.replace(", ", ",\n"), errors) for name, errors in staircase(result)]
    names, steps = _steps(stairs)
    floor = _floor(result.noise_floor_um)
    known = [c for c in result.ranking if math.isfinite(c.errors.validation_rmse_um)][:_SHOWN]
    added = {candidate.effect for candidate in result.added}
    effects = [c.effect for c in known] or ["no candidate"]
    bars = Bars(
        effects,
        [c.errors.validation_rmse_um for c in known] or [0.0],
        colour=[AFTER if name in added else _OTHER for name in effects],
    )
    panels = [
        Panel([*steps, floor], Axis(categories=names, grid=False), Axis(RMS_UM, from_zero=True)),
        Panel(
            [bars, replace(floor, along="x")],
            Axis("RMS error with the candidate ({output_unit})", from_zero=True),
            Axis(categories=effects, reversed=True, grid=False),
        ),
    ]
    return side_by_side(panels)


def staircase_figure(stairs: Sequence[tuple[str, Errors]], noise_floor_um: float) -> Any:
    """Draw the error of training and validation records by model, with a choice of the scale.

    The choice is for pages alone: returns a Plotly figure.
    """
    names, steps = _steps(stairs)
    known = [v for line in steps for v in line.y if v is not None and v > 0]
    limits = {"linear": [0.0, 1.15 * max([*known, noise_floor_um])]}
    low, high = min([*known, noise_floor_um or math.inf]), max([*known, noise_floor_um])
    if low > 0:
        limits["log"] = [math.log10(low / 1.6), math.log10(high * 1.6)]
    chosen = "log" if low > 0 and high / low > 30.0 else "linear"
    panel = Panel(
        [*steps, _floor(noise_floor_um)], Axis(categories=names, grid=False), Axis(RMS_UM)
    )
    figure = plotly_figure(Chart([panel], 440))
    figure.update_yaxes(_scale(chosen, limits[chosen]))
    return _with_scale_buttons(figure, limits, chosen)


def _steps(stairs: Sequence[tuple[str, Errors]]) -> tuple[list[str], list[Series]]:
    """Return the names of the models, and the errors of validation and training records by model."""
    names = [name for name, _ in stairs]
    validation = [errors.validation_rmse_um for _, errors in stairs]
    line = Series(
        names, list(map(_finite, validation)), "validation records", AFTER, "solid", 2.0, "circle", 9.0,
        stepped=True, tagged=True, hover="%{x}: %{y:.4g} {output_unit}",
        texts=[f"{error:.3g}" if math.isfinite(error) else "none" for error in validation],
    )  # fmt: skip
    training = [_finite(errors.train_rmse_um) for _, errors in stairs]
    below = replace(line, y=training, name="training records", colour=MUTED, dash="dot", texts=None)
    return names, [line, below]


def _scale(kind: str, reach: list[float]) -> dict[str, Any]:
    """Give an axis its kind and reach; a logarithmic one ticks at 1, 2 and 5 of each decade."""
    ticks, texts = decade_ticks(reach[0], reach[1]) if kind == "log" else (None, None)
    return {"type": kind, "range": reach, "tickvals": ticks, "ticktext": texts}


def _with_scale_buttons(figure: Any, limits: Mapping[str, list[float]], chosen: str) -> Any:
    if len(limits) < 2:
        return figure
    buttons = [
        {
            "label": f"{kind} scale",
            "method": "relayout",
            "args": [{f"yaxis.{key}": value for key, value in _scale(kind, reach).items()}],
        }
        for kind, reach in limits.items()
    ]
    # in a row of their own over the legend, which may be as wide as the figure
    margin_px = 92
    plot_px = figure.layout.height - margin_px - figure.layout.template.layout.margin.b
    menu = {
        "type": "buttons", "direction": "right", "buttons": buttons, "active": list(limits).index(chosen),
        "x": 0.0, "xanchor": "left", "y": 1.0 + 40.0 / plot_px, "yanchor": "bottom", "font": {"size": 12},
    }  # fmt: skip
    return figure.update_layout(margin_t=margin_px, updatemenus=[menu])


def ranking(
    candidates: Sequence[Candidate], noise_floor_um: float, without: Errors, taken: Sequence[str]
) -> Chart:
    """Draw the validation error of every candidate of a round, its confidence and its share."""
    names = [c.effect for c in candidates]
    base = without.validation_rmse_um
    reach = _ROOM * max(base, noise_floor_um, 1e-12)
    lines = [
        _floor(noise_floor_um, "x"),
        Level(
            base, f"without a candidate, {base:.3g} {{output_unit}}", BEFORE, width=1.6, along="x"
        ),
    ]
    effects = Axis(categories=names, reversed=True, grid=False)
    errors = Axis(RMS_UM, limits=(0.0, reach))
    panels = [
        Panel(
            [*_error_bars(candidates, taken, reach), *lines],
            errors,
            effects,
            "Validation error,\ncandidate added",
        ),
        Panel(
            _certainty_dots(candidates),
            Axis("Value (%)", limits=(-8.0, 108.0)),
            effects,
            "Confidence,\nshare",
        ),
    ]
    return side_by_side(
        panels, round(190 + 27 * len(names)), widths=(0.64, 0.36), gap=0.04, shared="y", legend="below",
    )  # fmt: skip


def _error_bars(candidates: Sequence[Candidate], taken: Sequence[str], reach: float) -> list[Bars]:
    """Return a bar a candidate, coloured by whether it, or a rival of it, was taken."""
    rivals = {name for c in candidates if c.effect in taken for name in c.indistinguishable}
    groups: dict[str, tuple[str, list[Candidate]]] = {
        "the choice": (AFTER, []),
        "indistinguishable from it": (_CLASS, []),
        "others": (_OTHER, []),
    }
    for candidate in candidates:
        rival = "indistinguishable from it" if candidate.effect in rivals else "others"
        groups["the choice" if candidate.effect in taken else rival][1].append(candidate)
    return [
        Bars(
            [c.effect for c in members],
            [_length(c.errors.validation_rmse_um, reach) for c in members],
            group, colour, width=0.68, texts=[_bar_text(c, reach) for c in members],
            names=[_hover(c) for c in members], hover="<b>%{y}</b><br>%{hovertext}",
        )
        for group, (colour, members) in groups.items() if members
    ]  # fmt: skip


def _length(error_um: float, reach: float) -> float:
    """Keep a bar on the axis; one without an error is a sliver, since an empty bar shows no text."""
    return min(error_um, reach) if math.isfinite(error_um) else _SLIVER * reach


def _certainty_dots(candidates: Sequence[Candidate]) -> list[Series]:
    """Return confidence and share of each candidate; values far outside are at the edge."""
    dots = (
        ("confidence", "circle", PALETTE[0], [100.0 * c.confidence for c in candidates]),
        ("share removed", "diamond-open", INK, [100.0 * c.share for c in candidates]),
    )
    return [
        Series(
            [min(max(v, -5.0), 105.0) if math.isfinite(v) else None for v in values],
            [c.effect for c in candidates], name, colour, None, marker=symbol, size=9.0,
            data=list(map(_finite, values)), hover="%{y}: %{customdata:.3g} %", tagged=True,
        )
        for name, symbol, colour, values in dots
    ]  # fmt: skip


def _bar_text(candidate: Candidate, reach: float) -> str:
    error = candidate.errors.validation_rmse_um
    if not math.isfinite(error):
        return "did not converge"
    mark = " (!)" if candidate.remarks else ""
    return f"{error:.3g}{' →' if error > reach else ''}{mark}"


def _hover(candidate: Candidate) -> str:
    errors = candidate.errors
    lines = [
        f"validation {errors.validation_rmse_um:.4g} {{output_unit}}, "
        f"training {errors.train_rmse_um:.4g} {{output_unit}}",
    ]
    if candidate.indistinguishable:
        lines.append(f"indistinguishable from {', '.join(candidate.indistinguishable)}")
    return "\n".join([*lines, *candidate.remarks])


def record_errors(
    stairs: Sequence[tuple[str, Errors]], roles: Mapping[str, str], noise_floor_um: float
) -> Chart:
    """Draw the error of every record before and after."""
    names = list(dict.fromkeys(name for _, errors in stairs for name in errors.by_record_um))
    labels = [f"{name} ({roles[name]})" if name in roles else name for name in names]
    ends = [stairs[0], stairs[-1]] if len(stairs) > 1 else [stairs[-1]]
    found = [[_finite(e.by_record_um.get(name, math.nan)) for name in names] for _, e in ends]
    marks: list[Mark] = []
    if len(ends) == 2:
        for label, *pair in zip(labels, *found, strict=True):
            marks.append(Series(pair, [label, label], colour=_OTHER, width=3.0, hover=""))
    for (step, _), values, colour in zip(ends, found, (BEFORE, AFTER)[-len(ends) :], strict=True):
        marks.append(
            Series(
                values, labels, step, colour, None, marker="circle", size=10.0,
                hover="%{y}: %{x:.4g} {output_unit}", tagged=True,
            )
        )  # fmt: skip
    marks.append(_floor(noise_floor_um, "x"))
    y = Axis(categories=labels, reversed=True)
    panel = Panel(marks, Axis(RMS_UM, from_zero=True), y)
    return Chart([panel], round(150 + 25 * len(labels)))


def _floor(noise_floor_um: float, along: Any = "y") -> Level:
    name = f"noise floor, {noise_floor_um:.3g} {{output_unit}}"
    return Level(noise_floor_um, name, FLOOR, width=1.6, along=along)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _looks(labels: Sequence[str]) -> dict[str, tuple[str, bool]]:
    """Give every model its colour: the first orange, the last blue, those between on demand."""
    found = {label: (_BETWEEN[i % len(_BETWEEN)], False) for i, label in enumerate(labels)}
    if labels:
        found |= {labels[0]: (BEFORE, True)} | {labels[-1]: (AFTER, True)}
    return found


def _overlays(view: View) -> list[Overlay]:
    return [
        Overlay(label, view_trace(view, label), colour, visible)
        for label, (colour, visible) in _looks(list(view.models_um)).items()
    ]


def view_over_time(view: View, noise_floor_um: float, samples: int = DISPLAY_SAMPLES) -> Chart:
    """Draw measured and modelled displacement over time, below them the residuals."""
    overlays = _overlays(view)
    if not overlays:
        k = thin_index(view.y_um, samples=samples)
        measured = Series(view.t_s[k], single(view.y_um[k]), "measured", MEASURED)
        return Chart([Panel([measured], TIME, Axis(DISPLACEMENT_UM))])
    # of the first model and of the last no peak may be lost
    ends = [overlay.trace.residual_um for overlay in (overlays[0], overlays[-1])]
    k = thin_index(view.y_um, *ends, samples=samples)
    return over_time(overlays, k, left_out=True, dash="dot", noise_um=noise_floor_um)


def view_largest_error(view: View, noise_floor_um: float, samples: int = DISPLAY_SAMPLES) -> Chart:
    """Draw the half-cycle in which the first model is farthest off, and its two neighbours."""
    overlays = _overlays(view)
    k = around_largest_error(overlays[0].trace, samples, overlays[-1].trace.residual_um)
    return over_time(overlays, k, left_out=False, dash="dot", noise_um=noise_floor_um)


def view_loops(view: View, noise_floor_um: float, samples: int = 2 * DISPLAY_SAMPLES) -> Chart:
    """Draw displacement over command with the models', and beside it the residuals."""
    return loops(_overlays(view), samples, title="Residual", noise_um=noise_floor_um)


def residuals(
    profiles: Mapping[str, ResidualProfiles], noise_floor_um: float, ts_s: float
) -> Chart:
    """Draw the residual of each model over command, rate, time at rest and frequency."""
    held = any(p.hold is not None for p in profiles.values())
    command: list[Mark] = []
    rate: list[Mark] = []
    spectrum: list[Mark] = []
    hold: list[Mark] = []
    for label, (colour, visible) in _looks(list(profiles)).items():
        of = profiles[label]
        command += [
            _means(of.rising, label, colour, visible, listed=True),
            _means(of.falling, label, colour, visible, "dot"),
        ]
        # a record has few rates: no line leads from one to the next
        rate.append(_means(of.rate, label, colour, visible, None))
        spectrum.append(
            Series(
                single(of.frequency_hz), single(of.density_um), label, colour, width=1.2, group=label,
                listed=False, visible=visible, hover="%{x:.4g} Hz: %{y:.3g} {output_unit}/√Hz", tagged=True,
            )
        )  # fmt: skip
        if of.hold is not None:
            hold.append(_means(of.hold, label, colour, visible))
    command.append(noise_band(noise_floor_um))
    rate.append(noise_band(noise_floor_um, listed=False))
    hold.append(noise_band(noise_floor_um, listed=False))
    spectrum.append(Level(noise_floor_um * float(np.sqrt(2.0 * ts_s)), colour=FLOOR, width=1.4))
    panels = [
        Panel(command, COMMAND, Axis(MEAN_UM), "Over the command"),
        Panel(
            rate,
            Axis("Rate of the command ({input_unit}/s)"),
            Axis(MEAN_UM),
            "Over its rate",
            column=2,
        ),
        Panel(
            spectrum,
            Axis("Frequency (Hz)", log=True, ticks="1-2-5"),
            Axis("Measured − model ({output_unit}/√Hz)", log=True, powers=True),
            "Over the frequency",
            row=2,
            columns=1 if held else 2,
        ),
    ]
    if held:
        time = Axis("Time since the last move (s)", log=True, ticks="1-2-5")
        onward = Axis("Onward since the move ({output_unit})")
        panels.append(Panel(hold, time, onward, "While the command rests", row=2, column=2))
    return Chart(panels, 760, row_gap=0.2)


def _means(
    profile: Profile,
    label: str,
    colour: str,
    visible: bool,
    dash: Dash | None = "solid",
    listed: bool = False,
) -> Series:
    return Series(
        profile.x, single(profile.mean_um), label, colour, dash, 1.4, "circle", 5.0, group=label,
        listed=listed, visible=visible, data=profile.samples, tagged=True,
        hover="%{x:.4g}: mean %{y:.3g} {output_unit}<br>%{customdata} samples",
    )  # fmt: skip
