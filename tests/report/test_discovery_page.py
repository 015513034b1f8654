"""The pages of the laboratory: every result can be drawn, and says in words what it shows."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rdpi_gym.diagnosis.comparison.traces import residual_profiles, view_trace
from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.portrait import Kin, Portrait, Value
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.diagnosis.results import (
    Candidate,
    Errors,
    Probabilities,
    SearchResult,
    Step,
    View,
    steps_of,
)
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Quantities
from rdpi_gym.plant import P5
from rdpi_gym.plant.effects import CATALOGUE, load_effect
from rdpi_gym.report import discovery_charts as charts
from rdpi_gym.report import discovery_page as candidates
from rdpi_gym.report.chart import Bands, Bars, Chart, Level, Series
from rdpi_gym.report.chart_plotly import plotly_figure
from rdpi_gym.report.discovery_page import MOST_VIEWS, view_sections, write_discovery_page
from rdpi_gym.report.discovery_text import evidence, lines, staircase
from tests.unpacked import read_page


def page_of(result, tmp_path):
    return read_page(write_discovery_page(tmp_path / "report.html", "a <b>stage</b>", result))


NOTHING = {
    "steps": (), "rounds": (), "verdict": "no missing effect", "next_experiment": None,
    "checks": (), "indistinguishable": (), "notes": (), "given": None,
}  # fmt: skip


def changed_views(made_discovery, change):
    return made_discovery(views=tuple(change(view) for view in made_discovery().views))


CASES = {
    "two steps": lambda make: make(),
    "no steps, nothing tried": lambda make: make(**NOTHING),
    "candidates tried, none earned": lambda make: make(**{**NOTHING, "rounds": make().rounds[-1:]}),
    "no records to show": lambda make: make(views=()),
    "one record, one model": lambda make: make(
        **NOTHING, views=(replace(make().views[0], models_um={"base model": make().views[0].y_um}),)
    ),
    "a step taken out again": lambda make: make(steps=make().steps[:1], removed=("resonance",)),
    "a noise floor of zero": lambda make: make(noise_floor_um=0.0),
    "the mask as numbers": lambda make: changed_views(
        make, lambda view: replace(view, counted=view.counted.astype(float))
    ),
    "nothing counts in a record": lambda make: changed_views(
        make, lambda view: replace(view, counted=np.zeros_like(view.counted))
    ),
    "the command at rest": lambda make: changed_views(
        make, lambda view: replace(view, u_V=np.zeros_like(view.u_V))
    ),
    "sixteen samples": lambda make: changed_views(
        make,
        lambda view: View(
            view.name,
            view.role,
            view.t_s[100:116],
            view.u_V[100:116],
            view.y_um[100:116],
            {label: y[100:116] for label, y in view.models_um.items()},
            view.counted[100:116],
        ),
    ),
    "an effect that no catalogue has": lambda make: make(
        steps=(Step((replace(make().added[0], effect="wobble", parameters={"depth_um": 1.5}),)),)
    ),
    "names that look like markup": lambda make: changed_views(
        make,
        lambda view: replace(view, models_um={"<b>x</b>": view.y_um, "<i>y</i>": view.y_um}),
    ),
}


@pytest.mark.slow
def test_a_page_of_every_case_is_written(made_discovery, tmp_path):
    for name, case in CASES.items():
        result = case(made_discovery)
        text = page_of(result, tmp_path)
        assert f"<p>{result.headline}</p>" in text, name
        assert ("Indistinguishable on" in text) is bool(result.indistinguishable), name
        assert "a &lt;b&gt;stage" in text, name
        assert "<b>x</b>" not in text, name
        for check in result.checks:
            assert text.count(f"<li>{check}</li>") == 1, name


def marks(chart, kind):
    return [mark for panel in chart.panels for mark in panel.marks if isinstance(mark, kind)]


def test_the_answer_comes_first(made_discovery):
    said = lines(made_discovery())
    assert said[0] == (
        "Missing: creep and resonance (or delay). Error 0.8 to 0.021 µm, noise 0.02 µm."
    )
    assert said[1].startswith(
        "- creep: confidence 99 %, removes 98 % of the squared error above noise. creep makes the loops"
    )
    assert said[2].startswith(
        "- resonance: confidence 99 %, removes 100 % of the squared error above"
    )
    assert "; indistinguishable from delay on these" in said[2]
    assert said[-2] == (
        "Indistinguishable on these records: delay and sensor_lag; creep and thermal_drift."
    )
    assert said[-1] == "Next experiment: A multisine below the first threshold."
    creeping = replace(P5, effects=(CATALOGUE["creep"](0.0123), CATALOGUE["delay"](2.5e-5)))
    sized = made_discovery(plant=creeping).headline
    assert sized.startswith("Missing: creep (gain per decade 0.0123) and resonance (or delay).")


def test_probabilities_stand_beside_the_names(made_discovery, tmp_path):
    chances = Probabilities(
        {"creep": 0.98, "resonance": 0.4, "delay": 0.2, "backlash": 0.01},
        {"creep": 0.97, "resonance": 0.9}, 0.0, 0.07, ("creep", "resonance", "delay"),
    )  # fmt: skip
    found = made_discovery(probabilities=chances)
    said = lines(found)
    assert said[0].startswith("Missing: creep; possibly missing: resonance. Error")
    assert said[1].startswith(
        "- creep: 98 % probable, removes 98 % of the squared error above noise."
    )
    assert said[1].count("%") == 2
    assert "40 % probable" in said[2]
    assert "90 % that" not in said[2]
    assert said[3] == (
        "Further effects, by probability: delay 20 % and something outside the catalogue 7 %."
    )
    assert [text.count("probable") for text in evidence(found)] == [2, 0, 0]
    assert "Probability (%)" in page_of(found, tmp_path)
    tied, stand_ins = (
        replace(
            found,
            steps=tuple(
                replace(s, added=tuple(replace(c, grade=grade) for c in s.added))
                for s in found.steps
            ),
        ).headline
        for grade in ("likely", "stand-in")
    )
    assert tied.startswith("Probably missing: creep and resonance (or delay). Error")
    assert "falls as with creep and resonance, none of which is the cause. Error" in stand_ins
    nothing = made_discovery(**NOTHING, probabilities=replace(chances, none=0.83, other=0.0))
    assert lines(nothing)[:2] == [
        "Probably nothing is missing. Error 0.021 µm, noise 0.02 µm.",
        "Missing, by probability: creep 98 %, resonance 40 %, delay 20 % and nothing 83 %.",
    ]


def test_an_answer_for_every_verdict(made_discovery):
    assert (
        made_discovery(**NOTHING).headline == "Nothing is missing. Error 0.021 µm, noise 0.02 µm."
    )
    left = made_discovery(**NOTHING | {"verdict": "unexplained"})
    assert left.headline.startswith("Unexplained: no effect of the catalogue is found")
    poor = replace(left, undecided="The data are too short to decide.")
    assert poor.headline.startswith("Undecided. The data are too short to decide. Error 0.021")
    assert sum("too short" in line for line in lines(poor)) == 1
    part = made_discovery(verdict="unexplained")
    assert "and something that no effect of the catalogue explains. Error 0.8" in part.headline
    asked = replace(part, kind="addition")
    assert asked.headline.startswith("Added: creep and resonance, which leaves part of the error")
    missed = Notice(Code.MOTION_BETWEEN, ("one",), (20000.0, 5000.0, 4.0, 0.02))
    slow = made_discovery(sampling=text_of(missed), reservation=missed)
    assert slow.headline.endswith("noise 0.02 µm. Sample faster than 20000 Hz.")
    assert text_of(missed) in lines(slow)


def test_a_portrait_is_printed_shown_and_kept(made_discovery, tmp_path):
    drawn = Portrait(
        "before", {"before": 0.97, "in": 0.03}, True, 1.0, (Value(0.5, 0.02),), "even", {"even": 1.0},
        Value(1.5, 0.1), Value(0.0, 0.0), None, 0.4, 0.05, "with memory, before",
        (Kin("creep", "it is odd"),), "Record more.", ("A free block takes the error to 0.05 µm.",),
    )  # fmt: skip
    found = made_discovery(verdict="unexplained", portrait=drawn)
    assert "- A free block takes the error to 0.05 µm." in lines(found)
    assert "Portrait of the unknown effect" in page_of(found, tmp_path)
    assert SearchResult.from_dict(found.to_dict()).portrait == drawn
    assert "Portrait of" not in page_of(made_discovery(), tmp_path)


def test_diagnosis_speaks_of_what_would_be(made_diagnosis, tmp_path):
    result = made_diagnosis()
    assert [c.effect for c in result.added] == ["creep"]
    assert result.headline == (
        "Missing: creep, and something that no effect of the catalogue explains. "
        "Error 0.8 to 0.1 µm, noise 0.02 µm."
    )
    text = page_of(result, tmp_path)
    assert "Nothing has been added to the model yet" in text
    assert "<li>delay: delay makes the loops" in text


def test_diagnosis_that_earns_nothing_chooses_nothing(made_diagnosis):
    result = made_diagnosis(steps=())
    assert len(staircase(result)) == 2
    section = candidates.candidate_sections(result)[0]
    assert {bar.name for bar in marks(section.figure, Bars)} == {"others"}


def test_pair_is_one_step_of_the_staircase(made_discovery):
    creep, resonance = made_discovery().added
    pair = made_discovery(steps=steps_of([replace(creep, errors=resonance.errors), resonance]))
    assert [step.effects for step in pair.steps] == [("creep", "resonance")]
    assert [name for name, _ in staircase(pair)][-1] == "+ creep + resonance"


def test_rounds_name_what_was_there(made_discovery):
    whole = made_discovery()
    removed = made_discovery(steps=whole.steps[:1], removed=("resonance",))
    for result in (whole, removed):  # an effect taken out again is shown where it was taken
        section = candidates.candidate_sections(result)[0]
        assert list(section.figure) == [
            "Step 1", "Step 2: added to creep", "Step 3: added to creep and resonance",
        ]  # fmt: skip
    section = candidates.candidate_sections(whole)[0]
    reference = [
        Quantities().fill(next(m.name for m in marks(chart, Level) if m.name.startswith("without")))
        for chart in section.figure.values()
    ]
    assert reference == [f"without a candidate, {um} µm" for um in ("0.8", "0.1", "0.021")]


def bars(chart):
    return {
        name: (bar.name, length, text)
        for bar in marks(chart, Bars)
        for name, length, text in zip(bar.places, bar.lengths, bar.texts, strict=True)
    }


def test_ranking_keeps_runaways_and_failures_on_the_axis(made_discovery):
    result = made_discovery()
    first = next(iter(candidates.candidate_sections(result)[0].figure.values()))
    reach = first.panels[0].x.limits[1]
    drawn = bars(first)
    assert drawn["creep"] == ("the choice", 0.1, "0.1")
    assert drawn["thermal_drift"] == ("others", reach, "64 → (!)")
    group, length, text = drawn["backlash"]
    assert (group, text) == ("others", "did not converge")
    assert 0.0 < length < 0.01 * reach
    second = list(candidates.candidate_sections(result)[0].figure.values())[1]
    assert bars(second)["delay"][0] == "indistinguishable from it"


def test_staircase_holds_every_error_and_the_floor(made_discovery):
    figure = charts.staircase_figure(staircase(made_discovery()), 0.02)
    assert list(figure.data[0].y) == [0.9, 0.8, 0.1, 0.021]
    assert list(figure.data[0].x)[-2:] == ["+ creep", "+ resonance"]
    floor = figure.layout.shapes[0]
    assert (floor.y0, floor.y1) == (0.02, 0.02)
    assert figure.layout.yaxis.type == "log"
    buttons = figure.layout.updatemenus[0].buttons
    assert [b.args[0]["yaxis.type"] for b in buttons] == ["linear", "log"]


def test_left_out_stretch_and_noise_band_are_both_shaded(made_discovery):
    chart = charts.view_over_time(made_discovery().views[0], 0.02)
    assert {mark.name for mark in marks(chart, Bands)} == {
        "left out of the error", "noise floor (± rms)",
    }  # fmt: skip
    figure = plotly_figure(chart)
    shapes = figure.layout.shapes
    assert {(s.y0, s.y1) for s in shapes if s.yref == "y2"} == {(-0.02, 0.02)}
    assert {(s.x0, s.x1) for s in shapes if s.yref == "paper"} == {(0.0, 0.049)}


def test_loops_keep_an_early_peak_on_the_axis_and_models_between_wait_for_a_click(made_discovery):
    view = made_discovery().views[0]
    y = view.y_um.copy()
    y[20] += 3.0  # before the first reversal
    models = dict.fromkeys(("base", "creep", "both"), view.y_um)
    peaked = replace(view, y_um=y, counted=np.ones(y.size, dtype=bool), models_um=models)
    chart = charts.view_loops(peaked, 0.02)
    low, high = chart.panels[1].y.limits
    drawn = [line.y for line in chart.panels[1].marks if isinstance(line, Series) and line.visible]
    assert low < min(map(np.nanmin, drawn))
    assert high > max(map(np.nanmax, drawn)) > 2.9
    visible = {line.name: line.visible for line in marks(chart, Series)}
    assert (visible["base"], visible["creep"], visible["both"]) == (True, False, True)


def test_every_axis_carries_its_unit(made_discovery):
    result = made_discovery()
    figures = []
    for section in (*view_sections(result), *candidates.candidate_sections(result)):
        figures += section.figure.values()
    stairs = staircase(result)
    figures.append(charts.record_errors(stairs, {}, 0.02))
    figures.append(charts.staircase_figure(stairs, 0.02))
    for figure in (plotly_figure(f) if isinstance(f, Chart) else f for f in figures):
        titles = [
            Quantities().fill(axis.title.text)
            for axis in (*figure.select_xaxes(), *figure.select_yaxes())
            if axis.title.text
        ]
        assert titles
        for title in titles:
            assert any(f"({unit}" in title for unit in ("µm", "V", "s", "Hz", "%")), title


def test_a_view_without_models_shows_the_measurement(made_discovery):
    view = replace(made_discovery().views[0], models_um={})
    (line,) = marks(charts.view_over_time(view, 0.02), Series)
    assert line.name == "measured"
    assert not marks(charts.residuals({}, 0.02, 1e-3), Series)


def test_the_name_of_a_candidate_is_bold_and_plain_text(made_discovery):
    first = next(iter(candidates.candidate_sections(made_discovery())[0].figure.values()))
    for bar in (trace for trace in plotly_figure(first).data if trace.type == "bar"):
        assert bar.hovertemplate.startswith("<b>%{y}</b><br>%{hovertext}")
        assert all(text.startswith("validation ") for text in bar.hovertext)


@pytest.mark.slow
def test_many_records_keep_the_page_small(made_discovery, tmp_path):
    view = made_discovery().views[0]
    repeated = {
        key: np.tile(getattr(view, key), 20) for key in ("t_s", "u_V", "y_um", "counted")
    }  # fmt: skip
    repeated["t_s"] = np.arange(repeated["u_V"].size) * 1e-3
    models = {label: np.tile(y, 20) for label, y in view.models_um.items()}
    views = tuple(
        View(f"record {i}", "train", models_um=models, **repeated) for i in range(MOST_VIEWS + 3)
    )
    path = write_discovery_page(tmp_path / "report.html", "many", made_discovery(views=views))
    assert path.stat().st_size < 15e6
    said = f"Of {MOST_VIEWS + 3} records the {MOST_VIEWS} with the largest errors are here."
    assert said in path.read_text(encoding="utf-8")


def test_figures_open_on_the_record_with_the_largest_error(made_discovery):
    small, large = made_discovery().views
    models = {label: 0.5 * y for label, y in large.models_um.items()}
    quiet = replace(small, name="a quiet record", models_um=dict.fromkeys(models, small.y_um))
    views = (quiet, small, replace(large, models_um=models))
    for section in view_sections(made_discovery(views=views)):
        assert list(section.figure) == [
            "validation-stairs (validation)", "sine (train)", "a quiet record (train)",
        ]  # fmt: skip


def test_parameters_of_a_form_have_its_own_units_and_bounds():
    kind = load_effect("gain_drift", "to a limit")
    errors = Errors(0.1, 0.1, 0.1, {})
    drift = Candidate(
        "gain_drift", errors, kind().values, {}, 1.0, 1.0, (), "", form="to a limit"
    )  # fmt: skip
    found = SimpleNamespace(kind="diagnosis", candidates=(drift,))
    rows = candidates.parameter_sections(found, CATALOGUE)[0].table.set_index("parameter")
    assert rows.loc["time_constant_s", "unit"] == "s"
    assert (
        rows.loc["rate_per_s", "bounds"] == "\u22120.1 to 0.1"
    )  # those of the simplest are narrower


def creeping(step_V, seconds, ts_s=1e-2):
    """Two opposite steps, displacement going on by 0.1 µm a decade in the direction of each."""
    half = round(seconds / ts_s)
    k = np.arange(1, half)
    onward = np.concatenate([[0.0], 0.1 * np.log10(k)])
    u = np.repeat([0.0, step_V, 0.0], [10, half, half])
    y = u + np.concatenate([np.zeros(10), onward, -onward])
    t = np.arange(u.size) * ts_s
    return View("steps", "train", t, u, y, {"base": u}, np.ones(u.size, dtype=bool))


def test_creep_is_a_straight_line_over_the_logarithm_of_the_hold():
    hold = residual_profiles(view_trace(creeping(10.0, 40.0), "base")).hold
    assert hold is not None
    late = hold.x > 0.2
    # the sample after the step is the first of the hold
    np.testing.assert_allclose(
        np.diff(hold.mean_um[late]) / np.diff(np.log10(hold.x[late])), 0.1, rtol=0.1
    )


def test_spectrum_of_noise_is_its_floor(made_discovery):
    rng = np.random.default_rng(0)
    t = np.arange(40_000) * 1e-3
    noise = 0.05 * rng.standard_normal(t.size)
    view = View(
        "r", "train", t, np.sin(t), np.sin(t) + noise, {"base": np.sin(t)}, np.ones(t.size, bool)
    )
    profiles = residual_profiles(view_trace(view, "base"))
    # white noise of σ has the density σ √(2 Ts)
    assert np.sqrt(np.mean(profiles.density_um**2)) == pytest.approx(0.05 * np.sqrt(2e-3), rel=0.03)
    assert profiles.hold is None
    chart = charts.residuals({"base": profiles}, 0.05, 1e-3)
    assert [panel.columns for panel in chart.panels] == [1, 1, 2]


def test_codes_stand_beside_their_texts_in_a_file_and_a_file_without_them_is_read(made_discovery):
    missed = Notice(Code.MOTION_BETWEEN, ("one",), (20000.0, 5000.0, 4.0, 0.02))
    loose = Finding("spikes", "one", 3, "3 samples stand alone.", Notice(Code.CONTACTS))
    found = made_discovery(
        sampling=text_of(missed),
        reservation=missed,
        next_experiment=text_of(Notice(Code.HOLDS)),
        advice=Notice(Code.HOLDS),
        limits=(text_of(Notice(Code.NO_REST)),),
        limit_notices=(Notice(Code.NO_REST),),
        findings=(loose,),
        views=(),
    )
    document = json.loads(json.dumps(found.to_dict()))
    read = type(found).from_dict(document)
    assert read.to_dict() == found.to_dict()
    assert (read.advice, read.reservation) == (found.advice, missed)
    assert (read.limit_notices, read.findings) == (found.limit_notices, (loose,))
    for key in ("advice", "reservation", "limit_notices"):
        del document[key]
    del document["findings"][0]["advice"], document["core"]["advice"]
    old = type(found).from_dict(document)
    assert (old.advice, old.reservation, old.limit_notices) == (None, None, ())
    assert (old.next_experiment, old.limits) == (found.next_experiment, found.limits)
    assert old.headline.endswith(found.sampling)
