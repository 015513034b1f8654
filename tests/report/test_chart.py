"""One description of a figure is drawn alike by both plotting libraries."""

import numpy as np
from matplotlib.figure import Figure

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
