"""The study of foreign plants: its formulation against the package's, its draws, its judge."""

import json
import math
from collections import Counter
from dataclasses import MISSING, fields, replace

import numpy as np
import pandas as pd
import pytest

from benchmarks.foreign_effects import __main__ as foreign_effects
from benchmarks.foreign_effects.case_row import run_case
from benchmarks.foreign_effects.cases import NUMBERS, OUTSIDE, Case, make_cases, prepare
from benchmarks.foreign_effects.chain import Bench
from benchmarks.foreign_effects.degradations import KINDS, Sampled, degrade, through_files
from benchmarks.foreign_effects.drives import Drive, held, smooth
from benchmarks.foreign_effects.forms import EFFECTS, FORMS, Mechanism
from benchmarks.foreign_effects.physics import linear, plays_by_substeps, plays_by_turning_points
from benchmarks.foreign_effects.plants import Foreign
from benchmarks.foreign_effects.protocols import PROTOCOLS, Taken, take
from benchmarks.foreign_effects.scoring import judge
from benchmarks.foreign_effects.sentences import judge_sentences, what_is_left
from benchmarks.foreign_effects.summary import targets
from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult, View, steps_of
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, RDPI, Plant, PlantModel, settled_memory
from rdpi_gym.plant.effects import CATALOGUE

THRESHOLDS, WEIGHTS = np.array([0.7, 2.1, 5.0, 9.3]), np.array([0.2, 0.3, 0.1, 0.15])


def bench(u_fine, ts_s, parts, hidden=(), delta2_s=0.0):
    plant = Foreign(1.0, THRESHOLDS, WEIGHTS, delta2_s, 0.0, 20.0, 30.0, 0.01, 0.0)
    drive = Drive("run", "train", ts_s, parts, u_fine)
    return Bench(plant, tuple(hidden), Taken("", (drive,), 0.0, 20.0, False, False))


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


@pytest.mark.parametrize("history", [(), (15.0, -8.0), (-19.0, 10.0, -3.0, 1.0)])
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


@pytest.mark.parametrize("delta2_s", [0.0, 2e-4])
def test_a_held_command_moves_the_plant_as_the_sampled_model_says(delta2_s):
    u = steps()
    (y,) = bench(held(u, 8), 1e-3, 8, delta2_s=delta2_s).displacements()
    np.testing.assert_allclose(y, package(u, 1e-3, delta2_s=delta2_s), atol=1e-11)


@pytest.mark.parametrize("delta2_s", [0.0, 5e-4])
def test_a_smooth_command_differs_by_its_turns_between_the_samples_alone(delta2_s):
    def curve(t):
        return 18.0 * np.sin(2.0 * math.pi * 3.0 * t) * np.exp(-0.4 * t)

    one = bench(smooth(curve, 4000, 1e-3, 16), 1e-3, 16, delta2_s=delta2_s)
    (y,) = one.displacements()
    u = one.taken.drives[0].command_V
    # a turn lies up to a Ts² / 8 beyond its samples, 18 (2 pi 3)² 1e-6 / 8 V = 0.8 mV
    np.testing.assert_allclose(y, package(u, 1e-3, delta2_s=delta2_s), atol=1e-3)
    (straight,) = one.displacements(linear=True)
    np.testing.assert_allclose(straight, package(u, 1e-3, delta2_s=delta2_s), atol=1e-11)


def test_a_delay_of_whole_samples_is_the_catalogues():
    u, late = steps(), CATALOGUE["delay"](delay_s=3e-3)
    hidden = Mechanism(form("delay", "whole samples"), {"delay_s": 3e-3})
    (y,) = bench(held(u, 8), 1e-3, 8, [hidden]).displacements()
    np.testing.assert_allclose(y, package(u, 1e-3, late), atol=1e-11)


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


def test_a_gap_on_the_displacement_is_the_catalogues():
    u, gap = steps(), CATALOGUE["backlash"](half_width_um=0.4)
    hidden = Mechanism(form("backlash", "gap"), {"half_width_um": 0.4})
    (y,) = bench(held(u, 8), 1e-3, 8, [hidden]).displacements()
    np.testing.assert_allclose(y, package(u, 1e-3, gap), atol=1e-11)


# --- the draws ---


def test_the_study_has_a_thousand_plants_and_every_effect_its_turn():
    cases = make_cases(list(NUMBERS))
    assert len({case.key for case in cases}) == len(cases) == 1000
    singles = Counter(case.subject for case in cases if case.study == "single")
    assert singles == {(name,): 30 for name in EFFECTS}
    assert set(EFFECTS) == set(CATALOGUE)
    assert len({case.subject for case in cases if case.study == "double"}) == 105
    assert Counter(c.subject[0] for c in cases if c.study == "outside") == dict.fromkeys(
        OUTSIDE, 20
    )


