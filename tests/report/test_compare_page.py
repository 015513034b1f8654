"""Every chart of a comparison is complete, with units, from a short record to a large data set."""

import re
from dataclasses import replace
from html import escape

import numpy as np
import pytest

from rdpi_gym.diagnosis import compare, compare_several
from rdpi_gym.measurement import Dataset, Quantities, Record
from rdpi_gym.plant import P5, Plant, named_plant
from rdpi_gym.report import comparison as charts
from rdpi_gym.report.chart import Bands, Bars, Chart, Series
from rdpi_gym.report.chart_plotly import plotly_figure
from rdpi_gym.report.comparison_page import MOST_RECORDS, write_compare_page
from rdpi_gym.report.traces import loops, one_model
from tests.unpacked import read_page


def sine(name="sine", frequency_hz=5.0, periods=6.0, per_period=200, **keywords):
    ts_s = 1.0 / (frequency_hz * per_period)
    t = np.arange(round(periods * per_period)) * ts_s
    u = 10.0 * np.sin(2 * np.pi * frequency_hz * t)
    return Record(name, t, u, Plant(P5, ts_s).simulate(u), ts_s=ts_s, **keywords)


def staircase():
    u = np.repeat(np.arange(10.0), 100)
    t = np.arange(u.size) * 1e-3
    return Record("stairs", t, u, Plant(P5, 1e-3).simulate(u), ts_s=1e-3)


def short():
    t = np.arange(16) * 1e-2
    return Record("short", t, t, 2.0 * t, ts_s=1e-2)


def masked():
    record = sine()
    mask = np.ones(record.t_s.size, dtype=bool)
    mask[100:300] = False
    mask[-1] = False
    return replace(record, error_mask=mask)


CASES = {
    "single short record": (short(),),
    "one frequency, no validation record": (sine(),),
    "steps and holds": (staircase(),),
    "left-out stretches": (masked(),),
    "validation only": (sine(role="validation"),),
    "test records only": (sine(role="test"),),
    "several frequencies": tuple(sine(f"{f} Hz", f) for f in (1.0, 10.0, 100.0)),
    "names that look like markup": (sine("<b>a</b> & <script>"), sine("b", role="validation")),
}


@pytest.mark.slow
def test_a_page_of_every_case_is_written(tmp_path):
    for name, records in CASES.items():
        comparison = compare(Dataset("a data set", records), named_plant("P5-static"))
        text = read_page(write_compare_page(tmp_path / "report.html", comparison))
        assert "<b>a</b>" not in text, name
        for finding in comparison.findings.values():
            assert escape(finding[:20]) in text, name


def marks(chart, kind):
    return [mark for panel in chart.panels for mark in panel.marks if isinstance(mark, kind)]


@pytest.mark.slow
def test_many_long_records_stay_small(tmp_path):
    records = tuple(sine(f"r{i}", periods=50.0, role="validation") for i in range(MOST_RECORDS + 5))
    comparison = compare(Dataset("many", records), named_plant("P5-static"))
    page = write_compare_page(tmp_path / "report.html", comparison)
    assert page.stat().st_size < 12e6
    assert f"Of {MOST_RECORDS + 5} traces the {MOST_RECORDS}" in page.read_text(encoding="utf-8")


def test_figures_open_on_the_record_with_the_largest_error(tmp_path):
    good, bad = sine("a good record"), sine("b bad record", role="validation")
    bad = replace(bad, y_um=1.5 * bad.y_um)
    spiked = sine("c spiked record")
    spiked.y_um[700:712] += (
        30.0 * np.hanning(14)[1:-1]
    )  # a knock; a single sample would be left out
    comparison = compare(Dataset("three", (good, bad, spiked)), named_plant("P5"))
    text = write_compare_page(tmp_path / "report.html", comparison).read_text(encoding="utf-8")
    opened = dict(re.findall(r'<select aria-label="([^"]+)"[^>]*><option [^>]*>([^<]+)<', text))
    assert opened == {
        "Time traces": "b bad record (validation)",
        "Where the error is largest": "c spiked record (train)",
        "Loops": "b bad record (validation)",
    }


@pytest.fixture
def comparison():
    return compare(
        Dataset("two", (sine(periods=60.0), sine("held", role="validation"))),
        named_plant("P5-static"),
    )


def test_traces_show_the_largest_error(comparison):
    trace = comparison.traces[0]
    worst = np.max(np.abs(trace.residual_um))
    for chart in (charts.time_traces(trace, 600), charts.largest_error(trace, 3000)):
        measured, _, residual = marks(chart, Series)
        assert np.max(np.abs(residual.y)) == np.float32(worst)
        assert measured.x.size <= 602


def test_loops_are_whole_and_few(comparison):
    trace = comparison.traces[0]
    u = np.asarray(marks(loops(one_model(trace), 1200), Series)[0].x, dtype=float)
    assert u.size <= 1200 + 60
    pieces = np.split(u, np.flatnonzero(np.isnan(u)))
    inner = [piece[~np.isnan(piece)] for piece in pieces[1:-2]]
    assert len(inner) >= 5
    for piece in inner:
        assert np.ptp(piece) == pytest.approx(20.0, rel=1e-3)


