"""Comparison of compensators: references of every kind, errors that fall with the belief, warnings."""

from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory.compensator_comparison import KINDS, course, payoff
from rdpi_gym.support.errors import InputError
from tests.looping import over

P5 = rg.plants["P5"]
CREEPING = replace(P5, effects=(rg.effects["creep"](gain_per_decade=0.1),))


@over("kind", KINDS)
def test_a_reference_goes_from_rest_without_a_jump(kind):
    asked = {"kind": kind, "frequency_hz": 2.0, "points": [[0, 3.0], [1.0, -2.0], [1.5, 4.0]]}
    found = course(asked, P5, 1e-3)
    assert abs(found.reference_um[0]) < 0.1
    lead = found.reference_um[: int(0.1 * found.reference_um.size)]
    assert np.abs(np.diff(lead)).max() < 0.1
    assert np.ptp(found.reference_um[found.first :]) > 5.0


@over(
    "reference, said",
    [
        ({"kind": "square"}, "give sine, triangle, stairs, drawn"),
        ({"kind": "sine", "frequency_hz": 900.0}, "give 50 Hz at most"),
        ({"kind": "sine", "amplitude_um": "NaN"}, "amplitude_um = 'NaN'; give a number"),
        ({"kind": "drawn", "points": [[0, 0]]}, "give 2 to 2000"),
        ({"kind": "drawn", "points": [[0, 0], [0, 1]]}, "go forward in time"),
    ],
)
def test_a_reference_that_cannot_be_run_is_one_line(reference, said):
    with pytest.raises(InputError, match=said):
        course(reference, P5, 1e-3)


def test_knowing_the_creep_buys_what_an_inverse_makes_of_it():
    told = []
    found = payoff(
        P5, CREEPING, {"kind": "stairs", "frequency_hz": 1.0, "seconds": 2.0}, 4e-3, "s2",
        lambda stage, done, total: told.append((done, total)),
    )  # fmt: skip
    rows = {row["name"]: row for row in found["rows"]}
    assert len(told) == len(rows) == 7
    extended, plain = rows["extended-inverse"], rows["classical-reference-rate"]
    assert extended["after_um"] < 0.3 * extended["before_um"]
    assert plain["after_um"] == pytest.approx(plain["before_um"], rel=0.01)  # it reads no effect
    assert "no mode" in rows["pi"]["warning"]
    assert (
        found["trace"]["controller"]
        == min(found["rows"], key=lambda r: r["after_um"])["controller"]
    )
    assert (
        len({len(found["trace"][k]) for k in ("t_s", "reference_um", "before_um", "after_um")}) == 1
    )
