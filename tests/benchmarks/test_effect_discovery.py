"""Discovery of hidden effects: both truths against the package's physics, their draws, the scoring."""

import json
import math
import shutil
import time
from collections import Counter
from dataclasses import MISSING, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks import foreign_effects, hidden_effects
from benchmarks.effect_discovery import foreign, independent
from benchmarks.effect_discovery.__main__ import main
from benchmarks.effect_discovery.cases import Case, Prepared, Sampled, run_case, source_files
from benchmarks.effect_discovery.foreign import (
    FOREIGN,
    KINDS,
    OUTSIDE,
    degrade,
    through_files,
    true_residual,
)
from benchmarks.effect_discovery.forms import EFFECTS, FORMS, Mechanism
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.effect_discovery.physics import linear, plays_by_substeps, plays_by_turning_points
from benchmarks.effect_discovery.plants import Bench, Foreign
from benchmarks.effect_discovery.protocols import (
    PROTOCOLS,
    Drive,
    Experiment,
    draw_experiment,
    held,
    smooth,
)
from benchmarks.effect_discovery.report import (
    REPORTS,
    agreement,
    by_subject,
    foreign_targets,
    independent_targets,
    judge,
    judge_statements,
    judgements,
)
from benchmarks.rows import run_rows
from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult, View, steps_of
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, RDPI, Plant, PlantModel, settled_memory
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.virtual_lab.draws import HIDEABLE, MaskedError
from tests.looping import over

THRESHOLDS, WEIGHTS = np.array([0.7, 2.1, 5.0, 9.3]), np.array([0.2, 0.3, 0.1, 0.15])


def bench(u_fine, ts_s, parts, hidden=(), delta2_s=0.0):
    plant = Foreign(1.0, THRESHOLDS, WEIGHTS, delta2_s, 0.0, 20.0, 30.0, 0.01, 0.0)
    drive = Drive("run", "train", ts_s, parts, u_fine)
    return Bench(plant, tuple(hidden), Experiment("", (drive,), 0.0, 20.0, False, False))


def package(u, ts_s, *effects, delta2_s=0.0):
    hysteresis = RDPI((1.0, *WEIGHTS), tuple(THRESHOLDS), delta2_s)
    model = PlantModel(hysteresis, "same", (-30.0, 30.0), (0.0, 30.0), effects=effects)
    return Plant(model, ts_s).simulate(u)


def form(effect, name):
    return next(f for f in FORMS if (f.effect, f.form) == (effect, name))


def steps(samples=3000, seed=0):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-20.0, 20.0, samples // 30), 30)


# --- the other formulation is the same physics where the forms are the same ---


@over("history", [(), (15.0, -8.0), (-19.0, 10.0, -3.0, 1.0)])
def test_plays_from_turning_points_are_plays(history):
    u = np.random.default_rng(1).normal(1.0, 9.0, 4000)
    by_turns = plays_by_turning_points(u, THRESHOLDS, WEIGHTS, history)
    still = np.zeros(u.size)
    by_steps = plays_by_substeps(u, u, still, THRESHOLDS, WEIGHTS, history)
    np.testing.assert_allclose(by_turns, by_steps, atol=1e-12)
    past = settled_memory(THRESHOLDS, np.array(history)) if history else np.zeros(4)
    assert by_turns[0] == pytest.approx(
        WEIGHTS @ np.clip(past, u[0] - THRESHOLDS, u[0] + THRESHOLDS)
    )


@over("delta2_s", [0.0, 2e-4])
def test_a_held_command_moves_the_plant_as_the_sampled_model_says(delta2_s):
    u = steps()
    (y,) = bench(held(u, 8), 1e-3, 8, delta2_s=delta2_s).displacements()
    np.testing.assert_allclose(y, package(u, 1e-3, delta2_s=delta2_s), atol=1e-11)


@over("delta2_s", [0.0, 5e-4])
def test_a_smooth_command_differs_by_its_turns_between_the_samples_alone(delta2_s):
    def curve(t):
        return 18.0 * np.sin(2.0 * math.pi * 3.0 * t) * np.exp(-0.4 * t)

    one = bench(smooth(curve, 4000, 1e-3, 16), 1e-3, 16, delta2_s=delta2_s)
    (y,) = one.displacements()
    u = one.experiment.drives[0].command_V
    # a turn lies up to a Ts² / 8 beyond its samples, 18 (2 pi 3)² 1e-6 / 8 V = 0.8 mV
    np.testing.assert_allclose(y, package(u, 1e-3, delta2_s=delta2_s), atol=1e-3)
    (straight,) = one.displacements(linear=True)
    np.testing.assert_allclose(straight, package(u, 1e-3, delta2_s=delta2_s), atol=1e-11)


