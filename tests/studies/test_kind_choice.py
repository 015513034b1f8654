"""The study of kinds of hysteresis: its plants, one row, its table."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.identification import kinds
from rdpi_gym.plant import CORES
from rdpi_gym.plant.effects import CATALOGUE
from studies import kind_choice

RESULT = Path(kind_choice.RESULTS) / "kind_choice.md"


def test_every_kind_is_drawn_bare_and_with_an_effect_by_both_protocols():
    found = kind_choice.cases(4, 0)
    assert len(found) == 8 * len(CORES)
    assert {case.kind for case in found} == set(CORES)
    assert sum(case.effect == "" for case in found) == len(found) // 2
    assert {case.protocol for case in found if case.kind == "stop"} == set(kind_choice.PROTOCOLS)
    assert len({case.key for case in found}) == len(found)


def test_a_plant_is_drawn_again_by_its_seed_and_another_by_another():
    case = kind_choice.Case("bouc_wen", "creep", kind_choice.PROTOCOLS[1], 2, 7)
    plants = [kind_choice.drawn(each)[0] for each in (case, case)]
    assert plants[0] == plants[1]
    other, data = kind_choice.drawn(kind_choice.Case(*(*vars(case).values(),)[:-1], 8))
    assert other != plants[0]
    assert [effect.name for effect in other.effects] == ["creep"]
    assert all(np.isfinite(record.y_um).all() for record in data.records)
    assert len(data.validation) == 1


def test_a_row_says_what_was_chosen_and_the_table_counts_it(monkeypatch):
    few = {name: CORES[name] for name in ("rdpi", "stop", "duhem")}  # three stand for ten
    monkeypatch.setattr(kinds, "CORES", few)
    row = kind_choice.run_case(kind_choice.Case("stop", "", kind_choice.PROTOCOLS[1], 0, 0), "code")
    assert row["status"] == "done"
    assert row["right"]
    text = kind_choice.report([row, row | {"right": False, "sure": True, "chosen": "dahl"}], 1, 0)
    assert "in 1 of 2 (50 %); a wrong kind is named alone in 1." in text
    assert RESULT.read_text(encoding="utf-8").startswith("# Which kind of hysteresis?")


def search_of(effects, data, catalogue=None, **asked):
    return discover(data, catalogue=effects if catalogue is None else catalogue, **asked)


def test_a_search_prefers_no_other_core_where_rdpi_is_right(monkeypatch):
    one = {"creep": CATALOGUE["creep"]}  # stands for fifteen
    monkeypatch.setattr(kind_choice, "discover", partial(search_of, one))
    case = kind_choice.quiet_cases(2, 0)[1]
    assert (case.kind, case.effect, case.protocol) == ("rdpi", "", kind_choice.PROTOCOLS[1])
    row = kind_choice.run_quiet(case, "code")
    assert (row["status"], row["chosen"], row["told"]) == ("done", "rdpi", "rdpi")
    text = kind_choice.silence_report([row, row | {"chosen": "duhem", "told": "duhem"}], 1)
    assert "No other core is preferred on 1 of 2 plants" in text
    assert "names RDPI on 1, and lists it among those that it does not tell apart on 1." in text
