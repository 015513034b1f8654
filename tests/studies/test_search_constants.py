"""Constants of the search, halved and doubled: values, their scope, and the table."""

import pytest

from rdpi_gym.diagnosis.beam import decision, moves
from rdpi_gym.diagnosis.beam.constants import FOUND, LEVEL, TABLE
from studies.search_constants import AS_IT_IS, changed, scaled, table, trials

BY_NAME = {constant.name: constant for constant in TABLE}


def test_counts_stay_whole_and_probabilities_below_one():
    assert (scaled(BY_NAME["BEAM"], 0.5), scaled(BY_NAME["PASSES"], 0.5)) == (2, 8)
    assert scaled(BY_NAME["LEVEL"], 2.0) == pytest.approx(0.1)
    assert scaled(BY_NAME["FOUND"], 2.0) == pytest.approx(18.0 / 19.0)
    assert FOUND == 0.9


def test_a_constant_is_changed_where_it_is_read_and_for_a_while():
    with changed("LEVEL", 0.2):
        assert moves.LEVEL == 0.2
    assert moves.LEVEL == LEVEL
    with changed("TEMPERATURE", 1.0):
        assert decision.TEMPERATURE == 1.0


def test_every_constant_is_halved_and_doubled_on_the_same_plants():
    asked = trials(5, 0)
    of = {(trial.name, trial.factor) for trial in asked}
    assert len(of) == 1 + 2 * len(TABLE)
    assert len(asked) == len(of) * sum(trial.name == AS_IT_IS for trial in asked)
    assert len({trial.key for trial in asked}) == len(asked)


def row(constant, named, seconds):
    return {
        "key": f"{constant} x 2/beam/single/creep", "constant": constant, "factor": 2.0, "status": "done",
        "engine": "beam", "stratum": "single", "study": "single", "subject": ["creep"], "number": 0,
        "seed": 0, "truth": {}, "noise_um": 0.01, "validation_um": 0.01, "seconds": seconds,
        "ranking": [], "steps": [{"effect": name, "grade": "found"} for name in named],
    }  # fmt: skip


def test_the_table_has_other_names_and_the_ratio_of_times():
    lines = table([row(AS_IT_IS, ["creep"], 4.0), row("BEAM", ["creep", "delay"], 6.0)])
    last = lines.iloc[-1]
    assert (last["constant"], last["other names"], last["wrong"], last["time"]) == (
        "BEAM", 100.0, 100.0, 1.5,
    )  # fmt: skip
    assert lines.iloc[0]["other names"] == 0.0