@over(
    "effect, name, numbers",
    [
        ("delay", "whole samples", {"delay_s": 3e-3}),
        ("backlash", "gap", {"half_width_um": 0.4}),
    ],
)
def test_a_form_of_the_catalogue_is_the_catalogues(effect, name, numbers):
    u, kind = steps(), CATALOGUE[effect]
    hidden = Mechanism(form(effect, name), numbers)
    (y,) = bench(held(u, 8), 1e-3, 8, [hidden]).displacements()
    np.testing.assert_allclose(y, package(u, 1e-3, kind(**numbers)), atol=1e-11)


def test_one_pole_is_the_catalogues_lag_and_one_element_creeps_as_an_exponential():
    x = np.cumsum(np.random.default_rng(2).normal(size=500))
    lag = CATALOGUE["sensor_lag"](time_constant_s=3e-3).run(x, 1e-3)
    np.testing.assert_allclose(linear(x, [1.0], [3e-3, 1.0], 1e-3), lag, atol=1e-11)
    u = np.concatenate([np.zeros(10), np.full(2000, 0.5)])  # every play sticks: 1 µm/V
    numbers = {"times_s": [0.3], "shares": [0.04]}
    hidden = Mechanism(form("creep", "two Kelvin-Voigt elements"), numbers)
    (y,) = bench(held(u, 8), 1e-3, 8, [hidden]).displacements()
    # a step of the command is a ramp over one point of the grid, read half a sample later
    since = (np.arange(2000) + 0.5) * 1e-3
    expected = 0.5 * (1.0 + 0.04 * -np.expm1(-since / 0.3))
    np.testing.assert_allclose(y[10:], expected, atol=0.5 * 0.04 * 1.25e-4 / 0.3)


# --- the draws ---


def test_the_studies_have_the_cases_that_the_targets_need():
    cases = foreign.make_cases(list(FOREIGN.numbers))
    assert len({case.key for case in cases}) == len(cases) == 1000
    singles = Counter(case.subject for case in cases if case.study == "single")
    assert singles == {(name,): 30 for name in EFFECTS}
    # no effect needs a foreign form to be added to the catalogue, so that some may lack one; the
    # counts here pin the fifteen that have one, and so that none of them is lost
    assert set(EFFECTS) <= set(CATALOGUE)
    assert len({case.subject for case in cases if case.study == "double"}) == 105
    outside = Counter(c.subject[0] for c in cases if c.study == "outside")
    assert outside == dict.fromkeys(OUTSIDE, 20)

    cases = independent.make_cases(list(INDEPENDENT.numbers))
    assert len({case.key for case in cases}) == len(cases)
    by_study = {name: [c for c in cases if c.study == name] for name in INDEPENDENT.numbers}
    # plant by plant, so that what an interrupted run has done is a fair sample
    numbers = [case.number for case in by_study["single"]]
    assert numbers == sorted(list(range(20)) * len(HIDEABLE))
    possible = math.comb(len(HIDEABLE), 2)
    assert len(by_study["pairs"]) == possible * 3
    assert len({case.subject for case in by_study["pairs"]}) == possible
    assert len(by_study["none"]) == 100
    assert {case.variant for case in by_study["invariance"]} == {
        "order shuffled", "sampling time halved", "other units", "sign reversed",
    }  # fmt: skip


def test_an_independent_case_is_the_same_draw_in_every_study_and_variant():
    def drawn(study, number, variant="plain"):
        return independent.prepare(Case(study, ("gain_drift",), number, variant=variant))

    single, shuffled = drawn("single", 1), drawn("invariance", 1, "order shuffled")
    halved = drawn("invariance", 1, "sampling time halved")
    assert single.truth == shuffled.truth
    assert single.truth["hidden"] == halved.truth["hidden"] != drawn("single", 2).truth["hidden"]
    assert halved.truth["ts_factor"] == 0.5
    by_name = {r.name: r for r in shuffled.dataset.records}
    for record in single.dataset.records:
        np.testing.assert_array_equal(record.y_um, by_name[record.name].y_um)
    assert halved.dataset.records[0].ts_s == 0.5 * single.dataset.records[0].ts_s


