"""Texts stay letter for letter what they were, in V and µm."""

import json
import re
from dataclasses import replace

import pytest

from rdpi_gym import plan_experiment
from rdpi_gym.diagnosis import texts as table
from rdpi_gym.diagnosis import words
from rdpi_gym.diagnosis.comparison.compare import compare
from rdpi_gym.diagnosis.notices import RECORDS, Code, Notice
from rdpi_gym.measurement import Quantities, Quantity
from rdpi_gym.measurement.quantities import template_of
from rdpi_gym.plant import named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.report.comparison_page import write_compare_page
from rdpi_gym.support.errors import InputError
from tests.diagnosis.golden_texts import CHOSEN, FILE, datasets, texts
from tests.looping import over
from tests.unpacked import read_page

WANTED = json.loads(FILE.read_text(encoding="utf-8"))


def test_every_text_stays_as_it_was():
    rendered = texts()
    assert list(rendered) == list(WANTED)
    assert len(WANTED) >= 200
    assert {key: text for key, text in rendered.items() if text != WANTED[key]} == {}


AMPLIFIER = Quantities(Quantity("current", "I", "A"), Quantity("force", "F", "kN"))
FOREIGN = re.compile(
    r"µm|\bV\b|[vV]oltage|[dD]isplacement|A-shaped|current-driven|kN/V|put_unit|put}"
)


def test_a_force_over_a_current_is_told_in_their_words_and_units():
    told = texts(AMPLIFIER)
    assert list(told) == list(WANTED)
    text = json.dumps(list(told.values()), ensure_ascii=False)
    assert set(FOREIGN.findall(text)) <= {"V", "µm"}
    # what the text of a unit error names beside the user's own units
    assert not FOREIGN.search(text.replace("as between m, mm, µm and nm, or V and mV", ""))
    assert told["finding command rebuilt"][1].endswith(
        "rebuilt from the force, which tells the rest of the command to 0.12 A rms."
    )
    assert [len(told[key]) for key in told if isinstance(told[key], list)] == [
        len(WANTED[key]) for key in told if isinstance(told[key], list)
    ]


@over(
    "text, said",
    [
        ("A V-shaped valley at 3 V.", "A V-shaped valley at 3 A."),
        ("2 µm/V² and 1/µm at 5 V/s, 3 µm/√Hz", "2 kN/A² and 1/kN at 5 A/s, 3 kN/√Hz"),
        ("A voltage-driven stack loses voltage.", "A voltage-driven stack loses current."),
        ("The displacement's power (µm)", "The force's power (kN)"),
        ("u (V) in kV, 20 µF", "I (A) in kV, 20 µF"),
    ],
)
def test_what_is_no_unit_stays(text, said):
    assert AMPLIFIER.said(text) == said
    assert Quantities().said(text) == text


@over("name", CATALOGUE)
def test_what_the_catalogue_says_is_a_template_of_itself(name):
    for form in forms_of(CATALOGUE[name]):
        own = [form.signature, *(p.meaning for p in form.parameters)]
        units = [p.unit for p in form.parameters]
        assert [Quantities().fill(template_of(text)) for text in own] == own
        assert [Quantities().unit(unit) for unit in units] == units
        turned = " ".join([*map(AMPLIFIER.unit, units), *map(AMPLIFIER.said, own)])
        assert not re.search(r"A-shaped|current-driven|kN/V|µm|[dD]isplacement", turned)


@over("quantities", [Quantities(), AMPLIFIER])
def test_a_page_is_told_in_the_users_units_and_names_stay(tmp_path, quantities):
    own = "3 µm over {u} voltage"
    data = datasets(quantities)["fading"]
    data = replace(data, title=own, records=(replace(data.records[0], name=own), data.records[1]))
    page = write_compare_page(tmp_path / "page.html", compare(data, named_plant("P5")))
    text = read_page(page)
    assert f"RMSE ({quantities.output.unit})" in text
    assert own in text
    library = r'<script( type="text/plain" id="plotly")?>.*?</script>'
    shown = re.sub(rf"{library}|<style>.*?</style>", "", text, flags=re.DOTALL)
    shown = re.sub(r'"bdata": ?"[^"]*"', "", shown).replace("\\u00b5", "µ").replace(own, "")
    assert "put_unit" not in shown
    assert "put}" not in shown
    assert quantities.are_standard or FOREIGN.findall(shown) == []


def experiments():
    """What is chosen for each limit, reservation and finding, with the records to play."""
    return {
        key: text[-1]
        for key, text in texts(parts=CHOSEN).items()
        if key.startswith(("experiment", "again", "kinds", "creep", "standard", "reservation s"))
    }


def test_other_words_change_no_experiment(monkeypatch):
    own = experiments()
    assert sum(map(bool, own.values())) > 20
    monkeypatch.setattr(table, "NOTICES", dict.fromkeys(Code, "Four words, reworded: nothing."))
    monkeypatch.setattr(table, "REQUESTS", dict.fromkeys(table.REQUESTS, ("More", "less")))
    assert texts(parts=CHOSEN)["standard protocol"][0] == "Four words, reworded: nothing."
    assert experiments() == own


def test_other_words_change_no_planned_command(monkeypatch):
    data = datasets()["50 Hz"]
    asked = [Notice(code, ("rdpi", "stop")) for code in RECORDS]
    asked += [Notice(Code.FASTER), Notice(Code.EFFECTS_APART, ("stairs", "creep", "delay"))]
    own = [plan_experiment(each, data, "P5") for each in asked]
    monkeypatch.setattr(table, "NOTICES", dict.fromkeys(Code, "Other words."))
    for each, before in zip(asked, own, strict=True):
        planned = plan_experiment(each, data, "P5")
        assert (planned.title, planned.advice) == (before.title, "Other words.")
        assert (planned.u_V == before.u_V).all()


@over("code", Code)
def test_a_notice_is_the_same_in_a_file_and_its_text_is_known_without_one(code):
    notice = Notice(code, ("stairs", "creep", "delay"), (1.0, 2.0, 3.0, 4.0))
    assert Notice.from_dict(json.loads(json.dumps(notice.to_dict()))) == notice
    fixed = words.notice_of(words.text_of(notice))
    assert fixed is None or fixed.code is code
    assert (fixed is None) == ("{" in table.NOTICES[code])


def test_a_code_that_nobody_knows_is_one_line():
    with pytest.raises(
        InputError, match="file: code is 'moon'; expected one of 'no record moves', "
    ):
        Notice.from_dict({"code": "moon"}, "file")