def test_a_case_is_always_the_same_and_another_seed_is_another_plant():
    case = Case("single", ("backlash",), 3)
    once, again = prepare(case), prepare(case)
    other = prepare(replace(case, seed=2026))
    assert once.truth == again.truth != other.truth
    for a, b in zip(once.dataset.records, again.dataset.records, strict=True):
        np.testing.assert_array_equal(a.y_um, b.y_um)


@pytest.mark.parametrize("subject", [("saturation",), ("mains_hum", "delay")])
def test_what_is_hidden_shows_and_the_noise_is_what_is_said(subject):
    study = "single" if len(subject) == 1 else "double"
    made = prepare(Case(study, subject, 5))
    truth = json.loads(json.dumps(made.truth, allow_nan=False))
    assert {h["effect"] for h in truth["hidden"]} == set(truth["floors"]) == set(subject)
    assert min(truth["floors"].values()) >= 3.0
    left = np.concatenate([(s.record.y_um - s.clean_um)[s.is_sound] for s in made.records])
    assert np.std(left) == pytest.approx(truth["noise_um"], rel=0.05)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_protocol_keeps_to_its_range_and_its_size(protocol):
    for seed in range(8):
        taken = take(protocol, np.random.default_rng(seed))
        assert 4_000 <= taken.samples <= 40_000
        for drive in taken.drives:
            assert np.max(np.abs(drive.fine_V - taken.centre_V)) <= 1.001 * taken.span_V
            assert drive.parts % 2 == 0


@pytest.mark.parametrize("kind", KINDS)
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


# --- the judge ---


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


def test_a_right_name_a_member_of_its_class_and_a_wrong_one():
    exact = judge(row(["delay"], ["delay"]))
    assert (exact["first_exact"], exact["found_exact"], exact["additions"]) == (True, True, 0)
    classed = judge(row(["delay"], ["sensor_lag"], alike={"delay": ["sensor_lag"]}))
    assert (classed["first_exact"], classed["first_by_class"]) == (False, True)
    assert (classed["found_exact"], classed["found_by_class"], classed["additions"]) == (
        False,
        True,
        0,
    )
    wrong = judge(row(["delay"], ["creep", "delay"]))
    assert (wrong["first_exact"], wrong["found_exact"], wrong["additions"]) == (False, True, 1)
    # a class stands for its effect once
    twice = judge(row(["delay"], ["sensor_lag", "delay"], alike={"delay": ["sensor_lag"]}))
    assert (twice["found_exact"], twice["additions"]) == (True, 1)


def test_what_a_case_excuses_is_neither_right_nor_wrong():
    judged = judge(row([], ["initial_memory"], study="none", excused=["initial_memory"]))
    assert (judged["first"], judged["additions"]) == ("", 0)
    judged = judge(row(["creep"], ["initial_memory", "creep"], excused=["initial_memory"]))
    assert (judged["first"], judged["first_exact"], judged["additions"]) == ("creep", True, 0)


def test_nothing_outside_the_catalogue_can_be_named():
    judged = judge(row(["duhem"], ["creep"], study="outside"))
    assert (judged["additions"], judged["first_exact"]) == (1, False)


def test_a_failure_finds_nothing():
    judged = judge(row(["creep"], status="failed"))
    assert (judged["found_exact"], judged["first_exact"], judged["all_true"]) == (
        False,
        False,
        None,
    )


@pytest.mark.parametrize(
    ("clean", "part", "left", "true"),
    [
        (0.05, 0.04, {"low": 0.60, "high": 0.80}, True),  # the share is 0.64
        (0.05, 0.04, {"low": 0.73, "high": 0.90}, True),  # within the margin
        (0.05, 0.04, {"low": 0.75, "high": 0.90}, False),
        (0.004, 0.004, {"low": 0.0, "high": 0.0}, None),  # nothing that could be shared
        (0.05, 0.04, {}, None),
        (0.05, 0.04, None, None),
    ],
)  # fmt: skip
def test_the_share_that_follows_from_the_input(clean, part, left, true):
    true_left = {"clean_um": clean, "by_input_um": part}
    judged = judge_sentences(row([], verdict="unexplained", true_left=true_left, left=left))
    assert judged["share_true"] is true
    assert judged["all_true"] is (true is not False)


def test_what_could_hide_is_an_upper_limit():
    true_left = {"clean_um": 0.05, "by_input_um": 0.04}
    said = {"low": 0.0, "high": 1.0, "hidden_um": 0.05}
    found = row([], verdict="unexplained", true_left=true_left, left=said)
    assert judge_sentences(found)["hidden_true"] is True
    found["left"] = said | {"hidden_um": 0.02}
    assert judge_sentences(found)["all_true"] is False


def test_findings_are_set_beside_what_was_done_to_the_data():
    found = row([], study="none", findings=[{"kind": "frozen"}, {"kind": "clock"}])
    found["truth"]["degraded"] = "dropouts"
    assert (judge(found)["noticed"], judge(found)["findings"]) == (True, "clock+frozen")
    found["truth"]["degraded"] = "spikes"
    assert judge(found)["noticed"] is False


