"""The study of portraits: its plants are fair, and a portrait that cannot tell is not right."""

import numpy as np

from rdpi_gym.diagnosis.portrait import Portrait, Value
from studies.portrait_plants import PROTOCOLS, SORTS, measured
from studies.portraits import answers, cases, main, report
from tests.looping import over

DRAWN = Portrait(
    "behind", {"behind": 1.0}, True, 1.0, (Value(0.3, 0.1),), "even", {"even": 1.0}, None, None, None,
    0.2, 0.1, "with memory, behind", (), "", (),
)  # fmt: skip


def test_sorts_and_protocols_take_turns():
    found = cases(2 * len(SORTS), 0)
    assert len({(case.sort, case.protocol) for case in found}) == len(SORTS) * len(PROTOCOLS)
    assert {sort.place for sort in SORTS.values()} == {"before", "in", "behind"}


@over("tau_s, near", [(0.5, True), (0.16, True), (0.61, False)])
def test_what_is_said_is_right_or_not(tau_s, near):
    sort = SORTS["output follows past u^2"]
    row = answers(DRAWN, sort, {"tau_s": tau_s, "second_tau_s": 9.0})
    assert (row["place"], row["memory"], row["parity"], row["time constant"]) == (True,) * 3 + (
        near,
    )
    assert not answers(None, sort, {"tau_s": tau_s})["place"]
    assert answers(DRAWN, SORTS["u times its rate"], {"tau_s": 1.0})["time constant"] is None


def test_an_effect_is_seen_and_the_records_are_those_of_its_seed():
    one, again = (measured("u times its rate", "bursts", 3, 0) for _ in range(2))
    assert one.floors > 4.0
    for a, b in zip(one.dataset.records, again.dataset.records, strict=True):
        np.testing.assert_array_equal(a.y_um, b.y_um)


def test_the_report_counts():
    row = {
        "status": "done", "sort": "drag", "before": 4.0, "after": 1.0, "tracking_before": 2.0,
        "tracking_after": 1.0, "predictable": 0.9, "place": True, "memory": True, "parity": False, "time constant": None,
        "said": "behind, no memory, odd",
    }  # fmt: skip
    text = report([row, {"status": "failed"}], 2, 1)
    assert "1 plants, seed 1; 1 failed." in text
    assert "| parity | 0 | 1 | 0 | 95 |" in text
    assert "1 behind, no memory, odd |" in text
    assert "0 plants have no portrait; of 1 portraits 1 tell a place, and it is right on 1." in text
    assert "| halved, by a learner | 1 | 1 | 100 | 100 |" in text
    little = report([row | {"predictable": 0.7, "before": 1.9}], 1, 1)
    assert "| halved, by a learner | 0 | 0 |  | 100 |" in little
    assert "| halved, over the noise | 0 | 0 |  | 100 |" in little
    assert "the error falls by a factor of 2.00" in text


def test_a_wrong_number_of_plants_is_refused(tmp_path, capsys):
    assert main(["--plants", "-1", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
