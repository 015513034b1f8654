"""The study of the search on every kind of hysteresis: its plants and its table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rdpi_gym.plant import CORES
from studies import effects_on_cores as study
from tests.looping import over

RESULT = Path(study.RESULTS) / "effects_on_cores.md"


def test_every_kind_stands_bare_and_with_an_effect():
    found = study.cases(2, 0)
    assert len({case.key for case in found}) == len(found) == 4 * len(CORES)
    assert {(case.kind, case.hides) for case in found[: 2 * len(CORES)]} == {
        (kind, hides) for kind in CORES for hides in (False, True)
    }


@over("kind", ["stop", "duhem"])
def test_what_is_hidden_shows_and_is_drawn_again_by_its_seed(kind):
    case = study.Case(kind, True, 0, 3)
    core, hidden, data = study.drawn(case)
    again = study.drawn(case)
    assert (core, hidden) == again[:2]
    assert core.name == kind
    assert hidden is not None
    assert [record.role for record in data.records] == ["train", "train", "validation"]
    for record, other in zip(data.records, again[2].records, strict=True):
        np.testing.assert_array_equal(record.y_um, other.y_um)
    bare = study._displacements(core, study._drives(), None)
    noise = study._NOISE * max(np.ptp(y) for y in bare)
    moved = max(
        float(np.std(r.y_um - y)) for r, y in zip(data.records, bare, strict=True)
    )  # fmt: skip
    assert 0.4 * study._SHOWS[0] < moved / noise < 2.5 * study._SHOWS[1]


def test_the_table_counts_kinds_effects_and_silence():
    row = {
        "status": "done", "kind": "stop", "hides": True, "effect": "creep", "form": "power law",
        "chosen": "stop", "alike": ["dahl"], "right": True, "added": ["creep"], "first": True,
        "verdict": "explained", "floors": 1.01, "seconds": 3.0,
    }  # fmt: skip
    bare = row | {"hides": False, "effect": "", "form": "", "first": False, "right": False}
    text = study.report([row, bare], 1, 0)
    assert "in 1 of 2. The effect that is hidden comes first in 1 of 1" in text
    assert "nothing is added to 0 of 1 bare plants" in text
    assert "creep (power law)" in text
    assert RESULT.read_text(encoding="utf-8").startswith("# The search on every kind")
