"""Diagnosis as a benchmark: bad input first, the scores' laws, a diagnoser of one's own to its table."""

import math
from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym.cli as cli
from benchmarks.diagnosis import run
from benchmarks.diagnosis.answers import Answer, checked_answer, checked_prediction
from benchmarks.diagnosis.draws import drawn_cases
from benchmarks.diagnosis.entries import ENTRIES, most_frequent
from benchmarks.diagnosis.scoring import (
    LEAST,
    UNINFORMED,
    Outcomes,
    blank,
    explained,
    losses,
    mean_square,
    outcomes_of,
    withheld,
)
from benchmarks.effect_discovery.cases import Case, Prepared
from benchmarks.effect_discovery.independent import INDEPENDENT
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from tests.looping import over

OWN = """
import numpy as np
from benchmarks.diagnosis.answers import Answer

def sure(dataset):
    assert all(r.role != "validation" for r in dataset.records)
    return Answer({"creep": 1.0}, 0.0, lambda record: 2.0 * record.u_V)

def broken(dataset):
    raise ValueError("no idea")

def wrong(dataset):
    return {"creep": 1.0}

def curious(dataset):
    import gc
    assert not any(type(each).__name__ == "Case" for each in gc.get_objects())
    return sure(dataset)

one = 1
"""


def record(name="run", role="train", samples=400):
    t = np.arange(samples) * 1e-3
    u = 10.0 * np.sin(20.0 * t) + 3.0 * np.sin(90.0 * t)
    return Record(name, t, u, 2.0 * u + 0.3 * np.sin(5.0 * t), ts_s=1e-3, role=role)


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_diagnosers.py").write_text(OWN)
    return tmp_path


@pytest.fixture
def one_plant(monkeypatch):
    """A plant that needs no simulation of the studies."""
    data = Dataset("a plant", (record(), record("check", "validation")))
    truth = {"noise_um": 0.01, "alike": {"creep": ["gain_drift"]}, "excused": ["delay"]}
    source = replace(INDEPENDENT, prepare=lambda case: Prepared(data, truth))
    cases = ((source, Case("single", ("creep",), 0)), (source, Case("none", (), 1)))
    monkeypatch.setattr(run, "drawn_cases", lambda seed: cases)