def test_a_foreign_case_is_always_the_same_and_another_seed_is_another_plant():
    case = Case("single", ("backlash",), 3)
    once, again = foreign.prepare(case), foreign.prepare(case)
    assert once.truth == again.truth != foreign.prepare(replace(case, seed=2026)).truth
    for a, b in zip(once.dataset.records, again.dataset.records, strict=True):
        np.testing.assert_array_equal(a.y_um, b.y_um)


@over("subject", [("saturation",), ("mains_hum", "delay")])
def test_what_is_hidden_shows_and_the_noise_is_what_is_stated(subject):
    study = "single" if len(subject) == 1 else "double"
    made = foreign.prepare(Case(study, subject, 5))
    truth = json.loads(json.dumps(made.truth, allow_nan=False))
    assert {h["effect"] for h in truth["hidden"]} == set(truth["floors"]) == set(subject)
    assert min(truth["floors"].values()) >= 3.0
    left = np.concatenate([(s.record.y_um - s.clean_um)[s.is_sound] for s in made.records])
    assert np.std(left) == pytest.approx(truth["noise_um"], rel=0.05)


def test_a_protocol_keeps_to_its_range_and_its_size():
    for protocol in PROTOCOLS:
        for seed in range(8):
            experiment = draw_experiment(protocol, np.random.default_rng(seed))
            assert 4_000 <= experiment.samples <= 40_000, (protocol, seed)
            for drive in experiment.drives:
                reach = np.max(np.abs(drive.fine_V - experiment.centre_V))
                assert reach <= 1.001 * experiment.span_V, (protocol, seed)
                assert drive.parts % 2 == 0, (protocol, seed)


@over("kind", KINDS)
def test_a_degradation_keeps_what_is_true_beside_its_record(kind):
    t = np.arange(4000) * 1e-3
    u = 10.0 * np.sin(6.0 * t)
    record = Record("wave", t, u, 2.0 * u, ts_s=1e-3)
    whole = Sampled(record, 2.0 * u, 2.0 * u, np.ones(t.size, dtype=bool))
    (found,) = degrade(kind, [whole], np.random.default_rng(0))
    dataset = through_files(kind, Dataset("", (found.record,)), np.random.default_rng(0))
    read = dataset.records[0]
    sound = found.is_sound
    np.testing.assert_allclose(found.record.y_um[sound], found.clean_um[sound])
    if kind in ("spikes", "dropouts", "clipped output", "clipped input"):
        assert 0.0 < np.mean(~sound) < 0.2
    elif kind in ("one sample apart",):
        assert not np.allclose(found.clean_um, whole.clean_um)
    assert np.isfinite(read.y_um).all()
    # what was read is still the wave, wherever a sample is sound and was measured
    good = read.error_mask & (np.interp(read.t_s, t, sound.astype(float)) > 0.99)
    assert np.std((read.y_um - np.interp(read.t_s, t, found.clean_um))[good]) < 0.02


SKEWED = (  # all that an eighth of seed 2033 draws
    ("single", "gain_drift", 3), ("single", "gain_drift", 243), ("outside", "duhem", 23),
    ("double", "slew_limit+actuator_lag", 161), ("triple", "congruency+gain_drift+sensor_lag", 71),
    ("triple", "initial_memory+backlash+delay", 87),
)  # fmt: skip


@over("study, names, number", SKEWED)
def test_a_skew_that_moves_no_sample_is_no_fault(study, names, number):
    truth = FOREIGN.prepare(Case(study, tuple(names.split("+")), number, 2033)).truth
    assert truth["degraded"] == ""


# --- the scoring ---


def row(subject, names=(), study="single", alike=None, excused=(), status="done", **changed):
    truth = {
        "noise_um": 0.01, "sampling_um": 0.0, "rates_hz": [1e3], "hidden": [], "excused": list(excused),
        "protocol": "multisines", "degraded": "", "alike": alike or {},
    }  # fmt: skip
    found = [{"effect": name} for name in names]
    return {
        "key": "+".join(subject), "code": "abc", "study": study, "subject": list(subject), "number": 0,
        "seed": 0, "status": status, "noise_um": 0.01, "validation_um": 0.0102, "seconds": 2.0,
        "verdict": "explained", "ranking": found, "steps": found, "truth": truth, "sampling": None,
        "true_left": {"clean_um": 0.002, "by_input_um": 0.002},
    } | changed  # fmt: skip


