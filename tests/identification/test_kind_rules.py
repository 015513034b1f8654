"""Which kinds of hysteresis are told apart, by what they leave held out."""

from __future__ import annotations

from typing import Any

import numpy as np

from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.identification.kinds import KindComparison, KindFit, compare_kinds, explained
from rdpi_gym.identification.residuals import PIECES, beats
from rdpi_gym.measurement import Record
from rdpi_gym.plant import CORES, RDPI
from rdpi_gym.plant.cores.bouc_wen import BoucWen
from rdpi_gym.plant.cores.lugre import LuGre

T_S = np.arange(400) * 1e-2
RECORD = Record("loop", T_S, 10.0 * np.sin(T_S), T_S, ts_s=1e-2)
FEW = BoucWen(1.0, -0.4, 4.0, 0.7, 1.5)
MANY = RDPI((1.0, *(0.1,) * 30), tuple(np.arange(0.2, 6.1, 0.2)), 0.0)  # type: ignore[arg-type]
OTHER = LuGre(1.0, 0.1, 0.1, 4.0, 1.3, 10.0)


def rival(core: Any, *left: float, noise: float = 1.0) -> KindFit:
    pieces = np.repeat(np.array(left)[:, None], PIECES, axis=1)
    fit = JointFit(Variant(core, ()), 1.0, (), {}, 1, True)
    return KindFit(fit, pieces, np.full(len(left), noise))


def compared(*rivals: KindFit) -> KindComparison:
    return compare_kinds(rivals, [RECORD])


def test_the_kind_that_leaves_least_is_chosen_and_the_others_are_told_from_it():
    found = compared(rival(FEW, 5.0), rival(MANY, 1.0), rival(OTHER, 9.0))
    assert found.chosen.core is MANY
    assert found.confidence == 1.0
    assert not {"bouc_wen", "lugre"} & set(found.alike)


def test_a_kind_of_many_numbers_has_to_leave_less():
    assert compared(rival(FEW, 1.2), rival(MANY, 1.0)).chosen.core is FEW
    assert compared(rival(FEW, 1.2), rival(OTHER, 1.0)).chosen.core is OTHER
    assert compared(rival(FEW, 1.5), rival(MANY, 1.0)).chosen.core is MANY


def test_where_something_else_is_missing_a_little_less_tells_nothing():
    assert "lugre" in compared(rival(FEW, 10.0), rival(OTHER, 25.0)).alike
    assert (
        "lugre" not in compared(rival(FEW, 10.0, noise=10.0), rival(OTHER, 25.0, noise=10.0)).alike
    )


def test_each_record_counts_alike():
    # what no kind explains in a large record does not hide what tells them apart in a small one
    found = compared(rival(FEW, 1000.0, 9.0), rival(OTHER, 990.0, 90.0))
    assert found.chosen.core is FEW


def test_kinds_that_are_one_model_at_the_numbers_found_are_alike():
    found = compared(rival(CORES["duhem"](1.0, 0.7, 4.0), 1.0), rival(MANY, 50.0))  # type: ignore[call-arg]
    assert set(found.same) == {"bouc_wen", "asymmetric_bouc_wen"} <= set(found.alike)


def test_a_record_that_no_kind_explains_as_the_others_is_left_out():
    u = 10.0 * np.sin(T_S)
    fit = JointFit(Variant(RDPI((1.0,), (), 0.0), ()), 1.0, (), {}, 1, True)
    rng = np.random.default_rng(0)
    shares = {"a": 0.01, "b": 0.02, "c": 0.01, "odd": 0.5}
    made = [
        Record(name, T_S, u, u + share * rng.standard_normal(len(u)), ts_s=1e-2)
        for name, share in shares.items()
    ]
    assert [record.name for record in explained(made, [fit])] == ["a", "b", "c"]
    assert explained(made[2:], [fit]) == made[2:]


def test_the_winner_is_better_in_the_share_of_draws():
    rng = np.random.default_rng(0)
    large, small = np.ones((2, PIECES)), 0.9 * np.ones((2, PIECES))
    assert beats(large, small, rng) == 1.0
    assert beats(small, large, rng) == 0.0
    mixed = np.where(np.arange(2 * PIECES) % 2, 0.8, 1.2).reshape(2, PIECES)
    assert 0.2 < beats(large, mixed, rng) < 0.8
