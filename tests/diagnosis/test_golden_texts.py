"""Texts stay letter for letter what they were, in V and µm."""

import json

import pytest

from rdpi_gym import plan_experiment
from rdpi_gym.diagnosis import words
from rdpi_gym.diagnosis.notices import RECORDS, Code, Notice
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fields import Fields
from tests.diagnosis.golden_texts import FILE, datasets, texts

WANTED = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rendered():
    return texts()


def test_every_text_is_there(rendered):
    assert list(rendered) == list(WANTED)
    assert len(WANTED) >= 200


@pytest.mark.parametrize("key", WANTED)
def test_a_text_stays_as_it_was(rendered, key):
    assert rendered[key] == WANTED[key]


def experiments():
    """What is chosen for each limit, reservation and finding, with the records to play."""
    return {
        key: text[-1]
        for key, text in texts().items()
        if key.startswith(("experiment", "again", "kinds", "creep", "standard", "reservation s"))
    }


def test_other_words_change_no_experiment(rendered, monkeypatch):
    own = experiments()
    assert sum(map(bool, own.values())) > 20
    monkeypatch.setattr(words, "_TEXTS", dict.fromkeys(Code, "Four words, reworded: nothing."))
    monkeypatch.setattr(words, "_REQUESTS", dict.fromkeys(words._REQUESTS, ("More", "less")))
    assert texts()["standard protocol"][0] == "Four words, reworded: nothing."
    assert experiments() == own


def test_other_words_change_no_planned_command(monkeypatch):
    data = datasets()["50 Hz"]
    asked = [Notice(code, ("rdpi", "stop")) for code in RECORDS]
    asked += [Notice(Code.FASTER), Notice(Code.EFFECTS_APART, ("stairs", "creep", "delay"))]
    own = [plan_experiment(each, data, "P5") for each in asked]
    monkeypatch.setattr(words, "_TEXTS", dict.fromkeys(Code, "Other words."))
    for each, before in zip(asked, own, strict=True):
        planned = plan_experiment(each, data, "P5")
        assert (planned.title, planned.advice) == (before.title, "Other words.")
        assert (planned.u_V == before.u_V).all()


@pytest.mark.parametrize("code", Code)
def test_a_notice_is_the_same_in_a_file_and_its_text_is_known_without_one(code):
    notice = Notice(code, ("stairs", "creep", "delay"), (1.0, 2.0, 3.0, 4.0))
    assert Notice.from_fields(Fields(json.loads(json.dumps(notice.to_dict())), "file")) == notice
    fixed = words.notice_of(words.text_of(notice))
    assert fixed is None or fixed.code is code
    assert (fixed is None) == ("{" in words._TEXTS[code])


def test_a_code_that_nobody_knows_is_one_line():
    with pytest.raises(InputError, match="file: the code 'moon' is unknown"):
        Notice.from_fields(Fields({"code": "moon"}, "file"))