def test_explained_is_false_with_error_left_unless_it_lies_between_the_samples():
    much = {"clean_um": 0.02, "by_input_um": 0.02}
    assert judge_sentences(row([], true_left=much))["explained_true"] is False
    stated = row([], true_left=much, numerical_floor_um=0.02)
    assert judge_sentences(stated)["explained_true"] is False  # the truth knows of no such floor
    stated["truth"]["sampling_um"] = 0.02
    assert judge_sentences(stated)["explained_true"] is True


def test_sample_faster_is_true_where_something_lies_between_the_samples():
    said = row([], verdict="unexplained", sampling="Sample faster than 2000 Hz.")
    assert judge_sentences(said)["all_true"] is False
    said["truth"]["hidden"] = [{"effect": "resonance", "f0_hz": 200.0}]
    assert judge_sentences(said)["all_true"] is True


# --- what a model leaves of the truth, and the command ---


def discovery(names, views=(), effects=(), verdict="explained"):
    errors = Errors(0.01, 0.01, 0.1, {})
    added = [Candidate(n, errors, {}, {}, 0.9, 0.9, (), "") for n in names]
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
        return what_is_left(discovery([], [view], effects), [sampled])  # fmt: skip

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
    found = what_is_left(discovery([], [view]), [sampled], ["gain_drift"])
    assert found["by_input_um"] ** 2 < 0.01 * found["clean_um"] ** 2
    assert what_is_left(discovery([]), [sampled]) == {"clean_um": None, "by_input_um": None}


def test_a_record_whose_channels_were_moved_back_is_compared_where_they_are():
    t = np.arange(2000) * 1e-3
    u = 10.0 * np.sin(6.0 * t)
    late = np.concatenate([u[:1], u[:-1]])  # y came a sample after u, and was moved back
    record = Record("wave", t, u, late, ts_s=1e-3, role="validation")
    sampled = Sampled(record, late, late, np.ones(t.size, dtype=bool))
    view = View("wave", "validation", t, u, u, {"end": u}, np.ones(t.size))
    found = what_is_left(discovery([], [view]), [sampled])
    assert found["clean_um"] == pytest.approx(0.0, abs=1e-9)
    # and a clock that was rounded runs as the result says, sample by sample
    view = View("wave", "validation", 1.001 * t, u, late, {"end": late}, np.ones(t.size))
    assert what_is_left(discovery([], [view]), [sampled])["clean_um"] == pytest.approx(
        0.0, abs=1e-9
    )


def silent(dataset, seed):
    return discovery([], verdict="no missing effect")


def test_a_case_that_fails_is_a_row_that_is_json():
    def fails(dataset, seed):
        raise ValueError("no idea")

    found = json.loads(json.dumps(run_case(Case("none", (), 1), fails), allow_nan=False))
    assert (found["status"], found["error"]) == ("failed", "ValueError: no idea")
    found = json.loads(json.dumps(run_case(Case("none", (), 1), silent), allow_nan=False))
    assert found["status"] == "done"


def test_the_command_runs_resumes_and_writes_tables(tmp_path, capsys):
    words = ["--studies", "none,outside", "--per", "2", "--jobs", "1", "--out", str(tmp_path)]
    assert foreign_effects.main([*words, "--part", "1/2"], engine=silent) == 0
    seen = []

    def counting(dataset, seed):
        seen.append(dataset.title)
        return silent(dataset, seed)

    capsys.readouterr()
    assert foreign_effects.main(words, engine=counting) == 0
    assert len(seen) == 2
    printed = capsys.readouterr().out
    assert "none: nothing named: 100.0 % (2 of 2, 0 by class), asked 98 %: met" in printed
    assert len(pd.read_csv(tmp_path / "cases.csv")) == 4
    tables = (tmp_path / "foreign_effects.md").read_bytes()
    assert foreign_effects.main([*words, "--tables"], engine=None) == 0
    assert (tmp_path / "foreign_effects.md").read_bytes() == tables


def test_targets_count_exact_and_by_class():
    rows = [
        row(["delay"], ["delay"]), row(["delay"], ["sensor_lag"], alike={"delay": ["sensor_lag"]}),
        row(["delay"], ["creep"]), row([], [], study="none"),
    ]  # fmt: skip
    found = {(t.study, t.asks): t for t in targets(rows)}
    first = found["single", "the right effect ranked first"]
    assert (first.reached, first.cases, first.by_class, first.is_met) == (2, 3, 1, False)
    wrong = found["all", "an effect added that is not there"]
    assert (wrong.reached, wrong.cases, wrong.is_met) == (1, 4, False)
    assert found["none", "nothing named"].is_met


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--studies", "singel"], "did you mean 'single'"),
        (["--part", "3/2"], "--part is"),
        (["--part", "half"], "for example 1/2"),
        (["--per", "0"], "--per is 0"),
        (["--tables"], "has no row of these cases"),
    ],
)
def test_bad_words_are_one_line_and_status_2(words, said, tmp_path, capsys):
    out = tmp_path / "out"
    assert foreign_effects.main([*words, "--out", str(out)], engine=silent) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
