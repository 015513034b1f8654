"""Records that an advice asks for are made, and sets that shrink by half are counted."""

from rdpi_gym.diagnosis.notices import RECORDS, Code, Notice
from rdpi_gym.diagnosis.search.separability import _LIFTS
from rdpi_gym.signals.experiments import standard_protocol
from studies.advised_experiment import GIVEN, report


def row(before, after, hidden="creep"):
    told = [
        None if names is None else {"probable": names, "added": names[:1]}
        for names in (before, after)
    ]
    return {"status": "done", "hidden": hidden, "before": told[0], "after": told[1]}  # fmt: skip


def test_every_record_that_is_given_or_asked_for_is_of_the_protocol():
    known = {experiment.name for experiment in standard_protocol(0.0, 30.0, 1.0)}
    assert {name for pair in GIVEN for name in pair} <= known
    assert {name for records in RECORDS.values() for name in records} <= known


def test_every_advice_on_limits_but_a_longer_record_names_records():
    assert [code for code in _LIFTS.values() if not Notice(code).records] == [Code.LONGER]


def test_the_table_counts_sets_that_shrink_by_half():
    rows = [
        row(["creep", "delay", "backlash"], ["creep"]),  # by half and more
        row(["delay", "creep"], ["delay", "creep"]),  # not at all
        row(["creep"], ["creep"]),  # nothing was open
        row(["creep", "delay"], None),  # no experiment
    ]
    text = report(rows, 4, 0)
    assert "3 leave more than one effect probable; for 2 of them" in text
    assert "in 1 of 2 (asked: 80 %)" in text