def independent_row(subject, names, study="single", variant="plain", excess_um=0.0, **changed):
    made = row(subject, names, study, variant=variant, **changed)
    del made["true_left"]
    made["validation_um"] = math.hypot(made["noise_um"], excess_um)
    if subject == ["force"]:
        made["truth"]["outside"] = "force"
    return made


CLASS = {"delay": ["sensor_lag"]}
JUDGED = [  # subject, names, further fields, first, first by class, found, by class, additions
    (["delay"], ["delay"], {}, "delay", False, True, False, 0),
    (["delay"], ["creep"], {}, "creep", False, False, False, 1),
    (["delay"], ["sensor_lag"], {}, "sensor_lag", False, False, False, 1),
    (["delay"], ["sensor_lag"], {"alike": CLASS}, "sensor_lag", True, True, True, 0),
    (["delay"], ["creep", "delay"], {}, "creep", False, True, False, 1),
    # a class stands for its effect once
    (["delay"], ["sensor_lag", "delay"], {"alike": CLASS}, "sensor_lag", True, True, False, 1),
    (["creep", "delay"], ["delay", "creep", "backlash"], {}, "delay", False, True, False, 1),
    (["creep", "delay"], ["delay"], {}, "delay", False, False, False, 0),
    # what a case excuses is neither right nor wrong
    ([], ["initial_memory"], {"excused": ["initial_memory"]}, "", False, True, False, 0),
    (["creep"], ["initial_memory", "creep"], {"excused": ["initial_memory"]}, "creep", False, True, False, 0),
    # nothing outside the catalogue can be named
    (["duhem"], ["creep"], {"study": "outside"}, "creep", False, False, False, 1),
    (["creep"], [], {"status": "failed"}, "", False, False, False, 0),
]  # fmt: skip


@over("subject, names, changed, first, first_by_class, found, by_class, additions", JUDGED)
def test_a_right_name_a_member_of_its_class_and_a_wrong_one(
    subject, names, changed, first, first_by_class, found, by_class, additions
):
    judged = judge(row(subject, names, **changed))
    assert judged["first"] == first
    assert judged["first_by_class"] is first_by_class
    assert judged["first_exact"] is (first in subject)
    assert judged["first_right"] is (first_by_class or first in subject)
    assert (judged["found"], judged["found_by_class"]) == (found, by_class)
    assert judged["additions"] == additions
    assert (judged["all_true"] is None) is (changed.get("status") == "failed")


def test_the_ratio_is_the_validation_error_over_the_noise():
    right = judge(independent_row(["creep"], ["creep"]))
    assert (right["ratio"], right["within"]) == (pytest.approx(1.0), True)
    wrong = judge(independent_row(["creep"], ["delay"], excess_um=0.01))
    assert (wrong["ratio"], wrong["within"]) == (pytest.approx(math.sqrt(2)), False)


CLEAN = {"clean_um": 0.05, "by_input_um": 0.04}
MUCH = {"clean_um": 0.02, "by_input_um": 0.02}
LITTLE = {"clean_um": 0.004, "by_input_um": 0.004}
UNEXPLAINED, MODE = {"verdict": "unexplained"}, [{"effect": "resonance", "f0_hz": 200.0}]
STATED = [  # fields of the row, changes of its truth, the statement, whether that is true
    # the share that follows from the input is 0.64
    ({"true_left": CLEAN, "left": {"low": 0.60, "high": 0.80}}, {}, "share_true", True),
    # within the margin
    ({"true_left": CLEAN, "left": {"low": 0.73, "high": 0.90}}, {}, "share_true", True),
    ({"true_left": CLEAN, "left": {"low": 0.75, "high": 0.90}}, {}, "share_true", False),
    # nothing that could be shared
    ({"true_left": LITTLE, "left": {"low": 0.0, "high": 0.0}}, {}, "share_true", None),
    ({"true_left": CLEAN, "left": {}}, {}, "share_true", None),
    ({"true_left": CLEAN, "left": None}, {}, "share_true", None),
    # what could hide is an upper limit
    ({"true_left": CLEAN, "left": {"low": 0.0, "high": 1.0, "hidden_um": 0.05}}, {}, "hidden_true", True),
    ({"true_left": CLEAN, "left": {"low": 0.0, "high": 1.0, "hidden_um": 0.02}}, {}, "hidden_true", False),
    # explained is false with error left, unless the truth knows that it lies between the samples
    ({"true_left": MUCH, "verdict": "explained"}, {}, "explained_true", False),
    ({"true_left": MUCH, "verdict": "explained", "numerical_floor_um": 0.02}, {}, "explained_true", False),
    ({"true_left": MUCH, "verdict": "explained", "numerical_floor_um": 0.02}, {"sampling_um": 0.02}, "explained_true", True),
    # sampling faster is of use where something lies between the samples
    ({"sampling": "Sample faster than 2000 Hz."}, {}, "sampling_true", False),
    ({"sampling": "Sample faster than 2000 Hz."}, {"hidden": MODE}, "sampling_true", True),
]  # fmt: skip


