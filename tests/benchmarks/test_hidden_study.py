"""The study: what counts as found, resuming, and the tables, with engines of which all is known."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.hidden_effects import __main__ as hidden_effects
from benchmarks.hidden_effects import case_row
from benchmarks.hidden_effects import run as run_module
from benchmarks.hidden_effects.case_row import found as found_of
from benchmarks.hidden_effects.case_row import run_case
from benchmarks.hidden_effects.cases import NUMBERS, Case, make_cases, prepare
from benchmarks.hidden_effects.run import run_study
from benchmarks.hidden_effects.scoring import judge, judgements
from benchmarks.hidden_effects.summary import agreement, as_markdown, by_subject, targets
from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult, steps_of
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fingerprint import statements
from rdpi_gym.support.store import named_rows
from rdpi_gym.virtual_lab.draws import HIDEABLE, MaskedError


def candidate(effect, error_um=0.013, indistinguishable=()):
    errors = Errors(error_um, error_um, 0.03, {})
    return Candidate(
        effect, errors, {"size": 1.0}, {"size": None}, 0.99, 0.9, indistinguishable, ""
    )


def discovery(steps, verdict="explained", excess_um=0.0, ranking=None, floor_um=0.012):
    base = Errors(0.4, 0.4, 1.0, {})
    ranking = steps if ranking is None else ranking
    return SearchResult(
        kind="discovery", title="", plant=P10, steps=steps_of(steps),
        rounds=(tuple(ranking),) if ranking else (), removed=(), noise_floor_um=floor_um, noise_origin="",
        numerical_floor_um=0.0, base=base, final=base, given=None, verdict=verdict, sampling=None,
        undecided=None, unexplained_rmse_um=excess_um, remainder="", next_experiment=None,
        indistinguishable=(), findings=(), limits=(), checks=(), views=(), seconds=1.0,
    )  # fmt: skip


def row(subject, steps, *, study="single", noise_um=0.012, number=0, variant="plain", **found):
    case = Case(study, tuple(subject), number, variant=variant)
    result = found_of(discovery([candidate(s) if isinstance(s, str) else s for s in steps], **found))  # fmt: skip
    head = {
        "key": case.key, "study": study, "subject": list(subject), "number": number, "seed": 0,
        "variant": variant, "code": "abc", "status": "done", "noise_um": noise_um, "seconds": 2.0,
        "truth": {"hidden": [{"effect": s} for s in subject]},
    }  # fmt: skip
    return head | result


@pytest.fixture
def quick(monkeypatch):
    """Replace the simulation by a record that holds nothing but the name of the case."""
    t = np.arange(40) * 1e-3
    dataset = Dataset("", (Record("r", t, np.sin(t), np.sin(t), ts_s=1e-3),))

    def prepared(case):
        if case.subject == ("mains_hum",):
            raise MaskedError("mains_hum cannot be seen")
        document = {"hidden": [{"effect": name} for name in case.subject], "noise_um": 0.012}
        titled = Dataset("+".join(case.subject), dataset.records)
        return titled, document

    monkeypatch.setattr(case_row, "prepare", prepared)


def oracle(dataset, seed):
    names = [name for name in dataset.title.split("+") if name]
    return discovery(
        [candidate(name) for name in names], "explained" if names else "no missing effect"
    )


def creep_fan(dataset, seed):
    if dataset.title == "delay":
        raise ValueError("no idea")
    return discovery([candidate("creep")])


def test_the_standard_study_asks_what_the_targets_need():
    assert len(make_cases(["single"])) == len(HIDEABLE) * 20
    pairs = make_cases(["pairs"])
    possible = math.comb(len(HIDEABLE), 2)
    assert len(pairs) == possible * 3
    assert len({case.subject for case in pairs}) == possible
    assert len(make_cases(["none"])) == 100
    variants = {case.variant for case in make_cases(["invariance"])}
    assert variants == {
        "order shuffled", "sampling time halved", "other units", "sign reversed",
    }  # fmt: skip
    everything = make_cases(list(NUMBERS))
    assert len({case.key for case in everything}) == len(everything)
    # plant by plant, so that what an interrupted run has done is a fair sample
    assert [case.number for case in make_cases(["single"])] == sorted(
        list(range(20)) * len(HIDEABLE)
    )


def test_a_case_is_the_same_draw_in_every_study_and_variant():
    single, truth = prepare(Case("single", ("gain_drift",), 1))
    shuffled, again = prepare(Case("invariance", ("gain_drift",), 1, variant="order shuffled"))
    halved, fine = prepare(Case("invariance", ("gain_drift",), 1, variant="sampling time halved"))
    _, different = prepare(Case("single", ("gain_drift",), 2))
    assert truth == again
    assert truth["hidden"] == fine["hidden"] != different["hidden"]
    assert fine["ts_factor"] == 0.5
    by_name = {r.name: r for r in shuffled.records}
    assert all(np.array_equal(r.y_um, by_name[r.name].y_um) for r in single.records)
    assert halved.records[0].ts_s == 0.5 * single.records[0].ts_s


def test_what_counts_as_found():
    right = judge(row(["creep"], ["creep"]))
    assert right["first_right"]
    assert right["found"]
    assert right["additions"] == 0
    assert right["ratio"] == pytest.approx(1.0)
    wrong = judge(row(["creep"], ["delay"], excess_um=0.012))
    assert not wrong["first_right"]
    assert not wrong["found"]
    assert wrong["additions"] == 1
    assert wrong["ratio"] == pytest.approx(math.sqrt(2))
    assert not wrong["within"]
    third = judge(row(["creep", "delay"], ["delay", "creep", "backlash"], study="pairs"))
    assert third["found"]
    assert third["additions"] == 1
    half = judge(row(["creep", "delay"], ["delay"], study="pairs"))
    assert not half["found"]
    assert half["additions"] == 0


def test_a_rival_counts_only_where_documented_and_declared():
    pair = frozenset({frozenset({"delay", "sensor_lag"})})
    named = candidate("sensor_lag", indistinguishable=("delay",))
    unnamed = candidate("sensor_lag")
    assert judge(row(["delay"], [named]), pair)["found"]
    assert judge(row(["delay"], [named]), pair)["by_class"]
    assert not judge(row(["delay"], [named]), frozenset())["found"]
    assert not judge(row(["delay"], [unnamed]), pair)["found"]
    # the effect itself and its double: the double is an addition
    both = judge(row(["delay"], [named, "delay"]), pair)
    assert both["found"]
    assert both["additions"] == 1


def test_targets_are_counted_over_their_studies():
    rows = [
        row(["creep"], ["creep"], number=0),
        row(["creep"], ["delay"], number=1, excess_um=0.1, verdict="unexplained"),
        row([], [], study="none", verdict="no missing effect"),
        row([], ["delay"], study="none", number=1),
        row(["force"], [], study="outside", verdict="unexplained", excess_um=0.1),
        row(["force"], ["creep"], study="outside", number=1, excess_um=0.1),
        row(["creep"], ["creep"], study="invariance", variant="sign reversed"),
        row([], ["creep"], study="invariance", variant="sign reversed"),
    ]
    found = {(t.study, t.asks): t for t in targets(rows)}
    counts = [(t.reached, t.cases, t.is_met) for t in found.values()]
    assert counts[:2] == [(1, 2, False), (1, 2, False)]
    assert (found["none", "`no missing effect`"].reached, counts[2][1]) == (1, 2)
    assert counts[3] == (1, 2, False)
    outside = next(t for t in found.values() if t.study == "outside")
    assert (outside.false_additions, outside.falsely_added_to) == (1, 1)
    assert outside.falsely_added == "1 on 1 of 2"
    changed = {t.study: (t.reached, t.cases) for t in found.values() if "sign" in t.study}
    assert changed == {"single, sign reversed": (1, 1), "none, sign reversed": (0, 1)}


def test_agreement_is_with_the_same_draw():
    rows = [
        row(["creep"], ["creep"], number=0),
        row(["creep"], ["creep"], number=0, study="invariance", variant="sign reversed"),
        row(["creep"], ["delay"], number=1),
        row(["creep"], ["creep"], number=1, study="invariance", variant="sign reversed", excess_um=0.009),
        row(["creep"], ["creep"], number=2, study="invariance", variant="sign reversed"),
    ]  # fmt: skip
    line = agreement(rows).iloc[0]
    assert (line["cases"], line["same_verdict"], line["same_steps"]) == (2, 2, 1)
    assert line["largest_change_percent"] == pytest.approx(25.0)


def test_masked_and_failed_cases_are_told_apart(quick, tmp_path):
    cases = make_cases(["single"], plants=1, effects=["creep", "delay", "mains_hum"])
    rows = run_study(cases, tmp_path, engine=creep_fan)
    assert [r["status"] for r in rows] == ["done", "failed", "masked"]
    assert rows[1]["error"] == "ValueError: no idea"
    assert len(judgements(rows)) == 2
    table = by_subject(rows).set_index("subject")
    assert table.loc["delay", "failed"] == 1
    assert table.loc["delay", "first_percent"] == 0.0
    text = as_markdown(rows)
    assert "| single | the right effect ranked first | 97 % | 50.0 % (1 of 2) | no |" in text
    assert "No draw shows, beside noise or each other: mains_hum." in text


def test_an_interrupted_study_continues(quick, tmp_path):
    cases = make_cases(["single"], plants=2, effects=["creep", "delay"])
    seen = []

    def interrupted(dataset, seed):
        if len(seen) == 2:
            raise KeyboardInterrupt
        seen.append(dataset.title)
        return oracle(dataset, seed)

    with pytest.raises(KeyboardInterrupt):
        run_study(cases, tmp_path, engine=interrupted)
    with (tmp_path / "rows.jsonl").open("a") as stream:
        stream.write('{"key": "single/cre')  # torn
    again = []

    def counted(dataset, seed):
        again.append(dataset.title)
        return oracle(dataset, seed)

    done = []
    rows = run_study(cases, tmp_path, progress=lambda stage, *n: done.append(n), engine=counted)
    assert seen == again == ["creep", "delay"]
    assert done == [(2, 4), (3, 4), (4, 4)]
    assert [r["key"] for r in rows] == [case.key for case in cases]
    assert len(named_rows(tmp_path / "rows.jsonl").rows) == 4


def test_rows_of_changed_code_are_set_aside(quick, tmp_path, monkeypatch):
    cases = make_cases(["none"], plants=2)
    run_study(cases, tmp_path, engine=oracle)
    monkeypatch.setattr(run_module, "study_fingerprint", lambda: "changed")
    again, said = [], []
    run_study(
        cases, tmp_path, engine=lambda d, s: again.append(1) or oracle(d, s), note=said.append
    )
    assert len(again) == 2
    assert said == [
        f"rows of code that has changed since were set aside in {tmp_path / 'rows-stale-1.jsonl'}"
    ]
    assert len((tmp_path / "rows-stale-1.jsonl").read_text().splitlines()) == 3


def test_the_fingerprint_sees_statements_and_no_words():
    assert statements("def f():\n    'one'\n    return 1") == statements("def f(): return 1  # x")
    assert statements("def f(): return 1") != statements("def f(): return 2")


def test_a_foreign_file_is_no_store(tmp_path):
    (tmp_path / "rows.jsonl").write_text('{"format": "rdpi-bench-rows", "version": 1}\n')
    with pytest.raises(InputError, match="not a file of rows that this release wrote"):
        named_rows(tmp_path / "rows.jsonl")


def test_a_row_is_json_that_says_what_was_found():
    found = run_case(
        Case("single", ("gain_drift",), 0), lambda d, s: discovery([candidate("creep")])
    )
    found = json.loads(json.dumps(found, allow_nan=False))
    assert found["truth"]["hidden"][0]["effect"] == "gain_drift"
    assert found["ranking"][0]["effect"] == "creep"
    assert found["steps"][0]["parameters"] == {"size": 1.0}
    assert found["status"] == "done"


def test_the_command_writes_tables_and_prints_targets(quick, tmp_path, capsys):
    words = ["--study", "single,none", "--plants", "1", "--jobs", "1", "--out", str(tmp_path)]
    assert hidden_effects.main(words, engine=oracle) == 0
    printed = capsys.readouterr().out.splitlines()
    known = len(HIDEABLE) - 1  # the oracle here knows no hum
    assert (
        printed[0]
        == f"single: the right effect ranked first: 100.0 % ({known} of {known}), asked 97 %: met; "
        "effects falsely added: 0"
    )
    assert printed[-1] == f"tables: {tmp_path / 'hidden_effects.md'}"
    assert len(pd.read_csv(tmp_path / "cases.csv")) == known + 1
    assert set(pd.read_csv(tmp_path / "by_subject.csv")["subject"]) == {
        "nothing", *(name for name in HIDEABLE if name != "mains_hum"),
    }  # fmt: skip


def test_tables_alone_are_written_without_a_run(quick, tmp_path):
    words = ["--study", "single,none", "--plants", "1", "--jobs", "1", "--out", str(tmp_path)]
    assert hidden_effects.main(words, engine=oracle) == 0
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.suffix in (".md", ".csv")}
    for name in before:
        (tmp_path / name).unlink()

    def never(*arguments):
        raise AssertionError("the study was run")

    assert hidden_effects.main([*words, "--tables"], engine=never) == 0
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


def test_tables_of_no_rows_are_refused(tmp_path, capsys):
    assert hidden_effects.main(["--tables", "--out", str(tmp_path)], engine=oracle) == 2
    assert "has no row of these cases" in capsys.readouterr().err


def test_committed_tables_are_those_of_the_committed_rows(tmp_path):
    committed = Path(hidden_effects.__file__).parents[2] / "studies" / "results" / "hidden"
    shutil.copy(committed / "rows.jsonl", tmp_path)
    assert hidden_effects.main(["--tables", "--out", str(tmp_path)], engine=oracle) == 0
    for name in ("hidden_effects.md", "by_subject.csv", "cases.csv"):
        assert (tmp_path / name).read_bytes() == (committed / name).read_bytes(), name


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--study", "singel"], "did you mean 'single'"),
        (["--effects", "crep"], "did you mean 'creep'"),
        (["--plants", "0"], "--plants is 0"),
        (["--jobs", "0"], "--jobs is 0"),
        (["--seed", "-1"], "--seed is -1"),
    ],
)
def test_bad_words_are_one_line_and_status_2(words, said, tmp_path, capsys):
    out = tmp_path / "out"
    assert hidden_effects.main([*words, "--out", str(out)], engine=oracle) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_file_is_no_folder(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert hidden_effects.main(["--out", str(tmp_path / "taken")], engine=oracle) == 2
    assert "is a file" in capsys.readouterr().err