@over(
    "words, said",
    [
        (["nothing"], "'nothing' is no suite; give diagnosis, or leave it out"),
        (["--diagnoser", "laboratory"], "--diagnoser is of rdpi bench diagnosis"),
        (["diagnosis", "--controllers", "none"], "--controllers is not for rdpi bench diagnosis"),
        (["diagnosis", "--task", "Stage"], "--task is not for rdpi bench diagnosis"),
        (["diagnosis", "--draws", "100000"], "--draws is 100000; give 1 to 1775 plants"),
        (["diagnosis", "--diagnoser", "labratory"], "no diagnoser is named 'labratory'"),
        (["diagnosis", "--diagnoser", "nowhere:a"], "module 'nowhere' of 'nowhere:a' cannot be imported"),
        (["diagnosis", "--diagnoser", "my_diagnosers:none"], "has no 'none'"),
        (["diagnosis", "--diagnoser", "my_diagnosers:one"], "'my_diagnosers:one' is no callable"),
        (["diagnosis", "--seed-file", "seed.txt"], "seed.txt"),
    ],
)  # fmt: skip
def test_bad_words_are_one_line(own, capsys, words, said):
    assert cli.main(["bench", *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line


@over(
    "answer, said",
    [
        ({"creep": 1.0}, "not dict"),
        (Answer({"crep": 0.5}, 0.0, np.sin), "effects: 'crep' is unknown"),
        (Answer({"creep": 1.5}, 0.0, np.sin), "the probability of creep is 1.5"),
        (Answer({"creep": math.nan}, 0.0, np.sin), "the probability of creep is nan"),
        (Answer({}, -0.1, np.sin), "the probability of other is -0.1"),
        (Answer({}, 0.0, None), "predict of the answer is no function"),
    ],
)
def test_an_answer_that_is_none_says_what_would_be_right(answer, said):
    with pytest.raises(InputError, match=said):
        checked_answer(answer)


@over("predict", [lambda r: r.u_V[:-1], lambda r: r.u_V * math.nan, lambda r: 1.0])
def test_a_prediction_is_one_finite_number_a_sample(predict):
    with pytest.raises(InputError, match="one finite number for each of the 400 samples"):
        checked_prediction(Answer({}, 0.0, predict), record())


def test_the_loss_is_proper_and_a_class_is_one_outcome():
    true = Outcomes((frozenset(("delay", "sensor_lag")),), frozenset(("creep",)), False)
    sure = losses(Answer({"sensor_lag": 1.0}, 0.0, np.sin), true)
    assert sure["log_loss"] == pytest.approx(-3.0 * math.log(1.0 - LEAST))
    assert (sure["found"], sure["false_names"], sure["brier"]) == (1, 0, 0.0)
    half = losses(Answer({"delay": 0.5, "creep": 0.5}, 0.5, np.sin), true)
    assert half["log_loss"] == pytest.approx(3.0 * math.log(2.0))
    assert half["false_names"] == 1
    # of all forecasts of an outcome that comes in three of ten cases, 0.3 has the least loss
    there, gone = (Outcomes(x, y, False) for x, y in ((true.there, frozenset()), ((), frozenset(("delay",)))))  # fmt: skip

    def mean(p, score):
        parts = (losses(Answer({"delay": p}, 0.0, np.sin), true)[score] for true in (there, gone))
        return np.dot([0.3, 0.7], list(parts))

    for score in ("log_loss", "brier"):
        assert min((0.1, 0.2, 0.3, 0.4, 0.9), key=lambda p: mean(p, score)) == 0.3
    everything = Outcomes((), frozenset(CATALOGUE), False)
    unsure = losses(Answer(dict.fromkeys(CATALOGUE, 0.5), 0.5, np.sin), everything)
    assert unsure["log_loss"] == pytest.approx(UNINFORMED)


def test_what_is_true_of_a_case():
    truth = {"alike": {"creep": ["gain_drift"]}, "excused": ["delay"]}
    true = outcomes_of(Case("single", ("creep",), 0), truth)
    assert true.there == (frozenset(("creep", "gain_drift")),)
    assert not true.absent & {"creep", "gain_drift", "delay"}
    assert not true.other
    outside = outcomes_of(Case("outside", ("duhem",), 0), {})
    assert (outside.there, outside.absent, outside.other) == ((), frozenset(CATALOGUE), True)


def test_the_validation_records_or_a_last_quarter_are_withheld():
    whole = Dataset("", (record(), record("check", "validation")))
    given, asked = withheld(whole)
    assert ([r.name for r in given.records], [r.name for r in asked]) == (["run"], ["check"])
    given, (last,) = withheld(Dataset("", (record(), record("short", samples=100))))
    assert [r.t_s.size for r in given.records] == [300, 100]
    assert (last.t_s.size, last.before_V.size) == (100, 300)
    assert not blank(last).y_um.any()


def test_the_share_explained_is_that_between_base_model_and_noise():
    assert explained(1.01, 0.51, 0.1) == pytest.approx(0.5)
    assert explained(1.01, 3.0, 0.1) == 0.0
    assert explained(0.0101, 0.01, 0.1) is None
    r = record()
    assert mean_square(Answer({}, 0.0, lambda _: r.y_um + 7.0), [r]) == pytest.approx(0.0)


def test_any_beginning_of_the_plants_is_a_fair_sample_and_the_frequencies_are_theirs():
    cases = drawn_cases(2026)
    assert len({(source.module, case.key) for source, case in cases}) == len(cases) == 1775
    assert [c.subject for _, c in drawn_cases(1)] == [c.subject for _, c in cases]
    answer = checked_answer(most_frequent(Dataset("", (record(),))))
    true = sum("creep" in case.subject for _, case in cases) / len(cases)
    assert answer.effects["creep"] == pytest.approx(true)
    early = sum("creep" in case.subject for _, case in cases[:400]) / 400
    assert early == pytest.approx(true, abs=0.05)


def test_a_diagnoser_of_ones_own_gets_a_row_a_plant_and_one_that_fails_says_why(
    own, one_plant, capsys
):
    words = ["bench", "diagnosis", "--draws", "2", "--jobs", "1", "--out", "out"]
    names = ["my_diagnosers:sure", "my_diagnosers:broken", "my_diagnosers:wrong"]
    for name in names:
        words += ["--diagnoser", name]
    assert cli.main([*words, "--diagnoser", "residual-correlation"]) == 2
    said = capsys.readouterr()
    assert "my_diagnosers:broken has no score on any plant" in said.err
    assert "8 rows, 8 of them computed now" in said.out
    rows = run.DIAGNOSES.open(own / "out").rows
    first, second = (rows["my_diagnosers:sure", "public seed 2026", k] for k in range(2))
    assert (first["found"], first["false_names"], second["false_names"]) == (1, 0, 1)
    broken = rows["my_diagnosers:broken", "public seed 2026", 0]
    assert (broken["failure"], broken["log_loss"]) == ("ValueError: no idea", UNINFORMED)
    assert "not dict" in rows["my_diagnosers:wrong", "public seed 2026", 0]["failure"]
    page = (own / "out" / "diagnosis.md").read_text()
    assert "| my_diagnosers:sure | 2 |" in page
    # what is there is not computed again, and a private seed is named by a hash
    assert cli.main(words[:10]) == 0
    assert "2 rows, 0 of them computed now" in capsys.readouterr().out
    (own / "seed.txt").write_text("12345678901234567890")
    words = [*words[:8], "--draws", "1", "--seed-file", "seed.txt"]
    # with a private seed it runs in a process that is told the records alone
    assert cli.main([*words, "--diagnoser", "my_diagnosers:curious"]) == 0
    (row,) = (
        row for row in run.DIAGNOSES.open(own / "out").rows.values() if "private" in row["draws"]
    )
    assert (row["failure"], row["found"]) == ("", 1)
    assert "private seed" in (own / "out" / "diagnosis.md").read_text()
    assert "12345678901234567890" not in (own / "out" / run.DIAGNOSES.file).read_text()


def test_the_entries_that_ship_are_known():
    assert list(ENTRIES) == ["laboratory", "most-frequent", "residual-correlation", "e-sindy"]