@over("changed, truth, statement, true", STATED)
def test_a_statement_is_judged_by_the_truth(changed, truth, statement, true):
    made = row([], **(UNEXPLAINED | changed))
    made["truth"] |= truth
    judged = judge_statements(made)
    assert judged[statement] is true
    assert judged["all_true"] is (true is not False)


def test_findings_are_set_beside_what_was_done_to_the_data():
    found = row([], study="none", findings=[{"kind": "frozen"}, {"kind": "clock"}])
    found["truth"]["degraded"] = "dropouts"
    assert (judge(found)["noticed"], judge(found)["findings"]) == (True, "clock+frozen")
    found["truth"]["degraded"] = "spikes"
    assert judge(found)["noticed"] is False
    found["truth"]["degraded"] = "missing rows"
    assert judge(found | {"remarked": 0})["noticed"] is False
    assert judge(found | {"remarked": 2})["noticed"] is True


def test_independent_targets_are_counted_over_their_studies():
    rows = [
        independent_row(["creep"], ["creep"]),
        independent_row(["creep"], ["delay"], excess_um=0.1, verdict="unexplained"),
        independent_row([], [], "none", verdict="no missing effect"),
        independent_row([], ["delay"], "none"),
        independent_row(["force"], [], "outside", excess_um=0.1, verdict="unexplained"),
        independent_row(["force"], ["creep"], "outside", excess_um=0.1),
        independent_row(["creep"], ["creep"], "invariance", "sign reversed"),
        independent_row([], ["creep"], "invariance", "sign reversed"),
    ]
    found = [(t.study, t.reached, t.cases, t.is_met) for t in independent_targets(rows)]
    assert found == [
        ("single", 1, 2, False), ("single", 1, 2, False), ("none", 1, 2, False),
        ("outside", 1, 2, False), ("single, sign reversed", 1, 1, True),
        ("single, sign reversed", 1, 1, True), ("none, sign reversed", 0, 1, False),
    ]  # fmt: skip
    assert independent_targets(rows)[3].falsely_added == "1 on 1 of 2"


def test_foreign_targets_count_exact_and_by_class():
    names = (["delay"], ["sensor_lag"], ["creep"])
    rows = [row(["delay"], each, alike=CLASS) for each in names] + [row([], [], study="none")]
    found = {(t.study, t.asks): t for t in foreign_targets(rows)}
    named = found["single", "the effect named"]
    assert (named.reached, named.cases, named.by_class, named.is_met) == (2, 3, 1, False)
    wrong = found["all", "a wrong name that is found or likely"]
    assert (wrong.reached, wrong.cases, wrong.is_met) == (1, 4, False)
    assert found["none", "nothing named"].is_met


def test_a_wrong_name_that_is_likely_is_none_that_is_found():
    rows = [row(["delay"], ["delay", "creep"]), row(["delay"], ["delay"])]
    rows[0]["steps"][1]["grade"] = "likely"
    found = {(t.study, t.asks): t.reached for t in foreign_targets(rows)}
    assert found["all", "a wrong name that is found"] == 0
    assert found["all", "a wrong name that is found or likely"] == 1


def test_agreement_is_with_the_same_draw():
    rows = [
        independent_row(["creep"], ["creep"], number=0),
        independent_row(["creep"], ["creep"], "invariance", "sign reversed", number=0),
        independent_row(["creep"], ["delay"], number=1),
        independent_row(["creep"], ["creep"], "invariance", "sign reversed", 0.0075, number=1),
        independent_row(["creep"], ["creep"], "invariance", "sign reversed", number=2),
    ]
    line = agreement(rows).iloc[0]
    assert (line["cases"], line["same_verdict"], line["same_steps"]) == (2, 2, 1)
    assert line["largest_change_percent"] == pytest.approx(25.0)


