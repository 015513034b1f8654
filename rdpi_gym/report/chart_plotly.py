"""Charts drawn by Plotly, for pages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from plotly.subplots import make_subplots

from rdpi_gym.report.chart import Axis, Bands, Bars, Chart, Level, Mark, Note, Series
from rdpi_gym.report.style import INK, MUTED, figure_text, styled


def plotly_figure(chart: Chart) -> Any:
    """Draw a chart as a Plotly figure in the look of the house."""
    panels = chart.panels
    size = {
        "rows": max(panel.row + panel.rows - 1 for panel in panels),
        "cols": max(panel.column + panel.columns - 1 for panel in panels),
    }
    specs: list[list[Any]] = [[None] * size["cols"] for _ in range(size["rows"])]
    for panel in panels:
        specs[panel.row - 1][panel.column - 1] = {"rowspan": panel.rows, "colspan": panel.columns}
    ordered = sorted(panels, key=lambda panel: (panel.row, panel.column))
    titles = [_text(panel.title) for panel in ordered]
    figure = make_subplots(
        **size,
        specs=specs,
        shared_xaxes="x" in chart.shared,
        shared_yaxes="y" in chart.shared,
        row_heights=chart.heights,
        column_widths=chart.widths,
        horizontal_spacing=chart.gap,
        vertical_spacing=chart.row_gap,
        subplot_titles=titles if any(titles) else None,
    )
    figure.update_annotations(font_size=13)
    for panel in panels:
        place = {"row": panel.row, "col": panel.column}
        figure.update_xaxes(_axis(panel.x), **place)
        figure.update_yaxes(_axis(panel.y), **place)
        for mark in panel.marks:
            _DRAW[type(mark)](figure, mark, place)
    bars = [mark for panel in panels for mark in panel.marks if isinstance(mark, Bars)]
    if bars:
        beside = len(bars) > 1 and bars[0].width is None
        figure.update_layout(barmode="group" if beside else "overlay", bargap=0.25)
    styled(figure, chart.height_px)
    if chart.legend == "below":
        under = {"y": -70.0 / (chart.height_px - 130.0), "yanchor": "top", "entrywidth": 250}
        figure.update_layout(legend=under, margin_t=64 if any(titles) else 20)
    return figure


def _text(text: str) -> str:
    return figure_text(text).replace("\n", "<br>")


def _values(values: Any) -> Any:
    """Return numbers as they are, and texts, in rows and arrays too, as Plotly shows them."""
    if isinstance(values, str):
        return _text(values)
    if isinstance(values, list | tuple):
        return [_values(value) for value in values]
    if hasattr(values, "__array__") and (array := np.asarray(values)).dtype.kind not in "biufcmM":
        return _values(array.tolist())
    return values


def _axis(axis: Axis) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if axis.label:
        found["title_text"] = _text(axis.label)
    if axis.log:
        found["type"] = "log"
    if axis.limits is not None:
        found["range"] = [float(np.log10(end)) if axis.log else end for end in axis.limits]
    if axis.from_zero:
        found["rangemode"] = "tozero"
    if axis.categories is not None:
        found |= {"categoryorder": "array", "categoryarray": _values(list(axis.categories))}
        count = len(axis.categories)
        found["range"] = [count - 0.4, -0.6] if axis.reversed else [-0.5, count - 0.5]
    if isinstance(axis.ticks, str):
        found["dtick"] = {"decades": 1, "1-2-5": "D2"}[axis.ticks]
    elif axis.ticks is not None:
        found |= {"tickvals": axis.ticks[0], "ticktext": _values(list(axis.ticks[1]))}
    if axis.powers:
        found["exponentformat"] = "power"
    return found if axis.grid else found | {"showgrid": False}


def _hover(hover: str | None, name: str = "") -> dict[str, Any]:
    if hover is None:
        return {}
    return (
        {"hovertemplate": f"{hover}<extra>{_text(name)}</extra>"}
        if hover
        else {"hoverinfo": "skip"}
    )


def _draw_series(figure: Any, mark: Series, place: dict[str, int]) -> None:
    parts = {"lines": mark.dash, "markers": mark.marker, "text": mark.texts}
    found: dict[str, Any] = {"mode": "+".join(part for part, drawn in parts.items() if drawn)}
    found |= {"x0": 0.0, "dx": mark.x} if isinstance(mark.x, float) else {"x": _values(mark.x)}
    if mark.dash:
        found["line"] = {"color": mark.colour, "dash": mark.dash} | (
            {} if mark.width is None else {"width": mark.width}
        )
        if mark.stepped:
            found["line"]["shape"] = "hvh"
    if mark.marker:
        filled = mark.fill is not None
        found["marker"] = {
            "symbol": mark.marker, "size": mark.size, "color": mark.fill if filled else mark.colour,
        }  # fmt: skip
        if filled or mark.marker.endswith("open"):
            found["marker"]["line"] = {"width": mark.edge} | (
                {"color": mark.colour} if filled else {}
            )
    if mark.errors is not None:
        below, above = mark.errors
        found[f"error_{mark.errors_along}"] = {
            "type": "data", "symmetric": False, "array": above, "arrayminus": below, "color": MUTED,
            "thickness": 1.2,
        }  # fmt: skip
    if mark.area:
        found |= {"fill": "tozeroy", "fillcolor": "rgba(0, 114, 178, 0.15)"}
    if mark.texts is not None:
        found |= {
            "text": _values(list(mark.texts)),
            "textposition": "top center",
            "cliponaxis": False,
        }
    if not (mark.listed and mark.name):
        found["showlegend"] = False
    if not mark.visible:
        found["visible"] = "legendonly"
    if mark.group is not None:
        found["legendgroup"] = mark.group
    if mark.data is not None:
        found["customdata"] = _values(mark.data)
    found |= _hover(mark.hover, mark.name if mark.tagged else "")
    figure.add_scatter(y=_values(mark.y), name=_text(mark.name), **found, **place)


def _draw_bars(figure: Any, mark: Bars, place: dict[str, int]) -> None:
    places, lengths = _values(mark.places), _values(mark.lengths)
    found: dict[str, Any] = (
        {"x": lengths, "y": places, "orientation": "h"}
        if mark.horizontal
        else {"x": places, "y": lengths}
    )
    if mark.name:
        found["name"] = _text(mark.name)
    if mark.width is not None:
        found["width"] = mark.width
    if mark.errors is not None:
        along = "x" if mark.horizontal else "y"
        found[f"error_{along}"] = {"type": "data", "array": mark.errors}
    if mark.names is not None:
        found["hovertext"] = _values(list(mark.names))
    if mark.texts is not None:
        found |= {
            "text": _values(list(mark.texts)), "textposition": "auto", "insidetextanchor": "end",
            "textangle": 0,
        }  # fmt: skip
    figure.add_bar(
        marker_color=mark.colour, showlegend=bool(mark.name), **found, **_hover(mark.hover), **place
    )


def _draw_level(figure: Any, mark: Level, place: dict[str, int]) -> None:
    style = {"color": mark.colour, "dash": mark.dash, "width": mark.width}
    if np.isfinite(mark.value):
        across = figure.add_hline if mark.along == "y" else figure.add_vline
        across(**{mark.along: mark.value}, line=style, **place)
    if mark.name:
        figure.add_scatter(
            x=[None], y=[None], mode="lines", name=_text(mark.name), line=style, hoverinfo="skip", **place,
        )  # fmt: skip


def _draw_bands(figure: Any, mark: Bands, place: dict[str, int]) -> None:
    look = {
        "fillcolor": mark.colour, "opacity": mark.opacity, "line_width": 0, "layer": "below",
    }  # fmt: skip
    other = "x" if mark.along == "y" else "y"
    for low, high in mark.spans:
        ends: dict[str, Any] = {f"{mark.along}0": low, f"{mark.along}1": high}
        if mark.across:
            ends |= {f"{other}0": 0, f"{other}1": 1, f"{other}ref": "paper"}
            figure.add_shape(type="rect", **ends, **{f"{mark.along}ref": mark.along}, **look)
        else:
            (figure.add_hrect if mark.along == "y" else figure.add_vrect)(**ends, **look, **place)
    if mark.name and mark.spans:
        square = {"symbol": "square", "size": 11, "color": mark.colour, "opacity": 0.4}
        figure.add_scatter(
            x=[None], y=[None], mode="markers", name=_text(mark.name), marker=square, hoverinfo="skip", **place,
        )  # fmt: skip


def _draw_note(figure: Any, mark: Note, place: dict[str, int]) -> None:
    axes = figure.get_subplot(**place)
    found: dict[str, Any] = {}
    for side, value in (("x", mark.x), ("y", mark.y)):
        axis = getattr(axes, f"{side}axis")
        name = axis.plotly_name.replace("axis", "")
        if isinstance(value, str):
            found[side] = _text(value)
        elif value is None:
            found[side] = 0.98
        else:  # of a logarithmic axis an annotation takes the exponent
            found[side] = float(np.log10(value)) if axis.type == "log" else value
        found[f"{side}ref"] = f"{name} domain" if value is None else name
    figure.add_annotation(
        **found,
        text=_text(mark.text),
        showarrow=False,
        xanchor=mark.anchor,
        yshift=mark.shift_px,
        font={"color": mark.colour, "size": 12 if mark.colour != INK else 11},
    )


_DRAW: dict[type[Mark], Callable[[Any, Any, dict[str, int]], None]] = {
    Series: _draw_series,
    Bars: _draw_bars,
    Level: _draw_level,
    Bands: _draw_bands,
    Note: _draw_note,
}
