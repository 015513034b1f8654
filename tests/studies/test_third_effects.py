"""Third study of the search: its base plant is the package's, its draws are pure and show what they hide."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.foreign import KINDS as FOREIGN_FAULTS
from benchmarks.effect_discovery.forms import FORMS as FOREIGN_FORMS
from benchmarks.effect_discovery.protocols import PROTOCOLS as FOREIGN_PROTOCOLS
from benchmarks.rows import ROWS_FILE
from rdpi_gym.plant import CORES, RDPI, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.store import named_rows
from studies.third_effects.__main__ import OUT, judge_row, main, page, stored_draws
from studies.third_effects.draws import NUMBERS, ROUNDING, is_drawn_as, make_cases, prepare, sums
from studies.third_effects.faults import EXCUSED, FAULTS
from studies.third_effects.forms import EFFECTS, FORMS
from studies.third_effects.physics import filtered, slip_sums
from studies.third_effects.plants import (
    KINDS,
    OUTSIDE,
    BaseModel,
    Bench,
    draw_core,
    draw_elements,
)
from studies.third_effects.protocols import PROTOCOLS, Drive, Experiment, held
from tests.looping import over

CASES = {case.key: case for case in make_cases()}


def first(study, subject=None):
    return next(
        c for c in CASES.values() if c.study == study and (subject is None or c.subject == subject)
    )


@over("words", [["--part", "1/2"], ["--plants", "3"], ["--jobs", "0"]])
def test_it_is_run_on_all_cases_or_on_none(words, capsys):
    assert main(words) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_nothing_that_it_draws_is_drawn_by_another_study():
    assert not set(PROTOCOLS) & set(FOREIGN_PROTOCOLS)
    assert not {(f.effect, f.form) for f in FORMS} & {(f.effect, f.form) for f in FOREIGN_FORMS}
    assert not set(FAULTS) & set(FOREIGN_FAULTS)
    assert set(EFFECTS) == set(CATALOGUE)
    assert set(EXCUSED) <= set(FAULTS)
    assert set(sum(KINDS.values(), ())) <= set(CORES)


def test_every_stratum_has_its_cases_and_every_subject_its_turn():
    assert len(CASES) == sum(NUMBERS.values()) == 103
    for study, subjects in {
        "single": [(name,) for name in EFFECTS],
        "outside": [(name,) for name in OUTSIDE],
        "kind": [(name,) for name in KINDS],
        "fault": [(name,) for name in FAULTS],
    }.items():
        assert {c.subject for c in CASES.values() if c.study == study} == set(subjects)


def test_the_sums_of_all_cases_are_committed():
    assert set(stored_draws()) == set(CASES)


@over("name", ["u_rms_V", "u_last_V", "y_rms_um", "y_last_um"])
def test_another_rounding_is_the_same_draw_and_another_sum_is_not(name):
    stored = next(iter(stored_draws().values()))
    rms = stored[name.replace("last", "rms")]
    for change, same in ((0.5, True), (2.0, False)):
        assert is_drawn_as(stored | {name: stored[name] + change * ROUNDING * rms}, stored) is same


def bench(u, delta2_s=0.0, parts=8):
    drive = Drive("run", "train", 1e-3, parts, held(u, parts), True)
    experiment = Experiment("", (drive,), 0.0, 20.0)
    plant = draw_elements(experiment, np.random.default_rng(3), False)
    return Bench(plant, experiment)


def test_the_plant_without_effects_is_the_package_s():
    u = np.repeat(np.random.default_rng(0).uniform(-20.0, 20.0, 60), 20)
    one = bench(u)
    p = one.plant
    gains = (p.gain_um_V - p.weights.sum(), *p.weights)
    model = PlantModel(RDPI(gains, tuple(p.yields_V), 0.0), "same", (-30.0, 30.0), (0.0, 30.0))
    (y,) = one.displacements()
    np.testing.assert_allclose(y, Plant(model, 1e-3).simulate(u), atol=1e-9 * p.stroke_um)
    # a refit of the base model takes all of it up
    assert BaseModel(one).left_um([y]) < 2e-3 * p.stroke_um


@over("kind", list(KINDS))
def test_a_plant_of_another_kind_begins_at_rest_at_0_V(kind):
    u = 5.0 + np.concatenate([np.linspace(0.0, 6.0, 300), np.linspace(6.0, -8.0, 700)])
    core = draw_core(kind, 10.0, 1e-3, np.random.default_rng(1))
    walk = np.linspace(0.0, u[0], 400)
    here, from_rest = (
        replace(bench(each, parts=1), core=core).displacements()[0]
        for each in (u, np.concatenate([walk, u]))
    )
    np.testing.assert_allclose(here, from_rest[walk.size :], atol=1e-9)


def test_wider_elements_yield_later_and_a_filter_is_its_differential_equation():
    u = np.linspace(0.0, 5.0, 501)
    still, wide = (
        slip_sums(u, np.full(u.size, w), np.array([1.0]), np.ones((1, 1)), np.zeros(0))[-1, 0]
        for w in (0.0, 0.5)
    )
    assert (still, wide) == (pytest.approx(4.0), pytest.approx(3.5))
    t = np.arange(2000) * 1e-3
    np.testing.assert_allclose(
        filtered(t, [1.0], [0.2, 1.0], 1e-3), t - 0.2 * (1.0 - np.exp(-t / 0.2)), atol=1e-9
    )


@over("study", list(NUMBERS))
def test_a_case_is_drawn_as_its_committed_sums_say(study):
    case = first(study)
    once = prepare(case)
    assert is_drawn_as(sums(once.dataset), stored_draws()[case.key])
    truth = json.loads(json.dumps(once.truth, allow_nan=False))
    assert all(floors >= 3.0 for floors in truth["floors"].values())
    assert truth["sampling_um"] >= 0.0
    for s in once.records:
        assert np.isfinite(s.record.y_um).all()
        assert s.record.u_V.size == s.clean_um.size


def test_what_is_hidden_is_in_the_records():
    case = first("double")
    made = prepare(case)
    noise = np.concatenate([(s.record.y_um - s.clean_um) for s in made.records])
    assert np.std(noise) == pytest.approx(made.truth["noise_um"], rel=0.15)
    assert {h["effect"] for h in made.truth["hidden"]} == set(case.subject)


TRUTH = {
    "noise_um": 0.01, "sampling_um": 0.0, "rates_hz": [1e3], "outside": {}, "degraded": "", "protocol": "",
    "hidden": [{"effect": "creep", "form": ""}], "excused": ["delay"], "alike": {"creep": []}, "kinds": ["dahl"],
}  # fmt: skip
ROW = {
    "key": "", "code": "", "study": "kind", "subject": ["dahl"], "number": 0, "seed": 0, "status": "done",
    "noise_um": 0.01, "validation_um": 0.01, "seconds": 1.0, "verdict": "explained", "truth": TRUTH,
    "ranking": [{"effect": "creep"}], "true_left": {"clean_um": 0.0, "by_input_um": 0.0},
    "steps": [
        {"effect": "creep", "grade": "found"}, {"effect": "delay", "grade": "found"},
        {"effect": "backlash", "grade": "likely"},
    ],
    "core": {"kind": "stop", "alike": ["dahl"]},
}  # fmt: skip


def test_a_wrong_name_counts_by_its_grade_and_a_kind_among_its_alike():
    judged = judge_row(ROW)
    assert (judged["kind_right"], judged["found"]) == (True, True)
    assert (judged["wrong_found"], judged["additions"]) == (0, 1)


@over("remarked, noticed", [(["clock of run"], True), ([], False)])
def test_a_fault_of_a_clock_is_noticed_where_one_is_stated(remarked, noticed):
    fault = TRUTH | {"degraded": "lost buffer", "is_clock": True}
    judged = judge_row(ROW | {"study": "fault", "truth": fault, "remarked": remarked})
    assert (judged["is_clock"], judged["noticed"]) == (True, noticed)


def test_its_page_sets_the_figures_of_the_second_study_beside_its_own():
    second = ROW | {"study": "single", "subject": ["creep"], "steps": ROW["steps"][:2]}
    third = second | {"truth": TRUTH | {"kinds": []}, "steps": []}
    kind, fault = ROW, ROW | {"study": "fault", "subject": ["lost buffer"]}
    outside = third | {"study": "outside", "subject": ["footsteps"]}
    text = page([third, kind, fault, outside], [second, outside])
    assert "| single | the effect named | 95 % | 100.0 % (1 of 1) | 0.0 % (0 of 1) | no |" in text


def test_the_committed_page_is_that_of_the_committed_rows():
    rows, second = (named_rows(out / ROWS_FILE).rows for out in (OUT, FOREIGN.out))
    drawn = sorted(rows.values(), key=lambda r: (list(NUMBERS).index(r["study"]), r["number"]))
    text = page(drawn, list(second.values()))
    assert (OUT / "third_effects.md").read_text(encoding="utf-8") == text