# --- the residual of a model against the truth ---


def discovery(names, views=(), effects=(), verdict="explained"):
    errors = Errors(0.01, 0.01, 0.1, {})
    added = [Candidate(n, errors, {"size": 1.0}, {"size": None}, 0.9, 0.9, (), "") for n in names]
    said = {
        "kind": "discovery", "title": "", "plant": replace(P10, effects=tuple(effects)),
        "steps": steps_of(added), "rounds": (tuple(added),), "noise_floor_um": 0.01, "noise_origin": "",
        "numerical_floor_um": 0.0, "base": errors, "final": errors, "verdict": verdict,
        "unexplained_rmse_um": 0.0, "remainder": "", "views": tuple(views), "seconds": 1.0,
    }  # fmt: skip
    for entry in fields(SearchResult):  # nothing else was found
        if entry.name not in said and entry.default is MISSING and entry.default_factory is MISSING:
            said[entry.name] = () if "tuple" in str(entry.type) else None
    return SearchResult(**said)


def test_what_is_left_is_divided_between_the_input_and_the_clock():
    t = np.arange(2000) * 1e-3
    u, hum = 10.0 * np.sin(6.0 * t), 0.3 * np.sin(2.0 * math.pi * 50.0 * t)
    by_input = 2.0 * u
    record = Record("wave", t, u, by_input + hum, ts_s=1e-3, role="validation")
    sampled = Sampled(record, by_input + hum, by_input, np.ones(t.size, dtype=bool))

    def left(model, effects=()):
        view = View(
            "wave", "validation", t, u, record.y_um, {"base": 0 * u, "end": model}, np.ones(t.size)
        )
        return true_residual(discovery([], [view], effects), [sampled])  # fmt: skip

    size = 0.3 / math.sqrt(2.0)
    nothing = left(by_input)  # the hum is missing, and no function of the input
    assert nothing["clean_um"] == pytest.approx(size, rel=1e-3)
    assert nothing["by_input_um"] == pytest.approx(0.0, abs=1e-9)
    whole = left(by_input + hum, [CATALOGUE["mains_hum"](0.3, 50.0, 0.0)])
    assert whole == pytest.approx({"clean_um": 0.0, "by_input_um": 0.0}, abs=1e-9)
    missing = left(1.9 * u + hum, [CATALOGUE["mains_hum"](0.3, 50.0, 0.0)])
    assert missing["by_input_um"] == pytest.approx(np.std(0.1 * u), rel=1e-3)
    # a drift of the gain is none of the input's doing, whatever it has become by then
    drifting = 1.0 + 0.05 * (4.0 + t)
    sampled = Sampled(record, drifting * by_input, by_input, np.ones(t.size, dtype=bool))
    view = View("wave", "validation", t, u, record.y_um, {"end": 1.25 * by_input}, np.ones(t.size))
    found = true_residual(discovery([], [view]), [sampled], ["gain_drift"])
    assert found["by_input_um"] ** 2 < 0.01 * found["clean_um"] ** 2
    assert true_residual(discovery([]), [sampled]) == {"clean_um": None, "by_input_um": None}


def test_a_record_whose_channels_were_moved_back_is_compared_where_they_are():
    t = np.arange(2000) * 1e-3
    u = 10.0 * np.sin(6.0 * t)
    late = np.concatenate([u[:1], u[:-1]])  # y came a sample after u, and was moved back
    record = Record("wave", t, u, late, ts_s=1e-3, role="validation")
    sampled = Sampled(record, late, late, np.ones(t.size, dtype=bool))
    view = View("wave", "validation", t, u, u, {"end": u}, np.ones(t.size))
    found = true_residual(discovery([], [view]), [sampled])
    assert found["clean_um"] == pytest.approx(0.0, abs=1e-9)
    # and a clock that was rounded runs as the result says, sample by sample
    view = View("wave", "validation", 1.001 * t, u, late, {"end": late}, np.ones(t.size))
    assert true_residual(discovery([], [view]), [sampled])["clean_um"] == pytest.approx(
        0.0, abs=1e-9
    )


# --- the rows and the command ---


def silent(dataset, seed):
    return discovery([], verdict="no missing effect")


