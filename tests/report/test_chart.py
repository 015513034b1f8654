"""One description of a figure is drawn alike by both plotting libraries."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from rdpi_gym.plant import P5
from rdpi_gym.report.chart import (
    Axis,
    Bands,
    Bars,
    Chart,
    Level,
    Note,
    Panel,
    Series,
    frequency_axis,
    side_by_side,
)
from rdpi_gym.report.chart_matplotlib import chart_png, draw_chart
from rdpi_gym.report.chart_plotly import plotly_figure
from rdpi_gym.report.result_pages import fit_chart

NAMES = ["a <b>$x$</b>", "second"]


def example():
    x = np.array([1.0, 10.0, 100.0])
    line = Series(x, [3.0, None, 1.0], "line {output_unit}", marker="circle", texts=["p", "q", "r"])
    hidden = Series(x, x, "on demand", visible=False)
    dots = Series([2.0, 3.0], NAMES, "dots", dash=None, marker="diamond-open")
    bars = Bars(NAMES, [1.0, 2.0], "bars", colour=["#000000", "#111111"])
    return side_by_side(
        [
            Panel(
                [line, hidden, Level(2.0, "floor"), Bands([(0.5, 0.7)], "band"), Note(10.0, 2.5, "note", "#000000")],
                frequency_axis(x), Axis("Error ({output_unit})", from_zero=True), "Panel",
            ),
            Panel([bars, dots], Axis("Length (s)"), Axis(categories=NAMES, reversed=True)),
        ]
    )  # fmt: skip


def test_both_draw_the_same_values_names_and_axes():
    chart = example()
    plotly, figure = plotly_figure(chart), Figure()
    axes = draw_chart(figure, chart, lambda text: text.replace("{output_unit}", "nm"))
    first = axes[0].get_lines()[0]
    np.testing.assert_array_equal(first.get_ydata(), [3.0, np.nan, 1.0])
    assert list(plotly.data[0].y) == [3.0, None, 1.0]
    assert axes[0].get_ylabel() == "Error (nm)"
    assert plotly.layout.yaxis.title.text == "Error ({output_unit})"
    assert axes[0].get_xscale() == plotly.layout.xaxis.type == "log"
    np.testing.assert_allclose(np.log10(axes[0].get_xlim()), plotly.layout.xaxis.range)
    assert axes[0].get_ylim()[0] == 0.0
    assert plotly.layout.yaxis.rangemode == "tozero"
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sorted(legend) == ["band", "bars", "dots", "floor", "line nm"]
    assert [t.name for t in plotly.data if t.visible == "legendonly"] == ["on demand"]
    assert [bar.get_width() for bar in axes[1].patches] == list(plotly.data[4].x) == [1.0, 2.0]
    assert list(axes[1].get_ylim()) == list(plotly.layout.yaxis2.range)
    note = next(note for note in plotly.layout.annotations if note.text == "note")
    assert note.x == 1.0  # the exponent, on a logarithmic axis


def test_names_are_plain_text_in_both():
    chart = example()
    assert plotly_figure(chart).data[4].y[0] == "a &lt;b&gt;$x$&lt;/b&gt;"
    axes = draw_chart(Figure(), chart)
    ticks = axes[1].get_yticklabels()
    assert [tick.get_text() for tick in ticks] == NAMES
    assert not ticks[0].get_parse_math()


def test_the_same_chart_is_the_same_picture():
    chart = Chart([Panel([Series([0.0, 1.0], [0.0, 1.0])])])
    assert chart_png(chart, (3.0, 2.0)) == chart_png(chart, (3.0, 2.0))


SCRIPT = "<script>alert(1)</script>"


@pytest.mark.parametrize(
    "mark",
    [
        Series([0.0], [1.0], marker="circle", texts=[SCRIPT]),
        Bars([0.0], [1.0], texts=[SCRIPT]),
        Bars([0.0], [1.0], names=[SCRIPT]),
        Bars(np.array([SCRIPT]), [1.0]),
        Series([0.0], [1.0], data=[SCRIPT]),
        Series([0.0], [1.0], data=[[SCRIPT, 2.0]]),
        Series([0.0], [1.0], data=np.array([[SCRIPT]])),
        Series([0.0], [1.0], data=np.array([[SCRIPT, 2.0]], dtype=object)),
        Series([0.0], [1.0], data=pd.Series([SCRIPT])),
        Series([0.0], [1.0], data=pd.DataFrame({"name": [SCRIPT], "value": [2.0]})),
    ],
)
def test_no_text_reaches_plotly_as_markup(mark):
    drawn = str(plotly_figure(Chart([Panel([mark])])).to_dict()["data"])
    assert "<script>" not in drawn
    assert "&lt;script&gt;" in drawn


def test_numbers_pass_as_they_are():
    data = np.array([[1.0, 2.0]])
    drawn = plotly_figure(Chart([Panel([Series([0.0], [1.0], data=data)])])).data[0]
    np.testing.assert_array_equal(drawn.customdata, data)


@pytest.mark.parametrize(("horizontal", "along"), [(True, 0), (False, 1)])
def test_errors_of_bars_lie_along_them_and_unknown_ones_are_not_drawn(horizontal, along):
    bars = Bars([0.0, 1.0], [5.0, 7.0], horizontal=horizontal, errors=np.array([0.5, np.nan]))
    chart = Chart([Panel([bars])])
    bar = plotly_figure(chart).data[0]
    errors, other = (bar.error_x, bar.error_y) if horizontal else (bar.error_y, bar.error_x)
    np.testing.assert_array_equal(errors.array, [0.5, np.nan])
    assert other.array is None
    axes = draw_chart(Figure(), chart)
    first, second = axes.collections[0].get_segments()
    assert first[:, along].tolist() == [4.5, 5.5]
    assert first[:, 1 - along].tolist() == [0.0, 0.0]
    assert second.size == 0
    for cap in axes.get_lines():
        assert not np.isfinite(cap.get_xydata()[1, along])


def test_a_weight_that_the_data_do_not_determine_has_no_interval():
    count = len(P5.hysteresis.weights)
    errors = {f"a_{i}": 0.01 for i in range(count)} | {"a_1": np.inf}
    result = SimpleNamespace(plant=P5, standard_errors=errors, rmse_um={"sine": 0.02})
    panel = fit_chart(result).panels[0]
    assert panel.y.label.endswith(", 95 % interval")
    assert np.flatnonzero(np.isnan(panel.marks[0].errors)).tolist() == [1]