@pytest.fixture(scope="module")
def eventful():
    """A comparison with rests, harmonics and a clock."""
    wave = 10.0 * np.sin(2 * np.pi * 5.0 * np.arange(3000) * 1e-3)
    steps = np.repeat([0.0, 8.0, -4.0], 2000)

    def record(name, u, start_s, role="train"):
        t = start_s + np.arange(u.size) * 1e-3
        return Record(name, t, u, Plant(P5, 1e-3).simulate(u), ts_s=1e-3, role=role)

    held = record("held", 0.5 * wave, 20.0, "validation")
    records = (record("<i>sine</i>", wave, 0.0), record("steps", steps, 5.0), held)
    return compare(Dataset("three", records), named_plant("P5-static"))


def every_chart(comparison):
    trace = comparison.traces[0]
    return {
        "time": charts.time_traces(trace, 3000),
        "loops": loops(one_model(trace)),
        "records": charts.record_errors(comparison.records),
        "frequency": charts.error_by_frequency(comparison.by_frequency),
        "spectrum": charts.error_spectrum(comparison.spectrum),
        "distortion": charts.distortion_parts(comparison.distortion),
        "rest": charts.error_since_rest(comparison.since_rest, comparison.noise_floor_um),
        "clock": charts.error_over_clock(comparison.clock),
        "plane": charts.residual_plane(comparison.plane),
    }


def test_every_axis_carries_its_unit_and_names_are_text(eventful):
    for name, chart in every_chart(eventful).items():
        figure = plotly_figure(chart) if isinstance(chart, Chart) else chart
        axes = (*figure.select_xaxes(), *figure.select_yaxes())
        titles = [Quantities().fill(axis.title.text) for axis in axes if axis.title.text]
        assert titles, name
        for title in titles:
            assert any(f"({unit}" in title for unit in ("µm", "V", "s", "Hz", "%")), title
        assert "<i>sine" not in figure.to_json().replace("\\u003c", "<"), name


def test_every_row_is_drawn(eventful):
    drawn = every_chart(eventful)
    assert len(marks(drawn["spectrum"], Series)[0].x) == len(eventful.spectrum)
    lengths = [len(bar.lengths) for bar in marks(drawn["distortion"], Bars)]
    assert lengths == [len(eventful.distortion)] * 5
    points = sum(len(line.x) for line in marks(drawn["clock"], Series))
    assert points == len(eventful.clock)
    resting = eventful.since_rest[eventful.since_rest["state"] == "resting"]
    assert len(marks(drawn["rest"], Series)[0].x) == len(resting)


def test_page_tells_what_every_check_says(eventful, tmp_path):
    page = write_compare_page(tmp_path / "report.html", eventful).read_text(encoding="utf-8")
    for check in eventful.checks:
        assert escape(check.sentence) in page
    for heading in ("Tests without a model", "Harmonics", "Spectrum and coherence", "Drift over"):
        assert f"<h2>{heading}" in page


def test_left_out_stretches_are_shaded():
    trace = compare(Dataset("one", (masked(),)), P5).traces[0]
    assert trace.role == "train"
    # 100 to 299; and the last: blocks of the 999 that count are held out for validation
    (band,) = marks(charts.time_traces(trace, 3000), Bands)
    spans = set(band.spans)
    assert len(spans) == 5
    assert {(trace.t_s[100], trace.t_s[299]), (trace.t_s[-63], trace.t_s[-1])} < spans


def wild():
    """Return a record with its largest error that counts beside wild values that do not."""
    record = sine()
    counted = np.ones(record.t_s.size, dtype=bool)
    counted[250:290] = False
    y_um = np.where(counted, record.y_um, 1e3)
    y_um[300:340] += 0.5 * np.hanning(40)
    wild = replace(record, y_um=y_um, error_mask=counted)
    return Dataset("one", (wild, replace(wild, name="two", role="validation")))


def residuals_drawn(chart, trace):
    """Yield the residuals over time of a chart, whether each sample counts, and the axis' limits."""
    for panel in chart.panels:
        if panel.y.label.startswith("Measured") and panel.x.label.startswith("Time"):
            for line in panel.marks:
                yield line.y, trace.counted[np.searchsorted(trace.t_s, line.x)], panel.y.limits


def test_a_plot_interrupts_the_residual_over_time_where_samples_are_left_out():
    found = compare(wild(), named_plant("P5-static"))
    both = compare_several(wild(), {"a": named_plant("P5-static"), "b": P5})
    drawn = [
        *residuals_drawn(charts.comparison_chart(found), found.traces[0]),
        *residuals_drawn(charts.models_chart(both), both.comparisons[0].traces[0]),
    ]
    assert len(drawn) == 3
    for residual, counted, limits in drawn:
        assert counted.any()
        assert not counted.all()
        np.testing.assert_array_equal(np.isfinite(residual), counted)
        assert limits[1] < 100.0
    over_command = charts.models_chart(both).panels[2]
    assert all(np.nanmax(line.y) < 100.0 for line in over_command.marks)
    assert over_command.y.limits is None  # it shares that of the panel beside it


def test_a_page_draws_the_residual_over_time_whole_and_shades_what_is_left_out():
    trace = compare(wild(), named_plant("P5-static")).traces[0]
    *_, residual = marks(charts.time_traces(trace, 3000), Series)
    assert np.isfinite(residual.y).all()
    assert np.max(residual.y) > 900.0