def oracle(dataset, seed):
    names = [name for name in dataset.title.split("+") if name]
    return discovery(names, verdict="explained" if names else "no missing effect")


def creep_or_failure(dataset, seed):
    if dataset.title == "delay":
        raise ValueError("no idea")
    return discovery(["creep"])


@pytest.fixture
def quick(monkeypatch):
    """The independent source with records that hold nothing but the name of the case."""
    t = np.arange(40) * 1e-3
    records = (Record("r", t, np.sin(t), np.sin(t), ts_s=1e-3),)

    def prepared(case):
        if case.subject == ("mains_hum",):
            raise MaskedError("mains_hum cannot be seen")
        truth = {"hidden": [{"effect": name} for name in case.subject], "noise_um": 0.012}
        return Prepared(Dataset("+".join(case.subject), records), truth)

    return replace(INDEPENDENT, prepare=prepared)


def test_masked_and_failed_cases_are_told_apart(quick, tmp_path):
    cases = independent.make_cases(["single"], 1, effects=["creep", "delay", "mains_hum"])
    rows = [run_case(case, quick, creep_or_failure) for case in cases]
    assert [r["status"] for r in rows] == ["done", "failed", "masked"]
    assert rows[1]["error"] == "ValueError: no idea"
    assert len(judgements(rows)) == 2
    table = by_subject(rows).set_index("subject")
    assert table.loc["delay", "failed"] == 1
    assert table.loc["delay", "first_percent"] == 0.0
    text = REPORTS["independent"].page(rows, "hidden_effects")
    assert "| single | the right effect ranked first | 97 % | 50.0 % (1 of 2) | no |" in text
    assert "No draw shows, beside noise or each other: mains_hum." in text


def test_seconds_of_a_row_are_those_of_its_source(quick):
    """Of the independent truth as they pass, of the foreign one those of the processor."""

    def sleeps(dataset, seed):
        time.sleep(0.2)
        return silent(dataset, seed)

    apart = replace(quick, clock=FOREIGN.clock)
    passed, worked = (run_case(Case("none", (), 0), s, sleeps)["seconds"] for s in (quick, apart))
    assert passed >= 0.2 > worked


def test_an_interrupted_study_continues_and_rows_of_changed_code_are_set_aside(quick, tmp_path):
    cases = independent.make_cases(["single"], 2, effects=["creep", "delay"])
    seen, done, notes = [], [], []

    def study(code, stop=99):
        def run(case):
            if len(seen) == stop:
                raise KeyboardInterrupt
            seen.append(case.subject[0])
            return run_case(case, quick, oracle) | {"code": code}

        return run_rows(cases, tmp_path, run, code, 1, lambda _, *n: done.append(n), notes.append)

    with pytest.raises(KeyboardInterrupt):
        study("first", stop=2)
    done.clear()
    rows = study("first")
    assert seen == ["creep", "delay"] * 2
    assert done == [(2, 4), (3, 4), (4, 4)]
    assert [r["key"] for r in rows] == [case.key for case in cases]
    study("changed")
    assert len(seen) == 8
    aside = tmp_path / "rows-stale-1.jsonl"
    assert notes == [f"rows of code that has changed since were set aside in {aside}"]
    assert len(aside.read_text().splitlines()) == 5


def test_the_rows_of_one_truth_do_not_depend_on_the_other():
    own, other = ({path.stem for path in source_files(name)} for name in ("independent", "foreign"))
    assert own == {"cases", "independent", "outsiders"}
    assert other >= {"cases", "foreign", "forms", "physics", "protocols", "outsiders"}
    assert "independent" not in other


def test_rows_are_json():
    def fails(dataset, seed):
        raise ValueError("no idea")

    def row_of(case, source, engine):
        return json.loads(json.dumps(run_case(case, source, engine), allow_nan=False))

    case = Case("single", ("gain_drift",), 0, variant="plain")
    found = row_of(case, INDEPENDENT, lambda dataset, seed: discovery(["creep"]))
    assert (found["status"], found["truth"]["hidden"][0]["effect"]) == ("done", "gain_drift")
    assert found["ranking"][0]["effect"] == found["steps"][0]["effect"] == "creep"
    assert found["steps"][0]["parameters"] == {"size": 1.0}
    assert found["key"] == "single/gain_drift/0/seed 0/plain"
    found = row_of(Case("none", (), 1), FOREIGN, fails)
    assert (found["status"], found["error"]) == ("failed", "ValueError: no idea")
    found = row_of(Case("none", (), 1), FOREIGN, silent)
    assert (found["status"], found["key"]) == ("done", "none/nothing/1/seed 0")
    assert set(found["true_left"]) == {"clean_um", "by_input_um"}


def test_the_first_study_writes_tables_and_prints_targets(quick, tmp_path, capsys):
    words = ["--study", "single,none", "--plants", "1", "--jobs", "1", "--out", str(tmp_path)]
    assert main(words, quick, oracle) == 0
    printed = capsys.readouterr().out.splitlines()
    known = len(HIDEABLE) - 1  # the oracle here knows no hum
    assert printed[0] == (
        f"single: the right effect ranked first: 100.0 % ({known} of {known}), asked 97 %: met; "
        "effects falsely added: 0"
    )
    assert printed[-1] == f"tables: {tmp_path / 'hidden_effects.md'}"
    assert len(pd.read_csv(tmp_path / "cases.csv")) == known + 1
    assert set(pd.read_csv(tmp_path / "by_subject.csv")["subject"]) == {
        "nothing", *(name for name in HIDEABLE if name != "mains_hum"),
    }  # fmt: skip


def test_the_second_study_runs_in_parts_and_its_tables_are_written_without_a_run(tmp_path, capsys):
    words = ["--truth", "foreign", "--studies", "none,outside", "--plants", "2", "--jobs", "1"]
    words += ["--out", str(tmp_path)]
    seen = []

    def counting(dataset, seed):
        seen.append(dataset.title)
        return silent(dataset, seed)

    assert main([*words, "--part", "1/2"], engine=silent) == 0
    assert main(words, engine=counting) == 0
    assert len(seen) == 2
    printed = capsys.readouterr().out
    assert "none: nothing named: 100.0 % (2 of 2, 0 by class), asked 98 %: met" in printed
    tables = {name: (tmp_path / name).read_bytes() for name in ("foreign_effects.md", "cases.csv")}
    assert len(pd.read_csv(tmp_path / "cases.csv")) == 4
    # by the first name of the command, and without a run
    words = ["--studies", "none,outside", "--per", "2", "--tables", "--out", str(tmp_path)]
    assert foreign_effects.main(words, engine=None) == 0
    for name, content in tables.items():
        assert (tmp_path / name).read_bytes() == content, name


@over(
    "command, folder, seed", [(hidden_effects, "hidden", "0"), (foreign_effects, "foreign", "2034")]
)
def test_committed_tables_are_those_of_the_committed_rows(command, folder, seed, tmp_path):
    committed = Path(hidden_effects.__file__).parents[1] / "studies" / "results" / folder
    shutil.copy(committed / "rows.jsonl", tmp_path)
    assert command.main(["--tables", "--seed", seed, "--out", str(tmp_path)], engine=None) == 0
    for path in committed.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


REFUSED = [
    (hidden_effects, ["--study", "singel"], "--study: 'singel' is unknown (did you"),
    (hidden_effects, ["--study", "none", "--studies", "none"], "--studies and --study are names"),
    (hidden_effects, ["--effects", "crep"], "did you mean 'creep'"),
    (hidden_effects, ["--plants", "0"], "--plants is 0"),
    (hidden_effects, ["--jobs", "0"], "--jobs is 0"),
    (hidden_effects, ["--seed", "-1"], "--seed is -1"),
    (hidden_effects, ["--tables"], "has no row of these cases"),
    (foreign_effects, ["--studies", "singel"], "--studies: 'singel' is unknown (did"),
    (foreign_effects, ["--part", "3/2"], "--part is"),
    (foreign_effects, ["--part", "half"], "for example 1/2"),
    (foreign_effects, ["--per", "0"], "--per is 0"),
    (foreign_effects, ["--per", "1", "--plants", "1"], "--plants and --per are names"),
    (foreign_effects, ["--tables"], "has no row of these cases"),
]


def test_bad_words_are_one_line_and_status_2(tmp_path, capsys):
    (tmp_path / "experiment").write_text("")
    experiment = (hidden_effects, ["--out", str(tmp_path / "experiment")], "is a file")
    for command, words, message in (*REFUSED, experiment):
        out = tmp_path / "out"
        assert command.main(["--out", str(out), *words], engine=silent) == 2, words
        error = capsys.readouterr().err
        assert message in error, words
        assert error.count("\n") == 1, words
        assert not out.exists(), words
